"""Snapshot tori in ramps of κ: mean distances, exponents, and when graphs are excluded."""

import numpy as np

from workflows.figures.style import VERMILION, colour_of, legend_below, panels

_GOLDEN, _COLOURS = VERMILION, {1: colour_of(0), 0: colour_of(1)}  # keys: values of `winds`
_KINDS = {1: "torus around the cylinder", 0: "torus in islands"}
_EVENTS = {  # marker, whether it is filled, label
    "excluded": ("v", True, "graphs through the torus excluded"),
    "exceeds": ("o", False, "EAPD exceeds the bound"),
    "onset": ("o", True, "onset of EAPD growth"),
    "stretched": ("s", False, r"half of the orbits stretched by $n^2$"),
}


def draw_snapshot_tori(cube):
    """Draw EAPD and exponents in one ramp, the events of its tori, and delays in all ramps."""
    figure, (distances, exponents, events, delays) = panels(2, 2, 12, 10.5)
    _draw_distances(distances, cube)
    _draw_exponents(exponents, cube)
    _draw_events(events, cube)
    _draw_delays(delays, cube)
    return figure


def snapshot_tori_caption(cube, findings):
    return (
        f"Snapshot tori in ramps that begin at κ = {float(cube.strength[0]):g} and rise by r per "
        "kick. (a) EAPD (ensemble-averaged pairwise distance, as a logarithm) of each torus for "
        f"r = {cube.attrs['kept_rate']:g}, and its bound for graphs; vertical line: "
        "converse KAM excludes all graphs. (b) Finite-time exponents on two of these tori: median, "
        "and the central 80% of the orbits. (c) κ at which four events occur on each torus of (a): "
        "all graphs through one of its points are excluded; its EAPD exceeds the bound; mean "
        f"distances exceed the bound by a factor of {cube.attrs['factor']:g} from then on; and "
        "half of its orbits are stretched by more than n². Horizontal line: all graphs are "
        "excluded. "
        "(d) Kicks from the first of these events to the second, for all tori that wind around "
        "the cylinder; red: the golden circle."
        f"\n{findings}"
    )


def _draw_distances(axes, cube):
    for winds, label in _KINDS.items():
        rows = cube.distance[cube.winds == winds]
        axes.plot(cube.kick, rows.T, color=_COLOURS[winds], lw=0.7)
        axes.plot([], [], color=_COLOURS[winds], label=label)
    axes.plot(cube.kick, cube.distance[0], color=_GOLDEN, lw=1.8, label="golden circle")
    axes.plot(cube.kick, cube.bound, "--", color="black", lw=1.2, label="bound for graphs")
    _mark_exclusion(axes, cube)
    axes.set(ylabel=r"EAPD $\rho_n$", ylim=(-1.5, 10))
    axes.set(title=f"Mean distances, $r = {cube.attrs['kept_rate']:g}$")
    legend_below(axes, 3, 1)


def _draw_exponents(axes, cube):
    n = cube.kick[1:] - cube.kick[0]
    drawn = [0, *cube.start[cube.winds == 0].values[-1:]]
    for start, colour in zip(drawn, (_GOLDEN, _COLOURS[0]), strict=False):
        row = cube.sel(start=start)
        lower, median, upper = row.exponent[:, 1:]
        axes.fill_between(n + cube.kick[0], lower, upper, color=colour, alpha=0.25, lw=0)
        label = "golden circle" if start == 0 else rf"islands, $\omega = {float(row.omega):.3g}$"
        axes.plot(n + cube.kick[0], median, color=colour, label=label)
    axes.plot(n + cube.kick[0], np.log(n) / n, ":", color="black", label=r"shear, $(\ln n)/n$")
    _mark_exclusion(axes, cube)
    axes.set(
        ylabel=r"exponent $\lambda_n$ per kick", ylim=(0, 1.2 * cube.exponent[:, drawn, -1].max())
    )
    axes.set(title="Finite-time exponents, same ramp")
    legend_below(axes, 3, 1)


def _mark_exclusion(axes, cube):
    lost = cube.lost.sel(rate=cube.attrs["kept_rate"])
    axes.axvline(lost, color="0.4", ls="-.", lw=1, label="all graphs excluded")
    axes.set(xlabel=r"kicks after $\kappa_G$", xlim=(cube.kick[0], cube.kick[-1]))


def _draw_events(axes, cube):
    rate, last = cube.attrs["kept_rate"], cube.attrs["last"]
    row = cube.sel(rate=rate)
    for name, (marker, filled, label) in _EVENTS.items():
        kappa = _strength(cube, row[name])
        style = {"ls": "", "marker": marker, "ms": 5}
        for start, colour in enumerate(_colours(cube)):
            face = colour if filled else "none"
            axes.plot(row.y[start], kappa[start], color=colour, mfc=face, **style)
        axes.plot([], [], color="0.4", mfc="0.4" if filled else "none", label=label, **style)
    silent = row.y[np.isinf(row.onset)]
    axes.plot(silent, np.full(silent.size, last), "^", color="0.4", ms=5, label="no onset")
    axes.axhline(_strength(cube, row.lost), color="0.4", ls="-.", lw=1)
    axes.set(xlabel=r"$y$ of the torus at $x = 1/2$", ylabel=r"$\kappa$ of the event")
    axes.set(xlim=(0, 0.5), title="Events of each torus, same ramp")
    legend_below(axes, 3, 1)


def _draw_delays(axes, cube):
    winding = cube.sel(start=cube.start[cube.winds == 1])
    delay, early = winding.exceeds - winding.excluded, winding.onset < winding.lost
    for row, before, colour in zip(delay, early, _colours(winding), strict=True):
        axes.plot(row.rate, row, color=colour, lw=0.5)
        for chosen, face in ((before, colour), (~before, "none")):
            axes.plot(row.rate[chosen], row[chosen], "o", color=colour, mfc=face, ms=5)
    for face, label in (("0.4", "onset before all graphs are excluded"), ("none", "onset later")):
        axes.plot([], [], "o", color="0.4", mfc=face, ms=5, label=label)
    axes.set(xscale="log", yscale="log", title="Delay of the EAPD, all ramps")
    xlabel, ylabel = r"growth $r$ of $\kappa$ per kick", "kicks from exclusion until EAPD > bound"
    axes.set(xlabel=xlabel, ylabel=ylabel)
    legend_below(axes, 2, 1)


def _strength(cube, kicks):
    """Return κ from the number of kicks after κ_G, in the ramp of (a) to (c); NaN for inf."""
    kappa = cube.attrs["critical_scale"] + cube.attrs["kept_rate"] * kicks
    return kappa.where(np.isfinite(kappa))


def _colours(cube):
    return [_GOLDEN, *(_COLOURS[int(winds)] for winds in cube.winds[1:])]
