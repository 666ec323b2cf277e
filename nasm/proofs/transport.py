"""A proof, by computer, that transport is global: no rotational invariant circle exists.

Along orbits of the chain that start on a symmetry line, x_c = a, x_{c+1} = a + y, the second
variation of the action is positive if a circle passes through the start. So if for every y in
[0, 1/2] some η, even about the site c and of finite support, has

    Q = Σ_k η_k ((2 + κ_k cos 2πx_k) η_k - η_{k+1} - η_{k-1}) ≤ 0,   η ≠ 0,

no circle is left, and there are orbits from any y to any other. The theorem, and why what follows
proves its hypothesis in floating point, are in `proofs/README.md`, "Transport is global".

[0, 1/2] is covered by boxes |y - ŷ| ≤ δ. With y = ŷ + σδ the orbits of a box are

    x_n(σ) = x̂_n + σ t_n + σ² q_n + ρ_n,   |ρ_n| ≤ A_n|v_n| + B_n|t_n|,   |σ| ≤ 1,

x̂ in sums of two floats, v and t, in floats, the even and the odd solution of the linearised chain,
t_1 = δ, and q that of second order. A and B gather the remainder of third order and all rounding,
in the frame of v and t, where nothing is multiplied from kick to kick. One η serves a box: v with
payments. To

    V_{n+1} = (2 + κ_n cos 2πx̂_n + μ_n) V_n - V_{n-1}

μ_nV_n² adds what Q may be larger by, somewhere in the box, than what was paid before, so that
V_N ≤ 0 shows Q ≤ 0 in the whole box. N is the life of the box. A box that fails is halved.

Sixteen boxes run in lockstep on `nasm.arithmetic.lanes`; an event among them is found again by the
same kick on floats, which is the definition. Everything rests on IEEE arithmetic with rounding to
nearest, gradual underflow and a true fma, which `check_arithmetic` tries at run time.
"""

import math
import time
from dataclasses import dataclass, field
from enum import Enum
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
from nasm.checks import real
from nasm.maps import direction, forcing
from nasm.numbers import rational
from nasm.proofs.certificates import certificate, in_hex
from nasm.symmetries import dominant_centre, shorten

__all__ = ["Outcome", "TransportProof", "prove", "proved_upper"]
__dir__ = __all__.copy

_D0, _D1, _D2, _D3, _D4, _D5, _D6, _D7 = COSINE

# Taylor coefficients of sin 2πu / 2πu in u²: four sums of two floats, eight floats.
_SERIES = [(-1) ** k * (2 * EXACT_PI) ** (2 * k) / factorial(2 * k + 1) for k in range(12)]
_S0, _S1, _S2, _S3 = map(pair, _SERIES[:4])
_S4, _S5, _S6, _S7, _S8, _S9, _S10, _S11 = map(float, _SERIES[4:])

ULP = 2.0**-53  # of rounding, relative; and a bound of the error of h = sin 2πx/2π
ORBIT = 2.0**-66  # a bound of the error of h as a sum of two floats, and of rounding x and y
COS = 2.1e-14  # a bound of the error of cos 2πx; the tests prove both in ball arithmetic
UP = 1 + 1e-14  # makes up for 90 roundings of sums and products of positive numbers
DOWN = 1 - 1e-14
MORE = 1.0001  # makes up for `_LONGEST` roundings of a sum of positive numbers
PI, TWO_PI, TWO_PI2 = 3.141592653589793, 6.283185307179586, 19.739208802178716
CUBIC, QUARTIC = 6.58, 10.34  # (2π)²/6 and (2π)³/24, rounded up: remainders of h
COS_CUBIC = 41.35  # (2π)³/6, rounded up: the remainder of cos

_LARGEST = 0.1  # |x - x̂| up to which the bounds hold
_KNOWN = 0.8  # share of |x - x̂| that may be known by its bound alone; else the box is halved
_WRONSKIAN = 1e-3  # by which v_n t_{n+1} - v_{n+1} t_n may differ from δ
_HUGE = 1e100  # V beyond which products may overflow
_LONGEST = 1e11  # kicks of a box in a proof; they would take hours

