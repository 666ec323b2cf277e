"""Rotation numbers as exact continued fractions.

    ω = [a₀; a₁, …, a_k, (b₁, …, b_m)]  =  a₀ + 1/(a₁ + 1/(a₂ + …)),   b₁, …, b_m repeated for ever

The robustness of a circle depends on how poorly fractions approximate ω, and thus on digits that a
float cuts off. A RotationNumber keeps the prefix a₀, …, a_k and the period b₁, …, b_m, so its
convergents are exact to any order. A *noble* number has the period (1); circles with noble ω are
the most robust.

Strings may use γ = [0;(1)], the golden mean (√5 - 1)/2, as in the paper: "gamma", "2gamma+1",
"(5gamma+6)/(4gamma+5)".
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from itertools import chain, cycle, takewhile
from math import isfinite, isqrt
from numbers import Rational

from nasm.checks import count, exact_fraction, integer, real
from nasm.texts import MAX_DIGITS, abbreviate, short_repr

__all__ = ["NAMES", "RotationNumber", "convergents", "moebius", "nobles_near", "parse", "rational"]

NAMES = ("gamma", "gamma+1", "2gamma", "2gamma+1", "(5gamma+6)/(4gamma+5)", "(gamma+1)/(4gamma+5)")
"""The six rotation numbers of the paper, Sec. VI, as `parse` reads them."""

MAX_CHARACTERS = 10_000
"""Maximum length of a text that `parse` accepts."""

MAX_QUOTIENTS = 1000
"""Maximum number of partial quotients that are read or computed, counting prefix and period."""

_INTEGERS = r"\d+(?:,\d+)*"
_CONTINUED_FRACTION = rf"\[(-?\d+)(?:;({_INTEGERS})(?:,\(({_INTEGERS})\))?|;\(({_INTEGERS})\))?\]"
_TERM = r"(?:\d+\*?gamma|gamma|\d+)"
_SUM = rf"[+-]?{_TERM}(?:[+-]{_TERM})*"
_RATIO = rf"(-?{_TERM}|\({_SUM}\))/({_TERM}|\({_SUM}\))"


@dataclass(frozen=True, repr=False)
class RotationNumber:
    """An exact rotation number [prefix; (tail)].

    Create one with `parse` or `rational`, which return the shortest form, so that equal numbers
    compare equal and have the same hash.

    Parameters
    ----------
    prefix : sequence of int
        Partial quotients before the period, at least one; all but the first are ≥ 1.
    tail : sequence of int
        The period, partial quotients ≥ 1 that repeat for ever; () if the number is rational.

    Raises
    ------
    ValueError
        If a partial quotient is too small or not a whole number, or prefix is empty. NumPy
        integers are accepted, and converted to ints, whose arithmetic does not overflow.

    Examples
    --------
    >>> from nasm.numbers import RotationNumber
    >>> omega = RotationNumber((0, 2), (1,))
    >>> omega, round(float(omega), 6)
    (parse("[0;2,(1)]"), 0.381966)
    """

    prefix: tuple[int, ...]
    tail: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in ("prefix", "tail"):
            quotients = getattr(self, name)
            try:
                integers = tuple(map(integer, quotients))
            except TypeError:
                integers = None
            if integers is None or min((1, *integers[name == "prefix" :])) < 1:
                raise ValueError(
                    f"{name}={short_repr(quotients)} must be whole numbers, ≥ 1 except for the "
                    "integer part, e.g. RotationNumber((0, 2), (1,))"
                )
            object.__setattr__(self, name, integers)
        if not self.prefix:
            raise ValueError("prefix=() is empty; its first entry is the integer part, e.g. (0,)")

    def __str__(self) -> str:
        """Return ω as text like "[1;4,(1)]", which `parse` reads back."""
        periodic = f"({','.join(map(str, self.tail))})" if self.tail else ""
        parts = [*map(str, self.prefix), *([periodic] if periodic else [])]
        return f"[{';'.join([parts[0], ','.join(parts[1:])]) if parts[1:] else parts[0]}]"

    def __repr__(self) -> str:
        return f'parse("{self}")'

    def __float__(self) -> float:
        """Return the nearest float: the one to which two consecutive convergents round."""
        value = float("nan")
        for fraction in convergents(self):
            previous, value = value, fraction.numerator / fraction.denominator
            if value == previous:
                break
        return value

    @property
    def is_rational(self) -> bool:
        """True if ω is rational: no circle has this ω, and it has finitely many convergents."""
        return not self.tail


def parse(text: str) -> RotationNumber:
    """Parse a rotation number.

    Parameters
    ----------
    text : str
        A continued fraction "[1;4,(1)]" with its period in parentheses, a fraction "3/5", or a
        Möbius transform of the golden mean with integer coefficients, "(5gamma+6)/(4gamma+5)".

    Raises
    ------
    ValueError
        If the text is anything else, or exceeds `MAX_CHARACTERS`, `texts.MAX_DIGITS` or
        `MAX_QUOTIENTS`.

    Examples
    --------
    >>> from nasm.numbers import parse
    >>> [str(parse(text)) for text in ("gamma", "(5gamma+6)/(4gamma+5)", "3/5")]
    ['[0;(1)]', '[1;4,(1)]', '[0;1,1,2]']
    """
    if len(compact := str(text)) <= MAX_CHARACTERS:
        compact = re.sub(r"\s+", " ", compact.strip()).replace("γ", "gamma")
        compact = re.sub(r" ?([-+*/;,()[\]]) ?", r"\1", compact)
    too_long = len(compact) > MAX_CHARACTERS or compact.count(",") >= MAX_QUOTIENTS
    if too_long or re.search(rf"\d{{{MAX_DIGITS + 1}}}", compact):
        raise _too_long(compact)
    if match := re.fullmatch(_CONTINUED_FRACTION, compact):
        first, prefix_text, tail_text, tail_alone = match.groups()
        prefix = [int(a) for a in (prefix_text or "").split(",") if a]
        tail = [int(b) for b in (tail_text or tail_alone or "").split(",") if b]
        if all(a >= 1 for a in prefix + tail):
            return _shortest([int(first), *prefix], tail)
    elif match := re.fullmatch(f"({_SUM})", compact) or re.fullmatch(_RATIO, compact):
        (a, b), (c, d) = (_linear(part.strip("()")) for part in (*match.groups(), "1")[:2])
        if a * d != b * c:
            return moebius(RotationNumber((0,), (1,)), a, b, c, d)
        if (c, d) != (0, 0):  # γ cancels
            return rational(Fraction(b, d) if d else Fraction(a, c))
    raise ValueError(
        f"{short_repr(text)} is not a rotation number; write a continued fraction like [1;4,(1)], "
        "or a ratio in the golden mean like (5gamma+6)/(4gamma+5)"
    )


def _too_long(text: str) -> ValueError:
    return ValueError(
        f"{abbreviate(text)} is too long; write at most {MAX_CHARACTERS} characters, integers of "
        f"at most {MAX_DIGITS} digits, and a number whose continued fraction has at most "
        f"{MAX_QUOTIENTS} partial quotients before it repeats"
    )


def rational(fraction: Rational | float | str) -> RotationNumber:
    """Expand a fraction into its continued fraction.

    Parameters
    ----------
    fraction : Fraction, int, float or str
        Anything that Fraction converts exactly.

    Examples
    --------
    >>> from nasm.numbers import rational
    >>> rational("5/8")
    parse("[0;1,1,1,2]")
    """
    fraction = exact_fraction(fraction)
    p, q = fraction.numerator, fraction.denominator
    quotients = []
    while q:
        a, (p, q) = p // q, (q, p % q)
        quotients.append(a)
    return RotationNumber(tuple(quotients))


def as_rotation_number(omega: RotationNumber | str) -> RotationNumber:
    """Check an argument `omega`, and return it as a RotationNumber.

    Raises
    ------
    ValueError
        If omega is not a RotationNumber or a string that `parse` accepts. A decimal number is
        refused, because the digits beyond its last one matter; the message suggests the simplest
        noble number that rounds to it.

    Examples
    --------
    >>> from nasm.numbers import as_rotation_number
    >>> as_rotation_number("gamma")
    parse("[0;(1)]")
    """
    if isinstance(omega, str):
        try:
            return parse(omega)
        except ValueError as error:
            raise ValueError(f"omega={error}") from None
    if not isinstance(omega, RotationNumber):
        cure = "create one from its name or continued fraction, e.g. 'gamma' or '[1;(4)]'"
        if isinstance(omega, float) and isfinite(omega):
            places = -Decimal(repr(float(omega))).as_tuple().exponent
            for noble in nobles_near(omega, 0.5 * 10.0**-places, 1):
                cure = f"the simplest noble number with these digits is '{noble}'"
        raise ValueError(f"omega={omega!r} is not a RotationNumber, which is exact; {cure}")
    return omega


def irrational(omega: RotationNumber | str) -> RotationNumber:
    """Check the rotation number of a circle, and return it as a RotationNumber.

    Raises
    ------
    ValueError
        If `as_rotation_number` refuses omega, or omega is rational.

    Examples
    --------
    >>> from nasm.numbers import irrational
    >>> irrational("gamma")
    parse("[0;(1)]")
    """
    omega = as_rotation_number(omega)
    if omega.is_rational:
        raise ValueError(f"omega={omega} is rational; a circle needs an irrational rotation number")
    return omega


def convergents(omega: RotationNumber | str) -> Iterator[Fraction]:
    """Iterate over the convergents p_k/q_k of ω; the iterator is endless if ω is irrational.

    Examples
    --------
    >>> from itertools import islice
    >>> from nasm.numbers import convergents
    >>> [str(fraction) for fraction in islice(convergents("gamma"), 6)]
    ['0', '1', '1/2', '2/3', '3/5', '5/8']
    """
    omega = as_rotation_number(omega)
    p, p_last, q, q_last = 1, 0, 0, 1
    for a in chain(omega.prefix, cycle(omega.tail)):
        p, p_last, q, q_last = a * p + p_last, p, a * q + q_last, q
        yield Fraction(p, q)


def distinct_convergents(omega: RotationNumber | str, q_max: int) -> list[Fraction]:
    """List the convergents p/q of ω with q ≤ q_max; if two have q = 1, omit the first."""
    known = takewhile(lambda f: f.denominator <= q_max, convergents(omega))
    return list({fraction.denominator: fraction for fraction in known}.values())


def moebius(omega: RotationNumber | str, a: int, b: int, c: int = 0, d: int = 1) -> RotationNumber:
    """Compute (a·ω + b)/(c·ω + d) exactly.

    Parameters
    ----------
    omega : RotationNumber or str
    a, b, c, d : int
        Coefficients with ad ≠ bc.

    Raises
    ------
    ValueError
        If the coefficients are not whole numbers, ad = bc, the result is infinite, or its
        continued fraction has more than `MAX_QUOTIENTS` partial quotients.

    Examples
    --------
    >>> from nasm.numbers import moebius
    >>> moebius("gamma", -1, 2)
    parse("[1;2,(1)]")
    """
    try:
        a, b, c, d = map(integer, (a, b, c, d))
    except TypeError:
        raise ValueError(
            f"({a}ω + {b})/({c}ω + {d}) is not exact; use whole numbers a, b, c, d"
        ) from None
    if a * d == b * c:
        raise ValueError(f"({a}ω + {b})/({c}ω + {d}) does not depend on ω; use ad ≠ bc")
    if (omega := as_rotation_number(omega)).is_rational:
        value = list(convergents(omega))[-1]
        if c * value + d == 0:
            raise ValueError(f"({a}ω + {b})/({c}ω + {d}) is infinite at ω = {value}")
        return rational((a * value + b) / (c * value + d))
    # ω = (p·x + p_last)/(q·x + q_last), where x = (r + √n)/t > 1 is the periodic tail, a root of
    # q·x² + (q_last - p)·x - p_last = 0.
    (p, p_last), (q, q_last) = _product(omega.tail)
    n, r, t = (q_last - p) ** 2 + 4 * q * p_last, p - q_last, 2 * q
    (p, p_last), (q, q_last) = _product(omega.prefix)
    s, u = a * p + b * q, c * p + d * q
    top, bottom = s * r + (a * p_last + b * q_last) * t, u * r + (c * p_last + d * q_last) * t
    # Rationalize the denominator of (top + s·√n)/(bottom + u·√n).
    image = _expand_surd(top * bottom - n * s * u, s * bottom - top * u, bottom**2 - n * u**2, n)
    if image is None:
        raise _too_long(f"({a}ω + {b})/({c}ω + {d})")
    return image


def nobles_near(value: float, width: float, n: int) -> list[RotationNumber]:
    """List noble numbers close to a float.

    Their partial quotients agree with those of `value` up to some position and are 1 thereafter.

    Parameters
    ----------
    value : float
    width : float
        Largest distance from `value`, > 0.
    n : int
        Maximum number of noble numbers to return, 0 to 10⁶.

    Returns
    -------
    list of RotationNumber
        The noble numbers in order of increasing length of their prefixes.

    Examples
    --------
    >>> from nasm.numbers import nobles_near
    >>> nobles_near(0.375, 0.1, 2)
    [parse("[0;2,(1)]"), parse("[0;2,1,2,(1)]")]
    """
    value, width = real("value", value), real("width", width)
    n = count("n", n, 0, 10**6)
    if not isfinite(value) or not width > 0:
        raise ValueError(f"value={value} must be finite, and width={width} positive")
    quotients = list(rational(value).prefix[:30])
    nobles = (_shortest(quotients[: k + 1], [1]) for k in range(len(quotients)))
    distinct = dict.fromkeys(noble for noble in nobles if abs(float(noble) - value) < width)
    return list(distinct)[:n]


def _linear(text: str) -> tuple[int, int]:
    """Return (a, b) of "a·gamma + b", a sum of terms as in _SUM."""
    a = b = 0
    for sign, digits, gamma in re.findall(r"([+-]?)(\d*)\*?(gamma)?", text):
        if digits or gamma:
            value = int(sign + (digits or "1"))
            a, b = (a + value, b) if gamma else (a, b + value)
    return a, b


def _product(quotients: Sequence[int]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the matrix ((p, p_last), (q, q_last)) of these partial quotients."""
    p, p_last, q, q_last = 1, 0, 0, 1
    for a in quotients:
        p, p_last, q, q_last = a * p + p_last, p, a * q + q_last, q
    return (p, p_last), (q, q_last)


