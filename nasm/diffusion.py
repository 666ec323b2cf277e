"""Diffusion: how fast does momentum spread, once transport is global?

    D = lim <(y_n - y_0)²> / 2n,     n in periods of the forcing, y in its own unit,

the mean over all starts of the cell 0 ≤ x, y < 1: islands count, as places from which nothing
spreads, so that a gradient of density drives the flux -D ∂ρ/∂y. For the standard map's p = 2πy,
whose <(p_n - p_0)²>/n is mostly printed, that is 8π²D. While a barrier exists D is 0.

What orbits do within a cell adds a constant to <(y_n - y_0)²>, so that D is the slope between lags
of n/8 and n/2. n is doubled until orbits are two units of y away, in root mean square. Where an
accelerator mode carries some orbits along, y ~ n, there is no D: the squares grow faster than n, or
one orbit is far ahead of all others. Strong kicks diffuse as Rechester & White foretell, Phys. Rev.
Lett. 44 (1980) 1586.
"""

from dataclasses import dataclass

import numpy as np

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import LANES
from nasm.checks import count
from nasm.critical import Status
from nasm.escape import MAX_STEPS, advance, ensemble, kick_series
from nasm.maps import forcing

__all__ = ["Diffusion", "diffusion"]

SHORTEST = 8192  # periods: at fewer an accelerator mode may not yet stand out
_SPREAD = 4.0  # mean square over the longer lag from which on there is an answer
_PARTS = 8  # of the time, at whose ends momenta are kept
_FASTER = 1.2  # exponent of n above which squares do not grow like n
_AHEAD = 100.0  # times the mean square: further than chance takes any orbit


@dataclass(frozen=True)
class Diffusion:
    """What an ensemble shows.

    value, error : D and its standard error by the scatter of orbits, in squares of y a period; NaN
        if status is not OK.
    status : OK, NOT_CONVERGED if n_max was too few, ANOMALOUS.
    """

    value: float
    error: float
    status: Status


def diffusion(kappa, n_orbits=1024, n_max=2**21):
    """D by an ensemble of orbits that start evenly in the cell.

    kappa : sequence of P floats, the forcing, first kick first. n_orbits : int, 64 to 10⁶.
    n_max : int, 8192 to 10¹², periods; D of 4/n_max or more are found. Returns a Diffusion.

    ValueError if an argument is out of range.
    """
    kicks = kick_series(forcing(kappa))
    n_orbits = count("n_orbits", n_orbits, 64, 10**6)
    n_max = count("n_max", n_max, SHORTEST, MAX_STEPS)
    x, y = ensemble(-(-n_orbits // LANES) * LANES)
    x, y = x - 0.25, y / 0.3
    momenta, part = [y.copy()], SHORTEST // _PARTS
    while True:
        while len(momenta) <= _PARTS:
            _iterate(kicks, x, y, part)
            momenta.append(y.copy())
        found = _measured(np.array(momenta), part)
        if found.status is not Status.NOT_CONVERGED or 2 * _PARTS * part > n_max:
            return found
        momenta, part = momenta[::2], 2 * part


def _measured(momenta, part):
    """The Diffusion that momenta at the ends of equal parts of the time show."""
    lag = _PARTS // 2
    far, near = (np.mean((momenta[n:] - momenta[:-n]) ** 2, axis=0) for n in (lag, 1))
    slopes = (far - near) / (2 * part * (lag - 1))
    if far.mean() < _SPREAD:
        return Diffusion(np.nan, np.nan, Status.NOT_CONVERGED)
    if far.mean() > lag**_FASTER * near.mean() or far.max() > _AHEAD * far.mean():
        return Diffusion(np.nan, np.nan, Status.ANOMALOUS)
    return Diffusion(slopes.mean(), slopes.std(ddof=1) / slopes.size**0.5, Status.OK)


@kernel
def _iterate(c, x, y, n):
    """n periods of all orbits, a multiple of the lanes, in place."""
    reach = np.empty(LANES)
    for start in range(0, x.size, LANES):
        advance(c, x, y, start, n, reach)
