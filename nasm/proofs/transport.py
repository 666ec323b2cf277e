"""A proof, by computer, that transport is global: no rotational invariant circle exists.

Every rotational circle crosses a curve that leads from y = -∞ to y = ∞: for one or two kicks a
symmetry line x_c = a, for more a polygon through minimax orbits, as `nasm.converse_kam.transversal`
finds it. If a circle passes through a start, the second variation of the action is positive along
its orbit. So if for every start on the curve, up to symmetries, some η of finite support has

    Q = Σ_k η_k ((2 + κ_k cos 2πx_k) η_k - η_{k+1} - η_{k-1}) ≤ 0,   η ≠ 0,

no circle is left, and there are orbits from any y to any other. The theorem, and why what follows
proves its hypothesis in floating point, are in `proofs/README.md`, "Transport is global".

The curve is covered by boxes |s - ŝ| ≤ δ, whose orbits are

    x_n(σ) = x̂_n + σ t_n + σ² q_n + ρ_n,   |ρ_n| ≤ A_n|v_n| + B_n|t_n|,   s = ŝ + σδ,   |σ| ≤ 1.

One η serves a box: V, the solution v of the linearised chain with payments. V_N ≤ 0 shows Q ≤ 0 in
the whole box, and N is its life. A box that fails is halved. On a symmetry line sites n ≥ c are
enough; on a polygon those before c are followed as sites after it of the kicks in reverse, and a
box has two lives.

Sixteen boxes run in lockstep on `nasm.arithmetic.lanes`; an event among them is found again by the
same kick on floats, which is the definition. Everything rests on IEEE arithmetic with rounding to
nearest, gradual underflow and a true fma, which `check_arithmetic` tries at run time.
"""

import math
import time
from dataclasses import dataclass, field
from enum import Enum
from fractions import Fraction
from functools import cache
from math import factorial

import numpy as np
from numba import njit

from nasm.arithmetic.double_double import EXACT_PI, pair, renormalised, two_sum
from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import (
    FEW,
    copysign,
    fabs,
    fma,
    load_few,
    load_state,
    maximum,
    minimum,
    own_frame,
    rint,
    store,
    store_state,
)
from nasm.arithmetic.sine import COSINE
from nasm.checks import positive, real
from nasm.converse_kam import transversal
from nasm.critical import Result
from nasm.maps import MAX_PERIOD, MAX_STRENGTH, MIN_SIZE, direction, forcing
from nasm.numbers import rational
from nasm.proofs.certificates import certificate, columns_in_hex, in_hex
from nasm.symmetries import shorten

__all__ = ["Outcome", "TransportProof", "prove", "proved_upper"]

# Taylor coefficients of sin 2πu / 2πu in u²: four sums of two floats, eight floats.
_SERIES = [(-1) ** k * (2 * EXACT_PI) ** (2 * k) / factorial(2 * k + 1) for k in range(12)]
_S0, _S1, _S2, _S3 = map(pair, _SERIES[:4])
_S4 = tuple(map(float, _SERIES[4:]))

ULP = 2.0**-53  # of rounding, relative; and a bound of the error of h = sin 2πx/2π
ORBIT = 2.0**-66  # a bound of the error of h as a sum of two floats, and of rounding x and y
COS = 2.1e-14  # a bound of the error of cos 2πx; the tests prove both in ball arithmetic
UP = 1 + 1e-14  # makes up for 90 roundings of sums and products of positive numbers
MORE = 1.0001  # makes up for `_LONGEST` roundings of a sum of positive numbers
PI, TWO_PI, TWO_PI2 = 3.141592653589793, 6.283185307179586, 19.739208802178716
CUBIC, QUARTIC = 6.58, 10.34  # (2π)²/6 and (2π)³/24, rounded up: remainders of h
COS_CUBIC = 41.35  # (2π)³/6, rounded up: the remainder of cos

