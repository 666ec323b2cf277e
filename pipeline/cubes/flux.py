"""The flux through the last circle once it is broken: area per step, ΔW, beyond the breakup.

κ = origin + s_c·(1 + excess)·profile. An outlook of arXiv:1606.04824, Sec. VII; the method is that
of MacKay, Meiss & Percival, Physica D 13 (1984) 55.
"""

from functools import partial

import numpy as np
import xarray as xr

from nasm import flux
from nasm.numbers import parse
from nasm.planes import plane_of
from pipeline.cubes.cube import FLAGS, PAPER, STATUS_SETTING, Cube, Job, blank, fields, text
from pipeline.cubes.escape import beyond_breakup, strengths_beyond


def through_last_circle(plane, scales, circles, excesses, q_max):
    """Return the Job of the cube `flux`. A tile is one forcing.

    scales : {angle in degrees: scale s_c of the breakup on the ray}.
    circles : {angle: exact text of the last circle's ω}.
    excesses : increasing floats.
    q_max : int, the longest period.
    """
    coords = beyond_breakup(plane, scales, excesses)
    coords["circle"] = text("angle", circles.values(), "exact rotation number of the last circle")
    variables = {
        "flux": blank(coords, "area through the broken circle, per step: turns times y"),
        "error": blank(coords, "estimated absolute error of flux"),
        "period": blank(coords, "longest period of the orbits used", np.int32(0)),
        "status": blank(coords, "outcome", np.int8(0), **FLAGS),
    }
    attrs = {"title": "Flux through the remains of the last circle", "source": PAPER}
    settings = plane.record | {"q_max": q_max} | STATUS_SETTING
    template, tile = xr.Dataset(variables, coords, attrs), {"angle": 1, "excess": 1}
    cube = Cube("flux", template, tile, settings)
    return Job(cube, _compute, _predict, partial(flux.action_difference, (0.1, 0.1), 1, 3))


def _compute(coords, settings):
    plane, q_max = plane_of(settings), settings["q_max"]
    strengths = strengths_beyond(coords, plane)
    found = [
        [flux.flux(parse(circle), kappa, q_max) for kappa in on_ray]
        for circle, on_ray in zip(coords["circle"], plane.forcing(*strengths.values()), strict=True)
    ]
    return strengths | fields(found, {"flux": "value", "error": "error", "period": "period"})


def _predict(coords, settings):
    """Predict by the period needed, which grows like 1/excess."""
    return 3e-4 * coords["angle"].size * np.sum(1 / coords["excess"])
