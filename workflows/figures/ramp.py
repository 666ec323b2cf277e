"""When families of graphs are lost: in a ramp through the breakup, and by smoothness."""

import re

import numpy as np

from workflows.figures.style import colour_of, names_of, panels


def draw_ramp(ramp, lives, exponent, findings):
    """Draw the kick by which graphs are lost against the rate, and their lives by smoothness.

    ramp, lives : Datasets of the study. exponent : foreseen. findings : text, for the caption.
    """
    figure, (plain, scaled, smooth) = panels(1, 3, 15, 5)
    rate = ramp.rate.values
    for way, (name, mark) in enumerate(zip(names_of(ramp.way), "os", strict=True)):
        lost, look = ramp.lost.isel(way=way), {"marker": mark, "ms": 4, "color": colour_of(way)}
        plain.plot(rate, lost, ls="", label=name, **look)
        scaled.plot(rate, lost * rate**exponent, lw=0.8, label=name, **look)
    level = float((ramp.lost * ramp.rate**exponent).isel(way=1).median())
    law = {"color": "0.5", "lw": 0.9, "ls": "--"}
    plain.plot(rate, level * rate**-exponent, **law, label=rf"$\propto r^{{-{exponent:.3f}}}$")
    scaled.axhline(level, **law)
    plain.set(yscale="log", ylabel=r"kicks after $\kappa_G$", title="No graph is left")
    scaled.set(ylim=(0, None), ylabel=rf"the same, times $r^{{{exponent:.3f}}}$")
    scaled.set_title("Renormalisation foresees a constant")
    for axes in (plain, scaled):
        axes.set(xscale="log", xlabel=r"growth $r$ of $\kappa$ per kick")
        axes.legend(fontsize="small")
        axes.grid(lw=0.3)
    _draw_lives(smooth, lives)
    return figure, (
        f"Kicks κ_G + r·n: the kick after κ_G by which converse KAM denies every family of graphs, "
        f"by the line that does so first. Following the golden circle, whose area falls by "
        f"{-ramp.attrs['area_rate']:.4f} per unit of κ, the phases are accelerated. (c) Kicks "
        f"0.3·(1 + ripple·f_n), {lives.attrs['kicks']} of them; ▲: graphs last through all. Denied "
        "are graphs, as far as searches see; curves that fold are not, and escapes were not tried."
        f"\n{findings}"
    )


def _draw_lives(axes, lives):
    names, top = names_of(lives.kind), lives.attrs["kicks"] / 2
    for i, ripple in enumerate(lives.ripple.values):
        life, x = lives.life.sel(ripple=ripple).values, np.arange(len(names)) + 0.1 * (i - 2)
        lasts, look = np.isinf(life), {"ls": "", "ms": 5, "color": colour_of(i)}
        axes.plot(x[~lasts], life[~lasts], marker="o", label=f"ripple {ripple:g}", **look)
        axes.plot(x[lasts], np.full(lasts.sum(), top), marker="^", **look)
    axes.set(yscale="log", ylabel="life of graphs (kicks)", title="Smooth forcings keep them")
    words = [re.sub(r"k\^(-\d)", r"$f_k\\sim k^{\1}$", name) for name in names]
    axes.set_xticks(range(len(names)), words, rotation=40, ha="right")
    axes.legend(fontsize="small", loc="lower left")
    axes.grid(lw=0.3, axis="y")
