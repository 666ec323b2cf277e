"""Lifetimes of invariant graphs and escape times, on ramps and against the forcing's smoothness."""

import numpy as np

from nasm import escape
from nasm.barriers import critical_scale
from nasm.converse_kam import aperiodic
from nasm.numbers import parse
from pipeline.cubes.cube import text
from workflows.shared import power_law
from workflows.shared.judgement import finding, span
from workflows.shared.ramps import EXPONENT, lost
from workflows.shared.tables import dataset

ESCAPES = power_law.FLUX / (1 + power_law.FLUX)
"""Predicted exponent 0.751: the first orbit has crossed after ~ r^-0.751 kicks.

It follows from the flux ~ (rn)^3.01, summed over the kicks.
"""

_GOLDEN = float(parse("gamma"))
JUMPS = "square", "Fibonacci", "Thue-Morse", "random"
SMOOTH = "cosine", "k^-4", "k^-3", "k^-2"


def ramps(rates):
    """Find how long barriers persist under κ_n = κ_G + r·n; return a Dataset with the dim rate."""
    critical = critical_scale((1.0,), 1e-4).value
    patience = (6 * rates**-ESCAPES).astype(int)
    crossed = [_escape(critical + r * np.arange(n)) for r, n in zip(rates, patience, strict=True)]
    label = "kicks from κ_G until one of 64 orbits has crossed all circles"
    excluded = np.array([lost(critical, rate) for rate in rates])
    return dataset(
        "When barriers are excluded in a ramp",
        {"rate": (rates, "growth of κ per kick")},
        {
            "lost": ("rate", excluded, "kicks from κ_G until all graphs are excluded"),
            "escaped": ("rate", np.array(crossed), label),
        },
        {"critical_scale": critical, "exponents": [EXPONENT, ESCAPES]},
    )


def _escape(kappa):
    # Starts have y from 0 to 0.3, so that an orbit that escapes has crossed all circles.
    return aperiodic.escape_time(kappa, 0.0, *escape.ensemble(64), (-1.0, 1.3)).min()


def irregular(ripples, kicks):
    """Find how long barriers persist under κ_n = 0.3·(1 + ripple·f_n), by (kind, ripple).

    life : the shortest lifetime on eight lines, one at each of eight sites near the middle kick.
    Escapes are sought over 20 times as many kicks.
    """
    shapes = _shapes(np.arange(20 * kicks))
    kappas = [[0.3 * (1 + ripple * f) for ripple in ripples] for f in shapes.values()]

    def lifetime(kappa):
        sites = kicks // 2 + 7 * np.arange(8)
        return min(aperiodic.longest_lived(kappa[:kicks], 0.0, site)[2] for site in sites)

    lifetimes, crossed = ([list(map(f, row)) for row in kappas] for f in (lifetime, _escape))
    dims, graphs = (
        ("kind", "ripple"),
        "kicks in each direction until all families of graphs are excluded",
    )
    label = "kicks until one of 64 orbits has crossed all circles; inf if none has"
    kind = text("kind", shapes, "forcing, f_n")
    return dataset(
        "Lifetimes of barriers by the smoothness of the forcing",
        {"kind": kind, "ripple": (ripples, "largest relative deviation")},
        {
            "life": (dims, np.array(lifetimes), f"{graphs}; inf if they persist"),
            "escaped": (dims, np.array(crossed), label),
        },
        {"kicks": kicks},
    )


def _shapes(n):
    """Return {kind: f_n}, where -1 ≤ f_n ≤ 1."""
    phase, odd = n * _GOLDEN % 1, range(1, 60, 2)
    shapes = {"period two": 1 - 2 * (n % 2), "cosine": np.cos(2 * np.pi * phase)}

    def waves(phase, power):
        # The terms are NumPy numbers; from Python 3.12 on, sum() rounds Python floats differently.
        return sum(np.cos(2 * np.pi * k * phase) / k**power for k in odd)

    for power in (4, 3, 2):
        shapes[f"k^-{power}"] = waves(phase, power) / waves(0.0, power)
    return shapes | {
        "square": np.where(phase < 0.5, 1, -1),
        "Fibonacci": np.where(phase < _GOLDEN, 1, -1),
        "Thue-Morse": np.where(np.bitwise_count(n) % 2, -1, 1),
        "random": np.random.default_rng(1).choice([-1, 1], n.size),
    }


def findings(ramp, irregular):
    """Judge the predictions; return lines of text."""
    jumps, smooth = (irregular.sel(kind=[*kinds]) for kinds in (JUMPS, SMOOTH))
    excluded, through = np.isfinite(jumps.life), np.isfinite(jumps.escaped)
    lifetimes, crossed = (
        span(values, ".0f") for values in (jumps.life.values, jumps.escaped.values)
    )
    persist, kicks = np.isinf(smooth.life) & np.isinf(smooth.escaped), irregular.attrs["kicks"]
    return "\n".join([
        _power("graphs are excluded", ramp.lost, EXPONENT),
        _power("the first of 64 orbits crosses", ramp.escaped, ESCAPES),
        finding(
            "smoothness in the phase, not quasiperiodicity, decides whether barriers persist",
            "with jumps (square, Fibonacci, Thue-Morse and random kicks) graphs are excluded "
            f"within {lifetimes} kicks under {int(excluded.sum())} of {excluded.size} forcings, "
            f"and orbits cross within {crossed} kicks under {int(through.sum())}; with Fourier "
            f"coefficients that fall like k^-2 or faster, graphs persist for {kicks // 2} kicks "
            f"and no orbit crosses in {20 * kicks} kicks, under {int(persist.sum())} of "
            f"{persist.size}",
            bool(excluded.all() and through.all() and persist.all()),
            float(excluded.mean()) > 0.5 and bool(persist.all()),
        ),
        "Not studied: decreasing ramps, circles other than the golden one, coloured noise.",
    ])  # fmt: skip


def _power(claim, kicks, predicted):
    slope, error = power_law.exponent(kicks.rate.values, kicks.values)
    return finding(
        f"{claim} ~ r^-{predicted:.3f} kicks after κ_G",
        f"the exponent is {-slope:.3f} ± {error:.3f} for {int(np.isfinite(kicks).sum())} rates "
        f"from {float(kicks.rate.max()):.0e} to {float(kicks.rate.min()):.0e}",
        abs(slope + predicted) < 2 * error < 0.04,
        abs(slope + predicted) < 0.06,
        bool(np.isfinite(slope)),
    )
