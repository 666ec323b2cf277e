"""Numbers that are the same, to the last bit, on processors of different kinds.

NumPy computes exp, log, powers and `geomspace` of arrays by other formulas where a processor has
AVX-512, and BLAS adds the products of a matrix product in an order that suits the processor. The
functions of `math`, which kernels call too, do neither. What cubes hold, and where they hold it, is
computed without those functions of NumPy and without matrix products; proofs, whose results depend
on the time that they may take, are not concerned. It holds for processors of x86-64 with AVX2 and
FMA, and one version of the C library.
"""

import numpy as np

__all__ = ["geometric", "powers"]


def geometric(first, last, n):
    """n numbers in equal ratios, from first to last, both positive: `np.geomspace`."""
    first, last = float(first), float(last)
    between = [first * (last / first) ** (i / (n - 1)) for i in range(1, n - 1)]
    return np.array([first, *between, last][:n])


def powers(values, exponent):
    """The ndarray values**exponent, for a few numbers: it takes 0.1 µs for each."""
    return np.array([value**exponent for value in np.asarray(values, float).tolist()])
