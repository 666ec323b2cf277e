"""Circles mapped by symmetries to other parameters (Sec. VI.C of the paper).

If T∘K(θ) = K(θ + ω), and a change of variables C turns T into T', then C∘K is a circle of T'. Here
K is given by the deviations u_j of its sites (see `circles`). In terms of these, the paper's
compositions are

    S∘S:               (κ) → (κ, κ),          ω → 2ω:       u_j(θ) = u(θ + jω)           (49)
    R_{1/2} ∘ K:       κ → -κ:                              u_j(θ) → u_j(θ - 1/2)      (50)
    y → y + 1/2:       κ_j → (-1)^j κ_j,      ω → ω + P/2:  u_j unchanged
    P_{1/2} ∘ K:       (2κ) → (κ, 0):                       u_1(θ) = (u_0(θ) + u_0(θ + ω))/2
    S_κ0 ∘ K:          (κ_0, …) → (…, κ_0):                 u_j(θ) → u_{j+1}(θ - ω/P)

The third symmetry maps the paper's circle of S_κ∘R_{-1/2} to a circle under the forcing (κ, -κ)
with rotation number 2ω + 1. For P = 2, S_κ2⁻¹∘K is the circle of the last line, moved back by one
step of T. Each resulting circle is certified again.
"""

import numpy as np

from nasm import symmetries
from nasm.checks import count
from nasm.circles import fourier
from nasm.circles.newton import InvariantCircle, certified
from nasm.maps import MAX_PERIOD, TWO_PI
from nasm.numbers import moebius

__all__ = ["alternate", "interleave", "negate", "repeat", "shift"]


def repeat(circle: InvariantCircle, times: int) -> InvariantCircle:
    """Return the circle under the forcing repeated `times` times; ω → times·ω.

    Examples
    --------
    >>> from nasm.circles import invariant_circle
    >>> from nasm.circles.symmetries import repeat
    >>> repeat(invariant_circle("gamma", 0.3), 2)
    <InvariantCircle of [1;(4)] under kappa = [0.3, 0.3], certified>
    """
    times = count("times", times, 1, MAX_PERIOD)
    turn = fourier.turns(circle.omega, circle.u.shape[-1] // 2 + 1)
    u = [fourier.rotate(circle.u, turn**m) for m in range(times)]
    omega = moebius(circle.omega, times, 0)
    return certified(omega, np.tile(circle.kappa, times), np.concatenate(u))


def negate(circle: InvariantCircle) -> InvariantCircle:
    """Return the circle under κ → -κ; ω is unchanged.

    Examples
    --------
    >>> from nasm.circles import invariant_circle
    >>> from nasm.circles.symmetries import negate
    >>> negate(invariant_circle("gamma", 0.3))
    <InvariantCircle of [0;(1)] under kappa = [-0.3], certified>
    """
    n = circle.u.shape[-1]
    return certified(circle.omega, -circle.kappa, np.roll(circle.u, n // 2, axis=-1))


def alternate(circle: InvariantCircle) -> InvariantCircle:
    """Return the circle under κ_j → (-1)^j κ_j, for even P; ω → ω + P/2.

    Examples
    --------
    >>> from nasm.circles import invariant_circle
    >>> from nasm.circles.symmetries import alternate
    >>> alternate(invariant_circle("2gamma", (0.3, 0.3)))
    <InvariantCircle of [2;(4)] under kappa = [ 0.3, -0.3], certified>
    """
    kappa, _, _ = symmetries.alternate(circle.kappa, 0.0, 0.0)
    return certified(moebius(circle.omega, 1, kappa.size // 2), kappa, circle.u)


def interleave(circle: InvariantCircle) -> InvariantCircle:
    """Return the circle under (κ_0/2, 0, κ_1/2, 0, …): half of each kick, then a kick of 0.

    Examples
    --------
    >>> from nasm.circles import invariant_circle
    >>> from nasm.circles.symmetries import interleave
    >>> interleave(invariant_circle("gamma", 0.6))
    <InvariantCircle of [0;(1)] under kappa = [0.3, 0. ], certified>
    """
    turn = fourier.turns(circle.omega, circle.u.shape[-1] // 2 + 1)
    after = np.vstack([circle.u[1:], fourier.rotate(circle.u[:1], turn)])
    n_sites, n = circle.u.shape
    u = np.stack([circle.u, (circle.u + after) / 2], axis=1).reshape(2 * n_sites, n)
    kappa = np.stack([circle.kappa / 2, np.zeros(n_sites)], axis=1).ravel()
    return certified(circle.omega, kappa, u)


def shift(circle: InvariantCircle) -> InvariantCircle:
    """Return the circle under the shifted forcing (κ_1, …, κ_{P-1}, κ_0); ω is unchanged.

    For P = 2, the two kicks are swapped.

    Examples
    --------
    >>> from nasm.circles import invariant_circle
    >>> from nasm.circles.symmetries import shift
    >>> shift(invariant_circle("2gamma", (0.3, 0.4)))
    <InvariantCircle of [1;(4)] under kappa = [0.4, 0.3], certified>
    """
    n_sites, n = circle.u.shape
    turn = fourier.turns(circle.omega, n // 2 + 1)
    site_turn = fourier.turns(moebius(circle.omega, 1, 0, 0, n_sites), n // 2 + 1)
    u = np.vstack([circle.u[1:], fourier.rotate(circle.u[:1], turn)])
    u = fourier.rotate(u, site_turn.conj())
    # The origin of θ is fixed by ⟨u_0⟩ = 0; without a symmetry centre this requires a shift of θ.
    mean = u[0].mean()
    u = fourier.rotate(u, np.exp(-1j * TWO_PI * mean * np.arange(n // 2 + 1))) - mean
    return certified(circle.omega, np.roll(circle.kappa, -1), u)
