"""A proof that transport is global for every forcing in a cell of a plane.

The forcings in a plane are κ_i = o_i + αF_i + βG_i, and a cell is |α - a| ≤ h_a, |β - b| ≤ h_b. The
method of `nasm.proofs.transport` is extended to three parameters, the initial condition and the two
coordinates of the forcing, in which orbits are expanded to second order:

    κ_i = k_i + σ_α f_i + σ_β g_i,   f_i = h_α F_i,   g_i = h_β G_i,   |σ|, |σ_α|, |σ_β| ≤ 1,
    x_n = x̂_n + σ t + σ_α p + σ_β q + σ² tt + σσ_α tp + σσ_β tq + σ_α² pp + σ_ασ_β pq + σ_β² qq + ρ,
    |ρ_n| ≤ A_n|v_n| + B_n|t_n|.

A box that fails is bisected in the parameter that has moved its orbit most.

*Two kicks* (`prove_cell`): α and β are the two strengths, the curve is a symmetry line, and
y = ŷ + σδ + g_α σ_α h_α + g_β σ_β h_β. The shears g shift the initial conditions as κ varies, so
that the rotation numbers of their orbits hardly change and p and q grow more slowly. The line is
cut into pieces, each with its own shears. Boxes that extend |g_α|h_α + |g_β|h_β beyond the ends of
a piece cover it for all κ in the cell.

*Other planes* (`prove_cell_of_plane`): the curve is a polygon, the same for all κ in the cell.
Boxes are followed in both directions, as in `transport`. See `proofs/README.md`, "Cells".
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeAlias

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
    load_few,
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
from nasm.planes import Plane
from nasm.proofs.certificates import certificate, columns_in_hex, in_hex, matrix_in_hex
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
    curve_at,
    horner,
    is_twist,
)
from nasm.symmetries import dominant_centre
from nasm.tables import html_table
from nasm.types import FloatArray, IntArray

__all__ = ["CellProof", "PlaneCellProof", "prove_cell", "prove_cell_of_plane"]

# The same values as in `transport`.
_MAX_DEVIATION, _MAX_UNKNOWN_SHARE, _MAX_WRONSKIAN_ERROR, _MAX_V = 0.1, 0.8, 1e-3, 1e100

_ROUNDING = 1e-12  # a deviation this small may be wholly unknown, e.g. where t, p and q are 0
_STRENGTH_GRID = 2.0**30  # inverse spacing of strengths, so that bisecting a cell is exact
_PIECES = 16  # number of pieces of a symmetry line
_END_GRID = 2.0**-20  # spacing of the ends of pieces
_SHEAR_GRID, _MAX_SHEAR = 2.0**-8, 0.5  # spacing of g, and the largest
_MAX_SLOPE_KICKS = 20_000  # maximum number of kicks, in each direction, used to choose γ
_MAX_PLANE_STRENGTH = 4  # largest |κ| for which the bounds on rounding hold on a polygon
_MIN_DELTA, _MIN_STRENGTH_WIDTH = 2.0**-45, 2.0**-40
_KICKS_PER_BLOCK = 8  # kicks between checks for events
_STATE, _ROWS, _COLUMNS = 40, 41, 10  # changing and all numbers per lane; numbers per box
_OF_KICK = 4  # numbers that describe a kick: k, f, g, and a bound on their rounding
_MAX_WAITING = 4096  # maximum number of boxes on the stack
_KICKS_PER_CALL, _MAX_ELIMINATED = 200_000, 16_384  # per kernel call, between checks of the clock
DOWN = 1 - 1e-14  # the counterpart of `UP` for a sum that is subtracted


Curve: TypeAlias = tuple[int, FloatArray]
"""Site and corners of a curve."""


@dataclass(frozen=True, eq=False, repr=False)
class CellProof(Proof):
    """A proof that no circle exists under any forcing in a cell, or the reason why it failed.

    Attributes
    ----------
    outcome : Outcome
        PROVED, or the reason for the failure; a failed proof says nothing about circles.
    kappa, half_width : tuple of 2 floats
        The cell, |κ_i - kappa_i| ≤ half_width_i.
    site : int
        Index of the kick at the symmetry line.
    a : float
        x of the symmetry line before that kick.
    boxes : ndarray, shape (n, 9)
        Rows ŷ, δ, k_0, h_0, k_1, h_1, g_0, g_1, and the number of the piece of 0 ≤ y ≤ 1/2. The
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
        return _html(self, {"centre of the cell": f"{self.kappa}"}, "a cell")

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
    """Try to prove that no forcing in a cell has a rotational invariant circle.

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
        A proof that fails says nothing about circles.

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
    kappa, half_width, budget = _cell("kappa", kappa, half_width, budget)
    check_arithmetic()
    centre, widths = tuple(kappa.tolist()), tuple(half_width.tolist())
    if (np.abs(kappa) + half_width >= 2).any():
        boxes, lifetimes = np.empty((0, _COLUMNS - 1)), np.empty(0, np.int64)
        return CellProof(Outcome.SCOPE, centre, widths, 0, 0.0, boxes, lifetimes)
    centre_site, a = dominant_centre(kappa)
    site = int(centre_site)
    from_line = np.roll(kappa, -site).tolist(), np.roll(half_width, -site).tolist()
    line, strengths = np.array([[a, 0.0], [a, 0.5]]), np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    outcome, boxes, lifetimes = _covered(strengths, line, True, *from_line, budget)
    return CellProof(outcome, centre, widths, site, a, boxes[:, :-1], lifetimes[:, 0])


def _cell(
    name: str, centre: ArrayLike, half_width: ArrayLike, budget: float
) -> tuple[FloatArray, FloatArray, float]:
    """Check the arguments of a proof for a cell; `name` is the caller's name for the centre."""
    centre = forcing(floats(name, centre))
    half_width = forcing(np.broadcast_to(floats("half_width", half_width), 2))
    budget = positive("budget", budget, "seconds of computing time")
    if centre.size != 2:
        raise ValueError(f"{name}={centre.tolist()}: the centre of a cell has two coordinates")
    if not (half_width > 0).all():
        raise ValueError(f"half_width={half_width.tolist()} must be positive")
    numbers = _STRENGTH_GRID * np.concatenate([centre, half_width])
    if (numbers != np.rint(numbers)).any():
        raise ValueError(
            f"{name}={centre.tolist()} and half_width={half_width.tolist()} must be multiples of "
            "2**-30, so that the corners of the cell are exact"
        )
    return centre, half_width, budget


