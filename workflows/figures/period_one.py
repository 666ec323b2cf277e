"""Figures of period-one orbits, Figs. 3 and 4 of the paper."""

import numpy as np
from matplotlib.colors import LogNorm

from workflows.figures.style import VERMILION, outer_legend, panels


def draw_primary_points(primary):
    """Draw where the four primary period-one points are stable, Fig. 3."""
    figure, drawn = panels(2, 2, 8, 8.4, stack=False, sharex=True, sharey=True)
    for axes, here, point in zip(drawn, primary.residue, primary.point.values, strict=True):
        axes.contourf(primary.kappa1, primary.kappa2, here, levels=[0, 1], colors=[VERMILION])
        axes.set(title=f"$(x, y) = {point}$", aspect="equal")
        axes.locator_params(nbins=5, integer=True)
        axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$")
        axes.label_outer()
        axes.axhline(0, color="0.7", lw=0.6)
        axes.axvline(0, color="0.7", lw=0.6)
    figure.suptitle("Where each primary period-one orbit is stable")
    return figure


def _is_stable(points):
    return (points.residue > 0) & (points.residue < 1)


def primary_caption(primary):
    shares = [
        f"({letter}) {point}: {100 * float(here.mean()):.1f}%"
        for letter, point, here in zip(
            "abcd", primary.point.values, _is_stable(primary), strict=True
        )
    ]
    return (
        "Strengths for which each primary period-one orbit is stable, 0 < R < 1 (coloured). Stable "
        f"fraction of the plane shown: {', '.join(shares)}."
    )


def draw_secondary_points(secondary):
    """Draw where secondary points exist and are stable, and the error of the estimate, Fig. 4."""
    figure, (axes,) = panels(1, 1, 7.5, 6)
    exists = secondary.z.notnull()
    shown = secondary.where(exists, drop=True) if exists.any() else secondary
    error = shown.estimate_error.where(shown.estimate_error > 0)
    place = shown.kappa1, shown.kappa2
    image = axes.pcolormesh(*place, error, norm=LogNorm(vmin=1e-4, vmax=3), cmap="viridis")
    figure.colorbar(image, ax=axes, label=r"error of the cubic estimate of $z_*$ (radians)")
    border = np.linspace(2.01, float(shown.kappa1.max()), 1000)  # where R of (1/2, 0) is 0
    birth, ends = 2 * border / (border - 2), {"xlim": axes.get_xlim(), "ylim": axes.get_ylim()}
    # At the border, where the error tends to 0, the cells would end in a staircase.
    axes.fill_between(border, birth, ends["ylim"][1], color=image.cmap(0), lw=0, zorder=0.5)
    axes.fill_between(border, 0, birth, color="white", lw=0, zorder=1.5)
    axes.plot(border, birth, color="0.5", lw=1, label="border of existence")
    axes.set(**ends)
    # The hatch is dense, to be visible in the narrow second region, κ1 = κ2 > 5.
    square = _square_of_residue(shown)
    axes.contourf(*place, square, levels=[0, 1], colors="none", hatches=["//////"])
    axes.contour(*place, square, levels=[0, 1], colors="black", linewidths=1.2)
    look = {"facecolor": "none", "edgecolor": "black", "hatch": "//////"}
    axes.fill_between([], [], [], label="stable", **look)
    axes.fill_between([], [], [], label="white: none exist", facecolor="white", edgecolor="0.7")
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    axes.set_title("Secondary period-one orbits near $(1/2, 0)$")
    outer_legend(figure, 2, 2)
    return figure


def _square_of_residue(secondary):
    """Return R², from which contours are drawn, as an array over (kappa2, kappa1).

    Where a pair of orbits is born nearer to (1/2, 0), one of the pair becomes the nearest orbit: R
    jumps to 0, and R² grows linearly from there. R² is extrapolated backwards by one cell, so that
    its zero appears.
    """
    square = secondary.residue.values**2
    continued = 2 * square[:, 2:-1] - square[:, 3:]
    row, before = np.nonzero((square[:, 1:-2] > 1) & (continued < 0))
    square[row, before + 1], square[row, before] = continued[row, before], np.nan
    return square


def secondary_caption(secondary):
    exists, stable = secondary.z.notnull(), _is_stable(secondary)
    return (
        "Secondary period-one orbits near (1/2, 0): they exist in "
        f"{100 * float(exists.mean()):.1f}% of the cells and are stable in "
        f"{100 * float(stable.mean()):.1f}% (hatched). Colours: error of the paper's cubic "
        "estimate of z, with its sign corrected; median "
        f"{float(secondary.estimate_error.median()):.2g}, maximum "
        f"{float(secondary.estimate_error.max()):.2g}."
    )
