"""The last barrier on rays: CB_gt from both sides, and which circle is the last.

κ = s·(cos angle, sin angle), arXiv:1606.04824, Sec. V and VI. CB_gt has the symmetries of the
square (Sec. III), so the rays computed are images of those asked for, in the wedge 0 ≤ κ2 ≤ κ1.
"""

import dataclasses
from functools import partial

import numpy as np

from nasm import barriers
from nasm.symmetries import fold, ray
from pipeline.cubes.cube import PAPER, Job, blank, coordinate
from pipeline.cubes.rays import KICKS, cube_on_rays, per_ray, scales

_N_QUOTIENTS = 32  # places for the partial quotients of a rotation number


def last_barrier(angles, tol):
    """Return the Job of the cube `barrier`; ω is a result, exactly by its partial quotients.

    angles : degrees, any; the cube holds their images. tol : float, the bracket's relative width.
    """
    wedge, _ = fold(angles)
    cube = cube_on_rays(
        "barrier",
        {},
        sorted(set(wedge.round(9).tolist())),
        KICKS,
        1,
        {"tol": tol},
        title="The last barrier to transport of the nonautonomous standard map",
        source=f"{PAPER}, Sec. V and VI",
    )
    place = coordinate("quotient", range(_N_QUOTIENTS), "place of a partial quotient")
    on_ray = {"angle": cube.template.angle}
    template = cube.template.assign_coords(quotient=place).assign(
        omega=blank(on_ray, "rotation number of the last circle, per step, in [0, 1]"),
        quotients=blank(
            {"quotient": place, **on_ray},
            "partial quotients of omega",
            np.int32(0),
            comment="0 behind the last one",
        ),
        tail_length=blank(on_ray, "partial quotients at the end that repeat", np.int8(0)),
    )
    seconds, warm_up = 0.1 + 4e-5 / tol, partial(barriers.critical_scale, (1.0, 0.0), 0.1)
    cube = dataclasses.replace(cube, template=template)
    return Job(cube, _compute, partial(per_ray, seconds), warm_up)


def _compute(coords, settings):
    profiles = ray(coords["angle"])
    found = [barriers.critical_scale(profile, settings["tol"]) for profile in profiles]
    arrays = scales(found, profiles, KICKS)
    arrays["omega"] = np.array([np.nan if s.omega is None else float(s.omega) for s in found])
    arrays["quotients"] = np.zeros((coords["quotient"].size, len(found)), np.int32)
    arrays["tail_length"] = np.zeros(len(found), np.int8)
    for i, omega in enumerate(scale.omega for scale in found):
        if omega is not None:
            quotients = [*omega.prefix, *omega.tail]
            arrays["quotients"][: len(quotients), i] = quotients
            arrays["tail_length"][i] = len(omega.tail)
    return arrays
