from fractions import Fraction

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from nasm.lanes import LANES, copysign, fabs, fma, load, maximum, minimum, own_frame, rint, store

RNG = np.random.default_rng(2)
A, B, C = RNG.uniform(-1, 1, (3, LANES)) * 2.0 ** RNG.integers(-40, 40, (3, LANES))
A[:6] = 0.5, 1.5, -2.5, -0.25, -0.0, 2.0**60  # ties, signed zeros, beyond all fractions
B[:6] = 0.5, -1.5, 2.5, 0.25, 0.0, -(2.0**60)
F = 0.1  # a float among lanes


@njit
def _add(a, b, c):
    return a + b


@njit
def _subtract(a, b, c):
    return a - b


@njit
def _multiply(a, b, c):
    return a * b


@njit
def _rint(a, b, c):
    return rint(a)


@njit
def _fabs(a, b, c):
    return fabs(a)


@njit
def _maximum(a, b, c):
    return maximum(a, b)


@njit
def _minimum(a, b, c):
    return minimum(a, b)


@njit
def _copysign(a, b, c):
    return copysign(a, b)


@njit
def _fma(a, b, c):
    return fma(a, b, c)


def exact_fma(a, b, c):
    """a·b + c in rational arithmetic, then the nearest float."""
    triples = np.broadcast(a, b, c)
    return np.array([float(Fraction(a) * Fraction(b) + Fraction(c)) for a, b, c in triples])


OPERATIONS = {
    _add: lambda a, b, c: a + b,
    _subtract: lambda a, b, c: a - b,
    _multiply: lambda a, b, c: a * b,
    _rint: lambda a, b, c: np.rint(a),
    _fabs: lambda a, b, c: np.fabs(a),
    _maximum: lambda a, b, c: np.maximum(a, b),
    _minimum: lambda a, b, c: np.minimum(a, b),
    _copysign: lambda a, b, c: np.copysign(a, b),
    _fma: exact_fma,
}
BINARY = [_add, _subtract, _multiply, _maximum, _minimum, _copysign]


@njit
def _load(array):
    return load(array, 0)


@njit
def _keep(number):
    return number


def name(operation):
    return operation.__name__.lstrip("_")


def on_lanes(operation, a, b, c):
    """The operation on lanes; an argument that is a float stays one."""

    get_a, get_b, get_c = (_load if isinstance(x, np.ndarray) else _keep for x in (a, b, c))

    @njit
    def apply(a, b, c, out):
        store(out, 0, operation(get_a(a), get_b(b), get_c(c)))

    out = np.empty(LANES)
    apply(a, b, c, out)
    return out


def assert_same_bits(actual, expected):
    np.testing.assert_array_equal(actual.view(np.int64), np.asarray(expected).view(np.int64))


@pytest.mark.parametrize("operation", OPERATIONS, ids=name)
def test_lanes_numpy_and_floats_agree_to_the_last_bit(operation):
    lanes = on_lanes(operation, A, B, C)
    assert_same_bits(lanes, OPERATIONS[operation](A, B, C))
    assert_same_bits(lanes, list(map(operation, A, B, C)))


@pytest.mark.parametrize("operation", BINARY, ids=name)
def test_a_float_fills_all_lanes(operation):
    numpy = OPERATIONS[operation]
    assert_same_bits(on_lanes(operation, A, F, C), numpy(A, np.full(LANES, F), C))
    assert_same_bits(on_lanes(operation, F, B, C), numpy(np.full(LANES, F), B, C))


def test_fma_takes_a_float_in_any_place():
    for a, b, c in [(F, B, C), (A, F, C), (A, B, F), (A, F, F)]:
        assert_same_bits(on_lanes(_fma, a, b, c), exact_fma(a, b, c))


def test_fma_rounds_once():
    a, b, c = 1 + 2.0**-30, 1 - 2.0**-30, -1.0
    assert a * b + c == 0  # rounded twice
    assert _fma(a, b, c) == -(2.0**-60)


@pytest.mark.parametrize("operation", [_maximum, _minimum], ids=name)
def test_the_second_argument_wins_where_there_is_a_nan(operation):
    nans, ones = np.full(LANES, np.nan), np.ones(LANES)
    assert_same_bits(on_lanes(operation, nans, ones, C), ones)
    assert_same_bits(on_lanes(operation, ones, nans, C), nans)


def test_lanes_move_from_and_to_any_index():
    @njit
    def move(source, start, target, target_start):
        store(target, target_start, load(source, start))

    source, target = np.arange(LANES + 9.0), np.zeros(LANES + 9)
    move(source, 3, target, 5)
    np.testing.assert_array_equal(target[5:-4], source[3:-6])
    assert not target[:5].any()
    assert not target[-4:].any()


def test_lanes_mix_with_floats_only():
    @njit
    def add_integer(a):
        store(a, 0, load(a, 0) + 1)

    with pytest.raises(TypingError):
        add_integer(np.zeros(LANES))


def test_own_frame_is_aligned_and_never_inlined():
    @njit
    def framed(a):
        own_frame()
        return a

    assert framed(1.0) == 1.0
    (code,) = framed.inspect_llvm().values()
    assert "alignstack(64)" in code
    assert "noinline" in code