def _expand_surd(r: int, s: int, t: int, n: int) -> RotationNumber | None:
    """Expand (r + s·√n)/t into its continued fraction: a = ⌊x⌋, x → 1/(x - a), until x recurs.

    t must divide s²n - r², as it does for a root of an equation with integer coefficients. Return
    None if x has not recurred after `MAX_QUOTIENTS` quotients.
    """
    n, s = n * s * s, (1 if s > 0 else -1)
    if s < 0:
        r, t = -r, -t
    root = isqrt(n)
    places: dict[tuple[int, int], int] = {}
    quotients: list[int] = []
    while (r, t) not in places:
        if len(quotients) == MAX_QUOTIENTS:
            return None
        places[r, t] = len(quotients)
        a = (r + root) // t if t > 0 else (r + root + 1) // t
        quotients.append(a)
        r = a * t - r
        t = (n - r * r) // t
    start = places[r, t]
    return _shortest(quotients[:start], quotients[start:])


def _shortest(prefix: list[int], tail: list[int]) -> RotationNumber:
    """Return the canonical RotationNumber: the shortest period, then the shortest prefix."""
    if not tail:
        (p, _), (q, _) = _product(prefix)
        return rational(Fraction(p, q))
    sizes = range(1, len(tail) + 1)
    tail = next(tail[:n] for n in sizes if tail == tail[:n] * (len(tail) // n))
    if not prefix:  # keep a₀ out of the period: only a₀ may be 0 or negative
        prefix, tail = tail[:1], tail[1:] + tail[:1]
    while len(prefix) > 1 and prefix[-1] == tail[-1]:
        prefix, tail = prefix[:-1], tail[-1:] + tail[:-1]
    return RotationNumber(tuple(prefix), tuple(tail))
