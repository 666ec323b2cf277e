"""Converse KAM without a symmetry: starts on a curve that every rotational circle crosses.

Along an orbit of the chain, x_{n+1} - 2x_n + x_{n-1} = (κ_n/2π) sin 2πx_n, let v solve the
linearised chain forwards from the start, and likewise u backwards:

    v_{n+1} = (2 + κ_n cos 2πx_n) v_n - v_{n-1},   v_0 = 0,  v_1 = 1;    u_0 = 0,  u_{-1} = 1.

No rotational invariant circle passes through the start if some v_n ≤ 0 or u_{-n} ≤ 0, n ≥ 1, or if

    Σ_{n≥1} 1/(v_n v_{n+1}) + Σ_{n≥1} 1/(u_{-n} u_{-n-1})  ≥  2 + κ_0 cos 2πx_0

holds for partial sums. Indeed, a circle yields a solution ξ_n > 0 of the linearised chain (see
`nasm.converse_kam.symmetry_line`; on a symmetry line, this criterion reduces to the one there).
The combination ξ_n v_{n+1} - ξ_{n+1} v_n = ξ_0 is constant, so v_n > 0, and ξ_n/v_n falls by
ξ_0/(v_n v_{n+1}) from each site to the next: ξ_1 > ξ_0 Σ 1/(v_n v_{n+1}). The same holds backwards,
and ξ_1 + ξ_{-1} is ξ_0 times the right-hand side.

Every rotational circle crosses any curve that runs from y = -∞ to y = ∞. If all starts on one such
curve are eliminated, no circle exists. Orbits that minimize the action are never eliminated. So the
curve must pass through the gaps between them, for every ω, and a *minimax* orbit of p/q is in the
middle of such a gap: among the orbits of p/q that minimize the action for a fixed x_0, it has the
largest action. Therefore the *transversal* is a polygonal line whose corners are points of
minimax orbits before the kick at one site, in order of ω. If all minimax orbits are on one symmetry
line, the transversal is that line.

1. Start with the minimax orbits of ω = 0, 1, … and P/2 per period. The symmetries y → y + 1 and
   (x, y) → (-x, -y) continue this curve to all ω.
2. Search each piece between two orbits, p/q and p'/q', for a start that survives all N steps. If
   there is one, bend the piece through the minimax orbit of (p + p')/(q + q'), at the point of this
   orbit nearest to the piece, relative to the width of its gap.
3. Search both halves in the same way, as long as N is large enough to resolve the new corner:
   q + q' ≤ 4√N. The new corners descend the Farey tree, towards minimizing orbits on the curve and
   the circle that breaks last.

On a ray whose last circle breaks at the scale s_c, the longest lifetime T on the curve beyond the
breakup obeys s/s_c - 1 ≈ C/T, as on a symmetry line, with C in EXCESS_BOUNDS. These results rest
on sampled starts and floating point: strong evidence, not a proof. The choice of curve matters:
0.5% beyond breakup in the standard map, lifetimes on the transversal do not exceed 130 steps, while
on 15 of 20 other lines x = a some starts survive 3000 steps.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, partial
from math import log

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from nasm.action import LostError, ordered_orbits
from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import FEW, load_state, minimum, own_frame, store_state
from nasm.arithmetic.sine import SINE, cos2pi
from nasm.checks import count, points, real
from nasm.converse_kam.symmetry_line import DEFAULT_SETTINGS as LINE_SETTINGS
from nasm.converse_kam.symmetry_line import (
    MAX_STEPS,
    LongestLived,
    SearchSettings,
    search_grids,
    tangent_kick,
)
from nasm.maps import MAX_PERIOD, forcing, kick, segment
from nasm.types import FloatArray

__all__ = [
    "Transversal",
    "TransversalSettings",
    "eliminated_transversals",
    "elimination",
    "longest_lived",
    "longest_period",
    "upper_scale",
]

EXCESS_BOUNDS = 0.6, 0.95
"""Smallest and largest C in s/s_c - 1 ≈ C/T, with T in steps."""


@dataclass(frozen=True)
class TransversalSettings:
    """Settings for bending and searching transversals, and for lowering the scale.

    Attributes
    ----------
    search : SearchSettings
        The search for the longest-lived start on each piece.
    min_gap : float
        Narrowest gap in which a corner is placed in searches for survivors, relative to the widest
        gap before the same kick. On the ray 1 + 1.78·10⁻⁴·(1, -1, -1, 1), close to a cusp, upper is
        0.1% above the value with 0.5, and 0.2% with 0. In polygons for proofs, a corner may be in
        any gap.
    max_sites : int
        Maximum number of sites whose transversals are tried.
    period_factor : float
        Longest period of the minimax orbits used to bend pieces, divided by √n_max.
    scan_step : float
        Change in the largest strength in each step of the scan from a nonzero start.

    Examples
    --------
    >>> from nasm.converse_kam.transversal import TransversalSettings, upper_scale
    >>> one_site, _ = upper_scale((0.9, 0.7, 0.8), 30, settings=TransversalSettings(max_sites=1))
    >>> bool(one_site > 0.3)
    True
    """

    search: SearchSettings = LINE_SETTINGS.search
    min_gap: float = 0.5
    max_sites: int = 8
    period_factor: float = 4
    scan_step: float = 0.1


DEFAULT_SETTINGS = TransversalSettings()


def longest_lived(
    kappa: ArrayLike,
    n_max: int,
    until: float = math.inf,
    settings: TransversalSettings = DEFAULT_SETTINGS,
) -> LongestLived:
    """Find the longest-lived start on the transversals described in the module docstring.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    n_max : int
        Steps (periods of the forcing) in either direction, 1 to 10⁹.
    until : float
        The `time.thread_time` at which the computation stops. If it stops early, the start that it
        reports as a survivor may not be one.
    settings : TransversalSettings
        How transversals are bent and searched.

    Returns
    -------
    LongestLived
        The longest-lived start on the transversal before the strongest kick. If a start survives
        on it, the transversal before the next strongest kick is tried as well, and so on, until
        no start survives. kicks is inf if a start survives on each of them.

    Notes
    -----
    This is the beam search of `symmetry_line.longest_lived`, on two unrelated grids for each piece;
    it may miss a survivor. Where circles of the forcings in `tests/judged_forcings.csv` exist, just
    before they break, it missed one in 2 of 286 searches with 300 or 3000 steps.

    Examples
    --------
    >>> from nasm.converse_kam.transversal import longest_lived
    >>> longest_lived((0.9, 0.7, 0.8), 100).kicks < 300
    True
    """
    strengths = forcing(kappa)
    n_max, until = count("n_max", n_max, 1, MAX_STEPS), real("until", until)
    sites = _by_strength(strengths, settings.max_sites)
    return _longest_lived(strengths, n_max, sites, until, settings)


@dataclass(frozen=True, eq=False)
class Transversal:
    """A transversal before the kick at one site; `bend` changes it.

    Attributes
    ----------
    site : int
        Index of the kick, from 0.
    kappa : ndarray, shape (P,)
        The forcing, rotated to begin with the kick at that site.
    orbits : list of (Fraction, ndarray)
        ω of each minimax orbit, and the sites of the orbit from `site` on; in order of ω.
    minimax : callable
        (ω, x) → the sites of the minimax orbit near x.
    """

    site: int
    kappa: FloatArray
    orbits: list[tuple[Fraction, FloatArray]]
    minimax: Callable[[Fraction, float], FloatArray]

    @property
    def corners(self) -> FloatArray:
        """Coordinates x and y of the orbits before the kick at `site`, shape (m, 2)."""
        return np.array([_place(*orbit) for orbit in self.orbits])

    def bend(self, piece: int, max_period: float) -> bool:
        """Insert the corner of the mediant p/q between corners piece and piece + 1.

        Returns
        -------
        bool
            False if q exceeds max_period.
        """
        (before, x), (after, x_after) = self.orbits[piece : piece + 2]
        p, q = before.numerator + after.numerator, before.denominator + after.denominator
        if q > max_period:
            return False
        near = x[0] + (x_after[0] - x[0]) * after.denominator / q
        self.orbits.insert(piece + 1, (Fraction(p, q), self.minimax(Fraction(p, q), near)))
        return True


def eliminated_transversals(
    kappa: ArrayLike,
    n_max: int,
    until: float = math.inf,
    settings: TransversalSettings = DEFAULT_SETTINGS,
) -> Iterator[tuple[Transversal, float]]:
    """Yield transversals on which the search finds no survivor, roughly in order of lifetime.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    n_max : int
        Steps (periods of the forcing) in either direction.
    until : float
        The `time.thread_time` at which the search should end; it may end a bend or two later.
    settings : TransversalSettings
        How transversals are bent and searched.

    Yields
    ------
    transversal : Transversal
        At most one for each site.
    kicks : float
        The longest lifetime on it.

    Examples
    --------
    >>> from nasm.converse_kam.transversal import eliminated_transversals
    >>> transversal, kicks = next(eliminated_transversals((0.9, 0.7, 0.8), 300))
    >>> kicks < 300
    True
    """
    kappa, n_max = forcing(kappa), count("n_max", n_max, 1, MAX_STEPS)
    until = real("until", until)
    sites, n_steps = _by_strength(kappa, settings.max_sites), 256
    # The caller tests every start, so one grid suffices.
    grid, width = settings.search.grids[:1], settings.search.width
    search = replace(settings.search, grids=grid, final_width=width)
    settings = replace(settings, search=search)
    while n_steps <= n_max:
        for transversal in _transversals(kappa, list(sites), min_gap=0.0):
            _, kicks = _bend_while_surviving(transversal, n_steps, until, settings)
            if time.thread_time() > until:
                return
            if kicks < np.inf:
                sites.remove(transversal.site)
                yield transversal, kicks
        n_steps *= 4


def upper_scale(
    profile: ArrayLike,
    n_max: int,
    start: ArrayLike | None = None,
    n_sites: int | None = None,
    until: float = math.inf,
    settings: TransversalSettings = DEFAULT_SETTINGS,
) -> tuple[float, LongestLived | None]:
    """Find a scale just above the last breakup on κ = start + s·profile.

    1. Begin at the scale where the strongest kick has |κ| = 2. From a nonzero start, begin instead
       where a scan from s = 0 upwards first eliminates all starts.
    2. Bisect between this scale and s = 0, or the last scale of the scan at which a start survives.
       At first starts need to survive only 30 to 120 steps. The bisection ends when the relative
       change of the largest strength is less than 0.18/steps, the precision of the law below.
    3. Repeat step 2 with four times as many steps, and so on up to n_max. Each time, first lower
       the scale in steps that double, until a start survives.

    On a ray from zero the breakup is below the result by a relative distance of C/T, with C in
    EXCESS_BOUNDS.

    Parameters
    ----------
    profile : array_like, shape (P,)
        Direction of the segment, not zero; P ≤ 64.
    n_max : int
        Steps (periods of the forcing), 30 to 10⁹.
    start : array_like, shape (P,), optional
        Start of the segment; default 0. From a nonzero start the scale is just above the first
        breakup at s ≥ 0, found by a scan in steps of 0.1 in the largest strength.
    n_sites : int, optional
        Number of sites, 1 to 8, whose transversals are searched for survivors; default: 8 or P,
        whichever is smaller. With two sites the search takes half the time, but the scale may be a
        few per cent higher.
    until : float
        The `time.thread_time` after which the scale is not lowered any further.
    settings : TransversalSettings
        How transversals are bent and searched, and how the scale is lowered.

    Returns
    -------
    scale : float
        At this scale no initial condition was found to survive n_max steps. From a nonzero start
        the scale is 0 if none survives at s = 0.
    longest : LongestLived or None
        The longest-lived start at this scale; T is its lifetime in steps. None if scale is 0, or if
        time runs out.

    Raises
    ------
    ValueError
        If profile is zero, tiny or too long, if start and profile differ in length, or if n_max or
        n_sites is out of range.

    Examples
    --------
    >>> from nasm.converse_kam.transversal import upper_scale
    >>> scale, longest = upper_scale((0.9, 0.7, 0.8), 30)
    >>> bool(0.3 < scale < 2)
    True
    """
    start, profile = segment(start, profile)
    n_max = count("n_max", n_max, 30, MAX_STEPS)
    max_sites = settings.max_sites if n_sites is None else n_sites
    sites = _by_strength(profile, count("n_sites", max_sites, 1, settings.max_sites))
    until = real("until", until)
    strongest = np.abs(profile).argmax()
    size, sign = np.abs(profile[strongest]), np.sign(profile[strongest])

    def longest_at(scale, n_steps):
        return _longest_lived(start + scale * profile, n_steps, sites, until, settings)

    # With a kick |κ| = 2 no circle exists: none can cross x = 1/2 (or x = 0 if κ < 0) before it.
    upper, survived, longest = (2 - sign * start[strongest]) / size, 0.0, None
    if start.any():
        for scale in np.arange(0, upper, settings.scan_step / size):
            trial = longest_at(scale, n_max)
            if trial.kicks < np.inf:
                upper, longest = scale, trial
                break
            survived = scale
    if upper <= 0:
        return 0.0, None
    # By the law s/s_c - 1 ≈ C/T, n steps locate the breakup up to ±(C_max - C_min)/2n.
    spread, step = (EXCESS_BOUNDS[1] - EXCESS_BOUNDS[0]) / 2 / size, upper - survived
    for level in range(int(log(n_max / 30, 4)), -1, -1):
        n_steps, lower = n_max // 4**level, survived
        while upper - lower > (width := spread / n_steps * np.abs(start + upper * profile).max()):
            if time.thread_time() > until:
                return upper, None
            scale = max(upper - step, (upper + lower) / 2)
            trial = longest_at(scale, n_steps)
            if np.isinf(trial.kicks):
                lower = scale
            else:
                upper, longest, step = scale, trial, 2 * step
        step = width
    return upper, longest


def _by_strength(kappa, max_sites):
    """Return the sites of the largest |κ|, in descending order."""
    if kappa.size > MAX_PERIOD:
        raise ValueError(
            f"a forcing with P={kappa.size} kicks is too long: P must be at most {MAX_PERIOD}, "
            "unless the forcing repeats after one or two kicks"
        )
    return np.argsort(-np.abs(kappa), kind="stable").tolist()[:max_sites]


def _longest_lived(kappa, n_steps, sites, until, settings):
    """Return the LongestLived of the first transversal on which no start survives.

    If a start survives on every transversal, return one of these starts. The site of the start is
    moved to the front of `sites`.
    """
    for transversal in _transversals(kappa, list(sites), settings.min_gap):
        site = transversal.site
        (x, y), kicks = _bend_while_surviving(transversal, n_steps, until, settings)
        if kicks < np.inf or time.thread_time() > until:
            break
    sites.remove(site)
    sites.insert(0, site)
    return LongestLived(site, float(x), float(y), kicks)


def _transversals(kappa, sites, min_gap):
    """Yield the initial transversal of each site, which passes through the first orbits.

    The corners are placed in gaps at least min_gap times as wide as the widest gap.
    """
    # Orbits are computed once and shared by the transversals of all sites.
    minimizers = {}
    ordered = cache(lambda omega: ordered_orbits(kappa, *omega.as_integer_ratio(), minimizers))
    for site in sites:
        ahead = np.roll(kappa, -site)
        minimax = partial(_minimax, ordered, kappa.size, site, min_gap)
        yield Transversal(site, ahead, _first_orbits(ahead, minimax), minimax)


def _bend_while_surviving(transversal, n_steps, until, settings):
    """Bend each piece of a transversal as long as a start survives on it and time remains.

    Once time is up, every start counts as a survivor. Returns (x, y) of the longest-lived start, or
    of a survivor on a piece that cannot be bent, and its lifetime in kicks.
    """
    blocks, n_kicks = _blocks(transversal.kappa), n_steps * transversal.kappa.size
    max_period = longest_period(n_steps, settings)
    best, longest, piece = (0.0, 0.0), 0.0, 0
    while piece < len(transversal.orbits) - 1:
        # Places on the curve are turns per kick, as on a symmetry line.
        pair = transversal.orbits[piece : piece + 2]
        corners = np.array([_place(*orbit) for orbit in pair])
        ends = [float(omega) / transversal.kappa.size for omega, _ in pair]

        def points_at(place, ends=ends, corners=corners):
            return [np.interp(place, ends, axis) for axis in corners.T]

        def lifetimes(place, points_at=points_at):
            if time.thread_time() > until:
                return np.full(place.size, np.inf)
            times, slopes = np.zeros((2, place.size))
            _eliminate(*blocks, *points_at(place), n_kicks, True, times, slopes)
            return times

        place, kicks = search_grids(lifetimes, settings.search, ends)
        if kicks == np.inf:
            if time.thread_time() > until or not transversal.bend(piece, max_period):
                return points_at(place), kicks
            continue
        if kicks > longest:
            best, longest = points_at(place), kicks
        piece += 1
    return best, longest


def longest_period(n_steps: float, settings: TransversalSettings = DEFAULT_SETTINGS) -> float:
    """Return the longest period of the minimax orbits used to bend pieces, given n_steps.

    Examples
    --------
    >>> from nasm.converse_kam.transversal import longest_period
    >>> longest_period(100)
    40.0
    """
    return settings.period_factor * n_steps**0.5


def _first_orbits(kappa, minimax):
    """Return (ω, sites) of the minimax orbits of ω = 0, 1, … and P/2.

    The list extends to ω = P if the orbit at either end is not its own image under
    (x, y) → (-x, -y).
    """
    period = kappa.size
    omegas = sorted({*map(Fraction, range(period // 2 + 1)), Fraction(period, 2)})
    # Far beyond the breakup, x_before is also used in place of orbits that cannot be found; orbits
    # half a turn away from x_before would be minimizing, and would survive.
    orbits, x_before = [], 0.5 if kappa[0] > 0 else 0.0
    for omega in omegas:
        orbits.append((omega, minimax(omega, x_before)))
        x_before = orbits[-1][1][0]
    ends = (orbits[0], 0.0), (orbits[-1], 1.0)
    if any(
        max(abs(2 * x - np.rint(2 * x)), abs(2 * y - twice)) > 1e-6
        for (x, y), twice in ((_place(*orbit), twice) for orbit, twice in ends)
    ):
        for omega, sites in orbits[-2::-1]:
            image = np.arange(sites.size) + (-sites if omega else sites)
            image += np.rint(orbits[-1][1][0] - image[0])
            orbits.append((period - omega, image))
    return orbits


def _place(omega, sites):
    """Return (x, y) of an orbit before site 0."""
    return sites[0], sites[0] - sites[-1] + omega.numerator


def _minimax(ordered, period, site, min_gap, omega, target):
    """Return the sites of the minimax orbit of p/q before the kick at `site`.

    The first of these sites is the one nearest to x = target, relative to the width of its gap.
    ordered : a function that returns `ordered_orbits` of ω. min_gap : as for `_transversals`.
    """
    p, q = omega.numerator, omega.denominator
    rotation = np.arange(period * q) * (p / (period * q))
    try:
        minimizing, minimax = ordered(omega)
    except LostError:
        return rotation + target
    chain, starts = minimax.chain, np.arange((site - minimax.site) % period, period * q, period)
    gaps = np.maximum((chain.right(minimizing.u) - minimizing.u)[starts], np.finfo(float).eps)
    is_wide = gaps >= min_gap * gaps.max()
    displacement = target - minimax.sites()[starts[is_wide]]
    distances = np.abs(displacement - np.rint(displacement)) / gaps[is_wide]
    sites = rotation + chain.rolled(minimax.u, starts[is_wide][distances.argmin()])
    return sites + np.rint(target - sites[0])


def elimination(
    kappa: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    n_kicks: int,
) -> tuple[FloatArray, FloatArray]:
    """Compute when each start before kick 0 is eliminated, and its slope γ.

    When a start is eliminated, the solution V of the linearised chain with V_0 = 1, V_{-1} = 1 - γ
    has become ≤ 0 in both directions, or will soon become so: the two sums in the module docstring
    are at least 1 + κ_0 cos 2πx_0 + γ and 1 - γ, or v or u has become negative.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    x, y : array_like
        Starts, in turns.
    n_kicks : int
        Maximum number of kicks.

    Returns
    -------
    times : ndarray, shape (n,)
        Number of kicks in either direction that eliminate the start; inf if more than n_kicks.
    slopes : ndarray, shape (n,)
        γ; 0 for survivors.

    Examples
    --------
    >>> from nasm.converse_kam.transversal import elimination
    >>> times, slopes = elimination(1.5, [0.5, 0.5], [0.0, 0.3], 100)
    >>> times
    array([2., 2.])
    """
    kappa, (x, y) = forcing(kappa), points(x, y)
    n_kicks = count("n_kicks", n_kicks, 1, 10**12)
    times, slopes = np.zeros((2, x.size))
    _eliminate(*_blocks(kappa), x.ravel(), y.ravel(), n_kicks, False, times, slopes)
    return times, slopes


def _blocks(kappa):
    """Return the kernel's arguments for a forcing.

    The arguments are κ_0, and the coefficients of the kicks of a block, as in `nasm.escape`, one
    kick per row: of those after kick 0, and of those that are undone.
    """
    length = kappa.size * -(-LINE_SETTINGS.block_kicks // kappa.size)
    ahead, behind = np.resize(np.roll(kappa, -1), length), np.resize(kappa[::-1], length)
    return float(kappa[0]), *(rows[:, None] * -np.array(SINE) for rows in (ahead, behind))


@njit(nogil=True)
def _advance(ahead, behind, state):
    """Advance 16 starts by a block of kicks in both directions, in place."""
    own_frame()
    x, y, v, w, p, q, u, z, total_v, total_u, _ = load_state(state, 0, 11, FEW)
    least = minimum(v, u)
    for n in range(ahead.shape[0]):
        v_before, u_before = v, u
        x, y, v, w = tangent_kick(ahead, n, x, y, v, w)
        p, q, u, z = tangent_kick(behind, n, p, q, u, z)
        total_v = total_v + 1.0 / (v_before * v)
        total_u = total_u + 1.0 / (u_before * u)
        least = minimum(minimum(v, u), least)
    store_state(state, (x, y, v, w, p, q, u, z, total_v, total_u, least))


@njit(nogil=True)
def _replay(ahead, behind, state, lane, bound):
    """Return the number of the eliminating kick, counted from 1 in this block, and γ."""
    x, y, v, w, p, q, u, z, total_v, total_u = load_state(state, lane, 10, 1)
    for n in range(ahead.shape[0]):
        v_before, u_before = v, u
        x, y, v, w = tangent_kick(ahead, n, x, y, v, w)
        p, q, u, z = tangent_kick(behind, n, p, q, u, z)
        total_v = total_v + 1.0 / (v_before * v) if v > 0 else bound
        total_u = total_u + 1.0 / (u_before * u) if u > 0 else bound
        if total_v + total_u >= bound:
            return n + 1, 1 + (total_v - total_u - bound) / 2
    return ahead.shape[0], 0.0


@kernel
def _eliminate(strength, ahead, behind, x, y, n_kicks, one_is_enough, times, slopes):
    """Run `elimination`; a lane whose start is finished takes the next start.

    If one is enough, stop at the first survivor; the times of starts still undecided are then 0.
    """
    state, before = np.full((11, FEW), np.nan), np.empty((11, FEW))
    start, age, bound = (
        np.full(FEW, -1),
        np.zeros(FEW, np.int64),
        np.zeros(FEW),
    )
    next_start, n_active = 0, 0
    while True:
        for lane in range(FEW):
            while start[lane] < 0 and next_start < x.size:
                i, next_start = next_start, next_start + 1
                bound[lane] = 2 + strength * cos2pi(x[i])
                if bound[lane] <= 0:
                    times[i], slopes[i] = 1.0, 1 - bound[lane] / 2
                    continue
                x_ahead, y_ahead = kick(strength, x[i], y[i])
                before_x = x[i] - y[i] - 0.25
                state[:4, lane] = (x_ahead - 0.25, y_ahead, 1.0, 1.0)
                state[4:10, lane] = (before_x, -y[i], 1.0, 1.0, 0.0, 0.0)
                start[lane], age[lane] = i, 1
                n_active += 1
        if n_active == 0:
            return
        before[:] = state
        _advance(ahead, behind, state)
        for lane in range(FEW):
            if start[lane] < 0:
                continue
            time = np.inf
            if state[10, lane] <= 0 or state[8, lane] + state[9, lane] >= bound[lane]:
                n, slopes[start[lane]] = _replay(ahead, behind, before, lane, bound[lane])
                time = age[lane] + n
            age[lane] += ahead.shape[0]
            if time > n_kicks:
                time = np.inf
            if time < np.inf or age[lane] >= n_kicks:
                times[start[lane]] = time
                if one_is_enough and time == np.inf:
                    return
                start[lane] = -1
                state[2, lane] = state[6, lane] = np.nan
                n_active -= 1
