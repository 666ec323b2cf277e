"""Proofs of global transport in cells of a plane of forcings, and of barriers in triangles.

`nasm.proofs.transport_cells` proves transport for all forcings in a cell; a cell for which the
proof fails is divided into four. `nasm.proofs.patches` proves that a barrier exists for all
forcings in a triangle with a corner at the plane's origin.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nasm.planes import Plane, two_kicks
from nasm.proofs import transport_cells
from nasm.proofs.transport_cells import CellProof, Curve, PlaneCellProof
from nasm.types import FloatArray

__all__ = ["distance", "proved_cells", "triangles"]

OPEN = 1
"""State of a cell for which nothing is proved."""

TRANSPORT = 2
"""State of a cell for which transport is proved to be global."""

# Minimum relative distance from the boundary at which a proof limited to 1 s is attempted;
# in 128 attempts closer to it, transport was proved in only 2 cells.
_MIN_DISTANCE = 0.003
_ANGLE_ERROR = 1e-9  # degrees; rays at the ends of a wedge may be outside it by this angle


def distance(
    plane: Plane, rays: Sequence[Sequence[float]], a: ArrayLike, b: ArrayLike
) -> FloatArray:
    """Estimate 1 - s/s_c for the forcings at (a, b) in a plane; it is negative beyond the breakup.

    The estimate is used only to choose which proof to try in a cell.

    Parameters
    ----------
    plane : Plane
        The plane of forcings.
    rays : sequence of (angle, scale)
        Angle in degrees, in the plane's `wedge`, and scale s_c of the last breakup; between these
        angles, the scale is interpolated linearly.
    a, b : array_like
        Coordinates in the plane.

    Returns
    -------
    ndarray
        Distances, in the shape to which a and b broadcast.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from nasm.proofs.cells import distance
    >>> float(distance(two_kicks(), [(0.0, 0.5), (45.0, 1.4)], 0.0, -0.25))
    0.5
    """
    begin, _ = plane.wedge
    images = plane.unfold(np.rad2deg(np.arctan2(b, a)))
    angle = begin + ((images - begin + _ANGLE_ERROR) % 360).min(axis=0) - _ANGLE_ERROR
    return 1 - np.hypot(a, b) / np.interp(angle, *np.transpose(rays))


def in_wedge(plane: Plane, a: float, b: float) -> bool:
    """Return whether a point of a plane lies in its `wedge`, whose images cover the whole plane.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from nasm.proofs.cells import in_wedge
    >>> in_wedge(two_kicks(), 0.5, 0.5), in_wedge(two_kicks(), 0.5, 0.6)
    (True, False)
    """
    begin, end = plane.wedge
    angle = np.rad2deg(np.arctan2(b, a)) - begin
    return bool((angle + _ANGLE_ERROR) % 360 <= end - begin + 2 * _ANGLE_ERROR)


def triangles(
    angles: FloatArray, scales: FloatArray, circles: Sequence[str], sagitta: float
) -> list[tuple[list[float], list[float], list[str]]]:
    """Divide the region below the boundary into triangles with a corner at κ = 0.

    Parameters
    ----------
    angles, scales : ndarray, shape (n,)
        Rays, as for `distance`.
    circles : sequence of str
        The last circle on each ray, as text.
    sagitta : float
        Largest relative distance by which the boundary may lie inside the far side of a triangle
        that spans more than two rays.

    Returns
    -------
    list of (corner, corner, circles)
        The two far corners of each triangle, which it shares with its neighbours, and the one or
        two circles to try. A corner is a pair of floats with 20 binary places.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.proofs import triangles
    >>> circles = ["[0;2,(1)]", "[0;2,(1)]"]
    >>> triangles(np.array([0.0, 10.0]), np.array([0.5, 0.5]), circles, 0.01)
    [([0.5, 0.0], [0.4924039840698242, 0.08682441711425781], ['[0;2,(1)]'])]
    """
    points = np.stack([np.cos(np.deg2rad(angles)), np.sin(np.deg2rad(angles))], 1)
    corners = np.round(points * scales[:, None] * 2**20) / 2**20
    divided, first = [], 0
    while first < len(angles) - 1:
        last = first + 1
        for end in range(first + 2, len(angles)):
            a, b = corners[first], corners[end] - corners[first]
            side = _cross(a, b) / _cross(points[first : end + 1], b)  # scales of the far side
            if len({*circles[first:end]}) > 1 or (
                1 - (scales[first : end + 1] / side).min() > sagitta
            ):
                break
            last = end
        both = sorted({circles[first], circles[last]} - {None}, key=str)
        low, high = corners[[first, last]].tolist()
        divided.append((low, high, both))
        first = last
    return divided


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def proved_cells(
    plane: Plane,
    low: tuple[float, float],
    size: float,
    depth: int,
    rays: Sequence[Sequence[float]],
    seconds: float,
    failed: list[tuple[float, float]] | None = None,
    curve: Curve | None = None,
) -> tuple[NDArray[np.int8], list[CellProof | PlaneCellProof]]:
    """Try to prove that transport is global in each of the 4**depth cells of a square.

    1. Try a proof for the whole square, unless it is too close to the boundary.
    2. If that fails, continue with its quarters, beginning with the farthest from the boundary.
    3. Once a proof has failed, skip squares that are no smaller and no farther from the boundary.

    Squares outside the plane's `wedge` are skipped, because they are images of squares inside it.
    In planes other than `two_kicks` a proof needs a curve. If the proof for a square fails, its
    curve is tried first for the quarters.

    Parameters
    ----------
    plane : Plane
        The plane of forcings.
    low : (float, float)
        Coordinates of the lower left corner.
    size : float
        Width of the square; the corners of all cells must be multiples of 2⁻³⁰.
    depth : int
        Number of times that the width is halved.
    rays : sequence of (angle, scale)
        The boundary, as for `distance`.
    seconds : float
        CPU time allowed for a proof at the finest level; half of it is allowed for larger squares.
    failed : list of (size, distance), optional
        Squares for which no proof of transport was found; used in recursive calls.
    curve : (int, ndarray), optional
        The curve to try first; used in recursive calls.

    Returns
    -------
    states : ndarray of int8, shape (2**depth, 2**depth)
        OPEN or TRANSPORT, indexed by the second coordinate and the first. Skipped squares stay
        OPEN unless they belong to a larger square for which transport is proved.
    proofs : list of CellProof or PlaneCellProof

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from nasm.proofs import proved_cells
    >>> rays = [(0.0, 0.5), (45.0, 0.7)]
    >>> states, proofs = proved_cells(two_kicks(), (0.75, 0.25), 0.0625, 1, rays, 1.0)
    >>> states.tolist(), len(proofs)
    ([[2, 2], [2, 2]], 1)
    """
    n, (low1, low2) = 2**depth, low
    failed = [] if failed is None else failed
    states = np.full((n, n), OPEN, np.int8)
    proofs: list[CellProof | PlaneCellProof] = []
    centre = low1 + size / 2, low2 + size / 2
    if not in_wedge(plane, *centre):
        return states, proofs
    corners = low1 + np.array([0, size, 0, size]), low2 + np.array([0, 0, size, size])
    distances = distance(plane, rays, *corners)
    if (distances > 0).all():
        return states, proofs
    nearest, limit = distances.max(), -_MIN_DISTANCE / max(seconds, 1.0)
    if nearest < limit and not any(size >= smaller and nearest >= at for smaller, at in failed):
        budget = seconds / (2 if depth else 1)
        proof, curve = _proved_square(plane, centre, size / 2, budget, curve, not depth)
        if proof.proved:
            return np.full_like(states, TRANSPORT), [proof]
        failed.append((size, nearest))
    if depth:
        # Beyond the boundary, the upper right quarter is the farthest from it.
        for i, j in (1, 1), (1, 0), (0, 1), (0, 0):
            quarter = low1 + j * size / 2, low2 + i * size / 2
            quarter_states, more = proved_cells(
                plane, quarter, size / 2, depth - 1, rays, seconds, failed, curve
            )
            block = slice(i * n // 2, (i + 1) * n // 2), slice(j * n // 2, (j + 1) * n // 2)
            states[block] = quarter_states
            proofs += more
    return states, proofs


def _proved_square(
    plane: Plane,
    centre: tuple[float, float],
    half_width: float,
    budget: float,
    curve: Curve | None,
    is_finest: bool,
) -> tuple[CellProof | PlaneCellProof, Curve | None]:
    """Try to prove transport in a square; also return the curve to try in its parts.

    If the proof on `curve` fails in one of the finest squares, a curve found for that square is
    tried.
    """
    if plane == two_kicks():
        return transport_cells.prove_cell(centre, half_width, budget), None
    prove = partial(transport_cells.prove_cell_of_plane, plane, centre, half_width, budget)
    proof = prove(curve)
    if curve and is_finest and not proof.proved:
        proof = prove(None)
    return proof, (proof.site, proof.points) if len(proof.points) else curve
