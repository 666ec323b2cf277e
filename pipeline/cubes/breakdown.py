"""Breakup on rays: the scale at which a circle, or the last barrier, breaks on each ray of a plane.

κ = origin + s·(cos angle · first + sin angle · second), see `nasm.planes`. Dims are (row, angle): a
row is a circle or a frequency, and a cube without rows has dim (angle). arXiv:1606.04824, Sec. VI.
Angles are in degrees.
"""

from functools import partial
from math import ceil

import numpy as np
import xarray as xr

from nasm import escape, periodic
from nasm.circles import continuation
from nasm.numbers import parse
from nasm.planes import plane_of
from nasm.symmetries import ray
from pipeline.cubes import cube
from pipeline.cubes.cube import FLAGS, PAPER, STATUS_SETTING, Job, blank, coordinate
from pipeline.cubes.escape import SECONDS_PER_KICK

_SCALES = {
    "critical_scale": ("value", "scale of the breakup, best estimate"),
    "error": ("error", "estimated absolute error of critical_scale"),
    "lower": ("lower", "scale at which the barrier was shown to exist"),
    "upper": ("upper", "scale at which the barrier was shown to be gone"),
}
_SECONDS = 3  # of CPU time in a tile, which is a file for every variable
_METHODS = {  # and how hard it tries, at the least
    "continuation of circles": (continuation.critical_scale, {"tol": 0.1}),
    "Greene's residue": (periodic.critical_scale, {"q_max": 10}),
    "direct iteration": (escape.critical_scale, {"n_max": 64, "n_orbits": 1}),
}


def by_continuation(plane, omegas, angles, tol):
    """Return the Job of the cube `breakdown`: circles of `omegas`, RotationNumbers, continued to
    their breakdown; tol is the error to aim at. ValueError if the plane has an origin."""
    settings = {"method": "continuation of circles", "tol": tol}
    plane.rays_start_at_zero(settings["method"])
    return _job("breakdown", plane, _circles(omegas), angles, 0.02, settings)


def by_residue(plane, omegas, angles, q_max):
    """Return the Job of the cube `breakdown_residue`: Greene's residue of periods up to q_max."""
    settings = {"method": "Greene's residue", "q_max": q_max}
    seconds = 0.045 if len(plane.origin) <= 2 else 0.16  # two families of orbits
    return _job("breakdown_residue", plane, _circles(omegas), angles, seconds, settings)


def by_escape(plane, angles, n_max, n_orbits):
    """Return the Job of the cube `transport`: its onset by direct iteration of n_max steps."""
    settings = {"method": "direct iteration", "n_max": n_max, "n_orbits": n_orbits}
    plane.rays_start_at_zero(settings["method"])
    # Some runs of the whole ensemble.
    seconds = 20 * SECONDS_PER_KICK["double"] * len(plane.origin) * n_orbits * n_max
    return _job("transport", plane, {}, angles, seconds, settings)


def job_on_rays(name, axes, rows, angles, seconds, settings, compute, warm_up, title, more=()):
    """Return the Job of a cube of critical scales.

    axes : {name: words} of the plane's coordinates; those of the breakup are coordinates here.
    rows : {name: coordinate}, that of the rows first; {} for a cube with dim (angle).
    seconds : CPU time of a ray. A tile is some rays of one row.
    more : {name: variable} besides those of critical scales.
    """
    known = {**rows, "angle": cube.angles_of_rays(angles)}
    variables = blank_scales(known) | dict(more)
    coords = known | {key: blank(known, f"{words} at the breakup") for key, words in axes.items()}
    n_rays = known["angle"].size
    tile = dict.fromkeys(variables["status"].dims, 1)
    tile["angle"] = ceil(n_rays / ceil(n_rays / max(1, int(_SECONDS / seconds))))
    labels = {"title": f"{title} of the nonautonomous standard map", "source": PAPER}
    plan = cube.Cube(name, xr.Dataset(variables, coords, labels), tile, settings | STATUS_SETTING)
    return Job(plan, compute, lambda coords, _: seconds * coords["angle"].size, warm_up)


def blank_scales(known):
    """Return the variables of a CriticalScale, not computed, over the dimensions `known`."""
    variables = {key: blank(known, words) for key, (_, words) in _SCALES.items()}
    return variables | {"status": blank(known, "outcome", np.int8(0), **FLAGS)}


def scale_fields(found):
    """Return the arrays of these variables; `found` are nested lists of CriticalScale."""
    return cube.fields(found, {key: field for key, (field, _) in _SCALES.items()})


def scales(found, axes, angles):
    """Return the arrays of critical scales `found`, nested lists, on the rays at those angles."""
    arrays = scale_fields(found)
    for name, direction in zip(axes, ray(angles).T, strict=True):
        arrays[name] = arrays["critical_scale"] * direction
    return arrays


def _circles(omegas):
    return {
        "circle": cube.text("circle", map(str, omegas), "exact rotation number per step"),
        "omega": coordinate("circle", list(map(float, omegas)), "rotation number per step"),
    }


def _job(name, plane, rows, angles, seconds, settings):
    one = {key: row.values[:1] for key, row in rows.items()} | {"angle": np.array(angles[:1])}
    settings = plane.record | settings
    warm_up = partial(_compute, one, settings | _METHODS[settings["method"]][1])
    how = seconds, settings, _compute, warm_up, "Breakup of circles"
    return job_on_rays(name, plane.axes, rows, angles, *how)


def _compute(coords, settings):
    (method, least), plane = _METHODS[settings["method"]], plane_of(settings)
    start, profiles = plane.ray(coords["angle"])
    more = [settings[name] for name in least] + ([start] if start.any() else [])
    rows = [[parse(circle)] for circle in coords["circle"]] if "circle" in coords else [[]]
    found = [[method(*row, profile, *more) for profile in profiles] for row in rows]
    return scales(found if "circle" in coords else found[0], plane.axes, coords["angle"])
