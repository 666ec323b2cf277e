"""A computer-assisted proof that transport is global: no rotational invariant circle exists.

Every rotational circle crosses any curve that runs from y = -∞ to y = ∞. For one or two kicks,
the curve is the symmetry line x_c = a before kick c; for more kicks it is a polygon through minimax
orbits (see `nasm.converse_kam.transversal`). Along an orbit on a circle the second variation of the
action is positive. So if for every initial condition on the curve, up to symmetries, some η of
finite support satisfies

    Q = Σ_k η_k ((2 + κ_k cos 2πx_k) η_k - η_{k+1} - η_{k-1}) ≤ 0,   η ≠ 0,

then no circle exists, and there are orbits from any y to any other. `proofs/README.md`,
"Transport is global", states the theorem, and shows why the computation below proves its
hypothesis despite rounding.

A parameter s runs along the curve. Boxes |s - ŝ| ≤ δ cover the curve, and their orbits are

    x_n(σ) = x̂_n + σ t_n + σ² q_n + ρ_n,   |ρ_n| ≤ A_n|v_n| + B_n|t_n|,   s = ŝ + σδ,   |σ| ≤ 1.

All orbits of a box share one η, called V. It is the solution v of the linearised chain, increased
at each kick by a *payment*, which covers the amount by which Q may exceed its value in the middle
of the box. V_N ≤ 0 shows that Q ≤ 0 on the whole box; N is called the lifetime of the box. A box
that fails is bisected. On a symmetry line the sites n ≥ c are enough. On a polygon the sites before
c are followed too, under the kicks in reverse order, so each box has two lifetimes.

Sixteen boxes run in lockstep on `nasm.arithmetic.lanes`. After an event in one of them (V ≤ 0 or a
violated bound), its block of kicks is repeated on floats, by the same function. The proof relies on
IEEE arithmetic with rounding to nearest, gradual underflow and a fused fma, which
`check_arithmetic` tests at run time.
"""

import math
import time
from dataclasses import dataclass, replace
from enum import Enum
from fractions import Fraction
from functools import cache
from math import factorial
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

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
from nasm.maps import MAX_PERIOD, MAX_STRENGTH, MIN_SIZE, direction, forcing
from nasm.numbers import rational
from nasm.proofs.certificates import certificate, columns_in_hex, in_hex
from nasm.results import Result
from nasm.symmetries import shorten
from nasm.tables import html_table
from nasm.types import FloatArray, IntArray

__all__ = ["Outcome", "TransportProof", "prove", "proved_upper"]

# Taylor coefficients of sin 2πu / 2πu in u²: four as sums of two floats, eight as floats.
_SERIES = [(-1) ** k * (2 * EXACT_PI) ** (2 * k) / factorial(2 * k + 1) for k in range(12)]
_S0, _S1, _S2, _S3 = map(pair, _SERIES[:4])
_S4 = tuple(map(float, _SERIES[4:]))

ULP = 2.0**-53  # relative rounding error; also a bound on the error of h = sin 2πx/2π
ORBIT = 2.0**-66  # bounds the error of h as a sum of two floats, and the rounding of x and y
COS = 2.1e-14  # bounds the error of cos 2πx; the tests prove both bounds in ball arithmetic
UP = 1 + 1e-14  # covers 90 roundings of sums and products of positive numbers
PAYMENT_FACTOR = 1.0001  # covers `_MAX_LIFETIME` roundings of a sum of positive numbers
PI, TWO_PI, TWO_PI2 = 3.141592653589793, 6.283185307179586, 19.739208802178716
CUBIC, QUARTIC = 6.58, 10.34  # (2π)²/6 and (2π)³/24, rounded up: for the remainders of h
COS_CUBIC = 41.35  # (2π)³/6, rounded up: for the remainder of cos

_MAX_DEVIATION = 0.1  # largest |x - x̂| for which the bounds hold
_MAX_UNKNOWN_SHARE = 0.8  # largest fraction of |x - x̂| beyond first order; above it, bisect
_MAX_WRONSKIAN_ERROR = 1e-3  # relative error of v_n t_{n+1} - v_{n+1} t_n = δ
_MAX_V = 1e100  # beyond it, products may overflow
_MAX_LIFETIME = 1e11  # upper bound on the kicks of a box in a proof; that many would take hours

