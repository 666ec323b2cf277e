"""Rotating standard maps in the plane of κ̄ and Δκ, Figs. 10 and 11."""

import numpy as np

from workflows.figures.circle_boundaries import draw_circles
from workflows.figures.planes import fill_inside, outline
from workflows.figures.style import colour_of, in_column, outer_legend, panels, power


def draw_rotating_circles(circles, two, direct):
    """Draw CB_ω, CB_gt and the onset of transport under T in the plane of κ̄ and Δκ, Fig. 10."""
    title = r"Rotating standard map with $\Omega = 1/2$: $T_{\kappa_1\kappa_2}$"
    figure, parts = _plane(title, two, direct, circles.critical_scale, 0.7)
    for part in parts:
        draw_circles(part, circles)
    outer_legend(figure, 2)
    return figure


def rotating_circles_caption(circles, two, direct):
    return (
        f"The boundaries CB_ω of the circles {', '.join(circles.circle.values)} by Greene's "
        "residue, CB_gt (bracketed to "
        f"{float(((two.upper - two.lower) / two.critical_scale).max()):.1e}), and "
        f"the onset of transport by direct iteration ({_effort(direct)}), which lies "
        f"{_outside(two, direct)} outside CB_gt. Rotating standard map with Ω = 1/2 and φ0 = 0, "
        "κ̄ = (κ1 + κ2)/2 and Δκ = (κ1 - κ2)/2."
    )


def draw_rotating_tori(tori, two, direct):
    """Draw the breakup of tori, by residues of long orbits, together with CB_gt of T, Fig. 11."""
    title = "Tori of rotating standard maps, and the last circle of $T$"
    figure, parts = _plane(title, two, direct, tori.critical_scale, 0.4)
    x, y = outline(tori.assign_attrs(two.attrs))  # in the plane of T, although their Ω differs
    for part in parts:
        for i, vector in enumerate(tori.vector.values):
            look = {"color": colour_of(i), "ls": ("-", "--", "-.")[i % 3], "lw": 1.1}
            part.plot(x[i], y[i], label=f"torus ({vector})", **look)
    outer_legend(figure, 2)
    return figure


def rotating_tori_caption(tori, two, direct):
    wide = 100 * float((tori.error / tori.critical_scale).median())
    outside = " ".join(
        f"Torus ({vector}) beyond CB_gt: {where_above(tori.angle.values, sharp)}; beyond the "
        f"onset: {where_above(tori.angle.values, biased)}."
        for vector, sharp, biased in zip(
            tori.vector.values, tori.ratio.values, tori.ratio_direct.values, strict=True
        )
    )
    return (
        "Breakup of two-dimensional tori of the rotating standard map, estimated from |R| = 1/4 on "
        "one long orbit for each rotation vector, compared with CB_gt of T and the onset of "
        "transport under T "
        f"by direct iteration ({_effort(direct)}, {_outside(two, direct)} outside CB_gt), on rays "
        f"(κ̄, Δκ) = s·(cos θ, sin θ). {outside} |R| = 1 is reached {wide:.2g}% further out "
        "(median)."
    )


def _plane(title, two, direct, scale, inner):
    """Draw CB_gt, the onset of transport, and a × on each ray for which a method has no answer.

    Returns the figure, and the axes of the plane and of the insets, which begin at `inner`.
    """
    figure, (axes,) = panels(1, 1, 7, 8.6)
    parts = axes, *_tips(axes, inner)
    for part in parts:
        label = r"$\mathit{CB}_{gt}$ of $T$" if part is axes else None
        fill_inside(part, two, edgecolor="black", lw=1, label=label)
    # Near the axes the spacing of rays is no larger than the error of the onset, so the line of
    # the onset would be a row of spikes.
    away = np.abs((direct.angle.values + 45) % 90 - 45)
    onset = direct.isel(angle=np.flatnonzero((away == 0) | (away > 2)))
    words = rf"transport under $T$ within ${power(direct.attrs['n_max'])}$ steps"
    look = {"color": "black", "lw": 0.6, "label": words}
    axes.plot(*outline(onset, onset.upper / onset.critical_scale), **look)
    unknown = [each.isnull().any({*each.dims} - {"angle"}) for each in (scale, direct.upper)]
    angles = np.concatenate([each.angle.values[each.values] for each in unknown])
    if angles.size:
        silent = two.sel(angle=np.unique(angles), method="nearest")
        look = {"ls": "", "marker": "x", "color": "0.3", "ms": 5, "zorder": 4}
        axes.plot(*outline(silent), label="no answer from one of the methods", **look)
    axes.set(xlabel=r"$\bar\kappa$", ylabel=r"$\Delta\kappa$", aspect="equal", title=title)
    return figure, parts


def _effort(direct):
    return f"{direct.attrs['n_orbits']} orbits, {direct.attrs['n_max']} steps"


def _outside(two, direct):
    """Return the bias of direct iteration as text, e.g. "3% to 5%"."""
    excess = 100 * (direct.upper.values / two.critical_scale - 1)
    if not np.isfinite(excess).any():
        return "by an unknown amount"
    return f"{float(excess.min()):.0f}% to {float(excess.max()):.0f}%"


def where_above(angle, ratio):
    """Return, as text, the angles at which the ratio exceeds 1; if there are none, its maximum.

    An example is "12°-14.5° (by 3.1% at 13°)". A ray without a ratio (NaN) ends a range of angles.
    """
    if not np.isfinite(ratio).any():
        return "unknown"
    parts = []
    for first, end in np.flatnonzero(np.diff(np.pad(ratio > 1, 1))).reshape(-1, 2):
        peak = first + int(np.argmax(ratio[first:end]))
        most = f"by {100 * (ratio[peak] - 1):.2g}% at {angle[peak]:g}°"
        parts.append(f"{angle[first]:g}°-{angle[end - 1]:g}° ({most})")
    nearest = int(np.nanargmax(ratio))
    least = f"nowhere (largest ratio {ratio[nearest]:.3f}, at {angle[nearest]:g}°)"
    return ", ".join(parts) or least


def _tips(axes, inner):
    """Return insets that magnify the corners on both axes, from `inner` to 1.

    A figure for one journal column has no insets: the result is ().
    """
    if in_column():
        return ()
    right, top = axes.inset_axes([0.7, 0.7, 0.27, 0.27]), axes.inset_axes([0.06, 0.7, 0.27, 0.27])
    along, across = (inner, 1), ((inner - 1) / 2, (1 - inner) / 2)
    for tip, x, y in ((right, along, across), (top, across, along)):
        tip.set(xlim=x, ylim=y, xticks=[], yticks=[])  # the main axes have ticks
        axes.indicate_inset_zoom(tip, edgecolor="0.4", lw=0.6)
    return right, top
