"""Transport beyond a breakup, on rays: escape times, flux through the broken circle, diffusion.

κ = origin + s_c·(1 + excess)·profile, where s_c is the scale of the breakup; a tile is one forcing.
Flux and diffusion are part of the outlook of arXiv:1606.04824, Sec. VII; both vanish up to
the breakup.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np
import xarray as xr

from nasm import diffusion as ensembles
from nasm import flux as turnstiles
from nasm.numbers import parse
from nasm.planes import Plane, plane_of, two_kicks
from nasm.symmetries import ray
from nasm.types import FloatArray
from pipeline.cubes import cube, escape
from pipeline.cubes.cube import Arrays, Coords, Job, Labels, Settings
from pipeline.cubes.warm_up import load_orbits

_TILE = {"angle": 1, "excess": 1}

_Method: TypeAlias = Callable[[FloatArray, Coords, Settings], Arrays]
"""Computes a tile's arrays from its forcings (angle, excess, P), coordinates, and settings."""


def escape_times(
    name: str,
    plane: Plane,
    scales: Mapping[float, float],
    excesses: Sequence[float],
    sizes: Sequence[int],
    n_max: int,
) -> Job:
    """Return the Job for first escape times, dims (ensemble, angle, excess).

    Parameters
    ----------
    scales : mapping of float to float
        The scale s_c of the breakup on each ray; the key is the ray's angle in degrees.
    excesses : sequence of float
        Scales relative to s_c, minus 1, in increasing order.
    name, plane, sizes, n_max
        As for `escape.over_plane`.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.beyond import escape_times
    >>> job = escape_times("escape", two_kicks(), {45.0: 1.0}, [0.1, 0.2], [64], 1000)
    >>> dict(job.cube.template.escape_time.sizes)
    {'ensemble': 1, 'angle': 1, 'excess': 2}
    """
    settings, coords = {"n_max": n_max, "precision": "double"}, _coords(plane, scales, excesses)
    title = "First escape times beyond the last barrier"
    compute = partial(_compute, escape.times_of)
    return escape.job(name, plane, sizes, coords, _TILE, settings, title, compute, _predict_escapes)


def flux(
    plane: Plane,
    scales: Mapping[float, float],
    circles: Mapping[float, str],
    excesses: Sequence[float],
    q_max: int,
) -> Job:
    """Return the Job for the flux through the broken last circle: the area ΔW per step.

    Parameters
    ----------
    circles : mapping of float to str
        The exact rotation number of the last circle on each ray; the key is the ray's angle in
        degrees.
    q_max : int
        Longest period of the orbits.
    plane, scales, excesses
        As for `escape_times`.

    References
    ----------
    MacKay, Meiss & Percival, Physica D 13 (1984) 55.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.beyond import flux
    >>> job = flux(two_kicks(), {45.0: 1.0}, {45.0: "2gamma"}, [0.1, 0.2], 100)
    >>> job.cube.template.circle.values
    array(['2gamma'], dtype='<U6')
    """
    coords = _coords(plane, scales, excesses)
    coords["circle"] = cube.text(
        "angle", circles.values(), "exact rotation number of the last circle"
    )
    variables = {
        "flux": cube.blank(coords, "area per step through the broken circle, in turns times y"),
        "error": cube.blank(coords, "estimated absolute error of flux"),
        "period": cube.blank(coords, "longest period of the orbits used", np.int32(0)),
    }
    title, settings = "Flux through the remains of the last circle", {"q_max": q_max}
    return _job(
        "flux", plane, coords, variables, title, settings, _flux, _predict_flux, load_orbits
    )


