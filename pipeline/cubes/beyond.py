"""What there is beyond a breakup, on rays: escapes, flux through the broken circle, diffusion.

κ = origin + s_c·(1 + excess)·profile, with the scale s_c of the breakup; a tile is one forcing.
Flux and diffusion are an outlook of arXiv:1606.04824, Sec. VII; up to the breakup both are 0.
"""

from functools import partial

import numpy as np
import xarray as xr

from nasm import diffusion as ensembles
from nasm import flux as turnstiles
from nasm.numbers import parse
from nasm.planes import plane_of, two_kicks
from nasm.symmetries import ray
from pipeline.cubes import cube, escape
from pipeline.cubes.kernels import load_orbits

_TILE = {"angle": 1, "excess": 1}


def escape_times(name, plane, scales, excesses, sizes, n_max):
    """Return the Job of first escape times, dims (ensemble, angle, excess).

    scales : {angle in degrees: scale s_c of the breakup on the ray}. excesses : increasing floats.
    name, plane, sizes, n_max : as for `escape.over_plane`.
    """
    settings, coords = {"n_max": n_max, "precision": "double"}, _coords(plane, scales, excesses)
    how = "First escape times beyond the last barrier", partial(_compute, escape.times_of)
    return escape.job(name, plane, sizes, coords, _TILE, settings, *how, _predict_escapes)


def flux(plane, scales, circles, excesses, q_max):
    """Return the Job of the flux through the last circle once it is broken: area per step, ΔW.

    plane, scales, excesses : as for `escape_times`. circles : {angle: exact text of the last
    circle's ω}. q_max : int, the longest period. The method is that of MacKay, Meiss & Percival,
    Physica D 13 (1984) 55.
    """
    coords = _coords(plane, scales, excesses)
    words = "exact rotation number of the last circle"
    coords["circle"] = cube.text("angle", circles.values(), words)
    variables = {
        "flux": cube.blank(coords, "area through the broken circle, per step: turns times y"),
        "error": cube.blank(coords, "estimated absolute error of flux"),
        "period": cube.blank(coords, "longest period of the orbits used", np.int32(0)),
    }
    how = {"q_max": q_max}, _flux, _predict_flux, load_orbits
    title = "Flux through the remains of the last circle"
    return _job("flux", plane, coords, variables, title, *how)


def diffusion(scales, excesses, n_orbits, n_max):
    """Return the Job of the diffusion coefficient D of momentum, by ensembles, of two kicks;
    scales, excesses as for `escape_times`."""
    coords = _coords(two_kicks(), scales, excesses)
    variables = {
        "diffusion": cube.blank(coords, "D = <(y_n - y_0)²>/2n, in squares of y a period"),
        "error": cube.blank(coords, "standard error of diffusion"),
    }
    warm_up = partial(ensembles.diffusion, (9.0, 9.0), 64)
    how = {"n_orbits": n_orbits, "n_max": n_max}, _diffusion, _predict_diffusion, warm_up
    return _job("diffusion", two_kicks(), coords, variables, "Diffusion of momentum", *how)


def steps_beyond(excess):
    """Return about how many steps the first escape of hundreds of orbits takes, by measurement."""
    return 200 / excess**3


def _coords(plane, scales, excesses):
    """Return the coordinates; those in the plane are computed with each tile."""
    coords = {
        "angle": cube.angles_of_rays(list(scales)),
        "excess": cube.coordinate("excess", excesses, "scale in parts of the breakup's, less 1"),
        "breakup": cube.coordinate("angle", list(scales.values()), "scale of the breakup"),
    }
    return coords | {name: cube.blank(coords, words) for name, words in plane.axes.items()}


def _job(name, plane, coords, variables, title, settings, method, predict, warm_up):
    variables["status"] = cube.blank(coords, "outcome", np.int8(0), **cube.FLAGS)
    template = xr.Dataset(variables, coords, {"title": title, "source": cube.PAPER})
    settings = plane.record | settings | cube.STATUS_SETTING
    plan = cube.Cube(name, template, _TILE, settings)
    return cube.Job(plan, partial(_compute, method), predict, warm_up)


def _compute(method, coords, settings):
    """Return where the forcings (angle, excess) of a tile are, and what `method` says of them."""
    plane, scales = plane_of(settings), np.outer(coords["breakup"], 1 + coords["excess"])
    parts = zip(plane.axes, ray(coords["angle"]).T, strict=True)
    strengths = {name: scales * along[:, None] for name, along in parts}
    return strengths | method(plane.forcing(*strengths.values()), coords, settings)


def _predict_escapes(coords, settings):
    steps = np.minimum(settings["n_max"], steps_beyond(coords["excess"]))
    return escape.seconds(coords, settings, steps.sum() * coords["angle"].size)


def _flux(kappas, coords, settings):
    rays, q_max = zip(map(parse, coords["circle"]), kappas, strict=True), settings["q_max"]
    found = [[turnstiles.flux(omega, kappa, q_max) for kappa in along] for omega, along in rays]
    return cube.fields(found, {"flux": "value", "error": "error", "period": "period"})


def _predict_flux(coords, settings):
    """Predict by the period needed, which grows like 1/excess."""
    return 3e-4 * coords["angle"].size * np.sum(1 / coords["excess"])


def _diffusion(kappas, coords, settings):
    sizes = settings["n_orbits"], settings["n_max"]
    found = [[ensembles.diffusion(kappa, *sizes) for kappa in along] for along in kappas]
    return cube.fields(found, {"diffusion": "value", "error": "error"})


def _predict_diffusion(coords, settings):
    """Predict by the steps that forcings so far beyond the breakup need, by measurement."""
    steps = 1e4 / np.maximum(coords["excess"], 1e-3) ** 3
    n_steps = np.clip(steps, ensembles.MIN_PERIODS, settings["n_max"]).sum() * coords["angle"].size
    return 0.01 + 2 * escape.SECONDS_PER_KICK["double"] * settings["n_orbits"] * n_steps
