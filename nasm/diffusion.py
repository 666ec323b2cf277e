"""Diffusion: the rate at which momentum spreads once transport is global.

    D = lim <(y_n - y_0)²> / 2n,     with n in periods of the forcing, and y as in `nasm.maps`,

where <…> is the mean over all starts in the cell 0 ≤ x, y < 1. The mean includes orbits in islands,
which do not spread; with this definition, a density gradient drives the flux -D ∂ρ/∂y. The
literature on the standard map usually quotes <(p_n - p_0)²>/n for p = 2πy, which is 8π²D. While a
barrier exists, D is 0.

Motion within a cell adds a constant to <(y_n - y_0)²>, so D is computed from the slope between lags
of n/8 and n/2. The time n is doubled until the root mean square of y_{n/2} - y_0 reaches 2. D does
not exist if an accelerator mode carries some orbits along, with y ~ n: then the squares grow faster
than n, or one orbit is far ahead of all others. For strong kicks, compare with Rechester & White,
Phys. Rev. Lett. 44 (1980) 1586.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import LANES
from nasm.checks import count
from nasm.escape import MAX_STEPS, advance, ensemble, kick_series
from nasm.maps import forcing
from nasm.results import Result, Status
from nasm.tables import html_table, status_text
from nasm.texts import rounded_value
from nasm.types import FloatArray

__all__ = ["Diffusion", "DiffusionSettings", "diffusion"]

MIN_PERIODS = 8192
"""Minimum n_max; in fewer periods, accelerator modes may not stand out from the other orbits."""


@dataclass(frozen=True)
class DiffusionSettings:
    """Criteria for deciding when an ensemble has spread far enough, and whether it diffuses.

    Attributes
    ----------
    n_parts : int
        Number of equal time intervals, a power of 2; momenta are recorded at the end of each.
        The longer lag spans half of the intervals, and the shorter lag spans one.
    min_mean_square : float
        n suffices once the mean square of the displacements over the longer lag reaches this value.
    max_growth_exponent : float
        Largest exponent of n in the growth of mean squares; faster growth is anomalous.
    max_square_ratio : float
        Largest ratio of the mean square displacement of one orbit to the mean over all orbits; in
        normal diffusion no orbit exceeds it by chance.

    Examples
    --------
    >>> from nasm.diffusion import DiffusionSettings, diffusion
    >>> settings = DiffusionSettings(min_mean_square=1e9)
    >>> diffusion((8.0,), 64, 8192, settings).status
    Status.NOT_CONVERGED
    """

    n_parts: int = 8
    min_mean_square: float = 4.0
    max_growth_exponent: float = 1.2
    max_square_ratio: float = 100.0


DEFAULT_SETTINGS = DiffusionSettings()


@dataclass(frozen=True, eq=False, repr=False)
class Diffusion(Result):
    """Diffusion constant of an ensemble.

    It prints on one line, with the digits that the error justifies; notebooks show it as a table.

    Attributes
    ----------
    value, error : float
        D and its standard error, from the scatter of orbits, in y² per period; NaN if
        status is not OK.
    status : Status
        OK, NOT_CONVERGED if n_max was too small, or ANOMALOUS.

    Examples
    --------
    >>> from nasm.results import Status
    >>> from nasm.diffusion import Diffusion
    >>> Diffusion(0.52314, 0.0123, Status.OK)
    Diffusion(0.523 ± 0.012 per period, OK)
    """

    value: float
    error: float
    status: Status

    def __repr__(self) -> str:
        return f"Diffusion({self._value()}, {status_text(self.status)})"

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        rows = {"D": self._value(), "status": status_text(self.status)}
        return html_table(rows, "Diffusion constant, in squares of y")

    def _value(self) -> str:
        if np.isnan(self.value):
            return "no value"
        return f"{rounded_value(self.value, self.error)} per period"


def diffusion(
    kappa: ArrayLike,
    n_orbits: int = 1024,
    n_max: int = 2**21,
    settings: DiffusionSettings = DEFAULT_SETTINGS,
) -> Diffusion:
    """Estimate D from an ensemble of orbits whose starts are spread evenly over the cell.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    n_orbits : int
        Number of orbits, 64 to 10⁶; it is rounded up to a multiple of 64.
    n_max : int
        Maximum number of periods, 8192 to 10¹². Values of D down to 4/n_max can be resolved.
    settings : DiffusionSettings
        Criteria for deciding when the ensemble has spread far enough, and whether it diffuses.

    Raises
    ------
    ValueError
        If an argument is out of range.

    Examples
    --------
    >>> from nasm.diffusion import diffusion
    >>> estimate = diffusion((8.0,), n_orbits=64)
    >>> print(0.3 < estimate.value < 1.0, estimate.status)
    True Status.OK
    """
    kicks = kick_series(forcing(kappa))
    n_orbits = count("n_orbits", n_orbits, 64, 10**6)
    n_max = count("n_max", n_max, MIN_PERIODS, MAX_STEPS)
    x, y = ensemble(-(-n_orbits // LANES) * LANES)
    x, y = x - 0.25, y / 0.3
    n_parts = settings.n_parts
    momenta, part = [y.copy()], MIN_PERIODS // n_parts
    while True:
        while len(momenta) <= n_parts:
            _iterate(kicks, x, y, part)
            momenta.append(y.copy())
        estimate = _estimate(np.array(momenta), part, settings)
        if estimate.status is not Status.NOT_CONVERGED or 2 * n_parts * part > n_max:
            return estimate
        momenta, part = momenta[::2], 2 * part


def _estimate(momenta: FloatArray, part: int, settings: DiffusionSettings) -> Diffusion:
    """Estimate D from momenta at the ends of equal time intervals."""
    lag = settings.n_parts // 2
    long, short = (np.mean((momenta[n:] - momenta[:-n]) ** 2, axis=0) for n in (lag, 1))
    slopes = (long - short) / (2 * part * (lag - 1))
    if long.mean() < settings.min_mean_square:
        return Diffusion(np.nan, np.nan, Status.NOT_CONVERGED)
    grows_faster = long.mean() > lag**settings.max_growth_exponent * short.mean()
    if grows_faster or long.max() > settings.max_square_ratio * long.mean():
        return Diffusion(np.nan, np.nan, Status.ANOMALOUS)
    error = slopes.std(ddof=1) / slopes.size**0.5
    return Diffusion(float(slopes.mean()), float(error), Status.OK)


@kernel
def _iterate(c, x, y, n):
    """Advance all orbits by n periods, in place; their number is a multiple of LANES."""
    reach = np.empty(LANES)
    for start in range(0, x.size, LANES):
        advance(c, x, y, start, n, reach)
