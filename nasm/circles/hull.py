"""Circles close to their breakup, from the hull functions of long periodic orbits.

The sites of an ordered orbit of rotation number p/q per period are values of its *hull functions*
h_j at q equidistant angles θ_m = θ_0 + m p/q mod 1:

    x_{mP+j} = h_j(θ_m),     h_j(θ) = θ + j p/(Pq) + u_j(θ),     j = 0, …, P - 1.

Let p/q be a convergent of ω. Where the circle of ω exists, the hull functions converge to those of
the circle as q grows (Aubry & Le Daeron, Physica D 8 (1983) 381). At a relative distance d below
the breakup the circle's finest structure has a length of about d, because its wave number grows
like d^(-ν) with ν = 0.987 (see `nasm.circles.continuation`); an orbit with a few times 1/d periods
resolves it. Since |ω - p/q| < 1/q², the interpolated hull functions then satisfy the equations of
the circle of ω up to about u'/q², and one Newton step for ω certifies the circle.

The orbits are those of `nasm.action` that minimize the action with one site held fixed, so no
symmetry is needed, and no circle under weaker kicks. The interpolation is exact: q values determine
q/2 modes.
"""

from dataclasses import dataclass
from math import inf, isnan, nan
from time import thread_time

import numpy as np
from numpy.typing import ArrayLike

from nasm.action import Chain, ConvergentOrbits, LostError
from nasm.checks import real
from nasm.circles import fourier, newton
from nasm.circles.newton import DEFAULT_NEWTON_SETTINGS, NewtonSettings
from nasm.maps import TWO_PI, forcing, segment
from nasm.numbers import distinct_convergents, irrational
from nasm.types import FloatArray, OmegaLike

__all__ = ["HullSettings", "certified_circle"]


@dataclass(frozen=True)
class HullSettings:
    """Periods of the orbits near which circles are sought.

    Attributes
    ----------
    min_period : int
        Shortest period. Interpolated orbits satisfied the equations of the circle up to 2·10⁻⁷, and
        the circle satisfied them up to 2·10⁻¹⁰ (329 cases).
    max_period : int
        Longest period; a circle that would need a longer orbit is not sought. With two kicks, a
        period of 1.3·10⁶ takes 1.5 GB of memory.
    period_ratio : float
        Period multiplied by the relative distance from the breakup. With 2 instead of 2.5, two of
        12 circles were not certified at a distance of 1.6·10⁻⁵.
    newton : NewtonSettings
        Criteria for certification.

    Examples
    --------
    >>> from nasm.circles.hull import HullSettings, certified_circle
    >>> short = HullSettings(min_period=500)
    >>> certified_circle("gamma", 1.0, breakup=0.971635, distance=0.1, settings=short)[1].shape
    (1, 1728)
    """

    min_period: int = 2**12
    max_period: int = 2 * 10**6
    period_ratio: float = 2.5
    newton: NewtonSettings = DEFAULT_NEWTON_SETTINGS


DEFAULT_SETTINGS = HullSettings()


def certified_circle(
    omega: OmegaLike,
    profile: ArrayLike,
    breakup: float,
    distance: float,
    start: ArrayLike | None = None,
    until: float = inf,
    settings: HullSettings = DEFAULT_SETTINGS,
) -> tuple[float, FloatArray | None]:
    """Compute a certified circle of ω near a known breakup.

    The circle at the relative distance d = `distance` is sought near an orbit with a period of at
    least 2.5/d. If it is not certified, circles at 1.2, 4, 16, … times that distance are tried.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period, irrational, e.g. "gamma".
    profile : array_like, shape (P,)
        Direction of the segment κ = start + s·profile.
    breakup : float
        Scale of the breakup, e.g. from `periodic.critical_scale`; NaN if it is unknown.
    distance : float
        Relative distance, 10⁻⁶ to 1/2.
    start : array_like, shape (P,), optional
        Start of the segment; default 0.
    until : float
        The `time.thread_time` after which no further circle is attempted.
    settings : HullSettings
        Periods of the orbits, and settings of Newton's method.

    Returns
    -------
    scale : float
        breakup·(1 - distance) or below; NaN if no circle is certified.
    u : ndarray, shape (P, n), or None
        Deviations of the circle; None if no circle is certified.

    Notes
    -----
    With two kicks, a circle takes 0.04 s at a distance of 10⁻⁴, and 0.3 s at 1.6·10⁻⁵ (medians).
    Rounding limits the distance: 40 of 40 circles were certified at 1.6·10⁻⁵, and 24 of 30 at 10⁻⁵.

    Examples
    --------
    >>> from nasm.circles.hull import certified_circle
    >>> scale, u = certified_circle("gamma", 1.0, breakup=0.971635, distance=0.01)
    >>> round(scale, 6)
    0.961919
    """
    omega, (start, profile) = irrational(omega), segment(start, profile)
    breakup, distance = real("breakup", breakup), real("distance", distance, 1e-6, 0.5)
    until = real("until", until)
    distances = [min(ratio * distance, 0.5) for ratio in (1, 1.2, *(4**n for n in range(1, 11)))]
    for d in dict.fromkeys(distances):
        if isnan(breakup) or thread_time() >= until:
            break
        scale, period = breakup * (1 - d), int(settings.period_ratio / d)
        u = circle_near_orbit(omega, start + scale * profile, period, settings)
        if u is not None:
            return scale, u
    return nan, None


