"""Figures of up to three panels that show where each method fails, and their captions."""

import numpy as np
from matplotlib.ticker import NullFormatter

from workflows.figures.style import COLOURS, MARKERS, key, legend_below, line_of, panels

_OK = 1  # value of `status`, see `pipeline.cubes.cube`


def draw_stability(name, studies):
    """Draw the figure `name` of FIGURES, with a panel for each of its studies, {name: Dataset}."""
    parts = FIGURES[name]
    figure, drawn_on = panels(1, len(parts), 5 * max(len(parts), 1.5), 5.4)
    for axes, (part, (draw, _)) in zip(drawn_on, parts.items(), strict=True):
        draw(axes, studies[part])
        axes.grid(lw=0.3)
        legend_below(axes, 2, 2)
    return figure


def stability_caption(name, studies):
    """Describe the results of the studies of a figure, in numbered sentences."""
    numbers = {part: number for number, part in enumerate(studies, 1)}
    parts = FIGURES[name].items()
    return "\n".join(f"{numbers[part]}. {describe(studies[part])}" for part, (_, describe) in parts)


def _draw_near_cusp(axes, study):
    """Draw the true errors, the claimed errors (dashed), and crosses where there is no answer."""
    for i, name in enumerate(study.approach.values):
        part, colour = study.isel(approach=i), COLOURS[i]
        off = np.maximum(part.off, 1e-14)
        axes.plot(study.delta, off, f"{MARKERS[i]}-", color=colour, ms=4, label=name)
        axes.plot(study.delta, part.error, "--", color=colour, lw=1)
        _mark_silent(axes, study.delta[(part.status != _OK).values] * 1.2**i, colour)
    axes.set(xscale="log", yscale="log", xlabel=r"$45° - \varphi$ (degrees)")
    axes.set(ylabel="relative error", title="Near the cusp")
    key(axes, {"--": "claimed", "x": "no answer (on the axis)"})


def _near_cusp(study):
    parts = []
    for i, name in enumerate(study.approach.values):
        part = study.isel(approach=i)
        over = float((part.off / (part.error + part.judge_error)).max())
        parts.append(
            f"{name} down to {_nearest(part, part.status == _OK):.0e}° (error up to "
            f"{float(part.off.max()):.0e}, at most {over:.2g} times the claimed error)"
        )
    return f"Near the cusp at 45° these methods give answers: {'; '.join(parts)}."


def _nearest(study, holds):
    """Return the smallest distance at which `holds` is true, or inf if it never is."""
    return study.delta.values[holds.values].min(initial=np.inf)


def _mark_silent(axes, x, colour):
    """Draw a × on the lower axis at each x where a method has no answer."""
    below = {"transform": axes.get_xaxis_transform(), "clip_on": False, "zorder": 4}
    if len(x):  # an unclipped line without points would appear in the corner of the figure
        axes.plot(x, np.zeros(len(x)), "x", color=colour, ms=5, **below)


def _draw_past_boundary(axes, study):
    """Mark where each method makes its claim around the breakup, and draw dots elsewhere."""
    excess = study.excess.values
    claims = (
        ("circle\ncertified", study.certified == 1, "o"),
        ("Birkhoff\nregular", study.digits >= 5, "s"),
        ("converse\nKAM", np.isfinite(study.elimination_time), "v"),
        ("escape\nseen", np.isfinite(study.escape_time), "^"),
        ("escape,\nsingle", np.isfinite(study.escape_time_single), "<"),
    )
    claims = [claim for claim in claims[::-1] if claim[1].any()]
    for row, (_, claimed, mark) in enumerate(claims):
        for i, angle in enumerate(study.angle.values):
            made = claimed.sel(angle=angle).values
            for shown, marker, size in ((made, mark, 5), (~made, ".", 2)):
                y, style = np.full(shown.sum(), row + 0.2 * i), {"ls": "", "marker": marker}
                axes.plot(excess[shown], y, color=COLOURS[i], ms=size, **style)
    axes.set_yticks(range(len(claims)), [label for label, *_ in claims])
    axes.axvline(0, color="black", lw=0.8)
    axes.set_xscale("symlog", linthresh=np.abs(excess[excess != 0]).min())
    axes.tick_params(axis="x", rotation=45)
    for i, angle in enumerate(study.angle.values):
        axes.plot([], [], "o", color=COLOURS[i], label=rf"$\varphi = {angle:g}°$")
    key(axes, {".": "small dots: no claim"})
    axes.set(xlabel="$s/s_c - 1$", ylim=(-0.5, len(claims)))
    axes.set_title("Claims of each method around the breakup")


