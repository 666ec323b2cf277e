"""Test that bad arguments are refused with messages that state the value and the remedy.

The tables below are grouped by argument. Each row lists functions that take the argument,
bad values for it, and part of the message, in which {name} and {value} stand for the argument's
name and value, and … stands for any text. To add a case, add a value to a row, or add a row for its
argument; `arguments.py` supplies valid values for all other arguments.
"""

import inspect
import re
from decimal import Decimal
from fractions import Fraction
from importlib import import_module
from pkgutil import walk_packages

import numpy as np
import pytest
from arguments import GAMMA, arguments
from numpy import inf, nan

import nasm
from nasm import (
    action,
    barriers,
    circles,
    escape,
    fixed_points,
    flux,
    maps,
    numbers,
    orbits,
    periodic,
    proofs,
    self_consistent,
    symmetries,
    tori,
)
from nasm.circles import continuation, fourier, hull
from nasm.converse_kam import aperiodic, symmetry_line, transversal
from nasm.numbers import parse
from nasm.results import no_answer
from pipeline.sweep.grid import Axis, parse_axis

# Functions that treat an argument in the same way.
ORBITS = orbits.orbit, orbits.rotation_number
TORI = tori.invariant_torus, tori.critical_scale
ESCAPES = escape.escape_time, escape.first_escape
LINES = symmetry_line.elimination_time, symmetry_line.longest_lived
PERIOD_ONE = fixed_points.secondary, fixed_points.primary_residue, fixed_points.cubic_estimate
RAYS = (
    barriers.critical_scale,
    continuation.critical_scale,
    escape.critical_scale,
    periodic.critical_scale,
    symmetry_line.critical_scale,
    transversal.upper_scale,
)
BOUNDS = proofs.barrier.proved_lower, proofs.transport.proved_upper
CELLS = proofs.transport_cells.prove_cell
PROOFS = CELLS, proofs.barrier.prove, proofs.transport.prove

# Values and messages that several rows share.
WHOLE = "{name}={value} must be a whole number from"
MILLION, BILLION = WHOLE + " 1 to 1000000", WHOLE + " 1 to 1000000000"
NO_FLOATS = "{name}={value} must consist of real numbers that fit in floats, without a mask"
INEXACT = [
    np.ma.array([0.25, 0.5], mask=[False, True]),
    np.longdouble([0.25, 0.5]),
    [Decimal("0.25"), 0.5],
    [Fraction(1, 3), 0.5],
    (0.25, np.longdouble(1) / 3),
]
NO_NUMBERS = [0.3, 1j], [[0.1], [0.1, 0.2]], ["0.3"], "0.3", [True, False]
TINY = (1e-308, 0.0), (5e-324, 0.0), (0.0, -9e-301)
CIRCLE_OF_ONE_KICK = circles.invariant_circle(GAMMA, (0.0,))

