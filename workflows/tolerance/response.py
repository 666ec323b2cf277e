"""How critical golden orbits respond to a ripple: the exponent that renormalisation predicts.

R of a periodic orbit x_n of constant kicks is -det H/4, H the ring of 2 + κ_n cos 2πx_n and -1's,
and the orbit itself moves with κ_n by H dx = -sin(2πx_n)/(2π)·dκ_n. So, with h the diagonal of H⁻¹,

    d ln R/dκ_n = h_n cos 2πx_n + sin 2πx_n [H⁻¹ (κ h sin 2πx)]_n.

Its Fourier component at k/P turns a kick is the response to the part k of a ripple of P kicks. It
sums up over orbits whose period P divides, and grows by λ from one Fibonacci number to the next.
"""

from functools import cache

import numpy as np
from scipy.linalg import solve_banded

from nasm import periodic
from nasm.action import ordered_orbits
from nasm.circles.continuation import UNSTABLE

_LONGEST = 50_000  # period, beyond which rounding hides R


@cache
def golden():
    """Return κ_G, where the golden circle of constant kicks breaks, by residues."""
    return periodic.critical_scale("gamma", (1.0,)).value


@cache
def responses():
    """List (n, q, dR/dκ of the minimizing, and of the minimax orbit) of Fibonacci numbers q, the
    n-th."""
    found, p, q, n = [], 1, 2, 3
    while q < _LONGEST:
        both = [
            _response(orbit.sites(), orbit.residue) for orbit in ordered_orbits((golden(),), p, q)
        ]
        found.append((n, q, both))
        p, q, n = q, p + q, n + 1
    return found


def _response(x, residue):
    cosine, sine = np.cos(2 * np.pi * x), np.sin(2 * np.pi * x)
    diagonal, solve = _inverse(2 + golden() * cosine)
    return residue * (diagonal * cosine + sine * solve(golden() * diagonal * sine))


def _inverse(ring):
    """Return the diagonal of the inverse of a ring with -1's, and a function that applies it."""
    band = np.full((3, ring.size), -1.0)
    band[1] = ring
    band[1, 0] += ring[0]
    band[1, -1] += 1 / ring[0]
    corner = np.zeros(ring.size)
    corner[0], corner[-1] = -ring[0], -1.0
    away = solve_banded((1, 1), band, corner)
    weight = 1 + away[0] + away[-1] / ring[0]  # Sherman & Morrison

    def solve(right):
        inner = solve_banded((1, 1), band, right)
        return inner - away * (inner[0] + inner[-1] / ring[0]) / weight

    ahead, behind = band[1].copy(), band[1].copy()
    for n in range(1, ring.size):
        ahead[n] -= 1 / ahead[n - 1]
        behind[-1 - n] -= 1 / behind[-n]
    return 1 / (ahead + behind - band[1]) + away**2 / ring[0] / weight, solve


def response_growth(k, period):
    """Return numbers n of Fibonacci numbers that the period divides, and ln |dR/dd| there."""
    n, growth = [], []
    for number, q, both in responses():
        if q % period == 0:
            turn = np.exp(2j * np.pi * k * np.arange(q) / period)
            n.append(number)
            growth.append(np.log(np.linalg.norm([turn @ each for each in both])))
    return np.array(n), np.array(growth)


def predicted_exponent(f):
    """Return ln δ/ln λ of the ripple f, and by how much its last Fibonacci number changed it.

    Of the parts of f the one with the largest λ decides. NaN where there are fewer than 2 numbers,
    and no error where there are only 2.
    """
    period, best = f.size, (np.nan, np.nan)
    for k in np.flatnonzero(abs(np.fft.rfft(f)) > 1e-9 * period):
        n, growth = response_growth(int(k), period)
        back = 2 if n.size > 3 else 1  # parts k may come back only after twice the steps
        if n.size <= back:
            continue
        exponents = np.log(UNSTABLE[1,]) * (n[back:] - n[:-back]) / (growth[back:] - growth[:-back])
        last = exponents[-1], abs(exponents[-1] - exponents[-2]) if exponents.size > 1 else 0.0
        best = min(best, last) if np.isfinite(best[0]) else last
    return best
