"""Period-one orbits, Figs. 3 and 4."""

from matplotlib.colors import LogNorm

from workflows.figures.style import VERMILION, panels


def draw_primary_points(primary):
    """Draw where the four primary period-one points are stable, Fig. 3."""
    figure, drawn = panels(2, 2, 8, 8.4, stack=False, sharex=True, sharey=True)
    stable = _is_stable(primary)
    for axes, here, point in zip(drawn, stable, primary.point.values, strict=True):
        axes.contourf(primary.kappa1, primary.kappa2, here, levels=[0.5, 1.5], colors=[VERMILION])
        axes.set(title=f"$(x, y) = {point}$", aspect="equal")
        axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$")
        axes.label_outer()
        axes.axhline(0, color="0.7", lw=0.6)
        axes.axvline(0, color="0.7", lw=0.6)
    figure.suptitle("Strengths for which a primary period-one orbit is stable")
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
        "Strengths of the kicks for which each primary period-one orbit is stable, 0 < R < 1 "
        f"(coloured). Stable parts of the plane shown: {', '.join(shares)}."
    )


def draw_secondary_points(secondary):
    """Draw where secondary points exist and are stable, and the estimate's error, Fig. 4."""
    figure, (axes,) = panels(1, 1, 7.5, 6)
    exists = secondary.z.notnull()
    shown = secondary.where(exists, drop=True) if exists.any() else secondary
    error = shown.estimate_error.where(shown.estimate_error > 0)
    place = shown.kappa1, shown.kappa2
    image = axes.pcolormesh(*place, error, norm=LogNorm(vmin=1e-4, vmax=3), cmap="viridis")
    figure.colorbar(image, ax=axes, label=r"error of the cubic estimate of $z_*$ (radians)")
    stable = _is_stable(shown)
    # Dense lines: a coarse hatch is lost in the narrow second region, κ1 = κ2 > 5.
    axes.contourf(*place, stable, levels=[0.5, 1.5], colors="none", hatches=["//////"])
    axes.contour(*place, stable, levels=[0.5], colors="black", linewidths=1.2)
    look = {"facecolor": "none", "edgecolor": "black", "hatch": "//////"}
    axes.fill_between([], [], [], label="stable", **look)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    axes.set_title("Secondary period-one orbits next to $(1/2, 0)$")
    axes.legend(loc="lower left")
    return figure


def secondary_caption(secondary):
    exists, stable = secondary.z.notnull(), _is_stable(secondary)
    return (
        "Secondary period-one orbits next to (1/2, 0): where they exist "
        f"({100 * float(exists.mean()):.1f}% of the cells), where they are stable "
        f"({100 * float(stable.mean()):.1f}%, hatched), and the error of the paper's cubic "
        f"estimate of z, with its sign corrected: median "
        f"{float(secondary.estimate_error.median()):.2g}, largest "
        f"{float(secondary.estimate_error.max()):.2g}."
    )
