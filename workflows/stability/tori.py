"""A study of stability: tori of rotation vectors that are next to a resonance, and past the end."""

import numpy as np

from nasm import tori
from nasm.symmetries import ray
from nasm.tori import last_torus
from pipeline.cubes.cube import fields
from workflows.shared.tables import dataset, listed, outcomes

_GOLDEN = (5**0.5 - 1) / 2
_PAIRS = {  # at a distance from a resonance
    "Ω = 1/3 + δ": lambda delta: (_GOLDEN, 1 / 3 + delta),
    "2ω = Ω + δ": lambda delta: ((2**0.5 - 1 + delta) / 2, 2**0.5 - 1),
    "13ω = 8 + δ": lambda delta: ((8 + delta) / 13, 2**0.5 - 1),
}


def nearly_resonant(quick):
    """7. Break tori of pairs (ω, Ω) at a distance δ from a resonance, and look past the breakup.

    Judged by converse KAM for tori of that Ω, whatever their ω. Past its bound, tori of the first
    pair are asked for on grids of up to n points.
    """
    deltas = np.e * 10.0 ** -np.array([2, 5, 10] if quick else range(2, 13))
    profile, tol, kicks = ray(45), *((0.1, 1000) if quick else (0.03, 8000))
    pairs = list(_PAIRS)[: 2 if quick else None]
    vectors = [[_PAIRS[name](delta) for delta in deltas] for name in pairs]
    found = [[tori.critical_scale(*vector, *profile, tol) for vector in row] for row in vectors]
    frequencies = {Ω for row in vectors for _, Ω in row}
    known = {Ω: last_torus.upper_scale(Ω, *profile, kicks) for Ω in frequencies}
    upper = np.array([[known[frequency] for _, frequency in row] for row in vectors])
    sizes, excess = 2 ** np.arange(13, 16 if quick else 19, 2), np.array([0.01, 0.1, 0.5])
    beyond = [(1 + x) * upper[0, 0] * profile for x in excess]
    past = [[tori.invariant_torus(*vectors[0][0], *at, int(n)) for at in beyond] for n in sizes]
    dims = "pair", "delta"
    numbers = fields(found, {"value": "value", "error": "error", "lower": "lower"})
    coords = {
        "pair": listed("pair", *pairs),
        "delta": (deltas, "distance δ from the resonance"),
        "n": (sizes, "most grid points"),
        "excess": (excess, "scale over upper, less 1"),
    }
    variables = {
        "value": (dims, numbers["value"], "breakup on the ray of 45°"),
        "error": (dims, numbers["error"], "error that the method claims for value"),
        "lower": (dims, numbers["lower"], "scale of the last certified torus"),
        "upper": (dims, upper, "scale at which no torus of that Ω is left"),
        "status": outcomes(dims, numbers["status"]),
        "past": outcomes(("n", "excess"), fields(past, {})["status"]),
    }
    return dataset("Tori next to a resonance, and past their breakup", coords, variables)