_LARGEST = 0.1  # |x - x̂| up to which the bounds hold
_KNOWN = 0.8  # share of |x - x̂| that may be known by its bound alone; else the box is halved
_WRONSKIAN = 1e-3  # by which v_n t_{n+1} - v_{n+1} t_n may differ from δ
_HUGE = 1e100  # V beyond which products may overflow
_LONGEST = 1e11  # kicks of a box in a proof; they would take hours

_WEAK = 0.1  # P Σ|κ_j|; it is 0.97 where the last circle of one kick in P breaks
_FIRST = 16  # boxes to begin with
_SMALLEST = 2.0**-50  # δ; up to s = 8 centres are exact down to there
_BLOCK = 8  # kicks between two looks for events, or a few more: whole periods
_STATE, _ROWS, _V = 18, 19, 6  # numbers of a box: those that change, all, and which is V
_FIRST_EXCESS = 0.1  # s/value - 1 where `proved_upper` begins
_KICKS = 2_000_000  # in one call of the kernel
_CROWD = 128  # boxes, at least, that wait on a piece that is bent
_LOOK = 2**14  # steps within which floats must eliminate all starts on a polygon
_GRID = 2.0**26  # of its corners, whose sums and multiples in two floats are exact


class Outcome(Enum):
    """What became of a proof."""

    PROVED = "no rotational invariant circle exists: transport is global, by nasm/proofs/README.md"
    BUDGET = "not proved: the budget is spent"
    PRECISION = "not proved: boxes became too small or too many; a circle may be left"
    SCOPE = (
        "not proved: the theorem needs one kick a period, two of which one is weaker than 2, or "
        f"up to {MAX_PERIOD} that are weak enough for a twist map, after shortening"
    )
    WEAK = "not proved, and not tried: kicks are so weak that a circle is plainly there"


@dataclass(frozen=True, eq=False)
class Proof(Result):
    """A proof, or what was in the way, which says nothing about circles."""

    outcome: Outcome

    @property
    def proved(self):
        return self.outcome is Outcome.PROVED

    @property
    def why(self):
        return self.outcome.value


@dataclass(frozen=True, eq=False)
class TransportProof(Proof):
    """The result of trying to prove that a forcing has no rotational invariant circle.

    outcome : Outcome; PROVED, or what was in the way, which says nothing about circles.
    given : tuple of floats, the forcing as it was given. kappa : that, shortened, which the boxes
        are about. The proof holds for these very floats.
    site : int; points : ndarray of shape (m, 2), x and y before its kick of the curve's corners: of
        two ends that are their own images under (x, y) → (-x, -y), up to whole turns, and between.
    boxes : ndarray of shape (n, 2), rows ŝ, δ: starts |s - ŝ| ≤ δ that no circle meets; s is 0 at
        the first corner, 1/2 at the second, and so on. A proof's boxes tile the curve, in order.
    lives : ndarray of shape (n, 1), N: kicks until V ≤ 0, for each box; or (n, 2), forwards and
        backwards, for three kicks and more.
    slopes : ndarray of n floats, γ of each box.
    """

    given: tuple[float, ...]
    kappa: tuple[float, ...]
    site: int
    points: np.ndarray = field(repr=False)
    boxes: np.ndarray = field(repr=False)
    lives: np.ndarray = field(repr=False)
    slopes: np.ndarray = field(repr=False)

    def certificate(self):
        """What another program needs to check the proof; ValueError if nothing was proved."""
        fields = {
            "shortened_from": {"kappa": in_hex(self.given)},
            "kappa": in_hex(self.kappa),
            "site": self.site,
        }
        if len(self.kappa) > 2:
            rows, lives = np.column_stack([self.boxes, self.slopes]), self.lives
            theorem = "Transport is global under several kicks"
            fields["points"] = [in_hex(point) for point in self.points.tolist()]
        else:
            rows, lives, theorem = self.boxes, self.lives[:, 0], "Transport is global"
            fields["a"] = self.a
        fields |= {"boxes": columns_in_hex(rows), "lives": lives.tolist()}
        return certificate(self, theorem, fields, self.given)

    @property
    def a(self):
        """The curve's first x; of a symmetry line, all."""
        return float(self.points[0, 0])


