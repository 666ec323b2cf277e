"""The flux beyond the breakup, ΔW ~ (s/s_c - 1)^η, and a fit of η."""

import numpy as np
import xarray as xr

from workflows.shared import power_law
from workflows.shared.rays import with_degenerate


def law(excess, flux):
    """Fit flux = C·x^η·exp(bx + cx²) by least squares in log flux; x is the excess, up to 3%.

    The exponential contains the first corrections to the law: without them the fitted η is 0.01 too
    small, and without c it is 10⁻⁵ too small. Return C, η and their standard errors from the
    fit; all are NaN if there are too few points.
    """
    known = np.isfinite(flux) & (flux > 0) & (excess <= 0.031)
    if known.sum() < 6:
        return np.full(4, np.nan)
    x, right = excess[known], np.log(flux[known])
    matrix = np.stack([np.ones_like(x), np.log(x), x, x**2], axis=1)
    found, residual, *_ = np.linalg.lstsq(matrix, right)
    spread = residual / (x.size - found.size)
    errors = np.sqrt(spread * np.diag(np.linalg.inv(matrix.T @ matrix)))
    amplitude = np.exp(found[0])
    return amplitude, found[1], amplitude * errors[0], errors[1]


def laws(fluxes):
    """Fit `law` on each ray, and return a Dataset with the dim angle."""
    fits = np.transpose([law(fluxes.excess.values, row.values) for row in fluxes.flux])
    names = "amplitude", "exponent", "amplitude_error", "exponent_error"
    columns = {name: ("angle", fit) for name, fit in zip(names, fits, strict=True)}
    named = map(with_degenerate, fluxes.circle.values.tolist(), fluxes.angle.values)
    columns["circle_and_tie"] = ("angle", list(named))
    coords = {"angle": fluxes.angle, "circle": fluxes.circle}
    return xr.Dataset(columns, coords, {"predicted_exponent": power_law.FLUX})
