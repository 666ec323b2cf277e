"""The last barrier of rotating maps against the frequency, fractions and irrational numbers."""

from fractions import Fraction

import numpy as np

from workflows.figures.style import colour_of, outer_legend, panels

_NUMBER = {"fontsize": "xx-small", "ha": "center"}
_BRACKET = {"fmt": "_", "color": colour_of(0), "lw": 2, "ms": 6, "mew": 2}  # some are narrow
_BEYOND = 1.15  # times the largest end of a bracket: what is drawn


def draw_frequencies(cube):
    """Draw the scale of the last breakup against Ω, and the least one of convergents by their q."""
    ends = {"lower": ("lower", "min"), "upper": ("upper", "min"), "most": ("upper", "max")}
    table = cube.to_dataframe().groupby("frequency").agg(**ends, phases=("phase", "count"))
    limits, fractions = table[table.phases == 0], table[table.phases > 0]  # NaN does not count
    figure, (wide, near) = panels(1, 2, 12, 5.4, sharey=True)
    of, words = r"$\Omega = p/q$, ", "bracket of the phase that breaks first"
    look = {"color": "0.8", "lw": 6, "label": rf"{of}all phases $\varphi_0$"}
    wide.vlines(fractions.index, fractions.lower, fractions.most, **look)
    half = (fractions.upper - fractions.lower) / 2
    wide.errorbar(fractions.index, fractions.lower + half, half, label=f"{of}{words}", **_BRACKET)
    words = r"$\Omega$ irrational: from a certified torus (▲) to converse KAM"
    wide.vlines(limits.index, limits.lower, limits.upper, color=colour_of(1), lw=2, label=words)
    wide.plot(limits.index, limits.lower, "^", color=colour_of(1), ms=5)
    wide.set(xlabel=r"frequency $\Omega$", ylabel="scale $s$ of the last breakup")
    outer_legend(figure, 3)
    comparison = _draw_convergents(near, limits, fractions)
    # The axis ends above all brackets; how far phases above its end go is written there.
    top = _BEYOND * table.upper.max()
    for Ω, most in fractions.most[fractions.most > top].items():
        side, x = ("left", 5) if np.mean(wide.get_xlim()) > Ω else ("right", -5)
        how = {"textcoords": "offset points", "va": "top", "ha": side, "fontsize": "small"}
        wide.annotate(f"↑ {most:.2f}", (Ω, top), (x, -3), **how)
    wide.set_ylim(None, top)
    widths = (100 * (1 - cube.lower / cube.upper)).groupby(cube.phase.isnull()).median().to_series()
    names = {False: "fractions", True: "irrational Ω"}
    told = ", ".join(f"{width:.2g}% for {names[kind]}" for kind, width in widths.items())
    return figure, (
        "Where the last barrier of rotating maps breaks on the ray (κ̄, Δκ) = s·(cos, sin) of "
        f"{float(cube.angle):g}°: for {len(fractions)} fractions Ω, {table.phases.max()} phases "
        f"each, the last circle; for {len(limits)} irrational Ω the last torus. Brackets reach "
        f"from what is certified to converse KAM. Their median width is {told}; "
        f"{int((cube.lower + cube.upper).isnull().sum())} are missing. {comparison}"
    )


def _draw_convergents(axes, limits, fractions):
    """Draw the least scale of each convergent beside the bracket of its limit; compare in words."""
    ticks, overlap, inside, outside = [], [], [], []  # q of convergents
    for Ω, lower, upper, *_ in limits.itertuples():
        convergents = {Fraction(Ω).limit_denominator(q) for q in range(2, 65)}
        near = sorted((each.denominator, float(each)) for each in convergents)
        near = [(q, at) for q, at in near if at in fractions.index]
        if not near:
            continue
        i = len(ticks)
        ticks.append(f"{Ω:.4f}")
        axes.fill_between([i - 0.4, i + 0.4], lower, upper, color=colour_of(1), alpha=0.5, lw=0)
        for (q, at), x in zip(near, np.linspace(-0.3, 0.3, len(near) + 2)[1:-1], strict=True):
            least, first = fractions.loc[at, ["lower", "upper"]]
            axes.errorbar(i + x, (least + first) / 2, (first - least) / 2, **_BRACKET)
            axes.annotate(q, (i + x, first), (0, 4), textcoords="offset points", **_NUMBER)
            overlap += [q] if least < upper and lower < first else []
            inside += [q] if first <= lower else []
            outside += [q] if least >= upper else []
    axes.set(xlabel=r"irrational $\Omega$")
    axes.set_title("Beside its bracket those of its convergents, by $q$")
    axes.set_xticks(range(len(ticks)), ticks, rotation=60, fontsize="small")
    apart = inside + outside
    longest = f", up to q = {max(apart)}" if apart else ""
    return (
        f"Of {len(overlap + apart)} convergents, by the phase that breaks first, {len(overlap)} "
        f"have brackets that overlap the limit's, {len(inside)} lie below it, and {len(outside)} "
        f"above{longest}."
    )
