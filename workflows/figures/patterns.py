"""Draw the thresholds of kick pairs against their spacing, and of sign patterns and bursts."""

from fractions import Fraction

import numpy as np

from workflows.figures import style

CONSTANT, PAIRS, BURSTS = "constant kicks", "pairs of kicks", "bursts"
SIGNS, FLIPS = "one sign of P flipped", "flipped every M kicks"


def draw_patterns(cube):
    """Draw K_c for pairs against ε, and κ_c for sign patterns and bursts, as bracket midpoints."""
    figure, (spacing, others) = style.panels(1, 2, 12, 5)
    cube = cube.assign(middle=(cube.lower + cube.upper) / 2)
    golden = style.of_family(cube, CONSTANT).critical_scale.item()
    _draw_pairs(spacing, style.of_family(cube, PAIRS), golden)
    _draw_others(others, cube)
    for axes in (spacing, others):
        axes.axhline(golden, color="0.4", lw=1, ls=":", label=r"$\kappa_G$ for constant kicks")
        style.legend_below(axes, 2)
    return figure


def _draw_pairs(axes, pairs, golden):
    ε, K = pairs.parameter.values, (pairs.middle * pairs.period).values
    fractions = [Fraction(x).limit_denominator(100) for x in ε]
    line, limit = (
        np.geomspace(1 / 80, 0.5, 2),
        r"$\sqrt{\kappa_G/\varepsilon}$, limit $\varepsilon \to 0$",
    )
    axes.plot(line, np.sqrt(golden / line), color="0.4", lw=1, label=limit)
    kinds = [2 if f.numerator > 1 else f.denominator % 2 for f in fractions]
    for kind, label in enumerate(("1/P$, $P$ even", "1/P$, $P$ odd", "p/P$")):
        of_kind, colour = np.equal(kinds, kind), style.colour_of((0, 4, 2)[kind])
        options = {"color": colour, "ms": 4.5, "label": rf"$\varepsilon = {label}"}
        if of_kind.any():
            axes.plot(ε[of_kind], K[of_kind], "osD"[kind], **options)
    axes.set(xscale="log", yscale="log", xlim=(1 / 80, 0.62), title="Pairs of kicks")
    axes.set(xlabel=r"spacing $\varepsilon$ of a pair (periods)", ylabel=r"$K_c$")
    axes.margins(y=0.08)
    _ticks(axes.yaxis, [1, 2, 3, 4, 6, 8])
    _ticks(axes.xaxis, [1 / 2**n for n in range(1, 7)], [f"1/{2**n}" for n in range(1, 7)])


def _draw_others(axes, cube):
    bursts = style.of_family(cube, BURSTS).sortby("period")
    kicked = bursts.groupby((bursts.parameter * bursts.period).round().astype(int).rename("n"))
    labels = {SIGNS: "one of $P$ signs flipped", FLIPS: "flipped every $M = P/2$ kicks"}
    lines = [(labels[family], style.of_family(cube, family)) for family in labels]
    lines += [(f"bursts of {n} kicks", bursts_of_n) for n, bursts_of_n in kicked]
    for i, (label, family_cube) in enumerate(lines):
        options = {"marker": "os^vD*P"[i % 7], "ms": 5, "lw": 1, **style.line_of(i)}
        axes.plot(family_cube.period, family_cube.middle, label=label, **options)
    axes.set(yscale="log", xlabel="kick slots per period, $P$")
    axes.set_ylabel(r"$\kappa_c$")
    _ticks(axes.yaxis, [0.1, 0.2, 0.5, 1])
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_title("Signs and bursts")


def _ticks(axis, values, labels=None):
    axis.set_ticks(values, labels or values)
    axis.set_ticks([], minor=True)
