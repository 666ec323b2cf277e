"""Diffusion beyond the boundary: where to compute it, its law by the flux, and what is found."""

import numpy as np
import xarray as xr

from nasm.critical import Status
from nasm.diffusion import strong_kicks
from pipeline.cubes.cube import status_code
from workflows.shared.rules import finding
from workflows.shared.tables import described

STRONG = 13.0  # strengths, the end of the plane of strong kicks
ETA = 3.01172  # exponent of the flux, by renormalisation
_NEAR = 0.13  # distance beyond the breakup up to which the law is looked for
_RAYS = 3  # on which the law must be seen
_TESTED = 4.0  # strengths from which on the terms of Rechester & White are compared


def wedge(quick):
    """Return the rays of the boundary, denser towards the cusp at 45°."""
    away = np.geomspace(0.02, 2, 4 if quick else 9)
    return np.r_[np.linspace(0, 42, 15 if quick else 85), 45 - away[::-1], 45]


def rays(quick):
    """Return the rays, among those of `wedge`, on which the law is looked at."""
    return np.array([0.0, 12, 30, 45]) if quick else np.r_[0.0, 2, 5:45:5, 42, 45]


def excesses(*nearer):
    """Return distances beyond the breakup, relative to it, from 5% on, and some that are nearer."""
    return np.r_[nearer, np.geomspace(0.05, 1, 8)]


def foreseen(angles):
    """Return what `known` will return, about."""
    scales = dict.fromkeys(angles, 0.6)
    return scales, dict.fromkeys(angles, "[0;(1)]"), [(0.0, 0.48, 0.49), (45.0, 1.37, 1.374)]


def known(barrier, angles):
    """Return {angle: scale} and {angle: last circle} of some rays, and a list of all rays: (angle,
    certified scale, breakup); rays without an answer are left out."""
    whole = barrier.dropna("angle", subset=["critical_scale", "lower"])
    names = ("angle", "lower", "critical_scale")
    everywhere = list(zip(*(whole[name].values.tolist() for name in names), strict=True))
    some = whole.sel(angle=[angle for angle in angles if angle in whole.angle]).to_dataframe()
    return some.critical_scale.to_dict(), some.circle.to_dict(), everywhere


def law(barrier, fluxes, measured):
    """Compare D on rays with the flux: a Dataset with dims (angle, excess).

    one_cantorus is ΔW over the number of last circles between which y gains a unit: ω and 2 - ω,
    and on the axes those that are tied with them.
    """
    tied = barrier.tied.sel(angle=fluxes.angle) != ""
    of_flux = fluxes.flux / xr.where(tied, 4, 2)
    table = measured[["diffusion", "error", "steps", "status"]].assign(one_cantorus=of_flux)
    ratio = table.diffusion / table.one_cantorus
    labels = "ΔW over the number of last circles", "diffusion over one_cantorus"
    table = table.assign(ratio=ratio)
    for name, label in zip(("one_cantorus", "ratio"), labels, strict=True):
        table[name].attrs = described(label)
    near = of_flux.isel(excess=0)
    table["prefactor"] = (near / near.excess**ETA).drop_vars("excess")
    table.prefactor.attrs = described("one_cantorus/excess^3.01172, next to the breakup")
    return table.assign_coords(circle=fluxes.circle)


def with_law(plane, barrier, law):
    """Fill cells that no ensemble resolved by D = r·ΔW/m, r the ratio at the nearest distance of
    the nearest ray where there is one; `by_law` says where."""
    kappa1, kappa2 = np.meshgrid(plane.kappa1, plane.kappa2)
    scale = np.hypot(kappa1, kappa2)
    angle = np.rad2deg(np.arctan2(np.minimum(kappa1, kappa2), np.maximum(kappa1, kappa2)))
    breakup = np.interp(angle, *_known(barrier.angle, barrier.critical_scale))
    filled = plane.diffusion.values.copy()
    by_law = (plane.status == status_code(Status.NOT_CONVERGED)).values & (scale > breakup)
    nearest = np.abs(angle[by_law][:, None] - law.angle.values).argmin(axis=1)
    prefactor = (_nearest(law.ratio) * law.prefactor.values)[nearest]
    filled[by_law] = prefactor * (scale / breakup - 1)[by_law] ** ETA
    return plane.assign(
        filled=plane.diffusion.copy(data=filled), by_law=(plane.diffusion.dims, by_law)
    )


def _nearest(ratio):
    """Return on each ray the ratio at the least distance that has one, NaN if none has."""
    first = ratio.notnull().argmax("excess")
    return ratio.isel(excess=first).values


