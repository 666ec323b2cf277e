"""The diffusion of momentum: the plane near the boundary, strong kicks, and the law between."""

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm

from workflows.figures.style import INSIDE, VERMILION, circle_style, colour_of, panels

_RATIO = 4.0  # of D to that without correlations, up to which colours go
_ANOMALOUS = "0.25"


def draw_diffusion(plane, strong, law, barrier, findings):
    """Draw D in the plane with CB_gt, D over its quasilinear value, and the law on rays; caption.

    plane, strong : cubes of D with what the study adds. law : table on rays. findings : text.
    """
    figure, axes = panels(2, 3, 16, 9.6)
    _draw_plane(axes[0], plane, barrier)
    _draw_strong(axes[1], strong)
    _draw_diagonal(axes[2], strong)
    _draw_law(axes[3], law)
    _draw_ratio(axes[4], law)
    _draw_prefactor(axes[5], law, barrier)
    meanings = plane.status.attrs["flag_meanings"].split()
    codes = dict(zip(meanings, plane.status.attrs["flag_values"], strict=True))
    unresolved = int((plane.status == codes["not_converged"]).sum())
    return figure, (
        "D = <(y_n - y_0)²>/2n of the momentum of two kicks, in squares of y a period; all "
        "quadrants are images of this one. "
        f"{plane.attrs['n_orbits']} orbits under each forcing, errors of "
        f"{100 * float((plane.error / plane.diffusion).median()):.0f}% in the median. "
        f"{unresolved} of {plane.status.size} cells in (a) are too slow for "
        f"{plane.attrs['n_max']} periods; there D is extrapolated by the flux, with the prefactor "
        f"of the nearest ray. Not tried: other planes and numbers of kicks.\n{findings}"
    )


def _image(axes, cube, field, label, **how):
    reach = float(cube.kappa1[-1] + cube.kappa1[0])
    look = {"origin": "lower", "extent": (0, reach, 0, reach), "interpolation": "nearest"}
    image = axes.imshow(field, **look, **how)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$")
    bar = axes.figure.colorbar(image, ax=axes, label=label, fraction=0.046, pad=0.03)
    return reach, bar


def _draw_plane(axes, plane, barrier):
    field = plane.filled.where(plane.filled > 0)
    colours = colormaps["inferno"].with_extremes(bad=INSIDE)
    norm = LogNorm(max(1e-8, float(field.min())), float(field.max()))
    label = "$D$ (squares of $y$ a period)"
    reach, _ = _image(axes, plane, field, label, norm=norm, cmap=colours)
    levels = 10.0 ** np.arange(np.ceil(np.log10(norm.vmin)), np.log10(norm.vmax))
    look = {"colors": "white", "linewidths": 0.6, "alpha": 0.7}
    axes.contour(plane.kappa1, plane.kappa2, field, levels, **look)
    x = np.append(barrier.kappa1, barrier.kappa2[::-1])
    y = np.append(barrier.kappa2, barrier.kappa1[::-1])
    axes.plot(x, y, color=colour_of(3), lw=1.6, label=r"$\mathit{CB}_\mathrm{gt}$")
    axes.text(0.05 * reach, 0.06 * reach, "a barrier: $D = 0$", size="x-small")
    axes.set(title="Diffusion of momentum", xlim=(0, reach), ylim=(0, reach))
    axes.legend(loc="upper right", fontsize="small")


def _draw_strong(axes, strong):
    ratio = (strong.diffusion / strong.quasilinear).where(strong.diffusion > 0)
    colours = colormaps["RdBu_r"].with_extremes(bad=_ANOMALOUS)
    norm = LogNorm(1 / _RATIO, _RATIO)
    label = r"$16\pi^2 D/(\kappa_1^2 + \kappa_2^2)$"
    _, bar = _image(axes, strong, ratio, label, norm=norm, cmap=colours)
    ticks = [0.25, 0.5, 1, 2, 4]
    bar.set_ticks(ticks, labels=map(str, ticks))
    bar.minorticks_off()
    axes.set_title("Strong kicks (black: no $D$, accelerator modes)")


