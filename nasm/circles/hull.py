"""Circles close to their breakup, from the hull functions of long periodic orbits.

P kicks make one period of the forcing. An ordered orbit of rotation number p/q per period samples P
*hull functions* h_j at angles that are equidistant mod 1:

    x_{mP+j} = h_j(θ_m),   θ_m = θ_0 + m p/q,   h_j(θ) = θ + j p/(Pq) + u_j(θ),   j = 0, …, P - 1.

Each u_j is the trigonometric polynomial through its q values. Let p/q be a convergent of ω. If the
circle of ω exists, the u_j approach those of the circle as q grows (Aubry & Le Daeron, Physica D 8
(1983) 381). At a relative distance d below the breakup, the Fourier modes of the circle decay
beyond wave numbers of order d^(-ν), where ν is close to 1 (0.987 for golden tails; see
`nasm.circles.continuation`). An orbit whose period is a few times 1/d therefore resolves the
circle. With ω in place of p/q, the equations of the circle have a residual of order 1/q², because
|ω - p/q| < 1/q². If one Newton step reduces it sufficiently, the circle is accepted. This is strong
evidence, not a proof.

The orbits minimize the action with one site held fixed (`nasm.action`); on a circle, the force that
remains on that site is negligible. The method needs neither a symmetry of the forcing nor a circle
under weaker kicks.
"""

from dataclasses import dataclass
from itertools import dropwhile, islice
from math import inf, isnan, nan
from time import thread_time

import numpy as np
from numpy.typing import ArrayLike

from nasm.action import Chain, ConvergentOrbits, LostError
from nasm.checks import real
from nasm.circles import fourier, newton
from nasm.circles.newton import DEFAULT_NEWTON_SETTINGS, NewtonSettings
from nasm.maps import TWO_PI, forcing, segment
from nasm.numbers import convergents, distinct_convergents, irrational
from nasm.types import FloatArray, OmegaLike

__all__ = ["HullSettings", "certified_circle"]


@dataclass(frozen=True)
class HullSettings:
    """Periods of the orbits near which circles are sought.

    Attributes
    ----------
    min_period : int
        Shortest period. In 329 cases max |E_j| was at most 2·10⁻⁷ for the interpolated orbit, and
        at most 2·10⁻¹⁰ after the Newton step.
    period_ratio : float
        The period is at least this number divided by the relative distance from the breakup. With 2
        instead of 2.5, two of 12 circles were not certified at a distance of 1.6·10⁻⁵.
    resonance_ratio : float
        If the next denominator exceeds q by this factor, ω is so close to p/q that the resonance at
        mode q may destroy the circle; the Newton step then includes the modes up to the next
        denominator. Tails of ones to fours need only the modes below q.
    max_points : int
        Number of points of the finest grid; a circle that needs more is not sought. With two kicks,
        3.7·10⁶ points take 1.5 GB of memory.
    newton : NewtonSettings
        Settings of the grid, and criteria for certification.

    Examples
    --------
    >>> from nasm.circles.hull import HullSettings, certified_circle
    >>> short = HullSettings(min_period=500)
    >>> certified_circle("gamma", 1.0, breakup=0.971635, distance=0.1, settings=short)[1].shape
    (1, 1728)
    """

    min_period: int = 2**12
    period_ratio: float = 2.5
    resonance_ratio: float = 5
    max_points: int = 6 * 10**6
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
    least 2.5/d. If it is not certified, circles at 1.2, 4, 16, … times that distance, up to 1/2,
    are tried.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period, irrational, e.g. "gamma".
    profile : array_like, shape (P,)
        Direction of the segment κ = start + s·profile.
    breakup : float
        Scale of the breakup, e.g. from `periodic.critical_scale`; NaN if it is unknown.
    distance : float
        Relative distance, 10⁻⁶ to 1/2; distances that need more than `max_points` are skipped, for
        the golden circle those below 1.9·10⁻⁶.
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
    start, profile = segment(start, profile)
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
        Deviations of the circle; None if no circle is certified.

    Examples
    --------
    >>> from nasm.circles.hull import circle_near_orbit
    >>> [circle_near_orbit("gamma", kappa, period=2000) is None for kappa in (0.97, 0.98)]
    [False, True]
    """
    omega, kappa, grid = irrational(omega), forcing(kappa), settings.newton.grid
    period = max(period, settings.min_period)
    longer = dropwhile(lambda fraction: fraction.denominator < period, convergents(omega))
    nearest, following = islice(longer, 2)
    # Newton's method keeps all modes below n_modes, and perhaps more.
    is_isolated = following.denominator < settings.resonance_ratio * nearest.denominator
    n_modes = nearest.denominator if is_isolated else following.denominator
    if n_modes > grid.mode_ratio * settings.max_points:
        return None
    n_points = fourier.grid(omega, n_modes, grid)
    if n_points > settings.max_points:
        return None
    fractions = distinct_convergents(omega, nearest.denominator)
    orbits = ConvergentOrbits(kappa, 0 * kappa, fractions)
    try:
        first, sites = orbits.constrained_minimizer(len(fractions) - 1, 0.0)
    except LostError:
        return None
    u = hull_functions(orbits.chains[-1], first, sites, n_points)
    return u if newton.certify_by_step(omega, kappa, u, settings.newton) else None


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
    n_kicks, q = chain.period, chain.q
    # The orbit hits θ_0 + i/q in the period i p⁻¹ mod q.
    periods = np.arange(q) * pow(chain.p, -1, q) % q
    u = sites[(n_kicks * periods + np.arange(-first, n_kicks - first)[:, None]) % chain.n_sites]
    mean = u[0].mean()
    modes = np.fft.rfft(u - mean) * (n / q)
    if q % 2 == 0:  # the values determine only the sum of the modes q/2 and -q/2
        modes[:, -1] /= 2
    modes = modes[:, : n // 2 + 1]
    origin = (mean - first * chain.p / chain.n_sites) % 1
    modes *= np.exp(-1j * TWO_PI * origin * np.arange(modes.shape[1]))
    return np.fft.irfft(modes, n)
