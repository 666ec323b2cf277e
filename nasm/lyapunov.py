"""Growth of tangent vectors: finite-time Lyapunov exponents and the fast Lyapunov indicator.

    v_n = DT(z_{n-1}) … DT(z_0) v_0,     v_0 = (0, 1),
    λ_N = ln|v_N| / N,                   FLI_N = max { ln|v_n| : n ≤ N }.

n counts steps, i.e. periods of the forcing. On a regular orbit the twist of the map makes v_n grow
linearly, so that λ_N ~ ln N / N; on a chaotic orbit λ_N tends to the Lyapunov exponent (Froeschlé,
Lega & Gonczi, Celest. Mech. Dyn. Astron. 67 (1997) 41). Both numbers describe one orbit, and only
up to step N: they cannot tell a circle from an island, or an orbit that sticks to a cantorus from
an orbit on a circle.
"""

from math import floor, log

import numpy as np
from numpy.typing import ArrayLike

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import cos2pi
from nasm.checks import count, points
from nasm.maps import forcing, kick
from nasm.orbits import MAX_STEPS
from nasm.types import FloatArray

__all__ = ["tangent_growth"]

_LARGEST_SQUARE = 1e200
"""|v|² above which v is divided by its norm: low enough that no single kick causes overflow."""


def tangent_growth(
    kappa: ArrayLike, x: ArrayLike, y: ArrayLike, n: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Follow orbits, and the tangent vectors that start in the direction of y.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    x, y : array_like
        Starts, in turns. Their shapes broadcast.
    n : int
        Number of steps (periods of the forcing, P kicks each), 1 to 10⁹.

    Returns
    -------
    exponent : ndarray
        λ_n per step, in the broadcast shape.
    indicator : ndarray
        FLI_n, at least 0.
    advance : ndarray
        x_n - x_0 on the lift, in turns.

    Examples
    --------
    Without kicks v_n = (Pn, 1).

    >>> from nasm.lyapunov import tangent_growth
    >>> exponent, indicator, advance = tangent_growth((0.0, 0.0), 0.0, 0.3, 500)
    >>> print((500 * exponent).round(4), indicator.round(4), advance.round(9))
    6.9078 6.9078 300.0

    >>> exponent, _, _ = tangent_growth((2.0,), 0.3, 0.62, 1000)
    >>> print(exponent > 0.2)
    True
    """
    strengths = forcing(kappa)
    x, y = points(x, y)
    n = count("n", n, 1, MAX_STEPS)
    growth, largest, advance = _growth(strengths, x.ravel(), y.ravel(), n)
    return (growth / n).reshape(x.shape), largest.reshape(x.shape), advance.reshape(x.shape)


@kernel
def _growth(kappa, x, y, n):
    """Return ln|v_n|, its maximum up to n, and the advance of each orbit."""
    growth, largest, advance = np.empty((3, x.size))
    for i in range(x.size):
        xt, yt = x[i], y[i]
        v, w, square, most = 0.0, 1.0, 1.0, 1.0
        scale, moved = 0.0, 0.0
        for _ in range(n):
            # Reduce x mod 1 at each step: if x grew large, its advance would lose digits.
            start = xt = xt - floor(xt)
            for strength in kappa:
                w += strength * cos2pi(xt) * v
                v += w
                xt, yt = kick(strength, xt, yt)
                square = v * v + w * w
                if square > _LARGEST_SQUARE:
                    norm = square**0.5
                    v, w, scale = v / norm, w / norm, scale + log(norm)
                    square, most = 1.0, most / square
            moved += xt - start
            most = max(most, square)
        growth[i] = scale + log(square) / 2
        largest[i] = scale + log(most) / 2
        advance[i] = moved
    return growth, largest, advance
