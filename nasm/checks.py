"""Checks of arguments: public functions check each argument once; kernels rely on these checks.

This module also computes the checksum of certificates; the certificate checker uses its own code
to compute it.
"""

import hashlib
import json
from decimal import Decimal
from fractions import Fraction
from math import inf
from numbers import Integral, Rational, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nasm.texts import FORM_OF_FRACTION, abbreviate, parse_fraction, short_repr

__all__ = [
    "count",
    "exact_fraction",
    "floats",
    "fraction",
    "integer",
    "points",
    "positive",
    "real",
    "with_sha256",
]

MAX_DENOMINATOR = 10**6
"""Largest denominator allowed in a fraction passed as an argument."""


def _scalar(value: object) -> Any:
    """Unwrap a number from a zero-dimensional array, which NumPy and xarray may return."""
    if isinstance(value, np.ndarray) and value.ndim == 0 and not np.ma.isMaskedArray(value):
        return value[()]
    return value


def integer(value: object) -> int:
    """Convert a whole number to an int, whose arithmetic does not overflow as NumPy's does.

    Raises
    ------
    TypeError
        If `value` is not a whole number.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.checks import integer
    >>> integer(np.int8(100)) * 100
    10000
    """
    value = _scalar(value)
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{short_repr(value)} is not a whole number")
    return int(value)


def exact_fraction(value: Rational | Decimal | float | str) -> Fraction:
    """Convert a number, or a string that contains one, to a Fraction of ints.

    Raises
    ------
    ValueError
        If a string is too long. For other values that cannot be converted, Fraction raises its own
        errors.

    Examples
    --------
    >>> from nasm.checks import exact_fraction
    >>> exact_fraction("0.375")
    Fraction(3, 8)
    """
    value = parse_fraction(str(value)) if isinstance(value, str | Decimal) else Fraction(value)
    return Fraction(int(value.numerator), int(value.denominator))


def count(name: str, value: object, low: int, high: int) -> int:
    """Check that `value` is a whole number from low to high, and return it as an int.

    Raises
    ------
    ValueError
        If `value` is not such a number; the message contains `name`.

    Examples
    --------
    >>> from nasm.checks import count
    >>> count("n", 3.5, 1, 10)
    Traceback (most recent call last):
    ValueError: n=3.5 must be a whole number from 1 to 10
    """
    try:
        whole = integer(value)
    except TypeError:
        whole = None
    if whole is None or not low <= whole <= high:
        raise ValueError(f"{name}={short_repr(value)} must be a whole number from {low} to {high}")
    return whole


def real(name: str, value: object, *ends: float) -> float:
    """Check that `value` is a real number, within `ends` if given, and return it as a float.

    Raises
    ------
    ValueError
        If `value` is not such a number, or if it is a long double, which a float may round.

    Examples
    --------
    >>> from nasm.checks import real
    >>> real("tol", 2, 0, 1)
    Traceback (most recent call last):
    ValueError: tol=2 must be from 0 to 1
    """
    value = _scalar(value)
    if not isinstance(value, Real) or isinstance(value, bool | np.longdouble):
        raise ValueError(f"{name}={short_repr(value)} must be a number that fits in a float")
    if ends and not ends[0] <= value <= ends[1]:  # type: ignore[operator]
        raise ValueError(f"{name}={short_repr(value)} must be from {ends[0]} to {ends[1]}")
    return float(value)


def positive(name: str, value: object, meaning: str) -> float:
    """Check that `value` is a finite number > 0, and return it as a float.

    Parameters
    ----------
    name, value
        Name and value of the argument.
    meaning : str
        What the argument means, for the message.

    Raises
    ------
    ValueError
        If `value` is not such a number.

    Examples
    --------
    >>> from nasm.checks import positive
    >>> positive("spacing", 0, "turns from point to point")
    Traceback (most recent call last):
    ValueError: spacing=0.0 must be positive: turns from point to point
    """
    value = real(name, value)
    if not 0 < value < inf:
        raise ValueError(f"{name}={short_repr(value)} must be positive: {meaning}")
    return value


def floats(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Check that `values` are real numbers that floats can represent; return them as a float array.

    Raises
    ------
    ValueError
        If they are not such numbers. Masked arrays, long doubles and Decimals are refused; so are
        Fractions that floats would round.

    Examples
    --------
    >>> from nasm.checks import floats
    >>> floats("y", [1, 2])
    array([1., 2.])
    """
    try:
        if has_mask(values):
            raise TypeError("masked entries are not numbers")
        array = np.asarray(values)
        is_exact = array.dtype.kind in "iuf" and array.dtype.itemsize <= 8
        if array.dtype.kind == "O":
            is_exact = all(isinstance(x, Real) and float(x) == x for x in array.ravel())
    except (TypeError, ValueError, OverflowError):
        is_exact = False
    if not is_exact:
        raise ValueError(
            f"{name}={values!r} must consist of real numbers that fit in floats, without a mask; "
            f"convert them first, e.g. {name}=(0.3, 0.5)"
        )
    return array.astype(float)


def has_mask(values: object) -> bool:
    """Return True if `values` is or contains a masked array, whose mask NumPy would drop."""
    if isinstance(values, list | tuple):
        return any(map(has_mask, values))
    return np.ma.isMaskedArray(values)


def fraction(name: str, value: Rational | Decimal | float | str) -> Fraction:
    """Check that `value` is a fraction with a denominator of at most 10⁶; return it exactly.

    Raises
    ------
    ValueError
        If it is not such a fraction.

    Examples
    --------
    >>> from nasm.checks import fraction
    >>> fraction("frequency", "2/6")
    Fraction(1, 3)
    """
    try:
        ratio = exact_fraction(value)
        float(ratio)  # overflows for 1e400
    except (TypeError, ValueError, OverflowError, ZeroDivisionError):
        raise ValueError(
            f"{name}={short_repr(value)} is not a fraction; {FORM_OF_FRACTION}"
        ) from None
    if ratio.denominator > MAX_DENOMINATOR:
        raise ValueError(
            f"{name}={short_repr(value)} is {abbreviate(str(ratio))}, whose denominator is more "
            f"than {MAX_DENOMINATOR}; write a shorter fraction, like "
            f"'{ratio.limit_denominator(1000)}'"
        )
    return ratio


def points(x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Check points, and return x and y as finite float arrays of the same shape.

    Raises
    ------
    ValueError
        If x or y is not finite, or if their shapes do not broadcast.

    Examples
    --------
    >>> from nasm.checks import points
    >>> points([0.0, 0.5], 0.25)
    (array([0. , 0.5]), array([0.25, 0.25]))
    """
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


def with_sha256(certificate: dict[str, Any]) -> dict[str, Any]:
    """Return the certificate with the SHA-256 of its JSON text, which reveals any changed digit.

    Examples
    --------
    >>> from nasm.checks import with_sha256
    >>> with_sha256({"kappa": [0.5]})["sha256"][:8]
    '5038a8fe'
    """
    text = json.dumps(certificate, sort_keys=True).encode()
    return certificate | {"sha256": hashlib.sha256(text).hexdigest()}
