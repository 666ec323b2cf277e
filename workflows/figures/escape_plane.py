"""First escape times over the plane, Figs. 5 and 6."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

from workflows.figures.style import CIRCLE_COLOURS, power

_BOUNDARY_COLOURS = ["black", CIRCLE_COLOURS[2], CIRCLE_COLOURS[5]]  # far from those of the field


def draw_escape_plane(plane, steps):
    """First escape times of the largest ensemble, with the boundary of each number of steps."""
    figure, axes = _plane_axes(plane)
    field = draw_field(axes, plane)
    for n, colour in zip(steps[::-1], _BOUNDARY_COLOURS, strict=False):
        axes.contour(
            plane.kappa1, plane.kappa2, field <= n, levels=[0.5], colors=colour, linewidths=1.0
        )
        axes.plot([], [], color=colour, label=f"$N = {power(n)}$")
    figure.legend(loc="outside lower center", ncols=len(steps), frameon=False)
    return figure


def _plane_axes(plane):
    width = float(plane.kappa1.max() - plane.kappa1.min())
    height = float(plane.kappa2.max() - plane.kappa2.min())
    figure, axes = plt.subplots(
        figsize=(10, 1.2 + 8 * min(1.2, height / width)), layout="constrained"
    )
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    axes.set_title(
        rf"Global transport: {int(plane.ensemble[-1])} orbits, up to "
        rf"${power(plane.attrs['n_max'])}$ steps of $\mathcal{{T}}_{{\kappa_1\kappa_2}}$"
    )
    return figure, axes


def draw_field(axes, plane):
    """The field on a log scale; cells without escape are left white. Returns the field."""
    field = plane.escape_time.isel(ensemble=-1).values
    half = [float(c.diff(c.name)[0]) / 2 for c in (plane.kappa1, plane.kappa2)]
    extent = [
        float(plane.kappa1[0]) - half[0],
        float(plane.kappa1[-1]) + half[0],
        float(plane.kappa2[0]) - half[1],
        float(plane.kappa2[-1]) + half[1],
    ]
    finite = np.where(np.isfinite(field), field, np.nan)
    earliest = max(1.0, np.nanmin(finite)) if np.isfinite(finite).any() else 1.0
    image = axes.imshow(
        finite,
        extent=extent,
        origin="lower",
        norm=LogNorm(vmin=earliest, vmax=max(plane.attrs["n_max"], 1.1 * earliest)),
        cmap="magma",
        interpolation="nearest",
    )
    axes.figure.colorbar(
        image, ax=axes, label="first escape $n^*$ (steps); white: none", fraction=0.024, pad=0.02
    )
    return field
