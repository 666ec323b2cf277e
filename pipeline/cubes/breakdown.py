"""Breakup on rays: the scale at which a circle, or the last barrier, breaks on each ray of a plane.

Of several circles, CB_ω, by one of two methods: κ = s·(cos angle, sin angle), arXiv:1606.04824,
Sec. VI. The cubes of `barrier` and `rotating` are made in the same way. Dims are (row, angle): a
row is a circle, a frequency or a phase; `angle` the direction of the ray in a plane of forcings.
"""

from functools import partial
from math import ceil

import numpy as np
import xarray as xr

from nasm import continuation, periodic
from nasm.numbers import parse
from nasm.symmetries import ray
from pipeline.cubes import cube
from pipeline.cubes.cube import FLAGS, KICKS, PAPER, STATUS_SETTING, Job, blank, coordinate

_SCALES = {
    "critical_scale": ("value", "scale of the breakup, best estimate"),
    "error": ("error", "estimated absolute error of critical_scale"),
    "lower": ("lower", "scale at which a circle was shown to exist"),
    "upper": ("upper", "scale at which no circle was shown to be left"),
}
_SECONDS = 3  # of CPU time in a tile, which is a file for every variable


def by_continuation(omegas, angles, tol):
    """Return the Job of the cube `breakdown`: circles continued to their breakdown.

    omegas : list of RotationNumber. angles : degrees. tol : float, the error to aim at.
    """
    settings = {"method": "continuation of circles", "tol": tol}
    warm_up = partial(continuation.critical_scale, parse("gamma"), (1.0, 0.0), 0.1)
    method = partial(_breakup, continuation.critical_scale, "tol")
    return _job(method, warm_up, "breakdown", omegas, angles, 0.01, settings)


def by_residue(omegas, angles, q_max):
    """Return the Job of the cube `breakdown_residue`: Greene's residue.

    omegas : list of RotationNumber. angles : degrees. q_max : int, the longest period.
    """
    settings = {"method": "Greene's residue", "q_max": q_max}
    method = partial(_breakup, periodic.critical_scale, "q_max")
    return _job(method, warm_up_residues, "breakdown_residue", omegas, angles, 0.03, settings)


warm_up_residues = partial(periodic.residue, (0.1, 0.1), 1, 3)


def _job(critical_scale, warm_up, name, omegas, angles, seconds, settings):
    circles = {
        "circle": cube.text("circle", map(str, omegas), "exact rotation number per step"),
        "omega": coordinate("circle", list(map(float, omegas)), "rotation number per step"),
    }
    plan = name, circles, angles, KICKS, seconds, settings
    title = "Breakup of invariant circles of the nonautonomous standard map"
    return job_on_rays(critical_scale, warm_up, *plan, title=title, source=f"{PAPER}, Sec. VI")


def _breakup(method, effort, circle, profile, settings):
    return method(parse(circle), profile, settings[effort])


def cube_on_rays(name, rows, angles, plane, seconds, settings, **attrs):
    """Return the cube of critical scales.

    rows : {name: coordinate}, that of the rows first; {} for a cube with dim (angle).
    plane : {name: words} of the plane's coordinates; those of the breakup are variables.
    seconds : CPU time of a ray. A tile is some rays of one row.
    attrs : title and source.
    """
    coords = {**rows, "angle": cube.angles_of_rays(angles)}
    variables = {key: blank(coords, words) for key, (_, words) in _SCALES.items()}
    variables |= {key: blank(coords, f"{words} at the breakup") for key, words in plane.items()}
    variables["status"] = blank(coords, "outcome", np.int8(0), **FLAGS)
    n_rays = coords["angle"].size
    tile = dict.fromkeys(variables["status"][0], 1)
    tile["angle"] = ceil(n_rays / ceil(n_rays * seconds / _SECONDS))
    return cube.Cube(name, xr.Dataset(variables, coords, attrs), tile, settings | STATUS_SETTING)


def job_on_rays(critical_scale, warm_up, name, rows, angles, plane, seconds, settings, **attrs):
    """Return the Job of a cube on rays, see `cube_on_rays`, with dims (row, angle).

    critical_scale : (row, profile of the ray, settings) → CriticalScale.
    """
    plan = cube_on_rays(name, rows, angles, plane, seconds, settings, **attrs)
    compute = partial(_compute, critical_scale, next(iter(rows)), plane)
    return Job(plan, compute, partial(per_ray, seconds), warm_up)


def _compute(critical_scale, dim, plane, coords, settings):
    rows, profiles = coords[dim].tolist(), ray(coords["angle"])
    found = [[critical_scale(row, profile, settings) for profile in profiles] for row in rows]
    return scales(found, profiles, plane)


def scales(found, profiles, plane):
    """Return the arrays of critical scales `found`, nested lists, on the rays of `profiles`."""
    arrays = cube.fields(found, {key: field for key, (field, _) in _SCALES.items()})
    for name, direction in zip(plane, profiles.T, strict=True):
        arrays[name] = arrays["critical_scale"] * direction
    return arrays


def per_ray(seconds, coords, settings):
    """Predict that each ray of a tile takes as long."""
    return seconds * coords["angle"].size
