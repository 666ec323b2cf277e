"""A finite sequence of kicks with phases: orbits that leave, curves that cannot stay graphs.

    y_{n+1} = y_n + (κ_n/2π) sin 2π(x_n - θ_n),     x_{n+1} = x_n + y_{n+1},     n = 0, …, N - 1

The recorded field of `nasm.self_consistent` is such a sequence. A phase that is the same in all
kicks is a shift of x, and θ_n = nΩ is the standard map in x - nΩ, y - Ω. In X_n = x_n - θ_n

    X_{n+1} - 2X_n + X_{n-1} = (κ_n/2π) sin 2πX_n - (θ_{n+1} - 2θ_n + θ_{n-1}):

only changes of the phase's speed matter.

Nothing recurs, so there are no invariant circles. A barrier is a rotational curve and its images,
one before each kick. If all N + 1 of them are graphs of Lipschitz functions of x, the distances of
neighbours on an orbit give a solution ξ_n > 0 of the linearised chain (see
`nasm.converse_kam.symmetry_line`). The criterion of `nasm.converse_kam.transversal`, read along a
start before the kick of a site, then shows that no such family of graphs passes through the start,

    v_{n+1} = (2 + κ_n cos 2π(x_n - θ_n)) v_n - v_{n-1} ≤ 0,   v_site = 0,  v_{site+1} = 1,

and likewise backwards, or by the sum there. All graphs cross the line x = a before a kick: if all
its starts are eliminated, y from 0 to 1 by the symmetry y → y + 1, there is no family of graphs.

What is not shown: that nothing holds orbits back. For sequences there is no theorem like Birkhoff's
that barriers are graphs: `asymptotic` gives curves that are as good as circles from some kick on,
and that fold before. So ask about kicks among which the forcing has settled, and look for orbits
that escape: they alone show transport. And N kicks say nothing of the next ones.

So of κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ), θ_n = 0, one line without survivors shows, as far as samples do:

- Ω = p/q: no rotational circle under this φ0. By the theorem for products of twist maps each is a
  graph before every kick. Other φ0 are other forcings, and may have circles.
- Ω irrational: no invariant torus y = g(x, φ) that is Lipschitz in x. It would be a family of
  graphs for every φ0, so one φ0 is enough, and the line on which lives are shortest. Tori that fold
  are not denied: that none are left is only measured, by their continuation and by escapes.
"""

import numpy as np
from numba import njit

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import cos2pi
from nasm.checks import count, floats, points, real
from nasm.converse_kam.symmetry_line import GRIDS, KEPT, Survivor, longest_found
from nasm.critical import CriticalScale, Status, no_answer
from nasm.maps import MAX_STRENGTH, direction, forcing, kick, unkick

__all__ = ["asymptotic", "critical_scale", "elimination_time", "escape_time", "last_survivor"]

_METHOD = "converse KAM"
HORIZON = 200
"""Kicks, the longest life by which a search denies.

Where kicks outgrow the breakup a minimizing orbit is lost in rounding: before the kick of κ_G in
κ_G + 0.003·n the longest life found is 233 kicks, and a segment found by Newton's method survives
279. On lines before later kicks lives are those that a search of segments finds, or up to 6% longer
(29 lines in ramps from 10⁻² to 10⁻⁷). So a longer life is no denial where the kicks change."""
_LINES = 8  # at most, on which `last_survivor` looks
_MIDDLE = 32  # kicks on either side of the middle
_BELOW = np.array([0.85, 0.88, 0.91, 0.94, 0.96, 0.98])


def escape_time(kappa, theta, x, y, window):
    """The kick after which each orbit is outside the window for the first time.

    kappa : array (N,), strengths. theta : float or array (N,), phases in turns.
    x, y : arrays that broadcast to one shape, starts before the first kick.
    window : (lo, hi), y is inside while lo ≤ y ≤ hi.

    Returns ndarray of float64, shape of x: kicks, counted from 1; 0 for a start outside, inf for no
    escape in N kicks.

    ValueError if an argument is not finite, empty, or out of range; the message names it.
    """
    kappa, theta = sequence(kappa, theta)
    x, y = points(x, y)
    ends = floats("window", window)
    if ends.shape != (2,) or not ends[0] < ends[1]:
        raise ValueError(f"window={window!r} must be (lo, hi) with lo < hi")
    return _escape_times(kappa, theta, x.ravel(), y.ravel(), *ends.tolist()).reshape(x.shape)


