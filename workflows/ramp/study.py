"""Lifetimes of families of invariant graphs, and escapes: in ramps, and by smoothness."""

import numpy as np

from nasm import escape
from nasm.barriers import critical_scale
from nasm.circles.continuation import UNSTABLE_EIGENVALUES
from nasm.converse_kam import aperiodic
from nasm.numbers import parse
from pipeline.cubes.cube import text
from workflows.shared import power_law
from workflows.shared.judgement import finding, span
from workflows.shared.tables import dataset

_GOLDEN = float(parse("gamma"))
EXPONENT = np.log(_GOLDEN) / (np.log(_GOLDEN) - np.log(UNSTABLE_EIGENVALUES[1,]))
"""Of the kicks ~ r^-0.497: times grow by 1/γ for each factor δ of κ - κ_G, r by δ/γ."""

ESCAPES = power_law.FLUX / (1 + power_law.FLUX)
"""Of the kicks ~ r^-0.751 at which the first orbit is through: the flux ~ (rn)^3.01, summed up."""

_PLACES = np.array([0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3])  # of the line, in r^-0.497 kicks
JUMPS = "square", "Fibonacci", "Thue-Morse", "random"
SMOOTH = "cosine", "k^-4", "k^-3", "k^-2"


def ramps(rates):
    """Find how long barriers persist under κ_n = κ_G + r·n: a Dataset with the dim rate."""
    critical = critical_scale((1.0,), 1e-4).value
    patience = (6 * rates**-ESCAPES).astype(int)
    crossed = [_escape(critical + r * np.arange(n)) for r, n in zip(rates, patience, strict=True)]
    words = "kicks from κ_G until one of 64 orbits has crossed all circles"
    found = np.array([lost(critical, rate) for rate in rates])
    return dataset(
        "When barriers are excluded in a ramp",
        {"rate": (rates, "growth of κ per kick")},
        {
            "lost": ("rate", found, "kicks from κ_G until all graphs are excluded"),
            "escaped": ("rate", np.array(crossed), words),
        },
        {"critical_scale": critical, "exponents": [EXPONENT, ESCAPES]},
    )


def lost(critical, rate):
    """Return the kicks after κ_G until all graphs are excluded, on the line where it is first."""
    unit = rate**-EXPONENT
    n = np.arange(-int(5 * unit), int(5 * unit) + 1)

    def life(site):
        return aperiodic.longest_lived(critical + rate * (n + site), 0.0, n.size // 2)[2]

    return min(site + life(site) for site in np.unique(np.rint(_PLACES * unit).astype(int)))


def _escape(kappa):
    # Starts have y from 0 to 0.3: an escape is past all circles.
    return aperiodic.escape_time(kappa, 0.0, *escape.ensemble(64), (-1.0, 1.3)).min()


def irregular(ripples, kicks):
    """Find how long barriers last under κ_n = 0.3·(1 + ripple·f_n): dims (kind, ripple).

    life : the shortest of the lifetimes on eight lines in the middle of the kicks; escapes are
    looked for in 20 times as many kicks.
    """
    shapes = _shapes(np.arange(20 * kicks))
    kappas = [[0.3 * (1 + ripple * f) for ripple in ripples] for f in shapes.values()]

    def life(kappa):
        sites = kicks // 2 + 7 * np.arange(8)
        return min(aperiodic.longest_lived(kappa[:kicks], 0.0, site)[2] for site in sites)

    lives, crossed = ([list(map(found, row)) for row in kappas] for found in (life, _escape))
    dims, graphs = (
        ("kind", "ripple"),
        "kicks on either side until all families of graphs are excluded",
    )
    words = "kicks until one of 64 orbits has crossed all circles; inf if none has"
    kind = text("kind", shapes, "forcing, f_n")
    return dataset(
        "Lifetimes of barriers by the smoothness of the forcing",
        {"kind": kind, "ripple": (ripples, "largest deviation, relative")},
        {
            "life": (dims, np.array(lives), f"{graphs}; inf if they persist"),
            "escaped": (dims, np.array(crossed), words),
        },
        {"kicks": kicks},
    )


def _shapes(n):
    """Return {kind: f_n, from -1 to 1}."""
    phase, odd = n * _GOLDEN % 1, range(1, 60, 2)
    shapes = {"period two": 1 - 2 * (n % 2), "cosine": np.cos(2 * np.pi * phase)}
    for power in (4, 3, 2):
        waves = sum(np.cos(2 * np.pi * k * phase) / k**power for k in odd)
        shapes[f"k^-{power}"] = waves / sum(1 / k**power for k in odd)
    return shapes | {
        "square": np.where(phase < 0.5, 1, -1),
        "Fibonacci": np.where(phase < _GOLDEN, 1, -1),
        "Thue-Morse": np.where(np.bitwise_count(n) % 2, -1, 1),
        "random": np.random.default_rng(1).choice([-1, 1], n.size),
    }


def findings(ramp, lives):
    """Judge the predictions; lines of text."""
    jumps, smooth = (lives.sel(kind=[*kinds]) for kinds in (JUMPS, SMOOTH))
    gone, through = np.isfinite(jumps.life), np.isfinite(jumps.escaped)
    lived, crossed = (span(values, ".0f") for values in (jumps.life.values, jumps.escaped.values))
    kept, kicks = np.isinf(smooth.life) & np.isinf(smooth.escaped), lives.attrs["kicks"]
    return "\n".join([
        _power("graphs are excluded", ramp.lost, EXPONENT),
        _power("the first of 64 orbits crosses", ramp.escaped, ESCAPES),
        finding(
            "smoothness in the phase decides, not quasiperiodicity",
            "with jumps (square, Fibonacci, Thue-Morse and random kicks) graphs are excluded "
            f"within {lived} kicks under {int(gone.sum())} of {gone.size} forcings, and orbits "
            f"cross within {crossed} kicks under {int(through.sum())}; with Fourier coefficients "
            f"that fall like k^-2 or faster graphs persist for {kicks // 2} kicks and no orbit "
            f"crosses in {20 * kicks} kicks, under {int(kept.sum())} of {kept.size}",
            bool(gone.all() and through.all() and kept.all()),
            float(gone.mean()) > 0.5 and bool(kept.all()),
        ),
        "Not tried: decreasing ramps, circles other than the golden one, coloured noise.",
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
