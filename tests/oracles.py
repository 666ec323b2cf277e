"""Slow, obvious implementations and multiprecision arithmetic to test the package against."""

import math
import tomllib
from itertools import chain, cycle, islice
from pathlib import Path

import mpmath
import numpy as np
from numba import njit
from scipy.linalg import eigvalsh_tridiagonal

from nasm import action
from nasm.numbers import as_rotation_number, convergents

LITERATURE = tomllib.loads(Path(__file__).with_name("literature.toml").read_text())
KAPPA_G = LITERATURE["kappa_G"]["value"]


@njit
def kick(kappa, x, y):
    """Apply S_κ, Eq. (6), using the standard library's sine in radians."""
    y = y + kappa / (2 * math.pi) * math.sin(2 * math.pi * x)
    return x + y, y


@njit
def _escape_time(kappa, x, y, n_max, lo, hi):
    for n in range(n_max + 1):
        if y < lo or y > hi:
            return float(n)
        for strength in kappa:
            x, y = kick(strength, x - math.floor(x), y)
    return math.inf


def escape_time(kappa, x, y, n_max, window=(-2.0, 2.3)):
    """Compute n* from its definition, one orbit after another."""
    kappa = np.asarray(kappa, dtype=float)
    starts = zip(x, y, strict=True)
    return np.array([_escape_time(kappa, x0, y0, n_max, *window) for x0, y0 in starts])


def second_variation(kappa, site, x, y, n):
    """Return the smallest eigenvalue of the second variation on the sites |k| < n around (x, y)."""
    at = [(site, x)]
    ahead, p, behind, q = x, y, x, y
    for k in range(1, n):
        ahead, p = kick(kappa[(site + k - 1) % len(kappa)], ahead, p)
        at.append((site + k, ahead))
        behind -= q
        q -= kappa[(site - k) % len(kappa)] / (2 * math.pi) * math.sin(2 * math.pi * behind)
        at.insert(0, (site - k, behind))
    diagonal = [2 + kappa[k % len(kappa)] * math.cos(2 * math.pi * x) for k, x in at]
    return eigvalsh_tridiagonal(np.array(diagonal), np.full(len(at) - 1, -1.0))[0]


def exact_step(kappa, x, y):
    """Apply T at mpmath's working precision."""
    for strength in kappa:
        y = y + mpmath.mpf(strength) / (2 * mpmath.pi) * mpmath.sinpi(2 * mpmath.mpf(x))
        x = x + y
    return x, y


def continued_fraction(prefix, tail, terms=400):
    """Return [prefix; (tail)] from `terms` partial quotients, at mpmath's working precision."""
    quotients = list(islice(chain(prefix, cycle(tail)), terms))
    value = mpmath.mpf(quotients[-1])
    for a in reversed(quotients[:-1]):
        value = a + 1 / value
    return value


def nearest_float(value):
    """Round an mpf to the nearest double, in a single rounding."""
    with mpmath.workprec(53):
        return float(+value)


def point(circle, theta):
    """Compute K(θ) by summing over all modes: x_0 = θ + u_0(θ), and y_0 = x_0 - x_{-1}."""
    n_kicks, n = circle.u.shape

    def deviation(site, theta):
        modes = np.fft.rfft(circle.u[site]) / n
        modes[1 : (n + 1) // 2] *= 2
        return (modes * np.exp(2j * np.pi * np.arange(modes.size) * theta)).sum().real

    first, before = deviation(0, theta), deviation(-1, theta - float(circle.omega))
    return theta + first, float(circle.omega) / n_kicks + first - before


def invariance_error(circle):
    """Return max |T∘K(θ) - K(θ + ω)| over 100 random θ, by the definitions of T and K."""
    worst = 0.0
    for theta in np.random.default_rng(3).uniform(size=100):
        x, y = point(circle, theta)
        for strength in circle.kappa:
            x, y = kick(strength, x, y)
        following = point(circle, theta + float(circle.omega))
        worst = max(worst, *np.abs(np.subtract((x, y), following)))
    return worst


@njit
def _residue_along(kappa, x, y, p):
    """Return R of the product of tangent maps along an orbit, and the largest error in a step.

    R is inf if the product overflows.
    """
    a, b, c, d, worst = 1.0, 0.0, 0.0, 1.0, 0.0
    for i in range(x.size):
        x1, y1 = x[i], y[i]
        for strength in kappa:
            stretch = strength * math.cos(2 * math.pi * x1)
            c, d = c + stretch * a, d + stretch * b
            a, b = a + c, b + d
            x1, y1 = kick(strength, x1, y1)
        j = (i + 1) % x.size
        ahead = p if j == 0 else 0
        worst = max(worst, abs(x1 - x[j] - ahead), abs(y1 - y[j]))
    return (2 - a - d) / 4 if math.isfinite(a + d) else math.inf, worst


def residue(kappa, p, q):
    """Return R of the ordered p/q minimax orbit; NaN if `action` does not find it.

    How `action` finds the orbit does not matter, because the orbit is checked here: it closes, its
    points are in the order of the rotation, and R > 0 up to rounding, whereas no minimizing orbit
    has R > 0.
    """
    try:
        _, minimax = action.ordered_orbits(kappa, p, q)
    except action.LostError:
        return math.nan
    x, y = minimax.points()
    value, error = _residue_along(np.asarray(kappa, float), x, y, p)
    assert error < 1e-9
    turns = np.arange(q) * p
    order = np.argsort(turns % q)
    assert (np.diff((x - turns // q)[order]) > -1e-9).all()
    assert value > -RESOLVED
    return value


RESOLVED = 1e-4  # error of residues computed in floats, for orbits of about 10⁴ kicks


def residues_fall(omega, kappa, q):
    """Return True if the residues of minimax orbits decrease, as they do if a circle exists.

    The residue of the first convergent of period q or longer must be below 1. It must at least
    halve, or vanish to rounding, by the convergent that lies one repetition of the tail further on.
    Return None if an orbit is not found, unless the residue of the longer convergent exceeds 1.
    """
    omega = as_rotation_number(omega)
    longer = [f for f in islice(convergents(omega), 100) if f.denominator >= q]
    pair = longer[0], longer[len(omega.tail)]
    first, last = (residue(kappa, *f.as_integer_ratio()) for f in pair)
    if last > 1:
        return False
    if math.isnan(first + last):
        return None
    return last <= max(first / 2, RESOLVED) and first < 1
