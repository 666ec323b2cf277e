"""Errors of each method against its effort, on rays whose breakup is known."""

import numpy as np
import xarray as xr

from nasm import barriers, circles, periodic
from nasm.converse_kam import symmetry_line
from nasm.symmetries import ray
from workflows.shared.direct import exponent
from workflows.shared.tables import ANGLE, dataset, listed

ANGLES = (0.0, 20.0, 40.0, 45.0)


def breakups():
    """Find the CriticalScale of the last barrier on each ray, {angle: scale}, to judge by."""
    return {angle: barriers.critical_scale(ray(angle), 1e-3) for angle in ANGLES}


def exponents(bias):
    """Fit η and its error on each ray, {angle: (η, error)}, for the largest ensemble."""
    largest = bias.isel(ensemble=-1)
    return {angle: exponent(bias.n.values, largest.sel(angle=angle).values) for angle in ANGLES}


def on_the_diagonal(bias, critical):
    """Fit η to κ_N - κ_c on (κ, κ), Fig. 7, for the lower and for the upper half of N.

    bias : of `direct_bias`, with the angle 45. critical : scale of the breakup there.
    """
    kappa_c = critical * np.sqrt(0.5)
    distance = kappa_c * bias.sel(angle=45.0).isel(ensemble=-1).transpose("n").values
    n = bias.n.values
    upper, fits, power_law = n > np.sqrt(float(n[0]) * float(n[-1])), [], np.full(n.size, np.nan)
    for half in (~upper, upper):
        fits.append(exponent(n[half], distance[half]))
        if np.isfinite(eta := fits[-1][0]):
            offset = np.nanmean(np.log(distance[half]) + np.log(n[half]) / eta)
            power_law[half] = np.exp(offset) * n[half] ** (-1 / eta)
    eta, error = np.transpose(fits)
    variables = {
        "distance": ("n", distance, "κ_N - κ_c on the diagonal (κ, κ)"),
        "fit": ("n", power_law, "C N^(-1/η), of its half"),
        "upper_half": ("n", upper.astype("int8"), "whether N is in the upper half"),
        "eta": ("half", eta, "η of κ_N - κ_c ~ N^(-1/η)"),
        "eta_error": ("half", error, "standard error of η"),
    }
    coords = {"n": (n, "steps N"), "half": listed("half", "small N", "large N")}
    attrs = {"critical": float(kappa_c), "n_orbits": int(bias.ensemble[-1])}
    attrs["source"] = "arXiv:1606.04824, Fig. 7"
    title = "Convergence of direct iteration at the cusp of the horn"
    return dataset(title, coords, variables, attrs)


def other_methods(breakups, quick):
    """Measure the errors of the other methods: a Dataset with dims angle and steps, q or modes."""
    steps = 10 ** np.arange(2, 5 if quick else 6)
    modes = 2 ** np.arange(7, 11 if quick else 14)
    title = "Convergence of converse KAM, residues and circles"
    words = "error in parts of the breakup"
    rows, coords = [], {"steps": (steps, "steps N"), "modes": (modes, "grid points n")}
    for angle, best in breakups.items():
        found = [symmetry_line.critical_scale(ray(angle), int(n)) for n in steps]
        raw = [scale.upper / best.value - 1 for scale in found]
        corrected = [abs(scale.value / best.value - 1) for scale in found]
        q, scales = periodic.crossings(best.omega, ray(angle), 2000 if quick else 20_000)
        last = [_last_certified(best, ray(angle), int(n)) / best.value for n in modes]
        row = {
            "cones_raw": ("steps", raw, words),
            "cones_corrected": ("steps", corrected, words),
            "residue": ("q", np.abs(scales / best.value - 1), words),
            "circles_raw": ("modes", 1 - np.array(last), words),
        }
        rows.append(dataset(title, coords | {"q": (q.astype(int), "period")}, row))
    angles = xr.DataArray(list(breakups), dims="angle", name="angle", attrs=ANGLE)
    return xr.concat(rows, angles, join="outer")


def _last_certified(best, profile, n):
    """Find the largest scale below the breakup, to 1% of its distance, with a certified circle."""
    inside, outside = 0.5, 1.0
    while outside - inside > 0.01 * (1 - inside):
        middle = (inside + outside) / 2
        circle = circles.invariant_circle(best.omega, middle * best.value * profile, n_max=n)
        inside, outside = (middle, outside) if circle.certified else (inside, middle)
    return inside * best.value
