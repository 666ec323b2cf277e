"""Arguments that several modules take, checked at the edge: the kernels behind it trust them."""

from numbers import Integral

import numpy as np


def count(name, value, low, high):
    """`value` as an int; ValueError unless it is a whole number from low to high."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"{name}={value!r} must be a whole number from {low} to {high}")
    return int(value)


def points(x, y):
    """x and y as finite float arrays of one shape; ValueError otherwise."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    try:
        x, y = np.broadcast_arrays(x, y)
    except ValueError:
        raise ValueError(
            f"x and y have shapes {x.shape} and {y.shape}, which do not broadcast together"
        ) from None
    for name, values in (("x", x), ("y", y)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} is not finite; initial conditions must be finite numbers")
    return x, y
