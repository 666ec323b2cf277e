"""The nonautonomous standard map, its kicks' inverses and its tangent.

    S_κ :  y' = y + (κ/2π) sin 2πx,   x' = x + y'                              (6)
    T   =  S_{κ_{P-1}} ∘ … ∘ S_{κ_1} ∘ S_{κ_0}                                 (4)

Calleja, del-Castillo-Negrete, Martínez-del-Río, Olvera, "Global transport in a nonautonomous
standard map", arXiv:1606.04824, Sec. II. Equations have the numbers of that paper.

Conventions
-----------
- Angles are in turns. x is on the lift (not reduced mod 1), so rotation numbers can be read off.
- A *forcing* is one period of strengths, `kappa = (κ_0, …, κ_{P-1})`, first kick first. P = 2 is
  the paper's T_{κ1κ2}, with κ1 = κ_0; P = 1 is the standard map.
- One *step* is one period, P kicks. Rotation numbers are per step.
- The functions take numbers or arrays that broadcast together. `kick` and `unkick` can also be
  called inside Numba kernels: they check and convert nothing.
"""

import numpy as np
from numba.extending import register_jitable

from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import floats, fraction, points, real

__all__ = ["forcing", "kick", "rotating_forcing", "step", "step_tangent", "twist", "unkick"]

TWO_PI = 2 * np.pi

MAX_STRENGTH = 1e6
"""Largest |κ|: far beyond any barrier, and far from where products of strengths overflow."""

MAX_PERIOD = 64
"""Most kicks of a plane, and of a forcing without a dominant symmetry line: `barriers` then takes
minutes, also for 1%."""

MIN_SIZE = 1e-300
"""Least size of a ray's profile, its largest |κ|: scales are 1/size or so, and still floats."""


@register_jitable
def kick(kappa, x, y, theta=0.0):
    """S_κ, Eq. (6): one kick of strength kappa, whose phase is theta: sin 2π(x - θ) in place of
    sin 2πx. Returns x', y'."""
    y = y + kappa / TWO_PI * sin2pi(x - theta)
    return x + y, y


@register_jitable
def unkick(kappa, x, y, theta=0.0):
    """S_κ⁻¹, Eq. (8). Returns the x, y that `kick` takes to the given ones."""
    x = x - y
    return x, y - kappa / TWO_PI * sin2pi(x - theta)


def step(kappa, x, y):
    """T, Eq. (4): one period of the forcing `kappa`, first kick first. Returns x', y'."""
    x, y = points(x, y)
    for strength in forcing(kappa):
        x, y = kick(strength, x, y)
    return x, y


def step_tangent(kappa, x, y):
    """DT(x, y), shape (2, 2, *x.shape): rows (x', y'), columns (x, y); determinant 1."""
    tangent, (x, y) = np.eye(2), points(x, y)
    for strength in forcing(kappa):
        c = strength * cos2pi(x)
        one = np.ones_like(c)
        tangent = np.einsum("ij...,jk...->ik...", [[1 + c, one], [c, one]], tangent)
        x, y = kick(strength, x, y)
    return tangent


def twist(kappa, x, y):
    """∂x'/∂y of one step, Eq. (9); for P = 2 it is positive everywhere iff |κ2| < 2."""
    return step_tangent(kappa, x, y)[0, 1]


def rotating_forcing(mean, amplitude, frequency, phase=0.0):
    """One period of κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ), the rotating standard map, Eq. (53).

    mean, amplitude : float, κ̄ and Δκ.
    frequency : Fraction or str, Ω = p/q, an exact fraction, q ≤ 10⁶; the forcing has period P = q.
    phase : float, φ0 in turns.

    Returns ndarray of shape (q,), first kick first.

    With Ω = 1/2 and φ0 = 0 this is (κ̄ + Δκ, κ̄ - Δκ), so that Δκ = (κ1 - κ2)/2 for T_{κ1κ2}, whose
    first kick is κ1. The paper's (κ2 - κ1)/2 belongs to its Eq. (2), where even n kick with κ2; the
    two forcings differ by a shift of half a period.
    """
    mean, amplitude, phase = real("mean", mean), real("amplitude", amplitude), real("phase", phase)
    frequency = fraction("frequency", frequency)
    turns = [frequency * n % 1 for n in range(frequency.denominator)]
    # In (-1/2, 1/2], so that times n and -n get the same strength to the last bit.
    turns = [float(turn - 1 if 2 * turn > 1 else turn) for turn in turns]
    return forcing(mean + amplitude * cos2pi(np.asarray(turns) + phase))


def direction(profile):
    """`profile` of a ray κ = s·profile as a forcing; ValueError if it is zero, or so small that the
    scales of the ray are too large for floats."""
    strengths = forcing(profile, "profile")
    size = np.abs(strengths).max()
    if size == 0:
        raise ValueError("profile is zero; a ray needs a direction, e.g. profile=(1, 0.5)")
    if size < MIN_SIZE:
        raise ValueError(
            f"profile={profile!r} has no strength of {MIN_SIZE:g} or more; its size is only the "
            "unit of the scale, so multiply it by any number"
        )
    return strengths


def segment(start, profile):
    """start and profile of κ = start + s·profile, arrays of P floats; a start of None is 0.

    ValueError if they differ in length, or as for `direction`.
    """
    profile = direction(profile)
    start = np.zeros_like(profile) if start is None else forcing(start, "start")
    if start.shape != profile.shape:
        raise ValueError(f"start={start} and profile={profile} differ in length")
    return start, profile


def forcing(kappa, name="kappa"):
    """`kappa` as a float array of shape (P,), a number as (1,); ValueError if it is something else,
    too large, or made of numbers that floats would round. name : of the argument, for messages."""
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
