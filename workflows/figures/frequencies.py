"""The last barrier of rotating maps against the frequency, fractions and irrational numbers."""

from fractions import Fraction

import numpy as np

from workflows.figures.style import colour_of, outer_legend, panels

_NUMBER = {"fontsize": "xx-small", "ha": "center"}
_BEYOND = 1.15  # times the largest end of a bracket: what is drawn


def draw_frequencies(cube):
    """Draw the scale of the last breakup against Ω, and the least one of convergents by their q."""
    limits, fractions = _parts(cube)
    figure, (wide, near) = panels(1, 2, 12, 5.4, sharey=True)
    for Ω, (lower, upper) in fractions.items():
        wide.vlines(float(Ω), lower.min(), upper.max(), color="0.8", lw=6)
        wide.vlines(float(Ω), lower.min(), upper.min(), color=colour_of(0), lw=2)
    for Ω, ends in limits.items():
        wide.vlines(Ω, *ends, color=colour_of(1), lw=2)
        wide.plot(Ω, ends[0], "^", color=colour_of(1), ms=5)
    of = r"$\Omega = p/q$, "
    wide.plot([], [], color="0.8", lw=6, label=rf"{of}all phases $\varphi_0$")
    wide.plot([], [], color=colour_of(0), lw=2, label=f"{of}bracket of the phase that breaks first")
    words = r"$\Omega$ irrational: from a certified torus (▲) to converse KAM"
    wide.plot([], [], color=colour_of(1), lw=2, label=words)
    wide.set(xlabel=r"frequency $\Omega$", ylabel="scale $s$ of the last breakup")
    outer_legend(figure, 3)
    comparison = _draw_convergents(near, limits, fractions)
    _cut(wide, [*(upper for _, upper in limits.values())], fractions)
    widths = ((cube.upper - cube.lower) / cube.upper).values
    n_phases = len(np.unique(cube.phase.dropna("forcing")))
    return figure, (
        "Where the last barrier of rotating maps breaks on the ray (κ̄, Δκ) = s·(cos, sin) of "
        f"{float(cube.angle):g}°: for {len(fractions)} fractions Ω, {n_phases} phases each, the "
        f"last circle; for {len(limits)} irrational Ω the last torus. The bracket reaches from "
        f"what is certified to converse KAM; it is {100 * np.nanmedian(widths):.1g}% wide in the "
        f"median, and missing for {np.isnan(widths).sum()} of {widths.size}. {comparison}"
    )


def _cut(axes, limits, fractions):
    """End the axis above all brackets, and write how far phases above its end go."""
    top = _BEYOND * np.nanmax([*limits, *(upper.min() for _, upper in fractions.values())])
    for Ω, (_, upper) in fractions.items():
        if upper.max() > top:
            side, x = ("left", 5) if float(Ω) < np.mean(axes.get_xlim()) else ("right", -5)
            how = {"textcoords": "offset points", "va": "top", "ha": side, "fontsize": "small"}
            axes.annotate(f"↑ {upper.max():.2f}", (float(Ω), top), (x, -3), **how)
    axes.set_ylim(None, top)


def _parts(cube):
    """Return {Ω: (lower, upper)} of irrational Ω, and of Fractions, with arrays over the phases."""
    limits, fractions = {}, {}
    for Ω, here in cube.groupby("frequency"):
        ends = np.stack([here.lower, here.upper])
        if here.phase.isnull().all():
            limits[Ω] = ends[:, 0]
        else:
            fractions[Fraction(Ω).limit_denominator(64)] = ends
    return limits, fractions


def _draw_convergents(axes, limits, fractions):
    """Draw the least scale of each convergent beside the bracket of its limit; compare in words."""
    ticks, overlap, inside, outside = [], [], [], []  # q of convergents
    for Ω, (lower, upper) in sorted(limits.items()):
        near = sorted({Fraction(Ω).limit_denominator(q) for q in range(2, 65)} & fractions.keys())
        if not near:
            continue
        i = len(ticks)
        ticks.append(f"{Ω:.4f}")
        axes.fill_between([i - 0.4, i + 0.4], lower, upper, color=colour_of(1), alpha=0.5, lw=0)
        near.sort(key=lambda fraction: fraction.denominator)
        for fraction, x in zip(near, np.linspace(-0.3, 0.3, len(near) + 2)[1:-1], strict=True):
            (least, first), q = (ends.min() for ends in fractions[fraction]), fraction.denominator
            axes.vlines(i + x, least, first, color=colour_of(0), lw=2)
            axes.annotate(q, (i + x, first), (0, 1), textcoords="offset points", **_NUMBER)
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
