"""The breakup of circles: critical scales of several ω on rays, CB_ω, by one of two methods.

κ = s·(cos angle, sin angle), arXiv:1606.04824, Sec. VI.
"""

import dataclasses
from functools import partial

from nasm import continuation, numbers, periodic
from pipeline.cubes.cube import PAPER, Job, coordinate, text
from pipeline.cubes.rays import KICKS, cube_on_rays, per_ray, tile_on_rays


def by_continuation(omegas, angles, tol):
    """Return the Job of the cube `breakdown`: circles continued to their breakdown.

    omegas : list of RotationNumber. angles : degrees. tol : float, the error to aim at.
    """
    settings = {"method": "continuation of circles", "tol": tol}
    warm_up = partial(continuation.critical_scale, numbers.parse("gamma"), (1.0, 0.0), 0.1)
    return _job("breakdown", omegas, angles, 0.01, settings, _by_continuation, warm_up)


def by_residue(omegas, angles, q_max):
    """Return the Job of the cube `breakdown_residue`: Greene's residue.

    omegas : list of RotationNumber. angles : degrees. q_max : int, the longest period.
    """
    settings = {"method": "Greene's residue", "q_max": q_max}
    return _job("breakdown_residue", omegas, angles, 0.03, settings, _by_residue, warm_up_residues)


warm_up_residues = partial(periodic.residue, (0.1, 0.1), 1, 3)


def _job(name, omegas, angles, seconds, settings, compute, warm_up):
    cube = cube_on_rays(
        name,
        {"circle": text("circle", map(str, omegas), "exact rotation number per step")},
        angles,
        KICKS,
        seconds,
        settings,
        title="Breakup of invariant circles of the nonautonomous standard map",
        source=f"{PAPER}, Sec. VI",
    )
    floats = coordinate("circle", list(map(float, omegas)), "rotation number per step")
    cube = dataclasses.replace(cube, template=cube.template.assign_coords(omega=floats))
    return Job(cube, compute, partial(per_ray, seconds), warm_up)


def _by_continuation(coords, settings):
    return _on_rays(coords, continuation.critical_scale, settings["tol"])


def _by_residue(coords, settings):
    return _on_rays(coords, periodic.critical_scale, settings["q_max"])


def _on_rays(coords, method, effort):
    return tile_on_rays(
        coords,
        "circle",
        KICKS,
        lambda circle, profile: method(numbers.parse(circle), profile, effort),
    )
