"""The forcings of `tolerance`, the law that renormalisation predicts, and what is found."""

import numpy as np

from nasm import periodic
from workflows.shared.rules import finding
from workflows.shared.tables import dataset, described
from workflows.tolerance.response import DELTA, finer, golden, growth, modes, renormalisation

PERIODS = range(2, 9)
_SHARP = 0.1  # of the predicted exponent: a larger error settles nothing
_SEEN = 2  # times the period from which orbits tell a ripple from none: the longest,
_LONGEST = 50_000  # unless this is less
_CIRCLES = {
    (2, 1): ("[0;1,3,4,2,(1)]", 3e-3, 1e-3),
    (3, 1): ("[1;6,1,5,(1)]", 1e-2, 3e-3),
    (4, 1): ("[1;1,1,4,1,2,(1)]", 1e-2, 3e-3),
    (5, 1): ("[1;1,8,4,(1)]", 3e-2, 1e-2),
    (5, 2): ("[1;2,1,4,2,(1)]", 3e-2, 1e-2),
    (7, 1): ("[2;1,1,3,5,2,(1)]", 3e-2, 1e-2),
}
"""{(P, mode): a circle that is last under some ripple, and two ripples, to measure the law by}; for
6 and 8 kicks the finer circles take longer periods than that."""

_ROUNDS = {3: 2}  # of the cycle: in each the ripple changes its sign


def ripple(period, shape="cosine", mode=1):
    """Return f of that period and shape, of mean 0 and rms 1."""
    n, waves = np.arange(period), np.cos(2 * np.pi * mode * np.arange(period) / period)
    f = {"cosine": waves, "one kick": n == 0, "square": 2 * n < period}[shape]
    f = f - np.mean(f)
    return f / np.sqrt(np.mean(f**2))


def ripples(smallest, quick):
    """List the ripples as (shape, d, profile), for P = 2 to 8, or to 3 if `quick`.

    Those of P = 2 go down to 10⁻⁵, the others to `smallest`; other shapes than cosines are of 10%
    and 1% and of 4, 6 and 8 kicks.
    """
    sizes = np.array([1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5])
    sizes, periods = (sizes[:5:2], (2, 3)) if quick else (sizes, PERIODS)
    given = [(n, d) for n in periods for d in sizes if n == 2 or d >= 0.999 * smallest]
    other = [(n, d) for n, d in given if n in (4, 6, 8) and d in (0.1, 0.01)]
    shapes = {"cosine": given, "one kick": other, "square": other}
    return [(of, d, 1 + d * ripple(n, of)) for of, rows in shapes.items() for n, d in rows]


def random(n):
    """List n random forcings of 2 to 8 kicks: Gaussian deviations of 10⁻³ to 10 of the mean."""
    random = np.random.default_rng(0)
    sizes = 10 ** random.uniform(-3, 1, n)
    normal = random.standard_normal
    return [("random", d, 1 + d * normal(2 + i % 7)) for i, d in enumerate(sizes)]


def starts(n):
    """List the starts of n climbs of 2 to 8 kicks, anywhere."""
    normal = (np.random.default_rng([1, i]).standard_normal(2 + i % 7) for i in range(n))
    return [("anywhere", i, row) for i, row in enumerate(normal)]


def with_loss(cube):
    """Return the cube with what the rms strength at the breakup loses against κ_G."""
    kept, words = cube.rms_scale / golden(), "part of the rms strength lost against constant kicks"
    error = kept * cube.error / cube.critical_scale
    error = error.assign_attrs(described("estimated absolute error of loss"))
    return cube.assign(loss=(1 - kept).assign_attrs(described(words)), loss_error=error)


def laws(periods):
    """Predict the exponent of the loss by cosine ripples of P = 2 to 8, and measure some of them.

    After h renormalisations of each mode of the cycle the loss is δ^h as large, and the ripple as
    the responses say. measured: by the losses of circles, and of those `finer`, along the cycle,
    for the P in `periods`; its error is how much it changes from larger ripples, and what a change
    of the first loss by its own part would do: corrections to the law are of that order.
    """
    found = np.full((4, len(PERIODS)), np.nan)
    for row, period in zip(found.T, PERIODS, strict=True):
        cycle, (h, _) = modes(period), renormalisation(period)
        rates = np.sum([growth(period, mode)[:2] for mode in cycle], axis=0)
        predicted = h * len(cycle) * np.log(DELTA) / rates
        row[:2] = predicted[0], abs(predicted[0] - predicted[1])
        if period in periods:
            falls = np.sum([_falls(period, mode) for mode in cycle], axis=0)
            larger, smaller, loss = falls / rates[0] / _ROUNDS.get(period, 1)
            row[2:] = smaller, abs(smaller - larger) + loss
    labels = {
        "predicted": "exponent ln δ/ln λ",
        "predicted_error": "what longer orbits changed of it",
        "measured": "exponent of a circle's loss, over a repeat",
        "measured_error": "its change from larger ripples, and corrections of the loss's order",
    }
    columns = {k: ("period", row, labels[k]) for k, row in zip(labels, found, strict=True)}
    return dataset("The law of ripples", {"period": (PERIODS, "kicks in a period")}, columns)


