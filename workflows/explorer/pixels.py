"""How many pixels a figure of the page has."""

from contextlib import suppress

from bokeh.core.property.descriptors import UnsetValueError


def pixels_of(plot, otherwise, most):
    """Return rows and columns inside the axes, 1 to `most`; `otherwise` until the browser tells."""
    told = otherwise, otherwise
    with suppress(UnsetValueError):
        told = plot.inner_height, plot.inner_width
    return tuple(min(max(int(n), 1), most) for n in told)
