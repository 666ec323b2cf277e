"""Fields of the self-consistent map, barriers in them, and an asymptotic circle."""

from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import numpy as np
from dask.system import CPU_COUNT
from scipy.signal import welch

from nasm import circles, escape
from nasm.circles import fourier
from nasm.converse_kam import aperiodic
from nasm.maps import TWO_PI, kick, rotating_forcing
from nasm.numbers import parse
from nasm.self_consistent import evolve, momentum
from workflows.shared.tables import columns, dataset

AMPLITUDE, BAND = 1e-4, 0.3 / TWO_PI  # initial amplitude of the wave, initial range of y
_SEGMENT = 1024  # kicks per segment; the spectra of all segments are averaged
_SLOWEST = 1 / 64  # turns per kick; slower changes count as drift
_LONGEST_PERIOD = 34  # largest period of the fitted forcing
_SHOWN = 4096  # number of particles stored
_ORBIT = 2000  # number of points of an orbit that are stored
_BEST, _EFFORT = 3, 8  # number of best lines searched again, and the effort of that search

# Settings for the asymptotic circle under the forcing κ_n = limit + excess·e^(-n/time).
LIMIT, EXCESS, TIME, POINTS, ASKED = 0.9, 0.5, 5, 8192, 5

_VERDICTS = {
    "mean": "mean of κ_n",
    "deviation": "standard deviation of κ_n",
    "drift": "mean advance of θ_n per kick",
    "frequency": "Ω of the fitted κ̄ + Δκ cos 2π(φ0 + nΩ)",
    "modulation": "Δκ of the fitted forcing",
    "kicks": "kicks that eliminate all starts in the recorded field",
    "kicks_fitted": "kicks that eliminate all starts in the fitted forcing",
    "omega": "turns per kick of the longest-lived start",
    "escape": "kicks until the first particle has escaped",
}


