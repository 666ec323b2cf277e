"""A proof that transport is global for every forcing of a cell of the (κ1, κ2) plane.

As `nasm.proofs.transport`, to second order, in three parameters: the start and the two strengths,

    y = ŷ + σδ + g_0 σ_0 h_0 + g_1 σ_1 h_1,   κ_i = k_i + σ_i h_i,   |σ|, |σ_0|, |σ_1| ≤ 1,
    x_n = x̂_n + σ t + σ_0 p + σ_1 q + σ² tt + σσ_0 tp + σσ_1 tq + σ_0² pp + σ_0σ_1 pq + σ_1² qq + ρ,
    |ρ_n| ≤ A_n|v_n| + B_n|t_n|.

The shear g lets the starts follow an orbit of much the same rotation number as κ varies, so that p
and q grow less. [0, 1/2] is cut into pieces, each with a shear of its own; a piece is covered for
all κ of the cell by starts that reach Σ_i |g_i| h_i beyond its ends. A box that fails is halved
across the parameter that has moved its orbit most. See `proofs/README.md`, "Transport is global".
"""

import time
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from nasm.arithmetic.double_double import two_sum
from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import (
    FEW,
    copysign,
    fabs,
    fma,
    load_state,
    maximum,
    minimum,
    own_frame,
    rint,
    store,
    store_state,
)
from nasm.arithmetic.sine import COSINE, SINE
from nasm.checks import floats, positive
from nasm.maps import forcing
from nasm.proofs.certificates import certificate, columns_in_hex, in_hex
from nasm.proofs.transport import (
    COS,
    COS_CUBIC,
    CUBIC,
    PI,
    QUARTIC,
    TWO_PI,
    TWO_PI2,
    ULP,
    UP,
    Outcome,
    Proof,
    check_arithmetic,
    horner,
)
from nasm.symmetries import dominant_centre

__all__ = ["CellProof", "prove_cell"]

_LARGEST, _KNOWN, _WRONSKIAN, _HUGE = 0.1, 0.8, 1e-3, 1e100  # as in `transport`

_EXACT = 2.0**30  # times which strengths must be whole numbers, so that halving a cell is exact
_PIECES = 16  # of [0, 1/2]
_GRID = 2.0**-20  # of the ends of pieces
_SHEARS = 2.0**-8  # of which g is a multiple
_SMALLEST_START, _SMALLEST_STRENGTH = 2.0**-45, 2.0**-40
_BLOCK, _STATE, _ROWS, _COLUMNS = 8, 40, 45, 9  # numbers of a box: those that change, and all
_MOST_WAITING = 4096
_KICKS, _FOUND = 200_000, 16_384  # in one call of the kernel
DOWN = 1 - 1e-14  # as `UP`, for a sum that is subtracted


@dataclass(frozen=True, eq=False)
class CellProof(Proof):
    """A proof that no rotational invariant circle exists for any forcing of a cell, or why not.

    outcome : Outcome, as of a `TransportProof`.
    kappa, half_width : tuples of two floats; the cell, |κ_i - kappa_i| ≤ half_width_i.
    site, a : int and float, the symmetry line: boxes start at x = a before this kick.
    boxes : ndarray of shape (n, 9), rows ŷ, δ, k_0, h_0, k_1, h_1, g_0, g_1 and the piece of
        [0, 1/2]; index 0 is the kick at `site`. lives : ndarray of n ints, kicks until V ≤ 0.
    """

    kappa: tuple[float, float]
    half_width: tuple[float, float]
    site: int
    a: float
    boxes: np.ndarray = field(repr=False)
    lives: np.ndarray = field(repr=False)

    def certificate(self):
        """What another program needs to check the proof; ValueError if nothing was proved."""
        fields = {
            "kappa": in_hex(self.kappa),
            "half_width": in_hex(self.half_width),
            "site": self.site,
            "a": self.a,
            "boxes": columns_in_hex(self.boxes),
            "lives": self.lives.tolist(),
        }
        cell = self.kappa, self.half_width
        return certificate(self, "Transport is global in a cell", fields, *cell)


