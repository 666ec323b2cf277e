"""CB_gt in the colours of the last circle."""

import matplotlib.pyplot as plt
import numpy as np


def draw_last_barrier(barrier):
    """Draw CB_gt in the upper half plane, coloured by the last circle.

    Below: which circle that is, by angle; and how CB_gt falls from the tip at 45°.
    """
    figure = plt.figure(figsize=(11, 8.5))
    plane, strip, tip = three_panels(figure)
    colours = draw_barrier(plane, barrier)
    plane.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    plane.set_title("Where the last barrier breaks")
    draw_circle_strip(strip, barrier, colours)
    draw_tip(tip, barrier, colours)
    figure.tight_layout()
    return figure


def draw_tip(axes, barrier, colours):
    """Draw how far the boundary is below the tip at 45°, on logarithmic axes."""
    side = barrier.isel(angle=np.flatnonzero(((barrier.angle < 45) & (barrier.angle > 25)).values))
    short = barrier.critical_scale.sel(angle=45) - side.critical_scale
    if not (short > 0).any():
        axes.set_axis_off()
        return
    axes.scatter(45 - side.angle, short, c=[colours[c] for c in side.circle.values], s=14)
    axes.set(xscale="log", yscale="log", xlabel=r"$45° - \varphi$", ylabel="scale below the tip")
    axes.grid(lw=0.3)


def draw_barrier(axes, table):
    """Draw CB_gt, each point in the colour of its last circle; return {circle: colour}."""
    circles = [c for c in dict.fromkeys(table.circle.values.tolist()) if c]
    palette = plt.get_cmap("tab20").colors
    colours = {circle: palette[i % len(palette)] for i, circle in enumerate(circles)}
    colours[""] = "black"
    axes.plot(table.kappa1, table.kappa2, color="0.6", lw=0.8, zorder=1)
    points = [colours[c] for c in table.circle.values]
    axes.scatter(table.kappa1, table.kappa2, c=points, s=9, zorder=2)
    return colours


def draw_circle_strip(axes, table, colours):
    """Draw which circle is the last, by angle."""
    for circle, colour in colours.items():
        here = table.isel(angle=np.flatnonzero(table.circle.values == circle))
        if here.angle.size:
            label = rf"$\omega = {circle}$" if circle else "undecided"
            axes.plot(here.angle, here.omega, ".", color=colour, ms=5, label=label)
    axes.set(xlabel=r"angle $\varphi$ of the ray (degrees)", ylabel=r"$\omega$ of the last circle")
    axes.legend(loc="upper right", fontsize="xx-small", ncols=2)
    axes.grid(lw=0.3)


def three_panels(figure):
    """Make axes for the plane, for what happens by angle, and for the tip."""
    places, ratios = [["plane", "plane"], ["strip", "tip"]], ([1.5, 1], [2.4, 1])
    panels = figure.subplot_mosaic(places, height_ratios=ratios[0], width_ratios=ratios[1])
    return panels.values()
