"""The main job's figure: three methods in one plane."""

import numpy as np

from workflows.figures.circle_boundaries import draw_circles
from workflows.figures.escape_plane import draw_field
from workflows.figures.last_barrier import draw_last_barrier
from workflows.figures.planes import in_plane, of_two_kicks
from workflows.figures.style import in_column, known, power


def draw_critical_boundary(plane, circles, barrier):
    """Draw the escape field and CB_ω of the circles behind what `draw_last_barrier` draws."""
    figure = draw_last_barrier(barrier)
    axes = figure.axes[0]  # of the plane
    draw_field(axes, plane)
    draw_circles(axes, known(circles), lw=0.7)
    ends = [(float(c.min()), float(c.max())) for c in in_plane(plane)]
    axes.set(xlim=ends[0], ylim=ends[1])
    steps = power(plane.attrs["n_max"])
    behind = f"behind it, escape of {int(plane.ensemble[-1])} orbits within ${steps}$ steps"
    join = " " if barrier.angle[-1] <= 180 else "\n"  # of the upper half plane, which is wide
    axes.set_title(f"Where the last barrier breaks;{join}{behind}")
    if of_two_kicks(barrier) and not in_column():  # whose boundary is straight there
        x, y = (1.07 * np.interp((120, 130), barrier.angle, part) for part in in_plane(barrier))
        style = {"ha": "center", "va": "center", "size": 8, "clip_on": True}
        style["rotation"] = np.rad2deg(np.arctan(np.ptp(y) / -np.ptp(x)))
        axes.text(x.mean(), y.mean(), f"no barrier left, but no escape in ${steps}$ steps", **style)
    title = r"Lines: $\mathit{CB}_\omega$ of single circles"
    below = {"bbox_to_anchor": (0.45, -0.35), "columnspacing": 1} if in_column() else {}
    axes.legend(loc="upper center", ncols=3, fontsize="small", framealpha=0.9, title=title, **below)
    return figure