def prove_cell(kappa, half_width, budget=1.0):
    """Try to prove that no rotational invariant circle exists for any forcing of a cell.

    Parameters
    ----------
    kappa : two floats, the centre of the cell.
    half_width : float or two floats > 0. The cell is |κ_i - kappa_i| ≤ half_width_i; all of these
        numbers must be multiples of 2⁻³⁰, so that the corners of the cell are exact. Cells in which
        some |κ_i| ≥ 2 have the outcome SCOPE.
    budget : float, CPU seconds to spend.

    Returns
    -------
    CellProof. What is not proved is not disproved.

    ValueError if an argument is out of range or no multiple of 2⁻³⁰. RuntimeError if the machine's
    arithmetic is not the one that the proof needs.
    """
    kappa = forcing(kappa)
    half_width = forcing(np.broadcast_to(floats("half_width", half_width), 2))
    budget = positive("budget", budget, "seconds of computing time")
    if kappa.size != 2:
        raise ValueError(f"kappa={kappa.tolist()}: the centre of a cell has two strengths")
    if not (half_width > 0).all():
        raise ValueError(f"half_width={half_width.tolist()} must be positive")
    numbers = _EXACT * np.concatenate([kappa, half_width])
    if (numbers != np.rint(numbers)).any():
        raise ValueError(
            f"kappa={kappa.tolist()} and half_width={half_width.tolist()} must be multiples of "
            "2**-30, so that the corners of the cell are exact"
        )
    check_arithmetic()
    cell = tuple(kappa.tolist()), tuple(half_width.tolist())
    if (np.abs(kappa) + half_width >= 2).any():
        nothing = np.empty((0, _COLUMNS)), np.empty(0, np.int64)
        return CellProof(Outcome.SCOPE, *cell, 0, 0.0, *nothing)
    site, a = dominant_centre(kappa)
    from_line = np.roll(kappa, -site).tolist(), np.roll(half_width, -site).tolist()
    outcome, *cover = _covered(*from_line, a, budget)
    return CellProof(outcome, *cell, site, a, *cover)


def _covered(kappa, half_width, a, budget):
    """Outcome, boxes and lives of the cover; the first kick is that of the line."""
    (k0, k1), (h0, h1), x = kappa, half_width, a - 0.25
    waiting, n_waiting = np.empty((_MOST_WAITING, _COLUMNS)), _PIECES
    for piece in range(_PIECES):
        left, right = piece / (2 * _PIECES), (piece + 1) / (2 * _PIECES)
        shears = np.array(_shears(x, (left + right) / 2, k0, k1))
        g0, g1 = (np.rint(np.clip(shears, -0.5, 0.5) / _SHEARS) * _SHEARS).tolist()
        margin = abs(g0) * h0 + abs(g1) * h1
        left = float(np.floor((left - margin) / _GRID)) * _GRID
        right = float(np.ceil((right + margin) / _GRID)) * _GRID
        middle, half = (left + right) / 2, (right - left) / 2
        waiting[piece] = middle, half, k0, h0, k1, h1, g0, g1, piece
    lanes, boxes, ages = np.zeros((_ROWS, FEW)), np.zeros((_COLUMNS, FEW)), np.zeros(FEW, np.int64)
    found, lives = np.empty((_FOUND, _COLUMNS)), np.empty(_FOUND, np.int64)
    parts, end, done = [(found[:0], lives[:0])], time.thread_time() + budget, _UNFINISHED
    while done == _UNFINISHED and time.thread_time() < end:
        done, n_waiting, n_found = _cover(
            x, waiting, n_waiting, lanes, boxes, ages, found, lives, _KICKS
        )
        parts.append((found[:n_found].copy(), lives[:n_found].copy()))
    return _OUTCOMES[done], *map(np.concatenate, zip(*parts, strict=True))


