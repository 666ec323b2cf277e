"""The forcings of `tolerance`, the exponents that are measured and predicted, what is found."""

import numpy as np
import xarray as xr

from workflows.figures.tolerance import CLEAR, COSINE
from workflows.shared import power_law
from workflows.shared.rules import finding
from workflows.shared.tables import dataset, described
from workflows.tolerance.response import golden, predicted_exponent

RIPPLE = "rms of the deviations d·f from constant kicks, over their mean"
_LAWS = "exponent", "exponent_error", "predicted", "predicted_error"
_SMALL = 0.011  # ripples from which exponents are fitted


def shape(kind, period):
    """Return f, of mean 0 and rms 1."""
    n = np.arange(period)
    f = np.cos(2 * np.pi * n / period) if kind == COSINE else (n == 0) - 1 / period
    return f / np.sqrt(np.mean(f**2))


def ripples(shapes, smallest, quick):
    """List the ripples as (shape, d, profile), for P = 2 to 8, or to 3 if `quick`.

    Those of P = 2, for which all shapes are one, go down to 10⁻⁵, the others to `smallest`.
    """
    halves = np.array([1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5])
    longer = halves[(halves != 3e-2) & (halves >= 0.999 * smallest)]
    if quick:
        halves = longer = halves[:5:2]
    given = [(COSINE, 2, halves)]
    given += [(f, n, longer) for f in shapes for n in range(3, 4 if quick else 9)]
    return [(f, d, 1 + d * shape(f, n)) for f, n, sizes in given for d in sizes]


def random(n):
    """List n random forcings of 2 to 8 kicks: Gaussian deviations of 10⁻³ to 10 of the mean."""
    random, drawn = np.random.default_rng(0), []
    for i in range(n):
        d = 10 ** random.uniform(-3, 1)
        drawn.append(("random", d, 1 + d * random.standard_normal(2 + i % 7)))
    return drawn


def starts(n):
    """List the starts of n climbs of 2 to 8 kicks: every other near constant kicks, and the rest
    anywhere."""
    drawn = []
    for seed in range(n):
        deviations = np.random.default_rng([1, seed]).standard_normal(2 + seed % 7)
        near = seed // 7 % 2
        drawn.append(
            ("near" if near else "anywhere", seed, near + (0.3 if near else 1) * deviations)
        )
    return drawn


def with_loss(cube):
    """Return the cube with the rms strength at the breakup, and what it loses against κ_G."""
    rms = np.sqrt((cube.profile**2).mean("kick")) / golden()
    loss = (1 - cube.critical_scale * rms).assign_attrs(
        described("part of the rms strength that is lost against constant kicks")
    )
    error = (cube.error * rms).assign_attrs(described("estimated absolute error of loss"))
    return cube.assign(loss=loss, loss_error=error)


def clear(cube):
    """Return the ripples whose loss is known to a part CLEAR of it, the smallest first."""
    known = cube.loss_error < CLEAR * cube.loss
    return cube.isel(forcing=np.flatnonzero(known)).sortby("parameter")


def laws(cube):
    """Fit loss ~ d^exponent to ripples of 1% and less, and predict it: dims (shape, period)."""
    periods, shapes = np.unique(cube.period), np.unique(cube.family)
    fits = np.full((4, shapes.size, periods.size), np.nan)
    for i, kind in enumerate(shapes):
        for j, period in enumerate(periods):
            mine = (cube.family == kind) & (cube.period == period) & (cube.parameter < _SMALL)
            here = clear(cube.isel(forcing=np.flatnonzero(mine)))
            if mine.any():
                slope = power_law.exponent(here.parameter.values, here.loss.values, least=3)
                fits[:, i, j] = *slope, *predicted_exponent(shape(kind, period))
    words = "d ln loss/d ln d", "its standard error", "ln δ/ln λ", "what it changed by at last"
    columns = {
        name: (("shape", "period"), values, label)
        for name, values, label in zip(_LAWS, fits, words, strict=True)
    }
    coords = {"shape": (shapes, "shape of the ripple"), "period": (periods, "kicks in a period")}
    return dataset("Loss against ripple", coords, columns)


