"""Arguments that several modules take, checked at the edge: the kernels behind it trust them.

And the seal of what leaves the package to be checked elsewhere, a certificate.
"""

import hashlib
import json
from decimal import Decimal
from fractions import Fraction
from math import inf
from numbers import Integral, Real

import numpy as np

from nasm.texts import FORM_OF_FRACTION, parse_fraction, shortened, shown

__all__ = [
    "count",
    "exact",
    "floats",
    "fraction",
    "integer",
    "points",
    "positive",
    "real",
    "sealed",
]

MAX_DENOMINATOR = 10**6


def _scalar(value):
    """The number in an array without dimensions, which NumPy and xarray have for one."""
    is_one = isinstance(value, np.ndarray) and value.ndim == 0 and not np.ma.isMaskedArray(value)
    return value[()] if is_one else value


def integer(value):
    """`value` as an int, whose arithmetic does not overflow as that of NumPy's; TypeError unless it
    is a whole number."""
    value = _scalar(value)
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{shown(value)} is not a whole number")
    return int(value)


def exact(value):
    """The Fraction of ints that `value` is or spells; raises what Fraction does if it is not exact,
    and ValueError if it is too long."""
    value = parse_fraction(str(value)) if isinstance(value, str | Decimal) else Fraction(value)
    return Fraction(int(value.numerator), int(value.denominator))


def count(name, value, low, high):
    """`value` as an int; ValueError unless it is a whole number from low to high."""
    try:
        whole = integer(value)
    except TypeError:
        whole = None
    if whole is None or not low <= whole <= high:
        raise ValueError(f"{name}={shown(value)} must be a whole number from {low} to {high}")
    return whole


def real(name, value, *ends):
    """`value` as a float; ValueError unless it is a number, and between the two ends if they are
    given. Long doubles, which floats may round, are refused."""
    value = _scalar(value)
    if not isinstance(value, Real) or isinstance(value, bool | np.longdouble):
        raise ValueError(f"{name}={shown(value)} must be a number that a float holds")
    if ends and not ends[0] <= value <= ends[1]:
        raise ValueError(f"{name}={shown(value)} must be from {ends[0]} to {ends[1]}")
    return float(value)


def positive(name, value, what):
    """`value` as a finite float; ValueError unless it is a number > 0. what : it is, in words."""
    value = real(name, value)
    if not 0 < value < inf:
        raise ValueError(f"{name}={shown(value)} must be positive: {what}")
    return value


def floats(name, values):
    """`values` as a float array; ValueError unless they are real numbers that floats hold.

    Masked arrays are refused, and long doubles and Decimals whatever their digits; so are Fractions
    that floats would round.
    """
    try:
        if has_mask(values):
            raise TypeError("what is masked is no number")
        given = np.asarray(values)
        holds = given.dtype.kind in "iuf" and given.dtype.itemsize <= 8
        if given.dtype.kind == "O":
            holds = all(isinstance(x, Real) and float(x) == x for x in given.ravel())
    except (TypeError, ValueError, OverflowError):
        holds = False
    if not holds:
        raise ValueError(
            f"{name}={values!r} is not made of real numbers that floats hold, without a mask; "
            f"convert them before, e.g. {name}=(0.3, 0.5)"
        )
    return given.astype(float)


def has_mask(values):
    """Whether it is a masked array, or a list with one in it, whose mask NumPy would drop."""
    if isinstance(values, list | tuple):
        return any(map(has_mask, values))
    return np.ma.isMaskedArray(values)


def fraction(name, value):
    """`value` as an exact Fraction; ValueError unless its denominator is at most 10⁶."""
    try:
        ratio = exact(value)
        float(ratio)  # which 1e400 overflows
    except (TypeError, ValueError, OverflowError, ZeroDivisionError):
        raise ValueError(f"{name}={shown(value)} is not a fraction; {FORM_OF_FRACTION}") from None
    if ratio.denominator > MAX_DENOMINATOR:
        raise ValueError(
            f"{name}={shown(value)} is {shortened(str(ratio))}, whose denominator is more than "
            f"{MAX_DENOMINATOR}; write a shorter fraction, like '{ratio.limit_denominator(1000)}'"
        )
    return ratio


def points(x, y):
    """x and y as finite float arrays of one shape; ValueError otherwise."""
    x, y = floats("x", x), floats("y", y)
    try:
        x, y = np.broadcast_arrays(x, y)
    except ValueError:
        raise ValueError(
            f"x and y have shapes {x.shape} and {y.shape}, which do not broadcast together"
        ) from None
    for name, values in (("x", x), ("y", y)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} is not finite; initial conditions must be finite numbers")
    return x, y


def sealed(certificate):
    """`certificate`, a dict for JSON, with the SHA-256 of its text: no digit changes unnoticed."""
    text = json.dumps(certificate, sort_keys=True).encode()
    return certificate | {"sha256": hashlib.sha256(text).hexdigest()}