@kernel(error_model="numpy")
def _shears(x, y, k0, k1):
    """g_i = -p_i/t where v passes zero: the start moves with κ_i as the orbit that dies there.

    No proof depends on it.
    """
    v, w, t, z, p0, z0, p1, z1 = 1.0, abs(k0) / 2, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0
    for n in range(1000):
        k, first = (k0, 1.0) if n % 2 == 0 else (k1, 0.0)
        back, h, c = _trigonometry(x)
        w, z = w + k * c * v, z + k * c * t
        z0, z1 = z0 + k * c * p0 + first * h, z1 + k * c * p1 + (1 - first) * h
        v, t, p0, p1 = v + w, t + z, p0 + z0, p1 + z1
        if v <= 0:
            break
        y += k * h
        x = y - back
    if not abs(t) > 0.1:
        return 0.0, 0.0
    return -p0 / t, -p1 / t


_DONE, _UNFINISHED, _TOO_SMALL = 0, 1, 2
_OUTCOMES = Outcome.PROVED, Outcome.BUDGET, Outcome.PRECISION
_ELIMINATED, _FAILED = 0, 1


@kernel(error_model="numpy")
def _cover(x, waiting, n_waiting, lanes, boxes, ages, found, lives, most_kicks):
    """Go on with a cover, for some kicks: whether it is done, and counts.

    waiting[:n_waiting] : boxes to do, a stack, rows as in CellProof. lanes, boxes, ages : the
    state, the box (δ = 0 if there is none) and the kicks of each lane, in columns. found, lives :
    receive the boxes eliminated.
    """
    before, events = np.empty((_ROWS, FEW)), np.empty((2, FEW))
    n_found = kicks = 0
    while kicks < most_kicks and n_found <= found.shape[0] - FEW:
        busy = 0
        for lane in range(FEW):
            if boxes[1, lane] == 0 and n_waiting > 0:
                n_waiting -= 1
                boxes[:, lane], ages[lane] = waiting[n_waiting], 0
                _start(lanes, lane, x, boxes[:, lane])
            busy += boxes[1, lane] != 0
        if busy == 0:
            return _DONE, n_waiting, n_found
        before[:] = lanes
        _advance(lanes, events)
        for lane in range(FEW):
            if boxes[1, lane] == 0:
                continue
            if events[0, lane] > 0 and events[1, lane] <= 0:  # all went well; false for NaN
                ages[lane] += _BLOCK
                kicks += _BLOCK
                continue
            n, outcome, split = _replay(before, lane)
            kicks += n
            if outcome == _ELIMINATED:
                found[n_found], lives[n_found] = boxes[:, lane], ages[lane] + n
                n_found += 1
            elif not _halve(waiting, n_waiting, boxes[:, lane], split):
                return _TOO_SMALL, n_waiting, n_found
            else:
                n_waiting += 2
            boxes[1, lane] = 0
    return _UNFINISHED, n_waiting, n_found


@njit(nogil=True)
def _halve(waiting, n_waiting, box, split):
    """Put both halves of a box on the stack; False if they would be too small, or rounded.

    split : the parameter, 0 for the start, 1 and 2 for the strengths. The start of the middle moves
    with a strength as the shear says.
    """
    width = box[1 + 2 * split] / 2
    smallest = _SMALLEST_START if split == 0 else _SMALLEST_STRENGTH
    if width < smallest or n_waiting + 2 > waiting.shape[0]:
        return False
    for i, step in enumerate((width, -width)):
        half = waiting[n_waiting + i]
        half[:], half[1 + 2 * split] = box, width
        half[2 * split], error = two_sum(half[2 * split], step)
        if split > 0 and error == 0:
            half[0], error = two_sum(half[0], box[5 + split] * step)
        if error != 0:  # as with NaN
            return False
    return True


@njit(nogil=True)
def _start(lanes, lane, x, box):
    """The state of a box before the kick of its line."""
    state = lanes[:, lane]
    k0, h0, h1 = box[2], box[3], box[5]
    weight = 0.5 if x > 0 else -0.5  # -cos 2πa/2
    state[:] = 0.0
    state[0], state[1] = x, box[0]
    state[2] = state[4] = 1.0  # v, V
    state[3] = state[5] = weight * k0  # their last differences
    state[7], state[9], state[11] = box[1], box[6] * h0, box[7] * h1  # those of t, p, q
    # Site c counts half: half of what σ_0 adds there, h_0 cos 2πa, is taken off beforehand.
    state[27] = weight * h0
    state[_STATE], state[_STATE + 1 :] = 1 / box[1], box[2:6]


