"""The paper's Algorithm 1: Newton's method for invariant circles in a symplectic frame.

    T ∘ K(θ) = K(θ + ω),     K(θ) = (θ + u_0(θ), ω/P + …),                        (42)

See arXiv:1606.04824, Sec. VI; equation numbers refer to that paper. This module follows the
paper line by line; `circles.newton_step` takes the same step in chain form, and is faster.

Functions of θ are arrays whose last axis is the grid θ = i/n; vectors have shape (2, n), matrices
(2, 2, n). J = [[0, 1], [-1, 0]].
"""

import numpy as np
from numpy.typing import ArrayLike

from nasm.circles import fourier
from nasm.maps import forcing, kick, step, step_tangent
from nasm.numbers import as_rotation_number
from nasm.types import FloatArray, OmegaLike

__all__ = ["newton_step", "symplectic_frame", "twist"]


def newton_step(omega: OmegaLike, kappa: ArrayLike, u: FloatArray) -> tuple[FloatArray, float]:
    """Take one step of Algorithm 1, for any forcing.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period, e.g. "gamma".
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    u : ndarray, shape (P, n)
        Deviations u_j of the circle's sites from the rotation; see `circles`.

    Returns
    -------
    u : ndarray, shape (P, n)
        Deviations after the step, with ⟨u_0⟩ = 0.
    error : float
        Largest component of |e_0| = |T∘K(θ) - K(θ + ω)| before the step.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles.parameterization import newton_step
    >>> u, first = newton_step("gamma", 0.3, np.zeros((1, 64)))
    >>> u, second = newton_step("gamma", 0.3, u)
    >>> bool(second < first / 10)
    True
    """
    kappa = forcing(kappa)
    n = u.shape[-1]
    turn, kept = fourier.turns(omega, n // 2 + 1), fourier.cut(omega, n)
    rotation, theta = float(as_rotation_number(omega)), np.arange(n) / n

    # 1) K_0 and its error; x - θ is the periodic part of x.
    periodic = np.stack([u[0], rotation / kappa.size + u[0] - fourier.rotate(u[-1], turn.conj())])
    x, y = theta + periodic[0], periodic[1]
    e = np.stack(step(kappa, x, y)) - fourier.rotate(periodic, turn)
    e[0] -= theta + rotation

    # 2) M(θ) and M(θ + ω), S, and M⁻¹(θ + ω) e; M⁻¹ follows from det M = 1.
    tangent = fourier.derivative(periodic)
    tangent[0] += 1
    frame = symplectic_frame(tangent)
    frame_after = symplectic_frame(fourier.rotate(tangent, turn))
    s = twist(step_tangent(kappa, x, y), frame, frame_after)
    e_1 = frame_after[1, 1] * e[0] - frame_after[0, 1] * e[1]
    e_2 = frame_after[0, 0] * e[1] - frame_after[1, 0] * e[0]

    # 4), 5), 6) Solve for W_2 up to its average, then the average, then W_1: Eqs. (47), (48).
    w_2 = fourier.solve_cohomology(e_2, turn, kept)
    w_2 -= np.mean(e_1 + s * w_2) / np.mean(s)
    w_1 = fourier.solve_cohomology(e_1 + s * w_2, turn, kept)
    w_1 -= np.mean(frame[0, 0] * w_1 + frame[0, 1] * w_2)  # ⟨Δx⟩ = 0, because ⟨DK_x⟩ = 1

    # 7) K_1 = K_0 + M W; then the sites of K_1.
    x, y = np.stack([x, y]) + np.einsum("ab...,b...->a...", frame, np.stack([w_1, w_2]))
    after = [x - theta]
    for j, strength in enumerate(kappa[:-1], start=1):
        x, y = kick(strength, x, y)
        after.append(x - theta - j * rotation / kappa.size)
    modes = np.fft.rfft(after)
    modes[:, kept:] = 0
    return np.fft.irfft(modes, n), np.abs(e).max()


def symplectic_frame(tangent: FloatArray) -> FloatArray:
    """Compute the frame M = [DK | J⁻¹ DK N], N = 1/|DK|², Eq. (44); its determinant is 1.

    Parameters
    ----------
    tangent : ndarray, shape (2, n)
        The tangent DK of the circle.

    Returns
    -------
    ndarray, shape (2, 2, n)

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles.parameterization import symplectic_frame
    >>> symplectic_frame(np.array([[2.0], [0.0]]))[..., 0]
    array([[ 2. , -0. ],
           [ 0. ,  0.5]])
    """
    normal = np.stack([-tangent[1], tangent[0]]) / np.sum(tangent**2, axis=0)
    return np.stack([tangent, normal], axis=1)


def twist(map_tangent: FloatArray, frame: FloatArray, frame_after: FloatArray) -> FloatArray:
    """Compute S(θ) in DT(K) M(θ) = M(θ + ω) [[1, S], [0, 1]], Eq. (45).

    S = N(θ+ω) DK(θ+ω)ᵀ DT(K) J⁻¹ DK N. The paper's formula for S lacks J⁻¹.

    Parameters
    ----------
    map_tangent, frame, frame_after : ndarrays, shape (2, 2, n)
        DT(K), M(θ) and M(θ + ω).

    Returns
    -------
    ndarray, shape (n,)

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles.parameterization import symplectic_frame, twist
    >>> from nasm.maps import step_tangent
    >>> frame = symplectic_frame(np.array([[1.0], [0.0]]))
    >>> twist(step_tangent(0.0, [0.1], [0.2]), frame, frame)
    array([1.])
    """
    tangent_after = frame_after[:, 0]
    pushed = np.einsum("ab...,b...->a...", map_tangent, frame[:, 1])
    return np.sum(tangent_after * pushed, axis=0) / np.sum(tangent_after**2, axis=0)
