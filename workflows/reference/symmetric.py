"""Periodic orbits on symmetry lines by shooting: a second method for the orbits of `nasm.action`.

Under a forcing that is the same forwards and backwards from its first kick, the orbit through
x_0 = 0 or x_0 = 1/2 is its own mirror image, x_n + x_{-n} = 2x_0, for every momentum y before that
kick. This orbit closes after q periods (N = Pq kicks) and p turns if it also satisfies, halfway,

    x_h + x_{N-h} = 2x_0 + p,    h = ⌊N/2⌋.

This is one equation for y. Newton's method follows its solution from κ = 0, where y = p/N.
Neither the action nor the kernels of `nasm` are used.

The flux through the gaps of p/q follows from areas alone: the segment from a minimizing point to
the next minimax point and its image under T^q, which has the same ends, enclose the area ΔW_{p/q}.
It is the difference of the integrals ∫ y dx along the two curves, computed here by Gauss-Legendre
quadrature.
"""

from dataclasses import dataclass
from math import cos, floor, pi, sin

import numpy as np

EPSILON = np.finfo(float).eps


@dataclass(frozen=True)
class SymmetricOrbit:
    """A periodic orbit with rotation number p/q through a point on a symmetry line.

    Attributes
    ----------
    x, y : float
        The point on the symmetry line, before the first kick.
    residue, error : float
        Greene's residue, and the effect of rounding on it.
    """

    x: float
    y: float
    residue: float
    error: float


def symmetric_orbit(kappa, p, q, x, n_scales=200):
    """Return the SymmetricOrbit of p/q that starts at x = 0 or 1/2, continued from κ = 0."""
    if list(kappa[1:]) != list(kappa[:0:-1]):
        raise ValueError(
            f"kappa={kappa} is not the same forwards and backwards from its first kick"
        )
    n_kicks = len(kappa) * q
    y = p / n_kicks
    for scale in np.linspace(0, 1, n_scales + 1)[1:].tolist():
        strengths, change = [scale * k for k in kappa], np.inf
        for _ in range(50):
            step = _half_way_step(strengths, p, n_kicks, x, y)
            y, last_change, change = y - step, change, abs(step)
            if change < 4 * EPSILON or (change < 1e-10 and change >= last_change / 2):
                break
        else:
            return SymmetricOrbit(x, np.nan, np.nan, np.nan)
    shift = max(change, EPSILON)
    residue, size = _residue(kappa, n_kicks, x, y)
    ends = [_residue(kappa, n_kicks, x, y + d)[0] for d in (-shift, shift)]
    return SymmetricOrbit(x, y, residue, abs(ends[1] - ends[0]) + n_kicks * EPSILON * size)


def _half_way_step(kappa, p, n_kicks, x, y):
    """Return Newton's step for x_h + x_{N-h} = 2x_0 + p, to be subtracted from y."""
    at, momentum, slope_x, slope_y = x, y, 0.0, 1.0
    last, last_slope = at, slope_x
    for n in range((n_kicks + 1) // 2):
        last, last_slope = at, slope_x
        strength = kappa[n % len(kappa)]
        momentum += strength / (2 * pi) * sin(2 * pi * at)
        slope_y += strength * cos(2 * pi * at) * slope_x
        at, slope_x = at + momentum, slope_x + slope_y
    if n_kicks % 2 == 0:
        last, last_slope = at, slope_x
    return (at + last - 2 * x - p) / (slope_x + last_slope)


def _residue(kappa, n_kicks, x, y):
    """Return R, computed from the product of the tangent maps, and the norm of this product."""
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    for n in range(n_kicks):
        strength = kappa[n % len(kappa)]
        y += strength / (2 * pi) * sin(2 * pi * x)
        bend = strength * cos(2 * pi * x)
        c, d = c + bend * a, d + bend * b
        a, b = a + c, b + d
        x += y
    return (2 - a - d) / 4, float(np.linalg.norm([[a, b], [c, d]]))


def gap_flux(kappa, p, q):
    """Compute ΔW_{p/q} under one kick from areas, for odd q; return it and its error.

    The error is the difference from the result with fewer nodes, plus the area left open because
    the orbits do not close exactly, plus rounding errors.
    """
    # For odd q the minimizing orbit has a point on x = 0, and the minimax one on x = 1/2.
    low, high = (symmetric_orbit(kappa, p, q, x) for x in (0.0, 0.5))
    x, y, ends = low.x, low.y, []
    for _ in range(q):
        ends.append((x - floor(x), y))
        y += kappa[0] / (2 * pi) * sin(2 * pi * x)
        x += y
    x0, y0 = max(point for point in ends if point[0] < high.x)
    areas = []
    for n_nodes in (48, 64):
        nodes, weights = np.polynomial.legendre.leggauss(n_nodes)
        weights = np.pad(weights, 1)  # the ends of the segment have no weight
        t = np.pad((nodes + 1) / 2, 1, constant_values=(0, 1))
        x, y = x0 + t * (high.x - x0), y0 + t * (high.y - y0)
        slope_x, slope_y = high.x - x0, high.y - y0
        before = weights @ (y * slope_x) / 2
        for _ in range(q):
            bend = kappa[0] * np.cos(2 * pi * x)
            y = y + kappa[0] / (2 * pi) * np.sin(2 * pi * x)
            slope_y = slope_y + bend * slope_x
            x, slope_x = x + y, slope_x + slope_y
        areas.append(abs(weights @ (y * slope_x) / 2 - before))
        miss = np.abs(x[[0, -1]] - p - [x0, high.x]) @ np.abs(y[[0, -1]])
    return float(areas[1]), float(abs(areas[1] - areas[0]) + miss + EPSILON * abs(before))
