"""What a figure of the page shows, and on how many pixels."""

from contextlib import suppress
from itertools import product

from bokeh.core.property.descriptors import UnsetValueError


def sides_of(plot):
    """Return (lowest, highest) of both axes."""
    return [tuple(sorted(map(float, (r.start, r.end)))) for r in (plot.x_range, plot.y_range)]


def pixels_of(plot, most):
    """Return rows and columns inside the axes, 1 to `most`; None until the browser tells."""
    with suppress(UnsetValueError):
        return tuple(min(max(int(n), 1), most) for n in (plot.inner_height, plot.inner_width))
    return None


def on_view(plot, work, refresh):
    """Call refresh(), once for many changes, soon after what the figure shows or its size changes.

    Returns a function that asks for that too.
    """
    waits = []

    def run():
        waits.clear()
        refresh()

    def soon():
        if not waits:
            waits.append(work.soon(run))

    ends = product((plot.x_range, plot.y_range), ("start", "end"))
    for model, name in (*ends, (plot, "inner_width"), (plot, "inner_height")):
        model.on_change(name, lambda attr, old, new: soon())
    return soon
