"""Rotation numbers as exact continued fractions.

    ω = [a₀; a₁, …, a_k, (b₁, …, b_m)]  =  a₀ + 1/(a₁ + 1/(a₂ + …)),   b₁, …, b_m repeated for ever

All that matters about ω, how badly it is approximated by fractions, is in the digits that a float
cuts off. A RotationNumber keeps a prefix and a period, so its convergents are exact to any order. A
*noble* number is one whose period is (1): its circles are the most robust.

Arithmetic goes by γ = [0;(1)], the golden mean (√5 - 1)/2, as in the paper: "gamma", "2gamma+1",
"(5gamma+6)/(4gamma+5)".
"""

import re
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from itertools import chain, cycle, takewhile
from math import isfinite, isqrt

from nasm.checks import count, exact, integer, real
from nasm.texts import MAX_DIGITS, shortened, shown

__all__ = ["NAMES", "RotationNumber", "convergents", "moebius", "nobles_near", "parse", "rational"]

NAMES = ("gamma", "gamma+1", "2gamma", "2gamma+1", "(5gamma+6)/(4gamma+5)", "(gamma+1)/(4gamma+5)")
"""The six rotation numbers of the paper, Sec. VI, as `parse` reads them."""

MAX_CHARACTERS, MAX_QUOTIENTS = 10_000, 1000
"""The longest text and the longest continued fraction, prefix and one period, that are read."""

_INTEGERS = r"\d+(?:,\d+)*"
_CONTINUED_FRACTION = rf"\[(-?\d+)(?:;({_INTEGERS})(?:,\(({_INTEGERS})\))?|;\(({_INTEGERS})\))?\]"
_TERM = r"(?:\d+\*?gamma|gamma|\d+)"
_SUM = rf"[+-]?{_TERM}(?:[+-]{_TERM})*"
_RATIO = rf"(-?{_TERM}|\({_SUM}\))/({_TERM}|\({_SUM}\))"


@dataclass(frozen=True, repr=False)
class RotationNumber:
    """[prefix; (tail)]: partial quotients, and those that repeat for ever: () if rational.

    All partial quotients but the first are ≥ 1. Made by `parse("gamma")` or `rational`, it is in
    its shortest form, so that equal numbers compare equal.

    ValueError unless they are whole numbers, of which there is one or more; NumPy's become ints,
    as arithmetic of a fixed width would overflow.
    """

    prefix: tuple[int, ...]
    tail: tuple[int, ...] = ()

    def __post_init__(self):
        for name in ("prefix", "tail"):
            quotients = getattr(self, name)
            try:
                exact = tuple(map(integer, quotients))
            except TypeError:
                exact = None
            if exact is None or min((1, *exact[name == "prefix" :])) < 1:
                raise ValueError(
                    f"{name}={shown(quotients)} must be whole numbers, ≥ 1 after the first of a "
                    "number, e.g. RotationNumber((0, 2), (1,))"
                )
            object.__setattr__(self, name, exact)
        if not self.prefix:
            raise ValueError("prefix=() is empty; its first entry is the integer part, e.g. (0,)")

    def __str__(self):
        """ "[1;4,(1)]", which `parse` reads back."""
        periodic = f"({','.join(map(str, self.tail))})" if self.tail else ""
        parts = [*map(str, self.prefix), *([periodic] if periodic else [])]
        return f"[{';'.join([parts[0], ','.join(parts[1:])]) if parts[1:] else parts[0]}]"

    def __repr__(self):
        return f'parse("{self}")'

    def __float__(self):
        """The nearest float: that of two consecutive convergents that round alike."""
        value = None
        for fraction in convergents(self):
            last, value = value, fraction.numerator / fraction.denominator
            if value == last:
                break
        return value

    @property
    def is_rational(self):
        return not self.tail


