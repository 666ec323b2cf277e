"""The flux through the last circle beyond its breakup, and its deviation from the power law."""

import numpy as np
from matplotlib.ticker import NullFormatter

from workflows.figures.style import circle_class, circle_style, key, outer_legend, panels


def draw_flux(fluxes, fits):
    """Draw the flux, and its ratio to the power law, against the distance beyond the breakup."""
    figure, (whole, divided) = panels(1, 2, 12, 5)
    x, eta = fluxes.excess.values, fits.attrs["predicted_exponent"]
    bottom = {"transform": divided.get_xaxis_transform(), "ls": "", "mfc": "none"}
    for i, angle in enumerate(fluxes.angle.values):
        flux, fit = fluxes.flux.sel(angle=angle).values, fits.sel(angle=angle)
        tie = r" and $1 - \omega$" if angle % 90 == 0 else ""
        label = rf"$\varphi = {angle:g}°$, $\omega = {circle_class(fit.circle.item())}${tie}"
        style = circle_style(fit.circle.item(), 1) | {"ms": 3.5, "lw": 1, "marker": "osD^v"[i % 5]}
        whole.plot(x, flux, label=label, **style)
        divided.plot(x, flux / x**eta, **style)
        silent = np.isnan(flux)
        divided.plot(x[silent], np.full(silent.sum(), 0.03 * (i + 1)), **style | bottom)
    if fluxes.flux.isnull().any():
        key(divided, {"o": "hollow, at the bottom: no answer"}, "o")
    middle = np.nanmedian(fluxes.flux / fluxes.excess**eta)
    fitted = fits.exponent.dropna("angle")
    law = r"$\propto x^\eta$"
    if fitted.size:
        law += rf"; median of the fits: $\eta = {float(fitted.median()):.4f}$"
    whole.plot(x, 3 * middle * x**eta, "--", color="0.5", label=law)
    whole.set(title="Flux through the last circle after its breakup", yscale="log")
    whole.set_ylabel(r"$\Delta W$ per step (turns $\times$ $y$)")
    outer_legend(figure, 3)
    divided.set(title=rf"Flux divided by $x^{{{eta:.4f}}}$", ylim=(0, None))
    divided.set_ylabel(rf"$\Delta W / x^{{{eta:.4f}}}$")
    for axes in (whole, divided):
        axes.set(xscale="log", xlabel=r"distance beyond the breakup, $x = s/s_c - 1$")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(lw=0.3)
    return figure


def flux_caption(fluxes, fits):
    laws = ", ".join(
        f"η = {row.exponent:.6f} ± {row.exponent_error:.0e} at {angle:g}° ({row.circle_and_tie})"
        if np.isfinite(row.exponent)
        else f"no fit at {angle:g}°, because there are too few distances"
        for angle, row in fits.to_dataframe().iterrows()
    )
    ratio, silent = np.nan, int(fluxes.flux.isnull().sum())
    if {0.0, 45.0} <= set(fluxes.angle.values.tolist()):
        ratio = float(fits.amplitude.sel(angle=45) / fits.amplitude.sel(angle=0))
    alike = (
        f" C at 45° is {ratio:.3f} times C at 0°. Both reduce to the standard map: at 45° a step "
        "is two steps of the standard map (twice the area), at 0° it is one step, with 2y as its "
        "momentum (half the area)."
    )
    return (
        "Flux through the cantorus of the last circle: the area that crosses it per step (one "
        "period), which is the difference in action between minimax and minimizing orbits with "
        f"periods up to {fluxes.attrs['q_max']}, against the distance beyond the breakup. Fits of "
        f"ΔW = C·x^η·exp(bx + cx²) up to x = 3%: {laws} (statistical errors of the fit). "
        f"Renormalisation predicts η = {fits.attrs['predicted_exponent']} for noble circles."
        f"{alike if np.isfinite(ratio) else ''} No answer at {silent} of {fluxes.flux.size} points."
    )