def prove(kappa, budget=10.0):
    """Try to prove that no rotational invariant circle exists under the forcing kappa.

    Parameters
    ----------
    kappa : sequence of P floats. Shortened it must be a twist map: P = 1, P = 2 with min |κ_i| < 2,
        or 2 < P ≤ 64 and the matrix of `_is_twist` positive definite; otherwise the outcome is
        SCOPE. It is WEAK, and nothing is tried, where P Σ|κ_j| < 0.1.
    budget : float, CPU seconds to spend; s/s_c - 1 = 10⁻³ takes some 10⁻² s for two kicks, and up
        to half a second for three or four; from there it takes ten times as long to come three
        times as near. For three and more that includes the search for the polygon, whose last step
        may take a second longer.

    Returns
    -------
    TransportProof. What is not proved is not disproved.

    ValueError if kappa is no forcing, or budget is not positive. RuntimeError if the machine's
    arithmetic is not the one that the proof needs.
    """
    kappa = forcing(kappa)
    (short,), _ = shorten([kappa], rational(0))
    budget = positive("budget", budget, "seconds of computing time")
    check_arithmetic()
    nothing = np.empty((0, 2))
    _followed(np.zeros(1), 0, nothing, nothing, np.empty(0), math.inf)  # before time counts
    given, strengths = tuple(kappa.tolist()), tuple(short.tolist())
    if short.size * np.abs(short).sum() < _WEAK:
        return _unproved(Outcome.WEAK, given, strengths)
    if short.size > MAX_PERIOD or not _is_twist(strengths):
        return _unproved(Outcome.SCOPE, given, strengths)
    if len(strengths) > 2:
        return _on_polygon(short, given, strengths, budget)
    site = int(np.argmax(np.abs(short)))
    a = 0.5 if short[site] > 0 else 0.0
    proof, _ = _covered(given, strengths, site, np.array([[a, 0.0], [a, 0.5]]), budget)
    return proof


def _unproved(outcome, given, kappa):
    nothing = np.empty((0, 2))
    lives = np.empty((0, 2), int)
    return TransportProof(outcome, given, kappa, 0, nothing, nothing, lives, np.empty(0))


def _on_polygon(kappa, given, strengths, budget):
    """The TransportProof for three kicks and more.

    A piece of the polygon is bent where more boxes wait than kicks were needed to eliminate all
    floats. If that does not help, another polygon is tried, and in the end all boxes of the last.
    """
    _compile_search()
    polygon, end = None, time.thread_time() + budget
    for curve, kicks in transversal.eliminated_transversals(kappa, _LOOK, end):
        longest, bent = transversal.longest_period(kicks / kappa.size), True
        while bent:
            points, pieces = _closed(curve.corners)
            polygon, left = (given, strengths, curve.site, points), end - time.thread_time()
            proof, crowded = _covered(*polygon, left, max(kicks, _CROWD))
            if crowded is None:
                return proof
            piece = pieces[crowded]
            bent = 0 <= piece < len(curve.orbits) - 1 and curve.bend(piece, longest)
    if polygon is None:
        late = time.thread_time() > end
        return _unproved(Outcome.BUDGET if late else Outcome.PRECISION, given, strengths)
    proof, _ = _covered(*polygon, end - time.thread_time())
    return proof


@cache
def _compile_search():
    """Search once where it takes no time, so that compiling its kernels does not count."""
    next(transversal.eliminated_transversals((1.9, 1.8, 1.7), 256), None)


def _closed(corners):
    """The corners on a grid, between two that are their own images. And of each piece its number
    among those of `corners`, which is out of their range where the piece leads to an image."""
    points = np.rint(corners * _GRID) / _GRID
    first, last = np.rint(2 * points[[0, -1]]) / 2
    points = np.concatenate([[first], points, [last]])
    kept = np.append(True, (np.diff(points, axis=0) != 0).any(axis=1))
    return points[kept], (np.flatnonzero(kept)[1:] - 2).tolist()