def parse(text):
    """The rotation number that `text` spells.

    Reads a continued fraction "[1;4,(1)]" (the period in parentheses), a fraction "3/5", or a
    Möbius transform of the golden mean with integer coefficients, "(5gamma+6)/(4gamma+5)".
    ValueError, with two of these forms, for anything else, and for what exceeds
    `MAX_CHARACTERS`, `texts.MAX_DIGITS` or `MAX_QUOTIENTS`.
    """
    if len(compact := str(text)) <= MAX_CHARACTERS:
        compact = re.sub(r"\s+", " ", compact.strip()).replace("γ", "gamma")
        compact = re.sub(r" ?([-+*/;,()[\]]) ?", r"\1", compact)
    too_long = len(compact) > MAX_CHARACTERS or compact.count(",") >= MAX_QUOTIENTS
    if too_long or re.search(rf"\d{{{MAX_DIGITS + 1}}}", compact):
        raise _too_long(compact)
    if match := re.fullmatch(_CONTINUED_FRACTION, compact):
        first, prefix, tail, tail_only = match.groups()
        prefix = [int(a) for a in (prefix or "").split(",") if a]
        tail = [int(b) for b in (tail or tail_only or "").split(",") if b]
        if all(a >= 1 for a in prefix + tail):
            return _shortest([int(first), *prefix], tail)
    elif match := re.fullmatch(f"({_SUM})", compact) or re.fullmatch(_RATIO, compact):
        (a, b), (c, d) = (_linear(part.strip("()")) for part in (*match.groups(), "1")[:2])
        if a * d != b * c:
            return moebius(RotationNumber((0,), (1,)), a, b, c, d)
        if (c, d) != (0, 0):  # no γ is left in it
            return rational(Fraction(b, d) if d else Fraction(a, c))
    raise ValueError(
        f"{shown(text)} is not a rotation number; write a continued fraction like [1;4,(1)], or a "
        "ratio in the golden mean like (5gamma+6)/(4gamma+5)"
    )


def _too_long(text):
    return ValueError(
        f"{shortened(text)} is too long; write at most {MAX_CHARACTERS} characters, integers of at "
        f"most {MAX_DIGITS} digits, and a number whose continued fraction has at most "
        f"{MAX_QUOTIENTS} partial quotients before it repeats"
    )


def rational(fraction):
    """The RotationNumber of a Fraction, int, or anything that Fraction takes exactly."""
    fraction = exact(fraction)
    p, q = fraction.numerator, fraction.denominator
    quotients = []
    while q:
        a, (p, q) = p // q, (q, p % q)
        quotients.append(a)
    return RotationNumber(tuple(quotients))


def checked(omega):
    """The RotationNumber that omega is or spells; ValueError, with the remedy, for anything else.

    A decimal is refused: what decides is in the digits that it cuts off.
    """
    if isinstance(omega, str):
        try:
            return parse(omega)
        except ValueError as error:
            raise ValueError(f"omega={error}") from None
    if not isinstance(omega, RotationNumber):
        cure = "make one of its name or its continued fraction, e.g. 'gamma' or '[1;(4)]'"
        if isinstance(omega, float) and isfinite(omega):
            places = -Decimal(repr(float(omega))).as_tuple().exponent
            for noble in nobles_near(omega, 0.5 * 10.0**-places, 1):
                cure = f"the simplest noble number with these digits is '{noble}'"
        raise ValueError(f"omega={omega!r} is not a RotationNumber, which is exact; {cure}")
    return omega


def convergents(omega):
    """Iterator over the convergents p_k/q_k of omega as Fractions; endless if irrational."""
    omega = checked(omega)
    p, p_last, q, q_last = 1, 0, 0, 1
    for a in chain(omega.prefix, cycle(omega.tail)):
        p, p_last, q, q_last = a * p + p_last, p, a * q + q_last, q
        yield Fraction(p, q)


def distinct_convergents(omega, q_max):
    """The convergents p/q of omega with q ≤ q_max, q increasing: of two with q = 1 the second."""
    known = takewhile(lambda f: f.denominator <= q_max, convergents(omega))
    return list({fraction.denominator: fraction for fraction in known}.values())


