"""The exponent of a power law, from measured points."""

import numpy as np

FLUX = 3.01172
"""ln αβ/ln δ of the flux through the golden circle beyond its breakup, by MacKay's constants."""


def exponent(x, y):
    """Fit y ~ x^a by a straight line through the logarithms: a and its standard error.

    x, y : arrays (n,), positive; NaN and inf in y are left out. NaN, twice, of fewer than 4 points.
    """
    known = np.isfinite(y)
    if known.sum() < 4:
        return np.nan, np.nan
    (slope, _), covariance = np.polyfit(np.log(x[known]), np.log(y[known]), 1, cov=True)
    return slope, np.sqrt(covariance[0, 0])
