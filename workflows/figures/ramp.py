"""Figure of the number of kicks until graphs are excluded, and until orbits cross all circles."""

import re

import numpy as np

from workflows.figures.style import colour_of, key, legend_below, panels


def draw_ramp(ramp, irregular):
    """Draw the number of kicks until graphs are excluded, and until orbits cross all circles.

    The first panel shows these numbers against the growth rate, the second against the smoothness.
    """
    figure, (kicks, smooth) = panels(1, 2, 13, 5)
    rows = {
        "all invariant graphs excluded (converse KAM)": ramp.lost,
        "first of 64 orbits crosses": ramp.escaped,
    }
    for i, (label, row) in enumerate(rows.items()):
        exponent, dash = ramp.attrs["exponents"][i], ("--", ":")[i]
        kicks.plot(ramp.rate, row, "o^"[i], color=colour_of(2 * i), ms=4, label=label)
        law = float((row * ramp.rate**exponent).median()) * ramp.rate**-exponent
        label = rf"$\propto r^{{-{exponent:.3f}}}$, predicted"
        kicks.plot(ramp.rate, law, dash, color="0.4", lw=0.9, label=label)
    kicks.set(xscale="log", yscale="log", title="Kicks growing through the breakup")
    kicks.set(xlabel=r"growth $r$ of $\kappa$ per kick", ylabel=r"kicks after $\kappa_G$")
    legend_below(kicks, 2, 1)
    _draw_lifetimes(smooth, irregular)
    return figure


def ramp_caption(irregular, findings):
    return (
        "(a) Ramp κ_n = κ_G + r·n: number n of kicks until converse KAM excludes every family of "
        "invariant graphs (on the line of starts where this happens first), and until one of 64 "
        "orbits has crossed all circles. (b) The same numbers for κ_n = 0.3·(1 + ripple·f_n), with "
        "the forcings f_n named below the axis. Filled "
        f"symbols: graphs are excluded; runs end after {irregular.attrs['kicks'] // 2} kicks. "
        "Hollow symbols: an orbit crosses; runs end after "
        f"{20 * irregular.attrs['kicks']} kicks. Triangles are lower bounds: by the end of the "
        "run, graphs were not excluded, or no orbit had crossed. The exclusion relies on a search "
        "and does not cover curves that fold; an orbit that crosses excludes both graphs and "
        f"folded curves.\n{findings}"
    )


def _draw_lifetimes(axes, irregular):
    names, kicks = irregular.kind.values, irregular.attrs["kicks"]
    for i, ripple in enumerate(irregular.ripple.values):
        x, row = np.arange(len(names)) + 0.12 * i - 0.24, irregular.sel(ripple=ripple)
        for values, end, fill in ((row.life, kicks / 2, None), (row.escaped, 20 * kicks, "none")):
            persists = np.isinf(values.values)
            for selected, mark in ((~persists, "o"), (persists, "^")):
                y = np.minimum(values, end)[selected]
                axes.plot(x[selected], y, mark, ms=4.5, mfc=fill, color=colour_of(i))
        axes.plot([], [], "o", ms=4.5, color=colour_of(i), label=f"ripple {ripple:g}")
    key(axes, {"o": "all graphs excluded"})
    key(axes, {"o": "an orbit crosses", "^": "triangles: not by the end of the run"}, "o^")
    axes.set(yscale="log", ylabel="kicks", title="Smooth forcings keep barriers")
    labels = [re.sub(r"k\^(-\d)", r"$f_k\\sim k^{\1}$", name) for name in names]
    axes.set_xticks(range(len(names)), labels, rotation=40, ha="right")
    axes.grid(lw=0.3, axis="y")
    legend_below(axes, 3, 2)
