"""Critical scales on rays: what the cubes of `breakdown`, `barrier` and `rotating` have in common.

Their dims are (row, angle): a row is a circle, a frequency or a phase; `angle` the direction of the
ray in a plane of forcings, on which a method finds the scale of the breakup.
"""

from math import ceil

import numpy as np
import xarray as xr

from nasm.symmetries import ray
from pipeline.cubes.cube import FLAGS, STATUS_SETTING, Cube, blank, coordinate, fields

KICKS = {"kappa1": "strength of the first kick", "kappa2": "strength of the second kick"}
ROTATING = {"kappa_mean": "mean strength κ̄", "kappa_amplitude": "amplitude Δκ of the strengths"}
_SCALES = {
    "critical_scale": ("value", "scale of the breakup, best estimate"),
    "error": ("error", "estimated absolute error of critical_scale"),
    "lower": ("lower", "scale at which a circle was shown to exist"),
    "upper": ("upper", "scale at which no circle was shown to be left"),
}
_SECONDS = 3  # of CPU time in a tile, which is a file for every variable


def angles_of_rays(angles):
    """Return the coordinate `angle`, in degrees."""
    return coordinate("angle", angles, "direction of the ray in the plane", "degree")


def rows_of(dim, exact, long_name):
    """Return {dim: coordinate} of numbers {exact text: float}."""
    return {dim: coordinate(dim, list(exact.values()), long_name, exact=list(exact))}


def cube_on_rays(name, rows, angles, plane, seconds, settings, **attrs):
    """Return the cube of critical scales.

    rows : {dim: coordinate}, or {} for a cube with dim (angle).
    plane : KICKS or ROTATING; the coordinates of the breakup are variables.
    seconds : CPU time of a ray. A tile is some rays of one row.
    attrs : title and source.
    """
    coords = {**rows, "angle": angles_of_rays(angles)}
    variables = {key: blank(coords, words) for key, (_, words) in _SCALES.items()}
    variables |= {key: blank(coords, f"{words} at the breakup") for key, words in plane.items()}
    variables["status"] = blank(coords, "outcome", np.int8(0), **FLAGS)
    n_rays = coords["angle"].size
    tile = {**dict.fromkeys(rows, 1), "angle": ceil(n_rays / ceil(n_rays * seconds / _SECONDS))}
    return Cube(name, xr.Dataset(variables, coords, attrs), tile, settings | STATUS_SETTING)


def tile_on_rays(coords, dim, plane, critical_scale):
    """Return the arrays of a tile with dims (dim, angle), by critical_scale(row, profile)."""
    profiles = ray(coords["angle"])
    found = [[critical_scale(row, profile) for profile in profiles] for row in coords[dim].tolist()]
    return scales(found, profiles, plane)


def scales(found, profiles, plane):
    """Return the arrays of critical scales `found`, nested lists, on the rays of `profiles`."""
    arrays = fields(found, {key: field for key, (field, _) in _SCALES.items()})
    for name, direction in zip(plane, profiles.T, strict=True):
        arrays[name] = arrays["critical_scale"] * direction
    return arrays


def per_ray(seconds, coords, settings):
    """Predict that each ray of a tile takes as long."""
    return seconds * coords["angle"].size
