"""Rotating standard maps in the plane of κ̄ and Δκ, Figs. 10 and 11."""

from fractions import Fraction

import matplotlib.pyplot as plt

from workflows.figures.circle_boundaries import draw_circles
from workflows.figures.style import CIRCLE_COLOURS, power


def draw_rotating_circles(breakdown, transport):
    """CB_ω and the onset of transport for Ω = 1/2 in the variables κ̄, Δκ: the diamond, Fig. 10."""
    figure, axes = plt.subplots(figsize=(7, 7))
    mean, amplitude = (
        (breakdown.kappa1 + breakdown.kappa2) / 2,
        (breakdown.kappa1 - breakdown.kappa2) / 2,
    )
    draw_circles(axes, breakdown, mean, amplitude)
    _draw_transport(axes, transport.sel(frequency=0.5))
    axes.set_title(r"Rotating standard map with $\Omega = 1/2$: $T_{\kappa_1\kappa_2}$")
    return _rotating(figure, axes)


def draw_rotating_tori(tori, transport):
    """Breakup of tori by the residue of long orbits, and the onset of transport, Fig. 11."""
    figure, axes = plt.subplots(figsize=(7, 7))
    for i, vector in enumerate(tori.attrs["vectors"]):
        curve, colour = tori.isel(frequency=i), CIRCLE_COLOURS[i % len(CIRCLE_COLOURS)]
        axes.plot(
            curve.kappa_mean, curve.kappa_amplitude, color=colour, lw=1.0, label=f"torus ({vector})"
        )
        axes.plot(-curve.kappa_mean, -curve.kappa_amplitude, color=colour, lw=1.0)
    for i, style in zip(range(transport.frequency.size), ("-", "--", ":", "-."), strict=False):
        _draw_transport(axes, transport.isel(frequency=i), style)
    axes.set_title("Rotating standard maps: tori and the onset of transport")
    return _rotating(figure, axes)


def _draw_transport(axes, transport, style="-"):
    frequency = Fraction(float(transport.frequency)).limit_denominator(10**6)
    label = rf"transport, $\Omega = {frequency}$, $N = {power(transport.attrs['n_max'])}$"
    for sign, text in ((1, label), (-1, None)):
        scale = sign * transport.upper / transport.critical_scale
        axes.plot(
            scale * transport.kappa_mean,
            scale * transport.kappa_amplitude,
            style,
            color="black",
            lw=1.6,
            label=text,
        )


def _rotating(figure, axes):
    axes.set(xlabel=r"$\bar\kappa$", ylabel=r"$\Delta\kappa$", aspect="equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, fontsize="small")
    return figure