def _draw_diagonal(axes, strong):
    """Draw D on κ1 = κ2, the standard map."""
    kappa, (value, error, theory, anomalous) = (
        strong.kappa1.values,
        (
            np.diagonal(part / strong.quasilinear)
            for part in (strong.diffusion, strong.error, strong.strong_kicks, 0 * strong.exponent)
        ),
    )
    known = np.isfinite(value) & (value > 0)
    axes.plot(kappa, theory, color=VERMILION, label="Rechester & White, four kicks")
    look = {"ls": "", "marker": "o", "ms": 3.5, "color": colour_of(0), "label": "ensemble"}
    axes.errorbar(kappa[known], value[known], error[known], **look)
    for left in kappa[~known & np.isfinite(anomalous)]:
        axes.axvline(left, color=_ANOMALOUS, alpha=0.2, lw=5)
    axes.plot([], [], color=_ANOMALOUS, alpha=0.2, lw=5, label="accelerator mode, no $D$")
    axes.axhline(1, color="0.6", lw=0.8)
    axes.set(xlabel=r"$\kappa_1 = \kappa_2$", ylabel=r"$16\pi^2 D/2\kappa_1^2$", ylim=(0, 4))
    axes.set_title("The standard map")
    axes.legend(fontsize="small")


def _some(law):
    """Return (angle, the table there, style) of up to five rays."""
    angles = law.angle.values[
        np.linspace(0, law.angle.size - 1, min(5, law.angle.size)).astype(int)
    ]
    for i, angle in enumerate(angles):
        here = law.sel(angle=angle)
        style = circle_style(here.circle.item(), 1) | {"color": colour_of(i), "ls": ""}
        yield angle, here, style


def _draw_law(axes, law):
    for angle, here, style in _some(law):
        look = {"ms": 4, "label": rf"$\varphi = {angle:g}°$", **style}
        axes.errorbar(law.excess, here.diffusion, here.error, **look)
        known = here.one_cantorus.dropna("excess")
        axes.plot(known.excess, known, color=style["color"], lw=1)
    axes.plot([], [], color="0.4", lw=1, label=r"$\Delta W/m$, the last circle alone")
    axes.set(xscale="log", yscale="log", xlim=(0.04, 1.2), ylim=(1e-7, None))
    axes.set(xlabel=r"distance beyond the breakup, $x = s/s_c - 1$", ylabel="$D$")
    axes.set_title("From the boundary outwards")
    axes.legend(fontsize="small")


def _draw_ratio(axes, law):
    far = law.sel(excess=slice(0.05, None))
    for i, x in enumerate(far.excess.values):
        here, colour = far.sel(excess=x), colormaps["viridis"](i / far.excess.size)
        if np.isfinite(here.ratio).any():
            error = here.error / here.one_cantorus
            look = {"marker": "o", "ms": 3.5, "lw": 0.8, "color": colour}
            axes.errorbar(law.angle, here.ratio, error, **look, label=f"$x = {100 * x:.0f}\\%$")
    axes.axhline(1, color="0.5", lw=0.8, ls="--")
    axes.set(yscale="log", xlabel=r"angle $\varphi$ (degrees)", ylabel=r"$mD/\Delta W$")
    axes.set_title("The other cantori hold back more")
    axes.set_ylim(0.02, 2)
    axes.legend(fontsize="x-small", ncols=4, loc="lower center")


def _draw_prefactor(axes, law, barrier):
    axes.plot(law.angle, law.prefactor, color="0.7", lw=0.8)
    for angle, value, circle in zip(
        law.angle.values, law.prefactor.values, law.circle.values, strict=True
    ):
        axes.plot(angle, value, **circle_style(circle, 1) | {"ls": "", "ms": 5})
    axes.set(yscale="log", xlabel=r"angle $\varphi$ (degrees)")
    axes.set(ylabel=r"$\Delta W/mx^\eta$, $x = 10^{-3}$", title="Prefactor along the boundary")
