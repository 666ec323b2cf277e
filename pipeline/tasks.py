"""Tasks: pure functions (coordinates of a tile, settings) → arrays, each wrapping a nasm kernel.

For each cube there is one that computes a tile, and one that predicts its cost in CPU seconds from
a small probe, so that a sweep can start with the expensive tiles and batch the cheap ones.
"""

import numpy as np

from nasm import escape, numbers, periodic
from nasm.critical import Status

_SECONDS_PER_STEP = 0.8e-9  # of one orbit and one step of two kicks; only ratios matter
_PROBE_STEPS = 2000


def escape_tile(coords, settings):
    """First escape times of the nested ensembles over one tile of the (κ1, κ2) plane.

    coords : arrays `kappa1`, `kappa2`, `ensemble`; settings : `n_max`, `window`.
    Returns {"escape_time": array (ensemble, kappa2, kappa1)}.
    """
    sizes = coords["ensemble"]
    x, y = escape.ensemble(int(sizes[-1]))
    times = escape.first_escape(
        _strengths(coords), x, y, sizes, settings["n_max"], settings["window"]
    )
    return {"escape_time": times}


def escape_cost(coords, settings):
    """Predicted CPU seconds of `escape_tile`: a few cells, 64 orbits, up to 2000 steps.

    A cell that the probe sees escape costs its escape time, any other one n_max; times all orbits.
    """
    probed = {dim: coords[dim][:: max(1, coords[dim].size // 3)] for dim in ("kappa2", "kappa1")}
    n_max, n_orbits = settings["n_max"], int(coords["ensemble"][-1])
    x, y = escape.ensemble(64)
    kappas = _strengths(probed)
    times = escape.first_escape(kappas, x, y, [64], min(n_max, _PROBE_STEPS), settings["window"])
    steps = np.where(np.isinf(times), n_max, times).mean()
    cells = coords["kappa2"].size * coords["kappa1"].size
    return _SECONDS_PER_STEP * n_orbits * steps * cells


def residue_tile(coords, settings):
    """Critical scales by Greene's residue, of the circles `omega` on the rays `angle`.

    settings : `omegas`, the exact texts of all rotation numbers; `q_max`, the longest period.
    """
    exact = {float(omega): omega for omega in map(numbers.parse, settings["omegas"])}
    radians = np.deg2rad(coords["angle"])
    profiles = np.stack([np.cos(radians), np.sin(radians)], axis=-1)
    # Exactly on a diagonal the map is shorter, and cos 45° and sin 45° differ by rounding.
    on_diagonal = coords["angle"] % 90 == 45
    profiles[on_diagonal] = np.sign(profiles[on_diagonal]) * np.sqrt(0.5)
    found = [
        [periodic.critical_scale(exact[omega], profile, settings["q_max"]) for profile in profiles]
        for omega in coords["omega"].tolist()
    ]
    arrays = {
        name: np.array([[getattr(scale, attribute) for scale in row] for row in found])
        for name, attribute in _BREAKDOWN.items()
    }
    arrays["kappa1"] = arrays["critical_scale"] * profiles[:, 0]
    arrays["kappa2"] = arrays["critical_scale"] * profiles[:, 1]
    arrays["status"] = np.array([[1 + STATUSES.index(s.status) for s in row] for row in found])
    return arrays


def residue_cost(coords, settings):
    """Predicted CPU seconds of `residue_tile`: 20 ms for each ray, whatever it holds."""
    return 0.02 * coords["omega"].size * coords["angle"].size


STATUSES = list(Status)
_BREAKDOWN = {"critical_scale": "value", "error": "error", "lower": "lower", "upper": "upper"}


def escape_warm_up():
    """Compile the kernels of `escape_tile`, once per process."""
    escape.first_escape([[0.0, 0.0]], *escape.ensemble(1), [1], 1)


def residue_warm_up():
    """Compile the kernels of `residue_tile`, once per process."""
    periodic.residue((0.1, 0.1), 1, 3)


def _strengths(coords):
    """The forcings of a tile, shape (kappa2, kappa1, 2)."""
    return np.stack(np.meshgrid(coords["kappa1"], coords["kappa2"]), axis=-1)
