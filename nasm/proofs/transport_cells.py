"""A proof that transport is global for every forcing of a cell of the (κ1, κ2) plane.

The method is that of `nasm.proofs.transport`, to second order in three parameters: the initial
condition and the two strengths,

    y = ŷ + σδ + g_0 σ_0 h_0 + g_1 σ_1 h_1,   κ_i = k_i + σ_i h_i,   |σ|, |σ_0|, |σ_1| ≤ 1,
    x_n = x̂_n + σ t + σ_0 p + σ_1 q + σ² tt + σσ_0 tp + σσ_1 tq + σ_0² pp + σ_0σ_1 pq + σ_1² qq + ρ,
    |ρ_n| ≤ A_n|v_n| + B_n|t_n|.

The shear g shifts the initial conditions as κ varies, so that the rotation numbers of their orbits
hardly change and p and q grow more slowly. The interval 0 ≤ y ≤ 1/2 is cut into pieces, each with
its own shear. Boxes that extend Σ_i |g_i| h_i beyond the ends of a piece cover it for all κ of the
cell. A box that fails is bisected in the parameter that has moved its orbit most. See
`proofs/README.md`, "Cells".
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

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
from nasm.tables import html_table
from nasm.types import FloatArray, IntArray

__all__ = ["CellProof", "prove_cell"]

# The same values as in `transport`.
_MAX_DEVIATION, _MAX_UNKNOWN_SHARE, _MAX_WRONSKIAN_ERROR, _MAX_V = 0.1, 0.8, 1e-3, 1e100

_STRENGTH_GRID = 2.0**30  # inverse spacing of strengths, so that bisecting a cell is exact
_PIECES = 16  # number of pieces of [0, 1/2]
_END_GRID = 2.0**-20  # spacing of the ends of pieces
_SHEAR_GRID = 2.0**-8  # spacing of g
_MIN_DELTA, _MIN_STRENGTH_WIDTH = 2.0**-45, 2.0**-40
_KICKS_PER_BLOCK = 8  # kicks between checks for events
_STATE, _ROWS, _COLUMNS = 40, 45, 9  # numbers per lane that change; all per lane; per box
_MAX_WAITING = 4096  # maximum number of boxes on the stack
_KICKS_PER_CALL, _MAX_ELIMINATED = 200_000, 16_384  # per kernel call, between checks of the clock
DOWN = 1 - 1e-14  # the counterpart of `UP` for a sum that is subtracted


@dataclass(frozen=True, eq=False, repr=False)
class CellProof(Proof):
    """A proof that no circle exists under any forcing of a cell, or the reason why it failed.

    Attributes
    ----------
    outcome : Outcome
        PROVED, or the reason for the failure; a failed proof makes no statement about circles.
    kappa, half_width : tuple of 2 floats
        The cell, |κ_i - kappa_i| ≤ half_width_i.
    site : int
        Index of the kick at the symmetry line.
    a : float
        x of the symmetry line before that kick.
    boxes : ndarray, shape (n, 9)
        Rows ŷ, δ, k_0, h_0, k_1, h_1, g_0, g_1, and the index of the piece of 0 ≤ y ≤ 1/2. The
        subscript 0 stands for the kick at `site`.
    lifetimes : ndarray of int, shape (n,)
        Number N of kicks until V ≤ 0, for each box.

    Examples
    --------
    >>> from nasm.proofs.transport_cells import prove_cell
    >>> prove_cell((0.75, 0.25), 2.0**-6)
    <CellProof: PROVED, transport is global within (0.015625, 0.015625) of (0.75, 0.25); ... boxes>
    """

    kappa: tuple[float, float]
    half_width: tuple[float, float]
    site: int
    a: float
    boxes: FloatArray
    lifetimes: IntArray

    def __repr__(self) -> str:
        claim = "transport is global" if self.proved else "transport is not proved to be global"
        return (
            f"<CellProof: {self.outcome.name}, {claim} within {self.half_width} of {self.kappa}; "
            f"{len(self.boxes)} boxes>"
        )

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        rows = {
            "centre of the cell": f"{self.kappa}",
            "half width": f"{self.half_width}",
            "outcome": f"{self.outcome.name}: {self.reason}",
            "boxes": f"{len(self.boxes)}, with {self.lifetimes.sum()} kicks in all",
        }
        return html_table(rows, "Proof that transport is global in a cell")

    def certificate(self) -> dict[str, Any]:
        """Return what another program needs to check the proof, as a JSON-serializable dict.

        Raises
        ------
        ValueError
            If nothing was proved.
        """
        fields = {
            "kappa": in_hex(self.kappa),
            "half_width": in_hex(self.half_width),
            "site": self.site,
            "a": self.a,
            "boxes": columns_in_hex(self.boxes),
            "lives": self.lifetimes.tolist(),
        }
        cell = self.kappa, self.half_width
        return certificate(self, "Transport is global in a cell", fields, *cell)


def prove_cell(kappa: ArrayLike, half_width: ArrayLike, budget: float = 1.0) -> CellProof:
    """Try to prove that no forcing of a cell has a rotational invariant circle.

    Parameters
    ----------
    kappa : array_like, shape (2,)
        Centre of the cell, a multiple of 2⁻³⁰.
    half_width : float or array_like, shape (2,)
        The cell is |κ_i - kappa_i| ≤ half_width_i. Half widths are positive multiples of 2⁻³⁰, so
        that the corners of the cell are exact. For cells in which some |κ_i| ≥ 2, the outcome is
        SCOPE.
    budget : float
        CPU seconds.

    Returns
    -------
    CellProof
        A proof that fails makes no statement about circles.

    Raises
    ------
    ValueError
        If an argument is out of range or not a multiple of 2⁻³⁰.
    RuntimeError
        If the arithmetic of this machine is not the IEEE 754 arithmetic that the proof requires.

    Examples
    --------
    >>> from nasm.proofs.transport_cells import prove_cell
    >>> prove_cell((0.75, 0.25), 2.0**-6).proved
    True
    """
    kappa = forcing(kappa)
    half_width = forcing(np.broadcast_to(floats("half_width", half_width), 2))
    budget = positive("budget", budget, "seconds of computing time")
    if kappa.size != 2:
        raise ValueError(f"kappa={kappa.tolist()}: the centre of a cell has two strengths")
    if not (half_width > 0).all():
        raise ValueError(f"half_width={half_width.tolist()} must be positive")
    numbers = _STRENGTH_GRID * np.concatenate([kappa, half_width])
    if (numbers != np.rint(numbers)).any():
        raise ValueError(
            f"kappa={kappa.tolist()} and half_width={half_width.tolist()} must be multiples of "
            "2**-30, so that the corners of the cell are exact"
        )
    check_arithmetic()
    centre, widths = tuple(kappa.tolist()), tuple(half_width.tolist())
    if (np.abs(kappa) + half_width >= 2).any():
        boxes, lifetimes = np.empty((0, _COLUMNS)), np.empty(0, np.int64)
        return CellProof(Outcome.SCOPE, centre, widths, 0, 0.0, boxes, lifetimes)
    centre_site, a = dominant_centre(kappa)
    site = int(centre_site)
    from_line = np.roll(kappa, -site).tolist(), np.roll(half_width, -site).tolist()
    outcome, boxes, lifetimes = _covered(*from_line, a, budget)
    return CellProof(outcome, centre, widths, site, a, boxes, lifetimes)


def _covered(
    kappa: Sequence[float], half_width: Sequence[float], a: float, budget: float
) -> tuple[Outcome, FloatArray, IntArray]:
    """Cover a cell with boxes; return the outcome, the boxes and their lifetimes.

    kappa, half_width : the cell, beginning with the kick at the symmetry line.
    """
    (k0, k1), (h0, h1), x = kappa, half_width, a - 0.25
    waiting, n_waiting = np.empty((_MAX_WAITING, _COLUMNS)), _PIECES
    for piece in range(_PIECES):
        left, right = piece / (2 * _PIECES), (piece + 1) / (2 * _PIECES)
        shears = np.array(_shears(x, (left + right) / 2, k0, k1))
        g0, g1 = (np.rint(np.clip(shears, -0.5, 0.5) / _SHEAR_GRID) * _SHEAR_GRID).tolist()
        margin = abs(g0) * h0 + abs(g1) * h1
        left = float(np.floor((left - margin) / _END_GRID)) * _END_GRID
        right = float(np.ceil((right + margin) / _END_GRID)) * _END_GRID
        middle, half = (left + right) / 2, (right - left) / 2
        waiting[piece] = middle, half, k0, h0, k1, h1, g0, g1, piece
    lanes, boxes, ages = np.zeros((_ROWS, FEW)), np.zeros((_COLUMNS, FEW)), np.zeros(FEW, np.int64)
    eliminated = np.empty((_MAX_ELIMINATED, _COLUMNS))
    lifetimes = np.empty(_MAX_ELIMINATED, np.int64)
    parts, end, done = [(eliminated[:0], lifetimes[:0])], time.thread_time() + budget, _UNFINISHED
    while done == _UNFINISHED and time.thread_time() < end:
        done, n_waiting, n_eliminated = _cover(
            x, waiting, n_waiting, lanes, boxes, ages, eliminated, lifetimes, _KICKS_PER_CALL
        )
        parts.append((eliminated[:n_eliminated].copy(), lifetimes[:n_eliminated].copy()))
    all_boxes, all_lifetimes = map(np.concatenate, zip(*parts, strict=True))
    return _OUTCOMES[done], all_boxes, all_lifetimes


@kernel(error_model="numpy")
def _shears(x, y, k0, k1):
    """Choose g_i = -p_i/t where v crosses zero, so that the orbit hardly depends on κ_i there.

    Proofs are valid for any choice of g_i.
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
def _cover(x, waiting, n_waiting, lanes, boxes, ages, eliminated, lifetimes, most_kicks):
    """Continue covering a cell for a limited number of kicks.

    Return the outcome, n_waiting and n_eliminated.

    waiting[:n_waiting] : the boxes still to be followed, a stack of rows as in CellProof. lanes,
    boxes, ages : for each lane, in columns, its state, its box (δ = 0 if it is idle) and its kicks
    so far. eliminated, lifetimes : receive the eliminated boxes and their lifetimes.
    """
    before, events = np.empty((_ROWS, FEW)), np.empty((2, FEW))
    n_eliminated = kicks = 0
    while kicks < most_kicks and n_eliminated <= eliminated.shape[0] - FEW:
        busy = 0
        for lane in range(FEW):
            if boxes[1, lane] == 0 and n_waiting > 0:
                n_waiting -= 1
                boxes[:, lane], ages[lane] = waiting[n_waiting], 0
                _start(lanes, lane, x, boxes[:, lane])
            busy += boxes[1, lane] != 0
        if busy == 0:
            return _DONE, n_waiting, n_eliminated
        before[:] = lanes
        _advance(lanes, events)
        for lane in range(FEW):
            if boxes[1, lane] == 0:
                continue
            if events[0, lane] > 0 and events[1, lane] <= 0:  # no event; false for NaN
                ages[lane] += _KICKS_PER_BLOCK
                kicks += _KICKS_PER_BLOCK
                continue
            n, outcome, split = _replay(before, lane)
            kicks += n
            if outcome == _ELIMINATED:
                eliminated[n_eliminated], lifetimes[n_eliminated] = boxes[:, lane], ages[lane] + n
                n_eliminated += 1
            elif not _bisect(waiting, n_waiting, boxes[:, lane], split):
                return _TOO_SMALL, n_waiting, n_eliminated
            else:
                n_waiting += 2
            boxes[1, lane] = 0
    return _UNFINISHED, n_waiting, n_eliminated


