"""Good arguments of the public functions of nasm, by their names."""

import inspect

import numpy as np

from nasm import circles, escape, numbers, orbits, periodic, proofs, self_consistent, tori
from nasm.converse_kam import sequence
from nasm.numbers import parse

GAMMA, KAPPA, REST = parse("gamma"), (0.3, 0.4), np.zeros((2, 64))  # deviations of the rotation

# Of which the tests make one bad.
GOOD = {"omega": GAMMA, "kappa": KAPPA, "kappas": [KAPPA], "forcings": [KAPPA]}
GOOD |= {"profile": np.array((1, 0)), "short": np.array(KAPPA), "start": KAPPA}
GOOD |= {"kappa1": 1.0, "kappa2": 1.0}
GOOD |= {"mean": 1.0, "amplitude": 0.1, "frequency": 0.54, "phase": 0.0, "theta": 0.1, "gamma": 0.1}
GOOD |= {"x": 0.0, "y": 0.1, "n": 64, "n_max": 100, "n_orbits": 5, "sizes": [1], "site": 1}
GOOD |= {"window": (-2, 2), "box": (0, 0, 1, 1), "p": 1, "q": 3, "q_max": 100, "a": 1, "b": 1}
GOOD |= {"u": REST, "circle": circles.invariant_circle(GAMMA, (0.0, 0.0)), "n_modes": 1000}
GOOD |= {"zero": numbers.rational(0), "breakup": 0.4, "distance": 0.01, "width": 1e-3}
GOOD |= {
    "angles": [0.0, 45.0],
    "value": 0.48,
    "budget": 0.1,
    "half_width": 2.0**-7,
    "lo": 0,
    "hi": 1,
    "text": "0:1:4",
}
# Functions that take others.
OTHERS = {
    escape.first_escape: {"x": np.zeros(5)},
    orbits.orbit: {"x": np.zeros(2)},
    periodic.torus_scale: {"omega": "5/8", "frequency": "1/2", "amplitude": 0.0},
    proofs.transport_cells.prove_cell: {"kappa": (0.25, 0.5)},
    self_consistent.evolve: {"x": np.zeros(3)},
    sequence.critical_scale: {"profile": np.ones(64)},
    tori.critical_scale: {"omega": 0.618},
    tori.invariant_torus: {"omega": 0.618},
}


def arguments(function):
    """Good arguments of a function, without those that have a default."""
    parameters = inspect.signature(function).parameters.values()
    needed = {p.name: GOOD[p.name] for p in parameters if p.default is p.empty}
    return needed | OTHERS.get(function, {})
