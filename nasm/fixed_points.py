"""Period-one orbits of T_{κ1κ2}: fixed points mod 1, their residues and stability (Sec. IV).

Primary points exist for all strengths: (0, 0), (1/2, 0), (0, ±1/2), (1/2, ±1/2), with the residues

    R = -(κ1 + κ2)/2 - κ1κ2/4,    (κ1 + κ2)/2 - κ1κ2/4,                       (period_one_r1, r2)
        (κ2 - κ1)/2 + κ1κ2/4,     (κ1 - κ2)/2 + κ1κ2/4;                       (period_one_r3, r4)

a point is stable iff 0 < R < 1. At R = 0 the point (1/2, 0) undergoes a pitchfork, on the curve
κ1 + κ2 = κ1κ2/2, beyond which there are secondary points x = 1/2 ± z/2π, the solutions of

    κ1 sin z + κ2 sin(z - (κ1/2) sin z) = 0,     2y = (κ1/2π) sin z,          (second1, second2)

The cubic expansion in z gives z² = (6κ1 + 6κ2 - 3κ1κ2) / (κ1 - κ1κ2/2 + κ2(1 - κ1/2)³). The paper's
Eq. (39) has +3κ1κ2, with which z would not vanish at the pitchfork.
"""

from itertools import pairwise

import numpy as np

from nasm.checks import floats
from nasm.maps import TWO_PI, step_tangent

__all__ = ["cubic_estimate", "primary_residue", "residue", "second2", "secondary"]

PRIMARY = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
"""x, y of the primary points I to IV; III and IV also have y = -1/2."""

_SAMPLES = 1024  # of (0, π) in the search for sign changes
_BISECTIONS = 60


def _strengths(kappa1, kappa2):
    """Both as finite float arrays of one shape; ValueError otherwise."""
    kappa1, kappa2 = np.broadcast_arrays(floats("kappa1", kappa1), floats("kappa2", kappa2))
    for name, values in (("kappa1", kappa1), ("kappa2", kappa2)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name}={values!r} must be finite numbers")
    return kappa1, kappa2


def primary_residue(kappa1, kappa2):
    """Residues of the `PRIMARY` points, shape (4, *broadcast shape of kappa1 and kappa2)."""
    kappa1, kappa2 = _strengths(kappa1, kappa2)
    mean, apart, product = (kappa1 + kappa2) / 2, (kappa1 - kappa2) / 2, kappa1 * kappa2 / 4
    return np.stack([-mean - product, mean - product, product - apart, product + apart])


def residue(kappa, x, y):
    """R = (2 - Tr DT(x, y))/4 of fixed points of T, Eq. (33)."""
    tangent = step_tangent(kappa, x, y)
    return (2 - tangent[0, 0] - tangent[1, 1]) / 4


def secondary(kappa1, kappa2):
    """The secondary point next to (1/2, 0), with x > 1/2; its mirror image is (1 - x, -y).

    kappa1, kappa2 : arrays that broadcast together, finite.

    Returns z : ndarray, the smallest solution of Eq. (38b) in (0, π), with z = 2πx - π; NaN where
        the sign changes between no two of 1024 equally spaced samples.
    x, y : ndarrays, the point.
    """
    kappa1, kappa2 = np.atleast_1d(*_strengths(kappa1, kappa2))
    grid = np.pi * np.arange(1, _SAMPLES) / _SAMPLES
    left, right = np.full((2, *kappa1.shape), np.nan)
    before = second2(kappa1, kappa2, grid[0])
    for low, high in pairwise(grid):
        after = second2(kappa1, kappa2, high)
        first = np.isnan(left) & (before * after < 0)
        left[first], right[first] = low, high
        before = after
    sign = np.sign(second2(kappa1, kappa2, left))
    for _ in range(_BISECTIONS):
        z = (left + right) / 2
        on_the_left = np.sign(second2(kappa1, kappa2, z)) == sign
        left, right = np.where(on_the_left, z, left), np.where(on_the_left, right, z)
    x = 0.5 + z / TWO_PI
    return z, x, kappa1 * np.sin(z) / (2 * TWO_PI)


def second2(kappa1, kappa2, z):
    """The left-hand side of Eq. (38b), written in z = 2πx - π."""
    kappa1, kappa2, z = floats("kappa1", kappa1), floats("kappa2", kappa2), floats("z", z)
    return kappa1 * np.sin(z) + kappa2 * np.sin(z - kappa1 / 2 * np.sin(z))


def cubic_estimate(kappa1, kappa2):
    """z of the secondary point to third order, Eq. (39) corrected; NaN where it is not real."""
    kappa1, kappa2 = _strengths(kappa1, kappa2)
    numerator = 6 * kappa1 + 6 * kappa2 - 3 * kappa1 * kappa2
    denominator = kappa1 - kappa1 * kappa2 / 2 + kappa2 * (1 - kappa1 / 2) ** 3
    with np.errstate(divide="ignore", invalid="ignore"):
        square = numerator / denominator
        return np.sqrt(np.where(np.isfinite(square) & (square >= 0), square, np.nan))
