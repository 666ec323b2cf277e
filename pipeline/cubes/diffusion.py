"""The diffusion coefficient D of momentum, by ensembles: over the plane of two kicks, and on rays
beyond the breakup. Where a barrier exists D is 0, and is not computed.
"""

from functools import partial

import numpy as np
import xarray as xr

from nasm import diffusion
from nasm.critical import Status
from nasm.planes import TWO_KICKS_AXES, two_kicks
from pipeline.cubes.cube import FLAGS, PAPER, STATUS_SETTING, Cube, Job, blank, coordinate, fields
from pipeline.cubes.escape import SECONDS_PER_KICK, beyond_breakup, strengths_beyond

_NO_TRANSPORT = diffusion.Diffusion(0.0, 0.0, np.nan, 0, Status.OK)
_NAMES = {"diffusion": "value", "error": "error", "exponent": "exponent", "steps": "steps"}
_TILE = 4  # cells along each side


def over_plane(name, rays, axis, n_orbits, n_max):
    """Return the Job of D over 0 < κ1, κ2, dims (kappa2, kappa1), of which all else are images.

    rays : list of (angle, scale where a circle is certified, scale of the breakup), increasing,
    from 0 to 45 degrees. axis : grid.Axis, of both strengths.
    """
    coords = {
        dim: coordinate(dim, axis.centres, TWO_KICKS_AXES[dim]) for dim in ("kappa2", "kappa1")
    }
    settings = {"rays": rays, "n_orbits": n_orbits, "n_max": n_max}
    return _job(name, coords, dict.fromkeys(coords, _TILE), settings, _on_plane, _predict_plane)


def beyond(name, scales, excesses, n_orbits, n_max):
    """Return the Job of D at κ = s_c·(1 + excess)·(cos, sin), dims (angle, excess).

    scales : {angle in degrees: scale s_c of the breakup on the ray}. excesses : increasing floats.
    """
    coords, tiles = beyond_breakup(two_kicks(), scales, excesses), {"angle": 1, "excess": 1}
    settings = {"n_orbits": n_orbits, "n_max": n_max}
    return _job(name, coords, tiles, settings, _beyond, _predict_beyond)


def _job(name, coords, tiles, settings, compute, predict):
    variables = {
        "diffusion": blank(coords, "D = <(y_n - y_0)²>/2n; 0 where a barrier exists"),
        "error": blank(coords, "standard error of diffusion"),
        "exponent": blank(coords, "a of <(y_n - y_0)²> ~ n^a, 1 for diffusion"),
        "steps": blank(coords, "periods that orbits were followed; 0 where a barrier exists"),
        "status": blank(coords, "outcome", np.int8(0), **FLAGS),
    }
    attrs = {"title": "Diffusion of momentum, in squares of y a period", "source": PAPER}
    settings = two_kicks().record | settings | STATUS_SETTING
    cube = Cube(name, xr.Dataset(variables, coords, attrs), tiles, settings)
    return Job(cube, compute, predict, partial(diffusion.diffusion, (9.0, 9.0), 64))


def _measured(kappas, there, settings):
    """Return the variables of forcings (..., 2); `there`: whether transport may be global."""
    sizes, found = (settings["n_orbits"], settings["n_max"]), np.empty(there.shape, object)
    for i in np.ndindex(there.shape):
        found[i] = diffusion.diffusion(kappas[i], *sizes) if there[i] else _NO_TRANSPORT
    return fields(found, _NAMES)


def _on_plane(coords, settings):
    kappas = np.stack(np.meshgrid(coords["kappa1"], coords["kappa2"]), axis=-1)
    lower, _ = _nearest_rays(kappas, settings["rays"])
    return _measured(kappas, np.linalg.norm(kappas, axis=-1) > lower, settings)


def _nearest_rays(kappas, rays):
    """Return the least of both scales of `over_plane` on the two rays that enclose a forcing."""
    angles, *scales = np.transpose(rays)
    angle = np.rad2deg(np.arctan2(kappas.min(axis=-1), kappas.max(axis=-1)))
    right = np.searchsorted(angles, angle).clip(1, angles.size - 1)
    return [np.minimum(scale[right - 1], scale[right]) for scale in scales]


def _beyond(coords, settings):
    strengths = strengths_beyond(coords, two_kicks())
    kappas = np.stack(list(strengths.values()), axis=-1)
    return strengths | _measured(kappas, np.ones(kappas.shape[:-1], bool), settings)


def _predict_plane(coords, settings):
    kappas = np.stack(np.meshgrid(coords["kappa1"], coords["kappa2"]), axis=-1)
    scale = np.linalg.norm(kappas, axis=-1)
    lower, breakup = _nearest_rays(kappas, settings["rays"])
    return _seconds(scale[scale > lower] / breakup[scale > lower] - 1, settings)


def _predict_beyond(coords, settings):
    return coords["angle"].size * _seconds(coords["excess"], settings)


def _seconds(excess, settings):
    """Return the CPU time of forcings so far beyond the breakup; the steps are by measurement."""
    steps = 1e4 / np.maximum(excess, 1e-3) ** 3
    n_steps = np.clip(steps, diffusion.SHORTEST, settings["n_max"]).sum()
    return 0.01 + 2 * SECONDS_PER_KICK["double"] * settings["n_orbits"] * n_steps
