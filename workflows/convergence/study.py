"""The exponent η of direct iteration on rays whose breakup is known."""

import numpy as np

from nasm import barriers
from pipeline.cubes.cube import text
from workflows.shared.direct_iteration import exponent
from workflows.shared.tables import dataset


def breakups(plane, angles):
    """Return {angle: scale of the last breakup}; raise ValueError if a breakup is unknown."""
    plane.rays_start_at_zero("the convergence of direct iteration")
    scales = {}
    for angle in angles:
        found = barriers.critical_scale(plane.ray(angle)[1], 1e-3)
        if np.isnan(found.value):
            raise ValueError(
                f"--angle {angle:g}: the breakup is unknown; choose another ray "
                f"({found.status.value})"
            )
        scales[angle] = found.value
    return scales


def on_the_diagonal(bias, critical):
    """Fit η to κ_N - κ_c on the diagonal (Fig. 7), for small and for large N separately.

    bias : result of `direct_bias`, including the angle 45°. critical : scale of the breakup at 45°.
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
        "fit": ("n", power_law, "C N^(-1/η), fitted to the half that contains N"),
        "upper_half": ("n", upper.astype("int8"), "whether N is in the upper half"),
        "eta": ("half", eta, "η in κ_N - κ_c ~ N^(-1/η)"),
        "eta_error": ("half", error, "standard error of η"),
    }
    coords = {"n": (n, "steps N"), "half": text("half", ["small N", "large N"], "range of N")}
    attrs = {"critical": float(kappa_c), "n_orbits": int(bias.ensemble[-1])}
    attrs["references"] = "arXiv:1606.04824, Fig. 7"
    title = "Convergence of direct iteration at the cusp"
    return dataset(title, coords, variables, attrs)
