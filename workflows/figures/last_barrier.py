"""CB_gt in the colours of the last circle, a colour for each class under the symmetry."""

import matplotlib.pyplot as plt
import numpy as np

from nasm.planes import plane_of
from workflows.figures.planes import fill_inside, in_plane, label_plane, of_two_kicks
from workflows.figures.style import class_colours, letters, mark_gaps

_TIP = 0.90, 0.98  # of both strengths, in the inset


def draw_last_barrier(barrier):
    """Draw CB_gt on the rays, coloured by the last circle.

    Below: which circle that is, by angle; and how CB_gt falls from the tip at 45°, of two kicks, or
    the bracket.
    """
    figure = plt.figure(figsize=(11, 9.4), layout="constrained")
    draw_panels(figure, barrier).set_title("Where the last barrier breaks")
    return figure


def draw_panels(figure, barrier, region="0.92"):
    """Draw CB_gt with its tip and bracket, the last circles by angle, and the cusp.

    region : grey of the plane inside CB_gt. Returns the axes of the plane.
    """
    places, ratios = [["plane", "plane"], ["strip", "cusp"]], ([1.55, 1], [2, 1])
    panels = figure.subplot_mosaic(places, height_ratios=ratios[0], width_ratios=ratios[1])
    plane, strip, cusp = panels.values()
    whole = max(shift for *_, shift in plane_of(barrier.attrs).symmetries)
    classes, colours = class_colours(barrier.angle.values, barrier.circle.values, whole)
    fill_inside(plane, barrier, region, lw=0, zorder=0.5)
    _draw_arcs(plane, barrier, classes, colours, 3)
    label_plane(plane, barrier)
    places = {}
    if of_two_kicks(barrier):
        places = dict(zip(colours, [90, 90, 90, 90, 15, 165], strict=False))  # the last are close
        _write_circles(plane, barrier, classes, colours)
        _draw_tip(plane, barrier, classes, colours, region)
        bracket = plane.inset_axes([0.535, 0.09, 0.135, 0.27])
        bracket.tick_params(labelsize=7)
        _draw_cusp(cusp, barrier, classes, colours)
    _draw_bracket(bracket if places else cusp, barrier)
    _draw_circle_strip(strip, barrier, classes, colours, whole, places)
    letters(panels.values())
    return plane


def _draw_tip(plane, barrier, classes, colours, region):
    """Draw the tip of two kicks at 45° in an inset, and frame it in the plane."""
    tip = plane.inset_axes([0.345, 0.09, 0.135, 0.27])
    fill_inside(tip, barrier, region, lw=0)
    _draw_arcs(tip, barrier, classes, colours, 2)
    tip.set(xlim=_TIP, ylim=_TIP, aspect="equal")
    tip.set_title("the tip, framed", fontsize=8, pad=3)
    tip.tick_params(labelsize=7)
    plane.add_patch(plt.Rectangle((_TIP[0],) * 2, *(_TIP[1] - _TIP[0],) * 2, fill=False, lw=0.6))


def _draw_arcs(axes, barrier, classes, colours, size):
    """Draw CB_gt as a line and points, each in the colour of the last circle's class."""
    axes.plot(*in_plane(barrier), color="0.4", lw=0.8, zorder=2)
    shades = [colours[name] for name in classes]
    axes.scatter(*in_plane(barrier), c=shades, s=size**2, zorder=3)


def _write_circles(axes, barrier, classes, colours):
    """Write ω along the arcs that have colours, between 45° and 90°."""
    above = (barrier.angle.values >= 45) & (barrier.angle.values <= 90)
    style = {"size": 9, "weight": "bold", "ha": "center", "va": "top", "zorder": 4}
    style |= {"textcoords": "offset points", "rotation_mode": "anchor"}
    for name, colour in colours.items():
        (here,) = np.nonzero((classes == name) & above)
        if colour.startswith("#") and here.size > 3:
            x, y = barrier.kappa1.values[here], barrier.kappa2.values[here]
            slope = np.rad2deg(np.arctan2(y[0] - y[-1], x[0] - x[-1]))
            place = x.mean(), y.mean()
            axes.annotate(name, place, (5, -5), color=colour, rotation=slope, **style)


