"""Converse KAM: starts through which no rotational invariant circle passes.

Along an orbit of the chain (see `nasm.action`) a tangent vector obeys the linearised chain

    v_{n+1} = (2 + κ_n cos 2πx_n) v_n - v_{n-1}.

For the start x_c = a at a symmetry centre (site c, a = 0 or 1/2), take the even solution

    v_0 = 1,   v_1 = v_{-1} = 1 + (κ_c/2) cos 2πa,   n counted from c.

If v_n ≤ 0 for some n, no rotational invariant circle passes through that start:

1. A rotational circle and its images under the kicks are graphs of Lipschitz functions, by
   Birkhoff's theorem for products of twist maps. (`proofs/README.md` derives it from the
   theorem for one twist map, if the kicks are weak enough.) On such a graph the kicks preserve the
   order of neighbouring points. As two such points approach each other, their normalised distances
   tend to a solution ξ_n > 0 of the linearised chain, for all n from -∞ to ∞.
2. Given such a ξ > 0, the second variation of the action of every finite piece of the orbit is
   positive: Σ_k η_k (Hη)_k = Σ_k ξ_k ξ_{k+1} (η_{k+1}/ξ_{k+1} - η_k/ξ_k)² > 0 for every η ≠ 0
   that vanishes outside the piece.
3. The orbit is its own mirror image about the centre, so v_{-n} = v_n. Let n be the first site at
   which v_n ≤ 0. Then the sequence η_k = v_k for |k| < n, and 0 elsewhere, yields
   Σ_k η_k (Hη)_k = 2 v_{n-1} v_n ≤ 0.

A circle is a graph, so it meets the line x_c = a at one point: if all y on the line are eliminated,
no rotational circle exists. The interval 0 ≤ y ≤ 1/2 suffices, by the symmetries y → y + 1 and
(x, y) → (-x, -y). The criterion is MacKay and Percival's, Commun. Math. Phys. 98 (1985) 469.

The line used is the dominant one: x = 1/2 before the stronger kick, or x = 0 if that kick is
negative. The minimax orbits have a point on this line, and starts on it are eliminated sooner than
on the other symmetry lines. With three or more kicks, minimax orbits of different ω may have their
points on different lines: `converse_kam.transversal` constructs a curve through them all.

If the last circle on a ray of forcings κ = s·profile breaks at the scale s_c, the longest lifetime
T on the line obeys, beyond the breakup,

    s/s_c - 1 ≈ C/T,

up to a log-periodic ripple of a few per cent. In the paper's plane C is 0.6 to 0.7 if T is in
steps (periods of the forcing), and half as large on |κ1| = |κ2|.

These results rely on sampled starts and floating-point arithmetic: they are strong evidence, but
not a proof. A search may miss a survivor; see `longest_lived`. For proofs, see
`nasm.proofs.transport`.

The kernel advances 64 starts in lockstep, with the kick of `nasm.escape` and its derivative:

    cos 2πx = -sign(r) Σ_k (2k + 1) c_k u²ᵏ,    w' = w + κ cos 2πx · v,   v' = v + w',

where w is the last difference of v. Elimination times are resolved to a single kick, because a
block in which v ≤ 0 occurs is replayed kick by kick.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import (
    LANES,
    copysign,
    fabs,
    fma,
    load,
    minimum,
    own_frame,
    rint,
    store,
)
from nasm.arithmetic.sine import COSINE, SINE
from nasm.checks import count, points
from nasm.escape import polynomial
from nasm.maps import direction, forcing
from nasm.results import CriticalScale, Status, no_answer
from nasm.symmetries import CUSP_EXPONENT, distances_to_shorter, dominant_centre, primitive
from nasm.types import FloatArray

__all__ = [
    "LineSettings",
    "LongestLived",
    "SearchSettings",
    "critical_scale",
    "elimination_time",
    "has_dominant_line",
    "longest_lived",
]

_METHOD = "converse KAM"
MAX_STEPS = 10**9

_LIFETIME_RATIO = 2 + 5**0.5
"""(1/γ)³, the factor by which lifetimes grow from one scale to the next."""


@dataclass(frozen=True)
class SearchSettings:
    """Settings of the beam search for the longest-lived start.

    A wider search is slower but more reliable.

    Attributes
    ----------
    grids : tuple of (int, float)
        For each grid, the number of starts on y from 0 to 1/2, and the position of a start in its
        cell, from 0 to 1. The grids have no start in common.
    width : int
        Number of starts from which the search continues at each level. See `longest_lived` for how
        often each width misses the longest lifetime.
    final_width : int
        Limit on `width` for cells smaller than 100·resolution/T², where T is the longest lifetime.
    children : int
        Number of new starts around each start from which the search continues.
    cell_ratio : float
        Factor by which the cell size changes from one level to the next.
    resolution : float
        The search ends when cells are smaller than resolution/T².

    Examples
    --------
    >>> from nasm.converse_kam.symmetry_line import LineSettings, SearchSettings, longest_lived
    >>> narrow = LineSettings(search=SearchSettings(width=4))
    >>> y, time = longest_lived((1.2, 0.9), 1000, narrow)
    >>> time <= longest_lived((1.2, 0.9), 1000)[1]
    True
    """

    grids: tuple[tuple[int, float], ...] = ((2048, 0.5), (1597, 0.382))
    width: int = 32
    final_width: int = 8
    children: int = 8
    cell_ratio: float = 0.15
    resolution: float = 0.01


@dataclass(frozen=True)
class LineSettings:
    """Settings of the search on the dominant line, and bounds for accepting the lifetime law.

    Attributes
    ----------
    search : SearchSettings
        The search for the longest-lived start.
    block_kicks : int
        Kicks between tests for v ≤ 0; even, so that each block starts a new period. It affects
        only the computing time.
    max_scales : int
        Maximum number of scales that `critical_scale` tries; it usually needs 10.
    min_slope, max_slope : float
        Bounds on slope/s_c in the law s - s_c = slope/T, with T in kicks; the upper bound is
        multiplied by the period P. On 63 random rays of 2 to 4 kicks and 88 rays close to the
        diagonal, slope/s_c was at least 0.68, and at most 1.01 P.

    Examples
    --------
    >>> from nasm.converse_kam.symmetry_line import LineSettings, critical_scale
    >>> critical_scale(1.0, 1000, LineSettings(max_scales=2)).status
    Status.NOT_CONVERGED
    """

    search: SearchSettings = SearchSettings()
    block_kicks: int = 32
    max_scales: int = 100
    min_slope: float = 0.4
    max_slope: float = 1.1


DEFAULT_SETTINGS = LineSettings()


@dataclass(frozen=True)
class LongestLived:
    """The start that takes longest to eliminate.

    Attributes
    ----------
    site : int
        Index, from 0, of the first kick applied to the start.
    x, y : float
        The start, in turns.
    kicks : float
        Kicks until the start is eliminated; inf if it survives.

    Examples
    --------
    >>> from nasm.converse_kam.symmetry_line import LongestLived
    >>> LongestLived(site=0, x=0.5, y=0.4, kicks=120.0).kicks
    120.0
    """

    site: int
    x: float
    y: float
    kicks: float


def elimination_time(
    kappa: ArrayLike, y: ArrayLike, n_max: int, settings: LineSettings = DEFAULT_SETTINGS
) -> FloatArray:
    """Compute when each start on the dominant symmetry line is eliminated.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first; they must repeat after one or two kicks.
    y : array_like
        Starts on the dominant line, in turns.
    n_max : int
        Steps (periods of the forcing), 1 to 10⁹.
    settings : LineSettings
        Only `block_kicks` is used.

    Returns
    -------
    ndarray, shape of y
        Steps, a multiple of 1/P, until v ≤ 0; inf for a start that survives n_max steps. A finite
        time shows that no rotational circle passes through the start.

    Raises
    ------
    ValueError
        If the forcing does not repeat after one or two kicks, or an argument is out of range.

    Examples
    --------
    >>> from nasm.converse_kam.symmetry_line import elimination_time
    >>> elimination_time(1.5, [0.0, 0.3], 100)
    array([2., 2.])
    """
    _, y = points(0.0, y)
    n_max = count("n_max", n_max, 1, MAX_STEPS)
    strengths = forcing(kappa)
    line = _line_coefficients(strengths, settings)
    kicks = _lifetimes(line, y.ravel(), strengths.size * n_max)
    return kicks.reshape(y.shape) / strengths.size


def longest_lived(
    kappa: ArrayLike, n_max: int, settings: LineSettings = DEFAULT_SETTINGS
) -> tuple[float, float]:
    """Find the start on the dominant symmetry line that takes longest to eliminate.

    Parameters
    ----------
    kappa, n_max
        As for `elimination_time`.
    settings : LineSettings
        How the line is searched.

    Returns
    -------
    y : float
        The start, in [0, 1/2] up to the size of a cell.
    time : float
        Its elimination time in steps; inf if the start survives n_max steps, in which case other
        starts may survive even longer.

    Notes
    -----
    A beam search is run on each of two unrelated grids, of 2048 and 1597 starts. At each level,
    each of the longest-lived starts is replaced by 8 children, 0.15 cells apart. The search ends
    when the cells are so small that neighbouring starts have nearly the same lifetime. It may miss
    the longest lifetime, and with it a survivor. It was tested in 992 searches at 2% to 0.002%
    beyond the breakup, a third of them within a degree of the diagonals. With a width of 32 or 16,
    no search missed the longest lifetime by more than 1%; with smaller widths, 4% (8), 20% (4) and
    77% (1) of the searches did. Dense scans of 2²⁴ starts did not find longer lifetimes.

    Examples
    --------
    >>> from nasm.converse_kam.symmetry_line import longest_lived
    >>> y, time = longest_lived((1.2, 0.9), 1000)
    >>> 0 <= y <= 0.5 and time < 1000
    True
    """
    strengths = forcing(kappa)
    n_max = count("n_max", n_max, 1, MAX_STEPS)
    line, n_kicks = _line_coefficients(strengths, settings), strengths.size * n_max
    y, time = search_grids(lambda y: _lifetimes(line, y, n_kicks), settings.search)
    return y, time / strengths.size


def critical_scale(
    profile: ArrayLike, n_max: int, settings: LineSettings = DEFAULT_SETTINGS
) -> CriticalScale:
    """Compute where the last circle breaks on κ = s·profile, and a scale at which no circle exists.

    1. Start at the scale at which the largest strength is 2; there the first kick eliminates all
       starts.
    2. Lower the scale step by step, so that the longest lifetime T grows by a factor of 4.2 each
       time, until it is close to n_max. Each scale is predicted by the law s - s_c = slope/T,
       fitted to the last two scales. The last scale is `upper`.
    3. `value` is the limit of the law for T → ∞.

    Parameters
    ----------
    profile : array_like, shape (P,)
        Direction of the ray, not zero; it must repeat after one or two kicks.
    n_max : int
        Steps (periods of the forcing), 100 to 10⁹. In the paper's plane upper/value - 1 is
        0.6/n_max to 1/n_max, and half as large on the diagonals.
    settings : LineSettings
        Settings of the search, and bounds on the slope of the law.

    Returns
    -------
    CriticalScale
        upper : no start was found to survive n_max steps at this scale. error : a third of
        upper - value, or all of it near a cusp that lifetimes do not resolve. lower is NaN and
        omega is None, because the method does not find circles. The status is NOT_CONVERGED if
        `max_scales` is too small, or if lifetimes contradict each other or the law, e.g. because
        a search missed a survivor.

    Raises
    ------
    ValueError
        If profile is zero or tiny, or does not repeat after one or two kicks.

    Notes
    -----
    The factor 4.2 is (1/γ)³: the ripple repeats when T grows by a factor of 1/γ, if the last circle
    has a golden tail. True errors were typically 3% of upper - value, and at most 15%; near a
    cusp, at most 80%.

    Examples
    --------
    >>> from nasm.converse_kam.symmetry_line import critical_scale
    >>> scale = critical_scale(1.0, 1000)
    >>> abs(scale.value - 0.971635) < scale.error
    True
    """
    profile = direction(profile)
    n_kicks = profile.size * count("n_max", n_max, 100, MAX_STEPS)

    def lifetime(scale):
        line = _line_coefficients(scale * profile, settings)
        return search_grids(lambda y: _lifetimes(line, y, n_kicks), settings.search)[1]

    top = 2 / np.abs(profile).max()
    # The slope is guessed; a bad guess only costs time.
    upper, time, slope = _lower_scale(lifetime, top, 1.0, top / 2, n_kicks, settings.max_scales)
    slopes = settings.min_slope, settings.max_slope * profile.size
    gap = _gap(lifetime, upper, time, slope, *slopes)
    if np.isnan(gap):
        return no_answer(None, Status.NOT_CONVERGED, _METHOD)
    # Lifetimes follow the law of a similar forcing of shorter period until orbits resolve the
    # difference. On 150 rays this took 6 distance**-CUSP_EXPONENT steps.
    distances = distances_to_shorter(profile)
    nearest = distances.min(where=distances > 0, initial=np.inf)
    near_cusp = time < profile.size * 6 * nearest**-CUSP_EXPONENT
    error = gap if near_cusp else gap / 3
    return CriticalScale(upper - gap, error, np.nan, upper, None, Status.OK, _METHOD)


def _lower_scale(lifetime, scale, time, slope, n_kicks, max_scales):
    """Lower the scale until starts survive nearly n_kicks.

    Returns the lowest scale at which no start was found to survive, the longest lifetime there, and
    the slope of the law; NaN if `max_scales` is too small.
    """
    survived = 0.0  # the largest scale at which a start is known to survive
    for _ in range(max_scales):
        if time >= 0.8 * n_kicks or scale - survived < 0.05 * slope / time:
            return scale, time, slope
        target = min(0.9 * n_kicks, _LIFETIME_RATIO * time)
        fraction = (1 / target - 1 / n_kicks) / (1 / time - 1 / n_kicks)
        lower = max(
            scale - slope * (1 / time - 1 / target),
            survived + max(fraction, 0.1) * (scale - survived),
        )
        longer_time = lifetime(lower)
        if np.isinf(longer_time):
            survived = lower
            continue
        if longer_time > 1.5 * time:
            slope = (scale - lower) / (1 / time - 1 / longer_time)
        scale, time = lower, max(longer_time, time)
    return np.nan, np.nan, np.nan


def _gap(lifetime, scale, time, slope, min_slope, max_slope):
    """Return the distance from `scale` down to the breakup, from the law; NaN if the law fails."""
    higher = scale + (_LIFETIME_RATIO - 1) * slope / time
    if np.isnan(higher):
        return np.nan
    shorter_time = lifetime(higher)
    if not shorter_time < time:  # the search missed a survivor at the lower scale
        return np.nan
    gap = (higher - scale) / (time / shorter_time - 1)
    return gap if min_slope < gap * time / (scale - gap) < max_slope else np.nan


def has_dominant_line(kappa: ArrayLike) -> bool:
    """Return True if the minimax orbits of all ω have a point on the same symmetry line.

    This is the case if the forcing repeats after one or two kicks.

    Examples
    --------
    >>> from nasm.converse_kam.symmetry_line import has_dominant_line
    >>> has_dominant_line((0.3, 0.5)), has_dominant_line((0.3, 0.2, 0.25))
    (True, False)
    """
    return primitive(kappa).size <= 2


def _line_coefficients(strengths, settings=DEFAULT_SETTINGS):
    """Return the kernel's arguments for the dominant line.

    The arguments are the coefficients of the kicks of a block, as in `nasm.escape`, one kick per
    row; the number a - 1/4; and the first difference, v_0 - v_{-1} = |κ_c|/2.
    """
    strengths = primitive(strengths)
    if strengths.size > 2:
        raise ValueError(
            f"kappa={strengths.tolist()} has no dominant symmetry line; "
            "forcings of one or two kicks have one; for others see nasm.converse_kam.transversal"
        )
    site, a = dominant_centre(strengths)
    strengths = np.roll(strengths, -site)
    rows = np.resize(strengths, settings.block_kicks)
    w = float(strengths[0] if a else -strengths[0]) / 2
    return -rows[:, None] * np.array(SINE), a - 0.25, w


def _lifetimes(line, y, n_kicks):
    times = np.empty(y.size)
    _elimination_times(*line, y, n_kicks, times)
    return times


def search_grids(
    lifetimes: Callable[[NDArray[np.floating]], FloatArray],
    settings: SearchSettings,
    ends: tuple[float, float] = (0.0, 0.5),
) -> tuple[float, float]:
    """Run `beam_search` on each of the grids, until one finds a survivor."""
    starts = []
    for grid in settings.grids:
        starts.append(beam_search(lifetimes, *grid, settings, ends))
        if np.isinf(starts[-1][1]):
            break
    return max(starts, key=lambda start: start[1])


def beam_search(
    lifetimes: Callable[[NDArray[np.floating]], FloatArray],
    starts: int,
    offset: float,
    settings: SearchSettings,
    ends: tuple[float, float],
) -> tuple[float, float]:
    """Find y of the longest-lived start in an interval, or of a survivor, and its lifetime.

    Parameters
    ----------
    lifetimes : callable
        Maps an array of starts y to their lifetimes in kicks; inf for a survivor.
    starts, offset
        One of the grids of the settings: number of starts, and position of a start in its cell.
    settings : SearchSettings
    ends : pair of floats
        The interval. It contains its share of the grid's starts, but at least `settings.width`.

    Returns
    -------
    y, lifetime : float
    """
    starts = max(round(starts * 2 * (ends[1] - ends[0])), settings.width)
    cell = (ends[1] - ends[0]) / starts
    y = ends[0] + (np.arange(starts) + offset) * cell
    children, width, resolution = settings.children, settings.width, settings.resolution
    offsets = np.arange(children) - (children - 1) / 2
    best_y, best_time = ends[0], 0.0
    while True:
        times = lifetimes(y)
        longest = times.argmax()
        if times[longest] > best_time:
            best_y, best_time = float(y[longest]), float(times[longest])
        # The map shears: starts a cell apart are T cells apart after T kicks. Their lifetimes are
        # nearly equal if this separation is less than 1/T, the distance between neighbours on an
        # orbit of T kicks. Then a few parents are enough.
        if np.isinf(best_time) or cell * best_time**2 < resolution or cell < np.spacing(0.5):
            return best_y, best_time
        if cell * best_time**2 < 100 * resolution:
            width = min(width, settings.final_width)
        parents = y[np.argsort(-times, kind="stable")[:width]]
        cell *= settings.cell_ratio
        y = (parents[:, None] + cell * offsets).ravel()


@njit(forceinline=True)
def tangent_kick(c, n, x, y, v, w):
    """Apply kick n to points and tangent vectors; x is the shifted angle X of `nasm.escape`.

    The arguments x, y, v, w are lanes or floats.
    """
    r = x - rint(x)
    u = fabs(r) - 0.25
    q = u * u
    y = fma(polynomial(c, n, q), u, y)
    d = fma(q, COSINE[7], COSINE[6])
    for k in range(5, -1, -1):
        d = fma(d, q, COSINE[k])
    w = fma(copysign(d, r) * v, c[n, 0], w)
    return r + y, y, v + w, w


@njit(nogil=True)
def _advance(c, state):
    """Advance 64 starts by a block, in place.

    The rows of `state` are x, y, v, w, and the smallest v in the block.
    """
    own_frame()
    x = load(state, 0)
    y = load(state, LANES)
    v = load(state, 2 * LANES)
    w = load(state, 3 * LANES)
    smallest = v
    for n in range(0, c.shape[0], 2):  # unrolled by two: 1.1 times faster
        x, y, v, w = tangent_kick(c, n, x, y, v, w)
        smallest = minimum(smallest, v)
        x, y, v, w = tangent_kick(c, n + 1, x, y, v, w)
        smallest = minimum(smallest, v)
    store(state, 0, x)
    store(state, LANES, y)
    store(state, 2 * LANES, v)
    store(state, 3 * LANES, w)
    store(state, 4 * LANES, smallest)


@njit(nogil=True)
def _replay(c, state, lane):
    """Return the first kick of the block, counted from 1, after which v ≤ 0."""
    x, y, v, w = state[0, lane], state[1, lane], state[2, lane], state[3, lane]
    n = 0
    while v > 0:
        x, y, v, w = tangent_kick(c, n, x, y, v, w)
        n += 1
    return n


@kernel
def _elimination_times(c, x, w, y, n_max, times):
    """Write into `times`, for every start, the number of kicks until v ≤ 0; inf if above n_max.

    A lane whose start is finished is assigned the next start.
    """
    # An idle lane has v = NaN, which does not trigger the alarm. If x and y have no rounding
    # errors, an orbit may stay on an unstable periodic orbit forever; v then overflows to NaN, and
    # the start correctly counts as a survivor.
    state, before = np.full((5, LANES), np.nan), np.empty((5, LANES))
    start, age = np.full(LANES, -1), np.zeros(LANES, np.int64)
    next_start, n_active = 0, 0
    while True:
        oldest = 0
        for lane in range(LANES):
            if start[lane] < 0 and next_start < y.size:
                state[:4, lane] = (x, y[next_start], 1.0, w)
                start[lane], age[lane] = next_start, 0
                next_start, n_active = next_start + 1, n_active + 1
            if start[lane] >= 0:
                oldest = max(oldest, age[lane])
        if n_active == 0:
            return
        alarm = False
        while not alarm:
            before[:] = state
            _advance(c, state)
            age += c.shape[0]
            oldest += c.shape[0]
            alarm = oldest >= n_max
            for lane in range(LANES):
                alarm |= state[4, lane] <= 0
        for lane in range(LANES):
            is_eliminated = state[4, lane] <= 0
            if start[lane] >= 0 and (is_eliminated or age[lane] >= n_max):
                time = (
                    age[lane] - c.shape[0] + _replay(c, before, lane)
                    if is_eliminated
                    else n_max + 1
                )
                times[start[lane]] = time if time <= n_max else np.inf
                start[lane], state[2, lane] = -1, np.nan
                n_active -= 1