def _past_boundary(study):
    excess = study.excess.values
    beyond = study.isel(excess=np.flatnonzero(excess > 1e-12))
    within = study.isel(excess=np.flatnonzero(excess < -1e-12))
    eliminated = beyond.excess.where(np.isfinite(beyond.elimination_time).all("angle")).min()
    regular = beyond.excess.where((beyond.digits >= 5).any("angle")).max()
    escaped, single = (
        beyond.excess.where(np.isfinite(times).any("angle")).min()
        for times in (beyond.escape_time, beyond.escape_time_single)
    )
    return (
        f"Past the breakup, {int((beyond.certified == 1).sum())} circles are certified. Converse "
        f"KAM eliminates all starts from {_percent(eliminated)} beyond the breakup onwards, and "
        f"wrongly in {int(np.isfinite(within.elimination_time).sum())} cases below the breakup. "
        "A weighted Birkhoff average still classifies an orbit as regular (5 digits) at "
        f"{_percent(regular)} beyond. The first escape of one of 100 orbits is seen "
        + (f"at {_percent(escaped)} beyond" if np.isfinite(escaped) else "nowhere")
        + (f" (in single precision, at {_percent(single)})" if np.isfinite(single) else "")
        + f"; in single precision, {int(np.isfinite(within.escape_time_single).sum())} ensembles "
        "escape through an existing circle."
    )


def _draw_fractions(axes, study):
    """Draw breakups by residues and continuation (with errors), and scales of certified circles."""
    for i, quotient in enumerate(study.quotient.values):
        part, colour = study.isel(quotient=i), COLOURS[i]
        place = study.q * 1.08**i
        residues, norms = (part.isel(approach=m) for m in (0, 1))
        style = {"fmt": "s", "ms": 4, "mfc": "none", "lw": 1}
        axes.errorbar(place, norms.value, norms.error, color=colour, **style)
        axes.plot(place, residues.value, "o", color=colour, ms=5, label=f"$a = {quotient}$")
        axes.plot(place, part.lower, "_", color=colour)
        silent = (residues.value.isnull() & norms.value.isnull()).values
        _mark_silent(axes, place[silent], colour)
    marks = {"o": "residues", "s": "continuation", "_": "certified", "x": "no answer (on the axis)"}
    key(axes, marks, "s")
    axes.axhline(study.attrs["golden"], color="0.5", lw=0.8, label="golden circle")
    axes.set(xscale="log", ylim=(0, 3))
    axes.set(xlabel="$q$ of the fraction", ylabel="breakup on $s(0.3, 0.2)$")
    axes.set_xticks(study.q.values, study.q.values)
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_title(r"Close to fractions: $[0;1,…,1,a,(1)]$")


def _fractions(study):
    silent = [(study.status.isel(approach=i) != _OK).sum("q").values.tolist() for i in (0, 1)]
    norms, judge = study.isel(approach=1), study.isel(approach=2)
    wrong = int((abs(norms.value - judge.value) > norms.error + judge.error).sum())
    large = ", ".join(f"{a:g}" for a in study.quotient.values)
    return (
        f"Irrational numbers close to fractions, [0;1,…,1,a,(1)] with a = {large}, "
        f"{study.q.size} for each a: residues give no answer in {', '.join(map(str, silent[0]))} "
        f"cases and continuation in {', '.join(map(str, silent[1]))}. Judged by longer orbits, "
        f"the true error of continuation exceeds the claimed error in {wrong} cases."
    )


def _draw_twist(axes, study):
    """Draw lifetimes on the dominant line, and the loss of twist."""
    for i, angle in enumerate(study.angle.values):
        part, colour = study.isel(angle=i), COLOURS[i]
        finite, line = part.where(np.isfinite(part)), line_of(i)
        line |= {
            "label": rf"$\varphi = {angle:g}°$",
            "ms": 6 - 2 * i,
        }  # marker sizes differ, so that all are visible
        axes.plot(study.scale, finite.elimination_time, "o", **line)
        axes.plot(study.scale, finite.escape_time, "^:", color=colour, ms=3, lw=0.8)
        end = part.scale.where(part.twist < 1e-9).min()
        axes.axvline(float(end), color=colour, lw=0.8, ls="--")
    axes.set(yscale="log", xlabel="scale $s$", ylabel="steps")
    key(axes, {"o": "converse KAM", "^": "escape", "--": "loss of twist"})
    axes.set_title("Lifetimes on the dominant line")


def _twist(study):
    beyond = study.isel(scale=np.flatnonzero((study.scale > 1.5).values))
    lifetimes = beyond.elimination_time.values
    return (
        "Beyond a scale of 1.5, up to and past the loss of twist, converse KAM eliminates all "
        f"starts in {np.isfinite(lifetimes).sum()} of {lifetimes.size} cases, within "
        f"{np.max(lifetimes):g} steps; {int((beyond.circle == _OK).sum())} circles are certified, "
        f"although Birkhoff averages reach up to {float(beyond.digits.max()):.0f} digits on other "
        "regular orbits."
    )


