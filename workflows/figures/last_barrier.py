"""CB_gt coloured by the circle that breaks last; symmetric images of a circle share its colour.

The caption is in `workflows.shared.boundary_captions`.
"""

import numpy as np

from workflows.figures import planes, style


def draw_last_barrier(barrier):
    """Draw CB_gt, the last circles by angle, and the cusp (two kicks) or bracket (otherwise)."""
    figure, plane, strip, cusp = _canvas(around=barrier.angle[-1] > 180)
    reflection = planes.whole_of(barrier)
    styles = style.circle_styles(barrier.circle.values, reflection)
    classes = np.array([style.circle_class(text, reflection) for text in barrier.circle.values])
    planes.fill_inside(plane, barrier)
    _draw_arcs(plane, barrier, classes, styles)
    planes.label_plane(plane, barrier)
    plane.set_title("Where the last barrier breaks")
    _draw_circle_strip(strip, barrier, classes, styles, reflection)
    if planes.of_two_kicks(barrier):
        _draw_cusp(cusp, barrier, classes, styles)
    else:
        _draw_bracket(cusp, barrier)
    handles, labels = strip.get_legend_handles_labels()
    title = r"$\omega$ of the last circle"
    title += rf", or ${reflection} - \omega$" if reflection else ""
    style.outer_legend(figure, 6, 2, handles=handles, labels=labels, title=title)
    return figure


def _canvas(around):
    """Return a figure and its axes; the axes of the plane are wide, or square if `around`."""
    if style.in_column():
        figure = style.canvas(0, 0, 2.3 if around else 2)
        return figure, *figure.subplots(3, height_ratios=[2 if around else 1.3, 1, 1])
    if around:
        figure, places = style.canvas(13, 7.6, 0), [["plane", "strip"], ["plane", "cusp"]]
        return figure, *figure.subplot_mosaic(places, width_ratios=[1.2, 1]).values()
    figure, places = style.canvas(11, 10, 0), [["plane", "plane"], ["strip", "cusp"]]
    shares = {"height_ratios": [1.55, 1], "width_ratios": [2, 1]}
    return figure, *figure.subplot_mosaic(places, **shares).values()


def _draw_arcs(axes, barrier, classes, styles):
    """Draw CB_gt as a line and points, in the style of the class of the last circle."""
    axes.plot(*planes.in_plane(barrier), color="0.4", lw=0.8, zorder=2)
    style.draw_points(axes, *planes.in_plane(barrier), classes, styles, 3.5, zorder=3)


def _draw_bracket(axes, barrier):
    """Draw the bracket relative to the value: certified circle below, converse KAM above."""
    lower, upper = (1e5 * (barrier[end] / barrier.critical_scale - 1) for end in ("lower", "upper"))
    axes.fill_between(barrier.angle, lower, upper, color="0.6", lw=0)
    axes.plot(barrier.angle, upper, color=style.VERMILION, lw=0.8)
    axes.plot(barrier.angle, lower, color=style.COLOURS[0], lw=0.8)
    axes.axhline(0, color="black", lw=0.6)
    last = int(barrier.angle[-1])
    axes.set(xlim=(0, last), xticks=[0, last // 2, last])
    axes.margins(y=0.25)
    for place, side, claim in ((0.98, "top", "no circle"), (0.02, "bottom", "certified circle")):
        axes.text(0.5, place, claim, transform=axes.transAxes, ha="center", va=side)
    axes.set(xlabel=r"$\varphi$ (degrees)", ylabel=r"$s/s_c - 1$ ($10^{-5}$)")
    axes.set_title("The bracket")


def _draw_cusp(axes, barrier, classes, styles):
    """Draw how far the boundary is below the cusp at 45°, with a fit, on logarithmic axes."""
    (side,) = np.nonzero((barrier.angle.values < 45) & (barrier.angle.values > 25))
    cusp = barrier.critical_scale.sel(angle=[45.0], method="nearest").values
    below, away = cusp - barrier.critical_scale.values[side], 45 - barrier.angle.values[side]
    if not (below > 0).any():
        axes.set_axis_off()
        return
    style.draw_points(axes, away, below, classes[side], styles, 4, zorder=3)
    near = (below > 0) & (away <= 2)
    if near.sum() > 2:
        power, offset = np.polyfit(np.log(away[near]), np.log(below[near]), 1)
        line = np.exp(offset) * away**power
        label = rf"$\propto (45° - \varphi)^{{{power:.2f}}}$, fitted up to 2°"
        axes.plot(away, line, color="0.5", lw=1, label=label)
    axes.set(xscale="log", yscale="log", title="The cusp")
    axes.set(xlabel=r"$45° - \varphi$ (degrees)", ylabel="$s$ below the cusp")
    axes.grid(lw=0.3)
    if near.sum() > 2:
        style.legend_below(axes)


def _draw_circle_strip(axes, barrier, classes, styles, reflection):
    """Draw ω of the last circle at each angle, or its image `reflection` - ω if that is larger."""
    angle, omega = barrier.angle.values, barrier.omega.values
    omega = np.maximum(omega, reflection - omega) if reflection else omega
    style.draw_points(axes, angle, omega, classes, styles, 4)
    style.name_circles(axes, {text: options for text, options in styles.items() if text})
    style.mark_gaps(axes, angle, barrier.critical_scale.isnull().values)
    axes.set(xlabel=r"angle $\varphi$ of the ray (degrees)", xticks=np.arange(0, angle[-1] + 1, 45))
    image = rf", or ${reflection} - \omega$" if reflection else ""
    axes.set(ylabel=rf"$\omega$ of the last circle{image}", title="The last circle")
    axes.grid(lw=0.3)
