"""First escape times over the plane, Figs. 5 and 6."""

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm
from matplotlib.patheffects import withStroke

from nasm.planes import plane_of
from workflows.figures import style
from workflows.figures.planes import in_plane, label_plane, of_two_kicks

_CELLS = 7
_MEDIAN = rf"median over ${_CELLS} \times {_CELLS}$ cells"
_BOUNDARY_COLOURS = ["black", style.COLOURS[2], style.COLOURS[3]]  # colours absent from the field


def draw_escape_plane(plane, steps):
    """Draw first escape times of the largest ensemble, and a boundary for each number of steps."""
    from scipy.ndimage import median_filter

    x, y = in_plane(plane)
    height = min(1.2, np.ptp(y.values) / np.ptp(x.values))
    figure = style.canvas(10, 1.2 + 7.6 * height, 0.6 + height)
    axes = figure.subplots()
    label_plane(axes, plane)
    of = r"$\mathcal{T}_{\kappa_1\kappa_2}$" if of_two_kicks(plane) else plane_of(plane.attrs).name
    steps_of = f"up to ${style.power(plane.attrs['n_max'])}$ steps of {of}"
    axes.set_title(f"Global transport: {int(plane.ensemble[-1])} orbits, {steps_of}")
    field = median_filter(draw_field(axes, plane), _CELLS)  # each cell is partly random
    for n, colour, dash in zip(steps[::-1], _BOUNDARY_COLOURS, ("-", "--", ":"), strict=False):
        look = {"linewidths": 1.6, "linestyles": dash, "colors": colour}
        curve = axes.contour(x, y, field <= n, levels=[0.5], **look)
        curve.set_path_effects([withStroke(linewidth=3, foreground="white")])
        axes.plot([], [], dash, color=colour, label=f"$N = {style.power(n)}$, {_MEDIAN}")
    style.outer_legend(figure, len(steps), frameon=False, fontsize=None)
    return figure


def draw_field(axes, plane):
    """Draw and return the field, on a log scale; cells without an escape are light grey."""
    field = plane.escape_time.isel(ensemble=-1).values
    finite = np.where(np.isfinite(field), field, np.nan)
    earliest = max(1.0, np.nanmin(finite)) if np.isfinite(finite).any() else 1.0
    colours = colormaps["magma"].with_extremes(bad=style.NO_ESCAPE)
    norm = LogNorm(vmin=earliest, vmax=max(plane.attrs["n_max"], 1.1 * earliest))
    look = {"norm": norm, "cmap": colours, "zorder": 0, "rasterized": True}
    image = axes.pcolormesh(*in_plane(plane), finite, **look)
    label = "first escape $n^*$ (steps); light grey: none"
    if "level" in plane and not style.in_column():
        times = 2 ** (plane.attrs["levels"] - 1)
        label += f"\ncells are up to {times} times wider far from the boundary"
    beside, above = {"fraction": 0.024, "pad": 0.02}, {"location": "top", "aspect": 40}
    where = above if style.in_column() else beside
    axes.figure.colorbar(image, ax=axes, label=label, **where)
    return field
