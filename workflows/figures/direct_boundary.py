"""Figs. 5 and 6, with captions: the boundary by direct iteration beside the true boundary."""

import numpy as np
from matplotlib.colors import LogNorm

from workflows.figures import style
from workflows.figures.planes import in_plane, label_plane

# Offsets, in points, of the letters from the panels' forcings; they keep letters off the line.
_PLACES = {"b": (-5, -3), "c": (5, 3), "d": (5, -11), "e": (-5, 3)}
# The paper's green triangles, red circles and blue squares, in colours safe for colour blindness.
_MARKS = [*zip("^osDv", np.take([*style.COLOURS, style.VERMILION], [2, 7, 0, 4, 5]), strict=True)]


def draw_rays(boundary, barrier, last=90):
    """Draw the boundary on rays up to angle `last`; by default the positive quadrant, Fig. 5."""
    figure, (axes,) = style.panels(1, 1, 7.5, 7.5)
    up_to = slice(None, last)
    _draw_boundaries(axes, boundary.sel(angle=up_to), barrier.sel(angle=up_to))
    if last == 90:
        axes.set(xlim=(0, None))
    style.outer_legend(figure, 4, 2)
    return figure


def rays_caption(boundary):
    n = ", ".join(map(str, boundary.n.values))
    medians = boundary.bias.median("angle").values
    biases = ", ".join(f"{100 * b:.2g}%" if np.isfinite(b) else "unknown" for b in medians)
    return (
        "The boundary of global transport by direct iteration: on each of "
        f"{boundary.sizes['angle']} rays, the smallest scale above which at least one of "
        f"{boundary.n_orbits} orbits started in [0, 1] × [0, 0.3] leaves -2 ≤ y ≤ 2.3 within "
        f"N = {n} steps (periods of the forcing). Line: the true boundary, bracketed by certified "
        "circles and converse KAM. Excess over the true boundary, median over the rays: "
        f"{biases} (resolution: {100 * boundary.spacing:.0f}% of the excess)."
    )


def draw_half_plane(boundary, barrier, insets):
    """Draw the upper half plane, Fig. 6, and below it the unit cell at four forcings."""
    figure = style.canvas(11, 9, 2.1)
    above, below = figure.subfigures(2, height_ratios=[1, 1.5] if style.in_column() else [1.7, 1])
    plane = above.subplots()
    _draw_boundaries(plane, boundary, barrier)
    plane.set_ylim(0, None)
    plane.plot([], [], "*", color="black", ms=7, label="the forcings of (b) to (e)")
    style.outer_legend(above, 4, 1, fontsize=None)
    rows, columns = (2, 2) if style.in_column() else (1, 4)
    cells = below.subplots(rows, columns, sharex=True, sharey=True).ravel()
    norm = LogNorm(1, max(2.0, float(insets.visits.max())))
    order = np.argsort(insets.kappa1.values, kind="stable")
    for axes, i, letter in zip(cells, order, "bcde", strict=True):
        shown = _draw_cell(axes, insets.isel(forcing=i), norm)
        forcing = [float(insets[name][i]) for name in ("kappa1", "kappa2")]
        plane.plot(*forcing, "*", color="black", ms=4 if style.in_column() else 7, zorder=5)
        at = _PLACES[letter]
        side = {"textcoords": "offset points", "ha": "right" if at[0] < 0 else "left"}
        plane.annotate(f"({letter})", forcing, at, fontsize="small", zorder=5, **side)
    where = {"location": "bottom", "aspect": 40} if style.in_column() else {"aspect": 15}
    below.colorbar(shown, ax=cells, label="visits", **where)
    return figure


def half_plane_caption(insets):
    ranges = "; ".join(
        f"({row.kappa1:g}, {row.kappa2:g}): {row.lowest:.3g} to {row.highest:.3g}"
        for row in insets.drop_dims(["x", "y"]).to_dataframe().itertuples()
    )
    return (
        "(a) The boundary of global transport by direct iteration in the upper half plane. (b) to "
        "(e) How often, at the forcings marked by stars, the "
        f"orbit of ({insets.start[0]:g}, {insets.start[1]:g}) visits each pixel of the unit cell "
        f"in {insets.steps} steps (white: never). Range of y on this orbit, not reduced mod 1, at "
        f"{ranges}."
    )


def _draw_boundaries(axes, boundary, barrier):
    axes.plot(*in_plane(barrier), color="black", lw=1.2, label=r"$\mathit{CB}_{gt}$")
    for i, n in enumerate(boundary.n.values.tolist()):
        marker, colour = _MARKS[i % len(_MARKS)]
        look = {"color": colour, "ms": 4, "mfc": "none", "clip_on": False}
        here, label = boundary.isel(n=i), f"$N = {style.power(n)}$"
        if silent := int(here.bias.isnull().sum()):
            label += f", no answer on {silent} of {here.angle.size} rays"
        axes.plot(*in_plane(here), marker, label=label, **look)
    label_plane(axes, barrier)
    axes.set_title(f"Onset of global transport: ${style.power(boundary.n_orbits)}$ orbits")


def _draw_cell(axes, inset, norm):
    """Draw how often an orbit visits each pixel of the unit cell; return the image."""
    visits = inset.visits.where(inset.visits > 0)
    image = axes.imshow(visits, extent=(0, 1, 0, 1), origin="lower", cmap="Blues", norm=norm)
    axes.set(xlabel="$x$", ylabel="$y$", xticks=[0, 0.5, 1], yticks=[0, 0.5, 1])
    axes.label_outer()
    low, high, verdict = (inset[name].item() for name in ("lowest", "highest", "verdict"))
    if verdict == "transport" and high - low < 1:
        verdict += f",\nbut this orbit stays\nin {low:.2f} < y < {high:.2f}"
    title = f"$({float(inset.kappa1):g}, {float(inset.kappa2):g})$: {verdict}"
    axes.set_title(title, fontsize="small", color=style.VERMILION if "but" in verdict else "black")
    return image