FORCINGS = {
    "kappa": [
        ((maps.forcing, maps.step, *ORBITS, escape.escape_time), [[[0.3]]], "shape (1, 1)"),
        ((maps.forcing, maps.step), [[[0.3, 0.5]]], "has shape (1, 2)"),
        ((maps.forcing, escape.escape_time, LINES[0]), [[], ()], "{value} has shape (0,)"),
        ((maps.forcing, escape.escape_time), [(0.3, nan), [inf]], "is not finite"),
        ((*LINES, transversal.longest_lived), [(0.3, nan), [inf]], "is not finite"),
        (proofs.barrier.prove, [(0.3, nan)], "is not finite"),
        (CELLS, [(0.5, nan)], "not finite"),
        ((maps.forcing, maps.step), NO_NUMBERS, "kappa={value} must consist of real numbers"),
        ((maps.forcing, symmetry_line.longest_lived, *PROOFS), INEXACT, NO_FLOATS),
        (proofs.transport.prove, [(nan, 0.1), (inf,), (1e7,), (), "a"], "kappa={value}"),
        (CELLS, [(0.5,), (0.1, 0.2, 0.1)], "two coordinates"),
        (CELLS, [(0.1, 0.5)], "multiples of"),
        (LINES, [(0.1, 0.2, 0.3)], "no dominant symmetry line"),
        (symmetries.alternate, [[0.3], [0.3, 0, 0.2]], "kicks per period, at a spacing of 1"),
    ],
    "kappas": [
        (escape.first_escape, [0.3], "is a number; give an array of shape"),
        (escape.first_escape, [[(0.3, 0.3), (0.3, inf)]], "is not finite"),
        (escape.first_escape, [[pair] for pair in INEXACT[1:]], NO_FLOATS),
    ],
    "kappa1": [(PERIOD_ONE, [nan, inf], "must be finite")],
    "spacing": [
        (symmetries.alternate, [0, 3, 1.0], WHOLE + " 1 to 2"),
        (symmetries.alternate, [2], "kicks per period, at a spacing of 2"),
    ],
    "half_width": [
        (CELLS, [0.0, -0.5], "positive"),
        (CELLS, [0.1], "multiples of"),
        (CELLS, [*INEXACT, Decimal("0.25")], NO_FLOATS),
    ],
    "profile": [
        (RAYS, [(0, 0)], "profile is zero; a ray needs a direction"),
        (RAYS, TINY, "profile={value} has no strength of 1e-300 or more"),
        (proofs.barrier.proved_lower, [(0, 0)], "profile is zero"),
        (barriers.critical_scale, [()], "profile=() has shape (0,)"),
        (barriers.critical_scale, [(1, nan)], "is not finite"),
        (transversal.upper_scale, [[1.0] + [0.5] * 63 + [0.2]], "P=65 kicks"),
        (aperiodic.critical_scale, [np.ones(63)], "profile has 63 kicks; it must have 64"),
        (
            symmetry_line.critical_scale,
            [(0.1, 0.2, 0.3), (0.3, 0.2, 0.2, 0.3)],
            "has no dominant symmetry line; forcings of one or two",
        ),
    ],
    "mean": [
        (periodic.torus_scale, [0], "profile is zero"),
        (periodic.torus_scale, [1e-310], "has no strength of 1e-300 or more"),
        (tori.invariant_torus, [nan], "is not finite"),
    ],
    "angles": [(barriers.boundary, [[[0, 45]], [nan]], "angles={value} must be a list of finite")],
    "value": [
        (
            BOUNDS,
            [np.longdouble(0.48), Decimal("0.48"), np.ma.masked],
            "value={value} must be a number",
        ),
        ((*BOUNDS, proofs.proved_below), [0, -1, 5e-324, inf, nan, True], "value={value}"),
    ],
}

NUMBERS = {
    "omega": [
        (
            (hull.certified_circle, fourier.grid),
            [parse("3/5")],
            "omega=[0;1,1,2] is rational; a circle needs",
        ),
        (symmetries.shorten, [0.618], "omega=0.618 is not a RotationNumber"),
        (periodic.torus_scale, ["1/0"], "omega='1/0' is not a fraction"),
        (TORI, [nan, inf], "omega={value} must be finite"),
    ],
    "frequency": [
        (maps.rotating_forcing, [0.1], "frequency=0.1 is 3602…like '1/10'"),
        (maps.rotating_forcing, ["1/1000001"], "whose denominator is more than"),
        (
            (maps.rotating_forcing, periodic.torus_scale),
            ["1/0", "x", None, nan, inf],
            "frequency={value} is not a fraction; write one like",
        ),
        (TORI, ["1/2", None], "frequency={value} must be a number"),
        (tori.upper_scale, [None, "1/3"], "frequency={value} must be a number"),
    ],
    "p": [((periodic.residue, action.ordered_orbits), [3], "p/q = 3/3 has a common factor")],
    "q": [((periodic.residue, action.ordered_orbits), [0], MILLION)],
    "a": [(numbers.moebius, [0], "does not depend on ω; use ad ≠ bc")],
    "b": [(numbers.moebius, [0.5], "(1ω + 0.5)/(0ω + 1) is not exact; use whole")],
    "value": [
        (numbers.nobles_near, [nan, inf], "value={value} must be finite"),
        (numbers.nobles_near, ["0.6"], "value='0.6' must be a number"),
    ],
    "width": [(numbers.nobles_near, [0.0, -1.0, nan], "width={value} positive")],
}