_MIN_TOTAL_STRENGTH = 0.1  # minimum P Σ|κ_j|; for one nonzero kick, the last circle breaks at 0.97
_FIRST_BOXES = 16  # number of boxes on each piece before any bisection
_MIN_DELTA = 2.0**-50  # smallest δ for which centres are exact, for s up to 8
_KICKS_PER_BLOCK = 8  # between checks for events; rounded up to whole periods
_STATE, _ROWS, _V = 18, 19, 6  # numbers per box that change, all numbers per box, and index of V
_FIRST_EXCESS = 0.1  # `proved_upper` begins at a scale this fraction above `value`
_KICKS_PER_CALL = 2_000_000  # kicks per kernel call, between checks of the clock
_MIN_CROWD = 128  # a piece of the polygon may be bent if more boxes than this wait on it
_MAX_STEPS = 2**14  # periods within which a polygon's starts must be eliminated in floats
_CORNER_GRID = 2.0**26  # inverse spacing of corners, so that their sums are exact in two floats


class Outcome(Enum):
    """Outcome of an attempt to prove that transport is global; each text states the reason.

    Examples
    --------
    >>> from nasm.proofs.transport import Outcome
    >>> print(Outcome.BUDGET.value)
    not proved: the budget is spent; allow more CPU seconds
    """

    PROVED = (
        "no rotational invariant circle exists: transport is global, by a theorem in "
        "nasm/proofs/README.md"
    )
    BUDGET = "not proved: the budget is spent; allow more CPU seconds"
    PRECISION = "not proved: boxes became too small or too many; a circle may exist"
    SCOPE = (
        "not proved: the shortened forcing must have one kick, or two kicks with one weaker than "
        f"2, or at most {MAX_PERIOD} kicks that are weak enough for a twist map"
    )
    WEAK = "not proved, and not attempted: the kicks are so weak that a circle certainly exists"

    __repr__ = Enum.__str__  # Outcome.PROVED, without its text


@dataclass(frozen=True, eq=False)
class Proof(Result):
    """A proof that transport is global, or the reason why no proof was found.

    A failed proof says nothing about circles.
    """

    outcome: Outcome

    @property
    def proved(self) -> bool:
        """True if transport is proved to be global."""
        return self.outcome is Outcome.PROVED

    @property
    def reason(self) -> str:
        """The text of the outcome."""
        return self.outcome.value


@dataclass(frozen=True, eq=False, repr=False)
class TransportProof(Proof):
    """A proof that no rotational invariant circle exists, or the reason why no proof was found.

    Attributes
    ----------
    outcome : Outcome
        PROVED, or the reason for the failure; a failed proof says nothing about circles.
    original_kappa : tuple of float
        Forcing passed to `prove`. The proof holds for exactly these floats.
    kappa : tuple of float
        The same forcing, shortened; the boxes refer to it.
    site : int
        Index of the kick at the curve.
    points : ndarray, shape (m, 2)
        Corners of the curve, x and y before that kick. Each end is its own image under
        (x, y) → (-x, -y), up to whole turns.
    boxes : ndarray, shape (n, 2)
        Rows ŝ, δ: no circle passes through initial conditions with |s - ŝ| ≤ δ; s is 0 at the first
        corner, 1/2 at the second, and so on. The boxes of a proof tile the curve, in order.
    lifetimes : ndarray of int, shape (n, 1) or (n, 2)
        Kicks N until V ≤ 0, for each box; if P > 2 after shortening, forwards and backwards.
    slopes : ndarray, shape (n,)
        γ of each box, defined in proofs/README.md.

    Examples
    --------
    >>> from nasm.proofs.transport import prove
    >>> prove((1.2, 0.3))
    <TransportProof: PROVED, transport is global under (1.2, 0.3); ... boxes, ... kicks>
    """

    original_kappa: tuple[float, ...]
    kappa: tuple[float, ...]
    site: int
    points: FloatArray
    boxes: FloatArray
    lifetimes: IntArray
    slopes: FloatArray

    def __repr__(self) -> str:
        effort = f"{len(self.boxes)} boxes, {self.lifetimes.sum()} kicks"
        claim = "transport is global" if self.proved else "transport is not proved to be global"
        return (
            f"<TransportProof: {self.outcome.name}, {claim} under {self.original_kappa}; {effort}>"
        )

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        rows = {
            "forcing": f"{self.original_kappa}",
            "outcome": f"{self.outcome.name}: {self.reason}",
            "boxes": f"{len(self.boxes)}, with {self.lifetimes.sum()} kicks in all",
        }
        return html_table(rows, "Proof that transport is global")

    def certificate(self) -> dict[str, Any]:
        """Return what another program needs to check the proof, as a JSON-serializable dict.

        Raises
        ------
        ValueError
            If nothing was proved.

        Examples
        --------
        >>> from nasm.proofs import certificate_checker, transport
        >>> certificate_checker.check(transport.prove((1.2, 0.3)).certificate())
        'transport is global under the forcing (1.2, 0.3)'
        """
        fields: dict[str, Any] = {
            "shortened_from": {"kappa": in_hex(self.original_kappa)},
            "kappa": in_hex(self.kappa),
            "site": self.site,
        }
        if len(self.kappa) > 2:
            rows, lifetimes = np.column_stack([self.boxes, self.slopes]), self.lifetimes
            theorem = "Transport is global under several kicks"
            fields["points"] = [in_hex(point) for point in self.points.tolist()]
        else:
            rows, lifetimes, theorem = self.boxes, self.lifetimes[:, 0], "Transport is global"
            fields["a"] = self.a
        fields |= {"boxes": columns_in_hex(rows), "lives": lifetimes.tolist()}
        return certificate(self, theorem, fields, self.original_kappa)

    @property
    def a(self) -> float:
        """x of the first corner of the curve; on a symmetry line all points have this x."""
        return float(self.points[0, 0])


