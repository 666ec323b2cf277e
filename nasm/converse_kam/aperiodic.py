"""Aperiodic forcing by N kicks with phases: orbits that escape and graphs that do not persist.

    y_{n+1} = y_n + (κ_n/2π) sin 2π(x_n - θ_n),     x_{n+1} = x_n + y_{n+1},     n = 0, …, N - 1

The recorded field of `nasm.self_consistent` is such a sequence of kicks. A phase common to all
kicks only shifts x, and θ_n = nΩ yields the standard map in x - nΩ, y - Ω. In terms of
X_n = x_n - θ_n,

    X_{n+1} - 2X_n + X_{n-1} = (κ_n/2π) sin 2πX_n - (θ_{n+1} - 2θ_n + θ_{n-1}),

so only changes in the speed of the phase matter.

The sequence of kicks does not repeat, so there are no invariant circles. A barrier is a rotational
curve together with its images under the kicks. If all N + 1 of these curves are graphs of Lipschitz
functions of x, the distance between two neighbouring points, followed along their orbits, yields a
solution ξ_n > 0 of the linearised chain (see `nasm.converse_kam.symmetry_line`). The criterion of
`nasm.converse_kam.transversal`, applied to a start before kick `site`, then shows that no such
family of graphs passes through the start if for some n

    v_{n+1} = (2 + κ_n cos 2π(x_n - θ_n)) v_n - v_{n-1} ≤ 0,   v_site = 0,  v_{site+1} = 1,

or if the same inequality holds for the backward chain, or if that module's inequality for sums
holds. Every graph crosses the line x = a. So if, before one kick, all starts on this line are
eliminated, no family of graphs exists. By the symmetry y → y + 1, the interval 0 ≤ y ≤ 1 suffices.

The absence of such graphs does not imply transport. For aperiodic forcing no theorem like
Birkhoff's states that barriers are graphs: `asymptotic` computes curves that are nearly invariant
circles after some kick, but fold before it. So apply the criterion to kicks over which the forcing
has settled, and search for orbits that escape: only such orbits show transport. Results for N kicks
say nothing about later kicks.

For κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ), θ_n = 0, one line without survivors therefore shows, within
the limits of sampling:

- Ω = p/q: no rotational circle exists for this φ0. By the theorem for products of twist maps,
  each circle is a graph before every kick. Other values of φ0 yield other forcings, which may
  have circles.
- Ω irrational: no invariant torus y = g(x, φ) exists that is Lipschitz in x. Such a torus would be
  a family of graphs for every φ0, so one φ0 and one line suffice: the line with the shortest
  lifetimes. Tori that fold are not excluded: the only evidence against them comes from the
  continuation of tori and from orbits that escape.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import cos2pi
from nasm.checks import count, floats, points, real
from nasm.converse_kam.symmetry_line import LongestLived, SearchSettings, search_grids
from nasm.maps import MAX_STRENGTH, direction, forcing, kick, unkick
from nasm.results import CriticalScale, Status, no_answer
from nasm.types import FloatArray

__all__ = [
    "AperiodicSettings",
    "around_strongest",
    "asymptotic",
    "critical_scale",
    "elimination_time",
    "escape_time",
    "last_survivor",
]

_METHOD = "converse KAM"
HORIZON = 200
"""Largest lifetime, in kicks, that is accepted as evidence that no graph persists.