STARTS = {
    "x": [
        ((*ORBITS, *ESCAPES), [nan], "x is not finite"),
        (escape.escape_time, INEXACT, NO_FLOATS),
        (escape.first_escape, [np.zeros((1, 5))], "shape (1, 5)…need a vector of starts"),
        (orbits.passages, [[[0.0]]], "passages takes a vector of starts"),
    ],
    "y": [
        ((*ORBITS, escape.escape_time, LINES[0]), [[0.0, inf]], "y is not finite"),
        (escape.escape_time, [[]], "are empty; an ensemble needs at least one start"),
        (orbits.orbit, [np.zeros(3)], "do not broadcast"),
    ],
    "window": [
        (ESCAPES, [(2.3, -2.0), (0.0, 0.0), (-inf, 2.0)], "={value} must be two finite"),
        (aperiodic.escape_time, [(2.0, -2.0), (nan, 2.0), 5], "window={value} must be (lo, hi)"),
        (escape.critical_scale, [(0.1, 2.3), (-2.0, 0.29)], "leaves out some starts"),
    ],
    "box": [
        (orbits.passages, [(0, 0, 0, 1), (0, 0, 1, 1.01), (0, 0, nan, 1)], "sizes up to 1"),
        (orbits.passages, [(0, 0, 1), (nan, 0, 1, 1), [[0, 0, 1, 1]]], "must be left"),
    ],
    "theta": [
        (aperiodic.longest_lived, INEXACT, NO_FLOATS),
        (
            (aperiodic.escape_time, aperiodic.longest_lived),
            [(0.1,), nan, [0.1, inf]],
            "must be one phase, or one for each of the 2 kicks",
        ),
    ],
    "site": [(aperiodic.longest_lived, [2], WHOLE + " 0 to 1")],
    "gamma": [
        (self_consistent.evolve, INEXACT, NO_FLOATS),
        (
            self_consistent.evolve,
            [[0.1, 0.2], nan, 1e7],
            "must be one weight, or one for each of the 3 particles",
        ),
    ],
    "amplitude": [(self_consistent.evolve, [0.0, -1.0, nan], "={value} must be from 1e-100")],
    "phase": [(self_consistent.evolve, [inf], "phase=inf and detuning=0.0 must be finite")],
    "start": [
        (circles.invariant_circle, [np.zeros((1, 64))], "they are P=2 functions"),
        (circles.invariant_circle, [np.full((2, 64), nan)], "deviations must be finite"),
        (proofs.barrier.prove, [np.zeros((1, 64)), np.zeros(64)], "must have 2 rows"),
        (periodic.critical_scale, [(0, 0, 0)], "differ in length"),
    ],
    "u": [(circles.newton_step, [np.zeros((2, 100))], "n a power of 2, at least 16")],
    "circle": [(circles.symmetries.alternate, [CIRCLE_OF_ONE_KICK], "an even number of kicks")],
}

COUNTS = {
    "n": [
        (ORBITS, [2.5, -1], WHOLE),
        (orbits.rotation_number, [3], WHOLE + " 4 to 1000000000"),
        (numbers.nobles_near, [1.5], WHOLE + " 0"),
        (self_consistent.evolve, [0, 1.5], BILLION),
        (proofs.barrier.prove, [63, 2**23, 100.0], WHOLE + " 64 to 4194304"),
        (proofs.barrier.prove, [65], "n=65 must be even"),
        (Axis, [0, -3, 10**7], "from 1 to 1048576"),
    ],
    "n_max": [
        (ESCAPES, [0, -1, 1.5, 10**13], WHOLE + " 1 to 1000000000000"),
        (escape.critical_scale, [10], WHOLE + " 64"),
        (LINES, [0, 2.5], BILLION),
        (symmetry_line.critical_scale, [99], WHOLE + " 100 to 1000000000"),
        (transversal.longest_lived, [0, 1.5], WHOLE + " 1"),
        (transversal.upper_scale, [29], WHOLE + " 30"),
        (circles.invariant_circle, [32], WHOLE + " 64 to 65536"),
        (tori.invariant_torus, [100, 2**23], WHOLE + " 8192 to 4194304"),
    ],
    "every": [((orbits.orbit, orbits.passages), [0, 1.5], BILLION)],
    "n_orbits": [
        (orbits.portrait, [0], WHOLE + " 1"),
        (escape.ensemble, [0, -3, 2.0, 10**9], WHOLE + " 1 to 100000000"),
    ],
    "sizes": [
        (
            escape.first_escape,
            [[], [0, 2], [-1], [2, 2], [3, 1], [1, 6], [1.0, 2.0], [[1, 2]], 3, [True]],
            "must be increasing whole numbers from 1 to 5, the number of starts",
        ),
        (
            escape.first_escape,
            [np.array([3, 1], np.uint8)],
            "must be increasing whole numbers from 1 to 5, the number of starts",
        ),
    ],
    "n_sites": [(transversal.upper_scale, [0, 9], WHOLE + " 1 to 8")],
    "n_kicks": [((tori.last_critical_scale, tori.upper_scale), [99], WHOLE + " 100 to 1000000")],
    "effort": [(aperiodic.longest_lived, [0], WHOLE + " 1 to 100")],
    "q_max": [
        (periodic.critical_scale, [0, nan, 500.5, "a", 10**6 + 1], MILLION),
        (flux.flux, [0, 500.5, nan], MILLION),
    ],
}

