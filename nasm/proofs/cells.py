"""Proofs of global transport in cells of the (κ1, κ2) plane, and of barriers in triangles.

`nasm.proofs.transport_cells` proves transport for all forcings of a cell; a cell for which the
proof fails is divided into four. `nasm.proofs.patches` proves that a barrier exists for all
forcings of a triangle with a corner at κ = 0.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nasm.proofs import transport_cells
from nasm.proofs.transport_cells import CellProof
from nasm.types import FloatArray

__all__ = ["distance", "proved_cells", "triangles"]

OPEN = 1
"""State of a cell for which nothing is proved."""

TRANSPORT = 2
"""State of a cell for which transport is proved to be global."""

# Minimum relative distance from the boundary for which a proof is tried if it may take 1 s; of 128
# closer cells only 2 were proved.
_MIN_DISTANCE = 0.003


def distance(rays: Sequence[Sequence[float]], kappa1: ArrayLike, kappa2: ArrayLike) -> FloatArray:
    """Estimate 1 - s/s_c of forcings with κ1, κ2 ≥ 0; it is negative beyond the breakup.

    The estimate is used only to choose which proof to try in a cell.

    Parameters
    ----------
    rays : sequence of (angle, scale)
        Angle in degrees, from 0 to 45, and scale s_c of the last breakup; between these angles, the
        scale is interpolated linearly.
    kappa1, kappa2 : array_like
        Non-negative strengths.

    Returns
    -------
    ndarray
        Distances, in the shape to which kappa1 and kappa2 broadcast.

    Examples
    --------
    >>> from nasm.proofs.cells import distance
    >>> float(distance([(0.0, 0.5), (45.0, 1.4)], 0.25, 0.0))
    0.5
    """
    angle = np.rad2deg(np.arctan2(np.minimum(kappa1, kappa2), np.maximum(kappa1, kappa2)))
    return 1 - np.hypot(kappa1, kappa2) / np.interp(angle, *np.transpose(rays))


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
    low: tuple[float, float],
    size: float,
    depth: int,
    rays: Sequence[Sequence[float]],
    seconds: float,
    failed: list[tuple[float, float]] | None = None,
) -> tuple[NDArray[np.int8], list[CellProof]]:
    """Prove global transport in the 4**depth cells of a square.

    1. Try a proof for the whole square, unless it is too close to the boundary.
    2. If that fails, divide the square into quarters, and begin with those far from the boundary.
    3. Once a proof has failed, skip squares that are no smaller and no farther from the boundary.

    Parameters
    ----------
    low : (float, float)
        κ1 and κ2 of the lower left corner, non-negative.
    size : float
        Width of the square; the corners of all cells must be multiples of 2⁻³⁰.
    depth : int
        Number of times that the width is halved.
    rays : sequence of (angle, scale)
        The boundary, as for `distance`.
    seconds : float
        CPU time for a proof in a cell of the finest level; larger squares get half of it.
    failed : list of (size, distance), optional
        Squares for which no proof of transport was found; used in recursive calls.

    Returns
    -------
    states : ndarray of int8, shape (2**depth, 2**depth)
        OPEN or TRANSPORT, indexed by κ2 and κ1. Cells with κ2 > κ1 are images of others;
        they stay OPEN unless they belong to a larger square for which transport is proved.
    proofs : list of CellProof

    Examples
    --------
    >>> from nasm.proofs import proved_cells
    >>> states, proofs = proved_cells((0.75, 0.25), 0.0625, 1, [(0.0, 0.5), (45.0, 0.7)], 1.0)
    >>> states.tolist(), len(proofs)
    ([[2, 2], [2, 2]], 1)
    """
    n, (low1, low2) = 2**depth, low
    failed = [] if failed is None else failed
    states = np.full((n, n), OPEN, np.int8)
    proofs: list[CellProof] = []
    if low2 >= low1 + size:
        return states, proofs
    centre = low1 + size / 2, low2 + size / 2
    corners = low1 + np.array([0, size, 0, size]), low2 + np.array([0, 0, size, size])
    distances = distance(rays, *corners)
    if (distances > 0).all():
        return states, proofs
    nearest, limit = distances.max(), -_MIN_DISTANCE / max(seconds, 1.0)
    if nearest < limit and not any(size >= smaller and nearest >= at for smaller, at in failed):
        proof = transport_cells.prove_cell(centre, size / 2, seconds / (2 if depth else 1))
        if proof.proved:
            return np.full_like(states, TRANSPORT), [proof]
        failed.append((size, nearest))
    if depth:
        # Beyond the boundary, the upper right quarter is the farthest from it.
        for i, j in (1, 1), (1, 0), (0, 1), (0, 0):
            quarter = low1 + j * size / 2, low2 + i * size / 2
            quarter_states, more = proved_cells(quarter, size / 2, depth - 1, rays, seconds, failed)
            block = slice(i * n // 2, (i + 1) * n // 2), slice(j * n // 2, (j + 1) * n // 2)
            states[block] = quarter_states
            proofs += more
    return states, proofs