def moebius(omega, a, b, c=0, d=1):
    """(a·ω + b)/(c·ω + d), exactly, for integers with ad ≠ bc; e.g. moebius(ω, -1, 2) = 2 - ω."""
    try:
        a, b, c, d = map(integer, (a, b, c, d))
    except TypeError:
        words = f"({a}ω + {b})/({c}ω + {d}) is not exact; use whole numbers a, b, c, d"
        raise ValueError(words) from None
    if a * d == b * c:
        raise ValueError(f"({a}ω + {b})/({c}ω + {d}) does not depend on ω; use ad ≠ bc")
    if (omega := checked(omega)).is_rational:
        value = list(convergents(omega))[-1]
        if c * value + d == 0:
            raise ValueError(f"({a}ω + {b})/({c}ω + {d}) is infinite at ω = {value}")
        return rational((a * value + b) / (c * value + d))
    # ω = (p·x + p_last)/(q·x + q_last), where x = (r + √n)/t > 1 solves the equation of the period,
    # q·x² + (q_last - p)·x - p_last = 0.
    (p, p_last), (q, q_last) = _product(omega.tail)
    n, r, t = (q_last - p) ** 2 + 4 * q * p_last, p - q_last, 2 * q
    (p, p_last), (q, q_last) = _product(omega.prefix)
    s, u = a * p + b * q, c * p + d * q
    top, bottom = s * r + (a * p_last + b * q_last) * t, u * r + (c * p_last + d * q_last) * t
    # Of (top + s·√n)/(bottom + u·√n) make the bottom rational.
    image = _expand_surd(top * bottom - n * s * u, s * bottom - top * u, bottom**2 - n * u**2, n)
    if image is None:
        raise _too_long(f"({a}ω + {b})/({c}ω + {d})")
    return image


def nobles_near(value, width, n):
    """Noble numbers within `width` of a float, those with the shortest prefix first; at most n.

    Each has the partial quotients of `value` up to some place, and ones from there on.
    """
    value, width = real("value", value), real("width", width)
    n = count("n", n, 0, 10**6)
    if not isfinite(value) or not width > 0:
        raise ValueError(f"value={value} must be finite, and width={width} positive")
    quotients = list(rational(value).prefix[:30])
    nobles = (_shortest(quotients[: k + 1], [1]) for k in range(len(quotients)))
    near = dict.fromkeys(noble for noble in nobles if abs(float(noble) - value) < width)
    return list(near)[:n]


def _linear(text):
    """(a, b) of "a·gamma + b", a sum of terms as in _SUM."""
    a = b = 0
    for sign, digits, gamma in re.findall(r"([+-]?)(\d*)\*?(gamma)?", text):
        if digits or gamma:
            value = int(sign + (digits or "1"))
            a, b = (a + value, b) if gamma else (a, b + value)
    return a, b


def _product(quotients):
    """The matrix ((p, p_last), (q, q_last)) of the continued fraction with these quotients."""
    p, p_last, q, q_last = 1, 0, 0, 1
    for a in quotients:
        p, p_last, q, q_last = a * p + p_last, p, a * q + q_last, q
    return (p, p_last), (q, q_last)


def _expand_surd(r, s, t, n):
    """The continued fraction of (r + s·√n)/t: repeat a = floor, x → 1/(x - a) until x recurs.

    t must divide s²n - r², as it does for a root of an equation with integer coefficients. None if
    x has not recurred after `MAX_QUOTIENTS`.
    """
    n, s = n * s * s, (1 if s > 0 else -1)
    if s < 0:
        r, t = -r, -t
    root = isqrt(n)
    seen, quotients = {}, []
    while (r, t) not in seen:
        if len(quotients) == MAX_QUOTIENTS:
            return None
        seen[r, t] = len(quotients)
        a = (r + root) // t if t > 0 else (r + root + 1) // t
        quotients.append(a)
        r = a * t - r
        t = (n - r * r) // t
    start = seen[r, t]
    return _shortest(quotients[:start], quotients[start:])


def _shortest(prefix, tail):
    """The canonical RotationNumber: no repetition inside the tail, as short a prefix as can be."""
    if not tail:
        (p, _), (q, _) = _product(prefix)
        return rational(Fraction(p, q))
    sizes = range(1, len(tail) + 1)
    tail = next(tail[:n] for n in sizes if tail == tail[:n] * (len(tail) // n))
    if not prefix:  # keep a₀ apart: it alone may be 0 or negative
        prefix, tail = tail[:1], tail[1:] + tail[:1]
    while len(prefix) > 1 and prefix[-1] == tail[-1]:
        prefix, tail = prefix[:-1], tail[-1:] + tail[:-1]
    return RotationNumber(tuple(prefix), tuple(tail))