TOLERANCES = {
    "tol": [
        (barriers.critical_scale, [9e-6, 0.2, nan], "tol={value} must be from 1e-05"),
        (barriers.critical_scale, ["1e-3", None], "tol={value} must be a number"),
        (continuation.critical_scale, [0.0, inf, nan], "tol={value} must be positive"),
        (continuation.critical_scale, ["a", None, True, 1e-4j], "must be a number"),
        (aperiodic.critical_scale, [1e-7, 0.2], "tol={value} must be from 1e-06"),
        (tori.critical_scale, [0.0, nan], "tol={value} must be positive: the error"),
    ],
    "distance": [(hull.certified_circle, [1e-7, 0.6, nan], "={value} must be from")],
    "nearest": [(proofs.proved_below, [-1, 1.5, nan], "must be from 0 to 1")],
    "budget": [
        ((proofs.barrier.prove, proofs.barrier.proved_lower), [0, nan], "positive: seconds"),
        (proofs.proved_below, [0, -1, nan], "positive: seconds"),
        (
            (proofs.transport.prove, proofs.transport.proved_upper, CELLS),
            [0, -1, nan, "1"],
            "budget={value}",
        ),
    ],
}

TEXTS = {
    "text": [
        (parse_axis, ["", "0:1", "0:1:x", "a:1:3", "0:1:2:3", "0:1:2.5"], "LO:HI:N"),
        (parse_axis, ["1:0:4", "1:1:4", "nan:1:4", "0:inf:4"], "the lower one first"),
    ],
}

TABLES = FORCINGS, NUMBERS, STARTS, COUNTS, TOLERANCES, TEXTS
CASES = [
    (function, name, value, message)
    for table in TABLES
    for name, rows in table.items()
    for functions, values, message in rows
    for function in (functions if isinstance(functions, tuple) else (functions,))
    for value in values
]


@pytest.mark.parametrize(("function", "name", "value", "message"), CASES)
def test_errors_for_bad_arguments_state_the_value_and_the_remedy(function, name, value, message):
    expected = message.replace("{name}", name).replace("{value}", repr(value))
    with pytest.raises(ValueError, match=re.escape(expected).replace("…", ".*")):
        function(**arguments(function) | {name: value})


def functions_of(argument):
    """Return the public functions of nasm whose first argument has this name."""
    modules = [import_module(module.name) for module in walk_packages(nasm.__path__, "nasm.")]
    functions = [f for module in modules for f in vars(module).values() if inspect.isfunction(f)]
    ours = {f for f in functions if f.__module__.startswith("nasm.") and f.__name__[0] != "_"}
    return {f for f in ours if [*inspect.signature(f).parameters][:1] == [argument]}


# Exceptions: a torus has a pair of rotation numbers; no_answer passes its argument on unchecked.
WITH_OMEGA = functions_of("omega") - {periodic.torus_scale, no_answer}
_barrier = proofs.barrier
WITH_OMEGA -= {_barrier.inequalities, _barrier.turns}  # their callers check omega
WITH_OMEGA -= {_barrier.bounds_of_the_step, _barrier.inequalities_after_a_step}
WITH_OMEGA = {f for f in WITH_OMEGA if f.__module__ != "nasm.tori.newton"}


@pytest.mark.parametrize("omega", [0.618, "golden", Fraction(3, 5), None])
@pytest.mark.parametrize("function", sorted(WITH_OMEGA, key=lambda f: (f.__module__, f.__name__)))
def test_errors_for_anything_but_a_rotation_number_state_the_remedy(function, omega):
    cure = {0.618: "'[0;(1)]'", "golden": "[1;4,(1)]"}.get(omega, "'gamma'")
    named = re.escape(f"omega={omega!r} is not a ") + "(?i:rotation ?number).*" + re.escape(cure)
    with pytest.raises(ValueError, match=named):
        list(function(**arguments(function) | {"omega": omega}))
