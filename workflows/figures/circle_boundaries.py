"""CB_ω of each circle, and their tips, Figs. 8 and 9."""

import numpy as np

from workflows.figures import planes, style


def draw_circle_boundaries(breakdown, barrier):
    """Draw CB_ω of each rotation number, CB_gt behind them, Fig. 8."""
    figure, (axes,) = style.panels(1, 1, 10, 6.6)
    sharp = style.known(breakdown)
    planes.fill_inside(axes, barrier, label=r"$\mathit{CB}_{gt}$")
    draw_circles(axes, sharp)
    planes.label_plane(axes, barrier)
    if planes.of_two_kicks(barrier) and not style.in_column():
        draw_circles(planes.tip_of(axes, barrier, 0.8), sharp)
    axes.set_title(r"Breakup of circles: $\mathit{CB}_\omega$, and of the last one")
    style.outer_legend(figure, 3, 2)
    return figure


def circle_boundaries_caption(breakdown, residues, barrier):
    """Compare CB_ω with CB_gt.

    breakdown : by continuation; `residues` themselves in a plane where that has no rays from zero.
    """
    effort = "periods up to {q_max}" if breakdown is residues else "errors of {tol:g}"
    sharp = style.known(breakdown)
    scales = ["critical_scale", "error"]  # by residues, where there are any
    best = residues[scales].load().fillna(sharp[scales].load())
    ratio = 100 * best.critical_scale / barrier.critical_scale
    beyond = best.critical_scale - best.error > barrier.critical_scale + barrier.error
    shares = ", ".join(
        f"{text}: {float(of.min()):.1f} to {float(of.max()):.1f}%"
        if of.notnull().any()
        else f"{text}: on no ray"
        for text, of in zip(residues.circle.values, ratio, strict=True)
    )
    how = f"{breakdown.attrs['method']}, {effort.format(**breakdown.attrs)}"
    return (
        f"Critical boundaries of circles on {breakdown.angle.size} rays by {how}, in front of the "
        "region without global transport. Their distance from the origin relative to that of the "
        f"last barrier: {shares}. Points beyond the last barrier by more than the errors: "
        f"{int(beyond.sum())} of {beyond.size}. Gaps: "
        f"{int(sharp.critical_scale.isnull().sum())} points without an answer to 2%."
    )


def draw_tips(residues, circles, barrier):
    """Draw the tips at 45° and 135°, Fig. 9: residues as lines, circles as points, gaps as ×."""
    figure, tips = style.panels(1, 2, 11, 6.8)
    silent = circles.critical_scale.isnull() | residues.critical_scale.isnull()
    gaps = barrier.sel(angle=circles.angle[silent.any("circle").values], method="nearest")
    lines, points = style.known(residues), style.known(circles)
    for axes, sign in zip(tips, (-1, 1), strict=True):
        planes.fill_inside(axes, barrier)
        draw_circles(axes, lines)
        for i, text in enumerate(points.circle.values):
            look = style.circle_style(text, 1) | {"ls": "", "ms": 3}
            axes.plot(points.kappa1[i], points.kappa2[i], **look)
        axes.plot(gaps.kappa1, gaps.kappa2, "x", color="black", ms=5, label="no answer on this ray")
        ends = sorted((sign * 0.7, sign * 1.0))
        axes.set(xlim=ends, ylim=(0.7, 1.0), aspect="equal")
        axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$")
        axes.set_xticks(sign * np.linspace(0.75, 0.95, 3 if style.in_column() else 5).round(2))
    handles, labels = tips[1].get_legend_handles_labels()
    style.outer_legend(figure, 4, 2, handles=handles, labels=labels)
    figure.suptitle("The tips: lines by Greene's residue, points by continuation of circles")
    return figure


def tips_caption(residues, circles):
    off = abs(circles.critical_scale / residues.critical_scale - 1)
    unanswered = sum(int(of.critical_scale.isnull().sum()) for of in (circles, residues))
    return (
        "The cusps: lines by Greene's residue of periods up to "
        f"{residues.attrs['q_max']}, points by continuation to {circles.attrs['tol']:g}. Relative "
        f"difference of the two: median {float(off.median()):.1g}, largest {float(off.max()):.1g}; "
        f"{unanswered} of {2 * circles.status.size} have no answer."
    )


def draw_circles(axes, breakdown, **more):
    """Draw the curves of each ω around the plane."""
    (x, y), whole = planes.outline(breakdown), planes.whole_of(breakdown)
    for i, text in enumerate(breakdown.circle.values):
        look = style.circle_style(text, whole) | {"marker": "", "lw": 1.3} | more
        axes.plot(x[i], y[i], label=style.omega_label(text), **look)
