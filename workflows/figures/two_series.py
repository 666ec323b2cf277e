"""Figures of two series of kicks: thresholds against the delay, and CB_gt in (K, K_α) planes."""

from fractions import Fraction
from math import ceil

import numpy as np

from nasm.planes import plane_of
from workflows.figures import planes, style

_MARKERS = {1.0: ("o", "K"), 0.5: ("^", "K/2"), -1.0: ("s", "-K")}  # K_α/K: marker, K_α


def draw_thresholds(table):
    """Draw K_c against τ and against the weakest resonance.

    Fractions τ = a/q with small q are labelled above the axes. Bars are brackets; if only one end
    of a bracket is known, an arrow points away from that end.
    """
    figure, against_delay, against_strength = _canvas()
    for i, (ratio, (marker, name)) in enumerate(_MARKERS.items()):
        part = table.sel(ratio=ratio)
        look = {"color": style.colour_of(i), "marker": marker, "ms": 4, "mew": 1}
        look |= {"ms": 7, "mfc": "none", "zorder": 1.5} if ratio < 0 else {}
        label = rf"$K_\alpha = {name}$"
        against_delay.plot(part.tau, part.critical_scale, lw=0.6, label=label, **look)
        against_strength.plot(part.weakest, part.critical_scale, ls="", **look)
        for axes, x in ((against_delay, part.tau), (against_strength, part.weakest)):
            style.draw_brackets(axes, x.values, part.lower.values, part.upper.values, look["color"])
    _name_fractions(against_delay, table)
    against_delay.set(xlabel=r"delay $\tau$ (periods)", ylabel=r"$K_c$", xlim=(0, 0.52))
    against_delay.set_title("Threshold against the delay")
    against_strength.set(xlabel=r"$\min_k\,|1 + r\,e^{2\pi i k\tau}|$, $r = K_\alpha/K$")
    against_strength.set(ylabel=r"$K_c$", title="Against the weakest resonance")
    against_strength.margins(x=0.08)
    for axes in (against_delay, against_strength):
        axes.margins(y=0.08)
        axes.set_ylim(0, None)
        axes.grid(lw=0.3, axis="y")
    style.outer_legend(figure, 3, 3)
    return figure


def _canvas():
    """Return a figure and two axes.

    The first axes are twice as wide as the second or, in a one-column figure, above it.
    """
    if style.in_column():
        figure = style.canvas(0, 0, 1.5)
        return figure, *figure.subplots(2)
    figure = style.canvas(12, 5, 0)
    return figure, *figure.subplots(1, 2, width_ratios=[2, 1])


def _name_fractions(axes, table):
    """Label fractions above the axes, smallest q first; skip any too close to a labelled one."""
    gap, named = 0.04 if style.in_column() else 0.017, {}
    for exact in sorted(table.delay.values, key=lambda exact: Fraction(exact).denominator):
        tau = float(Fraction(exact))
        if all(abs(tau - other) >= gap for other in named):
            named[tau] = exact
    above = axes.secondary_xaxis("top")
    above.set_xticks([*named], [*named.values()], fontsize="small")
    axes.vlines(
        [*named], 0, 1, color="0.85", lw=0.5, zorder=0, transform=axes.get_xaxis_transform()
    )


def draw_planes(*curves):
    """Draw CB_gt in the (K, K_α) plane for each delay, coloured by the last circles."""
    wide = 1 if style.in_column() else min(3, len(curves))
    rows = ceil(len(curves) / wide)
    height = 2.3 * rows if style.in_column() else 2.6 * rows + 0.9  # includes the legend
    figure, panels = style.panels(rows, wide, 4.2 * wide, height)
    classes = [_classes(curve) for curve in curves]
    styles = style.circle_styles(np.concatenate(classes))
    for axes, curve, names in zip(panels, curves, classes, strict=False):
        planes.fill_inside(axes, curve)
        axes.plot(*planes.in_plane(curve), color="0.4", lw=0.8, zorder=2)
        style.draw_points(axes, *planes.in_plane(curve), names, styles, 4, zorder=3)
        planes.label_plane(axes, curve)
        axes.text(0.5, 0.15, rf"$\tau = {_delay(curve)}$", transform=axes.transAxes, ha="center")
    for axes in panels[len(curves) :]:
        axes.set_axis_off()
    style.name_circles(panels[0], styles)
    handles, labels = panels[0].get_legend_handles_labels()
    style.outer_legend(figure, 6, 2, handles=handles, labels=labels)
    return figure


def _delay(curve):
    """Return the exact delay of a plane `pairs:a/q`."""
    return plane_of(curve.attrs).name.partition(":")[2]


def _classes(curve):
    """Return, for each ray, the larger of ω and its image; if the plane has no images, ω."""
    whole = planes.whole_of(curve)
    return np.array([style.circle_class(text, whole) for text in curve.circle.values])


def planes_caption(curves):
    parts = []
    for curve in curves:
        known = curve.critical_scale.notnull()
        width = 100 * ((curve.upper - curve.lower) / curve.critical_scale).dropna("angle")
        wide = f", brackets at most {float(width.max()):.2g}% wide" if width.size else ""
        circles = style.longest_arcs(curve.angle.values, _classes(curve))[:2]
        last = f"; most frequent last circles: {', '.join(circles)}" if circles else ""
        rays = f"{int(known.sum())} of {known.size} rays have a value"
        parts.append(f"τ = {_delay(curve)}: {rays}{wide}{last}.")
    return (
        "CB_gt in the plane of K and K_α, the strengths of the kicks at integer times and of the "
        "kicks a time τ later, in units of the period. Inside CB_gt (grey) barriers exist. CB_gt "
        "is symmetric under (K, K_α) → (-K, -K_α). Colours show the rotation number ω per period "
        "of the last circle, which equals its mean momentum; if the denominator q of τ is even, "
        "they show the larger of ω and q/2 - ω. "
        f"{_on_axes(curves)}{' '.join(parts)}"
    )


def _on_axes(curves):
    """State where CB_gt meets the axes, on which only one of the series acts."""
    on_axes = [curve.critical_scale.where(curve.angle % 90 == 0, drop=True) for curve in curves]
    values = np.concatenate([scales.dropna("angle").values for scales in on_axes])
    if not values.size:
        return ""
    ends = dict.fromkeys(f"{end(values):.7g}" for end in (np.min, np.max))
    return f"CB_gt meets the axes, where the map is the standard map, at {' to '.join(ends)}. "
