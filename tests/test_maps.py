from fractions import Fraction

import mpmath
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy import cos, pi
from numpy.testing import assert_allclose, assert_array_equal

from nasm.maps import direction, forcing, rotating_forcing, step, step_tangent

strengths = st.floats(-2, 2)
forcings = st.lists(strengths, min_size=1, max_size=3)
coordinates = st.floats(-1, 1)

# For |κ| ≤ 2 and |x|, |y| ≤ 4 the error of one kick is below 2e-15: 4e-16·κ/2π from the sine, and
# half an ulp from each sum. Each later kick magnifies this error by at most
# ‖DS‖ ≤ 2 + |κ| ≤ 4.
ROUNDING = 2e-15


def rounding(kappa):
    return ROUNDING * 4 ** (len(kappa) - 1)


@given(kappa=forcings, x=coordinates, y=coordinates)
def test_step_is_accurate_to_rounding(kappa, x, y):
    with mpmath.workdps(30):
        exact = [float(z) for z in oracles.exact_step(kappa, x, y)]
    assert_allclose(step(kappa, x, y), exact, rtol=0, atol=rounding(kappa))


@given(kappa=forcings, x=coordinates, y=coordinates)
def test_tangent_is_the_derivative_of_step(kappa, x, y):
    tangent = step_tangent(kappa, x, y)
    with mpmath.workdps(50):
        h = mpmath.mpf("1e-15")  # central differences are then exact to 30 digits
        for column, (dx, dy) in enumerate([(h, 0), (0, h)]):
            ahead = mpmath.matrix(oracles.exact_step(kappa, x + dx, y + dy))
            behind = mpmath.matrix(oracles.exact_step(kappa, x - dx, y - dy))
            slope = [float(s) for s in (ahead - behind) / (2 * h)]
            # In κ cos 2πx, an error in x is magnified by at most 2π|κ| < 13.
            assert_allclose(tangent[:, column], slope, rtol=0, atol=13 * 4 * rounding(kappa))


@pytest.mark.parametrize(
    ("frequency", "amplitude", "phase", "strengths"),
    [
        ("1/2", 0.2, 0, (0.7, 0.3)),
        ("1/2", -0.2, 0, (0.3, 0.7)),  # the paper's sign, which shifts the forcing by one kick
        ("1/2", 0.2, 0.25, (0.5, 0.5)),
        ("1/3", 0.2, 0, (0.7, 0.4, 0.4)),
        ("5/7", 0.2, 0.1, 0.5 + 0.2 * cos(2 * pi * (0.1 + np.arange(7) * 5 / 7))),
    ],
)
def test_rotating_forcing_has_the_period_of_its_frequency(frequency, amplitude, phase, strengths):
    assert_allclose(rotating_forcing(0.5, amplitude, frequency, phase), strengths, rtol=1e-14)


def test_strengths_and_frequencies_are_accepted_in_any_usual_form():
    assert_array_equal(direction((0.0, -1e-300)), (0.0, -1e-300))
    for kappa in ([1, 2], (Fraction(1), 2.0), np.array([1, 2], np.uint8), np.float32([1, 2])):
        assert forcing(kappa).dtype == float
        assert_array_equal(forcing(kappa), [1.0, 2.0])
    for frequency in ("3/8", Fraction(3, 8), 0.375):
        assert_array_equal(rotating_forcing(1.0, 0.5, frequency), rotating_forcing(1, 0.5, "0.375"))


@given(st.integers(1, 400), st.integers(2, 400))
def test_rotating_forcing_with_phase_zero_is_a_palindrome_to_the_last_bit(p, q):
    strengths = rotating_forcing(0.3, 0.7, Fraction(p, q))
    assert np.array_equal(strengths[1:], strengths[:0:-1])