@dataclass(frozen=True, eq=False, repr=False)
class PlaneCellProof(Proof):
    """A proof that no circle exists under any forcing in a cell of a plane, or why it failed.

    Attributes
    ----------
    outcome : Outcome
        PROVED, or the reason for the failure; a failed proof says nothing about circles.
    plane : Plane
        The plane of forcings.
    centre, half_width : tuple of 2 floats
        The cell, in coordinates of the plane.
    site : int
        Index of the kick at the curve.
    points : ndarray, shape (m, 2)
        Corners of the curve, as in `transport.TransportProof`.
    boxes : ndarray, shape (n, 7)
        Rows ŝ, δ, α, h_α, β, h_β and γ; s is 0 at the first corner, 1/2 at the second, and so on.
    lifetimes : ndarray of int, shape (n, 2)
        Numbers N of kicks until V ≤ 0, for each box, forwards and backwards.

    Examples
    --------
    >>> from nasm.planes import pairs
    >>> from nasm.proofs.transport_cells import prove_cell_of_plane
    >>> prove_cell_of_plane(pairs("1/3"), (1.0, 1.0), 2.0**-6)
    <PlaneCellProof: PROVED, transport is global within (0.015625, 0.015625) of (1.0, 1.0) in
    pairs:1/3; ... boxes>
    """

    plane: Plane
    centre: tuple[float, float]
    half_width: tuple[float, float]
    site: int
    points: FloatArray
    boxes: FloatArray
    lifetimes: IntArray

    def __repr__(self) -> str:
        claim = "transport is global" if self.proved else "transport is not proved to be global"
        return (
            f"<PlaneCellProof: {self.outcome.name}, {claim} within {self.half_width} of "
            f"{self.centre} in {self.plane.name}; {len(self.boxes)} boxes>"
        )

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        place = {"plane": self.plane.name, "centre of the cell": f"{self.centre}"}
        return _html(self, place, "a cell of a plane")

    def certificate(self) -> dict[str, Any]:
        """Return what another program needs to check the proof, as a JSON-serializable dict.

        Raises
        ------
        ValueError
            If nothing was proved.
        """
        fields = {
            "plane": matrix_in_hex(self.plane),
            "centre": in_hex(self.centre),
            "half_width": in_hex(self.half_width),
            "site": self.site,
            "points": [in_hex(point) for point in self.points.tolist()],
            "boxes": columns_in_hex(self.boxes),
            "lives": self.lifetimes.tolist(),
        }
        theorem, cell = "Transport is global in a cell of a plane", (self.centre, self.half_width)
        return certificate(self, theorem, fields, *cell, plane=self.plane)


