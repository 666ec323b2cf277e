"""What a panel of the explorer shows, as a figure of its own."""

import numpy as np
from matplotlib.figure import Figure

from workflows.figures.escape_plane import draw_field
from workflows.figures.phase_space import STRONG, draw_orbits, draw_survivor
from workflows.figures.planes import label_plane


def draw_seen(seen):
    """Draw escape times, the boundary, or orbits with what decides in a strong colour."""
    figure = Figure(figsize=(8, 6.6), layout="constrained")
    axes = figure.subplots()
    axes.set_title(seen.attrs["title"], fontsize="medium")
    if "which" not in seen:
        label_plane(axes, seen)
        if "escape_time" in seen:
            draw_field(axes, seen.expand_dims("ensemble"))
        else:
            angle = np.deg2rad(seen.angle)
            axes.plot(seen.scale * np.cos(angle), seen.scale * np.sin(angle), ".", color=STRONG)
        return figure
    draw_orbits(axes, seen)
    if "circle_x" in seen:
        axes.plot(seen.circle_x, seen.circle_y, color=STRONG, lw=1.8)
    if "longest_lived_x" in seen:
        draw_survivor(axes, seen.longest_lived_x.values, seen.longest_lived_y.values)
    left, bottom, width, height = seen.attrs["box"]
    axes.set(xlim=(left, left + width), ylim=(bottom, bottom + height))
    axes.set(xlabel="$x$ (turns)", ylabel="$y$ (mod 1)", box_aspect=1)
    return figure
