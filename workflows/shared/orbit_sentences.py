"""One orbit described in a sentence."""

from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from nasm import fixed_points, orbits

_STEPS = 10_000  # number of steps over which an orbit is averaged
_MAX_Q = 100  # islands of orbits with ω = p/q are recognized up to this q
_CLOSURE = 1e-9  # maximum distance from the end of a periodic orbit to its start, in turns


def describe_orbit(kappa: ArrayLike, x: float, y: float) -> str:
    """Describe in words whether the orbit from (x, y) is chaotic, on a circle or in islands.

    The classification uses weighted Birkhoff averages. For a periodic orbit the text also
    states the residue.
    """
    averages = orbits.rotation_number(kappa, x, y, _STEPS)
    omega, digits = (float(average) for average in averages)
    if np.isnan(omega):
        return f"chaotic (averages over {_STEPS} steps agree to {digits:.1f} digits)"
    places = int(digits)
    text = f"ω = {omega:.{places}f} per step, regular ({places} digits, by Birkhoff averages)"
    fraction = Fraction(omega).limit_denominator(_MAX_Q)
    if abs(omega - float(fraction)) > 10.0**-places:
        return f"{text}, a circle"
    repeated = np.tile(kappa, fraction.denominator)
    distance = np.diff(orbits.orbit(repeated, x, y, 1))
    if np.hypot(*(distance - np.rint(distance))) > _CLOSURE:
        return f"{text}, in an island around a periodic orbit with ω = {fraction}"
    residue = float(fixed_points.residue(repeated, x, y))
    return f"{text}, periodic with ω = {fraction}: {describe_residue(residue)}"


def describe_residue(residue: float) -> str:
    """Return Greene's residue and the stability that it implies, in words."""
    if abs(residue) < 1e-12:
        return f"residue {residue:.1g}, parabolic"
    kind = "elliptic" if 0 < residue < 1 else "hyperbolic" + " with reflection" * bool(residue >= 1)
    return f"residue {residue:.6g}, {kind}"