def prove(kappa: ArrayLike, budget: float = 10.0) -> TransportProof:
    """Try to prove that no rotational invariant circle exists under the forcing kappa.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first. After shortening, the map must be a twist map:
        P = 1, or P = 2 with min |κ_i| < 2, or 2 < P ≤ 64 and the matrix of `is_twist` positive
        definite; otherwise the outcome is SCOPE. For P Σ|κ_j| < 0.1 it is WEAK.
    budget : float
        CPU seconds. At a relative distance of 10⁻³ beyond the breakup, a proof takes about 10⁻² s
        for two kicks and up to 0.5 s for three or four; at a distance three times smaller, ten
        times as long. For P > 2 the budget includes the search for the polygon, whose last stage
        may exceed it by a second.

    Returns
    -------
    TransportProof
        A proof that fails says nothing about circles.

    Raises
    ------
    ValueError
        If kappa is too large or not finite, or budget is not positive.
    RuntimeError
        If the arithmetic of this machine is not the IEEE 754 arithmetic that the proof requires.

    References
    ----------
    R. S. MacKay and I. C. Percival, Commun. Math. Phys. 98 (1985) 469: converse KAM, made rigorous
    on a computer. `nasm/proofs/README.md` states the theorem for several kicks.

    Examples
    --------
    >>> from nasm.proofs.transport import prove
    >>> prove((0.98,)).proved  # by Greene's residues the last circle breaks at 0.971635
    True
    >>> prove((0.9,), budget=0.1).proved
    False
    """
    kappa = forcing(kappa)
    (short,), _ = shorten([kappa], rational(0))
    budget = positive("budget", budget, "seconds of computing time")
    check_arithmetic()
    nothing = np.empty((0, 2))
    _followed(np.zeros(1), 0, nothing, nothing, np.empty(0), math.inf)  # compile the kernels first
    original_kappa, strengths = tuple(kappa.tolist()), tuple(short.tolist())
    if short.size * np.abs(short).sum() < _MIN_TOTAL_STRENGTH:
        return _unproved(Outcome.WEAK, original_kappa, strengths)
    if short.size > MAX_PERIOD or not is_twist(strengths):
        return _unproved(Outcome.SCOPE, original_kappa, strengths)
    return replace(curve_at(short, budget), original_kappa=original_kappa)


def _unproved(
    outcome: Outcome, original_kappa: tuple[float, ...], kappa: tuple[float, ...]
) -> TransportProof:
    """Return the TransportProof for an attempt that ended before there were boxes."""
    nothing = np.empty((0, 2))
    lifetimes = np.empty((0, 2), int)
    return TransportProof(
        outcome, original_kappa, kappa, 0, nothing, nothing, lifetimes, np.empty(0)
    )


