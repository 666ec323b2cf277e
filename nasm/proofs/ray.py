"""A barrier exists under every forcing of a ray up to a scale: κ = s·profile, 0 ≤ s ≤ s_1.

Cells of `nasm.proofs.barrier_cells`, one behind the other. On the ray |κ_j - k_j| ≤ h holds for

    max_j (k_j/p_j - h/|p_j|) ≤ s ≤ min_j (k_j/p_j + h/|p_j|),     p = profile,

in exact fractions, and each cell begins before the one in front of it ends. So no weaker kicks are
left out: that a circle might break and come back on the way is ruled out for these s.
"""

import time
from fractions import Fraction
from math import nan

import numpy as np

from nasm.checks import real
from nasm.maps import direction
from nasm.numbers import checked, moebius
from nasm.proofs.barrier_cells import prove_cell
from nasm.proofs.cells import barrier_size

__all__ = ["covered", "proved_below"]
__dir__ = __all__.copy

_ROUNDED = Fraction(1, 2**50)  # of the scale: by more than s·profile in floats leaves the ray
_OVERLAP = 1e-3  # of a cell's half width
_SMALLEST = 0.02  # of the half width that is tried first,
_LEAST = 1e-4  # and of the breakup: smaller cells would be too many


def proved_below(omega, profile, value, budget):
    """The scale up to which the circle of omega is proved to exist on all of a ray, from 0 on.

    Parameters
    ----------
    omega : RotationNumber or its text, for a period of the profile, irrational.
    profile : sequence of P floats, not all 0.
    value : float > 0, where the circle breaks, e.g. by `periodic.critical_scale`. It says only how
        large a cell to try.
    budget : float, CPU seconds after which no other cell is begun. 10 s reach 0.9 of the breakup
        or more, 40 s 0.96, where the cells' rounding ends it.

    Returns
    -------
    scale : float; a circle exists under s·profile, exact or rounded to floats, for 0 ≤ s ≤ scale.
        NaN for three kicks and more, of which there are no cells.
    proofs : list of BarrierCellProof, by which it does, with their certificates.

    ImportError without python-flint; ValueError for a bad argument.
    """
    omega, profile = checked(omega), direction(profile)
    value, budget = real("value", value), real("budget", budget)
    if not value > 0:
        raise ValueError(f"value={value!r} must be positive: the scale at which the circle breaks")
    if profile.size > 2:
        return nan, []
    if profile.size == 1:
        profile, omega = np.repeat(profile, 2), moebius(omega, 2, 0)
    critical, largest = value * np.hypot(*profile), np.abs(profile).max()
    reached, proofs, part, until = 0.0, [], 1.0, time.thread_time() + budget
    while part > _SMALLEST and time.thread_time() < until:
        half_width = 0.0  # of the largest cell that its far end, at its distance, allows
        for _ in range(20):
            distance = 1 - (reached + 2 * half_width / largest) / value
            half_width = (half_width + float(barrier_size(distance, critical))) / 2
        half_width *= part
        if half_width < _LEAST * critical:
            break
        centre = (reached + (1 - _OVERLAP) * half_width / largest) * profile
        proof = prove_cell(omega, centre, half_width)
        further = covered([(p.kappa, p.half_width) for p in (*proofs, proof)], profile)
        if proof.proved and further > reached:
            reached, part = further, min(1.0, 1.2 * part)
            proofs.append(proof)
        else:
            part /= 2
    return reached, proofs


def covered(cells, profile):
    """The scale up to which all s·profile, exact or rounded to floats, are in one of the cells.

    cells : list of (kappa, half_width), nearer ones first. profile : as many floats.
    """
    reached = Fraction()
    for kappa, half_width in cells:
        low, high = _on_ray(kappa, half_width, profile)
        if low <= reached * (1 - 2 * _ROUNDED):
            reached = max(reached, high)
    return float(reached * (1 - 2 * _ROUNDED))


def _on_ray(kappa, half_width, profile):
    """Fractions s between which s·profile is in the cell; the first is larger if it is nowhere."""
    parts = [(Fraction(k), Fraction(p)) for k, p in zip(kappa, profile, strict=True)]
    h = Fraction(half_width)
    if any(p == 0 and abs(k) > h for k, p in parts):
        return Fraction(1), Fraction(0)
    low = max(k / p - h / abs(p) for k, p in parts if p)
    high = min(k / p + h / abs(p) for k, p in parts if p)
    return low, high
