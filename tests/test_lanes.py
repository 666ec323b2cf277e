from fractions import Fraction

import numpy as np
import pytest
from numba import njit

from nasm.arithmetic import lanes
from nasm.arithmetic.lanes import FEW, LANES, fma, load, rint, store

RNG = np.random.default_rng(2)
A, B, C = RNG.uniform(-1, 1, (3, LANES)) * 2.0 ** RNG.integers(-40, 40, (3, LANES))
A[:6] = 0.5, 1.5, -2.5, -0.25, -0.0, 2.0**60  # ties, signed zeros, large integers
B[:6] = 0.5, -1.5, 2.5, 0.25, 0.0, -(2.0**60)
F = 0.1  # a float that is combined with lanes


def exact_fma(a, b, c):
    """Return a·b + c, computed in rational arithmetic and rounded to the nearest float."""
    triples = np.broadcast(a, b, c)
    return np.array([float(Fraction(a) * Fraction(b) + Fraction(c)) for a, b, c in triples])


# Each operation is defined twice: for lanes or floats, and for NumPy arrays.
OPERATIONS = {
    "add": (lambda a, b, c: a + b, np.add),
    "subtract": (lambda a, b, c: a - b, np.subtract),
    "multiply": (lambda a, b, c: a * b, np.multiply),
    "maximum": (lambda a, b, c: lanes.maximum(a, b), np.maximum),
    "minimum": (lambda a, b, c: lanes.minimum(a, b), np.minimum),
    "copysign": (lambda a, b, c: lanes.copysign(a, b), np.copysign),
    "rint": (lambda a, b, c: rint(a), np.rint),
    "fabs": (lambda a, b, c: lanes.fabs(a), np.fabs),
    "fma": (lambda a, b, c: fma(a, b, c), exact_fma),
    "divide": (lambda a, b, c: a / c, lambda a, b, c: a / c),
}
COMPILED = {name: njit(operation) for name, (operation, _) in OPERATIONS.items()}
_load, _keep = njit(lambda array: load(array, 0)), njit(lambda number: number)


def on_lanes(name, a, b, c):
    """Apply the operation to lanes; arguments that are floats stay floats."""
    operation = COMPILED[name]
    get_a, get_b, get_c = (_load if isinstance(x, np.ndarray) else _keep for x in (a, b, c))

    @njit
    def apply(a, b, c, out):
        store(out, 0, operation(get_a(a), get_b(b), get_c(c)))

    out = np.empty(LANES)
    apply(a, b, c, out)
    return out


def assert_same_bits(actual, expected):
    np.testing.assert_array_equal(actual.view(np.int64), np.asarray(expected).view(np.int64))


@pytest.mark.parametrize("name", OPERATIONS)
def test_lanes_numpy_and_floats_agree_to_the_last_bit(name):
    result, numpy = on_lanes(name, A, B, C), OPERATIONS[name][1]
    assert_same_bits(result, numpy(*(A, B, C)[: getattr(numpy, "nin", 3)]))
    assert_same_bits(result, list(map(COMPILED[name], A, B, C)))


def test_a_float_in_any_position_is_broadcast_to_all_lanes():
    for name in list(OPERATIONS)[:6]:
        assert_same_bits(on_lanes(name, A, F, C), OPERATIONS[name][1](A, F))
        assert_same_bits(on_lanes(name, F, B, C), OPERATIONS[name][1](F, B))
    for a, b, c in [(F, B, C), (A, F, C), (A, B, F), (A, F, F)]:
        assert_same_bits(on_lanes("fma", a, b, c), exact_fma(a, b, c))


def test_operations_on_few_lanes_agree_with_the_first_of_many_lanes():
    @njit
    def compute(out):
        a, b, c = lanes.load_few(A, 0), lanes.load_few(B, 0), lanes.load_few(C, 0)
        store(out, 0, lanes.maximum(fma(a, b, c) / c, rint(a) - F * b))

    out = np.empty(FEW)
    compute(out)
    expected = np.maximum(exact_fma(A, B, C) / C, np.rint(A) - F * B)
    assert_same_bits(out, expected[:FEW])


@pytest.mark.parametrize("name", ["maximum", "minimum"])
def test_maximum_and_minimum_return_the_second_argument_if_one_is_nan(name):
    nans, ones = np.full(LANES, np.nan), np.ones(LANES)
    assert_same_bits(on_lanes(name, nans, ones, C), ones)
    assert_same_bits(on_lanes(name, ones, nans, C), nans)


def test_lanes_can_be_loaded_from_and_stored_at_any_index():
    @njit
    def move(source, start, target, target_start):
        store(target, target_start, load(source, start))

    source, target = np.arange(LANES + 9.0), np.zeros(LANES + 9)
    move(source, 3, target, 5)
    np.testing.assert_array_equal(target[5:-4], source[3:-6])
    assert not target[:5].any()
    assert not target[-4:].any()


def test_a_function_with_its_own_frame_is_aligned_and_never_inlined():
    @njit
    def framed(a):
        lanes.own_frame()
        return a

    assert framed(1.0) == 1.0
    (code,) = framed.inspect_llvm().values()
    assert "alignstack(64)" in code
    assert "noinline" in code
