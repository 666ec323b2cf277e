"""CB_ω of each circle, and their tips, Figs. 8 and 9."""

import matplotlib.pyplot as plt

from workflows.figures.style import CIRCLE_COLOURS


def draw_circle_boundaries(breakdown, barrier):
    """CB_ω of each rotation number over the upper half plane, and CB_gt behind them, Fig. 8."""
    figure, axes = plt.subplots(figsize=(10, 5.8))
    axes.fill_between(barrier.kappa1, barrier.kappa2, color="0.92", label=r"$\mathit{CB}_{gt}$")
    draw_circles(axes, breakdown, breakdown.kappa1, breakdown.kappa2)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal", ylim=(0, None))
    axes.set_title(r"Breakup of circles: $\mathit{CB}_\omega$, and of the last one")
    axes.legend(loc="upper center", ncols=2, fontsize="small")
    return figure


def draw_tips(residues, circles, barrier):
    """The tips at 45° and 135° in detail, Fig. 9: residues as lines, circles as points."""
    figure, panels = plt.subplots(1, 2, figsize=(11, 5.5), layout="constrained")
    for axes, sign in zip(panels, (-1, 1), strict=True):
        axes.fill_between(barrier.kappa1, barrier.kappa2, color="0.92")
        draw_circles(axes, residues, residues.kappa1, residues.kappa2)
        for i in range(circles.omega.size):
            colour = CIRCLE_COLOURS[i % len(CIRCLE_COLOURS)]
            axes.plot(circles.kappa1[i], circles.kappa2[i], ".", color=colour, ms=3)
        ends = sorted((sign * 0.7, sign * 1.0))
        axes.set(xlim=ends, ylim=(0.7, 1.0), aspect="equal", xlabel=r"$\kappa_1$")
    panels[0].set_ylabel(r"$\kappa_2$")
    panels[1].legend(loc="lower right", fontsize="x-small")
    figure.suptitle("The tips: lines by Greene's residue, points by continuation of circles")
    return figure


def draw_circles(axes, breakdown, x, y):
    """The curves (x, y) of each ω; with (-x, -y), as all boundaries have that symmetry."""
    for i, text in enumerate(breakdown.omega.attrs["exact"]):
        colour = CIRCLE_COLOURS[i % len(CIRCLE_COLOURS)]
        axes.plot(x[i], y[i], color=colour, lw=1.3, label=rf"$\omega = {text}$")
        axes.plot(-x[i], -y[i], color=colour, lw=1.3)
