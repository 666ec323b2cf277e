"""A bracket on the breakup of the last barrier of a rotating standard map with irrational Ω.

    κ_n = s·(κ̄ + Δκ cos 2π(φ0 + nΩ)),     n = …, -1, 0, 1, …

For Ω = p/q the barriers are circles of T^q, which depend on φ0: see `nasm.barriers`. For an
irrational Ω they are tori, each of which is a barrier for every φ0. The bracket is computed in
three steps:

1. `upper`: the lowest scale found at which converse KAM eliminates all starts, using the kicks from
   -N to N (`nasm.converse_kam.aperiodic`): no torus that is a graph exists at this scale.
2. Below `upper` some starts survive. Weighted Birkhoff averages distinguish the starts on tori from
   starts close to orbits that minimize the action, and yield the ω of the tori.
3. `lower`: the largest scale at which a torus with one of these ω is certified.

The last torus breaks inside the bracket. Its ω may differ from that of the torus at `lower`.
"""

from dataclasses import dataclass

import numpy as np

from nasm.arithmetic.sine import cos2pi
from nasm.checks import count, real
from nasm.converse_kam import aperiodic
from nasm.maps import direction
from nasm.orbits import bump, orbit
from nasm.results import CriticalScale, Status
from nasm.tori import newton

__all__ = ["LastTorusSettings", "last_critical_scale", "upper_scale"]

_METHOD = "converse KAM, and continuation of surviving tori"


@dataclass(frozen=True)
class LastTorusSettings:
    """Precision of `upper`, and settings that control the search for candidates for the last torus.

    Attributes
    ----------
    upper_tol : float
        Relative width of the bracket from converse KAM whose upper end is `upper`.
    distances : tuple of float
        Relative distances below `upper` at which to search for candidates, in this order.
    n_starts : int
        Number of starts on a line; averages are computed for the starts that survive.
    average_kicks : int
        Number of kicks over which orbits are averaged.
    max_difference : float
        A start is regular if its averages over all kicks and over half of them differ by less than
        this, in turns per kick.
    min_distance : float
        Smallest distance between two candidates, in turns per kick.
    max_candidates : int
        Maximum number of candidates whose tori are continued; continuation takes most of the time.

    Examples
    --------
    >>> from nasm.tori import LastTorusSettings, upper_scale
    >>> rough = LastTorusSettings(upper_tol=0.1)
    >>> 0.5 < upper_scale(0.414, 1.0, 0.1, n_kicks=100, settings=rough) < 0.8
    True
    """

    upper_tol: float = 4e-3
    distances: tuple[float, ...] = (
        0.01,
        0.02,
        0.03,
        0.05,
        0.07,
        0.09,
        0.12,
        0.15,
        0.2,
        0.25,
        0.3,
    )
    n_starts: int = 1024
    average_kicks: int = 4096
    max_difference: float = 1e-5
    min_distance: float = 1e-3
    max_candidates: int = 4


DEFAULT_SETTINGS = LastTorusSettings()