def _is_twist(kappa):
    """Whether for some m the kicks after κ_m, without κ_m itself, make x_{m+P} grow with x_{m+1}.

    That is if the matrix with 2 - |κ_j| on the diagonal, j = m + 1 … m + P - 1, and -1 beside it is
    positive definite: all its leading minors are positive, in exact arithmetic.
    """
    entries = [2 - abs(Fraction(k)) for k in kappa]
    return any(_is_positive(entries[m + 1 :] + entries[:m]) for m in range(len(kappa)))


def _is_positive(diagonal):
    minor, last = Fraction(1), Fraction(0)
    for entry in diagonal:
        minor, last = entry * minor - last, minor
        if minor <= 0:
            return False
    return True


def proved_upper(profile, value, budget):
    """The smallest scale found at which transport is proved to be global on a ray κ = s·profile.

    Parameters
    ----------
    profile : sequence of P floats, as for `prove`.
    value : float, 1e-300 to 1e306, where the last circle breaks, as by `barriers.critical_scale`. A
        bad value costs time, no truth.
    budget : float, CPU seconds in all.

    Returns
    -------
    scale : float, of the best proof; NaN if nothing was proved. proof : TransportProof at
    scale·profile, the last that failed if none succeeded.

    ValueError as for `prove`, or if value is out of range.
    """
    profile = direction(profile)
    value = real("value", value, MIN_SIZE, MAX_STRENGTH / MIN_SIZE)
    end = time.thread_time() + positive("budget", budget, "seconds of computing time")
    best, scale, reached, failed, affordable = None, math.nan, math.inf, 0.0, 0.0
    excess = _FIRST_EXCESS
    while excess < 0.9 * reached and (left := end - time.thread_time()) > 0:
        proof = prove(value * (1 + excess) * profile, left if best else left / 4)
        after = end - time.thread_time()
        if proof.proved:
            best, scale, reached = proof, value * (1 + excess), excess
            # Work grows like the square of 1/excess, or a little slower.
            affordable = excess * math.sqrt(1.5 * (left - after) / max(after, 1e-9))
        elif best is None and excess < 4:
            excess *= 2
            continue
        else:
            failed = excess
        excess = max(reached / 3, math.sqrt(reached * failed), affordable)
    return scale, best or proof


