"""Figure of the error of each method against CPU time."""

import numpy as np
from matplotlib.ticker import NullFormatter

from workflows.figures.style import in_column, outer_legend, panels

# Colour of each method, keyed by the start of its name.
_METHOD_COLOURS = {
    "direct, 100 orbits, near": "#E69F00",
    "direct, 100 orbits, single": "#8B0000",
    "direct, 100 orbits": "#CC79A7",
    "direct": "#D55E00",
    "weighted": "0.6",
    "converse": "#0072B2",
    "last certified": "#56B4E9",
    "blow-up": "#56B4E9",
    "residue": "#009E73",
    "last barrier": "black",
    "transport proved": "#E34234",
    "barrier proved": "#4B0082",
}
# Names of improved results, e.g. extrapolated ones, contain one of these words. Their markers are
# filled; the markers of plain results are hollow.
_BETTER = ("extrapolated", "value", "blow-up", "Aitken", "proved")


_LEAST_RANGE = 12
"""Minimum ratio of the ends of the time axis, so that at least one power of ten is labelled."""


def draw_work_precision(data):
    """Draw error against CPU time, with one panel for each ray.

    A one-column figure shows only the improved results (see `_BETTER`), on the first two rays. The
    range of errors too small to be resolved by the reference is shaded grey.
    """
    data = data.isel(ray=slice(2)) if in_column() else data
    columns = min(3, data.ray.size)
    figure, drawn = panels(-(-data.ray.size // columns), columns, 13, 8.4)
    for axes, i in zip(drawn, range(data.ray.size), strict=False):
        of_ray = data.isel(ray=i)
        for method, name in enumerate(data.method.values):
            colour = next(c for start, c in _METHOD_COLOURS.items() if name.startswith(start))
            better = any(word in name for word in _BETTER)
            if in_column() and not better:
                continue
            form, inside = ("o-", colour) if better else ("o--", "white")
            style = {"color": colour, "mfc": inside, "ms": 3 if in_column() else 5, "lw": 1.2}
            error = np.maximum(of_ray.error[method], 1e-16)
            axes.plot(of_ray.cpu_seconds[method], error, form, label=name, **style)
        axes.axhspan(1e-16, float(of_ray.judge_error), color="0.9")
        axes.set(xscale="log", yscale="log", ylim=(1e-14, 2))
        low, high = axes.get_xlim()
        axes.set_xlim(low, max(high, _LEAST_RANGE * low))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set(xlabel="CPU time (s)", ylabel="relative error")
        name = of_ray.ray.item()
        words = rf"$\varphi = {name}°$" if name.isdigit() else "three kicks, (1, 0.7, 0.3)"
        axes.text(0.5, 1.02, words, transform=axes.transAxes, ha="center")
        words = "grey: error of the reference"
        axes.text(0.97, 0.02, words, fontsize="small", transform=axes.transAxes, ha="right")
        axes.grid(lw=0.3)
    handles, labels = drawn[0].get_legend_handles_labels()
    outer_legend(figure, 4, handles=handles, labels=labels)
    for axes in drawn[data.ray.size :]:
        axes.set_axis_off()
    return figure
