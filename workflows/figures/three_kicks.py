"""Boundaries of rotating standard maps for several phases, relative to the map T (Ω = 1/2)."""

import numpy as np

from workflows.figures import planes, style
from workflows.figures.rotating import where_above


def draw_three_kicks(three, two):
    """Draw the boundaries in the (κ̄, Δκ) plane, and their brackets relative to the boundary of T.

    The brackets are drawn against the angle of the ray. Colours show the last circles.
    """
    exact = three.phase.values
    heights = [1.4, 0.3 + 0.4 * len(exact)]  # heights of the plane and of the strips in a column
    figure = style.canvas(13, 1.6 + 1.3 * max(4, len(exact)), sum(heights))
    if style.in_column():
        left, right = figure.subfigures(2, height_ratios=heights)
    else:
        left, right = figure.subfigures(1, 2, width_ratios=[1.05, 1])
    plane, strips = left.subplots(), right.subplots(len(exact), sharex=True, squeeze=False)[:, 0]
    circles = three.circle.transpose(
        "phase", "angle"
    ).values  # barriers under κ and -κ break at the same scale, but the last circles may differ
    styles = style.circle_styles(circles.ravel())
    label = r"$\mathit{CB}_{gt}$ of $T$ ($\Omega = 1/2$)"
    planes.fill_inside(plane, two, edgecolor="black", lw=1, label=label)
    for i, strip in enumerate(strips):
        curve = three.isel(phase=i)
        plane.plot(*planes.outline(curve), color="0.6", lw=0.6)
        for sign in (1, -1):
            points = sign * curve.kappa_mean, sign * curve.kappa_amplitude
            style.draw_points(plane, *points, circles[i], styles, zorder=3)
        strip.axhline(1, color="black", lw=1)
        angle, ends = curve.angle.values, (curve.ratio_lower.values, curve.ratio_upper.values)
        shades = [styles[text]["color"] for text in circles[i]]
        strip.vlines(angle, *ends, colors=shades, lw=2)
        style.draw_points(strip, angle, curve.ratio, circles[i], styles)
        open_side = np.isnan(curve.ratio.values)
        strip.plot(angle[open_side], ends[1][open_side], "v", color="0.3", ms=4, mfc="none")
        style.mark_gaps(strip, angle, open_side & np.isnan(ends[1]))
        strip.grid(lw=0.3)
        strip.set_ylabel(rf"$\varphi_0 = {exact[i]}$")
    style.name_circles(plane, {text: look for text, look in styles.items() if text})
    if three.ratio.isnull().any():
        style.key(plane, {"v": "converse KAM only", "x": "no answer"}, "v")
    plane.set(xlabel=r"$\bar\kappa$", ylabel=r"$\Delta\kappa$", aspect="equal")
    plane.set_title("Onset of global transport, coloured by the last circle")
    handles, labels = plane.get_legend_handles_labels()
    style.outer_legend(figure, 5, 2, handles=handles, labels=labels)
    strips[-1].set(xlabel=r"angle $\theta$ of the ray in the plane (degrees)", xlim=(0, 180))
    strips[-1].set_xticks(range(0, 181, 30))
    strips[0].set_title("Bracket relative to $T$ (above 1: breaks later than in $T$)")
    return figure


def three_kicks_caption(three):
    known, width = three.ratio.notnull(), (three.upper - three.lower) / three.critical_scale
    where = [
        f"φ0 = {phase}: {where_above(three.angle.values, ratio.values)}."
        for phase, ratio in zip(three.phase.values, three.ratio_lower, strict=True)
    ]
    return (
        "Boundaries of global transport of rotating standard maps for several phases φ0, and the "
        "boundary of T (Ω = 1/2, black): in the plane of the mean strength κ̄ and the amplitude "
        "Δκ, and, along rays (κ̄, Δκ) = s·(cos θ, sin θ), as ratios to the scale of T. The ratios "
        "are bracketed by a certified circle (below) and converse KAM (above). Colours show the "
        "last circle; triangles mark rays where only converse KAM yields a bound. Of "
        f"{known.size} rays, {int(known.sum())} have a value; the relative width of the bracket is "
        f"{float(width.median()):.1e} (median) and at most {float(width.max()):.1e}. Angles at "
        "which the barrier outlasts the barrier of T (certified circle above the converse KAM "
        f"bound of T): {' '.join(where)}"
    )
