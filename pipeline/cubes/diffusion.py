"""The diffusion coefficient D of momentum, by ensembles, on rays beyond the breakup.

Up to the breakup a barrier exists and D is 0; nothing is computed there.
"""

from functools import partial

import numpy as np
import xarray as xr

from nasm import diffusion
from nasm.planes import two_kicks
from pipeline.cubes.cube import FLAGS, PAPER, STATUS_SETTING, Cube, Job, blank, fields
from pipeline.cubes.escape import SECONDS_PER_KICK, beyond_breakup, strengths_beyond

_NAMES = {"diffusion": "value", "error": "error", "exponent": "exponent", "steps": "steps"}


def beyond(scales, excesses, n_orbits, n_max):
    """Return the Job of D at κ = s_c·(1 + excess)·(cos, sin), dims (angle, excess).

    scales : {angle in degrees: scale s_c of the breakup on the ray}. excesses : increasing floats.
    A tile is one forcing.
    """
    coords = beyond_breakup(two_kicks(), scales, excesses)
    variables = {
        "diffusion": blank(coords, "D = <(y_n - y_0)²>/2n, in squares of y a period"),
        "error": blank(coords, "standard error of diffusion"),
        "exponent": blank(coords, "a of <(y_n - y_0)²> ~ n^a, 1 for diffusion"),
        "steps": blank(coords, "periods that orbits were followed"),
        "status": blank(coords, "outcome", np.int8(0), **FLAGS),
    }
    attrs = {"title": "Diffusion of momentum", "source": PAPER}
    settings = {"n_orbits": n_orbits, "n_max": n_max} | two_kicks().record | STATUS_SETTING
    template, tile = xr.Dataset(variables, coords, attrs), {"angle": 1, "excess": 1}
    warm_up = partial(diffusion.diffusion, (9.0, 9.0), 64)
    return Job(Cube("diffusion", template, tile, settings), _compute, _predict, warm_up)


def _compute(coords, settings):
    strengths = strengths_beyond(coords, two_kicks())
    sizes = settings["n_orbits"], settings["n_max"]
    kappas = np.stack(list(strengths.values()), axis=-1)
    found = [[diffusion.diffusion(kappa, *sizes) for kappa in on_ray] for on_ray in kappas]
    return strengths | fields(found, _NAMES)


def _predict(coords, settings):
    """Predict by the steps that forcings so far beyond the breakup need, by measurement."""
    steps = 1e4 / np.maximum(coords["excess"], 1e-3) ** 3
    n_steps = np.clip(steps, diffusion.SHORTEST, settings["n_max"]).sum() * coords["angle"].size
    return 0.01 + 2 * SECONDS_PER_KICK["double"] * settings["n_orbits"] * n_steps