_FIRST = 16  # boxes to begin with
_SMALLEST = 2.0**-50  # δ; centres are exact down to there
_BLOCK = 8  # kicks between two looks for events; even
_STATE, _ROWS, _V = 18, 19, 6  # numbers of a box: those that change, all, and which is V
_MOST_WAITING = 2048  # boxes: each of 16 lanes leaves one behind at each of 46 halvings
_FIRST_EXCESS = 0.1  # s/value - 1 where `proved_upper` begins
_KICKS = 2_000_000  # in one call of the kernel
_FOUND = 8192  # boxes in one call


class Outcome(Enum):
    """What became of a proof."""

    PROVED = "no rotational invariant circle exists: transport is global, by nasm/proofs/README.md"
    BUDGET = "not proved: the budget is spent"
    PRECISION = "not proved: boxes became too small or too many; a circle may be left"
    SCOPE = (
        "not proved: the theorem needs one kick a period, or two of which one is weaker than 2, "
        "after shortening"
    )


@dataclass(frozen=True)
class TransportProof:
    """The result of trying to prove that a forcing has no rotational invariant circle.

    outcome : Outcome; PROVED, or what was in the way, which says nothing about circles.
    given : tuple of floats, the forcing as it was given. kappa : that, shortened, which the boxes
        are about. The proof holds for these very floats.
    site, a : int and float, the symmetry line: boxes start at x = a before this kick.
    boxes : ndarray of shape (n, 2), rows ŷ, δ: starts |y - ŷ| ≤ δ that no circle meets. A proof's
        boxes tile [0, 1/2], from left to right.
    lives : ndarray of n ints, N: kicks until V ≤ 0, for each box.
    kicks : int, kicks spent, on boxes that were halved too.
    """

    outcome: Outcome
    given: tuple[float, ...]
    kappa: tuple[float, ...]
    site: int
    a: float
    boxes: np.ndarray = field(repr=False)
    lives: np.ndarray = field(repr=False)
    kicks: int

    @property
    def proved(self):
        return self.outcome is Outcome.PROVED

    @property
    def why(self):
        return self.outcome.value

    def certificate(self):
        """What another program needs to check the proof: see proofs/README.md, "Certificates".

        ValueError if nothing was proved.
        """
        fields = {
            "shortened_from": {"kappa": in_hex(self.given)},
            "kappa": in_hex(self.kappa),
            "site": self.site,
            "a": self.a,
            "boxes": list(map(in_hex, self.boxes.tolist())),
            "lives": self.lives.tolist(),
        }
        return certificate(self, "Transport is global", fields, self.given)


def prove(kappa, budget=10.0):
    """Try to prove that no rotational invariant circle exists under the forcing kappa.

    Parameters
    ----------
    kappa : sequence of P floats. Shortened it must have P = 1, or P = 2 with min |κ_i| < 2;
        otherwise the outcome is SCOPE.
    budget : float, CPU seconds to spend; s/s_c - 1 = 10⁻³ takes some 10⁻² s, and from there it
        takes ten times as long to come three times as near.

    Returns
    -------
    TransportProof. What is not proved is not disproved.

    ValueError if kappa is no forcing, or budget is not positive. RuntimeError if the machine's
    arithmetic is not the one that the proof needs.
    """
    kappa = forcing(kappa)
    (short,), _ = shorten([kappa], rational(0))
    budget = checked_budget(budget)
    check_arithmetic()
    given, strengths = tuple(kappa.tolist()), tuple(short.tolist())
    if len(strengths) > 2 or (len(strengths) == 2 and min(map(abs, strengths)) >= 2):
        nothing = np.empty((0, 2)), np.empty(0, np.int64)
        return TransportProof(Outcome.SCOPE, given, strengths, 0, 0.0, *nothing, 0)
    site, a = dominant_centre(short)
    k0, k1 = np.resize(np.roll(short, -site), 2).tolist()
    outcome, boxes, lives, kicks = _covered(k0, k1, a, budget)
    return TransportProof(outcome, given, strengths, site, a, boxes, lives, kicks)