def prove_cell_of_plane(
    plane: Plane,
    centre: ArrayLike,
    half_width: ArrayLike,
    budget: float = 1.0,
    curve: Curve | None = None,
) -> PlaneCellProof:
    """Try to prove that no forcing in a cell of a plane has a rotational invariant circle.

    Parameters
    ----------
    plane : Plane
        The plane of forcings; the floats that define it are taken to be exact.
    centre : array_like, shape (2,)
        Centre of the cell, in coordinates of the plane, a multiple of 2⁻³⁰.
    half_width : float or array_like, shape (2,)
        Half widths of the cell, positive multiples of 2⁻³⁰. The outcome is SCOPE if any kick can be
        stronger than 4, or if the largest |κ_j| in the cell violate the twist condition of
        `transport.prove`.
    budget : float
        CPU seconds. Without `curve`, the search for one may take as long again.
    curve : (int, ndarray), optional
        Site and corners of a curve, e.g. from another proof. The default is the curve from a
        proof for the forcing at the centre.

    Returns
    -------
    PlaneCellProof
        A proof that fails says nothing about circles.

    Raises
    ------
    ValueError
        If an argument is out of range or not a multiple of 2⁻³⁰.
    RuntimeError
        If the arithmetic of this machine is not the IEEE 754 arithmetic that the proof requires.

    Examples
    --------
    >>> from nasm.planes import three_kicks
    >>> from nasm.proofs.transport_cells import prove_cell_of_plane
    >>> prove_cell_of_plane(three_kicks(0.25), (0.75, 0.25), 2.0**-6).proved
    True
    """
    centre, half_width, budget = _cell("centre", centre, half_width, budget)
    check_arithmetic()
    rows = np.array([plane.origin, plane.first, plane.second]).T
    about = plane, tuple(centre.tolist()), tuple(half_width.tolist())
    nothing = np.empty((0, 2)), np.empty((0, 7)), np.empty((0, 2), np.int64)
    largest = largest_strengths(*about)
    if max(largest) > _MAX_PLANE_STRENGTH or not is_twist(largest):
        return PlaneCellProof(Outcome.SCOPE, *about, 0, *nothing)
    if curve is None:
        proof = curve_at(plane.forcing(*centre), budget)
        if not len(proof.points):
            return PlaneCellProof(proof.outcome, *about, 0, *nothing)
        curve = proof.site, proof.points
    site, points = curve
    from_curve = np.ascontiguousarray(np.roll(rows, -site, axis=0))
    outcome, boxes, lifetimes = _covered(from_curve, points, False, *about[1:], budget)
    return PlaneCellProof(outcome, *about, site, points, boxes[:, [0, 1, 2, 3, 4, 5, 9]], lifetimes)


def _html(proof: CellProof | PlaneCellProof, place: dict[str, str], where: str) -> str:
    """Return the table that a notebook shows for a proof in a cell."""
    rows = place | {
        "half width": f"{proof.half_width}",
        "outcome": f"{proof.outcome.name}: {proof.reason}",
        "boxes": f"{len(proof.boxes)}, with {proof.lifetimes.sum()} kicks in all",
    }
    return html_table(rows, f"Proof that transport is global in {where}")


