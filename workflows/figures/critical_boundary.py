"""The figure of the main job, `critical_boundary`: three methods in one plane.

Its caption joins the captions of these methods, from `workflows.shared.boundary_captions` and
`circle_boundaries.describe_circles`.
"""

import numpy as np
from matplotlib.patches import Patch

from workflows.figures.circle_boundaries import draw_circles
from workflows.figures.escape_plane import draw_field
from workflows.figures.last_barrier import draw_last_barrier
from workflows.figures.planes import in_plane
from workflows.figures.style import INSIDE, NO_ESCAPE, outer_legend, power


def draw_critical_boundary(plane, circles, barrier):
    """Draw the escape field and CB_ω of the circles behind what `draw_last_barrier` draws."""
    figure = draw_last_barrier(barrier)
    axes = figure.axes[0]  # the axes of the plane
    draw_field(axes, plane)
    draw_circles(axes, circles, lw=0.7)
    xlim, ylim = (_ends(c.values) for c in in_plane(plane))
    axes.set(xlim=xlim, ylim=ylim)
    steps = power(plane.attrs["n_max"])
    behind = f"in colour, first escape of {int(plane.ensemble[-1])} orbits within ${steps}$ steps"
    join = " " if barrier.angle[-1] <= 180 else "\n"  # the upper half plane is wide
    axes.set_title(f"Where the last barrier breaks;{join}{behind}")
    title = r"Lines: $\mathit{CB}_\omega$ of individual circles"
    lines, _ = axes.get_legend_handles_labels()
    greys = {INSIDE: "a barrier exists", NO_ESCAPE: "no barrier, but no escape either"}
    lines += [Patch(facecolor=grey, edgecolor="0.5", label=label) for grey, label in greys.items()]
    outer_legend(figure, 4, 2, "upper", handles=lines, title=title)
    return figure


def _ends(centres):
    """Return the outer edges of the first and the last cell, up to rounding."""
    half = float(np.ptp(centres)) / max(1, centres.size - 1) / 2
    return round(float(centres.min()) - half, 9), round(float(centres.max()) + half, 9)
