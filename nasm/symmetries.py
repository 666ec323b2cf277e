"""How orbits, forcings and rotation numbers move under the map's symmetries (Sec. III).

A symmetry takes (κ, x, y) to (κ', x', y') such that the orbit of (x', y') under κ' is the image of
the orbit of (x, y) under κ; each docstring says what becomes of ω. Forcings have any period P; for
the paper's map P = 2.

The symmetries of the forcing generate the symmetry group of the square on the (κ1, κ2) plane. The
boundary of global transport, CB_gt, has all of it. That of one circle, CB_ω, has it up to
ω → ω + 1: `fold` takes a ray to the wedge 0 ≤ κ2 ≤ κ1, and says which ω it is there.
"""

import numpy as np

from nasm.maps import forcing, kick
from nasm.numbers import moebius


def reflect(kappa, x, y):
    """(x, y) → (-x, -y), Eq. (refl); ω → -ω."""
    return forcing(kappa), -np.asarray(x), -np.asarray(y)


def translate(kappa, x, y, r, s):
    """(x, y) → (x + r, y + s) with integers r, s, Eq. (trans); ω → ω + P·s."""
    return forcing(kappa), np.asarray(x) + r, np.asarray(y) + s


def negate(kappa, x, y):
    """κ → -κ and x → x + 1/2, Eq. (shift3); ω unchanged."""
    return -forcing(kappa), np.asarray(x) + 0.5, np.asarray(y)


def alternate(kappa, x, y):
    """κ_n → (-1)ⁿ κ_n and y → y + 1/2, for even P; ω → ω + P/2.

    For P = 2 this is Eq. (shift2), (κ1, κ2) → (κ1, -κ2): each kick finds x further by one half
    than the kick before it did. With an odd P the sign pattern does not close in one period.
    """
    strengths = forcing(kappa)
    if strengths.size % 2:
        raise ValueError(
            f"kappa has period P={strengths.size}; alternating signs need an even period, "
            "e.g. the forcing repeated twice"
        )
    return strengths * (-1.0) ** np.arange(strengths.size), np.asarray(x), np.asarray(y) + 0.5


def shift(kappa, x, y):
    """(κ_0, …, κ_{P-1}) → (κ_1, …, κ_{P-1}, κ_0) and z → S_κ0(z), Eq. (sim_M); ω unchanged.

    For P = 2 this swaps κ1 and κ2: S_κ1 ∘ T_{κ1κ2} = T_{κ2κ1} ∘ S_κ1. (The paper's form with
    S_κ2⁻¹ is the same: S_κ1(z) = S_κ2⁻¹(T z), one step later. Its Eq. (ome5) has S_κ2 for S_κ2⁻¹.)
    """
    strengths = forcing(kappa)
    return np.roll(strengths, -1), *kick(strengths[0], x, y)


def shortest(profile, omega):
    """The shortest forcing with the same orbits up to symmetry, and ω per its shorter period.

    On κ1 = κ2 it is the standard map with ω/2, on κ1 = -κ2 that with (ω + 1)/2 by `alternate`.
    """
    profile = forcing(profile)
    candidates = [(profile, omega)]
    if profile.size % 2 == 0:
        alternated, _, _ = alternate(profile, 0.0, 0.0)
        candidates.append((alternated, moebius(omega, 1, profile.size // 2)))
    for length in range(1, profile.size):
        for strengths, number in candidates:
            if profile.size % length == 0 and np.array_equal(
                strengths, np.tile(strengths[:length], profile.size // length)
            ):
                return strengths[:length], moebius(number, 1, 0, 0, profile.size // length)
    return profile, omega


def fold(angle):
    """Fold rays of the (κ1, κ2) plane into the wedge 0 ≤ κ2 ≤ κ1.

    Parameters
    ----------
    angle : array_like, degrees; the ray (cos, sin).

    Returns
    -------
    wedge_angle : ndarray in [0, 45] degrees.
    omega_shift : ndarray of 0 or 1: the circle of ω on the ray at `angle` breaks at the same scale
        as the circle of ω + omega_shift (mod 2) on the ray at `wedge_angle`.

    (κ1, κ2) → -(κ1, κ2) and the swap leave ω alone; the mirrors κ1 → -κ1 and κ2 → -κ2 add 1,
    Eqs. (ome1)-(ome5). Modulo 2, because y → y + 1 adds 2 to ω.
    """
    turned = np.asarray(angle, dtype=float) % 180.0
    mirrored = turned > 90.0
    quarter = np.where(mirrored, 180.0 - turned, turned)
    return np.minimum(quarter, 90.0 - quarter), mirrored.astype(int)


def unfold(wedge_angle):
    """The rays that share CB_gt with the one at `wedge_angle`: eight angles in [0, 360) degrees.

    The inverse of `fold`; shape (8, *wedge_angle.shape). On the wedge's two sides they coincide in
    pairs.
    """
    wedge_angle = np.asarray(wedge_angle, dtype=float)
    if not ((wedge_angle >= 0) & (wedge_angle <= 45)).all():
        raise ValueError(f"wedge_angle={wedge_angle} must be from 0 to 45 degrees; see fold")
    quarter = np.stack([wedge_angle, 90.0 - wedge_angle])
    half = np.concatenate([quarter, 180.0 - quarter])
    return np.concatenate([half, half + 180.0]) % 360.0
