"""Bad arguments: each is refused by a message with its value and the remedy."""

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
    critical,
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
from nasm.circles import continuation, fourier
from nasm.converse_kam import sequence, symmetry_line, transversal
from nasm.numbers import parse
from pipeline.sweep.grid import Axis, parse_axis

ORBITS = orbits.orbit, orbits.rotation_number
TORI = tori.invariant_torus, tori.critical_scale
ESCAPES = escape.escape_time, escape.first_escape
RAYS = periodic.critical_scale, escape.critical_scale, symmetry_line.critical_scale
RAYS += transversal.located, barriers.critical_scale, continuation.critical_scale
PERIOD_ONE = fixed_points.secondary, fixed_points.primary_residue, fixed_points.cubic_estimate
LINES = symmetry_line.elimination_time, symmetry_line.longest_lived
CELLS = (proofs.transport_cells.prove_cell,)
PROOFS = *CELLS, proofs.barrier.prove, proofs.transport.prove
INEXACT = [
    np.ma.array([0.25, 0.5], mask=[False, True]),
    np.longdouble([0.25, 0.5]),
    [Decimal("0.25"), 0.5],
    [Fraction(1, 3), 0.5],
    (0.25, np.longdouble(1) / 3),
]
NO_FLOATS = "{name}={value} is not made of real numbers that floats hold, without a mask"
WHOLE = "{name}={value} must be a whole number from"
ODD_CIRCLE = circles.invariant_circle(GAMMA, (0.0,))  # of one kick
# Functions, the argument, bad values of it, and what the message says, where … is anything.
BAD = [
    ((maps.forcing, maps.step, *ORBITS, escape.escape_time), "kappa", [[[0.3]]], "shape (1, 1)"),
    ((maps.forcing, escape.escape_time, symmetry_line.elimination_time),
     "kappa", [[], ()], "{value} has shape (0,)"),
    ((maps.forcing, maps.step), "kappa", [[[0.3, 0.5]]], "has shape (1, 2)"),
    ((maps.forcing, escape.escape_time, symmetry_line.elimination_time, symmetry_line.longest_lived,
     transversal.longest_lived), "kappa", [(0.3, nan), [inf]], "is not finite"),
    ((maps.forcing, maps.step), "kappa", [[0.3, 1j], [[0.1], [0.1, 0.2]], ["0.3"], "0.3",
     [True, False]], "kappa={value} is not made of real numbers"),
    ((maps.forcing, symmetry_line.longest_lived, *PROOFS), "kappa", INEXACT, NO_FLOATS),
    ((escape.escape_time,), "x", INEXACT, NO_FLOATS),
    ((escape.first_escape,), "kappas", [[pair] for pair in INEXACT[1:]], NO_FLOATS),
    ((sequence.longest_lived,), "theta", INEXACT, NO_FLOATS),
    ((self_consistent.evolve,), "gamma", INEXACT, NO_FLOATS),
    ((proofs.transport_cells.prove_cell,), "half_width", [*INEXACT, Decimal("0.25")], NO_FLOATS),
    ((proofs.barrier.proved_lower, proofs.transport.proved_upper), "value",
     [np.longdouble(0.48), Decimal("0.48"), np.ma.masked], "value={value} must be a number"),
    ((maps.rotating_forcing,), "frequency", [0.1], "frequency=0.1 is 3602…like '1/10'"),
    ((maps.rotating_forcing,), "frequency", ["1/1000001"], "whose denominator is more than"),
    ((maps.rotating_forcing, periodic.torus_scale), "frequency", ["1/0", "x", None, nan, inf],
     "frequency={value} is not a fraction; write one like"),
    (RAYS, "profile", [(0, 0)], "profile is zero; a ray needs a direction"),
    (RAYS, "profile", [(1e-308, 0.0), (5e-324, 0.0), (0.0, -9e-301)],
     "profile={value} has no strength of 1e-300 or more"),
    ((periodic.torus_scale,), "mean", [1e-310], "has no strength of 1e-300 or more"),
    ((symmetry_line.critical_scale,), "profile", [(0.1, 0.2, 0.3), (0.3, 0.2, 0.2, 0.3)],
     "has no dominant symmetry line, as one or two kicks have"),
    ((barriers.critical_scale,), "profile", [[1.0] + [0.5] * 63 + [0.2]], "P=65 kicks"),
    ((barriers.critical_scale,), "profile", [()], "profile=() has shape (0,)"),
    ((barriers.critical_scale,), "profile", [(1, nan)], "is not finite"),
    ((barriers.critical_scale,), "tol", [9e-6, 0.2, nan], "tol={value} must be from 1e-05"),
    ((barriers.critical_scale,), "tol", ["1e-3", None], "tol={value} must be a number"),
    ((continuation.critical_scale,), "tol", [0.0, inf, nan], "tol={value} must be positive"),
    ((continuation.critical_scale,), "tol", ["a", None, True, 1e-4j], "must be a number"),
    ((continuation.certified_circle,), "distance", [1e-7, 0.6, nan], "={value} must be from"),
    ((continuation.certified_circle, fourier.grid), "omega", [parse("3/5")],
     "omega=[0;1,1,2] is rational; a circle needs"),
    (ORBITS, "n", [2.5, -1], WHOLE),
    ((orbits.orbit, orbits.passages), "every", [0, 1.5], WHOLE + " 1 to 1000000000"),
    ((orbits.passages,), "box", [(0, 0, 0, 1), (0, 0, 1, 1.01), (0, 0, nan, 1)], "sizes up to 1"),
    ((orbits.passages,), "box", [(0, 0, 1), (nan, 0, 1, 1), [[0, 0, 1, 1]]], "must be left"),
    ((orbits.passages,), "x", [[[0.0]]], "passages takes a vector of starts"),
    ((orbits.rotation_number,), "n", [3], WHOLE + " 4 to 1000000000"),
    ((orbits.portrait,), "n_orbits", [0], WHOLE + " 1"),
    ((orbits.orbit,), "y", [np.zeros(3)], "do not broadcast"),
    ((*ORBITS, *ESCAPES), "x", [nan], "x is not finite"),
    ((*ORBITS, escape.escape_time, symmetry_line.elimination_time), "y", [[0.0, inf]],
     "y is not finite"),
    ((symmetries.alternate,), "kappa", [[0.3], [0.3, 0, 0.2]], "every 1th site alone"),
    ((symmetries.alternate,), "spacing", [0, 3, 1.0], WHOLE + " 1 to 2"),
    ((barriers.boundary,), "angles", [[[0, 45]], [nan]], "angles={value} must be a list of finite"),
    ((symmetries.alternate,), "spacing", [2], "does not kick every 2th site alone"),
    ((symmetries.shorten,), "omega", [0.618], "omega=0.618 is not a RotationNumber"),
    (PERIOD_ONE, "kappa1", [nan, inf], "must be finite"),
    ((numbers.moebius,), "b", [0.5], "(1ω + 0.5)/(0ω + 1) is not exact; use whole"),
    ((numbers.moebius,), "a", [0], "does not depend on ω; use ad ≠ bc"),
    ((numbers.nobles_near,), "value", [nan, inf], "value={value} must be finite"),
    ((numbers.nobles_near,), "value", ["0.6"], "value='0.6' must be a number"),
    ((numbers.nobles_near,), "width", [0.0, -1.0, nan], "width={value} positive"),
    ((numbers.nobles_near,), "n", [1.5], WHOLE + " 0"),
    ((circles.invariant_circle,), "start", [np.zeros((1, 64))], "they are P=2 functions"),
    ((circles.invariant_circle,), "start", [np.full((2, 64), nan)], "deviations must be finite"),
    ((circles.invariant_circle,), "n_max", [32], WHOLE + " 64 to 65536"),
    ((circles.newton_step,), "u", [np.zeros((2, 100))], "n a power of 2 from 16"),
    ((circles.symmetries.alternate,), "circle", [ODD_CIRCLE], "an even number of times"),
    ((periodic.residue, action.ordered_orbits), "p", [3], "p/q = 3/3 has a common factor"),
    ((periodic.residue, action.ordered_orbits), "q", [0], WHOLE + " 1 to 1000000"),
    ((periodic.critical_scale,), "q_max", [0, nan, 500.5, "a", 10**6 + 1], WHOLE + " 1 to 1000000"),
    ((periodic.critical_scale,), "start", [(0, 0, 0)], "differ in length"),
    ((periodic.torus_scale,), "omega", ["1/0"], "omega='1/0' is not a fraction"),
    ((periodic.torus_scale,), "mean", [0], "profile is zero"),
    (TORI, "omega", [nan, inf], "omega={value} must be finite"),
    (TORI, "frequency", ["1/2", None], "frequency={value} must be a number"),
    ((tori.invariant_torus,), "mean", [nan], "is not finite"),
    ((tori.invariant_torus,), "n_max", [100, 2**23], WHOLE + " 8192 to 4194304"),
    ((tori.critical_scale,), "tol", [0.0, nan], "tol={value} must be positive: the error"),
    ((flux.flux,), "q_max", [0, 500.5, nan], WHOLE + " 1 to 1000000"),
    (ESCAPES, "n_max", [0, -1, 1.5, 10**13], WHOLE + " 1 to 1000000000000"),
    (ESCAPES, "window", [(2.3, -2.0), (0.0, 0.0), (-inf, 2.0)], "={value} must be two finite"),
    ((escape.escape_time,), "y", [[]], "are empty; an ensemble has at least one start"),
    ((escape.first_escape,), "x", [np.zeros((1, 5))], "shape (1, 5)…need a vector of starts"),
    ((escape.first_escape,), "kappas", [0.3], "is a number; give an array of shape"),
    ((escape.first_escape,), "kappas", [[(0.3, 0.3), (0.3, inf)]], "is not finite"),
    ((escape.first_escape,), "sizes", [[], [0, 2], [-1], [2, 2], [3, 1], [1, 6], [1.0, 2.0], [[1,
     2]], 3, [True], np.array([3, 1], np.uint8)],
     "must be increasing whole numbers from 1 to 5, the number of starts"),
    ((escape.ensemble,), "n_orbits", [0, -3, 2.0, 10**9], WHOLE + " 1 to 100000000"),
    ((escape.critical_scale,), "n_max", [10], WHOLE + " 64"),
    ((escape.critical_scale,), "window", [(0.1, 2.3), (-2.0, 0.29)], "leaves out starts"),
    (LINES, "kappa", [(0.1, 0.2, 0.3)], "no dominant symmetry line"),
    (LINES, "n_max", [0, 2.5], WHOLE + " 1 to 1000000000"),
    ((symmetry_line.critical_scale,), "n_max", [99], WHOLE + " 100 to 1000000000"),
    ((transversal.longest_lived,), "n_max", [0, 1.5], WHOLE + " 1"),
    ((transversal.located,), "n_max", [29], WHOLE + " 30"),
    ((transversal.located,), "n_sites", [0, 9], WHOLE + " 1 to 8"),
    ((sequence.escape_time, sequence.longest_lived), "theta", [(0.1,), nan, [0.1, inf]],
     "must be one phase, or one for each of the 2 kicks"),
    ((sequence.escape_time,), "window", [(2.0, -2.0), (nan, 2.0), 5],
     "window={value} must be (lo, hi)"),
    ((sequence.longest_lived,), "site", [2], WHOLE + " 0 to 1"),
    ((sequence.critical_scale,), "profile", [np.ones(63)], "profile has 63 kicks; it must have 64"),
    ((sequence.critical_scale,), "tol", [1e-7, 0.2], "tol={value} must be from 1e-06"),
    ((tori.of_irrational, tori.upper_scale), "n_kicks", [99], WHOLE + " 100 to 1000000"),
    ((tori.upper_scale,), "frequency", [None, "1/3"], "frequency={value} must be a number"),
    ((sequence.longest_lived,), "effort", [0], WHOLE + " 1 to 100"),
    ((self_consistent.evolve,), "gamma", [[0.1, 0.2], nan, 1e7],
     "must be one weight, or one for each of the 3 particles"),
    ((self_consistent.evolve,), "amplitude", [0.0, -1.0, nan], "={value} must be from 1e-100"),
    ((self_consistent.evolve,), "n", [0, 1.5], WHOLE + " 1 to 1000000000"),
    ((self_consistent.evolve,), "phase", [inf], "phase=inf and detuning=0.0 must be finite"),
    ((proofs.barrier.prove,), "kappa", [(0.3, nan)], "is not finite"),
    ((proofs.barrier.prove,), "n", [63, 2**23, 100.0], WHOLE + " 64 to 4194304"),
    ((proofs.barrier.prove,), "n", [65], "n=65 must be even"),
    ((proofs.barrier.prove,), "start", [np.zeros((1, 64)), np.zeros(64)], "are 2 functions on"),
    ((proofs.barrier.prove, proofs.barrier.proved_lower), "budget", [0, nan], "positive: seconds"),
    (
        (proofs.barrier.proved_lower, proofs.proved_below, proofs.transport.proved_upper),
        "value", [0, -1, 5e-324, inf, nan, True], "value={value}",
    ),
    ((proofs.proved_below,), "budget", [0, -1, nan], "positive: seconds"),
    ((proofs.proved_below,), "nearest", [-1, 1.5, nan], "must be from 0 to 1"),
    ((proofs.barrier.proved_lower,), "profile", [(0, 0)], "profile is zero"),
    ((proofs.transport.prove,), "kappa", [(nan, 0.1), (inf,), (1e7,), (), "a"], "kappa={value}"),
    ((proofs.transport.prove, proofs.transport.proved_upper, proofs.transport_cells.prove_cell),
     "budget", [0, -1, nan, "1"], "budget={value}"),
    (CELLS, "kappa", [(0.5,), (0.1, 0.2, 0.1)], "two strengths"),
    (CELLS, "kappa", [(0.5, nan)], "not finite"),
    (CELLS, "half_width", [0.0, -0.5], "positive"),
    (CELLS, "kappa", [(0.1, 0.5)], "multiples of"),
    (CELLS, "half_width", [0.1], "multiples of"),
    ((Axis,), "n", [0, -3, 10**7], "from 1 to 1048576"),
    ((parse_axis,), "text", ["", "0:1", "0:1:x", "a:1:3", "0:1:2:3", "0:1:2.5"], "LO:HI:N"),
    ((parse_axis,), "text", ["1:0:4", "1:1:4", "nan:1:4", "0:inf:4"], "the lower one first"),
]  # fmt: skip

