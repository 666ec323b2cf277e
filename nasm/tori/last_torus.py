"""The last barrier of a rotating standard map of an irrational frequency, from both sides.

    κ_n = s·(κ̄ + Δκ cos 2π(φ0 + nΩ)),     n = …, -1, 0, 1, …

Ω = p/q has circles of T^q, other ones for another φ0: see `nasm.barriers`. An irrational Ω has
tori, for all φ0 at once:

1. `upper`: the lowest scale found at which converse KAM eliminates all starts, by the kicks from -N
   to N (`nasm.converse_kam.sequence`): no torus that is a graph is left.
2. Below it some starts survive. Weighted Birkhoff averages tell those on tori from those next to
   orbits that minimize the action, and their ω.
3. `lower`: the largest scale at which a torus of one of these ω is certified.

The last torus breaks inside the bracket. Its ω need not be that of `lower`.
"""

import numpy as np

from nasm.arithmetic.sine import cos2pi
from nasm.checks import count, real
from nasm.converse_kam import sequence
from nasm.critical import CriticalScale, Status
from nasm.maps import direction
from nasm.orbits import bump, orbit
from nasm.tori import newton

__all__ = ["of_irrational", "upper_scale"]

_BELOW = 1 - np.array([0.01, 0.02, 0.03, 0.05, 0.07, 0.09, 0.12, 0.15, 0.2, 0.25, 0.3])
_METHOD = "converse KAM, and continuation of what survives"
_TOL = 4e-3  # of upper
_STARTS = 1024
_AVERAGED = 4096  # kicks
_REGULAR = 1e-5  # turns per kick: regular if averages over all kicks and over half differ by less
_APART = 1e-3  # turns per kick: candidates that are nearer are one
_TRIED = 4  # candidates


def of_irrational(frequency, mean, amplitude, n_kicks=32_000, tol=0.01):
    """The last torus of an irrational Ω on the ray (κ̄, Δκ) = s·(mean, amplitude).

    frequency : float, Ω.
    mean, amplitude : floats, not both 0.
    n_kicks : int, 100 to 10⁶, N.
    tol : float, the error of a torus's breakup to aim at, in parts of `upper`.

    Returns CriticalScale. value is the middle of the bracket, and error half of its width; omega is
    None. Status UNDECIDED, and no value, if no torus was certified. Status NO_BREAKUP if a start
    survives kicks of strength 2, and no bounds; UNDECIDED if searches for survivors disagree.
    omega : float, turns per kick of the torus at lower, in [0, 1/2], NaN without one.
    """
    profile, tol = _kicks(frequency, mean, amplitude, n_kicks), real("tol", tol)
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
                torus = newton.critical_scale(candidate, frequency, mean, amplitude, tol * upper)
                if not torus.lower <= lower and np.isfinite(torus.lower):
                    lower, omega = torus.lower, candidate
    value, error = (lower + upper) / 2, (upper - lower) / 2
    status = Status.UNDECIDED if np.isnan(lower) else Status.OK
    return CriticalScale(value, error, lower, upper, None, status, _METHOD), omega


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
    sizes = len(steps), len(steps) // 2
    whole, half = ((bump(n)[:, None] * steps[:n]).sum(axis=0) for n in sizes)
    apart = np.abs(whole - half)
    order = [i for i in np.argsort(apart) if apart[i] < _REGULAR]
    return [abs(whole[i] - np.rint(whole[i])) for i in order]
