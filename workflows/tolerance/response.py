"""How critical golden orbits respond to a ripple: the exponent that renormalisation predicts.

Next to the critical golden circle of constant kicks the distance to κ_G grows by δ = 1.62795 from
one convergent to the next, and a ripple by some λ, measured here, so that losses go like d^(ln δ/
ln λ).

R of a periodic orbit x_n of constant kicks is -det H/4, H the ring of 2 + κ_n cos 2πx_n and -1's,
and the orbit itself moves with κ_n by H dx = -sin(2πx_n)/(2π)·dκ_n. A ripple of P kicks moves R, to
first order, only if P divides the orbit's period. Renormalise h times, F_h the first Fibonacci
number that P divides: kick n is kick F_{h+1}·n then, and the ripple cos 2πkn/P is that of the mode
±F_{h+1}·k, for some odd P with the other sign, which matters then. Along a cycle of such modes (of
1 alone but for P = 5 and 8) the response grows by λ in each step.
"""

from functools import cache

import numpy as np
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from nasm import periodic
from nasm.action import ordered_orbits
from nasm.circles.continuation import UNSTABLE
from nasm.numbers import moebius, parse

DELTA = UNSTABLE[1,]
_LONGEST = 80_000  # period, beyond which rounding hides R


@cache
def golden():
    """Return κ_G, where the golden circle of constant kicks breaks, by residues."""
    return periodic.critical_scale("gamma", (1.0,)).value


@cache
def orbits():
    """Return {n: (minimizing, minimax Orbit)} of the Fibonacci numbers F_n from 3 on."""
    found, p, q = {}, 2, 3
    while q < _LONGEST:
        found[len(found) + 4] = ordered_orbits((golden(),), p, q)
        p, q = q, p + q
    return found


def response(orbit, f):
    """Return dR/dd of an orbit of constant kicks under κ_G(1 + d·f_n), f of the orbit's period."""
    x = orbit.sites()
    moved = splu(_ring(x, 1.0)).solve(-golden() * f * np.sin(2 * np.pi * x) / (2 * np.pi))
    step = 1e-30j  # of a derivative by complex numbers
    pivots = splu(_ring(x + step * moved, 1 + step * f)).U.diagonal()
    return orbit.residue * np.sum(pivots.imag / pivots.real) / step.imag


def _ring(x, strength):
    ring, q = 2 + golden() * strength * np.cos(2 * np.pi * x), x.size
    at = {"offsets": [0, 1, -1, q - 1, 1 - q], "shape": (q, q)}
    return csc_array(diags_array([ring, -1, -1, -1, -1], **at))


def renormalisation(period):
    """Return h, and the Fibonacci numbers F_{h-1}, F_h, F_{h+1}: the first h with F_h = 0 mod P."""
    before, here, h = 0, 1, 1
    while here % period:
        before, here, h = here, before + here, h + 1
    return h, (before, here, before + here)


def finer(circle, period, mode):
    """Return the circle, its text per period, and the mode of the ripple, that look like the given
    ones after h renormalisations."""
    _, (a, b, c) = renormalisation(period)
    omega = parse(circle)
    sign = 1 if float(omega) > period / 2 else -1  # of ω per kick, or 1 - ω: the one next to γ
    per_kick = moebius(omega, sign, period * (sign < 0), 0, period)
    image = next(k for k in range(1, period) if k * c % period in (mode, period - mode))
    return str(moebius(per_kick, period * a, period * b, b, c)), min(image, period - image)


def modes(period):
    """List the cycle of modes that begins with 1."""
    found = [1]
    while (mode := finer("gamma", period, found[-1])[1]) != 1:
        found.append(mode)
    return found


def growth(period, mode):
    """Return by how much ln of the response grows as `finer` is undone, of the longest orbits and
    of those before, NaN where there are none; and whether ripples of odd P change their sign."""
    h, coarse = renormalisation(period)[0], _responses(period, mode)
    fine = _responses(period, finer("gamma", period, mode)[1])
    pairs = [(fine[n], coarse[n - h]) for n in fine if n - h in coarse]
    steps = [np.nan, *(np.log(np.linalg.norm(one) / np.linalg.norm(two)) for one, two in pairs)]
    turned = np.cos(period * np.angle(pairs[-1][0][1] / pairs[-1][1][1]))  # 1 or -1
    return steps[-1], steps[-2], period % 2 == 1 and turned < 0


@cache
def _responses(period, mode):
    """{n: (minimizing, minimax)} of F_n: to a ripple exp(2πi·mode·n/P), from the first site on."""
    found = {}
    for n, both in orbits().items():
        phase = 2 * np.pi * mode / period * np.arange(both[0].sites().size)
        if phase.size % period == 0:
            waves = np.cos(phase), np.sin(phase)
            parts = [[response(orbit, wave) for wave in waves] for orbit in both]
            found[n] = np.array(parts) @ [1, 1j]
    return found
