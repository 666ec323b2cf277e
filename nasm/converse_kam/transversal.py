"""Converse KAM without a symmetry: starts on a curve that every rotational circle crosses.

Along an orbit of the chain, x_{n+1} - 2x_n + x_{n-1} = (κ_n/2π) sin 2πx_n, let v solve the
linearised chain forwards from the start, and likewise u backwards:

    v_{n+1} = (2 + κ_n cos 2πx_n) v_n - v_{n-1},   v_0 = 0,  v_1 = 1;    u_0 = 0,  u_{-1} = 1.

No rotational invariant circle passes through the start if some v_n ≤ 0 or u_{-n} ≤ 0, n ≥ 1, or if

    Σ_{n≥1} 1/(v_n v_{n+1}) + Σ_{n≥1} 1/(u_{-n} u_{-n-1})  ≥  2 + κ_0 cos 2πx_0

in a partial sum. For a circle gives a solution ξ_n > 0 of the linearised chain (see
`nasm.converse_kam.symmetry_line`, whose criterion this is on a symmetry line). ξ_n v_{n+1} -
ξ_{n+1} v_n = ξ_0 is constant, so v_n > 0, and ξ_n/v_n falls by ξ_0/(v_n v_{n+1}) from each site to
the next: ξ_1 > ξ_0 Σ 1/(v_n v_{n+1}). Likewise backwards, and ξ_1 + ξ_{-1} is ξ_0 times the right.

Every rotational circle crosses a curve that leads from y = -∞ to y = ∞. If all starts on one are
eliminated, no circle is left. Orbits that minimize the action are never eliminated. The curve must
pass through the gaps that they leave, for every ω, and a *minimax* orbit of p/q is in the middle of
one: among the orbits of p/q that minimize the action for a given x_0, it has the largest. So the
*transversal* is a chain of straight pieces through the places of minimax orbits before the kick of
one site, in the order of their ω. Where all minimax orbits are on one symmetry line, it is that
line.

1. Start with the orbits of ω = 0, 1, … and P/2 per period. The symmetries y → y + 1 and
   (x, y) → (-x, -y) continue this curve to all ω.
2. The start that lives longest is on a piece between two orbits, p/q and p'/q'. Bend the piece by
   the minimax orbit of (p + p')/(q + q'), where it is nearest to the piece, over the width of the
   gap.
3. Repeat this as long as the start survives and its life can tell the difference. It leads down the
   Farey tree, to minimizing orbits that were in the way, and to the circle that breaks last.

Beyond the last circle's breakup, at the scale s_c of a ray, the longest life there is T, and s/s_c
- 1 ≈ C/T as on a symmetry line, with C in EXCESS. This is sampled, in floating point:
strong evidence, not a proof. The choice matters: 0.5% beyond the breakup of the standard map lives
last 130 steps there, and on 15 of 20 other lines x = a starts survive 3000.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, partial
from math import log

import numpy as np
from numba import njit

from nasm.action import LostError, ordered_orbits
from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import FEW, load_state, minimum, own_frame, store_state
from nasm.arithmetic.sine import SINE, cos2pi
from nasm.checks import count, points
from nasm.converse_kam.symmetry_line import Survivor, beam_search, longest_found, tangent_kick
from nasm.maps import MAX_PERIOD, forcing, kick, segment

__all__ = ["Transversal", "curves", "elimination", "located", "longest_lived", "longest_period"]

MAX_STEPS = 10**6
EXCESS = 0.6, 0.95  # steps: C of the law, least and largest
_EXCESS = 0.7  # mostly

_BLOCK = 32  # kicks, about, between two looks at the starts
_GRIDS = ((1024, 0.5), (797, 0.382))  # as of `symmetry_line`
_KEPT = 16  # starts for each kick of a period, of which the search goes on
_AT_FIRST = 8  # times fewer, that are tried first
_WIDE, _OPEN = 0.5, 1e-6  # of the widest gap before the kick of a site: where corners of searches
# for survivors are, and those of polygons for proofs
_SITES = 8  # at most, whose transversals are tried
_LONGEST = 4  # times √n_max: period of the minimax orbits up to which pieces are bent
_SHORT = 100  # kicks: of shorter lives the shortest is sought, on the transversals of all sites
_NARROW = 0.2  # over the steps: bracket, in parts of the scale, to which it is narrowed
_AHEAD, _FARTHEST = 0.1, 40  # change of the largest strength in a step from a start, and steps


def longest_lived(kappa, n_max):
    """The start that takes longest to be eliminated, on the transversals of the module.

    kappa : sequence of P floats, the forcing, first kick first.
    n_max : int, 1 to 10⁶, steps in either direction.

    Returns Survivor, on the transversal before the kick of the largest |κ|; where a start survives
    there, on that of the next largest, and so on. Its kicks are inf if on each one a start
    survives.

    The beam search of `symmetry_line.longest_lived`, on two unrelated grids: it may miss a
    survivor.
    """
    strengths = forcing(kappa)
    n_max = count("n_max", n_max, 1, MAX_STEPS)
    return _longest_lived(strengths, n_max, _by_strength(strengths))


@dataclass(frozen=True, eq=False)
class Transversal:
    """A transversal before the kick of one site; `bend` changes it.

    site : int. kappa : ndarray of P floats, the forcing from that site on. orbits : list of (ω,
    sites), minimax orbits from there on, in the order of ω. minimax : function of ω and x, sites of
    the minimax orbit near x.
    """

    site: int
    kappa: np.ndarray
    orbits: list
    minimax: Callable

    @property
    def corners(self):
        """ndarray of shape (m, 2): x and y of the orbits before the kick of the site."""
        return np.array([_place(*orbit) for orbit in self.orbits])

    def bend(self, piece, most):
        """Put between corners piece and piece + 1 that of their mediant p/q; whether q ≤ most."""
        (before, x), (after, x_after) = self.orbits[piece : piece + 2]
        p, q = before.numerator + after.numerator, before.denominator + after.denominator
        if q > most:
            return False
        near = x[0] + (x_after[0] - x[0]) * after.denominator / q
        self.orbits.insert(piece + 1, (Fraction(p, q), self.minimax(Fraction(p, q), near)))
        return True


def curves(kappa, n_max, until=math.inf):
    """Transversals on which all starts were found to be eliminated, those of short lives first.

    kappa : sequence of P floats, the forcing, first kick first. n_max : int, steps in either
    direction. until : float, the `time.thread_time` at which the search ends, within a bend or two.

    Yields (Transversal, kicks), at most one for each site; kicks is the longest life.
    """
    kappa, n_max = forcing(kappa), count("n_max", n_max, 1, MAX_STEPS)
    sites, n_steps = _by_strength(kappa), 256
    while n_steps <= n_max:
        for transversal in _transversals(kappa, list(sites), _OPEN):
            # Who asks will try all starts: one grid is enough.
            _, kicks = _bent(transversal, n_steps, _GRIDS[:1], _KEPT, until)
            if time.thread_time() > until:
                return
            if kicks < np.inf:
                sites.remove(transversal.site)
                yield transversal, kicks
        n_steps *= 4


def located(profile, n_max, start=None, n_sites=_SITES):
    """A scale on κ = start + s·profile at which no start was found to survive n_max steps, just
    above the last breakup; and the Survivor that lives longest there, T steps.

    Lower the scale until a start survives 30 steps or so, halve the bracket until it is narrow, go
    on with four times the steps, and so on to n_max. On a ray from zero the breakup is lower by
    some 0.7/T of the scale.

    profile : sequence of P floats, not all 0.
    n_max : int, 30 to 10⁶, steps.
    start : sequence of P floats, default 0. From another one the scale is just above the first
        breakup, s ≥ 0, that steps of 0.1 of the largest strength meet; 0 if no start survives
        there, inf if one does up to 40 steps; and None.
    n_sites : int, 1 to 8, on the transversals of how many sites it is sought. With two it takes
        half the time, and the scale may be some per cent higher.

    ValueError if profile is zero or tiny, or longer than 64 kicks, or start of another length, or
    n_max or n_sites out of range.
    """
    start, profile = segment(start, profile)
    n_max = count("n_max", n_max, 30, MAX_STEPS)
    sites = _by_strength(profile)[: count("n_sites", n_sites, 1, _SITES)]
    size = np.abs(profile).max()
    # No circle crosses x = 0 or x = 1/2 before a kick of |κ| = 2.
    upper, found, share = 2 / size, None, 0.15

    def lived(scale, n_steps):
        return _longest_lived(start + scale * profile, n_steps, sites)

    if start.any():
        scales = (_AHEAD * n / size for n in range(_FARTHEST + 1))
        upper = next((scale for scale in scales if lived(scale, n_max).kicks < np.inf), np.inf)
        if not 0 < upper < np.inf:
            return upper, None
    unit = np.abs(start + upper * profile).max() / size
    for left in range(int(log(n_max / 30, 4)), -1, -1):
        n_steps, survived = n_max // 4**left, None
        while survived is None or upper - survived > _NARROW / n_steps * unit:
            scale = max(upper - share * unit, 0) if survived is None else (upper + survived) / 2
            longest = lived(scale, n_steps)
            if np.isinf(longest.kicks):
                survived = scale
            elif scale == 0:
                return 0.0, None
            else:
                upper, found = scale, longest
                unit = np.abs(start + upper * profile).max() / size
                share = min(1.5 * share, 0.3)
        if found is None:  # of fewer steps than the search before
            found = lived(upper, 16 * n_max)
        share = _EXCESS / found.kicks * profile.size  # by the law, the breakup is that far below
    return upper, found


def _by_strength(kappa):
    """The sites of the largest |κ|, in descending order."""
    if kappa.size > MAX_PERIOD:
        raise ValueError(
            f"a forcing with P={kappa.size} kicks is too long: P is at most {MAX_PERIOD}, "
            "unless it repeats after one or two kicks"
        )
    return np.argsort(-np.abs(kappa), kind="stable").tolist()[:_SITES]


def _longest_lived(kappa, n_steps, sites):
    """The Survivor of the transversal where the longest life is the shortest.

    Of transversals on which no start survives and one lives long, the first is as good as any.
    The last site that was better is put first among `sites`.
    """
    best = None
    kept = _KEPT * max(2, kappa.size)  # all ω up to P/2 are there
    for transversal in _transversals(kappa, list(sites), _WIDE):
        site, ((x, y), kicks) = transversal.site, _bent(transversal, n_steps, _GRIDS, kept)
        if best is None or kicks < best.kicks:
            best = Survivor(site, float(x), float(y), kicks)
            sites.remove(site)
            sites.insert(0, site)
        if _SHORT < best.kicks < np.inf:
            break
    return best


def _transversals(kappa, sites, wide):
    """The transversal of each site, through its first orbits. Its corners are in gaps that are
    wider than the share `wide` of the widest."""
    # All ask for the same orbits.
    climbed = {}
    ordered = cache(lambda omega: ordered_orbits(kappa, *omega.as_integer_ratio(), climbed))
    for site in sites:
        ahead, minimax = np.roll(kappa, -site), partial(_minimax, ordered, kappa.size, site, wide)
        yield Transversal(site, ahead, _first_orbits(ahead, minimax), minimax)


def _bent(transversal, n_steps, grids, kept, until=math.inf):
    """Bend a transversal as long as a start survives, and there is time: (x, y) of the start that
    lives longest on it, and its life in kicks."""
    kappa = transversal.kappa
    while True:
        at = np.array([float(omega) for omega, _ in transversal.orbits])
        at, corners = at * (0.5 / at[-1]), transversal.corners

        def points_at(place, at=at, corners=corners):
            return [np.interp(place, at, axis) for axis in corners.T]

        def lifetimes(place, points_at=points_at):
            return elimination(kappa, *points_at(place), n_steps * kappa.size, True)[0]

        # Few starts find a survivor mostly, if there is one.
        place, kicks = beam_search(lifetimes, *grids[0], kept // _AT_FIRST, kept // _AT_FIRST)
        if kicks < np.inf:
            place, kicks = longest_found(lifetimes, grids, kept, kept)
        piece = int(np.clip(np.searchsorted(at, place), 1, at.size - 1)) - 1
        done = np.isfinite(kicks) or time.thread_time() > until
        if done or not transversal.bend(piece, longest_period(n_steps)):
            return points_at(place), kicks


def longest_period(n_steps):
    """Of the minimax orbits up to which pieces are bent, of starts that live so long: float."""
    return _LONGEST * n_steps**0.5


def _first_orbits(kappa, minimax):
    """(ω, sites) of the minimax orbits of ω = 0, 1, … and P/2; and if one end is not its own image
    under (x, y) → (-x, -y), those up to ω = P."""
    period = kappa.size
    omegas = sorted({*map(Fraction, range(period // 2 + 1)), Fraction(period, 2)})
    # Where orbits are lost, far beyond the breakup, this stands for them: on the other side of the
    # kick they would be minimizing, and survive.
    orbits, before = [], 0.5 if kappa[0] > 0 else 0.0
    for omega in omegas:
        orbits.append((omega, minimax(omega, before)))
        before = orbits[-1][1][0]
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
    """(x, y) of an orbit before site 0."""
    return sites[0], sites[0] - sites[-1] + omega.numerator


def _minimax(ordered, period, site, wide, omega, near):
    """Sites of the minimax orbit of p/q before the kick of `site`, from one on that is nearest to
    x = near, over the width of its gap. ordered : `ordered_orbits` of ω. wide : as above."""
    p, q = omega.numerator, omega.denominator
    rotation = np.arange(period * q) * (p / (period * q))
    try:
        minimizing, minimax = ordered(omega)
    except LostError:
        return rotation + near
    chain, starts = minimax.chain, np.arange((site - minimax.site) % period, period * q, period)
    gaps = (chain.right(minimizing.u) - minimizing.u)[starts]
    kept = gaps > wide * gaps.max()
    away = near - minimax.sites()[starts[kept]]
    far = np.abs(away - np.rint(away)) / gaps[kept]
    sites = rotation + chain.rolled(minimax.u, starts[kept][far.argmin()])
    return sites + np.rint(near - sites[0])


def elimination(kappa, x, y, n_kicks, one_is_enough=False):
    """Kicks in either direction until each start before kick 0 is eliminated, inf if more than
    n_kicks; if one is enough, 0 of those that are not known before the first survivor.

    And γ of each start, 0 of survivors: with V_0 = 1, V_{-1} = 1 - γ the solution V of the
    linearised chain is ≤ 0 in both directions by then, or soon: the sums of the module are
    ≥ 1 + κ_0 cos 2πx_0 + γ and ≥ 1 - γ, or v or u has turned negative.
    """
    kappa, (x, y) = forcing(kappa), points(x, y)
    n_kicks = count("n_kicks", n_kicks, 1, 10**12)
    times, slopes = np.zeros((2, x.size))
    length = kappa.size * -(-_BLOCK // kappa.size)
    ahead = np.resize(np.roll(kappa, -1), length)[:, None] * -np.array(SINE)
    behind = np.resize(kappa[::-1], length)[:, None] * -np.array(SINE)
    _eliminate(
        float(kappa[0]), ahead, behind, x.ravel(), y.ravel(), n_kicks, one_is_enough, times, slopes
    )
    return times, slopes


@njit(nogil=True)
def _advance(ahead, behind, state):
    """A block of kicks in both directions, of 16 starts, in place."""
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
    """The kick of the block, counted from 1, that eliminates the start: the definition. And γ."""
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
    """`elimination`; a lane whose start is done takes the next one."""
    state, before = np.full((11, FEW), np.nan), np.empty((11, FEW))
    start, age, bound = np.full(FEW, -1), np.zeros(FEW, np.int64), np.zeros(FEW)
    following, at_work = 0, 0
    while True:
        for lane in range(FEW):
            while start[lane] < 0 and following < x.size:
                i, following = following, following + 1
                bound[lane] = 2 + strength * cos2pi(x[i])
                if bound[lane] <= 0:
                    times[i], slopes[i] = 1.0, 1 - bound[lane] / 2
                    continue
                x_ahead, y_ahead = kick(strength, x[i], y[i])
                before_x = x[i] - y[i] - 0.25
                state[:4, lane] = (x_ahead - 0.25, y_ahead, 1.0, 1.0)
                state[4:10, lane] = (before_x, -y[i], 1.0, 1.0, 0.0, 0.0)
                start[lane], age[lane] = i, 1
                at_work += 1
        if at_work == 0:
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
                at_work -= 1