def _draw_missed(axes, study):
    axes.plot(
        study.kept,
        100 * study.missed,
        "o-",
        label="searches more than 1% short",
    )
    axes.plot(study.kept, 100 * study.worst, "s--", mfc="none", label="largest shortfall")
    axes.set_xscale("log", base=2)
    axes.set(xlabel="starts kept", ylabel="percent")
    axes.set_title(f"Beam search of converse KAM, {study.attrs['searches']} searches")


def _missed(study):
    pairs = zip(study.kept.values.tolist(), study.missed.values, strict=True)
    return (
        f"Of {study.attrs['searches']} beam searches of converse KAM, these fractions "
        "underestimate the longest lifetime by more than 1%, depending on the number of starts "
        "kept (32 by default): "
        f"{', '.join(f'{_percent(part)} with {number}' for number, part in pairs)}."
    )


def _draw_disorder(axes, study):
    labels = {
        "lost": "no convergence",
        "right": "the orbit of 13/21",
        "refused": "another orbit, rejected",
        "accepted": "another orbit, accepted",
    }
    lines = "o-", "s--"  # for the smaller and the larger noise
    for i, (name, label) in enumerate(labels.items()):
        for j, line in enumerate(lines):
            y = study[name].isel(noise=j)
            axes.plot(study.scale, y, line, color=COLOURS[i], ms=4, label="" if j else label)
    axes.set(xlabel="scale $s$ of $s(1, 0.5)$", ylabel="fraction of starts")
    axes.set_title("Newton's method for 13/21")
    key(
        axes,
        {line: f"starts off by {n:g}" for line, n in zip(lines, study.noise.values, strict=True)},
    )


def _disorder(study):
    trials, worst = study.attrs["trials"], study.refused.max("noise")
    return (
        "From bad starts, Newton's method converges to a disordered orbit in up to "
        f"{_percent(worst.max())} of trials, at scales of "
        f"{float(study.scale.where(worst > 0).min()):.2g} or more. Of the orbits found in all "
        f"{trials * study.refused.size} trials, the ordering test accepts "
        f"{round(float(study.accepted.sum()) * trials)} wrong ones."
    )


def _draw_tori(axes, study):
    """Draw brackets against the distance from a resonance, and crosses where none is certified."""
    for i, name in enumerate(study.pair.values):
        part, colour, place = study.isel(pair=i), COLOURS[i], study.delta * 1.15**i
        style = {"color": colour, "ms": 5}
        axes.errorbar(place, part.value, part.error, fmt="s", mfc="none", lw=1, **style)
        axes.plot(place, part.lower, "^", label=name, **style)
        axes.plot(place, part.upper, "v", mfc="none", **style)
        _mark_silent(axes, place[part.lower.isnull().values], colour)
    marks = {
        "^": "certified",
        "v": "no torus (converse KAM)",
        "s": "breakup",
        "x": "none certified (on the axis)",
    }
    key(axes, marks, "vs")
    axes.set(xscale="log", xlabel=r"distance $\delta$ from the resonance", ylabel="scale $s$")
    axes.set(ylim=(0, None), title="Tori near a resonance, ray at 45°")


def _tori(study):
    parts = []
    for i, name in enumerate(study.pair.values):
        part = study.isel(pair=i)
        shown, known = _nearest(part, part.lower.notnull()), _nearest(part, part.status == _OK)
        parts.append(f"{name} down to δ = {shown:.0e} (with a value, down to {known:.0e})")
    return (
        f"Near a resonance, tori are certified for {'; '.join(parts)}; at smaller δ the status "
        f"states the reason. Of these tori, {int((study.lower >= study.upper).sum())} lie beyond "
        f"the converse KAM bound for their Ω. Past that bound, {int((study.past == _OK).sum())} of "
        f"{study.past.size} attempts, on grids of several sizes, certify a torus."
    )


def _percent(part):
    return f"{100 * float(part):.2g}%"


FIGURES = {
    "stability_boundary": {
        "cusp": (_draw_near_cusp, _near_cusp),
        "boundary": (_draw_past_boundary, _past_boundary),
        "fractions": (_draw_fractions, _fractions),
    },
    "stability_searches": {
        "beam": (_draw_missed, _missed),
        "disorder": (_draw_disorder, _disorder),
    },
    "stability_orbits": {"twist": (_draw_twist, _twist), "tori": (_draw_tori, _tori)},
}
"""{name of a figure: {study: (function that draws its panel, function that describes it)}}"""
