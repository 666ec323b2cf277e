"""Breakup on rays: the scale at which a circle, or the last barrier, breaks on each ray of a plane.

κ = origin + s·(cos angle · first + sin angle · second), see `nasm.planes`. Dims are (row, angle): a
row is a circle or a frequency, and a cube without rows has dim (angle). arXiv:1606.04824, Sec. VI.
"""

import re
from fractions import Fraction
from functools import partial
from math import ceil

import numpy as np
import xarray as xr

from nasm import continuation, escape, periodic, transversals
from nasm.numbers import parse
from nasm.planes import ROTATING_AXES, plane_of
from nasm.symmetries import ray
from pipeline.cubes import cube
from pipeline.cubes.cube import FLAGS, PAPER, STATUS_SETTING, Job, blank, coordinate
from pipeline.cubes.escape import SECONDS_PER_KICK, warm_up_escape

_SCALES = {
    "critical_scale": ("value", "scale of the breakup, best estimate"),
    "error": ("error", "estimated absolute error of critical_scale"),
    "lower": ("lower", "scale at which a circle was shown to exist"),
    "upper": ("upper", "scale at which no circle was shown to be left"),
}
_SECONDS = 3  # of CPU time in a tile, which is a file for every variable


def by_continuation(plane, omegas, angles, tol):
    """Return the Job of the cube `breakdown`: circles continued to their breakdown.

    omegas : list of RotationNumber. angles : degrees. tol : float, the error to aim at.
    """
    starts_at_zero(plane, "the continuation of circles")
    settings = {"method": "continuation of circles", "tol": tol}
    warm_up = partial(continuation.critical_scale, parse("gamma"), (1.0, 0.0), 0.1)
    plan = "breakdown", plane, _circles(omegas), angles, 0.01, settings, ["tol"]
    return _on_plane(continuation.critical_scale, warm_up, *plan)


def by_residue(plane, omegas, angles, q_max):
    """Return the Job of the cube `breakdown_residue`: Greene's residue.

    omegas : list of RotationNumber. angles : degrees. q_max : int, the longest period.
    """
    for start, profile in map(plane.ray, angles):
        periodic.dominant_centre(start + profile)
    settings = {"method": "Greene's residue", "q_max": q_max}
    plan = "breakdown_residue", plane, _circles(omegas), angles, 0.03, settings, ["q_max"]
    return _on_plane(periodic.critical_scale, _warm_up_residues, *plan)


def by_escape(plane, angles, n_max, n_orbits):
    """Return the Job of the cube `transport`: its onset by direct iteration.

    angles : degrees. n_max : int, steps (periods of the forcing). n_orbits : int.
    """
    starts_at_zero(plane, "direct iteration on rays")
    settings = {"method": "direct iteration", "n_max": n_max, "n_orbits": n_orbits}
    # Ten runs of the whole ensemble.
    seconds = 10 * SECONDS_PER_KICK * len(plane.origin) * n_orbits * n_max
    plan = "transport", plane, {}, angles, seconds, settings, ["n_max", "n_orbits"]
    return _on_plane(escape.critical_scale, warm_up_escape, *plan)


def by_transversals(plane, angles, n_max):
    """Return the Job of last barriers by converse KAM, which needs no symmetry centre.

    Its cube has the plane's name, like transversals_rotating_1_3_1_48, so that one store can hold
    those of several planes.

    angles : degrees. n_max : int, steps (periods of the forcing).
    """
    starts_at_zero(plane, "converse KAM on transversals")
    settings = {"method": "converse KAM on transversals", "n_max": n_max}
    warm_up = partial(transversals.critical_scale, (1.0,), 30)
    name = re.sub(r"\W+", "_", f"transversals_{plane.name}", flags=re.ASCII)
    plan = name, plane, {}, angles, 0.4 + 2.5e-3 * n_max, settings, ["n_max"]
    return _on_plane(transversals.critical_scale, warm_up, *plan)


