"""False answers by indicators of transport, against distance from CB_gt and CPU time."""

from itertools import pairwise

import numpy as np

from workflows.figures import style

_NAMES = {
    "escape": "escape",
    "digits": "weighted Birkhoff average",
    "exponent": "Lyapunov exponent",
    "fli": "fast Lyapunov indicator",
}
_OFFSET = 0.13  # distance between the bars of two indicators, in classes


def draw_labels(scores, seconds):
    """Draw the fractions of false answers by distance from CB_gt, and overall against CPU time.

    scores : the cube `labels_scores`. seconds : CPU seconds per forcing, dims (indicator, n).
    """
    figure, (by_margin, by_cost) = style.panels(1, 2, 12, 5)
    last, sides = scores.isel(n=-1), [-scores.margin_class.values[::-1] - 1]
    places = np.concatenate([*sides, scores.margin_class.values + 1])
    for i, name in enumerate(scores.indicator.values):
        options = {"color": style.COLOURS[i], "label": _NAMES[name]}
        marker = {"marker": style.MARKERS[i], "ms": 3 if style.in_column() else 5}
        share, least, most = (
            100 * _from_below_to_beyond(last[part].sel(indicator=name))
            for part in ("share", "least", "most")
        )
        at = places + _OFFSET * (i - (scores.indicator.size - 1) / 2)
        by_margin.vlines(at, least, most, color=options["color"], lw=1.2)
        by_margin.plot(at, share, ls="", **marker, **options)
        one = scores[["n_false", "n_test"]].sel(indicator=name).sum(["side", "margin_class"])
        percent = 100 * one.n_false / one.n_test.where(one.n_test > 0)
        by_cost.plot(seconds.sel(indicator=name), percent, **marker, **options)
    ends = [f"{100 * end:g}" for end in (*scores.margin_low.values, scores.margin_high.values[-1])]
    classes = [f"{low}–{high}" for low, high in pairwise(ends)]
    by_margin.axvline(0, color="black", lw=0.8)
    by_margin.set_xticks(places, classes[::-1] + classes, fontsize="small")
    by_margin.set(xlabel=r"distance from $\mathit{CB}_{gt}$ (%)", ylabel="false answers (%)")
    by_margin.set(ylim=(-4, 118), yticks=range(0, 101, 20))
    style_of = {"transform": by_margin.get_xaxis_transform(), "fontsize": "small", "va": "top"}
    by_margin.text(-0.15, 0.98, "barrier proved", ha="right", **style_of)
    by_margin.text(0.15, 0.98, "transport proved", ha="left", **style_of)
    by_margin.set_title(f"After N = {int(scores.n[-1])} steps")
    by_cost.set(xscale="log", xlabel="CPU time per forcing (s)", ylim=(0, None))
    by_cost.set(ylabel="false answers in all classes (%)")
    total = scores.n_test.isel(indicator=0, n=0)
    always = 100 * float(total.sel(side="beyond").sum() / max(total.sum(), 1))
    by_cost.axhline(always, color="black", ls=":", lw=0.8, label="always BARRIER")
    by_cost.set_title(f"N = {', '.join(map(str, scores.n.values))}, from left to right")
    handles, names = by_cost.get_legend_handles_labels()
    style.outer_legend(figure, 5, 2, handles=handles, labels=names)
    return figure


def _from_below_to_beyond(counts):
    """Return the values of all classes from far below CB_gt to far beyond it."""
    return np.concatenate([counts.sel(side="below")[::-1], counts.sel(side="beyond")])


def labels_caption(labels, scores, findings):
    n_drawn = labels.attrs["drawn_below"] + labels.attrs["drawn_beyond"]
    barriers = int(style.has_flag(labels.label, "barrier").sum())
    worst = float((abs(labels.margin_error / labels.margin)).max())
    return (
        f"Of {n_drawn} random forcings, {labels.sizes['forcing']} have a proved answer: "
        f"{barriers} BARRIER, {labels.sizes['forcing'] - barriers} TRANSPORT. (a) Fraction of "
        f"false answers among the {int(scores.attrs['n_test'])} test forcings after N = "
        f"{int(scores.n[-1])} steps, with 95% intervals (Wilson), by relative distance from CB_gt "
        f"along the ray. The distance is known to within a relative error of {worst:.0e}. An "
        f"indicator of orbits answers BARRIER if one of {labels.attrs['n_starts']} orbits started "
        "on x = 0 looks regular and "
        f"rotational; its threshold is fitted on the other {int(scores.attrs['n_train'])} "
        f"forcings. (b) The fraction in all classes against CPU time.\n{findings}"
    )