def at_summits(climbed):
    """Return the climbs with how far their summits are from constant kicks, up to symmetry."""
    kicks = climbed.kick.values
    signs = [1.0 + 0 * kicks, (-1.0) ** kicks]
    period = climbed.period
    along = [abs((climbed.summit * sign).sum("kick")) / period for sign in signs]
    along[1] = along[1].where(period % 2 == 0, 0)
    part = xr.concat(along, "sign").max("sign")
    away = np.sqrt((1 - part**2).clip(0)).assign_attrs(
        described("rms distance of the summit from constant kicks of some sign")
    )
    return climbed.assign(distance=away).drop_vars("summit")


def found(cube, laws, tried, summits):
    """Say what a ripple costs and how the conjecture stands, with a verdict on each claim."""
    return " ".join([
        f"Of {cube.sizes['forcing']} ripples {clear(cube).sizes['forcing']} have a loss with an "
        f"error below {100 * CLEAR:g}% of it, and are drawn; {_examples(cube)}",
        _law("An alternating ripple costs what renormalisation predicts:", laws.sel(period=[2])),
        _law("So do ripples of longer periods:", laws.sel(period=laws.period > 2)),
        _conjecture(tried, summits),
        "Not tried: more than 8 kicks, kicks that do not recur, and forcings that a search of "
        "converse KAM with 100 periods eliminates though a circle is left.",
    ])  # fmt: skip


def _law(claim, laws):
    """Judge the exponents that are known to a tenth: within two standard errors of the predicted
    ones, or all within a tenth of these."""
    fits = [laws[name].values.ravel() for name in _LAWS]
    sharp = fits[1] < 0.1 * fits[2]
    measured, error, predicted, uncertainty = np.compress(sharp, fits, axis=1)
    apart = abs(measured - predicted)
    agree = apart <= 2 * error + uncertainty
    pairs = zip(measured, error, predicted, strict=True)
    said = ", ".join(f"{x:.3f} ± {dx:.3f} ({y:.3f})" for x, dx, y in pairs)
    words = (
        f"{agree.size} of {sharp.size} exponents from ripples of 1% and less are known to a tenth, "
        f"{said} with the predicted ones, and {agree.sum()} agree within two standard errors"
    )
    return finding(claim, words, agree.all(), (apart < 0.1 * predicted).all(), agree.size > 0)


def _conjecture(tried, summits):
    beaten = int(np.isinf(tried.upper).sum() + (summits.survived >= 1e4).sum())
    upper, reached = tried.upper.values / golden(), summits.reached.values / golden()
    other = (summits.distance > 0.05).values
    highest = reached[other].max(initial=0)
    elsewhere = f", the others at {highest:.2f} of κ_G or less" if other.any() else ""
    words = (
        f"{beaten} of {upper.size} random forcings of 2 to 8 kicks and {reached.size} climbs do "
        "better; of forcings 10% and more off constant ones the best hold up to "
        f"{upper[tried.parameter.values > 0.1].max(initial=0):.2f} of κ_G; "
        f"{(~other).sum()} climbs end at constant kicks{elsewhere}"
    )
    claim = "Constant kicks hold a barrier longest at equal rms strength:"
    return finding(claim, words, beaten == 0)


def _examples(cube):
    two = cube.isel(forcing=np.flatnonzero(cube.period == 2)).sortby("parameter")
    parts = [
        f"{100 * d:g}% cost {100 * loss:.2g}%"
        for d, loss in zip(two.parameter.values, two.loss.values, strict=True)
        if loss == loss and d in (1e-4, 1e-3, 1e-2, 1e-1)
    ]
    return f"of alternating ripples {', '.join(parts)}."
