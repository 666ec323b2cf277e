"""Roots of functions of one variable, by Chandrupatla's method (Adv. Eng. Software 28 (1997) 145).

The root stays between two points at which the function has opposite signs. The next point is found
by inverse quadratic interpolation if the last three points are suitable, and by bisection
otherwise. The method evaluates the function about as often as Brent's method in scipy.optimize, a
module that takes 0.3 s to import.
"""

from collections.abc import Callable
from math import ulp

__all__ = ["root"]


def root(
    f: Callable[[float], float], a: float, b: float, tol: float = 1e-12, max_steps: int = 100
) -> float:
    """Find x between a and b with f(x) = 0, to within tol.

    Parameters
    ----------
    f : callable
        A function of one float.
    a, b : float
        Points at which f has opposite signs.
    tol : float
        Absolute error.
    max_steps : int
        Maximum number of steps. After max_steps + 2 evaluations of f, the end of the bracket with
        the smaller |f| is returned.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        If f has the same sign at a and b, or is NaN at one of them.

    Examples
    --------
    >>> from nasm.arithmetic.roots import root
    >>> round(root(lambda x: x**2 - 2, 0.0, 2.0), 10)
    1.4142135624
    """
    at_a, at_b = f(a), f(b)
    if not min(at_a, at_b) <= 0 <= max(at_a, at_b):
        raise ValueError(f"f({a}) = {at_a} and f({b}) = {at_b} must have different signs")
    c, at_c, fraction = a, at_a, 0.5
    for _ in range(max_steps):
        best, at_best = (a, at_a) if abs(at_a) < abs(at_b) else (b, at_b)
        margin = (tol + 2 * ulp(best)) / abs(b - a)
        if at_best == 0 or margin > 0.5:
            break
        x = a + min(max(fraction, margin), 1 - margin) * (b - a)
        at_x = f(x)
        if (at_x > 0) == (at_a > 0):
            c, at_c = a, at_a
        else:
            b, at_b, c, at_c = a, at_a, b, at_b
        a, at_a = x, at_x
        xi, phi = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
        fraction = 0.5
        if phi**2 < xi and (1 - phi) ** 2 < 1 - xi:
            fraction = at_a / (at_b - at_a) * at_c / (at_b - at_c)
            fraction += (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
    return a if abs(at_a) < abs(at_b) else b
