"""The last barrier of a rotating standard map of any frequency, from both sides, in seconds.

    κ_n = s·(κ̄ + Δκ cos 2π(φ0 + nΩ)),     n = …, -1, 0, 1, …

Ω = p/q has circles of T^q, other ones for another φ0, and an irrational Ω has tori, for all φ0 at
once. `barriers` answers for the first, but takes minutes where q is large. Here both are bracketed
in the same way:

1. `upper`: the lowest scale found at which converse KAM eliminates all starts, by the kicks from -N
   to N (`nasm.converse_kam.sequence`): no circle is left, or no torus that is a graph.
2. Below it some starts survive. Weighted Birkhoff averages tell those on circles or tori from those
   next to orbits that minimize the action, and their ω.
3. `lower`: the largest scale at which a circle or torus of one of these ω is certified.

The last barrier breaks inside the bracket. Its ω need not be that of `lower`.
"""

import numpy as np

from nasm.arithmetic.sine import cos2pi
from nasm.checks import count, fraction, real
from nasm.circles import continuation
from nasm.converse_kam import sequence
from nasm.critical import CriticalScale, Status
from nasm.maps import direction, rotating_forcing
from nasm.numbers import nobles_near
from nasm.orbits import bump, orbit
from nasm.tori import newton

__all__ = ["of_fraction", "of_irrational", "upper_scale"]
__dir__ = __all__.copy

_BELOW = 1 - np.array([0.01, 0.02, 0.03, 0.05, 0.07, 0.09, 0.12, 0.15, 0.2, 0.25, 0.3])
_METHOD = "converse KAM, and continuation of what survives"
_TOL = 4e-3  # of upper
_STARTS = 1024
_AVERAGED = 4096  # kicks
_REGULAR = 1e-5  # turns per kick: regular if averages over all kicks and over half differ by less
_APART = 1e-3  # turns per kick: candidates that are nearer are one
_TRIED = 4  # candidates


def of_fraction(frequency, phase, mean, amplitude, n_kicks=8_000):
    """The last circle of Ω = p/q on the ray (κ̄, Δκ) = s·(mean, amplitude).

    frequency : Fraction or str.
    phase : float, φ0 in turns.
    mean, amplitude : floats, not both 0.
    n_kicks : int, 100 to 10⁶, N.

    Returns CriticalScale. value is the middle of the bracket, and error half of its width; omega is
    None. Status UNDECIDED, and no value, if no circle was certified. Status NO_BREAKUP if a start
    survives kicks of strength 2, and no bounds; UNDECIDED if searches for survivors disagree.
    omega : float, turns per kick of the circle at lower, in [0, 1/2], NaN without one.
    """
    frequency = fraction("frequency", frequency)
    profile = direction(rotating_forcing(mean, amplitude, frequency, real("phase", phase)))

    def certified(omega, upper):
        near = nobles_near(omega * profile.size, 2e-3, 1)
        return continuation.critical_scale(near[0], profile, 1e-3 * upper).lower if near else np.nan

    n = count("n_kicks", n_kicks, 100, 10**6)
    return _bracket(profile[np.arange(-n, n + 1) % profile.size], certified)


def of_irrational(frequency, mean, amplitude, n_kicks=32_000, tol=0.01):
    """The last torus of an irrational Ω on the ray (κ̄, Δκ) = s·(mean, amplitude).

    frequency : float, Ω.
    mean, amplitude, n_kicks : as for `of_fraction`.
    tol : float, the error of a torus's breakup to aim at, in parts of `upper`.

    Returns CriticalScale and omega, as of `of_fraction`.
    """
    profile, tol = _kicks(frequency, mean, amplitude, n_kicks), real("tol", tol)

    def certified(omega, upper):
        return newton.critical_scale(omega, frequency, mean, amplitude, tol * upper).lower

    return _bracket(profile, certified)


def upper_scale(frequency, mean, amplitude, n_kicks=8_000):
    """The scale at which no torus of an irrational Ω is left that is a graph, whatever its ω.

    Parameters as for `of_irrational`. Returns a float, `upper` of
    `converse_kam.sequence.critical_scale`, NaN without one. It takes a second or two.
    """
    return sequence.critical_scale(_kicks(frequency, mean, amplitude, n_kicks), _TOL).upper


def _kicks(frequency, mean, amplitude, n_kicks):
    n = count("n_kicks", n_kicks, 100, 10**6)
    turns = np.arange(-n, n + 1) * real("frequency", frequency) % 1
    return direction(real("mean", mean) + real("amplitude", amplitude) * cos2pi(turns))


def _bracket(profile, certified):
    """The CriticalScale of kicks s·profile, and ω of what is certified at its lower end.

    certified : function, ω per kick and upper → the scale at which it is certified, or NaN.
    """
    found = sequence.critical_scale(profile, _TOL)
    if found.status is not Status.OK:
        return found, np.nan
    upper, lower, omega, tried = found.upper, np.nan, np.nan, []
    for scale in upper * _BELOW:
        if len(tried) >= _TRIED or lower >= scale:
            break
        for candidate in _regular(scale * profile):
            if len(tried) < _TRIED and all(abs(candidate - other) > _APART for other in tried):
                tried.append(candidate)
                here = certified(candidate, upper)
                if not here <= lower and np.isfinite(here):
                    lower, omega = here, candidate
    if np.isnan(lower):
        return CriticalScale(np.nan, np.nan, np.nan, upper, None, Status.UNDECIDED, _METHOD), np.nan
    value, error = (lower + upper) / 2, (upper - lower) / 2
    return CriticalScale(value, error, lower, upper, None, Status.OK, _METHOD), omega


def _regular(kappa):
    """Turns per kick of regular starts that survive the kicks, the most regular first."""
    survivor = sequence.last_survivor(kappa, 0.0, 1)
    if survivor.kicks < np.inf:
        return []
    y = np.append((np.arange(_STARTS) + 0.5) / _STARTS, survivor.y)
    x = np.full(y.size, survivor.x)
    times = sequence.elimination_time(kappa, 0.0, survivor.site, x, y)
    ahead, left = kappa[survivor.site :][:_AVERAGED], np.isinf(times)
    steps = np.diff(orbit(ahead, x[left], y[left], ahead.size, 1)[0], axis=0)
    whole, half = (bump(n) @ steps[:n] for n in (len(steps), len(steps) // 2))
    apart = np.abs(whole - half)
    order = [i for i in np.argsort(apart) if apart[i] < _REGULAR]
    return [abs(whole[i] - np.rint(whole[i])) for i in order]
