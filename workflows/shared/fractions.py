"""Fractions with small denominators, used as frequencies and delays in sweeps."""

from collections.abc import Iterable
from fractions import Fraction
from typing import Any


def up_to_half(max_denominator: int, further: Iterable[Any] = ()) -> list[Any]:
    """List all p/q in (0, 1/2] with q up to a maximum, and any extra numbers, sorted."""
    denominators = range(2, max_denominator + 1)
    simple = {Fraction(p, q) for q in denominators for p in range(1, q // 2 + 1)}
    return sorted(simple.union(further))