CASES = [
    (function, name, value, message)
    for functions, name, values, message in BAD
    for function in functions
    for value in values
]


@pytest.mark.parametrize(("function", "name", "value", "message"), CASES)
def test_a_bad_argument_is_refused_by_its_value_and_the_remedy(function, name, value, message):
    told = message.replace("{name}", name).replace("{value}", repr(value))
    with pytest.raises(ValueError, match=re.escape(told).replace("…", ".*")):
        function(**arguments(function) | {name: value})


def functions_of(argument):
    """Public functions of nasm whose first argument has this name."""
    modules = [import_module(module.name) for module in walk_packages(nasm.__path__, "nasm.")]
    functions = [f for module in modules for f in vars(module).values() if inspect.isfunction(f)]
    ours = {f for f in functions if f.__module__.startswith("nasm.") and f.__name__[0] != "_"}
    return {f for f in ours if [*inspect.signature(f).parameters][:1] == [argument]}


# A torus has a pair of numbers; no_answer passes on what it gets.
WITH_OMEGA = functions_of("omega") - {periodic.torus_scale, critical.no_answer}
_barrier = proofs.barrier
WITH_OMEGA -= {_barrier.inequalities, _barrier.turns}  # checked before
WITH_OMEGA = {f for f in WITH_OMEGA if f.__module__ != "nasm.tori.newton"}


@pytest.mark.parametrize("omega", [0.618, "golden", Fraction(3, 5), None])
@pytest.mark.parametrize("function", sorted(WITH_OMEGA, key=lambda f: (f.__module__, f.__name__)))
def test_what_is_no_rotation_number_is_refused_with_the_remedy(function, omega):
    cure = {0.618: "'[0;(1)]'", "golden": "[1;4,(1)]"}.get(omega, "'gamma'")
    named = re.escape(f"omega={omega!r} is not a ") + "(?i:rotation ?number).*" + re.escape(cure)
    with pytest.raises(ValueError, match=named):
        list(function(**arguments(function) | {"omega": omega}))
