"""Valid arguments for the public functions of nasm, by name."""

import inspect

import numpy as np

from nasm import circles, escape, numbers, orbits, periodic, planes, proofs, self_consistent, tori
from nasm.converse_kam import aperiodic
from nasm.numbers import parse

GAMMA, KAPPA = parse("gamma"), (0.3, 0.4)

# Valid arguments by kind and name; tests replace one at a time with an invalid value.
FORCINGS = {
    "kappa": KAPPA,
    "kappas": [KAPPA],
    "forcings": [KAPPA],
    "short": np.array(KAPPA),
    "profile": np.array((1, 0)),
    "kappa1": 1.0,
    "kappa2": 1.0,
    "mean": 1.0,
    "amplitude": 0.1,
    "half_width": 2.0**-7,
    "angles": [0.0, 45.0],
    "value": 0.48,
    "breakup": 0.4,
}
NUMBERS = {
    "omega": GAMMA,
    "frequency": 0.54,
    "zero": numbers.rational(0),
    "p": 1,
    "q": 3,
    "a": 1,
    "b": 1,
    "width": 1e-3,
}
STARTS = {
    "x": 0.0,
    "y": 0.1,
    "window": (-2, 2),
    "box": (0, 0, 1, 1),
    "site": 1,
    "start": KAPPA,
    "theta": 0.1,
    "phase": 0.0,
    "gamma": 0.1,
    "u": np.zeros((2, 64)),  # deviations from the rotation
    "circle": circles.invariant_circle(GAMMA, (0.0, 0.0)),
}
COUNTS = {"n": 64, "n_max": 100, "n_orbits": 5, "n_modes": 1000, "q_max": 100, "sizes": [1]}
COUNTS |= {"period": 100}
TOLERANCES = {"distance": 0.01, "budget": 0.1}
AXES = {"lo": 0, "hi": 1, "text": "0:1:4"}
GOOD = FORCINGS | NUMBERS | STARTS | COUNTS | TOLERANCES | AXES

# Arguments for functions that need values other than those above.
OTHERS = {
    escape.first_escape: {"x": np.zeros(5)},
    orbits.orbit: {"x": np.zeros(2)},
    orbits.rotation_number_of: {"x": np.arange(5.0)},
    periodic.torus_scale: {"omega": "5/8", "frequency": "1/2", "amplitude": 0.0},
    proofs.transport_cells.prove_cell: {"kappa": (0.25, 0.5)},
    proofs.transport_cells.prove_cell_of_plane: {
        "plane": planes.two_kicks(),
        "centre": (0.25, 0.5),
    },
    self_consistent.evolve: {"x": np.zeros(3)},
    aperiodic.critical_scale: {"profile": np.ones(64)},
    tori.critical_scale: {"omega": 0.618},
    tori.invariant_torus: {"omega": 0.618},
}


def arguments(function):
    """Return valid arguments for those parameters of a function that have no default."""
    parameters = inspect.signature(function).parameters.values()
    needed = {p.name: GOOD[p.name] for p in parameters if p.default is p.empty}
    return needed | OTHERS.get(function, {})
