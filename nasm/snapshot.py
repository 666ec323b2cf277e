"""Snapshot tori: images of an invariant curve under varying kicks, and distances on them.

    y_{n+1} = y_n + (κ_n/2π) sin 2πx_n,     x_{n+1} = x_n + y_{n+1},     n = 0, …, N - 1

Before kick 0 the strength is constant, and K(θ) is an invariant curve under these kicks. Its image
before kick n is a snapshot torus (Jánosi & Tél, Chaos 29 (2019) 121105). For every n it is a closed
curve that no orbit crosses; but it may fold, and neighbouring points may separate. Pairs of points
at parameters θ and θ + r_0 have the ensemble-averaged pairwise distance (EAPD)

    ρ_n = ⟨ln r_n⟩ - ln r_0  →  ⟨ln |(ξ_n, η_n)|⟩,     (ξ_n, η_n) = DT^n K'(θ),     r_0 → 0,

where DT^n is the derivative of the first n kicks and ⟨·⟩ the average over θ, with the invariant
measure of the initial map. Jánosi & Tél call the slope of ρ_n an instantaneous Lyapunov exponent.
The finite-time Lyapunov exponent of one orbit is λ_n = (ln σ_n)/n, where σ_n is the largest
singular value of DT^n. (Grime & Morrison, arXiv:2505.04750, compute it in an extended phase space,
and doubt that averages describe individual orbits.) On a torus, shear makes σ_n grow like n.

*The EAPD of a graph is bounded.* Let a curve that winds once around the cylinder be a graph before
kicks n - 1, n and n + 1. Then ξ > 0 and ⟨ξ_n⟩ = 1. As η_n = ξ_n - ξ_{n-1} and
ξ_{n+1} = ξ_n + η_n + κ_n cos 2πx_n ξ_n, the slope η_n/ξ_n is between -1 - |κ_n| and 1. So, by
Jensen's inequality for the logarithm,

    ρ_n  ≤  ½ ln(1 + (1 + |κ_n|)²):

the EAPD of a graph stays bounded; once it exceeds the bound, the torus has folded. Averages over
a finite ensemble obey this only approximately.
"""

from dataclasses import dataclass
from math import cos, floor, pi, sin

import numpy as np
from numpy.typing import ArrayLike

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import cos2pi
from nasm.checks import count, floats, points, real
from nasm.maps import MAX_STRENGTH, forcing, kick
from nasm.results import Result
from nasm.types import FloatArray

__all__ = ["Separations", "graph_bound", "separations", "torus"]

_MAX_POINTS = 10**6


@dataclass(frozen=True, eq=False)
class Separations(Result):
    """How neighbouring points on a snapshot torus separate.

    `folded`, `separated` and `stretched` are inf where the event never occurs.

    Attributes
    ----------
    distance : ndarray, shape (N,)
        EAPD ρ_n before kick n.
    folded : ndarray, shape of x
        First n with ξ_n ≤ 0; just before kick `folded.min()` the torus is not a graph.
    separated : ndarray, shape of x
        First n from which |(ξ_n, η_n)| of the orbit stays above exp(`graph_bound`).
    stretched : ndarray, shape of x
        First n from which σ_n of the orbit stays above n²; shear makes it grow only like n.
    exponents : ndarray, shape (samples, *x.shape)
        λ_n of each orbit for n = 0, every, 2·every, … < N; NaN for n = 0.
    """

    distance: FloatArray
    folded: FloatArray
    separated: FloatArray
    stretched: FloatArray
    exponents: FloatArray


