"""How critical golden orbits respond to a ripple: the exponent that renormalisation predicts.

R of a periodic orbit x_n of constant kicks is -det H/4, H the ring of 2 + κ_n cos 2πx_n and -1's,
and the orbit itself moves with κ_n by H dx = -sin(2πx_n)/(2π)·dκ_n. A ripple of P kicks moves R, to
first order, only if P divides the orbit's period. There the response grows by λ from one Fibonacci
number to the next, once the ripple comes back to the same phases, up to its sign.
"""

from functools import cache

import numpy as np
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from nasm import periodic
from nasm.action import ordered_orbits
from nasm.circles.continuation import UNSTABLE

DELTA = UNSTABLE[1,]
_LONGEST = 50_000  # period, beyond which rounding hides R
_STEP = 1e-30  # of a derivative by complex numbers


@cache
def golden():
    """Return κ_G, where the golden circle of constant kicks breaks, by residues."""
    return periodic.critical_scale("gamma", (1.0,)).value


@cache
def orbits():
    """List (n, minimizing and minimax Orbit) of Fibonacci numbers, the n-th, from 3 on."""
    found, p, q, n = [], 2, 3, 4
    while q < _LONGEST:
        found.append((n, ordered_orbits((golden(),), p, q)))
        p, q, n = q, p + q, n + 1
    return found


def response(orbit, f):
    """Return dR/dd of an orbit of constant kicks under κ_G(1 + d·f_n), f of the orbit's period."""
    x = orbit.sites()
    moved = splu(_ring(x, 1.0)).solve(-golden() * f * np.sin(2 * np.pi * x) / (2 * np.pi))
    pivots = splu(_ring(x + 1j * _STEP * moved, 1 + 1j * _STEP * f)).U.diagonal()
    return orbit.residue * np.sum(pivots.imag / pivots.real) / _STEP


def _ring(x, strength):
    ring, q = 2 + golden() * strength * np.cos(2 * np.pi * x), x.size
    return csc_array(
        diags_array([ring, -1, -1, -1, -1], offsets=[0, 1, -1, q - 1, 1 - q], shape=(q, q))
    )


def repeat(period):
    """Return after how many Fibonacci numbers a ripple of P kicks is back at its phases or minus
    them, F_m = 0 and F_{m+1} = ±1 mod P."""
    a, b, m = 1, 1, 1
    while a % period or b % period not in (1, period - 1):
        a, b, m = b, a + b, m + 1
    return m


def growth(period):
    """Return ln λ of cosine ripples of P kicks, and by how much the last repeat changed it, NaN
    where there were fewer than three."""
    turn, sizes = 2 * np.pi / period, {}
    for n, both in orbits():
        phase = turn * np.arange(both[0].sites().size)
        if phase.size % period == 0:
            parts = [response(orbit, f(phase)) for orbit in both for f in (np.cos, np.sin)]
            sizes[n] = np.log(np.linalg.norm(parts))
    m = repeat(period)
    steps = [(sizes[n] - sizes[n - m]) / m for n in sizes if n - m in sizes]
    return steps[-1], abs(steps[-1] - steps[-2]) if len(steps) > 1 else np.nan
