"""Starts that survive converse KAM longest, and the rotation numbers of their orbits.

Converse KAM eliminates every start beyond the breakup in a number of steps that grows as the
breakup is approached. The *longest-lived start* is close to the remains of the last circle, and the
weighted Birkhoff average of its orbit is a rotation number to about six digits: the nobles near it
are candidates for the last circle.
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

LONGEST_LIFETIME = 1.6
"""Steps, times the relative distance beyond the breakup, in which converse KAM eliminates all
starts: about twice those of `transversal.EXCESS_BOUNDS`, as some orbits linger."""


def longest_lived(kappa: ArrayLike, n_max: int, until: float = inf) -> LongestLived:
    """Find the start that converse KAM takes longest to eliminate.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    n_max : int
        Most steps (periods of the forcing).
    until : float
        The `time.thread_time` after which a start on a transversal counts as a survivor.

    Returns
    -------
    LongestLived
        Its kicks are inf if starts survive n_max steps on every line or transversal.

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
    """Find the start by `longest_lived`, and move it to the beginning of its period.

    Beyond the breakup it is close to the remains of the last circle.

    Returns
    -------
    x, y : float
        The start.
    steps : float
        Steps until it is eliminated; inf if starts survive n_max steps, of which this is one.

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

    The starts are on the dominant line or, if there is none, on a transversal. That is strong
    evidence, not a proof, that no circle exists.

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
    """Return the nobles close to the rotation number of an orbit, averaged over n steps.

    Parameters
    ----------
    kappa : ndarray, shape (P,)
        The forcing.
    start : LongestLived
        Start of the orbit.
    n : int
        Steps to average over.
    distance : float
        Of a noble from that average, in turns per period, at most. The average is good to six
        digits.
    number : int
        Most nobles to return of each kind, the simplest ones.

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
