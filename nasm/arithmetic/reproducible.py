"""Functions whose results agree to the last bit on different kinds of processors.

NumPy computes exp, log, powers and `geomspace` of arrays by different formulas on processors with
AVX-512, and BLAS adds the terms of a matrix product in an order that depends on the processor. The
functions of `math`, which kernels also call, are not affected. The values and coordinates of cubes
are computed without these NumPy functions and without matrix products, except for proofs, whose
results depend on computing time anyway. Values and coordinates agree on all x86-64 processors with
AVX2 and FMA, given the same version of the C library.
"""

import numpy as np
from numpy.typing import ArrayLike

from nasm.types import FloatArray

__all__ = ["geometric", "powers"]


def geometric(first: float, last: float, n: int) -> FloatArray:
    """Return n positive numbers in geometric progression from first to last, like `np.geomspace`.

    Examples
    --------
    >>> from nasm.arithmetic.reproducible import geometric
    >>> geometric(1, 4, 3)
    array([1., 2., 4.])
    """
    first, last = float(first), float(last)
    between = [first * (last / first) ** (i / (n - 1)) for i in range(1, n - 1)]
    return np.array([first, *between, last][:n])


def powers(values: ArrayLike, exponent: float) -> FloatArray:
    """Compute values**exponent; meant for a few numbers, since each takes 0.1 µs.

    Examples
    --------
    >>> from nasm.arithmetic.reproducible import powers
    >>> powers([1.0, 4.0], 0.5)
    array([1., 2.])
    """
    return np.array([value**exponent for value in np.asarray(values, float).tolist()])