def tori(vectors, angles):
    """Return the Job of the cube `rotating_tori`: breakup of tori by the residue of a long orbit.

    κ_n = s·(cos angle + sin angle · cos 2πnΩ), of any frequency: no plane of periodic forcings.

    vectors : list of "p/q,Ω", an orbit's turns per kick and the frequency. angles : degrees.
    """
    exact = [vector.split(",")[1] for vector in vectors]
    settings = {"frequencies": exact, "vectors": list(vectors)}
    settings |= {"method": "Greene's residue of one orbit"}
    numbers = list(map(float, map(Fraction, exact)))
    rows = {"frequency": coordinate("frequency", numbers, "frequency Ω", exact=exact)}
    plan = "rotating_tori", ROTATING_AXES, rows, angles, 0.04, settings
    return _job(_torus, _warm_up_residues, *plan)


_warm_up_residues = partial(periodic.residue, (0.1, 0.1), 1, 3)


def starts_at_zero(plane, method):
    """Refuse a plane whose rays do not begin without kicks; ValueError."""
    if any(plane.origin):
        raise ValueError(
            f"plane={plane.name} has the origin {plane.origin}; {method} needs rays from zero: "
            "take a plane whose origin is zero"
        )


def _circles(omegas):
    return {
        "circle": cube.text("circle", map(str, omegas), "exact rotation number per step"),
        "omega": coordinate("circle", list(map(float, omegas)), "rotation number per step"),
    }


def _on_plane(method, warm_up, name, plane, rows, angles, seconds, settings, efforts):
    plan = name, plane.axes, rows, angles, seconds, plane.record | settings
    return _job(partial(_on_ray, method, efforts), warm_up, *plan)


def _on_ray(method, efforts, settings, angle, *circle):
    start, profile = plane_of(settings).ray(angle)
    segment = {"start": start} if start.any() else {}
    return method(*map(parse, circle), profile, *map(settings.get, efforts), **segment)


def _job(critical_scale, warm_up, name, axes, rows, angles, seconds, settings):
    """critical_scale : (settings, angle, row, if there are rows) → CriticalScale."""
    title = "Breakup of invariant circles of the nonautonomous standard map"
    plan = cube_on_rays(name, axes, rows, angles, seconds, settings, title=title, source=PAPER)
    compute = partial(_compute, critical_scale, next(iter(rows), None), list(axes))
    return Job(plan, compute, partial(per_ray, seconds), warm_up)


def cube_on_rays(name, axes, rows, angles, seconds, settings, **attrs):
    """Return the cube of critical scales.

    axes : {name: words} of the plane's coordinates; those of the breakup are variables.
    rows : {name: coordinate}, that of the rows first; {} for a cube with dim (angle).
    seconds : CPU time of a ray. A tile is some rays of one row.
    attrs : title and source.
    """
    coords = {**rows, "angle": cube.angles_of_rays(angles)}
    variables = {key: blank(coords, words) for key, (_, words) in _SCALES.items()}
    variables |= {key: blank(coords, f"{words} at the breakup") for key, words in axes.items()}
    variables["status"] = blank(coords, "outcome", np.int8(0), **FLAGS)
    n_rays = coords["angle"].size
    tile = dict.fromkeys(variables["status"][0], 1)
    tile["angle"] = ceil(n_rays / ceil(n_rays * seconds / _SECONDS))
    return cube.Cube(name, xr.Dataset(variables, coords, attrs), tile, settings | STATUS_SETTING)


def _compute(critical_scale, dim, axes, coords, settings):
    angles, rows = coords["angle"], coords[dim].tolist() if dim else []
    found = [[critical_scale(settings, angle, row) for angle in angles] for row in rows]
    found = found or [critical_scale(settings, angle) for angle in angles]
    return scales(found, axes, angles)


def scales(found, axes, angles):
    """Return the arrays of critical scales `found`, nested lists, on the rays at those angles."""
    arrays = cube.fields(found, {key: field for key, (field, _) in _SCALES.items()})
    for name, direction in zip(axes, ray(angles).T, strict=True):
        arrays[name] = arrays["critical_scale"] * direction
    return arrays


def per_ray(seconds, coords, settings):
    """Predict that each ray of a tile takes as long."""
    return seconds * coords["angle"].size


def _torus(settings, angle, frequency):
    vectors = (vector.split(",") for vector in settings["vectors"])
    exact = {float(Fraction(text)): (omega, text) for omega, text in vectors}
    return periodic.torus_scale(*exact[frequency], *ray(angle))
