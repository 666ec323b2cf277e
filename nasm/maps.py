"""The nonautonomous standard map, the inverses of its kicks, and its tangent map.

    S_κ :  y' = y + (κ/2π) sin 2πx,   x' = x + y'                              (6)
    T   =  S_{κ_{P-1}} ∘ … ∘ S_{κ_1} ∘ S_{κ_0}                                 (4)

Calleja, del-Castillo-Negrete, Martínez-del-Río, Olvera, "Global transport in a nonautonomous
standard map", arXiv:1606.04824, Sec. II. Equation numbers are those of that paper.

Conventions
-----------
- Angles are in turns. x is on the lift (not reduced mod 1), so rotation numbers can be read off.
- A *forcing* is one period of strengths, `kappa = (κ_0, …, κ_{P-1})`, first kick first. P = 2 is
  the paper's T_{κ1κ2}, with κ1 = κ_0; P = 1 is the standard map.
- One *step* is one period, P kicks. Rotation numbers are per step.
- The functions take numbers or arrays that broadcast together. `kick` and `unkick` can also be
  called inside Numba kernels: they neither check nor convert their arguments.
"""

from fractions import Fraction

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike

from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import floats, fraction, points, real
from nasm.types import FloatArray

__all__ = ["forcing", "kick", "rotating_forcing", "step", "step_tangent", "twist", "unkick"]

TWO_PI = 2 * np.pi

MAX_STRENGTH = 1e6
"""Largest |κ|: far beyond any barrier, and far too small for products of strengths to overflow."""

MAX_PERIOD = 64
"""Maximum number of kicks per period in a plane, and in a forcing without a dominant symmetry line:
with that many kicks `barriers` takes minutes, even at a tolerance of 1%."""

MIN_SIZE = 1e-300
"""Minimum size (largest |κ|) of a ray's profile: scales of about 1/size must not overflow."""