def _covered(given, kappa, site, points, budget, most=math.inf):
    """The TransportProof: boxes that fail are halved, level by level. And the piece on which more
    than `most` wait, if there is one: this ends there."""
    forwards = np.tile(np.roll(kappa, -site), -(-_BLOCK // len(kappa)))
    ways = [forwards, forwards[::-1].copy()] if len(kappa) > 2 else [forwards]
    boxes = np.full((_FIRST * (len(points) - 1), 2), 0.25 / _FIRST)
    boxes[:, 0] *= 2 * np.arange(len(boxes)) + 1
    end = time.thread_time() + budget
    outcome, found, crowded = Outcome.PROVED, [], None
    while len(boxes):
        if len(ways) > 1:
            slopes = _slopes(np.roll(kappa, -site), points, boxes[:, 0])
        else:
            slopes = np.full(len(boxes), abs(forwards[0]) / 2)
        lives = np.zeros((len(boxes), len(ways)), np.int64)
        for way, cycle in enumerate(ways):
            rest = lives[:, :way].all(axis=1)
            lives[rest, way] = _followed(cycle, way, points, boxes[rest], slopes[rest], end)
        done = lives.all(axis=1)
        found.append((boxes[done], lives[done], slopes[done]))
        middles, half = np.transpose(boxes[~done]) * [[1], [0.5]]
        boxes = np.transpose([[middles - half, middles + half], [half, half]]).reshape(-1, 2)
        waiting = np.bincount((2 * boxes[:, 0]).astype(int), minlength=1)
        if waiting.max() > most:
            crowded = int(waiting.argmax())
        if len(boxes) and (crowded is not None or time.thread_time() > end):
            outcome = Outcome.BUDGET
            break
        if len(boxes) and half.min() < _SMALLEST * max(1.0, (len(points) - 1) / 16):
            outcome = Outcome.PRECISION
            break
    boxes, lives, slopes = map(np.concatenate, zip(*found, strict=True))
    order = np.argsort(boxes[:, 0])
    boxes, lives, slopes = boxes[order], lives[order], slopes[order]
    end = len(points) / 2 - 0.5
    if outcome is Outcome.PROVED and not (_tiles(boxes, end) and lives.max() < _LONGEST):
        raise RuntimeError(
            f"the boxes of a proof do not tile its curve, or one lives for {_LONGEST:g} kicks; "
            "please report this"
        )
    return TransportProof(outcome, given, kappa, site, points, boxes, lives, slopes), crowded


def _slopes(kappa, points, starts):
    """γ of each start: with it V crosses zero on both sides, in floats, if that can be."""
    x, y = (np.interp(2 * starts, np.arange(len(points)), axis) for axis in points.T)
    _, slopes = transversal.elimination(kappa, x, y, _LOOK * len(kappa))
    return np.clip(np.rint(slopes * 2.0**20) / 2.0**20, -3, 1 - 2.0**-20)


def _followed(cycle, way, points, boxes, slopes, end):
    """The lives of boxes, 0 of those that fail, or that the time is not enough for."""
    lives, first, unfinished = np.zeros(len(boxes), np.int64), 0, True
    lanes, ages, here = np.zeros((_ROWS, FEW)), np.zeros(FEW, np.int64), np.full(FEW, -1)
    while unfinished and time.thread_time() < end:
        first, unfinished = _follow(
            cycle, way, points, boxes, slopes, lives, lanes, ages, here, first, _KICKS
        )
    return np.where(lives, lives + way, 0)


def _tiles(boxes, end=0.5):
    """Whether the boxes, from left to right, tile [0, end]; the sums are exact."""
    left, right = boxes[:, 0] - boxes[:, 1], boxes[:, 0] + boxes[:, 1]
    return left[0] == 0 and right[-1] == end and bool((left[1:] == right[:-1]).all())


def check_arithmetic():
    """RuntimeError unless floats round to nearest, underflow gradually, and fma is fused."""
    if not _arithmetic_is_ieee(1.0, 2.0**-53, 2.0**-52, 2.0**-1022):
        raise RuntimeError(
            "this machine's arithmetic is not IEEE 754 with rounding to nearest, gradual underflow "
            "and a fused fma; nothing can be proved on it"
        )


@kernel
def _arithmetic_is_ieee(one, half, ulp, tiny):
    """Powers of two as arguments, so that the compiler can work out nothing beforehand."""
    nearest = one + half == one and one + 1.5 * half == one + ulp and -one - half == -one
    fused = fma(one + ulp, one - ulp, -one) == -ulp * ulp
    return nearest and fused and tiny / 2 > 0


_ELIMINATED, _FAILED = 0, 1


@kernel(error_model="numpy")
def _follow(cycle, way, points, boxes, slopes, lives, lanes, ages, here, first, most_kicks):
    """Go on with boxes, for some kicks: the first one not begun, and whether any is left.

    cycle : a block of kicks. boxes, slopes, lives : ŝ, δ, γ, and what is found. lanes, ages, here :
    the state, the kicks and the box of each lane, -1 if there is none.
    """
    before, events, kicks = np.empty((_ROWS, FEW)), np.empty((2, FEW)), 0
    while kicks < most_kicks:
        busy = 0
        for lane in range(FEW):
            if here[lane] < 0 and first < len(boxes):
                here[lane], ages[lane] = first, 0
                _start(lanes, lane, points, boxes[first, 0], boxes[first, 1], slopes[first], way)
                first += 1
            busy += here[lane] >= 0
        if busy == 0:
            return first, False
        before[:] = lanes
        _advance(cycle, lanes, events)
        for lane in range(FEW):
            if here[lane] < 0:
                continue
            if events[0, lane] > 0 and events[1, lane] <= 0:  # all went well; false for NaN
                ages[lane] += len(cycle)
                kicks += len(cycle)
                continue
            n, outcome = _replay(cycle, before, lane)
            kicks += n
            if outcome == _ELIMINATED:
                lives[here[lane]] = ages[lane] + n
            here[lane] = -1
    return first, True


@njit(nogil=True)
def _start(lanes, lane, points, s, delta, slope, way):
    """The state of a box before the kick of the curve's site; or, way = 1, before that of the site
    before it, of the kicks in reverse."""
    for row in range(_ROWS):
        lanes[row, lane] = 0.0
    at = min(int(2 * s), len(points) - 2)
    part, x, y = 2 * s - at, points[at, 0], points[at, 1]
    dx, dy = points[at + 1, 0] - x, points[at + 1, 1] - y
    lanes[2, lane], lanes[3, lane] = _along(y, part, dy)
    t, z, last = 2 * delta * dx, 2 * delta * dy, slope
    if abs(z - last * t) < 1e-4 * (abs(t) + abs(z)):  # v would be along the curve
        last += 1
    wronskian = z - last * t
    if way:
        x, dx, t = y - x, dy - dx, z - t
        slope, last = -slope, -last
    sign = 1.0 if wronskian > 0 else -1.0
    lanes[0, lane], lanes[1, lane] = _along(x - 0.25, part, dx)
    lanes[4, lane], lanes[5, lane] = 1 + way * last, last  # v
    lanes[6, lane], lanes[7, lane] = 1 + way * slope, slope  # V
    lanes[8, lane], lanes[9, lane] = sign * t, sign * z
    lanes[18, lane] = sign / wronskian


@njit(nogil=True)
def _along(start, part, length):
    """start + part·length as a sum of two floats, exactly: see README.md."""
    product = part * length
    total, error = two_sum(start, product)
    return total, error + fma(part, length, -product)


@njit(nogil=True, error_model="numpy")
def _advance(cycle, lanes, events):
    """A block of kicks of all lanes, in place; the smallest V into events[0], `bad` into [1]."""
    own_frame()
    state = load_state(lanes, 0, _STATE, FEW)
    scale = load_few(lanes, 18 * FEW)
    smallest, worst = state[_V], scale - scale  # zeros
    for n in range(len(cycle)):
        state, bad = _kick(cycle[n], scale, state)
        smallest, worst = minimum(smallest, state[_V]), worst + bad
    store_state(lanes, state)
    store(events, 0, smallest)
    store(events, FEW, worst)


@njit(nogil=True, error_model="numpy")
def _replay(cycle, lanes, lane):
    """(kicks, outcome) of the lane within a block, kick by kick: the definition."""
    state = load_state(lanes, lane, _STATE, 1)
    for n in range(len(cycle)):
        state, bad = _kick(cycle[n], lanes[18, lane], state)
        if not bad <= 0:
            return n + 1, _FAILED
        if state[_V] <= 0:
            return n + 1, _ELIMINATED
    return len(cycle), _FAILED


@njit(forceinline=True)
def _accurate(x, x_low):
    """rint X - X of the leading part, h = sin 2πx/2π as a sum of two, and cos 2πx; x - 1/4 = X is
    x + x_low. On lanes or floats."""
    back = rint(x) - x
    r = fabs(back)
    u = 0.25 - r
    u_low = (0.25 - u) - r
    v = u * u
    v_low = fma(2.0 * u, u_low, fma(u, u, -v))
    s = horner(v, _S4)
    s, s_low = _next(s, 0.0, v, v_low, _S3)
    s, s_low = _next(s, s_low, v, v_low, _S2)
    s, s_low = _next(s, s_low, v, v_low, _S1)
    s, s_low = _next(s, s_low, v, v_low, _S0)
    c = copysign(horner(v, COSINE), back)
    h = u * s
    h_low = fma(u_low, s, fma(u, s_low, fma(u, s, -h)))
    return back, h, fma(c, x_low, h_low), c


@njit(forceinline=True)
def horner(v, c):
    """Σ c_k vᵏ of eight coefficients."""
    s = fma(v, c[7], c[6])
    s = fma(s, v, c[5])
    s = fma(s, v, c[4])
    s = fma(s, v, c[3])
    s = fma(s, v, c[2])
    s = fma(s, v, c[1])
    return fma(s, v, c[0])


@njit(forceinline=True)
def _next(s, s_low, v, v_low, coefficient):
    """(s + s_low)(v + v_low) + coefficient, whose leading part is the largest number."""
    product = s * v
    error = fma(s_low, v, fma(s, v_low, fma(s, v, -product)))
    total = coefficient[0] + product
    return total, (product - (total - coefficient[0])) + (error + coefficient[1])


@njit(forceinline=True, error_model="numpy")
def _kick(k, scale, state):
    """One kick of a box, on lanes or floats; x + x_low is the shifted angle x̂ - 1/4, scale 1/δ.

    w, W, z, p are the last differences of v, V, t, q. Returns the state and `bad`, which is 0 while
    the bounds hold, and NaN or positive if not.
    """
    x, x_low, y, y_low, v, w, V, W, t, z, q, p, A, B, linear, quadratic, rest, paid = state
    size = fabs(k)
    back, h, h_low, c = _accurate(x, x_low)
    kc = k * c
    f2 = -TWO_PI2 * k * h  # κh''/2

    # |x - x̂|: all of it, what is not σt, and what is known by its bound alone.
    straight = fabs(t)
    unknown = fma(A, fabs(v), B * straight)
    curved = fabs(q) + unknown
    E = straight + curved
    E2 = E * E
    E3 = E2 * E
    cosine = fabs(c)
    sine = fma(fabs(h), TWO_PI, 7e-16)
    both = curved * (E + straight)  # |(x - x̂)² - (σt)²|

    # Payment: for what Q may be larger by than in the middle, and for rounding.
    V2 = V * V
    f4 = 2.0 * f2
    linear = fma(f4 * t, V2, linear)
    quadratic = fma(fma(f4, q, -(TWO_PI2 * kc) * t * t), V2, quadratic)
    change = fma(TWO_PI * sine, unknown, fma(TWO_PI2 * cosine, both, COS_CUBIC * E3))
    rounding = fma(E, 1e-12, 3e-14)
    signed = fabs(linear) + fabs(quadratic)
    rest = fma(V2, fma(change, size, rounding * (1.0 + size)), rest) * UP + 1e-15 * signed
    due = maximum(0.0, (fabs(linear) + maximum(0.0, quadratic) + rest) * UP - paid)
    paid = paid + due
    W = fma(kc, V, W) + due / V * MORE
    V = V + W

    # One kick on.
    w = fma(kc, v, w)
    z = fma(kc, t, z)
    p = fma(f2 * t, t, fma(kc, q, p))
    v1, t1, q1 = v + w, t + z, q + p
    # Defects: of the orbit, of its expansion, of the three solutions, of the cosine.
    E1 = fma(A, fabs(v1), fma(B, fabs(t1), fabs(t1) + fabs(q1)))
    expansion = fma(PI * sine, both, fma(CUBIC * cosine, E3, QUARTIC * E2 * E2))
    solutions = fma(E1 + E, 3.1 * ULP, fma(E2, 41.0, E) * (size * (COS + 4 * ULP)))
    defect = fma(expansion, size, solutions + (size + 1.0) * ORBIT) * (1.002 * scale)
    tv = t * v1
    wronskian = fabs(fma(v, t1, -tv) * scale - 1.0) + fabs(tv) * (4 * ULP * scale)
    A = fma(defect, straight, A)
    B = fma(defect, fabs(v), B)
    bad = (
        maximum(0.0, E - _LARGEST)
        + maximum(0.0, fma(E, -_KNOWN, curved))
        + maximum(0.0, wronskian - _WRONSKIAN)
        + maximum(0.0, V - _HUGE)
    )
    product = k * h
    y, error = two_sum(y, product)
    y, y_low = renormalised(y, error + (y_low + fma(k, h_low, fma(k, h, -product))))
    y = y - rint(y)
    x, error = two_sum(y, -back)
    x, x_low = renormalised(x, error + (x_low + y_low))
    state = (x, x_low, y, y_low, v1, w, V, W, t1, z, q1, p, A, B, linear, quadratic, rest, paid)
    return state, bad
