"""Roots of functions of one number, by Chandrupatla's method (Adv. Eng. Software 28 (1997) 145).

The root stays between two points at which the function has opposite signs. The next point is by
inverse quadratic interpolation where the last three lie well for it, and halfway elsewhere. It asks
for about as many values as Brent's method, whose home, scipy.optimize, takes 0.3 s to import.
"""

__all__ = ["root"]

_SPACING = 4e-16  # of numbers, in parts of them


def root(f, a, b, tol=1e-12, most=100):
    """Return x between a and b with f(x) = 0, to within tol, or the best of `most` + 2 values of f.

    ValueError if f has the same sign at a and b, or is NaN there.
    """
    at_a, at_b = f(a), f(b)
    if not min(at_a, at_b) <= 0 <= max(at_a, at_b):
        raise ValueError(f"f({a}) = {at_a} and f({b}) = {at_b} must have different signs")
    c, at_c, part = a, at_a, 0.5
    for _ in range(most):
        best, least = (a, at_a) if abs(at_a) < abs(at_b) else (b, at_b)
        near = (tol + _SPACING * abs(best)) / abs(b - a)
        if least == 0 or near > 0.5:
            break
        x = a + min(max(part, near), 1 - near) * (b - a)
        at_x = f(x)
        if (at_x > 0) == (at_a > 0):
            c, at_c = a, at_a
        else:
            b, at_b, c, at_c = a, at_a, b, at_b
        a, at_a = x, at_x
        xi, phi = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
        part = 0.5
        if phi**2 < xi and (1 - phi) ** 2 < 1 - xi:
            part = at_a / (at_b - at_a) * at_c / (at_b - at_c)
            part += (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
    return a if abs(at_a) < abs(at_b) else b
