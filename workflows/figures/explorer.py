"""What a panel of the explorer shows, as a figure of its own."""

import numpy as np
from matplotlib.figure import Figure

from workflows.figures.escape_plane import draw_field
from workflows.figures.phase_space import STRONG, draw_orbits
from workflows.figures.planes import label_plane
from workflows.figures.style import dots

_SURVIVOR = dots("black", 3)  # unlike a circle: it is no barrier


def draw_seen(seen):
    """Draw escape times, the boundary, or orbits with what decides in a strong colour."""
    figure = Figure(figsize=(8, 6.6), layout="constrained")
    axes = figure.subplots()
    axes.set_title(seen.attrs.get("title", "Where the last circle breaks"), fontsize="medium")
    if "which" not in seen:
        label_plane(axes, seen)
        if "escape_time" in seen:
            draw_field(axes, seen.expand_dims("ensemble"))
        else:
            angle = np.deg2rad(seen.angle)
            axes.plot(seen.scale * np.cos(angle), seen.scale * np.sin(angle), ".", color=STRONG)
        return figure
    draw_orbits(axes, seen)
    for name, style in (("circle", {"lw": 1.8, "color": STRONG}), ("longest_lived", _SURVIVOR)):
        if f"{name}_x" in seen:
            axes.plot(seen[f"{name}_x"], seen[f"{name}_y"], **style)
    left, bottom, width, height = seen.attrs["box"]
    axes.set(xlim=(left, left + width), ylim=(bottom, bottom + height))
    axes.set(xlabel="$x$ (turns)", ylabel="$y$ (mod 1)", box_aspect=1)
    return figure
