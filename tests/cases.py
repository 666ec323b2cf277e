"""Tables of cases, of which the fast suite takes a third."""

import pytest


def thirds(table):
    """The rows of a table, a list or a dict by name, as parameters: each third row for the fast
    suite, the others for the slow one."""
    named = table.items() if isinstance(table, dict) else ((None, row) for row in table)
    return [
        pytest.param(row, id=name and str(name), marks=[pytest.mark.slow] if i % 3 else [])
        for i, (name, row) in enumerate(named)
    ]
