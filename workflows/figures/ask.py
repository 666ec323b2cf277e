"""The portrait of one forcing, with the evidence for the verdict, and the forcing in its plane.

For an aperiodic forcing, the kicks and the lifetimes of starts are drawn instead.
"""

import numpy as np

from workflows.figures import style
from workflows.figures.phase_space import draw_orbits, draw_survivor
from workflows.figures.planes import symbols
from workflows.figures.style import COLOURS, VERMILION, cell, dots

_ESCAPING, _BREAKUP = VERMILION, COLOURS[0]
_PLAIN = {"frameon": False, "fontsize": "small"}  # legend options


def draw_verdict(kappa, point, name, verdict, orbits, longest, escaping):
    """Draw a phase portrait with the evidence for the verdict, and the forcing in its plane.

    The evidence is the circle that is a barrier, or the longest-lived start and an escaping orbit.

    point : (Plane, the forcing's two coordinates in it), or None. name : the forcing as text.
    orbits : Dataset returned by `phase_space.portrait`.
    longest : (lifetime as text, x, y) of the longest-lived start, or None.
    escaping : (x, y) of an escaping orbit, or None.
    """
    bracket = verdict.boundary.lower, verdict.boundary.value, verdict.boundary.upper
    figure = style.canvas(11, 6.2, 2.2)
    if style.in_column():
        axes, time, where = figure.subplots(3, height_ratios=[1.8, 0.8, 1.2])
    else:
        places = [["plane", "time"], ["plane", "where"]]
        axes, time, where = figure.subplot_mosaic(places, width_ratios=[1.7, 1]).values()
    draw_orbits(axes, orbits)
    if verdict.circle is not None:
        omega = str(verdict.boundary.omega)
        options = style.circle_style(omega) | {"marker": "", "ls": "-", "lw": 1.8, "zorder": 3}
        x, y = (values[:: max(1, values.size // 4096)] for values in verdict.circle)
        x, y = (x % 1)[order := np.argsort(x % 1)], cell(y)[order]
        # Add a point at each end, so that the curve covers the whole period.
        x, y = np.r_[x[-1] - 1, x, x[0] + 1], np.r_[y[-1], y, y[0]]
        axes.plot(x, y, label=rf"certified circle, $\omega = {omega}$", **options)
    if longest is not None:
        lifetime, x, y = longest
        words = f"longest-lived start ({lifetime}): not a barrier"
        draw_survivor(axes, x % 1, cell(y), label=words)
    if escaping is None:
        for line, colour, words in ((0, COLOURS[0], "0"), (1, VERMILION, "1/2")):
            y, near = orbits.start_y[line::2], orbits.near[line::2]
            time.plot(y, near, ".", color=colour, label=f"starts at $x = {words}$")
        time.set(xlabel="$y$ of the start", ylabel=r"$\omega$, if regular", xlim=(0, 1))
        style.legend_below(time, 2, 2)
    else:
        x, y = escaping
        size = 1 + 12 / np.sqrt(x.size)  # a few small points would be hard to see
        axes.plot(x % 1, cell(y), **dots(_ESCAPING, size))
        axes.plot([], [], label="escaping orbit", **dots(_ESCAPING, 9))
        time.plot(y, color=_ESCAPING, lw=0.3, marker=".", ms=size, rasterized=True)
        time.set(xlabel="step $n$", ylabel="$y_n$ of the escaping orbit")
        time.xaxis.get_major_locator().set_params(integer=True)
    axes.set(xlim=(0, 1), ylim=(-0.25, 0.75), xlabel="$x$ (turns)", ylabel="$y$ (mod 1)")
    axes.set_aspect("equal")
    if axes.get_legend_handles_labels()[0]:
        tight = {"handletextpad": 0.2, "borderpad": 0.1}
        axes.legend(loc="lower right", bbox_to_anchor=(1.02, 1), **_PLAIN, **tight)
    if point and not any(point[0].origin):
        _locate(where, *point, bracket)
    else:
        n, breakup = np.arange(kappa.size), bracket[1] * kappa
        where.vlines(n, 0, kappa, color="black", lw=1)
        _mark(where, (n, kappa), (n, breakup), 6)
        where.set(xlabel="kick $n$", ylabel=r"$\kappa_n$")
        where.xaxis.get_major_locator().set_params(integer=True)
    if point:
        for axis, sign in zip(point[0].axes, symbols(point[0].axes), strict=True):
            name = name.replace(axis, sign)
    figure.suptitle(f"{name}: {verdict.answer.value}".replace("(-", "(−").replace(" -", " −"))
    return figure


def _locate(axes, plane, point, bracket):
    """Draw the forcing in the plane, the ray through it, and the breakup with its bracket."""
    lower, value, upper = ends = np.where(np.isfinite(bracket), bracket, np.nan)
    size = max(np.abs(point).max(), 1e-300)
    reach = 1.15 * size * np.nanmax([1.0, *ends])
    far = reach * np.array(point) / size
    axes.plot(*np.transpose([-far, far]), ":", color="0.5", lw=0.8)
    axes.plot(*np.outer(point, [lower, upper]), color=_BREAKUP, lw=3, solid_capstyle="butt")
    _mark(axes, point, value * np.array(point), 11)
    axes.axvline(0, color="0.8", lw=0.6, zorder=0)
    xlabel, ylabel = symbols(plane.axes)
    axes.set(xlabel=xlabel, ylabel=ylabel, aspect="equal")
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))


def _mark(axes, forcing, breakup, size):
    """Draw the forcing, and the breakup of the last circle on its ray if the breakup is known."""
    known = np.isfinite(breakup).all()
    words = "breakup of the last circle" if known else None
    axes.plot(*breakup, "o", color=_BREAKUP, mfc="none", ms=size, label=words)
    axes.plot(*forcing, "*", color="black", ms=9, label="this forcing")
    axes.axhline(0, color="0.8", lw=0.6, zorder=0)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1), **_PLAIN | {"fontsize": "x-small"})


