"""Figure of the last barrier in rotating maps against their frequency, rational or irrational."""

from fractions import Fraction

import numpy as np

from workflows.figures.style import colour_of, outer_legend, panels

_NUMBER = {"fontsize": "x-small", "ha": "center"}
_BRACKET = {"fmt": "_", "color": colour_of(0), "lw": 2, "ms": 6, "mew": 2}  # visible even if narrow
_BEYOND = 1.15  # upper end of the axis, relative to the top of the highest bracket


def draw_frequencies(cube):
    """Draw the scale of the last breakup against Ω, and the brackets of convergents."""
    limits, fractions = _brackets(cube)
    figure, (wide, near) = panels(1, 2, 12, 5.4, sharey=True)
    of, words = r"$\Omega = p/q$, ", "bracket for the phase with the smallest scale"
    look = {"color": "0.8", "lw": 6, "label": rf"{of}all phases $\varphi_0$"}
    wide.vlines(fractions.index, fractions.lower, fractions.most, **look)
    half = (fractions.upper - fractions.lower) / 2
    wide.errorbar(fractions.index, fractions.lower + half, half, label=f"{of}{words}", **_BRACKET)
    words = r"irrational $\Omega$: bracket up to the converse KAM bound"
    wide.vlines(limits.index, limits.lower, limits.upper, color=colour_of(1), lw=2, label=words)
    look = {
        "color": colour_of(1),
        "ms": 5,
        "ls": "",
        "label": r"irrational $\Omega$: last certified torus",
    }
    wide.plot(limits.index, limits.lower, marker="^", **look)
    wide.set_title(r"Last barrier for rational and irrational $\Omega$")
    wide.set(xlabel=r"frequency $\Omega$", ylabel="scale $s$ of the last breakup")
    outer_legend(figure, 2)
    _draw_convergents(near, limits, fractions)
    # The axis ends above all brackets; where `most` is beyond its end, a label gives the value.
    top = _BEYOND * np.fmax(limits.upper.max(), fractions.upper.max())
    for Ω, most in fractions.most[fractions.most > top].items():
        side, x = ("left", 5) if np.mean(wide.get_xlim()) > Ω else ("right", -5)
        how = {"textcoords": "offset points", "va": "top", "ha": side, "fontsize": "small"}
        wide.annotate(f"↑ {most:.2f}", (Ω, top), (x, -3), **how)
    wide.set_ylim(None, top)
    return figure


def _brackets(cube):
    """Return the brackets of the irrational Ω and of the fractions, as two tables indexed by Ω.

    lower, upper : smallest lower end and smallest upper end over all phases.
    most : largest upper end.
    """
    ends = {"lower": ("lower", "min"), "upper": ("upper", "min"), "most": ("upper", "max")}
    table = cube.to_dataframe().groupby("frequency").agg(**ends, phases=("phase", "count"))
    return table[table.phases == 0], table[table.phases > 0]  # NaN phases are not counted


def frequencies_caption(cube):
    limits, fractions = _brackets(cube)
    widths = (100 * (1 - cube.lower / cube.upper)).groupby(cube.phase.isnull()).median().to_series()
    names = {False: "fractions", True: "irrational Ω"}
    medians = ", ".join(f"{width:.2g}% for {names[kind]}" for kind, width in widths.items())
    return (
        "Breakup of the last barrier in rotating maps on the ray (κ̄, Δκ) = s·(cos θ, sin θ), "
        f"θ = {float(cube.angle):g}°: the last circle for {len(fractions)} fractions Ω with "
        f"{fractions.phases.max()} phases each, and the last torus for {len(limits)} irrational Ω. "
        "Brackets extend from the last certified circle or torus to the scale at which converse "
        f"KAM excludes all circles or tori. The median width of the brackets is {medians}; "
        f"{int((cube.lower + cube.upper).isnull().sum())} are missing. "
        f"{_comparison(limits, fractions)}"
    )


def _convergents(limits, fractions):
    """Yield each irrational Ω with known convergents, its bracket, and a table of the convergents.

    The table has the columns of `fractions`, and is indexed by the denominator q.
    """
    for Ω, lower, upper, *_ in limits.itertuples():
        convergents = {Fraction(Ω).limit_denominator(q) for q in range(2, 65)}
        by_q = sorted((each.denominator, float(each)) for each in convergents)
        known = {q: at for q, at in by_q if at in fractions.index}
        if known:
            yield Ω, lower, upper, fractions.loc[[*known.values()]].set_axis([*known])


def _draw_convergents(axes, limits, fractions):
    """Draw the lowest bracket of each convergent beside the bracket of its limit."""
    ticks = []
    for i, (Ω, lower, upper, near) in enumerate(_convergents(limits, fractions)):
        ticks.append(f"{Ω:.4f}")
        axes.fill_between([i - 0.4, i + 0.4], lower, upper, color=colour_of(1), alpha=0.5, lw=0)
        places = np.linspace(-0.3, 0.3, len(near) + 2)[1:-1]
        for (q, least, first, *_), x in zip(near.itertuples(), places, strict=True):
            axes.errorbar(i + x, (least + first) / 2, (first - least) / 2, **_BRACKET)
            axes.annotate(q, (i + x, first), (0, 4), textcoords="offset points", **_NUMBER)
    axes.set(xlabel=r"irrational $\Omega$", xlim=(-0.5, max(4, len(ticks)) - 0.5))
    axes.set_title("Brackets of the convergents, labelled by $q$")
    axes.set_xticks(range(len(ticks)), ticks, rotation=60, fontsize="small")


def _comparison(limits, fractions):
    """Describe how the brackets of the convergents compare with the brackets of their limits."""
    overlap, inside, outside = [], [], []  # denominators q of convergents
    for _, lower, upper, near in _convergents(limits, fractions):
        for q, least, first, *_ in near.itertuples():
            overlap += [q] if least < upper and lower < first else []
            inside += [q] if first <= lower else []
            outside += [q] if least >= upper else []
    apart = inside + outside
    longest = f"; the largest q without overlap is {max(apart)}" if apart else ""
    return (
        "Each convergent Ω is compared with its limit at the phase with the smallest scale: of "
        f"{len(overlap + apart)} brackets, {len(overlap)} overlap the bracket of the limit, "
        f"{len(inside)} lie below it, and {len(outside)} above{longest}."
    )