def proved_upper(profile, value, budget):
    """The smallest scale found at which transport is proved to be global on a ray κ = s·profile.

    Parameters
    ----------
    profile : sequence of P floats, as for `prove`.
    value : float, where the last circle breaks, as by `barriers.critical_scale`. A bad value costs
        time, no truth.
    budget : float, CPU seconds in all.

    Returns
    -------
    scale : float, of the best proof; NaN if nothing was proved. proof : TransportProof at
    scale·profile, the last that failed if none succeeded.

    ValueError as for `prove`, or if value is not positive.
    """
    profile = direction(profile)
    value, budget = real("value", value), checked_budget(budget)
    if not 0 < value < math.inf:
        raise ValueError(f"value={value!r} must be positive: the scale at which the circle breaks")
    end = time.thread_time() + budget
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


def checked_budget(budget):
    """`budget` as a float; ValueError unless it is a positive number."""
    budget = real("budget", budget)
    if not budget > 0:
        raise ValueError(f"budget={budget!r} must be positive: seconds of computing time")
    return budget


def _covered(k0, k1, a, budget):
    """Outcome, boxes, lives and kicks of the cover; k0 is the kick of the line."""
    delta = 0.25 / _FIRST
    waiting = np.zeros((_MOST_WAITING, 2))
    waiting[:_FIRST, 0] = delta * (2 * np.arange(_FIRST)[::-1] + 1)
    waiting[:_FIRST, 1] = delta
    lanes, boxes, ages = np.zeros((_ROWS, FEW)), np.zeros((FEW, 2)), np.zeros(FEW, np.int64)
    found, lives = np.empty((_FOUND, 2)), np.empty(_FOUND, np.int64)
    all_found, all_lives = [found[:0]], [lives[:0]]
    end = time.thread_time() + budget
    outcome, n_waiting, kicks = Outcome.BUDGET, _FIRST, 0
    while time.thread_time() < end:
        done, n_waiting, n_found, n_kicks = _cover(
            k0, k1, a - 0.25, waiting, n_waiting, lanes, boxes, ages, found, lives, _KICKS
        )
        kicks += n_kicks
        all_found.append(found[:n_found].copy())
        all_lives.append(lives[:n_found].copy())
        if done != _UNFINISHED:
            outcome = Outcome.PROVED if done == _DONE else Outcome.PRECISION
            break
    boxes, lives = np.concatenate(all_found), np.concatenate(all_lives)
    order = np.argsort(boxes[:, 0])
    boxes, lives = boxes[order], lives[order]
    if outcome is Outcome.PROVED and not (_tiles(boxes) and lives.max() < _LONGEST):
        raise RuntimeError(
            f"the boxes of a proof do not tile [0, 1/2], or one lives for {_LONGEST:g} kicks; "
            "please report this"
        )
    return outcome, boxes, lives, kicks


def _tiles(boxes):
    """Whether the boxes, from left to right, tile [0, 1/2]; the sums are exact."""
    left, right = boxes[:, 0] - boxes[:, 1], boxes[:, 0] + boxes[:, 1]
    return left[0] == 0 and right[-1] == 0.5 and bool((left[1:] == right[:-1]).all())


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


_DONE, _UNFINISHED, _TOO_SMALL = 0, 1, 2
_ELIMINATED, _FAILED = 0, 1


