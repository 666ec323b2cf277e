"""Breakup on rays: the scale at which a circle, or the last barrier, breaks on each ray of a plane.

κ = origin + s·(cos angle · first + sin angle · second), see `nasm.planes`. Dims are (row, angle): a
row is a circle or a frequency, and a cube without rows has dim (angle). arXiv:1606.04824, Sec. VI.
Angles are in degrees.

Continuation ends before the tolerance where a circle has no modes left to show its breakup: next to
cusps, and for rotation numbers whose quotients are large. Residues of long orbits reach it there,
and the variable `method` tells which of the two has answered.
"""

from dataclasses import replace
from functools import partial
from math import ceil

import numpy as np
import xarray as xr

from nasm import escape, periodic
from nasm.circles import continuation
from nasm.critical import Status
from nasm.numbers import parse
from nasm.planes import plane_of
from nasm.symmetries import ray
from pipeline.cubes import cube
from pipeline.cubes.cube import FLAGS, PAPER, STATUS_SETTING, Job, blank, coordinate
from pipeline.cubes.escape import SECONDS_PER_KICK
from pipeline.cubes.kernels import load_orbits

_SCALES = {
    "critical_scale": ("value", "scale of the breakup, best estimate"),
    "error": ("error", "estimated absolute error of critical_scale"),
    "lower": ("lower", "scale at which the barrier was shown to exist"),
    "upper": ("upper", "scale at which the barrier was shown to be gone"),
}
_SECONDS = 3  # of CPU time in a tile, which is a file for every variable
_FLAG_OF = {  # CriticalScale.method: its word in the flags of the variable `method`
    continuation.METHOD: "continuation",
    periodic.METHOD: "residue",
    escape.METHOD: "direct_iteration",
}


def continued_or_by_residue(omega, profile, tol, q_max):
    """The scale at which the circle of ω breaks on the ray κ = s·profile: a CriticalScale.

    By continuation, if that reaches an error of tol; else by Greene's residue of periods up to
    q_max, unless that has no answer either or a larger error. `lower` is that of continuation: the
    scale of a certified circle.
    """
    continued = continuation.critical_scale(omega, profile, tol)
    if continued.error <= tol:
        return continued
    found = periodic.critical_scale(omega, profile, q_max)
    better = found.status is Status.OK and not continued.error <= found.error
    return replace(found, lower=continued.lower) if better else continued


_CONTINUED = f"{continuation.METHOD}, else {periodic.METHOD}"
_METHODS = {  # and how hard it tries, at the least
    _CONTINUED: (continued_or_by_residue, {"tol": 0.1, "q_max": 10}),
    periodic.METHOD: (periodic.critical_scale, {"q_max": 10}),
    escape.METHOD: (escape.critical_scale, {"n_max": 64, "n_orbits": 1}),
}


def by_continuation(plane, omegas, angles, tol, q_max=6000):
    """Return the Job of the cube `breakdown`: circles of `omegas`, RotationNumbers, continued to
    their breakdown, and where that does not reach the error tol, their residues up to the period
    q_max. ValueError if the plane has an origin."""
    plane.rays_start_at_zero(continuation.METHOD)
    settings = {"method": _CONTINUED, "tol": tol, "q_max": q_max}
    # A fifth of the main job's rays need residues; with a smaller tol nearly all do.
    seconds = 0.03 if tol >= 1e-4 else 0.1
    job = _job("breakdown", plane, _circles(omegas), angles, seconds, settings)
    return replace(job, predict=partial(_predict_continuation, seconds))


def _predict_continuation(seconds, coords, settings):
    """Predict by the tail of ω: golden ones take half of the mean of the paper's six circles, those
    of fours, whose breakup takes more modes to be seen, twice as much."""
    is_golden = [parse(circle).tail == (1,) for circle in coords["circle"]]
    return seconds * coords["angle"].size * np.where(is_golden, 0.5, 1.9).sum()


def by_residue(plane, omegas, angles, q_max):
    """Return the Job of the cube `breakdown_residue`: Greene's residue of periods up to q_max."""
    settings = {"method": periodic.METHOD, "q_max": q_max}
    seconds = 0.045 if len(plane.origin) <= 2 else 0.16  # two families of orbits
    return _job("breakdown_residue", plane, _circles(omegas), angles, seconds, settings)


def by_escape(plane, angles, n_max, n_orbits):
    """Return the Job of the cube `transport`: its onset by direct iteration of n_max steps."""
    settings = {"method": escape.METHOD, "n_max": n_max, "n_orbits": n_orbits}
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
    warm_up = partial(_load, one, settings | _METHODS[settings["method"]][1])
    on = {**rows, "angle": cube.angles_of_rays(angles)}
    words = "what has answered, or says why there is no answer"
    more = {"method": blank(on, words, np.int8(0), **cube.flags(_FLAG_OF.values()))}
    how = seconds, settings, _compute, warm_up, "Breakup of circles", more
    return job_on_rays(name, plane.axes, rows, angles, *how)


def _load(coords, settings):
    """Compile the kernels of a method, by the least that it can be asked."""
    if settings["method"] != escape.METHOD:
        load_orbits()
    _compute(coords, settings)


def _compute(coords, settings):
    (method, least), plane = _METHODS[settings["method"]], plane_of(settings)
    start, profiles = plane.ray(coords["angle"])
    more = [settings[name] for name in least] + ([start] if start.any() else [])
    rows = [[parse(circle)] for circle in coords["circle"]] if "circle" in coords else [[]]
    found = [[method(*row, profile, *more) for profile in profiles] for row in rows]
    found = found if "circle" in coords else found[0]
    answers = cube.codes(found, lambda one: 1 + [*_FLAG_OF].index(one.method))
    return scales(found, plane.axes, coords["angle"]) | {"method": answers}
