"""A cube that is not complete yet: an escape plane, or rays."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from workflows.figures.escape_plane import draw_field
from workflows.figures.style import CIRCLE_COLOURS, dots

_SHOWN = 1024  # cells along an axis: of a larger plane every second, third, … is read
_ROWS = len(CIRCLE_COLOURS)


def draw_so_far(cube):
    """The plane of escape times or the critical scales by angle; None for another kind of cube."""
    if "escape_time" in cube and cube.escape_time.dims[1:] == ("kappa2", "kappa1"):
        return _draw_plane(cube)
    if "critical_scale" in cube and cube.critical_scale.dims[-1] == "angle":
        return _draw_rays(cube)
    return None


def caption(cube, name):
    """What is shown, and how much of it is there."""
    done = cube.cpu_seconds.notnull() if "cpu_seconds" in cube else None
    if done is None:
        return f"The cube {name}, which is complete."
    return f"The cube {name} so far: {int(done.sum())} of {done.size} tiles are computed."


def _draw_plane(cube):
    plane = _thinned(cube)[["escape_time"]].isel(ensemble=[-1]).load()
    figure, axes = plt.subplots(figsize=(9, 7))
    field = draw_field(axes, plane)
    unknown = np.where(np.isnan(field), 1.0, np.nan)
    axes.imshow(
        unknown,
        extent=axes.images[0].get_extent(),
        origin="lower",
        cmap=ListedColormap(["0.8"]),
        interpolation="nearest",
    )
    grey = [Patch(color="0.8", label="not computed")]
    axes.legend(handles=grey, loc="lower left", bbox_to_anchor=(0, 1), frameon=False)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    return figure


def _thinned(cube):
    return cube.isel(
        {dim: slice(None, None, -(-cube.sizes[dim] // _SHOWN)) for dim in ("kappa2", "kappa1")}
    )


def _draw_rays(cube):
    figure, axes = plt.subplots(figsize=(9, 5.5))
    scale = cube.critical_scale.load()
    rows = scale if scale.ndim == 2 else scale.expand_dims("row")
    labels = cube[rows.dims[0]].attrs.get("exact") if scale.ndim == 2 else None
    for i, row in enumerate(rows):
        label = f"{rows.dims[0]} {labels[i]}" if labels and len(rows) <= _ROWS else None
        axes.plot(cube.angle, row, **dots(CIRCLE_COLOURS[i % _ROWS], 6), label=label)
    if labels and len(rows) <= _ROWS:
        axes.legend()
    axes.set(
        xlabel=r"angle $\varphi$ of the ray (degrees)",
        ylabel="scale $s$ of the breakup",
        xlim=(float(cube.angle.min()) - 1, float(cube.angle.max()) + 1),
    )
    axes.grid(lw=0.3)
    return figure
