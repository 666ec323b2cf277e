"""The interface of nasm: every public function converts numbers of any kind or refuses them."""

import inspect
from importlib import import_module
from itertools import islice
from pkgutil import walk_packages

import numpy as np
import pytest
from arguments import GOOD, OTHERS

import nasm
from nasm import (
    barriers,
    diffusion,
    escape,
    farey,
    fixed_points,
    manifolds,
    maps,
    numbers,
    periodic,
    planes,
    proofs,
    self_consistent,
    snapshot,
    tori,
    verdict,
)
from nasm.circles import continuation, hull
from nasm.converse_kam import transversal
from nasm.results import no_answer

# These modules and functions do not check arguments that are results of other modules of nasm.
TRUSTING = ("arithmetic", "action", "checks", "circles.fourier", "circles.parameterization")
TRUSTING += ("proofs.cells", "proofs.certificate_checker", "proofs.certificates", "proofs.patches")
TRUSTING += ("proofs.residuals",)
TRUSTING += ("manifolds", "sources", "tables", "texts")
INNER = {barriers.last_circle, continuation.fineness, no_answer}
INNER |= {transversal.longest_period}

MORE = {"length": 0.1, "angle": 30.0, "z": 1.0, "limit": 0.5, "times": 2}
MORE |= {"above": True, "third": 0.25, "seconds": 0.1, "n_kicks": 100, "fraction": "1/3"}
MORE |= {"strength": 0.5, "v": 0.5}
CENTRES = [0.25, 0.75]
SPECIAL = {
    escape.boundary: {"escape_time": np.ones((2, 2)), "kappa1": CENTRES, "kappa2": CENTRES},
    manifolds.stable: {"kappa": (1.0, 0.5), "p": 0, "q": 1, "y": 0.0},
    manifolds.unstable: {"kappa": (1.0, 0.5), "p": 0, "q": 1, "y": 0.0},
    maps.rotating_forcing: {"frequency": "1/2"},
    numbers.parse: {"text": "gamma"},
    planes.parse: {"text": "two-kicks"},
    planes.from_json: {"text": planes.two_kicks().record["plane"]},
    planes.rotating: {"frequency": "1/2", "phase": "1/3"},
    snapshot.separations: {"u": 1.0},
    tori.graph: {"torus": tori.invariant_torus(0.618, 0.54, 0.0, 0.0)},
    tori.newton.residual: {"omega": 0.618, "u": np.zeros((16, 16))},
}
# Products of these numbers would overflow in eight bits.
SMALL = {
    fixed_points.primary_residue: {"kappa1": 99, "kappa2": 98},
    self_consistent.momentum: {"amplitude": 99, "gamma": [90, 91], "y": [90, 91]},
    numbers.moebius: {"a": 99, "b": 98, "c": 97, "d": 95},
}


def public_functions():
    """Yield (full name, function) for the public functions of all modules that check arguments."""
    for module in walk_packages(nasm.__path__, "nasm."):
        names = [] if module.ispkg else getattr(import_module(module.name), "__all__", ())
        for function in (getattr(import_module(module.name), name) for name in names):
            inner = module.name.removeprefix("nasm.").startswith(TRUSTING) or function in INNER
            if inspect.isfunction(function) and not inner:
                yield f"{module.name}.{function.__name__}", function


# Kernels do not convert arguments and are not tested. For functions that take seconds, the tests
# only check that bad arguments are refused.
KERNELS = {maps.kick, maps.unkick}
SLOW = {barriers.boundary, barriers.critical_scale, proofs.bracket.critical_scale}
SLOW |= {proofs.barrier.proved_lower, proofs.transport.prove, proofs.transport.proved_upper}
SLOW |= {proofs.transport_cells.prove_cell_of_plane}
SLOW |= {proofs.transport_cells.prove_cell, tori.last_critical_scale, tori.upper_scale, verdict}
SLOW |= {hull.certified_circle, diffusion.diffusion}
SEARCHES = {
    transversal.upper_scale,
    transversal.longest_lived,
    farey.find_existing_circle,
    periodic.crossings,
}


def good(function):
    """Return valid arguments of a function, including its numerical defaults."""
    special = OTHERS.get(function, {}) | SPECIAL.get(function, {})
    parameters = inspect.signature(function).parameters.items()
    defaults = {
        name: p.default for name, p in parameters if isinstance(p.default, int | float | tuple)
    }
    needed = {name for name, p in parameters if p.default is p.empty}
    return defaults | {n: v for n, v in {**MORE, **GOOD}.items() if n in needed} | special


def numeric(value):
    """Return True if a value consists of numbers."""
    try:
        return np.asarray(value).dtype.kind in "iuf" and np.size(value) > 0
    except ValueError:
        return False


CASES = [
    pytest.param(function, name, id=f"{path}-{name}")
    for path, function in public_functions()
    for name, value in good(function).items()
    if numeric(value) and function not in KERNELS
]


@pytest.mark.parametrize(("function", "name"), CASES)
def test_refusals_of_masked_values_and_strings_name_the_argument(function, name):
    value = np.asarray(good(function)[name])
    mask = np.zeros(value.shape, bool)
    mask.flat[0] = True
    bad = [np.ma.array(value, mask=mask), value.astype(str)]
    if value.ndim == 0:
        bad += [np.ma.masked, str(value)]
    else:
        bad += [
            [np.ma.masked, *value[1:]],
            [np.ma.array(v, mask=m) for v, m in zip(value, mask, strict=True)],
        ]
    if (function, name) == (escape.boundary, "escape_time"):
        bad = bad[1:2]  # masked times are allowed and count as unknown
    for values in bad:
        with pytest.raises(ValueError, match=f"{name}=|{name} |deviations=|ω"):
            called(function, good(function) | {name: values})


def kinds_of(value):
    """Yield the numbers of `value` as an array, as a list, and in small dtypes that fit them."""
    array = np.asarray(value)
    yield array
    yield array.tolist()
    for kind in ("float32", "int8", "uint8"):
        small = array.astype(kind) if np.abs(array).max() < 100 else array
        if (small == array).all():
            yield small if np.ndim(value) else small[()]


def timed(case):
    """Return the case, marked as slow if the function is a search."""
    function, name = case.values
    searches = "scale" in function.__name__ or function in SEARCHES
    return pytest.param(function, name, id=case.id, marks=[pytest.mark.slow] if searches else [])


ANSWERING = [timed(case) for case in CASES if case.values[0] not in SLOW]


@pytest.mark.parametrize(("function", "name"), ANSWERING)
def test_numbers_of_any_kind_yield_the_same_result_or_are_refused(function, name):
    arguments = good(function) | SMALL.get(function, {})
    expected = called(function, arguments)
    for values in kinds_of(arguments[name]):
        try:
            result = called(function, arguments | {name: values})
        except ValueError as error:
            assert name in str(error)  # noqa: PT017
        else:
            np.testing.assert_equal(result, expected)


def called(function, arguments):
    result = function(**arguments)
    return list(islice(result, 20)) if inspect.isgenerator(result) else result
