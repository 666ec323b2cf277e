"""Numbers that a text spells: "0.525", "3/8", "1e-3".

A text may come from anybody, and a short one can spell a number that nothing can compute with:
1e-99999999 has a denominator of 10⁸ digits. So digits are counted before a number is made of them.
"""

import re
from contextlib import suppress
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from fractions import Fraction
from math import inf, isfinite

__all__ = [
    "parse_float",
    "parse_fraction",
    "parse_integer",
    "rounded_bracket",
    "rounded_value",
    "shortened",
    "shown",
]

MAX_DIGITS = 100
"""The most digits of an integer in a text, and of a decimal number on either side of its point."""

_DIGITS = rf"\d{{1,{MAX_DIGITS}}}"
_DECIMAL = rf"(?:{_DIGITS}(?:\.(?:{_DIGITS})?)?|\.{_DIGITS})"
_FRACTION = re.compile(rf"[+-]?(?:{_DIGITS}/{_DIGITS}|{_DECIMAL}(?:[eE][+-]?\d{{1,3}})?)")
FORM_OF_FRACTION = f"write one like 3/8 or 0.375, with at most {MAX_DIGITS} digits"
_LONGEST = 80  # of a value in a message


def parse_float(text):
    """The float that a text spells; ValueError if it spells none."""
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{shown(text)} is not a number; write one like 0.3 or -1e-2") from None


def parse_fraction(text):
    """The Fraction that a text spells, "3/8", "0.375" or "3e-3"; ValueError if it spells none, or
    one of more than `MAX_DIGITS` digits."""
    with suppress(ZeroDivisionError):
        if _FRACTION.fullmatch(text.strip()):
            return Fraction(text)
    raise ValueError(f"{shown(text)} is not a fraction; {FORM_OF_FRACTION}")


def parse_integer(text, low, high):
    """The whole number that a text of digits spells; ValueError unless it is from low to high."""
    digits = text.strip()
    if digits.isdecimal() and len(digits) <= MAX_DIGITS and low <= int(digits) <= high:
        return int(digits)
    raise ValueError(f"{shown(text)} must be a whole number from {low} to {high}")


def shown(value):
    """`value` as messages write it, shortened."""
    try:
        return shortened(repr(value))
    except ValueError:  # of an integer of more than 4300 digits, which Python does not write
        return "an integer of thousands of digits"


def shortened(text):
    """`text`, or its beginning and its length."""
    return text if len(text) <= _LONGEST else f"{text[:40]}… ({len(text)} characters)"


def rounded_value(value: float, error: float) -> str:
    """Write a value with its error: both down to the second digit of the error.

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
    """Write the ends of a bracket, rounded outwards to the second digit of its width.

    An end that is NaN is an empty text, and the other one has six digits.

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
