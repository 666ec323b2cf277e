"""Programs with a changed line, for audits that must notice it."""

import inspect
import re
import sys
import types
from unittest.mock import patch

import pytest


def thirds(table):
    """The rows of a table, a dict, as parameters: each third row for the fast suite, the others for
    the slow one."""
    return [
        pytest.param(row, id=str(name), marks=[pytest.mark.slow] if i % 3 else [])
        for i, (name, row) in enumerate(table.items())
    ]


def changed(source, changes):
    """The source with each of the changes (right, wrong), each of which fits at one place.

    White space does not count, so that a line may be broken anew.
    """
    for right, wrong in changes:
        tokens = re.findall(r"\w+|[^\w\s]", right)
        pattern = r"\s*".join(map(re.escape, tokens))
        source, found = re.subn(pattern, lambda _, wrong=wrong: wrong, source)
        if found != 1:
            raise LookupError(
                f"{right!r} fits at {found} places: a table of changes is out of date"
            )
    return source


def mutant(module, *changes):
    """The module with changes of its source."""
    other = types.ModuleType("mutant")
    with patch.dict(sys.modules, mutant=other):  # where dataclasses look for it
        exec(changed(inspect.getsource(module), changes), vars(other))
    return other
