"""Scores of indicators, judged by proved answers: thresholds, false answers, and findings."""

import numpy as np
import xarray as xr

from pipeline.cubes.cube import text
from pipeline.cubes.indicators import INDICATORS, kicks_of
from pipeline.store.tiles import COMMIT, arrays_of
from workflows.labels.study import BARRIER, TEST, TRAIN
from workflows.shared.judgement import finding
from workflows.shared.tables import dataset, described

_LARGER_IS_BARRIER = {"escape": True, "digits": True, "exponent": False, "fli": False}


def threshold(values, is_barrier, larger_is_barrier):
    """Return the threshold: the value at and beyond which the answer is BARRIER.

    The threshold minimizes the sum of two fractions: of barriers that are answered TRANSPORT, and
    of forcings with transport that are answered BARRIER. Among equally good values, the middle one
    is chosen. The threshold is NaN unless there are forcings of both kinds.

    Parameters
    ----------
    values : ndarray
        Values of the indicator for the forcings in the split `train`.
    is_barrier : ndarray of bool
        Proved answers.
    larger_is_barrier : bool
        True if large values mean BARRIER.
    """
    if is_barrier.all() or not is_barrier.any():
        return np.nan
    score = values if larger_is_barrier else -values
    candidates = np.unique(score)
    below = np.array([np.mean(score[is_barrier] < c) for c in candidates])
    above = np.array([np.mean(score[~is_barrier] >= c) for c in candidates])
    best = np.flatnonzero(below + above <= (below + above).min() + 1e-12)
    chosen = candidates[best[best.size // 2]]
    return chosen if larger_is_barrier else -chosen


def answers_barrier(values, limit, larger_is_barrier):
    """Return True where an indicator answers BARRIER."""
    return values >= limit if larger_is_barrier else values <= limit


def wilson(k, n, z=1.96):
    """Return Wilson's 95% interval for the fraction k/n; NaN for n = 0."""
    k, n = np.asarray(k, float), np.where(np.asarray(n) > 0, n, np.nan)
    share, spread = k / n, z * np.sqrt(k * (n - k) / n + z**2 / 4) / n
    centre = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = spread / (1 + z**2 / n)
    return centre - half, centre + half


def share_of(counts):
    """Return the fraction of false answers; NaN where there are no forcings."""
    return np.where(counts.n_test > 0, counts.n_false / np.maximum(counts.n_test, 1), np.nan)


def scores(labels, margins):
    """Count false answers on the split `test`, by indicator, number of steps and margin class.

    The margin is the relative distance from CB_gt along the ray. A false answer is TRANSPORT below
    CB_gt, or BARRIER beyond it. The dims are (indicator, n, side, margin_class).
    """
    is_barrier = labels.label.values == BARRIER
    train, test = (labels.split.values == part for part in (TRAIN, TEST))
    classes = np.digitize(np.abs(labels.margin.values), margins) - 1
    groups = [[(is_barrier == side) & (classes == c) for c in range(len(margins) - 1)]
              for side in (True, False)]  # fmt: skip
    settings = {name: labels.attrs[name] for name in ("n_orbits", "n_starts")}
    shape = len(INDICATORS), labels.n.size
    limits, kicks = np.full((2, *shape), np.nan)
    false, total = np.zeros((2, *shape, 2, len(margins) - 1), int)
    for i, j in np.ndindex(shape):
        name, n = INDICATORS[i], int(labels.n[j])
        values, larger = labels[name].values[:, j], _LARGER_IS_BARRIER[name]
        kicks[i, j] = kicks_of(name, values, n, settings).mean()
        limit = np.inf
        if name != "escape":
            limit = threshold(values[train], is_barrier[train], larger)
        if np.isnan(limit):
            continue
        limits[i, j] = limit
        wrong = answers_barrier(values, limit, larger) != is_barrier
        false[i, j] = [[np.sum(wrong & test & group) for group in row] for row in groups]
        total[i, j] = [[np.sum(test & group) for group in row] for row in groups]
    dims = "indicator", "n", "side", "margin_class"
    low, high = wilson(false, total)
    counts = xr.Dataset({"n_false": (dims, false), "n_test": (dims, total)})
    variables = {
        "share": (dims, share_of(counts), "fraction of false answers on the test split"),
        "least": (dims, low, "lower end of its 95% interval (Wilson)"),
        "most": (dims, high, "upper end of its 95% interval (Wilson)"),
        "n_false": (dims, false, "false answers"),
        "n_test": (dims, total, "forcings in the test split"),
        "threshold": (
            dims[:2],
            limits,
            "value at and beyond which the answer is BARRIER",
        ),
        "kicks": (dims[:2], kicks, "mean number of kicks per forcing, in all orbits"),
    }
    coords = {
        "indicator": text("indicator", INDICATORS, "indicator"),
        "n": labels.n,
        "side": text("side", ["below", "beyond"], "side of CB_gt: barrier below, transport beyond"),
        "margin_class": (np.arange(len(margins) - 1), "margin class"),
        "margin_low": ("margin_class", margins[:-1], described("smallest margin in the class")),
        "margin_high": ("margin_class", margins[1:], described("largest margin in the class")),
    }
    flat = {name: coords.pop(name) for name in ("margin_low", "margin_high")}
    cube = dataset("False answers from indicators of transport", coords, variables)
    return cube.assign_coords(flat).assign_attrs(
        n_train=int(train.sum()), n_test=int(test.sum()), unlabelled=_unlabelled(labels)
    )


def seconds(place, values, scores):
    """Return the CPU seconds of each indicator per forcing, dims (indicator, n).

    The CPU time of the sweep, which is kept in the records of its tiles, is divided among the
    numbers of steps in proportion to the kicks.
    """
    spent = np.asarray(arrays_of(place, "labels_indicators")[COMMIT][0])
    per_forcing = xr.DataArray(spent.sum(axis=(1, *range(2, spent.ndim))), dims="indicator")
    per_forcing = per_forcing / values.sizes["forcing"]
    share = scores.kicks / scores.kicks.sum("n")
    label = "CPU seconds per forcing, in proportion to the kicks"
    return (share * per_forcing).assign_attrs(described(label, "s"))


def _unlabelled(labels):
    drawn = labels.attrs["drawn_below"] + labels.attrs["drawn_beyond"]
    return drawn - labels.sizes["forcing"]


_DECIDED = 0.05
"""An indicator errs (is right) if the 95% interval of its error rate lies above (below) this."""

_ERRS = {
    "escape": {"beyond"},
    "digits": {"below"},
    "exponent": {"below", "beyond"},
    "fli": {"below", "beyond"},
}
"""The sides of CB_gt on which each indicator errs, according to the first claim."""


def findings(scores, seconds):
    """Judge two claims about the indicators, and state the limits; return lines of text."""
    limits = (
        f"Limits: {scores.attrs['unlabelled']} forcings without a proved answer are left out, and "
        f"no forcing is closer to CB_gt than {100 * float(scores.margin_low[0]):g}%; "
        "thresholds depend on the distribution of the margins, and all indicators but the escape "
        "time depend on the line of starts and on the number of starts."
    )
    return "\n".join([_where_they_err(scores.isel(n=-1)), _next_to_it(scores, seconds), limits])


def _where_they_err(last):
    """Judge on which sides of CB_gt each indicator errs after the largest number of steps."""
    sums = last[["n_false", "n_test"]].sum("margin_class")
    share, least, most = (
        xr.DataArray(values, sums.n_test.coords)
        for values in (share_of(sums), *wilson(sums.n_false, sums.n_test))
    )
    errs, is_right = least > _DECIDED, most < _DECIDED
    parts, holds = [], []
    for name in last.indicator.values:
        sides = []
        for side in last.side.values:
            one = {"indicator": name, "side": side}
            claimed = errs if side in _ERRS[name] else is_right
            holds.append(bool(claimed.sel(one)))
            sides.append(f"{100 * float(share.sel(one)):.0f}% {side} ({_reach(last.sel(one))})")
        parts.append(f"{name} {', '.join(sides)}")
    known = bool((wilson(0, sums.n_test)[1] < _DECIDED).all())
    text = (
        f"after {int(last.n)} steps, the fractions of false answers on each side of CB_gt are "
        f"(in brackets, the margins at which there are none): {'; '.join(parts)}"
    )
    claim = (
        "the escape time errs only beyond CB_gt, the Birkhoff average only below it, and the "
        "Lyapunov indicators err on both sides"
    )
    every = bool(errs.any("side").all())
    return finding(claim, text, all(holds), every and holds[0], known)


def _reach(one):
    """Return, as text, the margin at and above which no answer is false."""
    right = (one.n_false.values == 0)[::-1].cumprod()[::-1].astype(bool)
    if not right.any():
        return "nowhere"
    return f"from {100 * float(one.margin_low.values[right][0]):g}% on"


def _next_to_it(scores, seconds):
    """Judge whether every indicator errs in the nearest class, and find the one that errs least."""
    nearest, sums = scores.isel(margin_class=0), scores[["n_false", "n_test"]]
    sums = sums.sum(["side", "margin_class"])
    errs = (nearest.least > _DECIDED).any("side").values
    share, known = share_of(sums), bool((nearest.n_test > 9).all())
    (i, j), ends = (
        np.unravel_index(np.argmin(share), share.shape),
        wilson(sums.n_false, sums.n_test),
    )
    low, high = (100 * end[i, j] for end in ends)
    text = (
        f"close to CB_gt, {int(errs.sum())} of {errs.size} err on at least one side; overall, "
        f"{scores.indicator.values[i]} after {int(scores.n[j])} steps has the fewest false "
        f"answers, {100 * share[i, j]:.0f}% ({low:.0f} to {high:.0f}%), in "
        f"{float(seconds[i, j]):.2g} CPU seconds per forcing, and {100 * share[i, -1]:.0f}% after "
        f"{int(scores.n[-1])} steps, in {float(seconds[i, -1]):.2g} s; the answer BARRIER for all "
        f"forcings would be false for {100 * _of_one_answer(scores):.0f}% of them"
    )
    margin = 100 * float(scores.margin_high[0])
    claim = f"within {margin:g}% of CB_gt every indicator errs, whatever the number of steps"
    return finding(claim, text, bool(errs.all()), bool(errs[:, -1].all()), known)


def _of_one_answer(scores):
    """Return the fraction of false answers if the answer is always BARRIER."""
    total = scores.n_test.isel(indicator=0, n=0)
    return float(total.sel(side="beyond").sum() / total.sum())
