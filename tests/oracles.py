"""Slow and obvious implementations, and arithmetic of many digits, to compare the package with."""

import math
import tomllib
from itertools import chain, cycle, islice
from pathlib import Path

import mpmath
import numpy as np
from numba import njit
from scipy.linalg import eigvalsh_tridiagonal

from nasm import periodic
from nasm.circles import fourier
from nasm.numbers import as_rotation_number, convergents
from workflows.claims.circles import invariance

LITERATURE = tomllib.loads(Path(__file__).with_name("literature.toml").read_text())
KAPPA_G = LITERATURE["kappa_G"]["value"]


@njit
def kick(kappa, x, y):
    """S_κ, Eq. (6), by the library's sine of radians."""
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
    """The definition of n*, one orbit after the other."""
    kappa = np.asarray(kappa, dtype=float)
    starts = zip(x, y, strict=True)
    return np.array([_escape_time(kappa, x0, y0, n_max, *window) for x0, y0 in starts])


def second_variation(kappa, site, x, y, n):
    """The smallest eigenvalue of the action's, over the sites |k| < n about the start (x, y)."""
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
    """T at mpmath's working precision."""
    for strength in kappa:
        y = y + mpmath.mpf(strength) / (2 * mpmath.pi) * mpmath.sinpi(2 * mpmath.mpf(x))
        x = x + y
    return x, y


def continued_fraction(prefix, tail, terms=400):
    """[prefix; (tail)] at mpmath's working precision, from its first `terms` partial quotients."""
    quotients = list(islice(chain(prefix, cycle(tail)), terms))
    value = mpmath.mpf(quotients[-1])
    for a in reversed(quotients[:-1]):
        value = a + 1 / value
    return value


def nearest_float(value):
    """An mpf rounded once, to double."""
    with mpmath.workprec(53):
        return float(+value)


def invariance_error(circle):
    """max |T∘K(θ) - K(θ + ω)|, by the map itself, on a grid that Newton's method did not use."""
    fine = fourier.resample(circle.u, 2 * circle.u.shape[-1])
    return np.abs(invariance(circle.omega, circle.kappa, fine)[2]).max()


def residues_fall(omega, kappa, q):
    """Whether the residues of minimax orbits fall, from the first convergent of period q or longer
    to that a tail further on, by half or more: False where an orbit is not found."""
    omega = as_rotation_number(omega)
    longer = [f for f in islice(convergents(omega), 100) if f.denominator >= q]
    pair = longer[0], longer[len(omega.tail)]
    first, last = (periodic.residue(kappa, *f.as_integer_ratio()) for f in pair)
    return last <= first / 2 < 0.5