def torus(
    strength: float, y: float, n: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute n points on the invariant curve through (1/2, y), and tangent vectors K' there.

    The points are the orbit of (1/2, y). The map is reversed by (x, y) → (-x, y + (κ/2π) sin 2πx),
    which fixes (1/2, y), so a curve that the reversal maps to itself has the tangent
    (1, κ/2) there. DT carries it along the orbit.

    Parameters
    ----------
    strength : float
        κ of the constant kicks, |κ| ≤ 10⁶.
    y : float
        Initial y, in turns. If the orbit is chaotic, there is no curve, and the vectors grow
        exponentially.
    n : int
        Number of points, 1 to 10⁶.

    Returns
    -------
    x, y : ndarrays, shape (n,)
        Points, x in [0, 1).
    u, v : ndarrays, shape (n,)
        Tangent vectors. If all u > 0, the curve winds around the cylinder, and the mean of u is 1;
        otherwise the curve encloses islands, and the mean length of the vectors is 1.

    Examples
    --------
    >>> from nasm.snapshot import torus
    >>> x, y, u, v = torus(0.0, 0.25, 4)
    >>> x, u
    (array([0.5 , 0.75, 0.  , 0.25]), array([1., 1., 1., 1.]))
    """
    kappa = real("strength", strength, -MAX_STRENGTH, MAX_STRENGTH)
    x, y = 0.5, real("y", y, -MAX_STRENGTH, MAX_STRENGTH)
    u, v, rows = 1.0, kappa / 2, []
    for _ in range(count("n", n, 1, _MAX_POINTS)):
        rows.append((x, y, u, v))
        y, v = y + kappa / (2 * pi) * sin(2 * pi * x), v + kappa * cos(2 * pi * x) * u
        x, u = x + y - floor(x + y), u + v
    xs, ys, us, vs = np.array(rows).T
    mean = (us if (us > 0).all() else np.hypot(us, vs)).mean()
    return xs, ys, us / mean, vs / mean


def graph_bound(kappa: ArrayLike) -> FloatArray:
    """Compute the bound on the EAPD of a graph before each kick; see the module docstring.

    Parameters
    ----------
    kappa : array_like, shape (N,)
        Strengths of the kicks.

    Examples
    --------
    >>> from nasm.snapshot import graph_bound
    >>> graph_bound([0.0, 1.0]).round(3)
    array([0.347, 0.805])
    """
    return 0.5 * np.log(1 + (1 + np.abs(forcing(kappa))) ** 2)


def separations(
    kappa: ArrayLike, x: ArrayLike, y: ArrayLike, u: ArrayLike, v: ArrayLike, every: int = 1
) -> Separations:
    """Follow points on a curve and its tangent vectors through N kicks.

    Parameters
    ----------
    kappa : array_like, shape (N,)
        Strengths of the kicks.
    x, y : array_like
        Points before the first kick, at least one. Their shapes broadcast.
    u, v : array_like
        Tangent vectors there, not zero, of the same shape as the points or broadcastable to it.
    every : int
        Number of kicks between samples of the finite-time exponents.

    Returns
    -------
    Separations

    Raises
    ------
    ValueError
        If an argument is not finite, empty, or out of range; the message names it.

    Examples
    --------
    A shear preserves distances along the curve y = 0.25; distances across it grow.

    >>> from nasm.snapshot import separations
    >>> along = separations([0.0] * 4, 0.0, 0.25, 1.0, 0.0)
    >>> across = separations([0.0] * 4, 0.0, 0.25, 0.0, 1.0)
    >>> along.distance, across.distance.round(3)
    (array([0., 0., 0., 0.]), array([0.   , 0.347, 0.805, 1.151]))
    """
    kappa = forcing(kappa)
    x, y = points(x, y)
    u, v = (np.broadcast_to(floats(name, each), x.shape) for name, each in (("u", u), ("v", v)))
    lengths = np.hypot(u, v)
    if x.size == 0:
        raise ValueError("x and y are empty; an ensemble needs at least one point")
    if not (np.isfinite(lengths) & (lengths > 0)).all():
        raise ValueError("tangent vectors (u, v) must be finite and nonzero")
    every = count("every", every, 1, kappa.size)
    distance = np.zeros(kappa.size)
    first, separated, stretched = (np.full(x.size, np.inf) for _ in range(3))
    exponents = np.full((-(-kappa.size // every), x.size), np.nan)
    starts = (np.ascontiguousarray(each).ravel() for each in (x, y, u, v))
    events = first, separated, stretched
    _separations(kappa, graph_bound(kappa), *starts, every, distance, *events, exponents)
    folded, separated, stretched = (each.reshape(x.shape) for each in events)
    return Separations(
        distance / x.size, folded, separated, stretched, exponents.reshape(-1, *x.shape)
    )


@kernel
def _separations(
    kappa, bound, xs, ys, us, vs, every, distance, folded, separated, stretched, exponents
):
    for i in range(xs.size):
        x, y, u, v = xs[i], ys[i], us[i], vs[i]
        a, b, c, d = 1.0, 0.0, 0.0, 1.0  # DT^n = ((a, b), (c, d))·e^logarithm
        determinant, logarithm = 1.0, 0.0
        near, sheared = -1, -1
        for n in range(kappa.size):
            length = logarithm + 0.5 * np.log(u * u + v * v)
            distance[n] += length
            half = 0.5 * (a * a + b * b + c * c + d * d)
            largest = half + np.sqrt(max(half * half - determinant * determinant, 0.0))
            stretch = logarithm + 0.5 * np.log(largest)
            if length <= bound[n]:
                near = n
            if n == 0 or stretch <= 2 * np.log(n):
                sheared = n
            if u <= 0 and folded[i] == np.inf:
                folded[i] = n
            if n % every == 0 and n > 0:
                exponents[n // every, i] = stretch / n
            twist = kappa[n] * cos2pi(x)
            v += twist * u
            u += v
            c += twist * a
            d += twist * b
            a += c
            b += d
            x, y = kick(kappa[n], x, y)
            if abs(a) + abs(b) + abs(c) + abs(d) > 1e60:
                u, v, a, b, c, d = 1e-60 * u, 1e-60 * v, 1e-60 * a, 1e-60 * b, 1e-60 * c, 1e-60 * d
                determinant, logarithm = 1e-120 * determinant, logarithm + np.log(1e60)
        if near < kappa.size - 1:
            separated[i] = near + 1
        if sheared < kappa.size - 1:
            stretched[i] = sheared + 1
