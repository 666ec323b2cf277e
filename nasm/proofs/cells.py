"""Where transport is proved to be global, in cells of the (κ1, κ2) plane; triangles with a barrier.

In a cell transport is proved for all forcings, by `nasm.proofs.transport_cells`; a cell for which
it is not is cut into four. A barrier is proved in triangles from κ = 0 on, by `nasm.proofs.fan`.
"""

import numpy as np

from nasm.proofs import transport_cells

__all__ = ["distance", "proved_cells", "triangles"]

OPEN, TRANSPORT = 1, 2  # states of a cell
_TOO_NEAR = 0.003  # to the boundary, in parts of it: of cells that near 2 of 128 are proved in 1 s


def distance(rays, kappa1, kappa2):
    """1 - s/s_c, about, of forcings of the first quadrant, negative beyond the breakup.

    rays : list of (angle in degrees, s_c), from 0 to 45 degrees. They only choose which proof to
    try in a cell.
    """
    angle = np.rad2deg(np.arctan2(np.minimum(kappa1, kappa2), np.maximum(kappa1, kappa2)))
    return 1 - np.hypot(kappa1, kappa2) / np.interp(angle, *np.transpose(rays))


def triangles(angles, scales, circles, sagitta):
    """Triangles from κ = 0 on that fill the region below the boundary, nearly.

    angles, scales : ndarrays (n,), of rays as of `distance`. circles : list of n, the last circles.
    sagitta : float; the boundary is that much nearer than the far side of a triangle at most, in
    parts, or else the triangle is of two neighbouring rays.

    Returns a list of (corner, corner, circles): far corners as two floats of 20 binary places,
    which neighbours share, and the one circle, or the two, to try.
    """
    points = np.stack([np.cos(np.deg2rad(angles)), np.sin(np.deg2rad(angles))], 1)
    corners = np.round(points * scales[:, None] * 2**20) / 2**20
    found, first = [], 0
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
        found.append((*corners[[first, last]].tolist(), both))
        first = last
    return found


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def proved_cells(low, size, depth, rays, seconds, failed=None):
    """What is proved in the 4**depth cells of a square: OPEN or TRANSPORT.

    low : κ1 and κ2 of its lower left corner, not negative. size : its width; all corners of cells
    must be multiples of 2⁻³⁰. rays : as of `distance`. seconds : CPU time for a proof in a finest
    cell; in larger ones half of it, as their quarters are tried next.
    failed : for itself, a list of (size, distance) of cells for which transport was not proved.

    Returns an int8 array (2**depth, 2**depth), index κ2, κ1, and the list of the proofs. A square
    is proved whole if it can be, else by quarters, those far from the boundary first: where one
    fails, none as large that is nearer is tried. What lies in κ2 > κ1 is left OPEN: it is an image.
    """
    n, (low1, low2) = 2**depth, low
    failed = [] if failed is None else failed
    states, proofs = np.full((n, n), OPEN, np.int8), []
    if low2 >= low1 + size:
        return states, proofs
    centre = low1 + size / 2, low2 + size / 2
    corners = low1 + np.array([0, size, 0, size]), low2 + np.array([0, 0, size, size])
    near = distance(rays, *corners)
    if (near > 0).all():
        return states, proofs
    nearest, limit = near.max(), -_TOO_NEAR / max(seconds, 1.0)
    if nearest < limit and not any(size >= smaller and nearest >= at for smaller, at in failed):
        proof = transport_cells.prove_cell(centre, size / 2, seconds / (2 if depth else 1))
        if proof.proved:
            return np.full_like(states, TRANSPORT), [proof]
        failed.append((size, nearest))
    if depth:
        # Beyond the boundary the upper right quarters are the far ones.
        for i, j in (1, 1), (1, 0), (0, 1), (0, 0):
            quarter = low1 + j * size / 2, low2 + i * size / 2
            found, more = proved_cells(quarter, size / 2, depth - 1, rays, seconds, failed)
            states[i * n // 2 : (i + 1) * n // 2, j * n // 2 : (j + 1) * n // 2] = found
            proofs += more
    return states, proofs