@njit(nogil=True)
def _bisect(waiting, n_waiting, box, split):
    """Put both halves of a box on the stack; return True on success.

    The halves must be exact and not too small, and the stack must have room for them.

    split : the parameter to bisect, 0 for the initial condition, 1 or 2 for a strength. Because of
    the shear, bisecting a strength also shifts the centre ŷ.
    """
    width = box[1 + 2 * split] / 2
    smallest = _MIN_DELTA if split == 0 else _MIN_STRENGTH_WIDTH
    if width < smallest or n_waiting + 2 > waiting.shape[0]:
        return False
    for i, step in enumerate((width, -width)):
        half = waiting[n_waiting + i]
        half[:], half[1 + 2 * split] = box, width
        half[2 * split], error = two_sum(half[2 * split], step)
        if split > 0 and error == 0:
            half[0], error = two_sum(half[0], box[5 + split] * step)
        if error != 0:  # true for NaN, too
            return False
    return True


@njit(nogil=True)
def _start(lanes, lane, x, box):
    """Set the state of a box before the kick at the symmetry line."""
    state = lanes[:, lane]
    k0, h0, h1 = box[2], box[3], box[5]
    weight = 0.5 if x > 0 else -0.5  # -cos 2πa/2
    state[:] = 0.0
    state[0], state[1] = x, box[0]
    state[2] = state[4] = 1.0  # v, V
    state[3] = state[5] = weight * k0  # their last differences
    state[7], state[9], state[11] = box[1], box[6] * h0, box[7] * h1  # those of t, p, q
    # Site c counts half: half of the term of σ_0 there, h_0 cos 2πa, is subtracted beforehand.
    state[27] = weight * h0
    state[_STATE], state[_STATE + 1 :] = 1 / box[1], box[2:6]


