"""Figures: each function takes a Dataset, returns a Figure, and computes no physics."""

from fractions import Fraction

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

# Okabe & Ito, safe for colour-blind readers; of boundaries, the largest N first.
_CIRCLE_COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]
_BOUNDARY_COLOURS = ["#0072B2", "#009E73", "#56B4E9"]


def save(figure, out, name):
    """Write the figure as NAME.png and NAME.pdf; returns the two paths."""
    paths = [f"{out}/{name}.{kind}" for kind in ("png", "pdf")]
    for path in paths:
        figure.savefig(path, dpi=200, bbox_inches="tight")
    plt.close(figure)
    return paths


def draw_escape_plane(plane, steps):
    """First escape times of the largest ensemble, with the boundary of each number of steps."""
    figure, axes = _plane_axes(plane)
    field = _draw_field(axes, plane)
    for n, colour in zip(steps[::-1], _BOUNDARY_COLOURS, strict=False):
        axes.contour(
            plane.kappa1, plane.kappa2, field <= n, levels=[0.5], colors=colour, linewidths=1.0
        )
        axes.plot([], [], color=colour, label=f"$N = {_power(n)}$")
    axes.legend(loc="best")
    return figure


def draw_critical_boundary(plane, table):
    """The escape field and on it the boundary along rays, for each number of steps."""
    figure, axes = _plane_axes(plane)
    _draw_field(axes, plane)
    for n, colour in zip(table.n.values[::-1], _BOUNDARY_COLOURS, strict=False):
        curve = table.sel(n=n)
        axes.plot(curve.kappa1, curve.kappa2, color=colour, lw=1.3, label=f"$N = {_power(n)}$")
    axes.legend(loc="lower center")
    return figure


def _plane_axes(plane):
    width = float(plane.kappa1.max() - plane.kappa1.min())
    height = float(plane.kappa2.max() - plane.kappa2.min())
    figure, axes = plt.subplots(figsize=(10, 1.2 + 8 * min(1.2, height / width)))
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    axes.set_title(
        rf"Global transport: {int(plane.ensemble[-1])} orbits, up to "
        rf"${_power(plane.attrs['n_max'])}$ steps of $\mathcal{{T}}_{{\kappa_1\kappa_2}}$"
    )
    return figure, axes


def _draw_field(axes, plane):
    """The field on a log scale; cells without escape are left white. Returns the field."""
    field = plane.escape_time.isel(ensemble=-1).values
    half = [float(c.diff(c.name)[0]) / 2 for c in (plane.kappa1, plane.kappa2)]
    extent = [
        float(plane.kappa1[0]) - half[0],
        float(plane.kappa1[-1]) + half[0],
        float(plane.kappa2[0]) - half[1],
        float(plane.kappa2[-1]) + half[1],
    ]
    finite = np.where(np.isfinite(field), field, np.nan)
    earliest = max(1.0, np.nanmin(finite)) if np.isfinite(finite).any() else 1.0
    image = axes.imshow(
        finite,
        extent=extent,
        origin="lower",
        norm=LogNorm(vmin=earliest, vmax=max(plane.attrs["n_max"], 1.1 * earliest)),
        cmap="magma",
        interpolation="nearest",
    )
    axes.figure.colorbar(
        image, ax=axes, label="first escape $n^*$ (steps); white: none", fraction=0.024, pad=0.02
    )
    return field


def _power(n):
    """10^5, 5·10^5, … in TeX; small numbers and crooked ones as they are."""
    if n < 1000 or n % 10 ** (len(str(n)) - 2):
        return str(n)
    exponent = len(str(n)) - 1
    mantissa = n / 10**exponent
    return f"10^{exponent}" if mantissa == 1 else rf"{mantissa:g}\cdot 10^{exponent}"


def draw_circle_boundaries(breakdown):
    """CB_ω of each rotation number over the upper half plane."""
    figure, axes = plt.subplots(figsize=(10, 5.6))
    _draw_circles(axes, breakdown, breakdown.kappa1, breakdown.kappa2)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    axes.set_title(r"Breakup of circles by Greene's residue: $\mathit{CB}_\omega$")
    axes.legend(loc="lower center", ncols=2, fontsize="small")
    return figure


def _draw_circles(axes, breakdown, x, y):
    """The curves (x, y) of each ω; with (-x, -y), as all boundaries have that symmetry."""
    for i, text in enumerate(breakdown.omega.attrs["exact"]):
        colour = _CIRCLE_COLOURS[i % len(_CIRCLE_COLOURS)]
        axes.plot(x[i], y[i], color=colour, lw=1.3, label=rf"$\omega = {text}$")
        axes.plot(-x[i], -y[i], color=colour, lw=1.3)


def draw_rotating_circles(breakdown, transport):
    """CB_ω and the onset of transport for Ω = 1/2 in the variables κ̄, Δκ: the diamond, Fig. 10."""
    figure, axes = plt.subplots(figsize=(7, 7))
    mean, amplitude = (
        (breakdown.kappa1 + breakdown.kappa2) / 2,
        (breakdown.kappa1 - breakdown.kappa2) / 2,
    )
    _draw_circles(axes, breakdown, mean, amplitude)
    _draw_transport(axes, transport.sel(frequency=0.5))
    axes.set_title(r"Rotating standard map with $\Omega = 1/2$: $T_{\kappa_1\kappa_2}$")
    return _rotating(figure, axes)


