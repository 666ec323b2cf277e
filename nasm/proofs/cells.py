"""Both sides of the boundary, proved in cells of the (κ1, κ2) plane.

In a cell a barrier, or transport, is proved for all forcings, by `nasm.proofs.barrier_cells` or
`nasm.proofs.transport_cells`; a cell for which neither is proved is cut into four.
"""

from dataclasses import dataclass, field

import numpy as np

from nasm.numbers import RotationNumber, parse
from nasm.proofs import barrier_cells, transport_cells

__all__ = ["Boundary", "proved_cells"]
__dir__ = __all__.copy

OPEN, TRANSPORT, BARRIER = 1, 2, 3  # states of a cell
_WIDEST, _NARROWER = 0.2, 1.5  # half widths, in distances, for which one polynomial is enough
_NEAREST = 0.03  # of the way to the breakup is too near for `barrier_cells`


@dataclass(frozen=True)
class Boundary:
    """Approximate boundary from a few rays. It only chooses which proof to try in a cell.

    angles : ndarray (n,), degrees, rising from 0 to 45. scales : ndarray (n,). circles : list of n
    RotationNumbers of the last circles, for a period of two kicks; None where none is known.
    """

    angles: np.ndarray = field(repr=False)
    scales: np.ndarray = field(repr=False)
    circles: list[RotationNumber | None] = field(repr=False)

    def distance(self, kappa1, kappa2):
        """1 - s/s_c of forcings of the first quadrant, negative beyond the breakup, and s_c."""
        angle = np.rad2deg(np.arctan2(np.minimum(kappa1, kappa2), np.maximum(kappa1, kappa2)))
        critical = np.interp(angle, self.angles, self.scales)
        return 1 - np.hypot(kappa1, kappa2) / critical, critical

    def circle(self, kappa1, kappa2):
        """The last circle of the nearest ray."""
        angle = np.rad2deg(np.arctan2(min(kappa1, kappa2), max(kappa1, kappa2)))
        return self.circles[np.abs(self.angles - angle).argmin()]


def warm_up_cells():
    """Compile what `proved_cells` needs: its proofs are given CPU time, and that would count."""
    transport_cells.prove_cell((1.0, 0.5), 2.0**-8)
    barrier_cells.prove_cell(parse("gamma"), (0.1, 0.05), 2.0**-8)


def barrier_size(distance, critical):
    """Half the width of the largest cell for which a barrier may be proved, 0 where none can be."""
    size = distance * critical * np.minimum(_WIDEST, _NARROWER * distance)
    return np.where(distance > _NEAREST, size, 0)


def proved_cells(low, size, depth, boundary, seconds, failed=None):
    """What is proved in the 4**depth cells of a square: OPEN, TRANSPORT or BARRIER.

    low : κ1 and κ2 of its lower left corner, not negative. size : its width; all corners of cells
    must be multiples of 2⁻³⁰. boundary : a Boundary. seconds : CPU time for a proof of transport in
    a finest cell; in larger ones half of it, as their quarters are tried next.
    failed : for itself, a list of (size, distance) of cells for which transport was not proved.

    Returns an int8 array (2**depth, 2**depth), index κ2, κ1, and the list of the proofs. A square
    is proved whole if it can be, else by quarters, those far from the boundary first: where one
    fails, none as large that is nearer is tried. What lies in κ2 > κ1 is left OPEN: it is an image.
    ImportError without python-flint.
    """
    n, (low1, low2) = 2**depth, low
    failed = [] if failed is None else failed
    states, proofs = np.full((n, n), OPEN, np.int8), []
    if low2 >= low1 + size:
        return states, proofs
    centre = low1 + size / 2, low2 + size / 2
    corners = low1 + np.array([0, size, 0, size]), low2 + np.array([0, 0, size, size])
    distance, critical = boundary.distance(*corners)
    if (nearest := distance.max()) < 0:
        if not any(size >= smaller and nearest >= near for smaller, near in failed):
            proof = transport_cells.prove_cell(centre, size / 2, seconds / (2 if depth else 1))
            if proof.proved:
                return np.full_like(states, TRANSPORT), [proof]
            failed.append((size, nearest))
    elif (distance > 0).all():
        circle = boundary.circle(*centre)
        if circle is None or not distance.max() > _NEAREST:
            return states, proofs
        if size / 2 <= barrier_size(distance, critical).min():
            proof = barrier_cells.prove_cell(circle, centre, size / 2)
            if proof.proved:
                return np.full_like(states, BARRIER), [proof]
    if depth:
        # Beyond the boundary the upper right quarters are the far ones.
        for i, j in (1, 1), (1, 0), (0, 1), (0, 0):
            quarter = low1 + j * size / 2, low2 + i * size / 2
            found, more = proved_cells(quarter, size / 2, depth - 1, boundary, seconds, failed)
            states[i * n // 2 : (i + 1) * n // 2, j * n // 2 : (j + 1) * n // 2] = found
            proofs += more
    return states, proofs
