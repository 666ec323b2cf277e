"""The response of critical golden orbits to a ripple, and the exponent that follows from it.

Near the critical golden circle of constant kicks, the distance to κ_G grows by the factor
δ = 1.62795 from one convergent to the next, and a ripple grows by a factor λ, which this module
measures. The fraction by which a ripple of amplitude d lowers the threshold therefore scales like
d^(ln δ/ln λ).

For constant kicks the residue of a periodic orbit x_n is R = -det H/4, where H is the cyclic
tridiagonal matrix with 2 + κ_n cos 2πx_n on the diagonal and -1 next to it. Changes dκ_n move the
orbit by dx, the solution of H dx = -sin(2πx_n)/(2π)·dκ_n. A ripple that repeats after P kicks
changes R to first order only if P divides the period of the orbit. Renormalise h times, where F_h
is the first Fibonacci number that P divides: kick n becomes kick F_{h+1}·n, and the ripple
cos 2πkn/P of mode k becomes the ripple of mode ±F_{h+1}·k; for some odd P its sign changes. Along a
cycle of such modes (mode 1 alone, except for P = 5 and 8) the response grows by the factor λ per
renormalisation on average.
"""

from functools import cache
from itertools import count

import numpy as np
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from nasm import periodic
from nasm.action import ordered_orbits
from nasm.circles.continuation import UNSTABLE_EIGENVALUES
from nasm.numbers import moebius, parse

DELTA = UNSTABLE_EIGENVALUES[1,]
_MAX_N = 25  # F_25 = 75 025; for longer periods, R is lost in rounding errors


@cache
def golden():
    """Return κ_G, at which the golden circle of constant kicks breaks, computed by residues."""
    return periodic.critical_scale("gamma", (1.0,)).value


def fibonacci(n):
    """Return F_n."""
    return round(((1 + 5**0.5) / 2) ** n / 5**0.5)


@cache
def orbits(n):
    """Return the minimizing and the minimax Orbit of F_{n-1}/F_n under constant kicks κ_G."""
    return ordered_orbits((golden(),), fibonacci(n - 1), fibonacci(n))


def response(orbit, f):
    """Return dR/dd of a constant-kick orbit under κ_G(1 + d·f_n); f has the orbit's period."""
    x = orbit.sites()
    moved = splu(_ring(x, 1.0)).solve(-golden() * f * np.sin(2 * np.pi * x) / (2 * np.pi))
    step = 1e-30j  # for complex-step differentiation
    pivots = splu(_ring(x + step * moved, 1 + step * f)).U.diagonal()
    return orbit.residue * np.sum(pivots.imag / pivots.real) / step.imag


def _ring(x, strength):
    ring, q = 2 + golden() * strength * np.cos(2 * np.pi * x), x.size
    at = {"offsets": [0, 1, -1, q - 1, 1 - q], "shape": (q, q)}
    return csc_array(diags_array([ring, -1, -1, -1, -1], **at))


def steps(period):
    """Return the smallest h with F_h = 0 mod P."""
    return next(h for h in count(1) if fibonacci(h) % period == 0)


def finer(circle, period, mode):
    """Return the circle and the mode that h renormalisations map to the given ones.

    Circles are given as text, with ω per period.
    """
    omega, h = parse(circle), steps(period)
    a, b, c = map(fibonacci, (h - 1, h, h + 1))
    sign = 1 if float(omega) > period / 2 else -1  # use ω per kick or 1 - ω, whichever is near γ
    per_kick = moebius(omega, sign, period * (sign < 0), 0, period)
    image = next(k for k in range(1, period) if k * c % period in (mode, period - mode))
    return str(moebius(per_kick, period * a, period * b, b, c)), min(image, period - image)


def modes(period):
    """List the cycle of modes that begins with 1."""
    cycle = [1]
    while (mode := finer("gamma", period, cycle[-1])[1]) != 1:
        cycle.append(mode)
    return cycle


def growth(period, mode):
    """Return the growth of ln |response| in h renormalisations, and whether the sign changes.

    The growth is returned first for the longest orbits, then for the next shorter ones; the latter
    value is NaN if there are no shorter orbits.
    """
    h, (_, image) = steps(period), finer("gamma", period, mode)
    pairs = [
        (_responses(n, period, image), _responses(n - h, period, mode))
        for n in range(_MAX_N // h * h, h, -h)[:2]
    ]
    rates = [np.log(np.linalg.norm(one) / np.linalg.norm(two)) for one, two in pairs]
    turned = np.cos(period * np.angle(pairs[0][0][1] / pairs[0][1][1]))  # 1 or -1
    return rates[0], *(rates[1:] or [np.nan]), period % 2 == 1 and turned < 0


@cache
def _responses(n, period, mode):
    """Return the responses of `orbits` to a ripple exp(2πi·mode·n/P); the first site has n = 0."""
    phase = 2 * np.pi * mode / period * np.arange(fibonacci(n))
    parts = [[response(orbit, wave(phase)) for wave in (np.cos, np.sin)] for orbit in orbits(n)]
    return np.array(parts) @ [1, 1j]
