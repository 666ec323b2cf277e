from itertools import groupby

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from nasm.arithmetic.sine import SINE, SINGLE_SINE, cos2pi, sin2pi

RNG = np.random.default_rng(1)
ANGLES = np.concatenate(
    [
        RNG.uniform(-1, 1, 20_000),
        RNG.uniform(-1e6, 1e6, 5_000),
        RNG.uniform(-1, 1, 5_000) * 2.0 ** RNG.integers(-60, 52, 5_000),
        np.arange(-16, 17) / 16,
    ]
)

# For these numbers, adding or subtracting a small integer or a quarter is exact.
dyadic = st.integers(-(2**42), 2**42).map(lambda k: k / 2**40)


@pytest.mark.parametrize(("ours", "exact"), [(sin2pi, mpmath.sinpi), (cos2pi, mpmath.cospi)])
def test_error_is_below_4e_16_even_far_from_zero(ours, exact):
    with mpmath.workdps(50):
        error = max(abs(ours(x) - exact(2 * mpmath.mpf(x))) for x in ANGLES.tolist())
    assert error <= 4e-16


def test_any_number_of_whole_turns_is_reduced_exactly():
    turns = np.array([0.0, 1.0, -7.0, 1e6, 2.0**53, -1e300])
    assert (sin2pi(turns) == 0).all()
    np.testing.assert_allclose(cos2pi(turns), 1, rtol=0, atol=4e-16)


def test_sine_is_odd_and_cosine_even_to_the_last_bit():
    np.testing.assert_array_equal(sin2pi(-ANGLES), -sin2pi(ANGLES))
    np.testing.assert_array_equal(cos2pi(-ANGLES), cos2pi(ANGLES))


@given(x=dyadic, turns=st.integers(-(10**3), 10**3))
def test_turns_half_turns_and_quarter_turns_are_exact(x, turns):
    assert sin2pi(x + turns) == sin2pi(x)
    assert sin2pi(x + 0.5) == -sin2pi(x)
    assert cos2pi(x) == sin2pi(x + 0.25)


def test_kernels_and_plain_python_agree_to_the_last_bit():
    @njit
    def both(x):
        return sin2pi(x), cos2pi(x)

    np.testing.assert_array_equal(both(ANGLES), (sin2pi(ANGLES), cos2pi(ANGLES)))
    assert both(0.1) == (sin2pi(0.1), cos2pi(0.1))


@pytest.mark.parametrize(("ours", "least"), [(SINE, 1.10e-16), (SINGLE_SINE, 4.62e-9)])
def test_no_polynomial_of_the_same_degree_is_closer_to_the_sine(ours, least):
    """The error of the best polynomial has equal extrema of alternating sign (Chebyshev).

    There is one more extremum than there are free coefficients. Our coefficients are rounded, so
    the extrema are only nearly equal.
    """
    with mpmath.workdps(40):
        errors = []
        for u in mpmath.linspace(0, mpmath.mpf(1) / 4, 2001)[1:]:
            series = sum(c * u ** (2 * k) for k, c in enumerate(ours))
            errors.append(float(2 * mpmath.pi * u * series - mpmath.sinpi(2 * u)))
    extrema = [max(map(abs, run)) for _, run in groupby(errors, np.sign)]
    assert len(extrema) == len(ours)
    assert 0.7 * least < min(extrema) <= max(extrema) < 1.3 * least