@njit(nogil=True, error_model="numpy")
def _advance(lanes, events):
    """A block of kicks of all lanes, in place; the smallest V into events[0], `bad` into [1]."""
    own_frame()
    rows = load_state(lanes, 0, _ROWS, FEW)
    state, (scale, k0, h0, k1, h1) = rows[:_STATE], rows[_STATE:]
    smallest, worst = state[4], scale - scale  # zeros
    for _ in range(_BLOCK):
        state, bad = _kick(k0, h0, k1, h1, scale, state)
        smallest, worst = minimum(smallest, state[4]), worst + bad
        k0, h0, k1, h1 = k1, h1, k0, h0
    store_state(lanes, state)
    store(events, 0, smallest)
    store(events, FEW, worst)


@njit(nogil=True, error_model="numpy")
def _replay(lanes, lane):
    """(kicks, outcome, parameter to halve) of the lane within a block: the definition."""
    state = load_state(lanes, lane, _STATE, 1)
    scale, k0, h0, k1, h1 = lanes[_STATE:, lane]
    for n in range(_BLOCK):
        state, bad = _kick(k0, h0, k1, h1, scale, state)
        if not bad <= 0 or state[4] <= 0:
            most, first, second = state[37], state[38], state[39]
            if n % 2 == 0:  # the parameters have changed places
                first, second = second, first
            split = 0 if most >= max(first, second) else 1 if first >= second else 2
            return n + 1, _FAILED if not bad <= 0 else _ELIMINATED, split
        k0, h0, k1, h1 = k1, h1, k0, h0
    return _BLOCK, _FAILED, 0


@njit(forceinline=True)
def _trigonometry(x):
    """rint X - X, h = sin 2πx/2π and cos 2πx of x = X + 1/4, on lanes or floats."""
    back = rint(x) - x
    u = 0.25 - fabs(back)
    u2 = u * u
    return back, horner(u2, SINE) * u, copysign(horner(u2, COSINE), back)


