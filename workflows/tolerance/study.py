"""The forcings of `tolerance`, the law that renormalisation predicts, and what is found."""

import numpy as np

from nasm import periodic
from workflows.shared.rules import finding
from workflows.shared.tables import dataset, described
from workflows.tolerance.response import DELTA, golden, growth, repeat

PERIODS = range(2, 9)
_LARGEST = 1e-3  # of two ripples, a repeat apart, under which the golden circle is asked
_SOLVED = 3  # kicks, up to which its residues answer there


def ripple(period):
    """Return the cosine f of that period, of mean 0 and rms 1."""
    f = np.cos(2 * np.pi * np.arange(period) / period)
    return f / np.sqrt(np.mean(f**2))


def ripples(smallest, quick):
    """List the ripples as ("cosine", d, profile), for P = 2 to 8, or to 3 if `quick`.

    Those of P = 2 go down to 10⁻⁵, the others to `smallest`.
    """
    sizes = np.array([1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5])
    sizes, periods = (sizes[:5:2], (2, 3)) if quick else (sizes, PERIODS)
    given = [(n, d) for n in periods for d in sizes if n == 2 or d >= 0.999 * smallest]
    return [("cosine", d, 1 + d * ripple(n)) for n, d in given]


def random(n):
    """List n random forcings of 2 to 8 kicks: Gaussian deviations of 10⁻³ to 10 of the mean."""
    random, drawn = np.random.default_rng(0), []
    for i in range(n):
        d = 10 ** random.uniform(-3, 1)
        drawn.append(("random", d, 1 + d * random.standard_normal(2 + i % 7)))
    return drawn


def starts(n):
    """List the starts of n climbs of 2 to 8 kicks, anywhere."""
    normal = (np.random.default_rng([1, i]).standard_normal(2 + i % 7) for i in range(n))
    return [("anywhere", i, row) for i, row in enumerate(normal)]


def with_loss(cube):
    """Return the cube with the rms strength at the breakup, and what it loses against κ_G."""
    rms = np.sqrt((cube.profile**2).mean("kick")) / golden()
    words = "part of the rms strength that is lost against constant kicks"
    error = (cube.error * rms).assign_attrs(described("estimated absolute error of loss"))
    loss = (1 - cube.critical_scale * rms).assign_attrs(described(words))
    return cube.assign(loss=loss, loss_error=error)


def laws(q_max):
    """Predict by which factor `repeat` in d the law of cosine ripples repeats, and measure it.

    loss ~ d^exponent times a function of ln d that has the period ln(repeat): from one repeat to
    the next the loss falls by δ^m. measured: the exponent of the golden circle's own loss over a
    repeat, from 10⁻³ down, by residues of periods up to q_max; NaN where it was not asked.
    """
    found = np.full((5, len(PERIODS)), np.nan)
    for row, period in zip(found.T, PERIODS, strict=True):
        rate, error = growth(period)
        predicted = np.log(DELTA) / rate
        row[:3] = np.exp(repeat(period) * rate), predicted, predicted * error / rate
        if period <= _SOLVED:
            row[3:] = _exponent(period, row[0], q_max)
    words = (
        *("factor in d after which the law repeats", "exponent ln δ/ln λ"),
        *("what the last repeat changed of it", "exponent of the golden circle's loss"),
        "its error",
    )
    names = "repeat", "predicted", "predicted_error", "measured", "measured_error"
    columns = {n: ("period", v, label) for n, v, label in zip(names, found, words, strict=True)}
    return dataset("The law of ripples", {"period": (PERIODS, "kicks in a period")}, columns)


def _exponent(period, factor, q_max):
    losses, errors = [], []
    for d in (_LARGEST, _LARGEST / factor):
        profile = 1 + d * ripple(period)
        scale = np.sqrt(np.mean(profile**2)) / golden()
        answer = periodic.critical_scale(f"{period}gamma", profile, q_max)
        losses.append(1 - scale * answer.value)
        errors.append(scale * answer.error / losses[-1])
    return np.log([losses[0] / losses[1], np.exp(np.hypot(*errors))]) / np.log(factor)


