"""Figures at low resolution, for tests that do not examine figures."""

from contextlib import contextmanager

import pytest
from matplotlib.figure import Figure

SAVE = Figure.savefig


@contextmanager
def sketches():
    """Draw figures at low resolution, but leave PDFs empty: drawing them would double the time."""

    def save(figure, file, **how):
        if how["format"] != "pdf":
            SAVE(figure, file, **how | {"dpi": 40})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save)
        yield
