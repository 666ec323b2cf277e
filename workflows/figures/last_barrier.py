"""CB_gt in the colours of the last circle, a colour for each class under the symmetry."""

import numpy as np

from workflows.figures import planes, style


def draw_last_barrier(barrier):
    """Draw CB_gt with its tip, the last circles by angle, and two kicks' cusp or the bracket."""
    figure = style.canvas(11, 9.4, 2)
    if style.in_column():
        plane, strip, cusp = figure.subplots(3, height_ratios=[1.5, 1, 1])
    else:
        places, ratios = [["plane", "plane"], ["strip", "cusp"]], ([1.55, 1], [2, 1])
        panels = figure.subplot_mosaic(places, height_ratios=ratios[0], width_ratios=ratios[1])
        plane, strip, cusp = panels.values()
    whole = planes.whole_of(barrier)
    classes = np.array([style.circle_class(text, whole) for text in barrier.circle.values])
    planes.fill_inside(plane, barrier)
    _draw_arcs(plane, barrier, classes, 3.5)
    planes.label_plane(plane, barrier)
    plane.set_title("Where the last barrier breaks")
    if planes.of_two_kicks(barrier):
        if not style.in_column():
            _write_circles(plane, barrier, classes)
            _draw_arcs(planes.tip_of(plane, barrier, 0.9), barrier, classes, 3.5)
        _draw_cusp(cusp, barrier, classes)
    else:
        _draw_bracket(cusp, barrier)
    _draw_circle_strip(strip, barrier, classes, whole)
    return figure


def _draw_arcs(axes, barrier, classes, size):
    """Draw CB_gt as a line and points, each as its last circle's class is drawn."""
    axes.plot(*planes.in_plane(barrier), color="0.4", lw=0.8, zorder=2)
    style.draw_points(axes, *planes.in_plane(barrier), classes, size=size, zorder=3)


def _write_circles(axes, barrier, classes):
    """Write ω along the longest arcs, between 45° and 90°."""
    above = (barrier.angle.values >= 45) & (barrier.angle.values <= 90)
    look = {"weight": "bold", "ha": "center", "va": "top", "zorder": 4, "fontsize": "small"}
    look |= {"textcoords": "offset points", "rotation_mode": "anchor"}
    for name in style.longest_arcs(barrier.angle.values, classes):
        (here,) = np.nonzero((classes == name) & above)
        if here.size > 3:
            x, y = barrier.kappa1.values[here], barrier.kappa2.values[here]
            slope = np.rad2deg(np.arctan2(y[0] - y[-1], x[0] - x[-1]))
            color = style.circle_style(name)["color"]
            axes.annotate(name, (x.mean(), y.mean()), (5, -5), color=color, rotation=slope, **look)


def _draw_bracket(axes, barrier):
    """Draw the certified circle below and converse KAM above, in parts of the value."""
    lower, upper = (1e5 * (barrier[end] / barrier.critical_scale - 1) for end in ("lower", "upper"))
    axes.fill_between(barrier.angle, lower, upper, color="0.6", lw=0)
    axes.plot(barrier.angle, upper, color="#D55E00", lw=0.8)
    axes.plot(barrier.angle, lower, color="#0072B2", lw=0.8)
    axes.axhline(0, color="black", lw=0.6)
    last = int(barrier.angle[-1])
    axes.set(xlim=(0, last), xticks=[0, last // 2, last])
    axes.margins(y=0.25)
    for place, side, words in ((0.98, "top", "no circle"), (0.02, "bottom", "certified circle")):
        axes.text(0.5, place, words, transform=axes.transAxes, ha="center", va=side)
    axes.set(xlabel=r"$\varphi$ (degrees)", ylabel=r"parts of the value, $10^{-5}$")
    axes.set_title("The bracket")


def _draw_cusp(axes, barrier, classes):
    """Draw how far the boundary is below the tip at 45°, on logarithmic axes, and the power."""
    (side,) = np.nonzero((barrier.angle.values < 45) & (barrier.angle.values > 25))
    tip = barrier.critical_scale.sel(angle=[45.0], method="nearest").values
    below, away = tip - barrier.critical_scale.values[side], 45 - barrier.angle.values[side]
    if not (below > 0).any():
        axes.set_axis_off()
        return
    style.draw_points(axes, away, below, classes[side], size=4, zorder=3)
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


def _draw_circle_strip(axes, barrier, classes, whole):
    """Draw which circle is the last, by angle: of ω and its image `whole` - ω the larger."""
    angle, omega = barrier.angle.values, barrier.omega.values
    omega = np.maximum(omega, whole - omega) if whole else omega
    style.draw_points(axes, angle, omega, classes, size=4)
    named = {name: omega[classes == name][0] for name in style.longest_arcs(angle, classes)}
    look = {"size": "small", "weight": "bold", "ha": "center", "va": "bottom"}
    apart = (0.1 if style.in_column() else 0.06) * np.ptp(omega)
    y = -np.inf
    for name in sorted(named, key=named.get):  # each above the one before
        y = max(named[name] + apart / 2, y + apart)
        axes.text(angle[-1] / 2, y, name, color=style.circle_style(name)["color"], **look)
    axes.set_ylim(axes.get_ylim()[0], y + 1.5 * apart)
    style.mark_gaps(axes, angle, barrier.critical_scale.isnull().values)
    axes.set(xlabel=r"angle $\varphi$ of the ray (degrees)", xticks=np.arange(0, angle[-1] + 1, 45))
    label, title = r"$\omega$ of the last circle", "The last circle"
    if whole:
        label += rf", or ${whole} - \omega$"
    if planes.of_two_kicks(barrier):
        title += r"; on the axes $\omega$ and $1 - \omega$ tie"
    axes.set(ylabel=label, title=title)
    axes.grid(lw=0.3)