@kernel(error_model="numpy")
def _cover(k0, k1, x, waiting, n_waiting, lanes, boxes, ages, found, lives, most_kicks):
    """Go on with a cover, for some kicks: whether it is done, and counts.

    waiting[:n_waiting] : boxes ŷ, δ to do, a stack. lanes, boxes, ages : the state, the box (δ = 0
    if there is none) and the kicks of each lane. found, lives : receive the boxes eliminated.
    """
    before, events = np.empty((_ROWS, FEW)), np.empty((2, FEW))
    n_found = kicks = 0
    while kicks < most_kicks and n_found <= found.shape[0] - FEW:
        busy = 0
        for lane in range(FEW):
            if boxes[lane, 1] == 0 and n_waiting > 0:
                n_waiting -= 1
                ages[lane] = 0
                boxes[lane, 0], boxes[lane, 1] = waiting[n_waiting, 0], waiting[n_waiting, 1]
                _start(lanes, lane, k0, x, boxes[lane, 0], boxes[lane, 1])
            if boxes[lane, 1] > 0:
                busy += 1
        if busy == 0:
            return _DONE, n_waiting, n_found, kicks
        for row in range(_ROWS):
            for lane in range(FEW):
                before[row, lane] = lanes[row, lane]
        _advance(k0, k1, lanes, events)
        for lane in range(FEW):
            delta = boxes[lane, 1]
            if delta == 0:
                continue
            if events[0, lane] > 0 and events[1, lane] <= 0:  # all went well; false for NaN
                ages[lane] += _BLOCK
                kicks += _BLOCK
                continue
            n, outcome = _replay(k0, k1, before, lane)
            kicks += n
            if outcome == _ELIMINATED:
                found[n_found, 0], found[n_found, 1] = boxes[lane, 0], delta
                lives[n_found] = ages[lane] + n
                n_found += 1
            else:
                if delta <= _SMALLEST or n_waiting + 2 > waiting.shape[0]:
                    return _TOO_SMALL, n_waiting, n_found, kicks
                for sign in (0.5, -0.5):  # the left half on top
                    waiting[n_waiting, 0] = boxes[lane, 0] + sign * delta
                    waiting[n_waiting, 1] = delta / 2
                    n_waiting += 1
            boxes[lane, 1] = 0
    return _UNFINISHED, n_waiting, n_found, kicks


@njit(nogil=True)
def _start(lanes, lane, k0, x, y, delta):
    """The state of a box before the kick of its line."""
    for row in range(_ROWS):
        lanes[row, lane] = 0.0
    lanes[0, lane], lanes[2, lane] = x, y
    lanes[4, lane] = lanes[6, lane] = 1.0  # v, V
    lanes[5, lane] = lanes[7, lane] = abs(k0) / 2  # their last differences
    lanes[9, lane] = delta  # the difference of t
    lanes[18, lane] = 1 / delta


@njit(nogil=True, error_model="numpy")
def _advance(k0, k1, lanes, events):
    """A block of kicks of all lanes, in place; the smallest V into events[0], `bad` into [1]."""
    own_frame()
    state = load_state(lanes, 0, _STATE, FEW)
    scale = load_few(lanes, 18 * FEW)
    smallest, worst = state[_V], scale - scale  # zeros
    for _ in range(_BLOCK):
        state, bad = _kick(k0, scale, state)
        smallest, worst = minimum(smallest, state[_V]), worst + bad
        k0, k1 = k1, k0
    store_state(lanes, state)
    store(events, 0, smallest)
    store(events, FEW, worst)


@njit(nogil=True, error_model="numpy")
def _replay(k0, k1, lanes, lane):
    """(kicks, outcome) of the lane within a block, kick by kick: the definition."""
    state = load_state(lanes, lane, _STATE, 1)
    for n in range(_BLOCK):
        state, bad = _kick(k0, lanes[18, lane], state)
        if not bad <= 0:
            return n + 1, _FAILED
        if state[_V] <= 0:
            return n + 1, _ELIMINATED
        k0, k1 = k1, k0
    return _BLOCK, _FAILED


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
    s = fma(v, _S11, _S10)
    s = fma(s, v, _S9)
    s = fma(s, v, _S8)
    s = fma(s, v, _S7)
    s = fma(s, v, _S6)
    s = fma(s, v, _S5)
    s = fma(s, v, _S4)
    s, s_low = _next(s, 0.0, v, v_low, _S3)
    s, s_low = _next(s, s_low, v, v_low, _S2)
    s, s_low = _next(s, s_low, v, v_low, _S1)
    s, s_low = _next(s, s_low, v, v_low, _S0)
    d = fma(v, _D7, _D6)
    d = fma(d, v, _D5)
    d = fma(d, v, _D4)
    d = fma(d, v, _D3)
    d = fma(d, v, _D2)
    d = fma(d, v, _D1)
    d = fma(d, v, _D0)
    c = copysign(d, back)
    h = u * s
    h_low = fma(u_low, s, fma(u, s_low, fma(u, s, -h)))
    return back, h, fma(c, x_low, h_low), c


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
