"""The main job's figure: three methods in one plane."""

import matplotlib.pyplot as plt

from workflows.figures.escape_plane import draw_field
from workflows.figures.last_barrier import draw_barrier, draw_circle_strip, draw_tip, three_panels
from workflows.figures.style import power


def draw_critical_boundary(plane, circles, barrier):
    """Draw the escape field, CB_ω of the circles and CB_gt in the colours of the last circle.

    Below: which circle that is, by angle; and how CB_gt falls from the tip at 45°.
    """
    figure = plt.figure(figsize=(12, 10.5))
    axes, strip, tip = three_panels(figure)
    draw_field(axes, plane)
    breakdown = {"color": "0.45", "lw": 0.7}
    for i in range(circles.omega.size):
        label = r"$\mathit{CB}_\omega$ of the paper's six circles" if i == 0 else None
        axes.plot(circles.kappa1[i], circles.kappa2[i], label=label, **breakdown)
    colours = draw_barrier(axes, barrier)
    ends = [(float(c.min()), float(c.max())) for c in (plane.kappa1, plane.kappa2)]
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal", xlim=ends[0], ylim=ends[1])
    axes.set_title(
        rf"Where the last barrier breaks; behind it, escape of {int(plane.ensemble[-1])} orbits "
        rf"within ${power(plane.attrs['n_max'])}$ steps"
    )
    axes.legend(loc="upper center", fontsize="small")
    draw_circle_strip(strip, barrier, colours)
    draw_tip(tip, barrier, colours)
    figure.tight_layout()
    return figure
