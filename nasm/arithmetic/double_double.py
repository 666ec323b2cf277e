"""Double-double arithmetic: numbers with about 32 digits as unevaluated sums of two floats.

    x = x_hi + x_lo,   |x_lo| ≤ ulp(x_hi)/2

Sums and products are built from error-free transformations: a + b = s + e and a·b = p + e exactly,
where s and p are the rounded results (Knuth; Dekker; the product uses fma here). If a long
computation in floats has lost digits to rounding, repeating its last steps in this arithmetic
restores them.

`add`, `multiply` and `sincos_2pi` take and return pairs (hi, lo); they are meant to be called from
functions compiled with `numba.njit`.
"""

from fractions import Fraction
from math import factorial

from numba import njit

from nasm.arithmetic.lanes import fma, rint

__all__ = ["add", "divided", "multiply", "pair", "sincos_2pi"]


# π to twice as many digits as a pair can represent.
EXACT_PI = Fraction("3.1415926535897932384626433832795028841971693993751058209749445923")


def pair(exact: Fraction) -> tuple[float, float]:
    """Round a Fraction to a pair (hi, lo).

    Examples
    --------
    >>> from fractions import Fraction
    >>> from nasm.arithmetic.double_double import pair
    >>> pair(Fraction(1, 2))
    (0.5, 0.0)
    """
    return float(exact), float(exact - Fraction(float(exact)))


def _taylor(first):
    """Return the Taylor coefficients in r² of (sin 2πr)/r (first = 1) or cos 2πr (first = 0).

    With these coefficients both functions are accurate to 1e-23 for |r| ≤ 1/8.
    """
    powers = range(first, first + 22, 2)
    return tuple(
        pair((-1) ** ((n - first) // 2) * (2 * EXACT_PI) ** n / factorial(n)) for n in powers
    )


_FIRST_FLOAT = 5  # index of the first coefficient whose term is evaluated in floats
_SIN, _COS = _taylor(1), _taylor(0)
INVERSE_TWO_PI = pair(1 / (2 * EXACT_PI))


@njit(inline="always")
def two_sum(a, b):
    """Add two floats exactly: return the rounded sum and its rounding error."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@njit(inline="always")
def renormalised(hi, lo):
    s = hi + lo
    return s, lo - (s - hi)


@njit(inline="always")
def add(a, b):
    s, error = two_sum(a[0], b[0])
    return renormalised(s, error + (a[1] + b[1]))


@njit(inline="always")
def multiply(a, b):
    p = a[0] * b[0]
    error = fma(a[0], b[0], -p)
    return renormalised(p, error + fma(a[0], b[1], a[1] * b[0]))


@njit(inline="always")
def divided(a, b):
    """Compute the quotient a/b of two floats as a pair."""
    quotient = a / b
    return quotient, fma(-quotient, b, a) / b


@njit
def _polynomial(coefficients, square):
    """Evaluate a Taylor polynomial to 1e-23, using plain floats for its terms below 1e-7."""
    low = coefficients[len(coefficients) - 1][0]
    for k in range(len(coefficients) - 2, _FIRST_FLOAT - 1, -1):
        low = low * square[0] + coefficients[k][0]
    value = (low, 0.0)
    for k in range(_FIRST_FLOAT - 1, -1, -1):
        value = add(multiply(value, square), coefficients[k])
    return value


@njit
def sincos_2pi(x):
    """Compute sin 2πx and cos 2πx for a pair x, to 1e-23."""
    x = renormalised(x[0] - rint(x[0]), x[1])
    quarter = rint(4 * x[0])
    r = two_sum(x[0] - 0.25 * quarter, x[1])
    square = multiply(r, r)
    s = multiply(_polynomial(_SIN, square), r)
    c = _polynomial(_COS, square)
    if quarter == 0:
        return s, c
    if quarter == 1:
        return c, (-s[0], -s[1])
    if quarter == -1:
        return (-c[0], -c[1]), s
    return (-s[0], -s[1]), (-c[0], -c[1])