If kicks grow beyond the breakup, rounding errors drive computed orbits away from a minimizing
orbit: before the kick of strength κ_G in the ramp κ_G + 0.003·n, the longest lifetime found is 233
kicks, while an orbit segment found by Newton's method survives 279. On lines before later kicks,
the lifetimes found agree with those found by a search for such segments, or are up to 6% longer
(29 lines, in ramps in which the strength grows by 10⁻² to 10⁻⁷ per kick)."""

DEFAULT_SEARCH = SearchSettings(resolution=0.0)


@dataclass(frozen=True)
class AperiodicSettings:
    """Settings for the lines on which survivors are sought, and for the search on them.

    Attributes
    ----------
    search : SearchSettings
        The search on a line; `effort` multiplies its number of starts and its width. Its resolution
        is 0, because no orbit recurs: starts may have different lifetimes even if they are so close
        that the shear of a periodic map would not separate them.
    max_lines : int
        Maximum number of lines that `last_survivor` searches.
    middle_kicks : int
        Every line but the first precedes a kick that is fewer than this many kicks from the middle.
    lower_ratios : tuple of float
        `critical_scale` looks for a lower scale without survivors at these multiples of the lowest
        such scale found so far, in this order.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.converse_kam.aperiodic import AperiodicSettings, last_survivor
    >>> last_survivor(np.full(201, 1.2), settings=AperiodicSettings(max_lines=1)).kicks < 100
    True
    """

    search: SearchSettings = DEFAULT_SEARCH
    max_lines: int = 8
    middle_kicks: int = 32
    lower_ratios: tuple[float, ...] = (0.85, 0.88, 0.91, 0.94, 0.96, 0.98)


DEFAULT_SETTINGS = AperiodicSettings()


def escape_time(
    kappa: ArrayLike, theta: ArrayLike, x: ArrayLike, y: ArrayLike, window: ArrayLike
) -> FloatArray:
    """Compute the kick after which each orbit is outside the window for the first time.

    Parameters
    ----------
    kappa : array_like, shape (N,)
        Strengths of the kicks.
    theta : float or array_like, shape (N,)
        Their phases, in turns.
    x, y : array_like
        Starts before the first kick, in turns. Their shapes must broadcast.
    window : (lo, hi)
        y is inside while lo ≤ y ≤ hi.

    Returns
    -------
    ndarray, shape of x
        Kicks, counted from 1; 0 for a start outside, inf for no escape in N kicks.

    Raises
    ------
    ValueError
        If an argument is not finite, empty, or out of range; the message names it.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.converse_kam.aperiodic import escape_time
    >>> escape_time(np.full(20, 6.0), 0.0, 0.25, [0.0, 2.0], (-1, 1))
    array([2., 0.])
    """
    kappa, theta = aperiodic_forcing(kappa, theta)
    x, y = points(x, y)
    ends = floats("window", window)
    if ends.shape != (2,) or not ends[0] < ends[1]:
        raise ValueError(f"window={window!r} must be (lo, hi) with lo < hi")
    return _escape_times(kappa, theta, x.ravel(), y.ravel(), *ends.tolist()).reshape(x.shape)


def elimination_time(
    kappa: ArrayLike, theta: ArrayLike, site: int, x: ArrayLike, y: ArrayLike
) -> FloatArray:
    """Compute when each start (x, y) before kick `site` is eliminated; see the module docstring.

    Parameters
    ----------
    kappa, theta, x, y
        As for `escape_time`.
    site : int
        Index of the kick, 0 to N - 1.

    Returns
    -------
    ndarray, shape of x
        Number of kicks followed in each direction until the start is eliminated; inf if it survives
        all N kicks. A finite time shows that no family of graphs passes through the start.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.converse_kam.aperiodic import elimination_time
    >>> elimination_time(np.full(41, 1.5), 0.0, 20, 0.5, [0.0, 0.3])
    array([2., 2.])
    """
    kappa, theta = aperiodic_forcing(kappa, theta)
    x, y = points(x, y)
    site = count("site", site, 0, kappa.size - 1)
    times = _elimination_times(kappa, theta, site, x.ravel(), y.ravel(), False)
    return times.reshape(x.shape)


def longest_lived(
    kappa: ArrayLike,
    theta: ArrayLike,
    site: int,
    effort: int = 1,
    settings: AperiodicSettings = DEFAULT_SETTINGS,
) -> tuple[float, float, float]:
    """Find the longest-lived start on a line x = a before kick `site`.

    The line is the one on which 2 + κ cos 2π(a - θ) is smallest: a = θ + 1/2 if κ > 0, and a = θ
    otherwise.

    Parameters
    ----------
    kappa, theta, site
        As for `elimination_time`.
    effort : int
        Factor, 1 to 100, that multiplies the number of starts on the first grids and the width of
        the search.
    settings : AperiodicSettings
        Only its `search` is used.

    Returns
    -------
    x, y : float
        The start, y in [0, 1].
    time : float
        Number of kicks followed in each direction until the start is eliminated; inf if it survives
        all N kicks. The search ends at the first such start.

    Notes
    -----
    The beam search of `symmetry_line.longest_lived` may miss the longest lifetime: on 18 lines in
    fields of 4096 particles, with lifetimes of 50 to 1750, the lifetimes found with an effort of 64
    were up to 1.7 times as long as with an effort of 1, and up to 1.3 times as long as with an
    effort of 8. An effort of 64 also found one survivor of 2048 kicks where the longest lifetime
    found with an effort of 1 was 1963.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.converse_kam.aperiodic import longest_lived
    >>> x, y, time = longest_lived(np.full(201, 1.2), 0.0, 100)
    >>> x, time < 100
    (0.5, True)
    """
    kappa, theta = aperiodic_forcing(kappa, theta)
    site = count("site", site, 0, kappa.size - 1)
    effort = count("effort", effort, 1, 100)
    x = theta[site] + (0.5 if kappa[site] > 0 else 0.0)

    def lifetimes(half):  # the search covers [0, 1/2], and y is in [0, 1]
        return _elimination_times(kappa, theta, site, np.full(half.size, x), 2 * half, True)

    grids = tuple((effort * starts, offset) for starts, offset in settings.search.grids)
    search = replace(settings.search, grids=grids, width=effort * settings.search.width)
    half, time = search_grids(lifetimes, search)
    return float(x), 2 * half, time


def last_survivor(
    kappa: ArrayLike,
    theta: ArrayLike = 0.0,
    effort: int = 8,
    settings: AperiodicSettings = DEFAULT_SETTINGS,
) -> LongestLived:
    """Find the longest-lived start on the first line where all starts are eliminated.

    Up to `settings.max_lines` lines are searched: one before the strongest kick, and the others
    before the strongest kicks near the middle.

    Parameters
    ----------
    kappa, theta
        As for `escape_time`.
    effort : int
        As for `longest_lived`.
    settings : AperiodicSettings
        Settings for the lines and for the search on them.

    Returns
    -------
    LongestLived
        The start described above. If a start survives all N kicks on each line, the survivor on
        the first line is returned instead; then a family of graphs may or may not exist.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.converse_kam.aperiodic import last_survivor
    >>> last_survivor(np.full(201, 1.2)).kicks < 100
    True
    """
    (kappa, theta), effort = aperiodic_forcing(kappa, theta), count("effort", effort, 1, 100)
    from_middle, survivors = np.abs(np.arange(kappa.size) - kappa.size // 2), []
    for site in _sites_of_lines(np.abs(kappa), from_middle, settings):
        for effort_on_line in sorted({1, effort}):  # a small effort usually finds a survivor
            start = longest_lived(kappa, theta, site, effort_on_line, settings)
            longest = LongestLived(site, *start)
            if longest.kicks == np.inf:
                break
        else:
            return longest
        survivors.append(longest)
    return survivors[0]


def around_strongest(kappa: ArrayLike) -> FloatArray:
    """Repeat a periodic forcing, and return the 1601 kicks around its strongest kick.

    No circle of the forcing exists if no family of graphs persists through these kicks.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.

    Examples
    --------
    >>> from nasm.converse_kam.aperiodic import around_strongest
    >>> around_strongest((0.1, 0.3, 0.2))[799:802]
    array([0.1, 0.3, 0.2])
    """
    kappa = forcing(kappa)
    reach = 4 * HORIZON
    return np.roll(kappa, -np.abs(kappa).argmax())[np.arange(-reach, reach + 1) % kappa.size]


def _sites_of_lines(size, from_middle, settings):
    """List the site of the largest |κ|, and sites near the middle with the largest distinct |κ|."""
    order = np.lexsort((from_middle, -size))
    inner = order[from_middle[order] < settings.middle_kicks]
    _, distinct = np.unique(size[inner].round(12), return_index=True)
    sites = dict.fromkeys([order[0].item(), *inner[np.sort(distinct)].tolist()])
    return list(sites)[: settings.max_lines]


def critical_scale(
    profile: ArrayLike, tol: float = 1e-3, settings: AperiodicSettings = DEFAULT_SETTINGS
) -> CriticalScale:
    """Compute the lowest scale at which no family of graphs survives the N kicks κ = s·profile.

    1. Bisect between a scale at which a start survives the middle quarter of the kicks and a scale
       at which no start does. Using a quarter leaves a margin: a start that a search misses may
       have a longer lifetime than the longest-lived one found, but seldom one four times as long.
    2. Starts close to orbits that minimize the action have longer lifetimes than others, and may
       survive even above a scale without survivors. Therefore search up to 15% lower, and begin
       again from the lowest scale without survivors.
    3. At the end, search for survivors of all N kicks with an effort of 8.

    Parameters
    ----------
    profile : array_like, shape (N,)
        Direction of the ray, not zero; N ≥ 64.
    tol : float
        Relative width of the bracket, 10⁻⁶ to 10⁻¹.
    settings : AperiodicSettings
        The lines, the search on them, and the ratios at which lower scales are sought.

    Returns
    -------
    CriticalScale
        upper : on one of the lines of `last_survivor`, no start survives at this scale. value is
        the middle of the bracket, and error half of its width. lower is NaN and omega None, because
        survivors do not imply barriers. The larger the number of kicks, the lower the scale. The
        status is NO_BREAKUP if a start survives kicks of strength 2, and UNDECIDED if the search at
        the end finds a survivor.

    Raises
    ------
    ValueError
        If profile is too short, zero or tiny, or tol is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.converse_kam.aperiodic import critical_scale
    >>> scale = critical_scale(np.ones(201), 0.05)
    >>> 0.97 < scale.upper < 1.1
    True
    """
    profile, tol = direction(profile), real("tol", tol, 1e-6, 0.1)
    min_kicks = 2 * settings.middle_kicks
    if profile.size < min_kicks:
        raise ValueError(f"profile has {profile.size} kicks; it must have {min_kicks} or more")
    reach = profile.size // 8
    inner = profile[profile.size // 2 - reach : profile.size // 2 + reach + 1]

    def eliminated(scale):
        return last_survivor(scale * inner, 0.0, 1, settings).kicks < np.inf

    survived, upper = 0.0, 2 / np.abs(inner).max()
    if not eliminated(upper):
        return no_answer(None, Status.NO_BREAKUP, _METHOD)
    while True:
        while upper - survived > tol * upper:
            scale = (survived + upper) / 2
            survived, upper = (survived, scale) if eliminated(scale) else (scale, upper)
        value, error, survived = (survived + upper) / 2, (upper - survived) / 2, 0.0
        for below in upper * np.array(settings.lower_ratios):
            if eliminated(below):
                upper = below
                break
            survived = below
        else:
            break
    if last_survivor(upper * profile, settings=settings).kicks == np.inf:
        return no_answer(None, Status.UNDECIDED, _METHOD)
    return CriticalScale(value, error, np.nan, upper, None, Status.OK, _METHOD)


def asymptotic(
    kappa: ArrayLike, theta: ArrayLike, limit: float, x: ArrayLike, y: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Compute starts whose orbits converge to the orbits of (x, y) under the limit map.

    They are

        K_0 = S_{κ_0}⁻¹ ∘ … ∘ S_{κ_{N-1}}⁻¹ ∘ S_limit^N (x, y).

    For points (x, y) = K(ϑ) of an invariant circle of S_limit, the last factor yields K(ϑ + Nω). If
    kappa → limit and theta → 0 fast enough, K_0 converges as N grows: it is the asymptotic circle
    of Canadell & de la Llave (Physica D 310 (2015) 104). K_0 is not invariant, but its images
    converge to an invariant circle, and it bounds the same area as that circle. It may fold; see
    the module docstring.

    Parameters
    ----------
    kappa, theta, x, y
        As for `escape_time`.
    limit : float
        Strength of the limit map.

    Returns
    -------
    x, y : ndarrays
        The points K_0, on the lift.

    Examples
    --------
    >>> from nasm.converse_kam.aperiodic import asymptotic
    >>> x, y = asymptotic([0.5, 0.5], 0.0, 0.5, 0.1, 0.3)  # the limit map itself
    >>> print(x.round(12), y.round(12))
    0.1 0.3
    """
    kappa, theta = aperiodic_forcing(kappa, theta)
    x, y = points(x, y)
    (limit,) = forcing([limit], "limit")
    for _ in kappa:
        x, y = kick(limit, x, y)
    for strength, phase in zip(kappa[::-1], theta[::-1], strict=True):
        x, y = unkick(strength, x, y, phase)
    return x, y


def aperiodic_forcing(kappa: ArrayLike, theta: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Check strengths and phases, and return them as arrays of shape (N,).

    Raises
    ------
    ValueError
        If they cannot be converted to such arrays, or are out of range.

    Examples
    --------
    >>> from nasm.converse_kam.aperiodic import aperiodic_forcing
    >>> aperiodic_forcing([0.3, 0.4], 0.5)[1]
    array([0.5, 0.5])
    """
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
    # 2 + κ cos … bounds the sum only if there are graphs before and after this one. No graph
    # precedes the one at site 0.
    bound = 2 + kappa[site] * cos2pi(x - theta[site]) if site > 0 else np.inf
    if bound <= 0:
        return 1.0
    # The backward chain has the kicks in reverse order.
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