def circle_near_orbit(
    omega: OmegaLike,
    kappa: ArrayLike,
    period: int,
    settings: HullSettings = DEFAULT_SETTINGS,
) -> FloatArray | None:
    """Compute a certified circle of ω from the hull functions of an orbit.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period, irrational, e.g. "gamma".
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    period : int
        Shortest period q of the orbit; if it is below `min_period`, that is used.
    settings : HullSettings
        Limits on the period, and criteria for certification.

    Returns
    -------
    ndarray, shape (P, n), or None
        Deviations of the circle, from `newton.certified_by_step`; None if no circle is certified.

    Examples
    --------
    >>> from nasm.circles.hull import circle_near_orbit
    >>> [circle_near_orbit("gamma", kappa, period=2000) is None for kappa in (0.97, 0.98)]
    [False, True]
    """
    kappa, period = forcing(kappa), max(period, settings.min_period)
    fractions = distinct_convergents(omega, settings.max_period)
    longer = [n for n, fraction in enumerate(fractions) if fraction.denominator >= period]
    if not longer:
        return None
    orbits = ConvergentOrbits(kappa, 0 * kappa, fractions[: longer[0] + 1])
    try:
        first, sites = orbits.constrained_minimizer(longer[0], 0.0)
    except LostError:
        return None
    chain = orbits.chains[-1]
    n = fourier.grid(omega, chain.q, settings.newton.grid)
    u = hull_functions(chain, first, sites, n)
    return u if newton.certified_by_step(omega, kappa, u, settings.newton) else None


def hull_functions(chain: Chain, first: int, sites: FloatArray, n: int) -> FloatArray:
    """Interpolate the hull functions of an orbit.

    Parameters
    ----------
    chain : Chain
        The orbit's fraction, and the number P of kicks.
    first : int
        The kick within a period, from 0, of the orbit's first site.
    sites : ndarray, shape (N,)
        Deviations of the sites from the rotation by p/q.
    n : int
        Number of grid points.

    Returns
    -------
    ndarray, shape (P, n)
        Deviations u_j at θ = i/n, with ⟨u_0⟩ = 0.

    Examples
    --------
    >>> from fractions import Fraction
    >>> import numpy as np
    >>> from nasm.action import Chain
    >>> from nasm.circles.hull import hull_functions
    >>> chain = Chain(1, Fraction(2, 5))
    >>> sites = np.sin(2 * np.pi * chain.theta)
    >>> theta = np.arange(8) / 8
    >>> bool(np.allclose(hull_functions(chain, 0, sites, 8), np.sin(2 * np.pi * theta)))
    True
    """
    period, q = chain.period, chain.q
    # The orbit hits θ_0 + i/q in the period i p⁻¹ mod q.
    periods = np.arange(q) * pow(chain.p, -1, q) % q
    u = sites[(period * periods + np.arange(-first, period - first)[:, None]) % chain.n_sites]
    mean = u[0].mean()
    modes = np.fft.rfft(u - mean)[:, : n // 2 + 1] * (n / q)
    origin = (mean - first * chain.p / chain.n_sites) % 1
    modes *= np.exp(-1j * TWO_PI * origin * np.arange(modes.shape[1]))
    return np.fft.irfft(modes, n)
