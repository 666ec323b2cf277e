"""Converse KAM: starts through which no rotational invariant circle passes.

Along an orbit of the chain (see `nasm.action`) a tangent vector obeys the linearised chain

    v_{n+1} = (2 + κ_n cos 2πx_n) v_n - v_{n-1}.

Through the start x_c = a on a symmetry centre (site c, a = 0 or 1/2) take the even solution,

    v_0 = 1,   v_1 = v_{-1} = 1 + (κ_c/2) cos 2πa,   n counted from c.

If v_n ≤ 0 for some n, no rotational invariant circle passes through that start:

1. A rotational circle and its images under the kicks are graphs of Lipschitz functions (Birkhoff's
   theorem; `proofs/README.md` derives it from that for one twist map, where the kicks are weak
   enough, and else it is taken from the theorem for products of twist maps). On a graph the kicks
   keep the order of neighbours. Their distances, normalised, tend to a solution ξ_n > 0 of the
   linearised chain, for all n from -∞ to ∞.
2. With one ξ > 0 the second variation of the action of every finite piece of the orbit is
   positive: Σ_k η_k (Hη)_k = Σ_k ξ_k ξ_{k+1} (η_{k+1}/ξ_{k+1} - η_k/ξ_k)² > 0 for every η ≠ 0
   that vanishes outside the piece.
3. The orbit is its own mirror image about the centre, so v_{-n} = v_n. If v_n ≤ 0 for the first
   time at n, then η = v on |k| < n, and 0 elsewhere, has Σ_k η_k (Hη)_k = 2 v_{n-1} v_n ≤ 0.

A circle is a graph, so it meets the line x_c = a in one point: if all y of the line are
eliminated, no rotational circle is left. y from 0 to 1/2 suffice, by the symmetries y → y + 1 and
(x, y) → (-x, -y). The criterion is MacKay and Percival's, Commun. Math. Phys. 98 (1985) 469.

The line is the dominant one, x = 1/2 before the stronger kick, or x = 0 if that is negative. The
minimax orbits are on it, and lose their positive v soonest. With three kicks or more minimax orbits
of different ω may be on different lines: `converse_kam.transversal` has a curve through them all.

Beyond the last circle's breakup, at the scale s_c of a ray, the longest life on the line is T,

    s/s_c - 1 ≈ C/T,

up to a log-periodic ripple of some per cent; on the paper's plane C is 0.6 to 0.7 in steps, on
|κ1| = |κ2| half of that.

These results rest on sampled starts and floating point: strong evidence, not a proof. A search may
miss a survivor; see `longest_lived`. `nasm.proofs.transport` proves it.

The kernel advances 64 starts in lockstep, on the kick of `nasm.escape` with its derivative:

    cos 2πx = -sign(r) Σ_k (2k + 1) c_k u²ᵏ,    w' = w + κ cos 2πx · v,   v' = v + w',

w being the last difference of v. Times are exact: a block of kicks with v ≤ 0 is replayed.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import LANES, copysign, fabs, fma, load, minimum, own_frame, rint, store
from nasm.arithmetic.sine import COSINE, SINE
from nasm.checks import count, points
from nasm.critical import CriticalScale, Status, no_answer
from nasm.escape import polynomial
from nasm.maps import direction, forcing
from nasm.symmetries import CUSP_EXPONENT, distances_to_shorter, dominant_centre, primitive

__all__ = ["Survivor", "critical_scale", "elimination_time", "has_dominant_line", "longest_lived"]

_METHOD = "converse KAM"
MAX_STEPS = 10**9

_BLOCK = 32  # kicks between two tests for v ≤ 0; even, so that each begins a period

_SLOPES = 0.4, 1.1
"""Bounds of slope/s_c of the law, in kicks; the upper one for each kick of the period. On 63 random
rays of 2 to 4 kicks and 88 next to the diagonal it was 0.68 or more, and 1.01 or less for each."""

# (starts, place of the start in its cell) of two grids that have no start in common.
GRIDS = ((2048, 0.5), (1597, 0.382))
KEPT = 32  # starts from which a search goes on at each level
_FEW, _CHILDREN, _SHRINK = 8, 8, 0.15

_STRIDE = 2 + 5**0.5  # (1/γ)³
_MOST_SCALES = 100  # 10 are usual


@dataclass(frozen=True)
class Survivor:
    """A start that takes longest to be eliminated.

    site : int, the kick that it is before, from 0. x, y : floats.
    kicks : float, until it is eliminated; inf if it survives all that were asked.
    """

    site: int
    x: float
    y: float
    kicks: float


def elimination_time(kappa, y, n_max):
    """When each start on the dominant symmetry line is eliminated.

    kappa : sequence of P floats that repeat after one or two kicks, the forcing, first kick first.
    y : array, the starts, on the dominant line.
    n_max : int, 1 to 10⁹, steps (periods of the forcing).

    Returns ndarray of float64, shape of y: steps, a multiple of 1/P, until v ≤ 0; inf for a start
    that survives n_max steps. A finite time shows that no rotational circle passes through the
    start.

    ValueError if the forcing repeats later, or an argument is out of range.
    """
    _, y = points(0.0, y)
    n_max = count("n_max", n_max, 1, MAX_STEPS)
    strengths = forcing(kappa)
    kicks = _kicks(_line(strengths), y.ravel(), strengths.size * n_max)
    return kicks.reshape(y.shape) / strengths.size


def longest_lived(kappa, n_max, kept=KEPT):
    """The start on the dominant symmetry line that takes longest to be eliminated.

    kappa, n_max : as for `elimination_time`.
    kept : int ≥ 1, the starts from which the search goes on at each level.

    Returns y : float, of the start, in [0, 1/2] up to the width of a cell.
    time : float, its elimination time in steps; inf if it survives n_max steps, and then it is one
        of the survivors and need not be the last.

    A beam search, on two unrelated grids: of 2048 and 1597 starts, the longest-lived get 8
    children each, 0.15 cells apart, and so on until a cell is too small for its starts to part.
    It may miss the longest life, and with it a survivor. Of 992 searches, 2% to 0.002% beyond the
    breakup and a third of them within a degree of the diagonals, none did so by more than 1%; with
    16 kept none, with 8 4%, with 4 20%, with 1 77%. Dense scans of 2²⁴ starts found nothing more.
    """
    strengths = forcing(kappa)
    n_max = count("n_max", n_max, 1, MAX_STEPS)
    line, n_kicks = _line(strengths), strengths.size * n_max
    kept = count("kept", kept, 1, GRIDS[1][0])
    y, time = longest_found(lambda y: _kicks(line, y, n_kicks), GRIDS, kept)
    return y, time / strengths.size


def critical_scale(profile, n_max):
    """The scale at which the last circle breaks on the ray κ = s·profile, and one without circles.

    1. Start where the largest strength is 2, and the first kick eliminates all starts.
    2. Lower the scale, by the law s - s_c = slope/T through the last two scales, so that the
       longest lifetime T grows by a factor of 4.2 each time, until it is near n_max: `upper`.
    3. `value` is where the law leads to for T → ∞.

    The factor is (1/γ)³: the ripple has the period 1/γ in T if the last circle has a golden tail.

    profile : sequence of P floats that repeat after one or two kicks, not all 0.
    n_max : int, 100 to 10⁹, steps. On the paper's plane upper/value - 1 is 0.6/n_max to 1/n_max, on
        its diagonals half of that.

    Returns CriticalScale. upper : no start was found to survive n_max steps there. error : a third
    of upper - value; all of it next to a cusp, while lives cannot tell. (True errors were 3% of
    upper - value, at most 15%; next to a cusp at most 80%.) lower is NaN and omega None: the method
    shows no circle, and names none. status NOT_CONVERGED if lifetimes contradict each other, or the
    law, as they do when a search misses a survivor.

    ValueError if profile is zero or tiny, or repeats later.
    """
    profile = direction(profile)
    n_kicks = profile.size * count("n_max", n_max, 100, MAX_STEPS)

    def lifetime(scale):
        line = _line(scale * profile)
        return longest_found(lambda y: _kicks(line, y, n_kicks), GRIDS)[1]

    top = 2 / np.abs(profile).max()
    # A guess of the slope; a bad one costs time, no more.
    upper, time, slope = _walk(lifetime, top, 1.0, top / 2, n_kicks)
    gap = _gap(lifetime, upper, time, slope, _SLOPES[1] * profile.size)
    if np.isnan(gap):
        return no_answer(None, Status.NOT_CONVERGED, _METHOD)
    # Lifetimes follow the law of a forcing of a shorter period that is near until orbits see the
    # difference: six times this power was measured, on 150 rays.
    distances = distances_to_shorter(profile)
    nearest = distances.min(where=distances > 0, initial=np.inf)
    near_cusp = time < profile.size * 6 * nearest**-CUSP_EXPONENT
    error = gap if near_cusp else gap / 3
    return CriticalScale(upper - gap, error, np.nan, upper, None, Status.OK, _METHOD)


def _walk(lifetime, scale, time, slope, n_kicks):
    """The lowest scale at which no start was found to survive, the longest life there, and the
    slope of the law; NaN if `_MOST_SCALES` do not lead near n_kicks."""
    survived = 0.0  # the largest scale known at which a start survives
    for _ in range(_MOST_SCALES):
        if time >= 0.8 * n_kicks or scale - survived < 0.05 * slope / time:
            return scale, time, slope
        target = min(0.9 * n_kicks, _STRIDE * time)
        share = (1 / target - 1 / n_kicks) / (1 / time - 1 / n_kicks)
        lower = max(
            scale - slope * (1 / time - 1 / target),
            survived + max(share, 0.1) * (scale - survived),
        )
        lived = lifetime(lower)
        if np.isinf(lived):
            survived = lower
            continue
        if lived > 1.5 * time:
            slope = (scale - lower) / (1 / time - 1 / lived)
        scale, time = lower, max(lived, time)
    return np.nan, np.nan, np.nan


def _gap(lifetime, scale, time, slope, steepest):
    """How far below `scale` the law has its breakup; NaN if the law does not hold there."""
    higher = scale + (_STRIDE - 1) * slope / time
    if np.isnan(higher):
        return np.nan
    earlier = lifetime(higher)
    if not earlier < time:  # the search has missed a survivor at the lower scale
        return np.nan
    gap = (higher - scale) / (time / earlier - 1)
    return gap if _SLOPES[0] < gap * time / (scale - gap) < steepest else np.nan


def has_dominant_line(kappa):
    """Whether minimax orbits of all ω are on one symmetry line, as the forcing repeats after one or
    two kicks: bool."""
    return primitive(kappa).size <= 2


def _line(strengths):
    """What the kernel needs of the dominant line: in row n the coefficients of kick n, as in
    `nasm.escape`, of a block; a - 1/4; and v_0 - v_{-1} = |κ_c|/2."""
    strengths = primitive(strengths)
    if strengths.size > 2:
        raise ValueError(
            f"kappa={strengths.tolist()} has no dominant symmetry line, as one or two kicks have; "
            "see nasm.converse_kam.transversal"
        )
    site, a = dominant_centre(strengths)
    strengths = np.roll(strengths, -site)
    rows = np.resize(strengths, _BLOCK)
    w = float(strengths[0] if a else -strengths[0]) / 2
    return -rows[:, None] * np.array(SINE), a - 0.25, w


def _kicks(line, y, n_kicks):
    times = np.empty(y.size)
    _elimination_times(*line, y, n_kicks, times)
    return times


def longest_found(lifetimes, grids, kept=KEPT, few=_FEW, apart=0.01):
    """`beam_search` on each of the grids (starts, offset), until one finds a survivor."""
    found = []
    for grid in grids:
        found.append(beam_search(lifetimes, *grid, kept, few, apart))
        if np.isinf(found[-1][1]):
            break
    return max(found, key=lambda start: start[1])


def beam_search(lifetimes, starts, offset, kept=KEPT, few=_FEW, apart=0.01):
    """y in [0, 1/2] and lifetime of the start that lives longest; one survivor is enough.

    lifetimes : function, vector of y → their lifetimes in kicks, inf for a survivor. starts, offset
    : as in GRIDS. kept : as for `longest_lived`. few : no more are kept when cells are smaller than
    100·apart over T², the longest life. apart : the search ends when they are smaller than this.
    """
    cell = 0.5 / starts
    y = (np.arange(starts) + offset) * cell
    brood = np.arange(_CHILDREN) - (_CHILDREN - 1) / 2
    best_y, best_time = 0.0, 0.0
    while True:
        times = lifetimes(y)
        longest = times.argmax()
        if times[longest] > best_time:
            best_y, best_time = float(y[longest]), float(times[longest])
        # The map shears: starts a cell apart are T cells apart after T kicks. They live equally
        # long, nearly, if that is less than 1/T, the distance of neighbours on an orbit of T kicks:
        # then a few parents are enough.
        if np.isinf(best_time) or cell * best_time**2 < apart or cell < np.spacing(0.5):
            return best_y, best_time
        if cell * best_time**2 < 100 * apart:
            kept = min(kept, few)
        parents = y[np.argsort(-times, kind="stable")[:kept]]
        cell *= _SHRINK
        y = (parents[:, None] + cell * brood).ravel()


@njit(forceinline=True)
def tangent_kick(c, n, x, y, v, w):
    """Kick n, on lanes or floats; x is the shifted angle X."""
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
    """A block of kicks of 64 starts, in place: rows x, y, v, w, and the smallest v in the block."""
    own_frame()
    x = load(state, 0)
    y = load(state, LANES)
    v = load(state, 2 * LANES)
    w = load(state, 3 * LANES)
    smallest = v
    for n in range(0, _BLOCK, 2):  # unrolled by two: 1.1 times faster
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
    """The first kick of the block, counted from 1, after which v ≤ 0: the definition."""
    x, y, v, w = state[0, lane], state[1, lane], state[2, lane], state[3, lane]
    n = 0
    while v > 0:
        x, y, v, w = tangent_kick(c, n, x, y, v, w)
        n += 1
    return n


@kernel
def _elimination_times(c, x, w, y, n_max, times):
    """The kick after which v ≤ 0 for every start into `times`, inf if later than n_max.

    A lane whose start is done takes the next one.
    """
    # A lane at rest has v = NaN: it raises no alarm. An orbit that is hyperbolic for ever, as only
    # one whose x and y are exact is, gets there by overflow: it counts as a survivor, as it should.
    state, before = np.full((5, LANES), np.nan), np.empty((5, LANES))
    start, age = np.full(LANES, -1), np.zeros(LANES, np.int64)
    following, at_work = 0, 0
    while True:
        oldest = 0
        for lane in range(LANES):
            if start[lane] < 0 and following < y.size:
                state[:4, lane] = (x, y[following], 1.0, w)
                start[lane], age[lane] = following, 0
                following, at_work = following + 1, at_work + 1
            if start[lane] >= 0:
                oldest = max(oldest, age[lane])
        if at_work == 0:
            return
        alarm = False
        while not alarm:
            before[:] = state
            _advance(c, state)
            age += _BLOCK
            oldest += _BLOCK
            alarm = oldest >= n_max
            for lane in range(LANES):
                alarm |= state[4, lane] <= 0
        for lane in range(LANES):
            gone = state[4, lane] <= 0
            if start[lane] >= 0 and (gone or age[lane] >= n_max):
                time = age[lane] - _BLOCK + _replay(c, before, lane) if gone else n_max + 1
                times[start[lane]] = time if time <= n_max else np.inf
                start[lane], state[2, lane] = -1, np.nan
                at_work -= 1
