"""The forcings of `patterns`, the resonances of pairs, and what is found of both."""

from math import gcd

import numpy as np

from nasm.periodic import residue
from workflows.figures.patterns import BURSTS, CONSTANT, FLIPS, PAIRS, SIGNS, of_family
from workflows.shared.rules import finding
from workflows.shared.tables import dataset, described

PARAMETER = f"ε of {PAIRS}, P of {SIGNS}, M of {FLIPS}, share of the period kicked in {BURSTS}"
_NEAR, _CLOSE = 0.05, 1 / 16  # of K_c to its limit, for pairs that close


def pair(p, q):
    """Return a pair of kicks p/q of the period apart."""
    return [1.0 if n in (0, p) else 0.0 for n in range(q)]


def patterns(quick):
    """List all forcings as (family, parameter, profile); few of them if `quick`."""
    apart = [(1, q) for q in (2, 3, 4, 6, 8)]
    signs, flips, bursts = (3, 4), (1, 3), [(3, 5), (4, 5)]
    if not quick:
        apart = [(p, q) for q in range(2, 9) for p in range(1, 1 + q // 2) if gcd(p, q) == 1]
        apart += [(1, q) for q in (9, 10, 11, 12, 16, 24, 48, 64)]
        signs, flips = range(3, 9), range(1, 6)
        bursts = [(n, q) for q in range(4, 8) for n in range(3, q)]
    return [
        (CONSTANT, 1, [1.0]),
        *((PAIRS, p / q, pair(p, q)) for p, q in apart),
        *((SIGNS, q, [1.0] * (q - 1) + [-1.0]) for q in signs),
        *((FLIPS, m, [1.0] * m + [-1.0] * m) for m in flips),
        *((BURSTS, n / q, [1.0] * n + [0.0] * (q - n)) for n, q in bursts),
    ]


def in_lab_units(cube):
    """Return the cube with thresholds in units of the period, as laboratories of pairs have them,
    and the rms strength of the kicks over that of constant ones."""
    per_period = (cube.critical_scale * cube.period).assign_attrs(
        described("K_c = P·s of a kick, in units of the period: its phase depth times 8ω_r·period")
    )
    rms = cube.critical_scale * np.sqrt((cube.profile**2).mean("kick"))
    golden = of_family(cube, CONSTANT).critical_scale.item()
    words = described("rms strength at the breakup over that of constant kicks")
    return cube.assign(per_period=per_period, robustness=(rms / golden).assign_attrs(words))


def resonances(spacings, strength=0.01):
    """Measure how strong the period-one resonances of pairs 1/P apart are, by their residues.

    spacings : ints P. Returns a Dataset with dims (spacing, resonance), NaN for resonance ≥ P.
    """
    k, spacings = np.arange(max(spacings)), np.array(spacings)
    found = np.full((spacings.size, k.size), np.nan)
    for row, q in zip(found, spacings.tolist(), strict=True):
        kappa = strength / q * np.array(pair(1, q))
        row[:q] = [4 / strength * residue(kappa, p, 1) for p in range(q)]
    order = 2 * np.abs(np.cos(np.pi * k / spacings[:, None])) + 0 * found
    dims, words = ("spacing", "resonance"), "strength of a resonance over K, 4R/K"
    coords = {
        "spacing": (spacings, "P, of pairs of kicks 1/P of the period apart"),
        "resonance": (k, "momentum, in turns per period"),
    }
    columns = {
        "strength": (dims, found, f"{words}, at K = {strength:g}"),
        "first_order": (dims, order, f"{words}, to first order in K"),
    }
    return dataset("Resonances of pairs of kicks", coords, columns, {"kick": strength})


def found(cube, driven):
    """Say what the cube and the resonances show, with a verdict on each claim."""
    pairs = of_family(cube, PAIRS).sortby("parameter")
    lower, upper = (pairs[side] * pairs.period for side in ("lower", "upper"))
    third = np.isclose(pairs.parameter, 1 / 3)
    K, others = pairs.per_period, pairs.per_period.values[~third]
    off = float(abs(driven.strength - driven.first_order).max())
    limit = K * np.sqrt(pairs.parameter / of_family(cube, CONSTANT).critical_scale.item())
    close = limit.values[(pairs.parameter <= _CLOSE) & limit.notnull()]
    known = cube.critical_scale.notnull()
    above = (cube.robustness * cube.lower / cube.critical_scale > 1 + 1e-9) & known
    alike = int((abs(cube.robustness - 1) < 1e-9).sum())
    return " ".join([
        f"Of {known.size} forcings {int(known.sum())} have a value, with brackets of "
        f"{100 * float(((cube.upper - cube.lower) / cube.critical_scale).median()):.2g}% in the "
        "median. K is in units of the period, κ in units of the time from kick to kick; with "
        "atoms K is the phase depth of a pulse times 8ω_r times that time, ω_r the recoil "
        "frequency.",
        finding(
            "Of all pairs those 1/3 of the period apart lose their last barrier first:",
            f"K_c = {K.values[third].item():.6g}, and {np.nanmin(others):.6g} or more for the "
            f"{others.size} other spacings",
            bool((upper.values[third] < lower.values[~third]).all()),
            bool((K.values[third] < others).all()),
            bool(np.isfinite(K.values).all()),
        ),
        finding(
            "Pairs 1/P apart drive the resonance at k like a standard map of 2K|cos πk/P|: at 1/3 "
            "none is weaker than K, which is why, and that at P/2 is missing for even P:",
            f"residues of {int(driven.strength.count())} orbits of period one, P = "
            f"{', '.join(map(str, driven.spacing.values))}, at K = {driven.attrs['kick']:g}, "
            f"deviate by up to {off:.2g}",
            off < driven.attrs["kick"],
        ),
        finding(
            "K_c approaches √(κ_G/ε) for close pairs:",
            f"from 1/{1 / _CLOSE:g} down to 1/{1 / float(pairs.parameter.min()):g} it is "
            f"{', '.join(f'{x:.3f}' for x in close[::-1])} of that",
            close.size > 2 and abs(close[0] - 1) < _NEAR and bool((np.diff(close) < 0).all()),
            close.size > 2 and bool((np.diff(close) < 0).all()),
            close.size > 0,
        ),
        finding(
            "No pattern outlasts constant kicks of the same rms strength:",
            f"{int(above.sum())} do of {int(known.sum())}, and {alike} are as robust, as their "
            "circles are the same up to symmetry",
            not above.any(),
        ),
        "Not tried: kicks of finite length, spacings that are no fractions with q ≤ 8 or 1/P, and "
        "quantum effects.",
    ])  # fmt: skip