@njit(forceinline=True, error_model="numpy")
def _kick(k, spread, k_next, spread_next, scale, state):
    """One kick, of strength k ± spread, of a box, on lanes or floats; as in `transport`.

    p is moved by this kick, q by the next; in what is returned they have changed places, and with
    them tp and tq, pp and qq. zp, … are the last differences of p, …, lt, ltt, … the sums, mt, mp,
    mq the largest moves so far.
    """
    x, y, v, w, V, W, t, zt, p, zp, q, zq = state[:12]
    tt, ztt, tp, ztp, tq, ztq, pp, zpp, pq, zpq, qq, zqq = state[12:24]
    A, B, lt, lp, lq, ltt, ltp, ltq, lpp, lpq, lqq, rest, paid, mt, mp, mq = state[24:]
    size = fabs(k)
    back, h, c = _trigonometry(x)
    kc = k * c
    sc = spread * c
    bend = -TWO_PI2 * k * h  # κh''/2

    # |x - x̂|, and what of it is of second order, or known by its bound alone.
    at, ap, aq = fabs(t), fabs(p), fabs(q)
    straight = at + ap + aq
    unknown = (A * fabs(v) + B * at) * UP
    curved = (fabs(tt) + fabs(tp) + fabs(tq) + fabs(pp) + fabs(pq) + fabs(qq) + unknown) * UP
    E = (straight + curved) * UP
    E2 = E * E
    E3 = E2 * E
    both = curved * (E + straight) * UP  # |(x - x̂)² - (σt + σ_0p + σ_1q)²|
    sine = TWO_PI * (fabs(h) + ULP) * UP
    mt, mp, mq = maximum(mt, at), maximum(mp, ap), maximum(mq, aq)
    t2, p2, q2 = t * t, p * p, q * q
    tp2, tq2, pq2 = 2.0 * t * p, 2.0 * t * q, 2.0 * p * q

    # Payment: for what Q may be larger by than in the middle, and for rounding.
    V2 = V * V
    # What Q has of x - x̂, of its square, and of x - x̂ times this strength.
    slope, turn, twist = 2.0 * bend * V2, -TWO_PI2 * kc * V2, -2.0 * TWO_PI2 * spread * h * V2
    lt = lt + slope * t
    lp = lp + slope * p + sc * V2
    lq = lq + slope * q
    ltt = ltt + slope * tt + turn * t2
    ltp = ltp + slope * tp + turn * tp2 + twist * t
    ltq = ltq + slope * tq + turn * tq2
    lpp = lpp + slope * pp + turn * p2 + twist * p
    lpq = lpq + slope * pq + turn * pq2 + twist * q
    lqq = lqq + slope * qq + turn * q2
    known = fabs(lt) + fabs(lp) + fabs(lq)
    known = known + (fabs(ltt) + fabs(ltp) + fabs(ltq) + fabs(lpp) + fabs(lpq) + fabs(lqq))
    change = TWO_PI * sine * unknown + TWO_PI2 * fabs(c) * both + COS_CUBIC * E3
    of_strength = TWO_PI * sine * curved + TWO_PI2 * E2 + COS_CUBIC * E3 + 3e-14
    rounding = 3e-14 + 1e-12 * E
    rest = UP * (
        rest + V2 * (size * change + spread * of_strength + (1.0 + size) * rounding) + 1e-15 * known
    )
    due = maximum(0.0, UP * (known + rest) - paid)
    paid = (paid + due) * DOWN
    W = fma(kc, V, W) + due / V * UP
    V = V + W

    # One kick on.
    w = fma(kc, v, w)
    zt = fma(kc, t, zt)
    zp = fma(kc, p, zp) + spread * h
    zq = fma(kc, q, zq)
    ztt = fma(kc, tt, ztt) + bend * t2
    ztp = fma(kc, tp, ztp) + fma(sc, t, bend * tp2)
    ztq = fma(kc, tq, ztq) + bend * tq2
    zpp = fma(kc, pp, zpp) + fma(sc, p, bend * p2)
    zpq = fma(kc, pq, zpq) + fma(sc, q, bend * pq2)
    zqq = fma(kc, qq, zqq) + bend * q2
    v1, t1, p1, q1 = v + w, t + zt, p + zp, q + zq
    tt, tp, tq, pp, pq, qq = tt + ztt, tp + ztp, tq + ztq, pp + zpp, pq + zpq, qq + zqq
    # Defects: of the orbit, of its expansion, of the solutions, of the cosine.
    E1 = A * fabs(v1) + (1.0 + B) * fabs(t1) + fabs(p1) + fabs(q1)
    E1 = E1 + fabs(tt) + fabs(tp) + fabs(tq) + fabs(pp) + fabs(pq) + fabs(qq)
    expansion = PI * sine * both + CUBIC * fabs(c) * E3 + QUARTIC * E2 * E2
    of_strength = fabs(c) * curved + COS * E + PI * sine * E2 + CUBIC * E3 + QUARTIC * E2 * E2
    solutions = 3.1 * ULP * (E1 + E + spread + spread_next) + size * (COS + 4 * ULP) * (
        E + 41.0 * E2
    )
    orbit = (size + 1.5) * ULP + size * expansion + spread * of_strength
    defect = 1.002 * (orbit + solutions) * scale
    vt, tv = v * t1 * scale, t * v1 * scale
    wronskian = fabs(vt - tv - 1.0) + 4 * ULP * (fabs(vt) + fabs(tv))
    A = (A + defect * at) * UP
    B = (B + defect * fabs(v)) * UP
    bad = (
        maximum(0.0, E - _LARGEST)
        + maximum(0.0, curved - _KNOWN * E)
        + maximum(0.0, wronskian - _WRONSKIAN)
        + maximum(0.0, V - _HUGE)
    )
    y = fma(k, h, y)
    y = y - rint(y)
    x = y - back
    state = (
        *(x, y, v1, w, V, W, t1, zt, q1, zq, p1, zp),
        *(tt, ztt, tq, ztq, tp, ztp, qq, zqq, pq, zpq, pp, zpp),
        *(A, B, lt, lq, lp, ltt, ltq, ltp, lqq, lpq, lpp, rest, paid, mt, mq, mp),
    )
    return state, bad
