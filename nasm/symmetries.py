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
from nasm.numbers import checked, moebius


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


def ray(angle):
    """(cos, sin) of an angle in degrees, shape (*angle.shape, 2): the profile of a ray.

    Exact where symmetry makes it matter: on the axes no strength is left over, and on the diagonals
    both are equal in size to the last bit, so that the map is the shorter one of `shorten`.
    """
    angle = np.asarray(angle, dtype=float)
    radians = np.deg2rad(angle)
    profile = np.stack([np.cos(radians), np.sin(radians)], axis=-1)
    on_axis, on_diagonal = angle % 90 == 0, angle % 90 == 45
    profile[on_axis] = np.rint(profile[on_axis])
    profile[on_diagonal] = np.sign(profile[on_diagonal]) * np.sqrt(0.5)
    return profile


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


def shorten(forcings, omega):
    """The shortest forcings with the same orbits up to symmetry, and ω per their shorter period.

    On κ1 = κ2 one step is two of the standard map, at ω/2; on κ1 = -κ2 so it is up to `alternate`.

    Parameters
    ----------
    forcings : sequence of forcings of one period P, which are shortened alike.
    omega : RotationNumber per P kicks, e.g. `numbers.parse("gamma")`.

    Returns
    -------
    forcings : list of arrays of shape (P',), P' a divisor of P. omega : RotationNumber.
    """
    candidates = [([forcing(kappa) for kappa in forcings], checked(omega))]
    period = candidates[0][0][0].size
    if period % 2 == 0:
        alternated = [alternate(kappa, 0.0, 0.0)[0] for kappa in forcings]
        candidates.append((alternated, moebius(omega, 1, period // 2)))
    for length in (n for n in range(1, period) if period % n == 0):
        for strengths, number in candidates:
            if all((kappa == np.roll(kappa, length)).all() for kappa in strengths):
                number = moebius(number, 1, 0, 0, period // length)
                return [kappa[:length] for kappa in strengths], number
    return candidates[0]


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