def elimination_time(kappa, theta, site, x, y):
    """When each start (x, y) before the kick of `site` is eliminated, see the module.

    kappa, theta, x, y : as for `escape_time`; site : int, 0 to N - 1.

    Returns ndarray of float64, shape of x: the kicks in either direction that it takes; inf for a
    start that survives all N. A finite time shows that no family of graphs passes through the
    start.
    """
    kappa, theta = sequence(kappa, theta)
    x, y = points(x, y)
    site = count("site", site, 0, kappa.size - 1)
    times = _elimination_times(kappa, theta, site, x.ravel(), y.ravel(), False)
    return times.reshape(x.shape)


def longest_lived(kappa, theta, site, effort=1):
    """The start on a line x = a before the kick of `site` that takes longest to be eliminated.

    kappa, theta, site : as for `elimination_time`; a is where the kick turns orbits back, θ + 1/2
        if κ > 0.
    effort : int, 1 to 100, the parts into which the starts of the first grids are divided.

    Returns x, y : floats, y in [0, 1]. time : float, kicks in either direction; inf for a start
    that survives all N, which need not be the last one.

    The beam search of `symmetry_line.longest_lived` may miss the longest: on 18 lines in fields of
    4096 particles, longest lives 50 to 1750, an effort of 64 found lives up to 1.7 times those of
    effort 1, and up to 1.3 times those of effort 8, and one survivor of 2048 kicks where an effort
    of 1 had found 1963.
    """
    kappa, theta = sequence(kappa, theta)
    site = count("site", site, 0, kappa.size - 1)
    effort = count("effort", effort, 1, 100)
    x = theta[site] + (0.5 if kappa[site] > 0 else 0.0)

    def lifetimes(half):  # the search knows y from 0 to 1/2
        return _elimination_times(kappa, theta, site, np.full(half.size, x), 2 * half, True)

    grids = [(effort * starts, offset) for starts, offset in GRIDS]
    # No orbit recurs: starts that the shear of a map would not part have unlike lives, so go on.
    half, time = longest_found(lifetimes, grids, effort * KEPT, apart=0.0)
    return float(x), 2 * half, time