@njit(nogil=True, error_model="numpy")
def _advance(lanes, events):
    """Advance all lanes by a block of kicks, in place; set events to the smallest V and Σ bad."""
    own_frame()
    rows = load_state(lanes, 0, _ROWS, FEW)
    state, (scale, k0, h0, k1, h1) = rows[:_STATE], rows[_STATE:]
    smallest, worst = state[4], scale - scale  # zeros
    for _ in range(_KICKS_PER_BLOCK):
        state, bad = _kick(k0, h0, k1, h1, scale, state)
        smallest, worst = minimum(smallest, state[4]), worst + bad
        k0, h0, k1, h1 = k1, h1, k0, h0
    store_state(lanes, state)
    store(events, 0, smallest)
    store(events, FEW, worst)


@njit(nogil=True, error_model="numpy")
def _replay(lanes, lane):
    """Repeat the block of one lane; return the kicks up to the event, the outcome and `split`."""
    state = load_state(lanes, lane, _STATE, 1)
    scale, k0, h0, k1, h1 = lanes[_STATE:, lane]
    for n in range(_KICKS_PER_BLOCK):
        state, bad = _kick(k0, h0, k1, h1, scale, state)
        if not bad <= 0 or state[4] <= 0:
            most, first, second = state[37], state[38], state[39]
            if n % 2 == 0:  # the two strengths have changed places
                first, second = second, first
            split = 0 if most >= max(first, second) else 1 if first >= second else 2
            return n + 1, _FAILED if not bad <= 0 else _ELIMINATED, split
        k0, h0, k1, h1 = k1, h1, k0, h0
    return _KICKS_PER_BLOCK, _FAILED, 0