def largest_strengths(
    plane: Plane, centre: Sequence[float], half_width: Sequence[float]
) -> tuple[Fraction, ...]:
    """Return the largest |κ_j| in a cell, for each kick, exactly.

    Examples
    --------
    >>> from nasm.planes import three_kicks
    >>> from nasm.proofs.transport_cells import largest_strengths
    >>> largest_strengths(three_kicks(0.25), (0.5, -1.0), (0.125, 0.25))
    (Fraction(5, 8), Fraction(5, 4), Fraction(1, 4))
    """
    (a, b), (h_a, h_b) = (map(Fraction, pair) for pair in (centre, half_width))
    rows = zip(plane.origin, plane.first, plane.second, strict=True)
    exact = (map(Fraction, row) for row in rows)
    return tuple(abs(o + a * f + b * g) + h_a * abs(f) + h_b * abs(g) for o, f, g in exact)


def _covered(
    forcings: FloatArray,
    points: FloatArray,
    is_line: bool,
    centre: Sequence[float],
    half_width: Sequence[float],
    budget: float,
) -> tuple[Outcome, FloatArray, IntArray]:
    """Cover a curve with boxes, for all forcings in a cell.

    forcings : rows o_i, F_i, G_i, beginning with the kick at the curve. points : corners of the
    curve, as in PlaneCellProof. is_line : whether the curve is a symmetry line under all forcings
    in the plane.
    """
    waiting, n_waiting = np.empty((_MAX_WAITING, _COLUMNS)), 0
    (a, b), (h_a, h_b) = centre, half_width
    n_pieces = _PIECES if is_line else 1
    for piece in np.arange((len(points) - 1) * n_pieces) / n_pieces:
        left, right, g_a, g_b = piece / 2, (piece + 1 / n_pieces) / 2, 0.0, 0.0
        if is_line:
            shears = _shears(forcings, a, b, points[0, 0] - 0.25, (left + right) / 2)
            shears = np.clip(shears, -_MAX_SHEAR, _MAX_SHEAR)
            g_a, g_b = (np.rint(shears / _SHEAR_GRID) * _SHEAR_GRID).tolist()
            margin = abs(g_a) * h_a + abs(g_b) * h_b
            left = float(np.floor((left - margin) / _END_GRID)) * _END_GRID
            right = float(np.ceil((right + margin) / _END_GRID)) * _END_GRID
        middle, half = (left + right) / 2, (right - left) / 2
        waiting[n_waiting] = middle, half, a, h_a, b, h_b, g_a, g_b, piece, 0.0
        n_waiting += 1
    n_cycle = len(forcings) * -(-_KICKS_PER_BLOCK // len(forcings))
    lanes, kicks = np.zeros((_ROWS, FEW)), np.zeros((n_cycle, _OF_KICK, FEW))
    boxes, ages = np.zeros((_COLUMNS, FEW)), np.zeros((2, FEW), np.int64)
    ways = np.zeros(FEW, np.int64)
    eliminated = np.empty((_MAX_ELIMINATED, _COLUMNS))
    lifetimes = np.empty((_MAX_ELIMINATED, 2), np.int64)
    parts, end, done = [(eliminated[:0], lifetimes[:0])], time.thread_time() + budget, _UNFINISHED
    while done == _UNFINISHED and time.thread_time() < end:
        done, n_waiting, n_eliminated = _cover(
            forcings, points, is_line, waiting, n_waiting, lanes, kicks, boxes, ways, ages,
            eliminated, lifetimes, _KICKS_PER_CALL,
        )  # fmt: skip
        parts.append((eliminated[:n_eliminated].copy(), lifetimes[:n_eliminated].copy()))
    all_boxes, all_lifetimes = map(np.concatenate, zip(*parts, strict=True))
    return _OUTCOMES[done], all_boxes, all_lifetimes


_DONE, _UNFINISHED, _TOO_SMALL = 0, 1, 2
_OUTCOMES = Outcome.PROVED, Outcome.BUDGET, Outcome.PRECISION
_ELIMINATED, _FAILED = 0, 1


@kernel(error_model="numpy")
def _cover(
    forcings, points, is_line, waiting, n_waiting, lanes, kicks, boxes, ways, ages,
    eliminated, lifetimes, most_kicks,
):  # fmt: skip
    """Continue covering a curve for some kicks; return the outcome, n_waiting and n_eliminated.

    waiting[:n_waiting] : the boxes still to be followed, a stack of rows ŝ, δ, α, h_α, β, h_β, g_α,
    g_β, the number of a piece of the curve, and γ; the integer part of the piece's number is the
    index of a segment. lanes, kicks, boxes, ways, ages : for each lane, in columns, its state, a
    block of its kicks, its box (δ = 0 if the lane is idle), whether the box is followed backwards
    (after it has been eliminated forwards), and the numbers of kicks so far, forwards and
    backwards. eliminated, lifetimes : arrays that receive the eliminated boxes and their lifetimes.
    """
    before, events = np.empty((_ROWS, FEW)), np.empty((2, FEW))
    n_eliminated = n_kicks = 0
    while n_kicks < most_kicks and n_eliminated <= eliminated.shape[0] - FEW:
        busy = 0
        for lane in range(FEW):
            if boxes[1, lane] == 0 and n_waiting > 0:
                n_waiting -= 1
                boxes[:, lane], ages[:, lane], ways[lane] = waiting[n_waiting], 0, 0
                _start(lanes, kicks, lane, forcings, points, is_line, boxes[:, lane], 0)
            busy += boxes[1, lane] != 0
        if busy == 0:
            return _DONE, n_waiting, n_eliminated
        before[:] = lanes
        _advance(kicks, lanes, events)
        for lane in range(FEW):
            if boxes[1, lane] == 0:
                continue
            way = ways[lane]
            if events[0, lane] > 0 and events[1, lane] <= 0:  # no event; false for NaN
                ages[way, lane] += kicks.shape[0]
                n_kicks += kicks.shape[0]
                continue
            n, outcome, split = _replay(kicks, before, lane)
            n_kicks += n
            ages[way, lane] += n + way
            if outcome == _ELIMINATED and way == 0 and not is_line:
                ways[lane] = 1
                _start(lanes, kicks, lane, forcings, points, is_line, boxes[:, lane], 1)
                continue
            if outcome == _ELIMINATED:
                eliminated[n_eliminated], lifetimes[n_eliminated] = boxes[:, lane], ages[:, lane]
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

    split : the parameter to bisect, 0 for the initial condition, 1 or 2 for a coordinate of the
    forcing. Because of the shear, bisecting a coordinate also shifts the centre ŝ.
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


@njit(nogil=True, error_model="numpy")
def _start(lanes, kicks, lane, forcings, points, is_line, box, way):
    """Set the state of a box before the kick at the curve, and a block of its kicks.

    If way is 1, set the state before the kick at the preceding site, for following the kicks in
    reverse order. If way is 0, also choose the slope γ of the box.
    """
    for n in range(kicks.shape[0]):
        o, F, G = forcings[(-1 - n if way else n) % len(forcings)]
        k, f, g = fma(box[2], F, fma(box[4], G, o)), box[3] * F, box[5] * G
        size = fabs(o) + fabs(box[2] * F) + fabs(box[4] * G) + fabs(f) + fabs(g)
        kicks[n, 0, lane], kicks[n, 1, lane], kicks[n, 2, lane] = k, f, g
        kicks[n, 3, lane] = 4 * ULP * size
    x, t, x_error = _coordinate(points[:, 0], box)
    y, zt, y_error = _coordinate(points[:, 1], box)
    zp = zq = 0.0  # last differences of p and q at the curve, where p = q = 0
    if is_line:  # η is even: with this γ both directions are equivalent
        weight = 0.5 if x == 0.5 else -0.5  # -cos 2πa/2
        slope = weight * kicks[0, 0, lane]
        zp, zq = box[6] * box[3], box[7] * box[5]
        y_error = 0.0  # y = ŝ
    elif way == 0:
        slope = _slope(forcings, box[2], box[4], x, y)
    else:
        slope = box[9]
    box[9] = last = slope
    if abs(zt - last * t) < 1e-4 * (abs(t) + abs(zt)):  # v would point along the curve
        last += 1
    wronskian = zt - last * t
    if way:
        x, t = y - x, zt - t
        x_error, slope, last = x_error + y_error, -slope, -last
    sign = 1.0 if wronskian > 0 else -1.0
    scale, v = sign / wronskian, 1 + way * last
    state = lanes[:, lane]
    state[:] = 0.0
    state[0], state[1] = x - 0.25, y - rint(y)
    state[2], state[3] = v, last
    state[4], state[5] = 1 + way * slope, slope  # V
    # σ changes sign if v and t would otherwise have a negative Wronskian.
    state[6], state[7], state[9], state[11] = sign * t, sign * zt, zp, zq
    state[24] = 1.002 * scale * (x_error * abs(zt) + y_error * abs(t))  # A
    state[25] = 1.002 * scale * (x_error * abs(last) + y_error * abs(v))  # B
    if is_line:
        # Site c counts half: half of the σ_α and σ_β terms there, f_c cos 2πa and g_c cos 2πa, are
        # subtracted beforehand.
        state[27], state[28] = weight * kicks[0, 1, lane], weight * kicks[0, 2, lane]
    state[_STATE] = scale


@njit(nogil=True, error_model="numpy")
def _coordinate(corners, box):
    """Return x or y at the middle of a box on a polygon, its change with σ, and an error bound.

    The bound covers the sum of the rounding errors in both results, in x - 1/4 and in y - x.
    """
    at = int(box[8])
    part, width, z = 2 * box[0] - at, 2 * box[1], corners[at]
    dz = corners[at + 1] - z
    error = 8 * ULP * (fabs(z) + (fabs(part) + width) * fabs(dz) + 1.0)
    return fma(part, dz, z), width * dz, error if dz != 0 else 0.0


@njit(nogil=True, error_model="numpy")
def _advance(kicks, lanes, events):
    """Advance all lanes by a block of kicks, in place; set events to the smallest V and Σ bad."""
    own_frame()
    state, scale = load_state(lanes, 0, _STATE, FEW), load_few(lanes, _STATE * FEW)
    smallest, worst = state[4], scale - scale  # zeros
    for n in range(kicks.shape[0]):
        row = n * _OF_KICK * FEW
        k, f = load_few(kicks, row), load_few(kicks, row + FEW)
        g, blur = load_few(kicks, row + 2 * FEW), load_few(kicks, row + 3 * FEW)
        state, bad = _kick(k, f, g, blur, scale, state)
        smallest, worst = minimum(smallest, state[4]), worst + bad
    store_state(lanes, state)
    store(events, 0, smallest)
    store(events, FEW, worst)


@njit(nogil=True, error_model="numpy")
def _replay(kicks, lanes, lane):
    """Repeat a lane's block; return the number of kicks to its event, the outcome, and `split`."""
    state, scale = load_state(lanes, lane, _STATE, 1), lanes[_STATE, lane]
    for n in range(kicks.shape[0]):
        k, f, g, blur = kicks[n, 0, lane], kicks[n, 1, lane], kicks[n, 2, lane], kicks[n, 3, lane]
        state, bad = _kick(k, f, g, blur, scale, state)
        if not bad <= 0 or state[4] <= 0:
            most, first, second = state[37], state[38], state[39]
            split = 0 if most >= max(first, second) else 1 if first >= second else 2
            return n + 1, _FAILED if not bad <= 0 else _ELIMINATED, split
    return kicks.shape[0], _FAILED, 0


@njit(nogil=True, error_model="numpy")
def _slope(forcings, a, b, x, y):
    """Choose γ, a multiple of 2⁻²⁰, so that V becomes ≤ 0 in both directions if possible.

    See `nasm.converse_kam.transversal`. Proofs are valid for any choice.
    """
    bound = 2 + _strength(forcings, 0, a, b) * _trigonometry(x - 0.25)[2]
    y_ahead = y + _strength(forcings, 0, a, b) * _trigonometry(x - 0.25)[1]
    ahead, behind, n = (x, y_ahead, 1.0, 1.0, 0.0), (x, -y, 1.0, 1.0, 0.0), 1
    while ahead[4] + behind[4] < bound and n < _MAX_SLOPE_KICKS:
        ahead = _summed(_strength(forcings, n, a, b), bound, ahead)
        behind = _summed(_strength(forcings, -n, a, b), bound, behind)
        n += 1
    if not ahead[4] + behind[4] >= bound:
        return 0.0
    slope = 1 + (min(ahead[4], bound) - min(behind[4], bound) - bound) / 2
    return min(max(rint(slope * 2.0**20) / 2.0**20, -3.0), 1 - 2.0**-20)


@njit(forceinline=True, error_model="numpy")
def _strength(forcings, n, a, b):
    """Return κ_n at the point (a, b) of the plane."""
    row = forcings[n % len(forcings)]
    return row[0] + a * row[1] + b * row[2]


@njit(forceinline=True, error_model="numpy")
def _summed(k, bound, state):
    """Advance one site; add 1/(v_n v_{n+1}) to the total, or set it to `bound` if v_{n+1} ≤ 0."""
    x, y, v, w, total = state
    x += y
    x -= rint(x)
    _, h, c = _trigonometry(x - 0.25)
    before, w = v, w + k * c * v
    v += w
    total = total + 1 / (before * v) if v > 0 and total < bound else bound
    return x, y + k * h, v, w, total


@kernel(error_model="numpy")
def _shears(forcings, a, b, x, y):
    """Choose g = -p/t, -q/t where V crosses zero, so that the orbit hardly depends on κ there.

    x and y begin on a symmetry line; x is shifted by -1/4. Proofs are valid for any choice.
    """
    v, w, t, z = 1.0, abs(_strength(forcings, 0, a, b)) / 2, 0.0, 1.0
    p = zp = q = zq = 0.0
    for n in range(1000):
        k, i = _strength(forcings, n, a, b), n % len(forcings)
        back, h, c = _trigonometry(x)
        w, z = w + k * c * v, z + k * c * t
        zp, zq = zp + k * c * p + forcings[i, 1] * h, zq + k * c * q + forcings[i, 2] * h
        v, t, p, q = v + w, t + z, p + zp, q + zq
        if v <= 0:
            break
        y += k * h
        x = y - back
    return np.array([-p / t, -q / t]) if abs(t) > 0.1 else np.zeros(2)


@njit(forceinline=True)
def _trigonometry(x):
    """Return rint x - x, h = sin 2πX/2π and cos 2πX, where X = x + 1/4, for lanes or floats."""
    back = rint(x) - x
    u = 0.25 - fabs(back)
    u2 = u * u
    return back, horner(u2, SINE) * u, copysign(horner(u2, COSINE), back)


@njit(forceinline=True, error_model="numpy")
def _kick(k, f, g, blur, scale, state):
    """Apply one kick to a box, for lanes or floats, by the method of `transport`.

    The strength of the kick differs from k + σ_α f + σ_β g by at most blur. p and q are the
    responses to σ_α and σ_β. zp, … are the last differences of p, …; lt, ltt, … are the sums in Q;
    mt, mp, mq are the largest |t|, |p|, |q| so far.
    """
    x, y, v, w, V, W, t, zt, p, zp, q, zq = state[:12]
    tt, ztt, tp, ztp, tq, ztq, pp, zpp, pq, zpq, qq, zqq = state[12:24]
    A, B, lt, lp, lq, ltt, ltp, ltq, lpp, lpq, lqq, rest, paid, mt, mp, mq = state[24:]
    size, spread = fabs(k), fabs(f) + fabs(g)
    back, h, c = _trigonometry(x)
    kc = k * c
    fc, gc = f * c, g * c
    bend = -TWO_PI2 * k * h  # κh''/2

    # Bounds on |x - x̂|: the first-order part, the unknown remainder, everything beyond first
    # order, and the total.
    at, ap, aq = fabs(t), fabs(p), fabs(q)
    straight = at + ap + aq
    unknown = (A * fabs(v) + B * at) * UP
    curved = (fabs(tt) + fabs(tp) + fabs(tq) + fabs(pp) + fabs(pq) + fabs(qq) + unknown) * UP
    E = (straight + curved) * UP
    E2 = E * E
    E3 = E2 * E
    both = curved * (E + straight) * UP  # |(x - x̂)² - (σt + σ_α p + σ_β q)²|
    sine = TWO_PI * (fabs(h) + ULP) * UP
    mt, mp, mq = maximum(mt, at), maximum(mp, ap), maximum(mq, aq)
    t2, p2, q2 = t * t, p * p, q * q
    tp2, tq2, pq2 = 2.0 * t * p, 2.0 * t * q, 2.0 * p * q

    # The payment covers rounding, and the amount by which Q may exceed its value at the centre.
    V2 = V * V
    # Coefficients in Q of x - x̂, of its square, and of x - x̂ times σ_α and σ_β.
    slope, turn, twist = 2.0 * bend * V2, -TWO_PI2 * kc * V2, -2.0 * TWO_PI2 * h * V2
    twist_f, twist_g = twist * f, twist * g
    lt = lt + slope * t
    lp = lp + slope * p + fc * V2
    lq = lq + slope * q + gc * V2
    ltt = ltt + slope * tt + turn * t2
    ltp = ltp + slope * tp + turn * tp2 + twist_f * t
    ltq = ltq + slope * tq + turn * tq2 + twist_g * t
    lpp = lpp + slope * pp + turn * p2 + twist_f * p
    lpq = lpq + slope * pq + turn * pq2 + twist_f * q + twist_g * p
    lqq = lqq + slope * qq + turn * q2 + twist_g * q
    known = fabs(lt) + fabs(lp) + fabs(lq)
    known = known + (fabs(ltt) + fabs(ltp) + fabs(ltq) + fabs(lpp) + fabs(lpq) + fabs(lqq))
    change = TWO_PI * sine * unknown + TWO_PI2 * fabs(c) * both + COS_CUBIC * E3
    of_strength = TWO_PI * sine * curved + TWO_PI2 * E2 + COS_CUBIC * E3 + 3e-14
    rounding = 3e-14 + 1e-12 * E
    more = size * change + spread * of_strength + (1.0 + size) * rounding + blur
    rest = UP * (rest + V2 * more + 1e-15 * known)
    due = maximum(0.0, UP * (known + rest) - paid)
    paid = (paid + due) * DOWN
    W = fma(kc, V, W) + due / V * UP
    V = V + W

    # The solutions after the kick.
    w = fma(kc, v, w)
    zt = fma(kc, t, zt)
    zp = fma(kc, p, zp) + f * h
    zq = fma(kc, q, zq) + g * h
    ztt = fma(kc, tt, ztt) + bend * t2
    ztp = fma(kc, tp, ztp) + fma(fc, t, bend * tp2)
    ztq = fma(kc, tq, ztq) + fma(gc, t, bend * tq2)
    zpp = fma(kc, pp, zpp) + fma(fc, p, bend * p2)
    zpq = fma(kc, pq, zpq) + fma(fc, q, fma(gc, p, bend * pq2))
    zqq = fma(kc, qq, zqq) + fma(gc, q, bend * q2)
    v1, t1, p1, q1 = v + w, t + zt, p + zp, q + zq
    tt, tp, tq, pp, pq, qq = tt + ztt, tp + ztp, tq + ztq, pp + zpp, pq + zpq, qq + zqq
    # Defects of the orbit, of its expansion, of the solutions, and of the cosine.
    E1 = A * fabs(v1) + (1.0 + B) * fabs(t1) + fabs(p1) + fabs(q1)
    E1 = E1 + fabs(tt) + fabs(tp) + fabs(tq) + fabs(pp) + fabs(pq) + fabs(qq)
    expansion = PI * sine * both + CUBIC * fabs(c) * E3 + QUARTIC * E2 * E2
    of_strength = fabs(c) * curved + COS * E + PI * sine * E2 + CUBIC * E3 + QUARTIC * E2 * E2
    solutions = 3.1 * ULP * (E1 + E + spread) + size * (COS + 4 * ULP) * (E + 41.0 * E2)
    orbit = (size + 1.5) * ULP + size * expansion + spread * of_strength + 0.16 * blur
    defect = 1.002 * (orbit + solutions) * scale
    vt, tv = v * t1 * scale, t * v1 * scale
    wronskian = fabs(vt - tv - 1.0) + 4 * ULP * (fabs(vt) + fabs(tv))
    A = (A + defect * at) * UP
    B = (B + defect * fabs(v)) * UP
    bad = (
        maximum(0.0, E - _MAX_DEVIATION)
        + maximum(0.0, curved - _MAX_UNKNOWN_SHARE * E - _ROUNDING)
        + maximum(0.0, wronskian - _MAX_WRONSKIAN_ERROR)
        + maximum(0.0, V - _MAX_V)
    )
    y = fma(k, h, y)
    y = y - rint(y)
    x = y - back
    state = (
        *(x, y, v1, w, V, W, t1, zt, p1, zp, q1, zq),
        *(tt, ztt, tp, ztp, tq, ztq, pp, zpp, pq, zpq, qq, zqq),
        *(A, B, lt, lp, lq, ltt, ltp, ltq, lpp, lpq, lqq, rest, paid, mt, mp, mq),
    )
    return state, bad