def diffusion(
    scales: Mapping[float, float], excesses: Sequence[float], n_orbits: int, n_max: int
) -> Job:
    """Return the Job for the momentum diffusion coefficient D under two kicks, from ensembles.

    Parameters
    ----------
    scales, excesses
        As for `escape_times`.
    n_orbits : int
        Number of orbits in the ensemble.
    n_max : int
        Longest time, in steps.

    Examples
    --------
    >>> from pipeline.cubes.beyond import diffusion
    >>> job = diffusion({45.0: 1.0}, [0.1, 0.2], 100, 1000)
    >>> job.cube.tile_counts
    (1, 2)
    """
    plane = two_kicks()
    coords = _coords(plane, scales, excesses)
    variables = {
        "diffusion": cube.blank(coords, "D = <(y_n - y_0)²>/2n, in squares of y per period"),
        "error": cube.blank(coords, "standard error of diffusion"),
    }
    title, settings = "Diffusion of momentum", {"n_orbits": n_orbits, "n_max": n_max}
    warm_up = partial(ensembles.diffusion, (9.0, 9.0), 64)
    return _job(
        "diffusion",
        plane,
        coords,
        variables,
        title,
        settings,
        _diffusion,
        _predict_diffusion,
        warm_up,
    )


def steps_beyond(excess: FloatArray) -> FloatArray:
    """Estimate the steps until one of a few hundred orbits escapes, by the fit 200/excess³."""
    return 200 / excess**3


def _coords(plane: Plane, scales: Mapping[float, float], excesses: Sequence[float]) -> Labels:
    """Return the coordinates; the strengths in the plane are computed tile by tile."""
    coords = {
        "angle": cube.angles_of_rays(list(scales)),
        "excess": cube.coordinate("excess", excesses, "scale relative to the breakup, minus 1"),
        "breakup": cube.coordinate("angle", list(scales.values()), "scale of the breakup"),
    }
    return coords | {name: cube.blank(coords, label) for name, label in plane.axes.items()}


def _job(
    name: str,
    plane: Plane,
    coords: Labels,
    variables: Labels,
    title: str,
    settings: Settings,
    method: _Method,
    predict: Callable[[Coords, Settings], float],
    warm_up: Callable[[], object],
) -> Job:
    """Return the Job whose tiles are computed by `method`."""
    variables["status"] = cube.blank(coords, "outcome", np.int8(0), **cube.FLAGS)
    template = xr.Dataset(variables, coords, {"title": title})
    settings = plane.record | settings | cube.STATUS_SETTING
    plan = cube.Cube(name, template, _TILE, settings)
    return Job(plan, partial(_compute, method), predict, warm_up)


def _compute(method: _Method, coords: Coords, settings: Settings) -> Arrays:
    """Return the strengths (angle, excess) of a tile and the arrays that `method` computes."""
    plane, scales = plane_of(settings), np.outer(coords["breakup"], 1 + coords["excess"])
    directions = zip(plane.axes, ray(coords["angle"]).T, strict=True)
    strengths = {name: scales * along[:, None] for name, along in directions}
    return strengths | method(plane.forcing(*strengths.values()), coords, settings)


def _predict_escapes(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds from the measured growth of escape times."""
    steps = np.minimum(settings["n_max"], steps_beyond(coords["excess"]))
    return escape.seconds(coords, settings, steps.sum() * coords["angle"].size)


def _flux(kappas: FloatArray, coords: Coords, settings: Settings) -> Arrays:
    """Compute the fluxes through the broken circles of a tile."""
    rays, q_max = zip(map(parse, coords["circle"]), kappas, strict=True), settings["q_max"]
    fluxes = [[turnstiles.flux(omega, kappa, q_max) for kappa in along] for omega, along in rays]
    return cube.field_arrays(fluxes, {"flux": "value", "error": "error", "period": "period"})


def _predict_flux(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds from the period needed, which grows like 1/excess."""
    return 3e-4 * coords["angle"].size * np.sum(1 / coords["excess"])


def _diffusion(kappas: FloatArray, coords: Coords, settings: Settings) -> Arrays:
    """Compute the diffusion coefficients of a tile."""
    n_orbits, n_max = settings["n_orbits"], settings["n_max"]
    coefficients = [
        [ensembles.diffusion(kappa, n_orbits, n_max) for kappa in along] for along in kappas
    ]
    return cube.field_arrays(coefficients, {"diffusion": "value", "error": "error"})


def _predict_diffusion(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds from a fit to the steps needed at each excess."""
    steps = 1e4 / np.maximum(coords["excess"], 1e-3) ** 3
    n_steps = np.clip(steps, ensembles.MIN_PERIODS, settings["n_max"]).sum() * coords["angle"].size
    return 0.01 + 2 * escape.SECONDS_PER_KICK["double"] * settings["n_orbits"] * n_steps