@njit(forceinline=True)
def _trigonometry(x):
    """Return rint x - x, h = sin 2πX/2π and cos 2πX, where X = x + 1/4, for lanes or floats."""
    back = rint(x) - x
    u = 0.25 - fabs(back)
    u2 = u * u
    return back, horner(u2, SINE) * u, copysign(horner(u2, COSINE), back)


@njit(forceinline=True, error_model="numpy")
def _kick(k, spread, k_next, spread_next, scale, state):
    """Kick a box with strength k ± spread, on lanes or floats; the method is that of `transport`.

    p is the response to this strength, and q is the response to the strength of the next kick. In
    the returned state p and q are exchanged, and so are tp and tq, and pp and qq. zp, … are the
    last differences of p, …; lt, ltt, … are the sums in Q; mt, mp, mq are the largest |t|, |p|, |q|
    so far.
    """
    x, y, v, w, V, W, t, zt, p, zp, q, zq = state[:12]
    tt, ztt, tp, ztp, tq, ztq, pp, zpp, pq, zpq, qq, zqq = state[12:24]
    A, B, lt, lp, lq, ltt, ltp, ltq, lpp, lpq, lqq, rest, paid, mt, mp, mq = state[24:]
    size = fabs(k)
    back, h, c = _trigonometry(x)
    kc = k * c
    sc = spread * c
    bend = -TWO_PI2 * k * h  # κh''/2

    # Bounds on |x - x̂|: its first order, the unknown rest, all beyond first order, and the total.
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

    # The payment covers rounding, and the amount by which Q may exceed its value at the centre.
    V2 = V * V
    # Coefficients in Q of x - x̂, of its square, and of x - x̂ times the change of this strength.
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

    # The solutions after the kick.
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
    # Defects of the orbit, of its expansion, of the solutions, and of the cosine.
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
        maximum(0.0, E - _MAX_DEVIATION)
        + maximum(0.0, curved - _MAX_UNKNOWN_SHARE * E)
        + maximum(0.0, wronskian - _MAX_WRONSKIAN_ERROR)
        + maximum(0.0, V - _MAX_V)
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