def fields(couplings, n_particles, n_max):
    """Iterate the self-consistent map for each coupling.

    The Dataset contains kappa, theta (coupling, kick); spectrum (coupling, frequency), the spectrum
    of the second half of kappa; x, y (coupling, particle) after the last kick, x relative to the
    phase of the wave; and escape (coupling), the kick after which the first of these particles has
    moved by more than 2 in y, inf if none has.
    """
    couplings = np.unique(couplings)
    x, y = escape.ensemble(n_particles)
    y = BAND * (2 * y / 0.3 - 1)

    weights, shown = couplings / n_particles, (x[:_SHOWN], y[:_SHOWN], (-2 - BAND, 2 + BAND))
    with ThreadPoolExecutor(CPU_COUNT) as threads:  # one for each CPU that this job may use
        runs = list(threads.map(lambda weight: evolve(x, y, weight, AMPLITUDE, n_max), weights))
    kappa = np.array([run.kappa for run in runs])
    theta = np.unwrap([run.theta for run in runs], period=1)
    frequency, spectra = welch(kappa[:, n_max // 2 :], nperseg=_SEGMENT, scaling="spectrum")
    escapes = [aperiodic.escape_time(run.kappa, run.theta, *shown) for run in runs]
    change = [
        momentum(run.y, weight, run.kappa[-1]) - momentum(y, weight, AMPLITUDE)
        for run, weight in zip(runs, weights, strict=True)
    ]
    from_phase = [(run.x[:_SHOWN] - run.phase) % 1 for run in runs]
    per_kick, per_particle = ("coupling", "kick"), ("coupling", "particle")
    escaped = "kick after which the first particle has moved by more than 2 in y"
    spectrum = "power of κ_n in the second half of the kicks"
    conserved = "change of 2π Σγy + κ²/2, which is conserved"
    coords = {
        "coupling": (couplings, "Γ = Σγ, sum of the weights"),
        "kick": (range(n_max), "kick n"),
        "frequency": (frequency, "frequency in turns per kick"),
        "particle": (range(min(n_particles, _SHOWN)), "particle"),
    }
    variables = {
        "kappa": (per_kick, kappa, "strength κ_n"),
        "theta": (per_kick, theta, "phase θ_n on the lift, in turns"),
        "spectrum": (("coupling", "frequency"), spectra, spectrum),
        "x": (per_particle, from_phase, "x - θ mod 1 after the last kick"),
        "y": (per_particle, [run.y[:_SHOWN] for run in runs], "y after the last kick"),
        "escape": ("coupling", np.min(escapes, axis=1), escaped),
        "momentum_change": ("coupling", np.abs(change), conserved),
    }
    references = {"references": "arXiv:1601.00942; nasm/self_consistent.py"}
    return dataset("The self-consistent map", coords, variables, references)


def verdicts(fields):
    """Search for barriers by converse KAM in the recorded field, and in a fitted periodic one.

    Starts lie on lines just before kicks in the middle of the second half. `kicks` is the number of
    kicks in either direction until all starts on one of these lines are eliminated, inf if some
    survive. x, y (coupling, step) are the points of the orbit of the longest-lived start, in the
    frame of the wave.
    """
    half = fields.kick.size // 2
    frequencies = fields.frequency.values
    slow = frequencies < _SLOWEST
    rows, orbits = [], []
    for coupling in fields.coupling.values:
        field = fields.sel(coupling=coupling)
        kappa, theta = field.kappa.values[-half:], field.theta.values[-half:]
        frequency = frequencies[np.where(slow, 0, field.spectrum.values).argmax()]
        drift = np.polyfit(np.arange(half), theta, 1)[0]
        modulation = np.sqrt(2) * kappa.std()
        rotation = Fraction(frequency).limit_denominator(_LONGEST_PERIOD)
        periodic = rotating_forcing(kappa.mean(), modulation, rotation)
        # If minimizing orbits cross a line, starts on it survive: try one per kick of a period.
        sites = half // 2 + np.arange(periodic.size)
        lifetimes = [aperiodic.longest_lived(kappa, theta, int(site))[2] for site in sites]
        best = sites[np.argsort(lifetimes, kind="stable")[:_BEST]].tolist()
        searched = {site: aperiodic.longest_lived(kappa, theta, site, _EFFORT) for site in best}
        site = min(searched, key=lambda site: searched[site][2])
        orbit = _orbit(kappa, theta, site, *searched[site], drift)
        orbits.append(np.full((2, _ORBIT), np.nan))
        orbits[-1][:, : orbit.shape[1]] = orbit[:, :_ORBIT]
        repeated = periodic[(np.arange(half) - half // 2) % periodic.size]
        fitted = aperiodic.longest_lived(repeated, 0.0, half // 2, _EFFORT)[2]
        row = kappa.mean(), kappa.std(), drift, float(rotation), modulation, searched[site][2]
        rows.append([*row, fitted, orbit[1].mean() % 1, float(field.escape)])
    variables = columns("coupling", _VERDICTS, zip(*rows, strict=True))
    for name, values in zip("xy", np.stack(orbits, axis=1) % 1, strict=True):
        label = f"{name} of the orbit of the longest-lived start, in the frame of the wave"
        variables[name] = ("coupling", "step"), values, label
    settings = {"asked": half // 2, "horizon": aperiodic.HORIZON}
    coords = {"coupling": fields.coupling}
    return dataset("Barriers in the recorded field", coords, variables, settings)


def _orbit(kappa, theta, site, x, y, lifetime, drift):
    """Follow an orbit from before kick `site` to its elimination; return x - θ_n and y - drift."""
    end = int(min(site + lifetime, kappa.size))
    points = [(x, y)]
    for strength, phase in zip(kappa[site:end], theta[site:end], strict=True):
        points.append(kick(strength, *points[-1], phase))
    x, y = np.transpose(points[:-1])
    return np.array([x - theta[site:end], y - drift])


def settling():
    """Pull the golden circle of κ = 0.9 back through the kicks κ_n = 0.9 + 0.5 e^(-n/5).

    The three curves x, y, with dims (curve, point), are the pulled-back circle before the first
    kick, the pulled-back circle before kick `asked`, and the golden circle itself. excluded (point)
    is 1 if converse KAM, applied at the first kick, excludes the point of the first curve.
    """
    kappa = LIMIT + EXCESS * np.exp(-np.arange(40 * TIME) / TIME)
    angle = np.arange(POINTS) / POINTS
    x, y = circles.graph(circles.invariant_circle(parse("gamma"), (LIMIT,)))
    x = angle + fourier.resample(x - np.arange(x.size) / x.size, POINTS)
    y = fourier.resample(y, POINTS)
    curves = [aperiodic.asymptotic(kappa[n:], 0.0, LIMIT, x, y) for n in (0, ASKED)]
    excluded = np.isfinite(aperiodic.elimination_time(kappa, 0.0, 0, *curves[0]))
    xs, ys = np.stack([*curves, (x, y)], axis=1)
    slopes = 1 + fourier.derivative(xs - angle)
    dims, lifetime = ("curve", "point"), aperiodic.longest_lived(kappa, 0.0, ASKED)[2]
    variables = {
        "x": (dims, xs, "x on the lift"),
        "y": (dims, ys, "y"),
        "excluded": ("point", excluded.astype("int8"), "excluded by converse KAM"),
        "area": ("curve", np.mean(ys * slopes, axis=1), "area below the curve"),
        "kicks": ((), lifetime, f"kicks that eliminate all starts on a line before kick {ASKED}"),
    }
    coords = {"point": (angle, "angle θ of the circle, in turns")}
    settings = {"limit": LIMIT, "excess": EXCESS, "time": TIME, "asked": ASKED}
    return dataset("An asymptotic circle", coords, variables, settings)
