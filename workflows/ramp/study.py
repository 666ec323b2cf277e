"""Lives of families of graphs: in ramps through the breakup, and by the smoothness of a forcing."""

import numpy as np

from nasm.barriers import critical_scale
from nasm.circles import invariant_circle
from nasm.circles.continuation import UNSTABLE
from nasm.converse_kam import sequence
from nasm.numbers import parse
from workflows.shared import power_law
from workflows.shared.rules import finding
from workflows.shared.tables import dataset, listed

_GOLDEN = float(parse("gamma"))
EXPONENT = np.log(_GOLDEN) / (np.log(_GOLDEN) - np.log(UNSTABLE[1,]))
"""Of the kicks ~ r^-0.497: times grow by 1/γ for each factor δ of κ - κ_G, r by δ/γ."""

_PLACES = np.array([0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3])  # of the line, in r^-0.497 kicks
_REACH = 5  # in the same unit, kicks on either side
JUMPS = "square", "Fibonacci", "Thue-Morse", "random"
SMOOTH = "cosine", "k^-4", "k^-3", "k^-2"
_LARGE = 0.05  # ripples from which on jumps are foreseen to be seen
_MEAN, _LINES = 0.3, 8


def area_rate(critical):
    """Return dA/dκ of the area A = ∫ y dx under the golden circle of the standard map at κ_G."""
    kappas = critical - np.array([0.05, 0.03, 0.02, 0.012, 0.007])
    return np.polyval(np.polyder(np.polyfit(kappas, list(map(_area, kappas)), 2)), critical)


def _area(kappa):
    """The mean of y dx/dθ over the circle x = θ + u(θ), y = x(θ) - x(θ - ω)."""
    circle = invariant_circle("gamma", kappa)
    modes, omega = np.fft.rfft(circle.u[0]), float(circle.omega)
    turn = 2j * np.pi * np.arange(modes.size)
    y = omega + np.fft.irfft(modes * (1 - np.exp(-turn * omega)), circle.u[0].size)
    return (y * (1 + np.fft.irfft(turn * modes, circle.u[0].size))).mean()


def ramps(rates):
    """Find when no family of graphs is left in κ_n = κ_G + r·n: a Dataset with dims (way, rate).

    way 0 is the plain ramp. In way 1 the phases are accelerated, by which y falls from kick to kick
    as the area under the golden circle does. lost : the kick after κ_G by which they are lost, on
    the line that denies them first; site : the kick before which that line is; life : kicks on
    either side of it.
    """
    critical = critical_scale((1.0,), 1e-4).value
    acceleration = area_rate(critical)
    found = np.array(
        [[_lost(critical, rate, way * acceleration * rate) for rate in rates] for way in (0, 1)]
    )
    dims = "way", "rate"
    variables = {
        "lost": (dims, found[..., 0], "kicks from κ_G until no family of graphs is left"),
        "site": (dims, found[..., 1], "kick from κ_G before which the line is that denies them"),
        "life": (dims, found[..., 2], "kicks on either side of the line"),
    }
    ways = listed("way", "plain ramp", "following the golden circle")
    attrs = {"critical_scale": critical, "area_rate": acceleration}
    coords = {"way": ways, "rate": (rates, "growth of κ per kick")}
    return dataset("When graphs are lost in a ramp", coords, variables, attrs)


def _lost(critical, rate, acceleration):
    """The least of site + life over lines, and both."""
    unit = rate**-EXPONENT
    n = np.arange(-int(_REACH * unit), int(_REACH * unit) + 1)
    lives = []
    for site in np.unique(np.rint(_PLACES * unit).astype(int)):
        theta = acceleration / 2 * n * (n + 2.0 * site)  # and linear terms, which shift y
        life = sequence.longest_lived(critical + rate * (n + site), theta, n.size // 2)[2]
        lives.append((site + life, site, life))
    return min(lives)


def irregular(ripples, kicks):
    """Find how long graphs last under κ_n = 0.3·(1 + ripple·f_n): dims (kind, ripple).

    life : kicks on either side of the line that denies them first, of eight in the middle of all
    kicks; inf if a start survives on each.
    """
    shapes = _shapes(np.arange(kicks))
    sites = kicks // 2 + 7 * np.arange(_LINES)
    lives = [
        [
            min(sequence.longest_lived(_MEAN * (1 + ripple * f), 0.0, site)[2] for site in sites)
            for ripple in ripples
        ]
        for f in shapes.values()
    ]
    coords = {"kind": listed("kind", *shapes), "ripple": (ripples, "largest deviation, relative")}
    label = "kicks on either side until no family of graphs is left; inf if they last"
    variables = {"life": (("kind", "ripple"), np.array(lives), label)}
    title = "Lives of graphs by the smoothness of the forcing"
    return dataset(title, coords, variables, {"kicks": kicks})


def _shapes(n):
    """Return {kind: f_n, from -1 to 1}."""
    phase, odd = n * _GOLDEN % 1, np.arange(1, 200, 2)[:, None]
    waves = np.cos(2 * np.pi * odd * phase)
    parity = np.array([bin(i).count("1") % 2 for i in n])
    shapes = {"period two": 1 - 2 * (n % 2), "cosine": waves[0]}
    for power in (4, 3, 2):
        shapes[f"k^-{power}"] = (waves / odd**power).sum(axis=0) / (1 / odd**power).sum()
    shapes["square"] = np.where(phase < 0.5, 1, -1)
    shapes["Fibonacci"] = np.where(phase < _GOLDEN, 1, -1)
    shapes |= {"Thue-Morse": 1 - 2 * parity}
    return shapes | {"random": np.random.default_rng(1).choice([-1, 1], n.size)}


def findings(ramp, lives):
    """Judge what was foreseen; lines of text."""
    said = []
    for way, name in enumerate(("plain", "following the golden circle")):
        slope, error = power_law.exponent(ramp.rate.values, ramp.lost.isel(way=way).values)
        known = np.isfinite(ramp.lost.isel(way=way))
        said.append(
            finding(
                f"Graphs are lost ~ r^-{EXPONENT:.3f} kicks after κ_G, ramp {name}:",
                f"the exponent is {-slope:.3f} ± {error:.3f} in {int(known.sum())} rates from "
                f"{float(ramp.rate.max()):.0e} to {float(ramp.rate.min()):.0e}",
                abs(slope + EXPONENT) < 2 * error < 0.04,
                abs(slope + EXPONENT) < 0.06,
                np.isfinite(slope),
            )
        )
    jumps, smooth = (
        lives.life.isel(kind=[list(lives.kind.attrs["names"]).index(kind) for kind in kinds])
        for kinds in (JUMPS, SMOOTH)
    )
    lost, kept = np.isfinite(jumps), np.isinf(smooth)
    large = lost.sel(ripple=lives.ripple >= _LARGE)
    said.append(
        finding(
            "Smoothness in the phase decides, not quasi-periodicity:",
            f"with jumps, square or Fibonacci, graphs are lost in {_range(jumps)} kicks under "
            f"{int(lost.sum())} of {lost.size} forcings, as with Thue-Morse and random ones; with "
            f"coefficients like k^-2 or smaller they last {lives.attrs['kicks'] // 2} kicks under "
            f"{int(kept.sum())} of {kept.size}",
            bool(large.all() and kept.all()),
            bool(large.all()) and float(kept.mean()) > 0.5,
        )
    )
    return "\n".join(said)


def _range(values):
    known = values.values[np.isfinite(values.values)]
    return f"{known.min():.0f} to {known.max():.0f}" if known.size else "no number of"
