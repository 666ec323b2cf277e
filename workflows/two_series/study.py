"""Forcings and thresholds of `two_series`, resonances to first order, and the findings.

For a delay τ = a/q, the forcing κ = K·(1, 0, …, r, 0, …)/q has q entries, and r = K_α/K is the a-th
entry after the first (see `nasm.planes.pairs`). The scale of such a forcing is its strength K. To
first order, the resonance at p = k has the strength K|1 + r e^{2πikτ}|.
"""

from fractions import Fraction
from itertools import permutations, product

import numpy as np
import xarray as xr

from nasm.numbers import distinct_convergents, parse
from nasm.planes import pairs
from pipeline.cubes.barrier import with_circles
from pipeline.cubes.cube import coordinate, text
from workflows.shared.judgement import finding
from workflows.shared.tables import columns, dataset

RATIOS = {"K": 1.0, "K/2": 0.5, "-K": -1.0}  # name of K_α: the ratio K_α/K
PARAMETER = "delay τ of the second series, in periods"
IRRATIONAL = "[0;2,(1)]"  # the golden delay, (3 - √5)/2


def computed_ratio(delay, ratio):
    """Return the ratio r that is computed in place of `ratio`, and the shift of ω.

    If q is even, a is odd; then κ_n → (-1)ⁿκ_n maps r to -r and ω to ω + q/2.
    """
    is_image = delay.denominator % 2 == 0 and ratio < 0
    return (-ratio, delay.denominator // 2) if is_image else (ratio, 0)


def forcings(delays):
    """List the forcings to compute as (family, τ, profile); images by symmetry are left out."""
    return [
        (f"K_α = {name}", float(delay), pairs(delay).forcing(1.0, ratio).tolist())
        for delay, (name, ratio) in product(delays, RATIOS.items())
        if computed_ratio(delay, ratio)[0] == ratio
    ]


def thresholds(cube, delays):
    """Return the cube of `forcings` as a Dataset with dims (delay, ratio), including images."""
    names = {ratio: f"K_α = {name}" for name, ratio in RATIOS.items()}
    rows = list(zip(cube.family.values.tolist(), cube.parameter.values.tolist(), strict=True))
    places, shifts = [], []
    for delay, ratio in product(delays, RATIOS.values()):
        computed, shift = computed_ratio(delay, ratio)
        places.append(rows.index((names[computed], float(delay))))
        shifts.append(shift)
    images = with_circles(cube.isel(forcing=places), shifts)
    images["omega"] = images.omega.copy(data=np.where(shifts, shifts - images.omega, images.omega))
    coords = {
        "delay": text("delay", map(str, delays), "exact delay τ of the second series, in periods"),
        "tau": coordinate("delay", list(map(float, delays)), PARAMETER),
        "ratio": coordinate("ratio", list(RATIOS.values()), "K_α over K"),
    }
    dims, shape = ("delay", "ratio"), (len(delays), len(RATIOS))
    names = "critical_scale", "error", "lower", "upper", "omega", "status", "circle"
    variables = {
        name: xr.Variable(dims, images[name].values.reshape(shape), images[name].attrs)
        for name in names
    }
    long_name = "K_c, strength K (kicks at integer times) at which the last barrier breaks"
    variables["critical_scale"].attrs["long_name"] = long_name
    weakest = [[weakest_resonance(delay, r) for r in RATIOS.values()] for delay in delays]
    label = "strength over K of the weakest resonance, to first order"
    more = columns(dims, {"weakest": label}, [weakest])
    return dataset("Thresholds of two series of kicks", coords, variables | more)


def weakest_resonance(delay, ratio, window=None):
    """Compute min |1 + r e^{2πikτ}| over integers k, to 12 decimals.

    Parameters
    ----------
    delay : Fraction or float
        The delay τ; it must be a Fraction if `window` is None.
    ratio : float
        The ratio r.
    window : int, optional
        Largest |k|; by default, all k are included.
    """
    if window is None:  # kτ modulo 1 takes all values j/q
        turns = np.arange(delay.denominator) / delay.denominator
    else:  # the strengths at k and -k are equal
        turns = delay * np.arange(window + 1)
    return np.abs(1 + ratio * np.exp(2j * np.pi * turns)).min().round(12)


def by_delay(delays, curves):
    """Join the boundaries of several planes along the dim `delay`; `delays` are texts."""
    exact = text("delay", delays, "exact delay τ of the second series, in periods")
    return xr.concat(curves, exact, coords="all", combine_attrs="drop")


def findings(table):
    """Describe the thresholds, with a verdict on what the weakest resonance predicts."""
    width = ((table.upper - table.lower) / table.lower).values
    brackets = np.isfinite(width)
    widest = f", at most {100 * width[brackets].max():.2g}% wide" if brackets.any() else ""
    return " ".join([
        "K_c of two series of kicks, K at integer times and K_α a time τ later, in units of the "
        f"period, at {table.delay.size} delays a/q up to 1/2; τ and 1 - τ are equivalent. "
        "Bars are brackets between a certified circle and the bound of converse KAM; arrows mark "
        "the known end of a bracket whose other end is unknown. "
        f"{int(table.critical_scale.notnull().sum())} of {width.size} thresholds have a value, "
        f"{brackets.sum()} a bracket{widest}.",
        _order(table),
        _window(table),
    ])  # fmt: skip


def _order(table):
    """Judge whether K_c falls as the weakest resonance grows, and is lowest where that peaks."""
    follows, decided, lowest, places = 0, 0, [], []
    for name, ratio in RATIOS.items():
        part = table.sel(ratio=ratio)
        weakest, lower, upper = (part[key].values for key in ("weakest", "lower", "upper"))
        for i, j in permutations(range(weakest.size), 2):
            if weakest[i] > weakest[j]:
                follows += upper[i] < lower[j]
                decided += upper[i] < lower[j] or upper[j] < lower[i]
        strongest = weakest == weakest.max()
        if not strongest.all():  # NaN compares false: an open bracket is never shown to be lowest
            lowest.append(bool(upper[strongest].max() < lower[~strongest].min()))
            first = part.isel(delay=int(np.flatnonzero(strongest)[0]))
            places.append(f"{first.delay.item()} for K_α = {name} ({_value(first)})")
    least = table.lower.where(table.weakest == 0).min().item()
    bound = f"K_c is at least {least:.4g}" if np.isfinite(least) else "no circle is certified"
    claim = (
        "the last barrier breaks first at the delay whose weakest resonance, K|1 + r e^{2πikτ}| at "
        "p = k to first order, is strongest, and K_c decreases with its strength"
    )
    text = (
        f"it is strongest at {' and '.join(places)}, and K_c is lowest there in "
        f"{sum(lowest)} of {len(lowest)} cases; where a resonance vanishes, as at all τ for "
        f"K_α = -K, {bound}. Of {decided} pairs of delays with different "
        f"strengths and disjoint brackets, {follows} have the lower K_c at the larger strength; "
        "the strength of the weakest resonance alone does not explain the other pairs"
    )
    literal = all(lowest) and follows == decided
    return finding(claim, text, literal, all(lowest), known=decided > 0)


def _window(table):
    """State what a window of p shows if the delay is irrational."""
    tau, equal = float(parse(IRRATIONAL)), table.sel(ratio=1.0)
    known = [*map(str, distinct_convergents(IRRATIONAL, 64))]
    near = equal.isel(delay=np.flatnonzero(np.isin(equal.delay.values, known)))
    order = np.argsort([Fraction(each).denominator for each in near.delay.values])
    near = near.isel(delay=order)
    windows = sorted({Fraction(each).denominator // 2 for each in near.delay.values})
    strengths = ", ".join(f"{weakest_resonance(tau, 1.0, n):.2g}" for n in windows)
    values = ", ".join(map(_value, (near.isel(delay=i) for i in range(near.delay.size))))
    return (
        f"If τ is irrational, the map is not periodic in p: at τ = {IRRATIONAL} = {tau:.4f} and "
        f"K_α = K the weakest resonance with |p| ≤ {', '.join(map(str, windows))} has the strength "
        f"{strengths} in units of K, and outside any such window there are weaker resonances, with "
        "strengths down to 0. At the convergents "
        f"{', '.join(near.delay.values.tolist())} of τ, K_c is {values}. So transport that is "
        "global in a window of p excludes barriers only in that window, and a fraction can replace "
        "an irrational delay only in a window narrower than its denominator q. K_c for irrational "
        "delays was not computed."
    )


def _value(cell):
    """Return the K_c of a cell as text, or the upper end of its bracket."""
    value, upper = cell.critical_scale.item(), cell.upper.item()
    if np.isfinite(value):
        return f"{value:.4g}"
    return f"below {upper:.4g}" if np.isfinite(upper) else "unknown"