def draw_once(kappa, survivor, y, lifetimes):
    """Draw the kicks, shading those that eliminate the longest-lived start; also draw lifetimes.

    survivor : `converse_kam.symmetry_line.LongestLived`. y, lifetimes : values for all starts on
    the line of `survivor`; the lifetime of a start that survives is inf.
    """
    figure, (kicks, line) = style.panels(1, 2, 11, 4)
    kicks.plot(np.arange(1, kappa.size + 1), kappa, ".-", color="0.6", ms=3, lw=0.5)
    here, reach = survivor.site + 1, min(survivor.kicks, kappa.size)
    kicks.axvspan(max(1, here - reach), min(kappa.size, here + reach), color="black", alpha=0.12)
    kicks.axvline(here, color=_ESCAPING, label=f"line of starts, before kick {here}")
    kicks.set(
        xlabel="kick", ylabel=r"$\kappa_n$", title="shaded: the kicks that eliminate all starts"
    )
    style.legend_below(kicks)
    alive = np.isinf(lifetimes)
    line.plot(y[~alive], lifetimes[~alive], ".", color=_BREAKUP, ms=3)
    top = np.full(alive.sum(), 1.5 * kappa.size)
    if alive.any():
        line.plot(y[alive], top, "^", color=_ESCAPING, ms=4, label="survives all kicks")
    if survivor.kicks < np.inf:
        line.plot(
            survivor.y, survivor.kicks, "*", color="black", ms=10, label="longest-lived start"
        )
    else:
        kicks.set_title("no line found on which all starts are eliminated")
    line.set(yscale="log", xlabel=f"$y$ of the start at $x = {survivor.x:g}$", xlim=(0, 1))
    line.set(ylabel="lifetime (kicks)")
    if line.get_legend_handles_labels()[0]:
        style.legend_below(line)
    return figure