def _on_polygon(kappa: FloatArray, budget: float) -> TransportProof:
    """Try to prove that transport is global under three or more kicks.

    A piece of the polygon is bent if the boxes waiting on it outnumber the kicks in which converse
    KAM in plain floats eliminates all starts. If bending does not help, another polygon is tried;
    the last one gets the remaining time.
    """
    _compile_search()
    strengths = tuple(kappa.tolist())
    polygon, end = None, time.thread_time() + budget
    for curve, kicks in transversal.eliminated_transversals(kappa, _MAX_STEPS, end):
        longest, bent = transversal.longest_period(kicks / kappa.size), True
        while bent:
            points, pieces = _closed(curve.corners)
            polygon = strengths, strengths, curve.site, points
            remaining = end - time.thread_time()
            proof, crowded = _covered(*polygon, remaining, max(kicks, _MIN_CROWD))
            if crowded is None:
                return proof
            piece = pieces[crowded]
            bent = 0 <= piece < len(curve.orbits) - 1 and curve.bend(piece, longest)
    if polygon is None:
        late = time.thread_time() > end
        return _unproved(Outcome.BUDGET if late else Outcome.PRECISION, strengths, strengths)
    proof, _ = _covered(*polygon, end - time.thread_time())
    return proof


def curve_at(kappa: FloatArray, budget: float) -> TransportProof:
    """Try to prove, on a curve chosen for kappa, that transport is global; kappa is not shortened.

    The proof for a cell of forcings uses the curve chosen for the forcing at its centre.
    """
    if kappa.size > 2:
        return _on_polygon(kappa, budget)
    strengths = tuple(kappa.tolist())
    site = int(np.argmax(np.abs(kappa)))
    a = 0.5 if kappa[site] > 0 else 0.0
    line = np.array([[a, 0.0], [a, 0.5]])
    return _covered(strengths, strengths, site, line, budget)[0]


@cache
def _compile_search() -> None:
    """Compile the kernels of the search, so that compilation does not count against the budget."""
    next(transversal.eliminated_transversals((1.9, 1.8, 1.7), 256), None)


def _closed(corners: FloatArray) -> tuple[FloatArray, list[int]]:
    """Round the corners to a grid, and add ends that are their own images.

    Also return the index of each piece among the pieces of `corners`; the two pieces added at the
    ends have indices out of range.
    """
    points = np.rint(corners * _CORNER_GRID) / _CORNER_GRID
    first, last = np.rint(2 * points[[0, -1]]) / 2
    points = np.concatenate([[first], points, [last]])
    kept = np.append(True, (np.diff(points, axis=0) != 0).any(axis=1))
    return points[kept], (np.flatnonzero(kept)[1:] - 2).tolist()


def is_twist(kappa: tuple[float | Fraction, ...]) -> bool:
    """Return True if, for some m, the kicks other than κ_m make x_{m+P} grow with x_{m+1}.

    They do if the matrix with 2 - |κ_j|, j = m + 1 … m + P - 1, on the diagonal and -1 next to the
    diagonal is positive definite, that is, if all its leading minors are positive. The arithmetic
    is exact.
    """
    entries = [2 - abs(Fraction(k)) for k in kappa]
    return any(_is_positive(entries[m + 1 :] + entries[:m]) for m in range(len(kappa)))


def _is_positive(diagonal: list[Fraction]) -> bool:
    minor, last = Fraction(1), Fraction(0)
    for entry in diagonal:
        minor, last = entry * minor - last, minor
        if minor <= 0:
            return False
    return True


def proved_upper(profile: ArrayLike, value: float, budget: float) -> tuple[float, TransportProof]:
    """Search for the smallest scale s at which transport is proved to be global under s·profile.

    Parameters
    ----------
    profile : array_like, shape (P,)
        Direction of the ray; it must meet the requirements for kappa in `prove`.
    value : float
        Scale at which the last circle breaks, e.g. from `barriers.critical_scale`; 1e-300 to 1e306.
        The proof does not depend on this value; a bad one only costs time.
    budget : float
        Total CPU seconds.

    Returns
    -------
    scale : float
        Scale of the best proof; NaN if nothing was proved.
    proof : TransportProof
        Proof at scale·profile, or the last failed attempt.

    Raises
    ------
    ValueError, RuntimeError
        As for `prove`, or if value is out of range.

    Examples
    --------
    >>> from nasm.proofs.transport import proved_upper
    >>> scale, proof = proved_upper((1.0,), 0.971635, budget=0.5)
    >>> proof.proved, scale > 0.971635
    (True, True)
    """
    profile = direction(profile)
    value = real("value", value, MIN_SIZE, MAX_STRENGTH / MIN_SIZE)
    end = time.thread_time() + positive("budget", budget, "seconds of computing time")
    best: TransportProof | None = None
    scale, reached, failed, affordable = math.nan, math.inf, 0.0, 0.0
    excess = _FIRST_EXCESS
    while excess < 0.9 * reached and (left := end - time.thread_time()) > 0:
        proof = prove(value * (1 + excess) * profile, left if best else left / 4)
        after = end - time.thread_time()
        if proof.proved:
            best, scale, reached = proof, value * (1 + excess), excess
            # The work grows like the square of 1/excess, or a little more slowly.
            affordable = excess * math.sqrt(1.5 * (left - after) / max(after, 1e-9))
        elif best is None and excess < 4:
            excess *= 2
            continue
        else:
            failed = excess
        excess = max(reached / 3, math.sqrt(reached * failed), affordable)
    return scale, best or proof


