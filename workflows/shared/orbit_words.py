"""What one orbit is, in plain words."""

from fractions import Fraction

import numpy as np

from nasm import fixed_points, orbits

_AVERAGED = 10_000  # steps of the orbit
_LARGEST = 100  # q of p/q that an orbit is said to belong to
_CLOSES = 1e-9  # turns, by which a periodic orbit may miss its start


def orbit_words(kappa, x, y):
    """Say by weighted Birkhoff averages whether an orbit is chaotic, on a circle, or on islands.

    An orbit that comes back to its start (x, y) has its residue told, too.
    """
    omega, digits = (float(found) for found in orbits.rotation_number(kappa, x, y, _AVERAGED))
    if np.isnan(omega):
        return f"chaotic (averages over {_AVERAGED} steps agree to {digits:.1f} digits)"
    places = int(digits)
    words = f"ω = {omega:.{places}f} per step, regular ({places} digits, by Birkhoff averages)"
    near = Fraction(omega).limit_denominator(_LARGEST)
    if abs(omega - float(near)) > 10.0**-places:
        return f"{words}, a circle"
    whole = np.tile(kappa, near.denominator)
    away = np.diff(orbits.orbit(whole, x, y, 1))
    if np.hypot(*(away - np.rint(away))) > _CLOSES:
        return f"{words}, on the islands of {near}"
    return f"{words}, periodic with {near}: {residue_words(fixed_points.residue(whole, x, y))}"


def residue_words(residue):
    """Say what Greene's residue says of stability."""
    if abs(residue) < 1e-12:
        return f"residue {residue:.1g}, parabolic"
    kind = "elliptic" if 0 < residue < 1 else "hyperbolic" + " with reflection" * bool(residue >= 1)
    return f"residue {residue:.6g}, {kind}"
