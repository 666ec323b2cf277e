"""The exponent of a power law, from measured points."""

import numpy as np

from nasm.types import FloatArray

FLUX = 3.01172
"""Exponent ln αβ/ln δ of the flux through the broken golden circle, from MacKay's constants."""


def exponent(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Fit y ~ x^a by a straight line through the logarithms.

    Parameters
    ----------
    x, y : arrays, shape (n,)
        Positive numbers; NaN and inf in y are ignored.

    Returns
    -------
    a, error : float
        The exponent and its standard error; NaN for fewer than 4 points.
    """
    known = np.isfinite(y)
    if known.sum() < 4:
        return np.nan, np.nan
    (slope, _), covariance = np.polyfit(np.log(x[known]), np.log(y[known]), 1, cov=True)
    return slope, np.sqrt(covariance[0, 0])