def _covered(
    original_kappa: tuple[float, ...],
    kappa: tuple[float, ...],
    site: int,
    points: FloatArray,
    budget: float,
    max_waiting: float = math.inf,
) -> tuple[TransportProof, int | None]:
    """Try to prove on one curve that transport is global; bisect failed boxes, level by level.

    If more than `max_waiting` boxes wait on one piece, stop and also return the piece's index.
    """
    forwards = np.tile(np.roll(kappa, -site), -(-_KICKS_PER_BLOCK // len(kappa)))
    ways = [forwards, forwards[::-1].copy()] if len(kappa) > 2 else [forwards]
    boxes = np.full((_FIRST_BOXES * (len(points) - 1), 2), 0.25 / _FIRST_BOXES)
    boxes[:, 0] *= 2 * np.arange(len(boxes)) + 1
    end = time.thread_time() + budget
    outcome, found, crowded = Outcome.PROVED, [], None
    while len(boxes):
        if len(ways) > 1:
            slopes = _slopes(np.roll(kappa, -site), points, boxes[:, 0])
        else:
            slopes = np.full(len(boxes), abs(forwards[0]) / 2)
        lifetimes = np.zeros((len(boxes), len(ways)), np.int64)
        for way, cycle in enumerate(ways):
            rest = lifetimes[:, :way].all(axis=1)
            lifetimes[rest, way] = _followed(cycle, way, points, boxes[rest], slopes[rest], end)
        done = lifetimes.all(axis=1)
        found.append((boxes[done], lifetimes[done], slopes[done]))
        middles, half = np.transpose(boxes[~done]) * [[1], [0.5]]
        boxes = np.transpose([[middles - half, middles + half], [half, half]]).reshape(-1, 2)
        waiting = np.bincount((2 * boxes[:, 0]).astype(int), minlength=1)
        if waiting.max() > max_waiting:
            crowded = int(waiting.argmax())
        if len(boxes) and (crowded is not None or time.thread_time() > end):
            outcome = Outcome.BUDGET
            break
        if len(boxes) and half.min() < _MIN_DELTA * max(1.0, (len(points) - 1) / 16):
            outcome = Outcome.PRECISION
            break
    boxes, lifetimes, slopes = map(np.concatenate, zip(*found, strict=True))
    order = np.argsort(boxes[:, 0])
    boxes, lifetimes, slopes = boxes[order], lifetimes[order], slopes[order]
    end = len(points) / 2 - 0.5
    if outcome is Outcome.PROVED and not (_tiles(boxes, end) and lifetimes.max() < _MAX_LIFETIME):
        raise RuntimeError(
            "the boxes of a proof do not tile its curve, or one has a lifetime of "
            f"{_MAX_LIFETIME:g} kicks; please report this"
        )
    return TransportProof(
        outcome, original_kappa, kappa, site, points, boxes, lifetimes, slopes
    ), crowded


def _slopes(kappa: FloatArray, points: FloatArray, starts: FloatArray) -> FloatArray:
    """Choose each box's γ so that V, in floats, becomes ≤ 0 in both directions, if possible."""
    x, y = (np.interp(2 * starts, np.arange(len(points)), axis) for axis in points.T)
    _, slopes = transversal.elimination(kappa, x, y, _MAX_STEPS * len(kappa))
    return np.clip(np.rint(slopes * 2.0**20) / 2.0**20, -3, 1 - 2.0**-20)


def _followed(
    cycle: FloatArray,
    way: int,
    points: FloatArray,
    boxes: FloatArray,
    slopes: FloatArray,
    end: float,
) -> IntArray:
    """Return the lifetimes of boxes; 0 for boxes that fail, or that remain when time is up."""
    lifetimes, first, unfinished = np.zeros(len(boxes), np.int64), 0, True
    lanes, ages, box_ids = np.zeros((_ROWS, FEW)), np.zeros(FEW, np.int64), np.full(FEW, -1)
    while unfinished and time.thread_time() < end:
        first, unfinished = _follow(
            cycle,
            way,
            points,
            boxes,
            slopes,
            lifetimes,
            lanes,
            ages,
            box_ids,
            first,
            _KICKS_PER_CALL,
        )
    return np.where(lifetimes, lifetimes + way, 0)


def _tiles(boxes: FloatArray, end: float = 0.5) -> bool:
    """Return True if the boxes, from left to right, tile [0, end]; the sums are exact."""
    left, right = boxes[:, 0] - boxes[:, 1], boxes[:, 0] + boxes[:, 1]
    return left[0] == 0 and right[-1] == end and bool((left[1:] == right[:-1]).all())


def check_arithmetic() -> None:
    """Check that floats round to nearest and underflow gradually, and that fma is fused.

    Raises
    ------
    RuntimeError
        If one of these does not hold.
    """
    if not _arithmetic_is_ieee(1.0, 2.0**-53, 2.0**-52, 2.0**-1022):
        raise RuntimeError(
            "this machine's arithmetic is not IEEE 754 with rounding to nearest, gradual underflow "
            "and a fused fma; nothing can be proved on it"
        )


@kernel
def _arithmetic_is_ieee(one, half, ulp, tiny):
    """Test the arithmetic on powers of two, passed as arguments to prevent constant folding."""
    nearest = one + half == one and one + 1.5 * half == one + ulp and -one - half == -one
    fused = fma(one + ulp, one - ulp, -one) == -ulp * ulp
    return nearest and fused and tiny / 2 > 0


_ELIMINATED, _FAILED = 0, 1


@kernel(error_model="numpy")
def _follow(cycle, way, points, boxes, slopes, lifetimes, lanes, ages, box_ids, first, most_kicks):
    """Follow boxes for some more kicks; return the index of the next box, and whether any remain.

    cycle : a block of kicks. boxes, slopes : ŝ, δ and γ. lifetimes : receives the results. lanes,
    ages, box_ids : for each lane, its state, its kicks so far, and the index of its box; -1 for an
    idle lane.
    """
    before, events, kicks = np.empty((_ROWS, FEW)), np.empty((2, FEW)), 0
    while kicks < most_kicks:
        busy = 0
        for lane in range(FEW):
            if box_ids[lane] < 0 and first < len(boxes):
                box_ids[lane], ages[lane] = first, 0
                _start(lanes, lane, points, boxes[first, 0], boxes[first, 1], slopes[first], way)
                first += 1
            busy += box_ids[lane] >= 0
        if busy == 0:
            return first, False
        before[:] = lanes
        _advance(cycle, lanes, events)
        for lane in range(FEW):
            if box_ids[lane] < 0:
                continue
            if events[0, lane] > 0 and events[1, lane] <= 0:  # no event; false for NaN
                ages[lane] += len(cycle)
                kicks += len(cycle)
                continue
            n, outcome = _replay(cycle, before, lane)
            kicks += n
            if outcome == _ELIMINATED:
                lifetimes[box_ids[lane]] = ages[lane] + n
            box_ids[lane] = -1
    return first, True


@njit(nogil=True)
def _start(lanes, lane, points, s, delta, slope, way):
    """Set the state of a box before the kick at the curve.

    If way is 1, set the state before the kick at the preceding site instead; from there, the kicks
    are followed in reverse order.
    """
    for row in range(_ROWS):
        lanes[row, lane] = 0.0
    at = min(int(2 * s), len(points) - 2)
    part, x, y = 2 * s - at, points[at, 0], points[at, 1]
    dx, dy = points[at + 1, 0] - x, points[at + 1, 1] - y
    lanes[2, lane], lanes[3, lane] = _along(y, part, dy)
    t, z, last = 2 * delta * dx, 2 * delta * dy, slope
    if abs(z - last * t) < 1e-4 * (abs(t) + abs(z)):  # v would point along the curve
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
    """Return start + part·length, exactly, as a sum of two floats; see proofs/README.md."""
    product = part * length
    total, error = two_sum(start, product)
    return total, error + fma(part, length, -product)


@njit(nogil=True, error_model="numpy")
def _advance(cycle, lanes, events):
    """Advance all lanes by a block of kicks, in place; set events to the smallest V and Σ bad."""
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
    """Repeat one lane's block kick by kick; return the kicks up to its event, and the outcome."""
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
    """Return rint x - x, h = sin 2πX/2π as a sum of two floats, and cos 2πX; X = x + x_low + 1/4.

    Arguments are lanes or floats.
    """
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
    """Return Σ c_k vᵏ for eight coefficients."""
    s = fma(v, c[7], c[6])
    s = fma(s, v, c[5])
    s = fma(s, v, c[4])
    s = fma(s, v, c[3])
    s = fma(s, v, c[2])
    s = fma(s, v, c[1])
    return fma(s, v, c[0])


@njit(forceinline=True)
def _next(s, s_low, v, v_low, coefficient):
    """Return (s + s_low)(v + v_low) + coefficient, where coefficient[0] is the largest term."""
    product = s * v
    error = fma(s_low, v, fma(s, v_low, fma(s, v, -product)))
    total = coefficient[0] + product
    return total, (product - (total - coefficient[0])) + (error + coefficient[1])


@njit(forceinline=True, error_model="numpy")
def _kick(k, scale, state):
    """Kick a box, on lanes or floats; x + x_low is the shifted angle x̂ - 1/4, scale is 1/δ.

    w, W, z, p are the last differences of v, V, t, q. Returns the state and `bad`, which is 0 while
    the bounds hold, and positive or NaN otherwise.
    """
    x, x_low, y, y_low, v, w, V, W, t, z, q, p, A, B, linear, quadratic, rest, paid = state
    size = fabs(k)
    back, h, h_low, c = _accurate(x, x_low)
    kc = k * c
    f2 = -TWO_PI2 * k * h  # κh''/2

    # Bounds on |x - x̂|: the first-order part, the unknown remainder, everything beyond first
    # order, and the total.
    straight = fabs(t)
    unknown = fma(A, fabs(v), B * straight)
    curved = fabs(q) + unknown
    E = straight + curved
    E2 = E * E
    E3 = E2 * E
    cosine = fabs(c)
    sine = fma(fabs(h), TWO_PI, 7e-16)
    both = curved * (E + straight)  # |(x - x̂)² - (σt)²|

    # The payment covers rounding, and the amount by which Q may exceed its value in the middle.
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
    W = fma(kc, V, W) + due / V * PAYMENT_FACTOR
    V = V + W

    # The solutions after the kick.
    w = fma(kc, v, w)
    z = fma(kc, t, z)
    p = fma(f2 * t, t, fma(kc, q, p))
    v1, t1, q1 = v + w, t + z, q + p
    # Defects of the orbit, of its expansion, of the three solutions, and of the cosine.
    E1 = fma(A, fabs(v1), fma(B, fabs(t1), fabs(t1) + fabs(q1)))
    expansion = fma(PI * sine, both, fma(CUBIC * cosine, E3, QUARTIC * E2 * E2))
    solutions = fma(E1 + E, 3.1 * ULP, fma(E2, 41.0, E) * (size * (COS + 4 * ULP)))
    defect = fma(expansion, size, solutions + (size + 1.0) * ORBIT) * (1.002 * scale)
    tv = t * v1
    wronskian = fabs(fma(v, t1, -tv) * scale - 1.0) + fabs(tv) * (4 * ULP * scale)
    A = fma(defect, straight, A)
    B = fma(defect, fabs(v), B)
    bad = (
        maximum(0.0, E - _MAX_DEVIATION)
        + maximum(0.0, fma(E, -_MAX_UNKNOWN_SHARE, curved))
        + maximum(0.0, wronskian - _MAX_WRONSKIAN_ERROR)
        + maximum(0.0, V - _MAX_V)
    )
    product = k * h
    y, error = two_sum(y, product)
    y, y_low = renormalised(y, error + (y_low + fma(k, h_low, fma(k, h, -product))))
    y = y - rint(y)
    x, error = two_sum(y, -back)
    x, x_low = renormalised(x, error + (x_low + y_low))
    state = (x, x_low, y, y_low, v1, w, V, W, t1, z, q1, p, A, B, linear, quadratic, rest, paid)
    return state, bad