def _falls(period, mode):
    """By how much ln of the loss falls from each of two ripples to the finer one of it; and the
    loss by the second ripple."""
    if (period, mode) not in _CIRCLES:
        return np.full(3, np.nan)
    circle, *sizes = _CIRCLES[period, mode]
    fine, factor = (circle, mode), 1.0
    for _ in range(_ROUNDS.get(period, 1)):
        rate, _, turned = growth(period, fine[1])
        fine, factor = finer(fine[0], period, fine[1]), (-1) ** turned * np.exp(-rate) * factor
    losses = [[_loss(period, circle, mode, d), _loss(period, *fine, factor * d)] for d in sizes]
    return np.append(-np.diff(np.log(losses)), losses[1][0])


def _loss(period, circle, mode, d):
    profile = 1 + d * ripple(period, mode=mode)
    q_max = int(np.clip(_SEEN * periodic.cusp_period(golden() * profile), 6000, _LONGEST))
    scale = periodic.critical_scale(circle, profile, q_max).value
    return 1 - scale * np.sqrt(np.mean(profile**2)) / golden()


def found(cube, laws, tried, summits):
    """Say what a ripple costs and how the conjecture stands, with a verdict on each claim."""
    known = cube.loss_error < 0.2 * cube.loss
    return " ".join([
        f"Of {known.size} ripples {int(known.sum())} have a loss with an error below a fifth of "
        f"it; {_examples(cube)}",
        _law(laws),
        _conjecture(tried, summits),
        "Not tried: more than 8 kicks, kicks that do not recur, the law of other shapes, and "
        "ripples of 3 kicks and more below 0.003.",
    ])  # fmt: skip


def _exponent(value, error):
    return f"{value:.3f} ± {error:.1g}" if error < np.inf else f"{value:.3f}"


def _law(laws):
    error = (laws.measured_error + laws.predicted_error).where(laws.measured.notnull())
    sharp = (error < _SHARP * laws.predicted).values  # False where an error is not known
    agree = (abs(laws.measured - laws.predicted) < error).values
    rows = laws.where(laws.measured.notnull(), drop=True).to_dataframe().itertuples()
    said = ", ".join(
        f"{_exponent(row.measured, row.measured_error)} "
        f"({_exponent(row.predicted, row.predicted_error)}) for P = {row.Index}"
        for row in rows
    )
    vague = ", ".join(map(str, laws.period.values[~sharp]))
    words = f"from a ripple to the next repeat of the law the loss has the exponents {said}, as "
    words += "measured (predicted), errors by larger ripples and the loss itself (shorter orbits)"
    words += f"; errors above a tenth, or none, settle nothing for P = {vague}" if vague else ""
    claim = "A ripple costs what renormalisation predicts, a power of it that depends on P:"
    fits = bool(agree[sharp].all())
    return finding(claim, words, fits and sharp.all(), fits, bool(sharp.any()))


def _conjecture(tried, summits):
    reached = summits.upper.values / golden()
    stay = reached > 1
    beaten = int(np.isinf(tried.upper).sum() + np.isinf(reached).sum())
    words = (
        f"{beaten} of {tried.upper.size} random forcings of 2 to 8 kicks and {reached.size} climbs "
        "hold a barrier at 1.001 times the rms strength of constant kicks. Under "
        f"{int((tried.upper <= golden()).sum())} random ones orbits escape, under the others "
        f"converse KAM finds no circle left, nor at the ends of {stay.sum()} climbs, from which "
        f"none escapes; from the others orbits do, at {reached[~stay].max(initial=0):.2f} of κ_G "
        "or less"
    )
    claim = "Constant kicks hold a barrier longest at equal rms strength:"
    return finding(claim, words, beaten == 0, known=reached.size > 0)


def _examples(cube):
    two = cube.isel(forcing=np.flatnonzero(cube.period == 2)).sortby("parameter")
    costs = zip(100 * two.parameter.values, 100 * two.loss.values, strict=True)
    said = ", ".join(f"{d:g}% cost {loss:.2g}%" for d, loss in costs)
    percent = np.isclose(cube.parameter, 0.01) & (cube.period > 2)
    longer = 100 * cube.loss.where(percent, drop=True)
    parts = (longer[longer.family == family] for family in np.unique(longer.family))
    most = ", ".join(f"{x.min():.2g}% to {x.max():.2g}% ({x.family[0].item()})" for x in parts)
    return f"of alternating ripples {said}; of longer ones 1% costs {most or 'was not asked'}."