def with_distance(climbed):
    """Return the climbs with how far their summits are from constant kicks, up to symmetry."""
    kicks, period = climbed.kick.values, climbed.period
    same, turned = (
        abs((climbed.summit * sign).sum("kick")) / period
        for sign in (1.0 + 0 * kicks, (-1.0) ** kicks)
    )
    part = np.maximum(same, turned.where(period % 2 == 0, 0))
    words = "rms distance of the summit from constant kicks of some sign"
    distance = np.sqrt((1 - part**2).clip(0)).assign_attrs(described(words))
    return climbed.assign(distance=distance).drop_vars("summit")


def found(cube, laws, tried, summits):
    """Say what a ripple costs and how the conjecture stands, with a verdict on each claim."""
    known = cube.loss_error < 0.2 * cube.loss
    return " ".join([
        f"Of {known.size} ripples {int(known.sum())} have a loss with an error below a fifth of "
        f"it; {_examples(cube)}",
        _law(laws),
        _conjecture(tried, summits),
        "Not tried: more than 8 kicks, kicks that do not recur, and ripples so small that the law "
        "of 4 kicks and more repeats: residues of the golden circle find no breakup there.",
    ])  # fmt: skip


def _law(laws):
    here = laws.dropna("period", subset=["measured", "measured_error"])
    apart, error = abs(here.measured - here.predicted), here.measured_error + here.predicted_error
    said = ", ".join(
        f"{float(row.measured):.3f} ± {float(row.measured_error):.1g} ({float(row.predicted):.3f} "
        f"± {float(row.predicted_error):.1g}) for P = {period}"
        for period, row in ((int(p), here.sel(period=p)) for p in here.period)
    )
    rest = laws.sel(period=laws.measured.isnull())
    others = ", ".join(f"{x:.2f}" for x in rest.predicted.values)
    repeats = ", ".join(f"{x:.0e}" for x in rest["repeat"].values)
    words = (
        f"from ripples of {_LARGEST:g} to the next repeat of the law the golden circle's loss has "
        f"the exponents {said} as measured (predicted); for the other P, predicted "
        f"{others or 'nowhere'}, it was not measured, as the law repeats after factors of "
        f"{repeats or 'nothing'} in d"
    )
    agree = bool((apart < error).all())
    claim = "A ripple costs what renormalisation predicts, a power of it that depends on P:"
    all_known = here.sizes["period"] == laws.sizes["period"]
    weaker = bool((apart < 0.1 * here.predicted).all())
    return finding(claim, words, agree and all_known, weaker, here.sizes["period"] > 0)


def _conjecture(tried, summits):
    reached = summits.upper.values / golden()
    stay = reached > 1
    beaten = int(np.isinf(tried.upper).sum() + np.isinf(reached).sum())
    words = (
        f"{beaten} of {tried.upper.size} random forcings of 2 to 8 kicks and {reached.size} climbs "
        "hold a barrier at 1.001 times the rms strength of constant kicks. Under "
        f"{int((tried.upper <= golden()).sum())} random ones orbits escape, under the others "
        f"converse KAM finds no circle left; {stay.sum()} climbs end where no orbit escapes, "
        f"{summits.distance.values[stay].max(initial=0):.2f} or less from constant kicks of some "
        "sign in rms, and it finds none there, either; from the others orbits escape at "
        f"{reached[~stay].max(initial=0):.2f} of κ_G or less"
    )
    claim = "Constant kicks hold a barrier longest at equal rms strength:"
    return finding(claim, words, beaten == 0, known=reached.size > 0)


def _examples(cube):
    two = cube.isel(forcing=np.flatnonzero(cube.period == 2)).sortby("parameter")
    parts = [
        f"{100 * d:g}% cost {100 * loss:.2g}%"
        for d, loss in zip(two.parameter.values, two.loss.values, strict=True)
        if loss == loss and d in (1e-4, 1e-3, 1e-2, 1e-1)
    ]
    return f"of alternating ripples {', '.join(parts)}."
