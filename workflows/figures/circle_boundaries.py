"""The boundaries CB_ω of circles, and their cusps (Figs. 8 and 9)."""

import numpy as np
from matplotlib.lines import Line2D

from workflows.figures import planes, style


def draw_circle_boundaries(breakdown, barrier):
    """Draw CB_ω for each rotation number, with CB_gt behind these curves (Fig. 8)."""
    figure, (axes,) = style.panels(1, 1, 10, 6.6)
    planes.fill_inside(axes, barrier, label=r"$\mathit{CB}_{gt}$")
    draw_circles(axes, breakdown)
    planes.label_plane(axes, barrier)
    axes.set_title(r"Breakup of individual circles, $\mathit{CB}_\omega$, and of the last one")
    style.outer_legend(figure, 3, 2)
    return figure


def circle_boundaries_caption(breakdown, residues, barrier):
    """Compare CB_ω with CB_gt.

    breakdown : the result of continuation, or `residues` again if the rays do not start at zero.
    """
    scales = ["critical_scale", "error"]  # taken from `residues` where known, else from `breakdown`
    best = residues[scales].load().fillna(style.known(breakdown)[scales].load())
    ratio = 100 * best.critical_scale / barrier.critical_scale
    beyond = best.critical_scale - best.error > barrier.critical_scale + barrier.error
    shares = ", ".join(
        f"{text}: {float(of.min()):.1f} to {float(of.max()):.1f}%"
        if of.notnull().any()
        else f"{text}: no ray"
        for text, of in zip(residues.circle.values, ratio, strict=True)
    )
    return (
        f"{describe_circles(breakdown)} Grey: the region without global transport. Distance from "
        f"the origin to CB_ω, relative to the distance to CB_gt: {shares}. Points of CB_ω that lie "
        f"beyond CB_gt by more than the errors: {int(beyond.sum())} of {beyond.size}."
    )


def describe_circles(circles):
    """Describe how many points each method contributes, and the largest error drawn."""
    drawn, settings = style.known(circles.load()), circles.attrs
    residue = f"Greene's residue with periods up to {settings['q_max']}"
    by = {"residue": residue}
    if "tol" in settings:
        continuation = f"continuation to an error of {settings['tol']:g}"
        residue += ", where continuation does not reach this error"
        by = {"continuation": continuation, "residue": residue}
    counts = {word: int(style.has_flag(drawn.method, word).sum()) for word in by}
    methods = " and ".join(f"{counts[word]} points by {by[word]}" for word in by if counts[word])
    worst = 100 * float((drawn.error / drawn.critical_scale).max())
    error = f"The largest error drawn is {worst:.1g}% of the scale. " if methods else ""
    return (
        f"CB_ω of {circles.circle.size} circles on {circles.angle.size} rays: "
        f"{methods or 'no answer'}. {error}Points omitted (no answer, or an error above 2%): "
        f"{int(drawn.critical_scale.isnull().sum())} of {circles.status.size}."
    )


def draw_tips(residues, circles, barrier):
    """Draw the cusps at 45° and 135° (Fig. 9): residues as lines, continuation as points.

    A × marks each ray on which a method has no answer for some circle.
    """
    figure, tips = style.panels(1, 2, 11, 6.2)
    silent = circles.critical_scale.isnull() | residues.critical_scale.isnull()
    gaps = barrier.sel(angle=circles.angle[silent.any("circle").values], method="nearest")
    points = style.known(circles.where(style.has_flag(circles.method, "continuation")))
    looks = _looks(points.circle.values, 1)
    for axes, sign in zip(tips, (-1, 1), strict=True):
        planes.fill_inside(axes, barrier)
        draw_circles(axes, residues)
        for i, look in enumerate(looks):
            axes.plot(points.kappa1[i], points.kappa2[i], **look | {"ls": "", "ms": 3})
        axes.plot(gaps.kappa1, gaps.kappa2, "x", color="black", ms=5)
        ends = sorted((sign * 0.7, sign * 1.0))
        axes.set(xlim=ends, ylim=(0.7, 1.0), aspect="equal")
        axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$")
        ticks = np.linspace(0.75, 0.95, 3 if style.in_column() else 5).round(2)
        axes.set(xticks=sign * ticks, yticks=ticks)
    marks = [
        Line2D([], [], ms=4, label=style.omega_label(text), **look)
        for text, look in zip(points.circle.values, looks, strict=True)
    ]
    if gaps.angle.size:
        marks.append(Line2D([], [], ls="", marker="x", color="black", label="no answer"))
    style.outer_legend(figure, 4, 2, handles=marks)
    figure.suptitle("The cusps: lines by Greene's residue, points by continuation of circles")
    return figure


def tips_caption(residues, circles):
    """Compare the two methods where both have an answer."""
    continued = circles.where(style.has_flag(circles.method, "continuation")).critical_scale
    off = abs(continued / residues.critical_scale - 1)
    return (
        "The cusps: lines by Greene's residue with periods up to "
        f"{residues.attrs['q_max']}, points by continuation to an error of "
        f"{circles.attrs['tol']:g}, which is reached for {int(continued.notnull().sum())} of "
        f"{circles.status.size} pairs of a ray and a circle. Relative difference of the two "
        f"methods: median {float(off.median()):.1g}, maximum {float(off.max()):.1g}. Residues "
        f"give no answer for {int(residues.critical_scale.isnull().sum())} pairs."
    )


def draw_circles(axes, breakdown, **more):
    """Draw CB_ω of each circle around the plane, where the scale is known to 2%."""
    (x, y), reflection = planes.outline(style.known(breakdown)), planes.whole_of(breakdown)
    circles = breakdown.circle.values
    for i, (text, look) in enumerate(zip(circles, _looks(circles, reflection), strict=True)):
        options = look | {"marker": "", "lw": 1.3} | more
        axes.plot(x[i], y[i], label=style.omega_label(text), **options)


def _looks(circles, reflection):
    """Return the style of each circle's class, or one style per circle if two share a class."""
    classes = [style.circle_class(text, reflection) for text in circles]
    if len({*classes}) < len(classes):
        reflection, classes = 0, [style.circle_class(text, 0) for text in circles]
    styles = style.circle_styles(classes, reflection)
    return [styles[text] for text in classes]
