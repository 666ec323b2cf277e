"""The last barrier on rays: CB_gt from both sides, and which circle is the last.

On rays of a plane of forcings, arXiv:1606.04824, Sec. V and VI. CB_gt has the symmetries of its
plane (Sec. III and `nasm.planes`), so that the rays computed stand for their images too.
"""

import re
from functools import partial

import numpy as np

from nasm import barriers
from nasm.numbers import RotationNumber, moebius, parse
from nasm.planes import plane_of, two_kicks
from nasm.symmetries import ray
from pipeline.cubes.breakdown import job_on_rays, scales
from pipeline.cubes.cube import NO_MEAN, angles_of_rays, blank, coordinate, text
from pipeline.cubes.kernels import load_search, load_searches

_N_QUOTIENTS = 32  # places for the partial quotients of a rotation number


def last_barrier(plane, angles, tol, name="barrier"):
    """Return the Job of the cube `barrier`; ω is a result, exactly by its partial quotients.

    angles : degrees, any; the cube holds those that they fold to, in the plane's symmetries.
    tol : float, the bracket's relative width.
    name : of the cube; another one where a store holds those of several planes.
    """
    two_kicks = len(plane.origin) <= 2  # some rays of longer ones repeat after one or two
    warm_up = partial(load_search, sum(plane.ray(30.0))) if two_kicks else load_searches
    seconds = 0.1 + 1.8e-5 / tol if two_kicks else 1 + 5e-4 / tol
    return job_of_barriers(name, plane, angles, seconds, {"tol": tol}, _compute, warm_up)


def job_of_barriers(name, plane, angles, seconds, settings, compute, warm_up, more=()):
    """Return the Job of a cube of last barriers; see `job_on_rays`.

    angles : as for `last_barrier`. more : {name: words} of further variables.
    """
    wedge = sorted(set(plane.fold(angles)[0].tolist()))
    on_ray = {"angle": angles_of_rays(wedge)}
    more = last_circles(on_ray) | {key: blank(on_ray, words) for key, words in dict(more).items()}
    how = seconds, plane.record | settings, compute, warm_up, "The last barrier to transport", more
    return job_on_rays(name, plane.axes, {}, wedge, *how)


def last_circles(on):
    """Return the variables of last circles over the coordinates `on`."""
    place = {"quotient": coordinate("quotient", range(_N_QUOTIENTS), "place of a partial quotient")}
    step, omega = f"jumps from circle to circle; {NO_MEAN}", "rotation number of the last circle"
    ends, tail = f"0 behind the last one; {NO_MEAN}", "partial quotients at the end that repeat"
    return place | {
        "omega": blank(on, f"{omega}, per step", comment=step),
        "quotients": blank(place | on, "partial quotients of omega", np.int32(0), comment=ends),
        "tail_length": blank(on, tail, np.int8(0), comment=NO_MEAN),
    }


def named(plane):
    """Return the name of the cube in a store of several planes, like barrier_rotating_1_3_1_60."""
    return re.sub(r"\W+", "_", f"barrier_{plane.name}", flags=re.ASCII)


def boundary(angles, tol=1e-4, plane=None):
    """Compute CB_gt on rays at any angles: the Dataset of `unfolded`, without workers or a store.

    angles : degrees. tol : float, 1e-5 to 0.1, the bracket's relative width. plane : of forcings,
    `nasm.planes.two_kicks()` by default. A ray that is no image of another one takes 0.3 s of CPU
    time at 1e-4, and 1 s at 2e-5.
    """
    cube = last_barrier(plane or two_kicks(), angles, tol).cube
    filled = cube.filled(_compute({"angle": cube.template.angle.values}, cube.settings))
    return unfolded(filled.assign_attrs(cube.attributes), angles)


def unfolded(barrier, angles):
    """Return the cube `barrier` on rays whose images it holds: a Dataset with dim (angle).

    Its coordinate `circle` is the exact text of the last circle's ω in [0, P/2], "" where none is
    named (NaN once it is read from a store); that of P - ω is its mirror image. `tied` is that of
    a circle that breaks together with it, as on the axes of two kicks; "" elsewhere.
    """
    angles, plane = np.asarray(angles, dtype=float), plane_of(barrier.attrs)
    folded, shifts = plane.fold(angles)
    there = barrier.sel(angle=folded, method="nearest", tolerance=1e-8)
    there = with_circles(there, shifts.tolist(), "step")
    ties = map(partial(tie, plane), there.circle.values, angles, there.critical_scale.values)
    tied = text("angle", ties, "that of a circle that breaks with it")
    table = there.assign_coords(angle=angles_of_rays(angles), tied=tied)
    for name, direction in zip(plane.axes, ray(angles).T, strict=True):
        table[name] = table[name].copy(data=table.critical_scale.values * direction)
    table["omega"] = table.omega.copy(data=np.where(shifts, shifts - table.omega, table.omega))
    return table


def with_circles(cube, shifts=None, per="period"):
    """Return the cube, read, with the coordinate `circle` in place of partial quotients.

    It is the exact text of the last circle's ω, or of shift - ω where one of `shifts` is not 0; ""
    where none is named.
    """
    circles, (dim,) = [], cube.load().tail_length.dims
    shifts = [0] * cube.sizes[dim] if shifts is None else shifts
    entries = cube.quotients.values.T.tolist(), cube.tail_length.values.tolist(), shifts
    for quotients, length, shift in zip(*entries, strict=True):
        quotients = tuple(np.trim_zeros(quotients, "b"))
        omega = quotients and RotationNumber(quotients[:-length], quotients[-length:])
        circles.append(str(moebius(omega, -1, shift) if omega and shift else omega or ""))
    circle = text(dim, circles, f"exact rotation number of the last circle, per {per}")
    return cube.drop_vars(["quotients", "tail_length", "quotient"]).assign_coords(circle=circle)


def tie(plane, circle, angle, scale):
    """Return the text of the ω that breaks together with that of `circle`, at scale; else ""."""
    start, profile = plane.ray(angle)
    return str(barriers.tied(parse(circle), start + scale * profile) or "") if circle else ""


def _compute(coords, settings):
    (start, profiles), tol = plane_of(settings).ray(coords["angle"]), settings["tol"]
    found = [barriers.critical_scale(profile, tol, start) for profile in profiles]
    return scales(found, plane_of(settings).axes, coords["angle"]) | circle_arrays(found)


def circle_arrays(found):
    """Return the arrays of `last_circles`; `found` is a list."""
    arrays = {"omega": np.array([s.omega and float(s.omega) for s in found], dtype=float)}
    known = [(s.omega.prefix, s.omega.tail) if s.omega else ((), ()) for s in found]
    rows = [[*prefix, *tail] for prefix, tail in known]
    padded = [row + [0] * (_N_QUOTIENTS - len(row)) for row in rows]
    arrays["quotients"] = np.array(padded, np.int32).T
    arrays["tail_length"] = np.array([len(tail) for _, tail in known], np.int8)
    return arrays
