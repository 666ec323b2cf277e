"""The law of diffusion beyond the boundary, predicted from the flux, and the findings."""

import numpy as np
import xarray as xr

from workflows.shared.judgement import finding, span
from workflows.shared.power_law import FLUX as ETA

NEAREST = 1e-3  # distance beyond the breakup at which the flux determines the prefactor
_NEAR = 0.13  # distance up to which the exponent of D is fitted


def law(barrier, fluxes, measured):
    """Compare D with the flux: return `measured`, dims (angle, excess), with further variables.

    one_cantorus is ΔW divided by the number of last circles per unit of y: the circles of ω and
    2 - ω and, on the axes, the circles degenerate with these. ratio is D divided by one_cantorus;
    prefactor is one_cantorus/excess^3.01172 at the excess `NEAREST`, close to the breakup.
    """
    of_flux = fluxes.flux / xr.where(barrier.tied.sel(angle=fluxes.angle) != "", 4, 2)
    prefactor = of_flux.sel(excess=NEAREST, drop=True) / NEAREST**ETA
    found = {"one_cantorus": of_flux, "ratio": measured.diffusion / of_flux, "prefactor": prefactor}
    return measured.assign_coords(circle=fluxes.circle).assign(found)


def findings(law):
    """Judge the predictions; return lines of text."""
    ratio = law.ratio.sel(excess=slice(0, 1)).values
    ratio = ratio[np.isfinite(ratio)]
    first = law.ratio.isel(excess=law.ratio.notnull().argmax("excess")).values
    slope, error, rays = _exponent(law.sel(excess=slice(0, _NEAR)))
    prefactor = law.prefactor.dropna("angle")
    return "\n".join([
        finding(
            "the cantorus of the last circle is the only obstacle, D = ΔW/m, with m such cantori "
            "per unit of y",
            f"D is {span(ratio)} times ΔW/m under {ratio.size} forcings, up to twice the scale of "
            f"the breakup, and {span(first)} times at the forcings closest to the boundary where D "
            "is resolved; where this ratio is smaller, the cantori of other circles, which break "
            "at almost the same scale, are stronger obstacles",
            bool((abs(ratio - 1) < 0.2).all()),
            bool((ratio < 1.2).all()),
            ratio.size > 0,
        ),
        finding(
            f"D ~ (s/s_c - 1)^{ETA:.3g}",
            f"the exponent is {slope:.2f} ± {error:.2f} from 5% to {100 * _NEAR:.0f}% beyond the "
            f"breakup, from {rays} rays with at least two resolved values there; the prefactor of "
            f"ΔW/m is {span(prefactor.values)} along the boundary, largest at "
            f"{float(prefactor.idxmax('angle')) if prefactor.size else np.nan:g}°",
            rays > 2 and abs(slope - ETA) < 2 * error,
            abs(slope - ETA) < 0.5,
            known=error < 0.25,
        ),
    ])  # fmt: skip


def _exponent(near):
    """Fit one slope of log D to all rays, each with its own prefactor.

    Return the slope, its error and the number of rays.
    """
    known = near.diffusion.where(near.diffusion.notnull().sum("excess") > 1)
    x, y = np.log(near.excess).where(known.notnull()), np.log(known)
    x = x - x.mean("excess")
    square = (x**2).sum()
    slope, error = (x * y).sum() / square, ((x * near.error / known) ** 2).sum() ** 0.5 / square
    return float(slope), float(error), int(known.notnull().any("excess").sum())