def draw_rotating_tori(tori, transport):
    """Breakup of tori by the residue of long orbits, and the onset of transport, Fig. 11."""
    figure, axes = plt.subplots(figsize=(7, 7))
    for i, vector in enumerate(tori.attrs["vectors"].split()):
        curve, colour = tori.isel(frequency=i), _CIRCLE_COLOURS[i % len(_CIRCLE_COLOURS)]
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
    label = rf"transport, $\Omega = {frequency}$, $N = {_power(transport.attrs['n_max'])}$"
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


def draw_primary_points(primary):
    """Stability of the four primary period-one points over the plane, Fig. 3."""
    figure, panels = plt.subplots(2, 2, figsize=(8, 8), sharex=True, sharey=True)
    for axes, i, point in zip(panels.flat, range(4), primary.point.attrs["points"], strict=True):
        residue = primary.residue.isel(point=i)
        stable = (residue > 0) & (residue < 1)
        axes.contourf(primary.kappa1, primary.kappa2, stable, levels=[0.5, 1.5], colors=["#D55E00"])
        axes.set(title=f"$(x, y) = {point}$", aspect="equal")
        axes.axhline(0, color="0.7", lw=0.6)
        axes.axvline(0, color="0.7", lw=0.6)
    for axes in panels[1]:
        axes.set_xlabel(r"$\kappa_1$")
    for axes in panels[:, 0]:
        axes.set_ylabel(r"$\kappa_2$")
    figure.suptitle("Strengths for which a primary period-one orbit is stable")
    return figure


def draw_secondary_points(secondary):
    """Where secondary points exist and are stable, and the error of the cubic estimate, Fig. 4."""
    figure, axes = plt.subplots(figsize=(7.5, 6))
    error = secondary.estimate_error.where(secondary.estimate_error > 0)
    image = axes.pcolormesh(
        secondary.kappa1, secondary.kappa2, error, norm=LogNorm(vmin=1e-4, vmax=3), cmap="viridis"
    )
    figure.colorbar(image, ax=axes, label=r"error of the cubic estimate of $z_*$; white: no point")
    stable = (secondary.residue > 0) & (secondary.residue < 1)
    axes.contourf(
        secondary.kappa1, secondary.kappa2, stable, levels=[0.5, 1.5], colors="none", hatches=["//"]
    )
    axes.fill_between([], [], [], facecolor="none", edgecolor="black", hatch="//", label="stable")
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    axes.set_title("Secondary period-one orbits next to $(1/2, 0)$")
    axes.legend(loc="lower left")
    return figure


def draw_verdict(portrait):
    """A phase portrait with the circle that is a barrier, or with an orbit that escapes."""
    escapes = "escaping_y" in portrait
    figure, panels = plt.subplots(
        1, 1 + escapes, figsize=(6 + 6 * escapes, 6.2), layout="constrained", squeeze=False
    )
    axes = panels[0, 0]
    axes.plot(portrait.x.values.ravel(), _cell(portrait.y.values.ravel()), **_dots("0.3", 0.9))
    if "circle_x" in portrait:
        stride = max(1, portrait.theta.size // 4096)
        x, y = portrait.circle_x.values[::stride] % 1, _cell(portrait.circle_y.values[::stride])
        order = np.argsort(x)
        axes.plot(
            x[order], y[order], color="#D55E00", lw=1.8, label=rf"$\omega = {portrait.omega}$"
        )
    if escapes:
        time = np.arange(portrait.time.size)
        x, y = portrait.escaping_x.values, portrait.escaping_y.values
        axes.plot(x % 1, _cell(y), label="orbit that escapes", **_dots("#D55E00", 1.5))
        panels[0, 1].plot(time, y, color="#D55E00", lw=0.3, marker=".", ms=2, rasterized=True)
        panels[0, 1].set(xlabel="step $n$", ylabel="$y_n$ of the orbit that escapes", box_aspect=1)
    axes.set(xlim=(0, 1), ylim=(-0.25, 0.75), xlabel="$x$ (turns)", ylabel="$y$ (mod 1)")
    axes.set_aspect("equal")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper right", framealpha=0.95, markerscale=6)
    kappa1, kappa2 = portrait.kappa
    figure.suptitle(rf"$(\kappa_1, \kappa_2) = ({kappa1:.8g}, {kappa2:.8g})$: {portrait.answer}")
    return figure


def _dots(colour, size):
    return {"ls": "", "marker": ".", "ms": size, "mew": 0, "color": colour, "rasterized": True}


def _cell(y):
    """y mod 1 in [-1/4, 3/4): the circles of 0 ≤ ω/P ≤ 1/2, up to their amplitude, are whole."""
    return (y + 0.25) % 1 - 0.25
