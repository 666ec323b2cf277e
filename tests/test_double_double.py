"""Double-double arithmetic compared with exact fractions and with mpmath."""

from fractions import Fraction

import mpmath
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nasm.arithmetic import double_double

NUMBERS = st.floats(-1e6, 1e6).filter(lambda a: a == 0 or abs(a) > 1e-6)


def exact(pair):
    return Fraction(pair[0]) + Fraction(pair[1])


@given(NUMBERS, NUMBERS)
def test_two_sum_is_exact(a, b):
    total = double_double.two_sum(a, b)
    assert exact(total) == Fraction(a) + Fraction(b)
    assert total[0] == a + b


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def test_sums_and_products_are_accurate_to_thirty_digits(a, b, c, d):
    first = double_double.two_sum(a, b * 2.0**-54)
    second = double_double.two_sum(c, d * 2.0**-54)
    size = abs(exact(first)) + abs(exact(second))
    total = exact(double_double.add(first, second))
    assert abs(total - exact(first) - exact(second)) <= size * Fraction(2) ** -103
    product = exact(double_double.multiply(first, second))
    assert abs(product - exact(first) * exact(second)) <= abs(product) * Fraction(2) ** -101


@given(st.integers(1, 10**6), st.integers(1, 10**6))
def test_a_ratio_of_integers_is_accurate_to_thirty_digits(a, b):
    quotient = exact(double_double.divided(float(a), float(b)))
    assert abs(quotient - Fraction(a, b)) <= Fraction(a, b) * Fraction(2) ** -104


def test_sine_and_cosine_agree_with_a_forty_digit_computation():
    rng = np.random.default_rng(1)
    x = [*rng.uniform(-2, 2, 500), *(np.arange(-16, 17) / 8), 1e-300, 0.125 - 2**-54]
    with mpmath.workdps(40):
        for hi in map(float, x):
            lo = float(rng.uniform(-0.5, 0.5) * np.spacing(hi))
            turns = 2 * (mpmath.mpf(hi) + mpmath.mpf(lo))
            sine, cosine = double_double.sincos_2pi((hi, lo))
            assert abs(mpmath.mpf(sine[0]) + sine[1] - mpmath.sinpi(turns)) < 1e-23
            assert abs(mpmath.mpf(cosine[0]) + cosine[1] - mpmath.cospi(turns)) < 1e-23