def last_critical_scale(
    frequency: float,
    mean: float,
    amplitude: float,
    n_kicks: int = 32_000,
    tol: float = 0.01,
    settings: LastTorusSettings = DEFAULT_SETTINGS,
) -> tuple[CriticalScale, float]:
    """Bracket the breakup of the last torus on (κ̄, Δκ) = s·(mean, amplitude) for irrational Ω.

    Parameters
    ----------
    frequency : float
        Ω.
    mean, amplitude : float
        The direction (κ̄, Δκ), not zero.
    n_kicks : int
        N, the number of kicks before and after the middle one; 100 to 10⁶.
    tol : float
        Target relative error of the scale at which a torus breaks.
    settings : LastTorusSettings
        Precision of `upper`, and settings that control the search for candidates.

    Returns
    -------
    scale : CriticalScale
        value is the middle of the bracket, and error half its width; omega is None. If no torus was
        certified, or if searches for survivors disagree, there is no value and the status is
        UNDECIDED. If a start survives kicks of strength 2, there are no bounds either, and the
        status is NO_BREAKUP.
    torus_omega : float
        Turns per kick of the torus at `lower`, in [0, 1/2]; NaN if none was certified.

    Examples
    --------
    >>> from nasm.tori import last_critical_scale
    >>> scale, omega = last_critical_scale(0.414, 1.0, 0.0, n_kicks=400)  # doctest: +SKIP
    """
    profile, tol = _kicks(frequency, mean, amplitude, n_kicks), real("tol", tol)
    breakup = aperiodic.critical_scale(profile, settings.upper_tol)
    if breakup.status is not Status.OK:
        return breakup, np.nan
    upper, lower, omega = breakup.upper, np.nan, np.nan
    candidates: list[float] = []
    for scale in upper * (1 - np.array(settings.distances)):
        if len(candidates) >= settings.max_candidates or lower >= scale:
            break
        for candidate in _regular(scale * profile, settings):
            is_new = all(abs(candidate - other) > settings.min_distance for other in candidates)
            if is_new and len(candidates) < settings.max_candidates:
                candidates.append(candidate)
                torus = newton.critical_scale(candidate, frequency, mean, amplitude, tol * upper)
                if not torus.lower <= lower and np.isfinite(torus.lower):
                    lower, omega = torus.lower, candidate
    value, error = (lower + upper) / 2, (upper - lower) / 2
    status = Status.UNDECIDED if np.isnan(lower) else Status.OK
    return CriticalScale(value, error, lower, upper, None, status, _METHOD), omega


def upper_scale(
    frequency: float,
    mean: float,
    amplitude: float,
    n_kicks: int = 8_000,
    settings: LastTorusSettings = DEFAULT_SETTINGS,
) -> float:
    """Compute a scale at which, for irrational Ω, no torus exists as a graph, whatever its ω.

    Parameters are those of `last_critical_scale`.

    Returns
    -------
    float
        `upper` of `converse_kam.aperiodic.critical_scale`; NaN if that function finds no scale. The
        computation takes a second or two.

    Examples
    --------
    >>> from nasm.tori import upper_scale
    >>> 0.5 < upper_scale(0.414, 1.0, 0.1, n_kicks=100) < 0.7
    True
    """
    profile = _kicks(frequency, mean, amplitude, n_kicks)
    return aperiodic.critical_scale(profile, settings.upper_tol).upper


def _kicks(frequency, mean, amplitude, n_kicks):
    n = count("n_kicks", n_kicks, 100, 10**6)
    turns = np.arange(-n, n + 1) * real("frequency", frequency) % 1
    return direction(real("mean", mean) + real("amplitude", amplitude) * cos2pi(turns))


def _regular(kappa, settings):
    """Return the turns per kick of the regular starts among the survivors, most regular first."""
    survivor = aperiodic.last_survivor(kappa, 0.0, 1)
    if survivor.kicks < np.inf:
        return []
    n_starts, max_difference = settings.n_starts, settings.max_difference
    y = np.append((np.arange(n_starts) + 0.5) / n_starts, survivor.y)
    x = np.full(y.size, survivor.x)
    times = aperiodic.elimination_time(kappa, 0.0, survivor.site, x, y)
    ahead, survives = kappa[survivor.site :][: settings.average_kicks], np.isinf(times)
    steps = np.diff(orbit(ahead, x[survives], y[survives], ahead.size, 1)[0], axis=0)
    sizes = len(steps), len(steps) // 2
    averages, half_averages = ((bump(n)[:, None] * steps[:n]).sum(axis=0) for n in sizes)
    differences = np.abs(averages - half_averages)
    order = [i for i in np.argsort(differences) if differences[i] < max_difference]
    return [abs(averages[i] - np.rint(averages[i])) for i in order]
