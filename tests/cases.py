"""Helpers for tests: every third row of a table for the fast suite; random continued fractions."""

import pytest
from hypothesis import strategies as st

from nasm.numbers import parse


def thirds(table):
    """Return the rows of a table (a list, or a dict keyed by name) as parameters for pytest.

    Every third row belongs to the fast suite; all other rows are marked as slow.
    """
    named = table.items() if isinstance(table, dict) else ((None, row) for row in table)
    return [
        pytest.param(row, id=name and str(name), marks=[pytest.mark.slow] if i % 3 else [])
        for i, (name, row) in enumerate(named)
    ]


def spell(prefix, tail=()):
    """Return a continued fraction as a string."""
    first, *rest = prefix
    parts = [*map(str, rest), *([f"({','.join(map(str, tail))})"] if tail else [])]
    return f"[{first};{','.join(parts)}]" if parts else f"[{first}]"


_QUOTIENTS = st.integers(1, 30)
tails = st.lists(_QUOTIENTS, min_size=1, max_size=5)
prefixes = st.tuples(st.integers(-5, 5), st.lists(_QUOTIENTS, max_size=5)).map(
    lambda parts: [parts[0], *parts[1]]
)
irrationals = st.tuples(prefixes, tails).map(lambda parts: parse(spell(*parts)))