@register_jitable
def kick(
    kappa: float | FloatArray,
    x: float | FloatArray,
    y: float | FloatArray,
    theta: float | FloatArray = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Kick points once: S_κ, Eq. (6).

    Parameters
    ----------
    kappa, x, y : floats or arrays
        Strength of the kick, and coordinates of the points, in turns; x is on the lift.
    theta : float or array
        Phase of the kick, in turns: sin 2π(x - θ) replaces sin 2πx.

    Returns
    -------
    x, y : floats or arrays
        The images, of the broadcast shape.

    Examples
    --------
    >>> from nasm.maps import kick
    >>> x, y = kick(0.5, 0.0, 0.25)
    >>> print(x, y)
    0.25 0.25
    """
    y = y + kappa / TWO_PI * sin2pi(x - theta)
    return x + y, y


@register_jitable
def unkick(
    kappa: float | FloatArray,
    x: float | FloatArray,
    y: float | FloatArray,
    theta: float | FloatArray = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Undo a kick: S_κ⁻¹, Eq. (8). Parameters and results are those of `kick`.

    Examples
    --------
    >>> from nasm.maps import unkick
    >>> x, y = unkick(0.5, 0.25, 0.25)
    >>> print(x, y)
    0.0 0.25
    """
    x = x - y
    return x, y - kappa / TWO_PI * sin2pi(x - theta)  # type: ignore[return-value]


def step(kappa: ArrayLike, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Map points by T, one period of the forcing, Eq. (4).

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    x, y : array_like
        Points, in turns, of shapes that broadcast together; x is on the lift.

    Returns
    -------
    x, y : ndarray
        The images, of the broadcast shape.

    Examples
    --------
    A kick does not change y at x = 0, where this orbit starts; the second kick acts at x = 1/4.

    >>> from nasm.maps import step
    >>> x, y = step((0.3, 0.5), 0.0, 0.25)
    >>> print(f"{x:.4f} {y:.4f}")
    0.5796 0.3296
    """
    x, y = points(x, y)
    for strength in forcing(kappa):
        x, y = kick(strength, x, y)
    return x, y


def step_tangent(kappa: ArrayLike, x: ArrayLike, y: ArrayLike) -> FloatArray:
    """Compute the derivative DT of one period of the forcing; its determinant is 1.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    x, y : array_like
        Points, in turns.

    Returns
    -------
    ndarray, shape (2, 2, *x.shape)
        Rows are (x', y'), columns (x, y).

    Examples
    --------
    >>> from nasm.maps import step_tangent
    >>> step_tangent((0.0, 0.0), 0.1, 0.2)
    array([[1., 2.],
           [0., 1.]])
    """
    tangent, (x, y) = np.eye(2), points(x, y)
    for strength in forcing(kappa):
        c = strength * cos2pi(x)
        one = np.ones_like(c)
        tangent = np.einsum("ij...,jk...->ik...", [[1 + c, one], [c, one]], tangent)
        x, y = kick(strength, x, y)
    return tangent


def twist(kappa: ArrayLike, x: ArrayLike, y: ArrayLike) -> FloatArray:
    """Compute the twist ∂x'/∂y of one period of the forcing, Eq. (9).

    For two kicks it is positive everywhere if and only if |κ2| < 2. Parameters are those of `step`;
    the result has the broadcast shape of x and y.

    Examples
    --------
    >>> from nasm.maps import twist
    >>> twist((0.0, 1.5), [0.0, 0.5], 0.0).round(3)
    array([3.5, 0.5])
    """
    return step_tangent(kappa, x, y)[0, 1]


def rotating_forcing(
    mean: float, amplitude: float, frequency: Fraction | str, phase: float = 0.0
) -> FloatArray:
    """Compute one period of the rotating standard map, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ), Eq. (53).

    Parameters
    ----------
    mean, amplitude : float
        κ̄ and Δκ.
    frequency : Fraction or str
        Ω = p/q, an exact fraction with q ≤ 10⁶. The forcing has P = q kicks.
    phase : float
        φ0, in turns.

    Returns
    -------
    ndarray, shape (q,)
        Strengths, first kick first.

    Notes
    -----
    With Ω = 1/2 and φ0 = 0 this is (κ̄ + Δκ, κ̄ - Δκ). For T_{κ1κ2}, whose first kick is κ1, Δκ is
    therefore (κ1 - κ2)/2. The paper's (κ2 - κ1)/2 belongs to its Eq. (2), where kicks with even n
    have strength κ2; the two forcings differ by a shift of half a period.

    Examples
    --------
    >>> from nasm.maps import rotating_forcing
    >>> rotating_forcing(0.5, 0.25, "1/4")
    array([0.75, 0.5 , 0.25, 0.5 ])
    """
    mean, amplitude, phase = real("mean", mean), real("amplitude", amplitude), real("phase", phase)
    exact = fraction("frequency", frequency)
    turns = [exact * n % 1 for n in range(exact.denominator)]
    # Reduce to (-1/2, 1/2], so that kicks n and -n have the same strength to the last bit.
    nearest = [float(turn - 1 if 2 * turn > 1 else turn) for turn in turns]
    return forcing(mean + amplitude * cos2pi(np.asarray(nearest) + phase))


def direction(profile: ArrayLike) -> FloatArray:
    """Check the profile of a ray κ = s·profile, and return it as an array of shape (P,).

    Raises
    ------
    ValueError
        If the profile is zero, or so small that the scales along the ray are too large for floats.
    """
    strengths = forcing(profile, "profile")
    size = np.abs(strengths).max()
    if size == 0:
        raise ValueError("profile is zero; a ray needs a direction, e.g. profile=(1, 0.5)")
    if size < MIN_SIZE:
        raise ValueError(
            f"profile={profile!r} has no strength of {MIN_SIZE:g} or more; its size only sets the "
            "unit of the scale, so multiply it by a large number"
        )
    return strengths


def segment(start: ArrayLike | None, profile: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Check a segment of forcings κ = start + s·profile; return start and profile as arrays.

    Both arrays have the shape (P,). A start of None means 0.

    Raises
    ------
    ValueError
        If start and profile differ in length, or if `direction` refuses the profile.
    """
    profile = direction(profile)
    start = np.zeros_like(profile) if start is None else forcing(start, "start")
    if start.shape != profile.shape:
        raise ValueError(f"start={start} and profile={profile} differ in length")
    return start, profile


def forcing(kappa: ArrayLike, name: str = "kappa") -> FloatArray:
    """Check a forcing, and return it as an array of shape (P,); a single number means one kick.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first, |κ| ≤ 10⁶.
    name : str
        Name of the argument in error messages.

    Raises
    ------
    ValueError
        If kappa is not such an array, is too large, or contains numbers that floats would round.

    Examples
    --------
    >>> from nasm.maps import forcing
    >>> forcing(0.3)
    array([0.3])
    """
    strengths = np.atleast_1d(floats(name, kappa))
    if strengths.ndim != 1 or strengths.size == 0:
        raise ValueError(
            f"{name}={kappa!r} has shape {strengths.shape}; a forcing is a vector of P ≥ 1 "
            f"strengths, first kick first, e.g. {name}=(0.3, 0.5)"
        )
    if not (np.abs(strengths) <= MAX_STRENGTH).all():
        raise ValueError(
            f"{name}={kappa!r} is not finite or too large; strengths are from -{MAX_STRENGTH:g} to "
            f"{MAX_STRENGTH:g}"
        )
    return strengths