def _draw_bracket(axes, barrier):
    """Draw the certified circle below and converse KAM above, in parts of the value."""
    lower, upper = (1e5 * (barrier[end] / barrier.critical_scale - 1) for end in ("lower", "upper"))
    axes.fill_between(barrier.angle, lower, upper, color="0.6", lw=0)
    axes.plot(barrier.angle, upper, color="#D55E00", lw=0.8)
    axes.plot(barrier.angle, lower, color="#0072B2", lw=0.8)
    axes.axhline(0, color="black", lw=0.6)
    last = 90 if of_two_kicks(barrier) else int(barrier.angle[-1])
    axes.set(xlim=(0, last), xticks=[0, last // 2, last])
    axes.margins(y=0.25)
    for place, side, words in ((0.98, "top", "no circle"), (0.02, "bottom", "certified circle")):
        axes.text(0.5, place, words, transform=axes.transAxes, ha="center", va=side, size=7)
    axes.set_title(r"bracket by $\varphi$, $10^{-5}$", fontsize=8, pad=3)


def _draw_cusp(axes, barrier, classes, colours):
    """Draw how far the boundary is below the tip at 45°, on logarithmic axes, and the power."""
    (side,) = np.nonzero((barrier.angle.values < 45) & (barrier.angle.values > 25))
    tip = barrier.critical_scale.sel(angle=[45.0], method="nearest").values
    below, away = tip - barrier.critical_scale.values[side], 45 - barrier.angle.values[side]
    if not (below > 0).any():
        axes.set_axis_off()
        return
    axes.scatter(away, below, c=[colours[name] for name in classes[side]], s=14, zorder=3)
    near = (below > 0) & (away <= 2)
    if near.sum() > 2:
        power, offset = np.polyfit(np.log(away[near]), np.log(below[near]), 1)
        line = np.exp(offset) * away**power
        label = rf"$\propto (45° - \varphi)^{{{power:.2f}}}$, fitted up to 2°"
        axes.plot(away, line, color="0.5", lw=1, label=label)
        axes.legend(fontsize="small", loc="upper left")
    axes.set(xscale="log", yscale="log", title="The cusp")
    axes.set(xlabel=r"$45° - \varphi$ (degrees)", ylabel="scale below the tip")
    axes.grid(lw=0.3)


def _draw_circle_strip(axes, barrier, classes, colours, whole, places):
    """Draw which circle is the last, by angle: of ω and its image `whole` - ω the larger."""
    angle, omega = barrier.angle.values, barrier.omega.values
    omega = np.maximum(omega, whole - omega) if whole else omega
    for name, colour in colours.items():
        here = classes == name
        axes.plot(angle[here], omega[here], ".", color=colour, ms=5)
        if colour.startswith("#") and here.any():
            style = {"ha": "center", "va": "center", "size": 9, "weight": "bold"}
            box = {"fc": "white", "ec": "none", "pad": 1}
            at = places.get(name, np.median(angle[here]))
            axes.text(at, omega[here][0], name, color=colour, bbox=box, **style)
    mark_gaps(axes, angle, barrier.status.values != 1)
    axes.set(xlabel=r"angle $\varphi$ of the ray (degrees)", xticks=np.arange(0, angle[-1] + 1, 45))
    label, title = r"$\omega$ of the last circle", "The last circle"
    if whole:
        label += rf", or ${whole} - \omega$"
    if places:
        title += r": $\omega$ from 0° to 90°, $1 - \omega$ beyond; on the axes the two tie"
    axes.set(ylabel=label, title=title)
    axes.grid(lw=0.3)