def last_survivor(kappa, theta=0.0, effort=8):
    """Try up to eight lines; return the longest-lived start of the first line on which every start
    is eliminated within N kicks.

    They are before the strongest kick, and before the strongest of the 64 in the middle. If a start
    survives on each of them, it is the first of these: a family of graphs may be left, or not.

    kappa, theta : as for `escape_time`; effort : as for `longest_lived`.
    """
    (kappa, theta), effort = sequence(kappa, theta), count("effort", effort, 1, 100)
    from_middle, first = np.abs(np.arange(kappa.size) - kappa.size // 2), None
    for site in _lines(np.abs(kappa), from_middle):
        for parts in sorted({1, effort}):  # a survivor is mostly found with little effort
            found = Survivor(site, *longest_lived(kappa, theta, site, parts))
            if found.kicks == np.inf:
                break
        else:
            return found
        first = first or found
    return first


def _lines(size, from_middle):
    """The site of the largest |κ|, and in the middle those of the largest |κ| that differ."""
    order = np.lexsort((from_middle, -size))
    inner = order[from_middle[order] < _MIDDLE]
    _, distinct = np.unique(size[inner].round(12), return_index=True)
    return list(dict.fromkeys([order[0].item(), *inner[np.sort(distinct)].tolist()]))[:_LINES]


def critical_scale(profile, tol=1e-3):
    """The lowest scale found at which no family of graphs survives the N kicks κ = s·profile.

    1. Halve the bracket between a scale with survivors of the middle quarter of the kicks and one
       without: what a search misses may live longer than what it finds, but seldom four times.
    2. Starts next to orbits that minimize the action outlive others, so that scales with survivors
       are no interval: look up to 15% further down, and begin again from the lowest without.
    3. At the end look for survivors of all kicks, with an effort of 8.

    profile : array (N,), N ≥ 64, not all 0.
    tol : float, 10⁻⁶ to 10⁻¹, the bracket's relative width.

    Returns CriticalScale. upper : no start survives there on one of the lines of `last_survivor`.
    value is the middle of the bracket, and error half of its width. lower is NaN and omega None:
    survivors show no barrier. More kicks have a smaller scale. Status NO_BREAKUP if a start
    survives kicks of strength 2, and UNDECIDED if the search at the end finds one.

    ValueError if profile is shorter, zero or tiny, or tol is out of range.
    """
    profile, tol = direction(profile), real("tol", tol, 1e-6, 0.1)
    if profile.size < 2 * _MIDDLE:
        raise ValueError(f"profile has {profile.size} kicks; it must have {2 * _MIDDLE} or more")
    reach = profile.size // 8
    inner = profile[profile.size // 2 - reach : profile.size // 2 + reach + 1]

    def eliminated(scale):
        return last_survivor(scale * inner, 0.0, 1).kicks < np.inf

    survived, upper = 0.0, 2 / np.abs(inner).max()
    if not eliminated(upper):
        return no_answer(None, Status.NO_BREAKUP, _METHOD)
    while True:
        while upper - survived > tol * upper:
            scale = (survived + upper) / 2
            survived, upper = (survived, scale) if eliminated(scale) else (scale, upper)
        value, error, survived = (survived + upper) / 2, (upper - survived) / 2, 0.0
        for below in upper * _BELOW:
            if eliminated(below):
                upper = below
                break
            survived = below
        else:
            break
    if last_survivor(upper * profile).kicks == np.inf:
        return no_answer(None, Status.UNDECIDED, _METHOD)
    return CriticalScale(value, error, np.nan, upper, None, Status.OK, _METHOD)


def asymptotic(kappa, theta, limit, x, y):
    """Pull points (x, y) of the limit map back through the sequence: orbits of the returned starts
    converge to their orbits.

        K_0 = S_{κ_0}⁻¹ ∘ … ∘ S_{κ_{N-1}}⁻¹ ∘ S_limit^N (x, y)

    For points of an invariant circle of S_limit, K(ϑ), the last factor is K(ϑ + Nω), and K_0 is the
    asymptotic circle of Canadell & de la Llave (Physica D 310 (2015) 104), if kappa → limit and
    theta → 0 fast enough: it converges as N grows, and is no invariant circle, but its images come
    to one. It bounds the same area as that one. It may fold; see the module.

    kappa, theta, x, y : as for `escape_time`. limit : float.

    Returns x, y : ndarrays, on the lift.
    """
    kappa, theta = sequence(kappa, theta)
    x, y = points(x, y)
    (limit,) = forcing([limit], "limit")
    for _ in kappa:
        x, y = kick(limit, x, y)
    for strength, phase in zip(kappa[::-1], theta[::-1], strict=True):
        x, y = unkick(strength, x, y, phase)
    return x, y


def sequence(kappa, theta):
    """Strengths and phases as float arrays (N,); ValueError if they are no such vectors."""
    kappa = forcing(kappa)
    theta = floats("theta", theta)
    if theta.shape not in ((), kappa.shape) or not (np.abs(theta) <= MAX_STRENGTH).all():
        raise ValueError(
            f"theta={theta!r} must be one phase, or one for each of the {kappa.size} kicks, from "
            f"-{MAX_STRENGTH:g} to {MAX_STRENGTH:g} turns"
        )
    return kappa, np.ascontiguousarray(np.broadcast_to(theta, kappa.shape))


@kernel
def _escape_times(kappa, theta, x, y, lo, hi):
    times = np.empty(x.size)
    for i in range(x.size):
        xt, yt, n = x[i], y[i], 0
        while n < kappa.size and lo <= yt <= hi:
            xt, yt = kick(kappa[n], xt, yt, theta[n])
            n += 1
        times[i] = np.inf if lo <= yt <= hi else n
    return times


@kernel
def _elimination_times(kappa, theta, site, x, y, one_is_enough):
    times = np.zeros(x.size)
    for i in range(x.size):
        times[i] = _elimination_time(kappa, theta, site, x[i], y[i])
        if one_is_enough and np.isinf(times[i]):
            break
    return times


@njit(nogil=True)
def _elimination_time(kappa, theta, site, x, y):
    # The curves before kicks 0 to N are graphs: 2 + κ cos … bounds a sum only between two of them.
    bound = 2 + kappa[site] * cos2pi(x - theta[site]) if site > 0 else np.inf
    if bound <= 0:
        return 1.0
    # Backwards the chain is one with the kicks in reverse order.
    ahead, p = kick(kappa[site], x, y, theta[site])
    behind, q = x - y, -y
    v_before, v, u_before, u, total = 0.0, 1.0, 0.0, 1.0, 0.0
    for n in range(1, max(kappa.size - site, site)):
        i, j = site + n, site - n
        if i < kappa.size:
            v_before, v = v, (2 + kappa[i] * cos2pi(ahead - theta[i])) * v - v_before
            if v <= 0:
                return n + 1.0
            total += 1 / (v_before * v)
            ahead, p = kick(kappa[i], ahead, p, theta[i])
        if j > 0:
            u_before, u = u, (2 + kappa[j] * cos2pi(behind - theta[j])) * u - u_before
            if u <= 0:
                return n + 1.0
            total += 1 / (u_before * u)
            behind, q = kick(kappa[j], behind, q, theta[j])
        if total >= bound:
            return n + 1.0
    return np.inf
