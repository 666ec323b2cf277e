"""When invariant graphs are excluded and orbits cross: in a ramp, and by smoothness."""

import re

import numpy as np

from workflows.figures.style import colour_of, key, legend_below, panels


def draw_ramp(ramp, lives):
    """Draw when graphs are excluded and orbits cross, by rate and smoothness."""
    figure, (kicks, smooth) = panels(1, 2, 13, 5)
    rows = {
        "all invariant graphs excluded (converse KAM)": ramp.lost,
        "first of 64 orbits crosses": ramp.escaped,
    }
    for i, (label, row) in enumerate(rows.items()):
        exponent, dash = ramp.attrs["exponents"][i], ("--", ":")[i]
        kicks.plot(ramp.rate, row, "o^"[i], color=colour_of(2 * i), ms=4, label=label)
        law = float((row * ramp.rate**exponent).median()) * ramp.rate**-exponent
        words = rf"$\propto r^{{-{exponent:.3f}}}$, predicted"
        kicks.plot(ramp.rate, law, dash, color="0.4", lw=0.9, label=words)
    kicks.set(xscale="log", yscale="log", title="Kicks growing through the breakup")
    kicks.set(xlabel=r"growth $r$ of $\kappa$ per kick", ylabel=r"kicks after $\kappa_G$")
    legend_below(kicks, 2, 1)
    _draw_lives(smooth, lives)
    return figure


def ramp_caption(lives, findings):
    return (
        "(a) Ramp κ_n = κ_G + r·n: kicks after κ_G until converse KAM excludes every family of "
        "invariant graphs (on the line of starts where this happens first), and until one of 64 "
        "orbits has crossed all circles. (b) The same for κ_n = 0.3·(1 + ripple·f_n): filled, "
        f"graphs, within {lives.attrs['kicks'] // 2} kicks; hollow, orbits, within "
        f"{20 * lives.attrs['kicks']}. Triangles are lower bounds: graphs not excluded, or no "
        "orbit across, at the end of the run. The exclusion relies on a search, and does not cover "
        f"curves that fold; an orbit that crosses excludes both.\n{findings}"
    )


def _draw_lives(axes, lives):
    names, kicks = lives.kind.values, lives.attrs["kicks"]
    for i, ripple in enumerate(lives.ripple.values):
        x, here = np.arange(len(names)) + 0.12 * i - 0.24, lives.sel(ripple=ripple)
        for values, end, fill in ((here.life, kicks / 2, None), (here.escaped, 20 * kicks, "none")):
            lasts = np.isinf(values.values)
            for there, mark in ((~lasts, "o"), (lasts, "^")):
                y = np.minimum(values, end)[there]
                axes.plot(x[there], y, mark, ms=4.5, mfc=fill, color=colour_of(i))
        axes.plot([], [], "o", ms=4.5, color=colour_of(i), label=f"ripple {ripple:g}")
    key(axes, {"o": "all graphs excluded"})
    key(axes, {"o": "an orbit crosses", "^": "triangles: not by the end of the run"}, "o^")
    axes.set(yscale="log", ylabel="kicks", title="Smooth forcings keep barriers")
    words = [re.sub(r"k\^(-\d)", r"$f_k\\sim k^{\1}$", name) for name in names]
    axes.set_xticks(range(len(names)), words, rotation=40, ha="right")
    axes.grid(lw=0.3, axis="y")
    legend_below(axes, 3, 2)
