"""Starts that survive converse KAM longest, and the rotation numbers of their orbits.

Beyond the breakup, converse KAM eliminates every start in a number of steps that grows as the
breakup is approached. The *longest-lived start* is close to the remains of the last circle, and the
weighted Birkhoff average of its orbit yields a rotation number to about six digits: the noble
numbers near this value are candidates for the last circle.
"""

from math import inf

import numpy as np
from numpy.typing import ArrayLike

from nasm.checks import real
from nasm.converse_kam import symmetry_line, transversal
from nasm.converse_kam.symmetry_line import LongestLived, has_dominant_line
from nasm.maps import forcing, unkick
from nasm.numbers import RotationNumber, nobles_near
from nasm.orbits import rotation_number
from nasm.symmetries import dominant_centre, half_shift_nobles
from nasm.types import FloatArray

__all__ = ["eliminates", "longest_lived", "longest_lived_start"]

LONGEST_LIFETIME = sum(transversal.EXCESS_BOUNDS)
"""At a relative distance ε beyond the breakup, converse KAM usually eliminates all starts within
LONGEST_LIFETIME/ε steps. This is twice the mean of the bounds, because some starts survive longer
than the bounds imply."""


def longest_lived(kappa: ArrayLike, n_max: int, until: float = inf) -> LongestLived:
    """Find the start that converse KAM takes longest to eliminate.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    n_max : int
        Maximum number of steps (periods of the forcing).
    until : float
        The `time.thread_time` at which the search over transversals stops; a start not yet
        eliminated then counts as a survivor.

    Returns
    -------
    LongestLived
        Its attribute `kicks` is inf if a start survives n_max steps on the dominant line or, if
        there is no such line, on every transversal tried.

    Examples
    --------
    >>> from nasm.survivors import longest_lived
    >>> longest_lived((1.2, 0.9), 1000).kicks < 1000
    True
    """
    kappa, until = forcing(kappa), real("until", until)
    if has_dominant_line(kappa):
        y, steps = symmetry_line.longest_lived(kappa, n_max)
        site, x = dominant_centre(kappa)
        return LongestLived(int(site), x, y, steps * kappa.size)
    return transversal.longest_lived(kappa, n_max, until)


def longest_lived_start(kappa: ArrayLike, n_max: int) -> tuple[float, float, float]:
    """Find the longest-lived start, and map it back to the beginning of the period.

    Beyond the breakup this start is close to the remains of the last circle.

    Returns
    -------
    x, y : float
        The start.
    steps : float
        Steps until the start is eliminated; inf if it survives n_max steps. Other starts may
        then survive, too.

    Examples
    --------
    >>> from nasm.survivors import longest_lived_start
    >>> x, y, steps = longest_lived_start((1.2, 0.9), 1000)
    >>> x, steps < 1000
    (0.5, True)
    """
    strengths = forcing(kappa)
    longest = longest_lived(strengths, n_max)
    x, y = longest.x, longest.y
    for strength in strengths[: longest.site][::-1]:
        x, y = unkick(strength, x, y)
    return float(x), float(y), float(longest.kicks / strengths.size)


def eliminates(kappa: ArrayLike, n_max: int) -> bool:
    """Return True if converse KAM eliminates all starts within n_max steps.

    The starts are on the dominant line or, if there is no such line, on a transversal. Their
    elimination is strong evidence, not a proof, that no circle exists.

    Examples
    --------
    >>> from nasm.survivors import eliminates
    >>> eliminates((1.2, 0.9), 1000), eliminates((0.3, 0.4), 1000)
    (True, False)
    """
    return bool(np.isfinite(longest_lived(forcing(kappa), n_max).kicks))


def candidates(
    kappa: FloatArray,
    start: LongestLived,
    n: int = 1000,
    distance: float = 2e-5,
    number: int = 3,
) -> list[RotationNumber]:
    """Return the noble numbers close to the rotation number of an orbit, averaged over n steps.

    Parameters
    ----------
    kappa : ndarray, shape (P,)
        The forcing.
    start : LongestLived
        Start of the orbit.
    n : int
        Steps to average over.
    distance : float
        Largest distance of a noble number from the average, in turns per period. The average is
        accurate to six digits.
    number : int
        Maximum number of noble numbers from `nobles_near`, and likewise from `half_shift_nobles`;
        the simplest are returned.

    Returns
    -------
    list of RotationNumber
        Empty if the average has not converged.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.survivors import candidates, longest_lived
    >>> kappa = np.array([0.972])
    >>> candidates(kappa, longest_lived(kappa, 100_000))[0]
    parse("[0;2,(1)]")
    """
    omega, _ = rotation_number(np.roll(kappa, -start.site), start.x, start.y, n)
    if not np.isfinite(omega):
        return []
    near = float(omega), distance, number
    return half_shift_nobles(kappa, *near) + nobles_near(*near)
