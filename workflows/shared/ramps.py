"""Ramps κ_n = κ_G + r·n through the breakup of the golden circle; lifetimes on lines of starts."""

from collections.abc import Callable

import numpy as np

from nasm.circles.continuation import UNSTABLE_EIGENVALUES
from nasm.converse_kam import aperiodic
from nasm.numbers import parse
from nasm.types import FloatArray

_GOLDEN = float(parse("gamma"))
EXPONENT = np.log(_GOLDEN) / (np.log(_GOLDEN) - np.log(UNSTABLE_EIGENVALUES[1,]))
"""Predicted exponent 0.497: graphs are excluded after ~ r^-0.497 kicks.

As κ - κ_G shrinks by a factor δ, times grow by a factor 1/γ, and r shrinks by a factor δ/γ.
"""

_PLACES = np.array([0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3])
"""Positions of the lines, in units of r^-0.497 kicks."""

Lifetime = Callable[[FloatArray, int], float]
"""Maps (kappa, site) to the number of kicks that eliminate all starts on the line before `site`."""


def lines(rate: float) -> list[int]:
    """Return the kicks before which lines of starts are searched; kick 0 has the strength κ_G."""
    return np.unique(np.rint(_PLACES * rate**-EXPONENT).astype(int)).tolist()


def longest_lived(kappa: FloatArray, site: int, effort: int = 1) -> float:
    """Return the longest lifetime on a line, as found by `nasm.converse_kam.aperiodic`."""
    return aperiodic.longest_lived(kappa, 0.0, site, effort)[2]


def lost(critical: float, rate: float, lifetime: Lifetime = longest_lived) -> float:
    """Return the number of kicks after κ_G until all graphs are excluded, minimized over lines.

    Parameters
    ----------
    critical : float
        κ_G, the strength of kick 0.
    rate : float
        Growth of κ per kick.
    lifetime : callable
        Function that computes the lifetime on a line.
    """
    reach = int(5 * rate**-EXPONENT)
    n = np.arange(-reach, reach + 1, dtype=np.float64)
    return min(site + lifetime(critical + rate * (n + site), reach) for site in lines(rate))
