"""Period-one orbits of T_{κ1κ2}: fixed points mod 1, their residues and stability (Sec. IV).

Primary points exist at all strengths: (0, 0), (1/2, 0), (0, ±1/2), (1/2, ±1/2), with the residues

    R = -(κ1 + κ2)/2 - κ1κ2/4,    (κ1 + κ2)/2 - κ1κ2/4,
        (κ2 - κ1)/2 + κ1κ2/4,     (κ1 - κ2)/2 + κ1κ2/4;

a point is stable iff 0 < R < 1. The point (1/2, 0) undergoes a pitchfork bifurcation where
R = 0, on the curve κ1 + κ2 = κ1κ2/2. Beyond this curve there are secondary points at
x = 1/2 ± z/2π, where z and y satisfy

    κ1 sin z + κ2 sin(z - (κ1/2) sin z) = 0,     2y = (κ1/2π) sin z.              (38)

The cubic expansion in z gives z² = (6κ1 + 6κ2 - 3κ1κ2) / (κ1 - κ1κ2/2 + κ2(1 - κ1/2)³). The paper's
Eq. (39) has +3κ1κ2 instead; z would then not vanish at the pitchfork.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from nasm.checks import count, floats
from nasm.maps import TWO_PI, step_tangent
from nasm.types import FloatArray

__all__ = ["cubic_estimate", "primary_residue", "residue", "secondary", "secondary_equation"]

PRIMARY = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
"""Coordinates x, y of the primary points I to IV; III and IV also exist at y = -1/2."""


def _strengths(kappa1: ArrayLike, kappa2: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Check both strengths, and return them as float arrays of the same shape."""
    kappa1, kappa2 = np.broadcast_arrays(floats("kappa1", kappa1), floats("kappa2", kappa2))
    for name, values in (("kappa1", kappa1), ("kappa2", kappa2)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name}={values!r} must be finite numbers")
    return kappa1, kappa2


def primary_residue(kappa1: ArrayLike, kappa2: ArrayLike) -> FloatArray:
    """Compute the residues of the `PRIMARY` points.

    Parameters
    ----------
    kappa1, kappa2 : array_like
        Finite strengths. Their shapes broadcast.

    Returns
    -------
    ndarray, shape (4, *shape)

    Examples
    --------
    >>> from nasm.fixed_points import primary_residue
    >>> primary_residue(0.25, 0.5).round(4)
    array([-0.4062,  0.3438,  0.1562, -0.0938])
    """
    kappa1, kappa2 = _strengths(kappa1, kappa2)
    mean, apart, product = (kappa1 + kappa2) / 2, (kappa1 - kappa2) / 2, kappa1 * kappa2 / 4
    return np.stack([-mean - product, mean - product, product - apart, product + apart])


def residue(kappa: ArrayLike, x: ArrayLike, y: ArrayLike) -> FloatArray:
    """Compute the residue R = (2 - Tr DT(x, y))/4 of fixed points of T, Eq. (33).

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    x, y : array_like
        Fixed points of T, mod 1, in turns; the function does not check that T leaves them fixed.

    Returns
    -------
    ndarray
        R, of the broadcast shape; a point is stable if 0 < R < 1.

    Examples
    --------
    >>> from nasm.fixed_points import residue
    >>> residue((0.5, 1.5), 0.5, 0.0).round(4)
    np.float64(0.8125)
    """
    tangent = step_tangent(kappa, x, y)
    return (2 - tangent[0, 0] - tangent[1, 1]) / 4


def secondary(
    kappa1: ArrayLike, kappa2: ArrayLike, n_samples: int = 1024
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the secondary point next to (1/2, 0), with x > 1/2; its mirror image is (1 - x, -y).

    Parameters
    ----------
    kappa1, kappa2 : array_like
        Finite strengths. Their shapes broadcast.
    n_samples : int
        Number of equal parts into which (0, π) is divided, 2 to 10⁶; a change of sign is sought in
        each of them.

    Returns
    -------
    z : ndarray, at least one-dimensional
        The smallest solution of Eq. (38b) in (0, π), with z = 2πx - π. NaN if no part contains a
        change of sign.
    x, y : ndarray
        The point, in turns.

    Examples
    --------
    >>> from nasm.fixed_points import secondary
    >>> z, x, y = secondary(5.0, 5.0)
    >>> print(z.round(4), x.round(4), y.round(4))
    [1.1311] [0.68] [0.36]
    """
    kappa1, kappa2 = np.atleast_1d(*_strengths(kappa1, kappa2))
    n_samples = count("n_samples", n_samples, 2, 10**6)
    grid = np.linspace(0.0, np.pi, n_samples + 1)
    left, right, sign = np.full((3, *kappa1.shape), np.nan)
    # Both ends are also solutions, at primary points; the slope at each end gives the sign nearby.
    before = kappa1 + kappa2 * (1 - kappa1 / 2)
    for low, high in pairwise(grid):
        if high < np.pi:
            after = secondary_equation(kappa1, kappa2, high)
        else:
            after = kappa1 + kappa2 * (1 + kappa1 / 2)
        first = np.isnan(left) & (before * after < 0)
        left[first], right[first], sign[first] = low, high, np.sign(before)[first]
        before = after
    # This many bisections reduce the interval to the size of a rounding error.
    for _ in range(np.finfo(float).nmant + 2):
        z = (left + right) / 2
        on_the_left = np.sign(secondary_equation(kappa1, kappa2, z)) == sign
        left, right = np.where(on_the_left, z, left), np.where(on_the_left, right, z)
    x = 0.5 + z / TWO_PI
    return z, x, kappa1 * np.sin(z) / (2 * TWO_PI)


def secondary_equation(kappa1: ArrayLike, kappa2: ArrayLike, z: ArrayLike) -> FloatArray:
    """Evaluate the left-hand side of Eq. (38b), κ1 sin z + κ2 sin(z - (κ1/2) sin z).

    Examples
    --------
    >>> from nasm.fixed_points import secondary_equation
    >>> secondary_equation(0.5, 0.5, 0.0)
    np.float64(0.0)
    """
    kappa1, kappa2, z = floats("kappa1", kappa1), floats("kappa2", kappa2), floats("z", z)
    return kappa1 * np.sin(z) + kappa2 * np.sin(z - kappa1 / 2 * np.sin(z))


def cubic_estimate(kappa1: ArrayLike, kappa2: ArrayLike) -> FloatArray:
    """Estimate z of the secondary point to third order, from the corrected Eq. (39).

    Return NaN where z is not real.

    Examples
    --------
    >>> from nasm.fixed_points import cubic_estimate, secondary
    >>> z, x, y = secondary(4.1, 4.1)
    >>> print(z.round(2), cubic_estimate(4.1, 4.1).round(2))
    [0.38] 0.37
    """
    kappa1, kappa2 = _strengths(kappa1, kappa2)
    numerator = 6 * kappa1 + 6 * kappa2 - 3 * kappa1 * kappa2
    denominator = kappa1 - kappa1 * kappa2 / 2 + kappa2 * (1 - kappa1 / 2) ** 3
    with np.errstate(divide="ignore", invalid="ignore"):
        square = numerator / denominator
        return np.sqrt(np.where(np.isfinite(square) & (square >= 0), square, np.nan))