def _known(x, y):
    return x.values[np.isfinite(y.values)], y.values[np.isfinite(y.values)]


def with_theory(plane):
    """Add D without correlations, `quasilinear`, and with those of four kicks, `strong_kicks`."""
    kappa1, kappa2 = xr.broadcast(plane.kappa1, plane.kappa2)
    quasilinear = ((kappa1**2 + kappa2**2) / (4 * np.pi) ** 2).transpose(*plane.diffusion.dims)
    strong = strong_kicks(kappa1, kappa2).transpose(*plane.diffusion.dims)
    return plane.assign(quasilinear=quasilinear, strong_kicks=strong)


def findings(law, plane, strong):
    """Judge what was foreseen; lines of text."""
    kappas = xr.broadcast(strong.kappa1, strong.kappa2)
    large = np.minimum(*kappas) >= _TESTED
    off = abs(strong.diffusion / strong.strong_kicks - 1).where(large).values
    off = off[np.isfinite(off)]
    middle, most = np.quantile(off, [0.5, 0.95]) if off.size else (np.nan, np.nan)
    anomalous = int(((strong.status == status_code(Status.ANOMALOUS)) & large).sum())
    apart = np.concatenate([_mirrored(each) for each in (plane, strong)])
    scatter = (apart**2).mean() ** 0.5 if apart.size else np.nan
    here = law.where(law.status == status_code(Status.OK))
    ratio = here.ratio.values[np.isfinite(here.ratio.values)]
    slope, error, cases = _exponent(here.sel(excess=slice(0, _NEAR)))
    smallest = _nearest(here.ratio)
    lowest = float(law.angle[np.nanargmin(smallest)]) if np.isfinite(smallest).any() else np.nan
    smallest = smallest[np.isfinite(smallest)]
    bounds = _range(ratio, "{:.2f}")
    return "\n".join(
        [
            finding(
                "D(κ1, κ2) = D(κ2, κ1):",
                f"{apart.size} pairs of cells, each from orbits of its own, differ by "
                f"{scatter:.2f} times their errors in root mean square",
                0.8 < scatter < 1.2,
                scatter < 2,
                apart.size > 0,
            ),
            finding(
                f"For κ1, κ2 ≥ {_TESTED:g} D is that of Rechester & White:",
                f"off by {100 * middle:.0f}% in the median of {off.size} cells, 95% of them within "
                f"{100 * most:.0f}%; {anomalous} more have accelerator modes, and no D",
                middle < 0.1 and not anomalous,
                middle < 0.1,
                off.size > 0,
            ),
            finding(
                "The last circle alone resists, D = ΔW/m:",
                f"D is {bounds} of that under {ratio.size} forcings from 5% to 100% beyond the "
                f"boundary, {_range(smallest, '{:.2f}')} at the nearest one resolved on each ray, "
                f"least at {lowest:g}°: a bound; other cantori hold back more, most next to the "
                "tip and the axes, where circles break almost together",
                bool((abs(ratio - 1) < 0.2).all()),
                bool((ratio < 1.2).all()),
                ratio.size > 0,
            ),
            finding(
                f"D ~ (s/s_c - 1)^{ETA:.3g}:",
                f"the exponent is {slope:.2f} ± {error:.2f} from 5% to {100 * _NEAR:.0f}%, by rays "
                f"where D is resolved there twice, {cases} of them; nearer none was tried",
                cases >= _RAYS and abs(slope - ETA) < 2 * error < 0.5,
                abs(slope - ETA) < 0.5,
                np.isfinite(slope),
            ),
        ]
    )


def _mirrored(plane):
    """Return differences of D and D of exchanged kicks, in parts of their error."""
    value, variance = plane.diffusion.values, plane.error.values**2
    apart = (value - value.T) / np.sqrt(variance + variance.T + (variance == 0))
    apart = apart[np.triu_indices_from(apart, 1)]
    return apart[np.isfinite(apart) & (apart != 0)]


def _exponent(near):
    """Fit one slope of log D to rays, each with a prefactor of its own: slope, error, rays."""
    known = near.diffusion.notnull() & (near.diffusion.notnull().sum("excess") >= 2)
    if not known.any():
        return np.nan, np.nan, 0
    x, y = (np.log(part).where(known) for part in (near.excess, near.diffusion))
    x = x - x.mean("excess")
    square, relative = float((x**2).sum()), (near.error / near.diffusion).where(known)
    error = float((x**2 * relative**2).sum()) ** 0.5 / square
    return float((x * y).sum()) / square, error, int(known.any("excess").sum())


def _range(values, form):
    return " to ".join(form.format(f(values)) for f in (np.min, np.max)) if values.size else "none"
