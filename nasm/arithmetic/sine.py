"""sin 2πx and cos 2πx with x in turns.

    sin 2πu = 2πu · (1 + c₁v + c₂v² + … + c₇v⁷),   v = u²,   |u| ≤ 1/4.

The reduction of an angle in turns, x - rint(x), is exact for every x below 2⁵². In radians the
product 2πx is rounded before it is reduced, so libm's sin(2π·x) is wrong by 7e-10 at x = 10⁶.

Of all such polynomials whose constant term is exactly 1, this one has the smallest maximum
*absolute* error in sin 2πu on |u| ≤ 1/4. Its coefficients were found by Remez exchange in 60-digit
arithmetic with the weight 2πu, then rounded to double. The error is 1.10e-16 before rounding;
`tests/test_sine.py` finds the extrema of this error. Including the rounding in the evaluation,
|error of sin2pi| ≤ 4e-16.

Both functions take floats or arrays, in plain NumPy and inside Numba kernels. sin2pi is odd and
cos2pi even to the last bit, so the map's reflection symmetry is not broken by rounding.
"""

import numpy as np
from numba.extending import register_jitable

from nasm.types import FloatArray

__all__ = ["COSINE", "SINE", "SINGLE_SINE", "cos2pi", "sin2pi"]

SINE = (
    1.0,
    -6.579736267392568,
    12.987878804423852,
    -12.208116730784253,
    6.69384827689851,
    -2.4023623458365613,
    0.6075197826138032,
    -0.11007027709872692,
)
"""Coefficients 1, c₁, …, c₇ of (sin 2πu)/(2πu) as a polynomial in u²; see the docstring above."""

SINGLE_SINE = (1.0, -6.5797324892444, 12.987386239067208, -12.18679412216513, 6.315699279004127)
"""Best polynomial of degree 4 in u²; its error, 5e-9, is below single-precision rounding, 6e-8."""

COSINE = tuple((2 * k + 1) * c for k, c in enumerate(SINE))
"""Coefficients of cos 2πu in u², from the derivative of sin 2πu.

This polynomial is less accurate than `cos2pi`, but can be evaluated at the same u as the sine.
"""

_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7 = SINE
_TWO_PI = 2 * np.pi


@register_jitable
def _sin2pi_quarter(u):
    """Compute sin 2πu for |u| ≤ 1/4."""
    v = u * u
    s = _C1 + v * (_C2 + v * (_C3 + v * (_C4 + v * (_C5 + v * (_C6 + v * _C7)))))
    return _TWO_PI * u * (_C0 + v * s)


@register_jitable
def sin2pi(x: float | FloatArray) -> FloatArray:
    """Compute sin 2πx, x in turns, odd to the last bit; absolute error ≤ 4e-16 for |x| < 2⁵².

    Examples
    --------
    >>> from nasm.arithmetic.sine import sin2pi
    >>> print(sin2pi(0.5), sin2pi(10.0**6))
    0.0 0.0
    """
    r = x - np.rint(x)
    a = np.abs(r)
    return np.copysign(_sin2pi_quarter(np.minimum(a, 0.5 - a)), r)


@register_jitable
def cos2pi(x: float | FloatArray) -> FloatArray:
    """Compute cos 2πx, x in turns, even to the last bit; absolute error ≤ 4e-16 for |x| < 2⁵².

    Examples
    --------
    >>> from nasm.arithmetic.sine import cos2pi
    >>> print(cos2pi(0.25), cos2pi(10.0**6 + 0.25))
    0.0 0.0
    """
    return _sin2pi_quarter(0.25 - np.abs(x - np.rint(x)))
