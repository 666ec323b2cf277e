"""Numbers as text: parse "0.525", "3/8" and "1e-3", and write values with their errors.

Strings may come from untrusted sources, and a short string can denote a number too large to
compute with: 1e-99999999 has a denominator with 10⁸ digits. Digits are therefore counted before a
string is converted.
"""

import re
from contextlib import suppress
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from fractions import Fraction
from math import inf, isfinite

__all__ = [
    "abbreviate",
    "parse_float",
    "parse_fraction",
    "parse_integer",
    "rounded_bracket",
    "rounded_value",
    "short_repr",
]

MAX_DIGITS = 100
"""Maximum number of digits in an integer, or on each side of a decimal point."""

_DIGITS = rf"\d{{1,{MAX_DIGITS}}}"
_DECIMAL = rf"(?:{_DIGITS}(?:\.(?:{_DIGITS})?)?|\.{_DIGITS})"
_FRACTION = re.compile(rf"[+-]?(?:{_DIGITS}/{_DIGITS}|{_DECIMAL}(?:[eE][+-]?\d{{1,3}})?)")
FORM_OF_FRACTION = f"write one like 3/8 or 0.375, with at most {MAX_DIGITS} digits"
_MAX_LENGTH = 80  # characters of a value in a message


def parse_float(text: str) -> float:
    """Parse a float.

    Raises
    ------
    ValueError
        If the text is not a number.

    Examples
    --------
    >>> from nasm.texts import parse_float
    >>> parse_float("-1e-2")
    -0.01
    """
    try:
        return float(text)
    except ValueError:
        raise ValueError(
            f"{short_repr(text)} is not a number; write one like 0.3 or -1e-2"
        ) from None


def parse_fraction(text: str) -> Fraction:
    """Parse an exact fraction, such as "3/8", "0.375" or "3e-3".

    Raises
    ------
    ValueError
        If the text is not a fraction, or has more digits than `MAX_DIGITS` allows.

    Examples
    --------
    >>> from nasm.texts import parse_fraction
    >>> parse_fraction("0.375")
    Fraction(3, 8)
    """
    with suppress(ZeroDivisionError):
        if _FRACTION.fullmatch(text.strip()):
            return Fraction(text)
    raise ValueError(f"{short_repr(text)} is not a fraction; {FORM_OF_FRACTION}")


def parse_integer(text: str, low: int, high: int) -> int:
    """Parse a whole number in decimal digits.

    Raises
    ------
    ValueError
        If the text is not a whole number between low and high, inclusive.

    Examples
    --------
    >>> from nasm.texts import parse_integer
    >>> parse_integer("12", 1, 100)
    12
    """
    digits = text.strip()
    if digits.isdecimal() and len(digits) <= MAX_DIGITS and low <= int(digits) <= high:
        return int(digits)
    raise ValueError(f"{short_repr(text)} must be a whole number from {low} to {high}")


def short_repr(value: object) -> str:
    """Return the repr of a value, abbreviated for a message.

    Examples
    --------
    >>> from nasm.texts import short_repr
    >>> short_repr("x" * 100)
    "'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx… (102 characters)"
    """
    try:
        return abbreviate(repr(value))
    except ValueError:  # Python refuses to write integers with more than 4300 digits
        return "an integer with thousands of digits"


def abbreviate(text: str) -> str:
    """Shorten a text longer than 80 characters to its beginning, and add its length."""
    return text if len(text) <= _MAX_LENGTH else f"{text[:40]}… ({len(text)} characters)"


def rounded_value(value: float, error: float) -> str:
    """Write a value with its error, both rounded to the second significant digit of the error.

    Examples
    --------
    >>> from nasm.texts import rounded_value
    >>> rounded_value(0.971635406, 2.1e-7)
    '0.97163541 ± 2.1e-07'
    """
    if not (isfinite(value) and 0 < error < inf):
        return f"{value:.15g}"
    digits = Decimal(value).adjusted() - Decimal(error).adjusted() + 2
    return f"{value:#.{min(max(digits, 2), 16)}g}".rstrip(".") + f" ± {error:.2g}"


def rounded_bracket(lower: float, upper: float) -> tuple[str, str]:
    """Write the ends of a bracket, rounded outwards to the second significant digit of its width.

    An end that is not finite becomes an empty string; the other end is then written with six
    digits.

    Examples
    --------
    >>> from nasm.texts import rounded_bracket
    >>> rounded_bracket(0.97154321, 0.97171234)
    ('0.97154', '0.97172')
    """
    known = [Decimal(end) for end in (lower, upper) if isfinite(end)]
    width = known[-1] - known[0] or known[0] / 10**4 if known else Decimal(0)
    unit = Decimal(1).scaleb(width.adjusted() - 1) if width else Decimal(0)

    def rounded(end: float, rounding: str) -> str:
        return f"{float(Decimal(end).quantize(unit, rounding)):.15g}" if isfinite(end) else ""

    return rounded(lower, ROUND_FLOOR), rounded(upper, ROUND_CEILING)
