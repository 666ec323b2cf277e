"""Diffusion of momentum beyond the boundary: over the plane, and along rays."""

import numpy as np
from matplotlib.colors import LogNorm

from workflows.figures.style import INSIDE, MARKERS, colour_of, in_column, legend_below, panels

_UNRESOLVED = "0.6"


def draw_diffusion(law):
    """Draw D over the plane, and D and ΔW/m of the last cantorus along up to seven rays."""
    figure, (plane, along) = panels(1, 2, 13, 5.8)
    _draw_plane(plane, law)
    for i, angle in enumerate(law.angle.values[:: max(1, law.angle.size // 4)]):
        here, look = law.sel(angle=angle), {"color": colour_of(i)}
        style = look | {"ls": "", "ms": 4, "marker": MARKERS[i]}
        label = rf"$\varphi = {angle:g}°$"
        along.errorbar(law.excess, here.diffusion, here.error, label=label, **style)
        here.one_cantorus.dropna("excess").plot(ax=along, lw=1, **look)
    along.plot([], [], color="0.4", lw=1, label=r"$\Delta W/m$, last cantorus alone")
    along.set(xscale="log", yscale="log", xlim=(0.04, 4), ylim=(1e-7, None))
    along.set(xlabel=r"distance beyond the breakup, $x = s/s_c - 1$", ylabel="$D$")
    along.set_title("From the boundary outwards")
    legend_below(along, 3, 2)
    return figure


def diffusion_caption(law, findings):
    known, error = law.diffusion.notnull(), float((law.error / law.diffusion).median())
    return (
        "Diffusion coefficient D = <(y_n - y_0)²>/2n of the momentum under two kicks, in y² per "
        "step (one period, two kicks); the other quadrants are mirror images. "
        f"{law.attrs['n_orbits']} orbits per forcing; the median error is {100 * error:.0f}%. D is "
        f"known for {int(known.sum())} of {known.size} forcings. For the others, grey in (a), "
        f"diffusion is too slow to be resolved in {law.attrs['n_max']} steps, or D does not exist "
        "because of accelerator modes. "
        "Inside CB_gt a barrier exists and D = 0; D is not computed there. Other planes and "
        f"numbers of kicks were not tested.\n{findings}"
    )


def _draw_plane(axes, law):
    kappa1, kappa2, D = (  # rows from 0° to 45°, and their images up to 90°
        np.concatenate([law[one].values, law[image].values[::-1]])
        for one, image in (("kappa1", "kappa2"), ("kappa2", "kappa1"), ("diffusion", "diffusion"))
    )
    reach = kappa1[0, -1]
    low, high = np.log10(np.nanquantile(D[(kappa1 <= reach) & (kappa2 <= reach)], [0, 1]))
    levels = 10 ** np.arange(np.floor(4 * low) / 4, high + 0.25, 0.25)
    decades, field = 10.0 ** np.arange(np.ceil(low), high), np.ma.masked_invalid(D)
    look = {"norm": LogNorm(levels[0], levels[-1]), "cmap": "inferno", "extend": "max"}
    image = axes.contourf(kappa1, kappa2, field, levels, **look)
    axes.contour(kappa1, kappa2, field, decades, colors="white", linewidths=0.8)
    axes.plot(kappa1[np.isfinite(D)], kappa2[np.isfinite(D)], ".", color="white", ms=3, mec="0.3")
    where = {"location": "top", "aspect": 40} if in_column() else {"fraction": 0.046, "pad": 0.03}
    bar = axes.figure.colorbar(image, ax=axes, ticks=decades, **where)
    bar.set_label("$D$ ($y^2$ per step)")
    edge = [kappa[:, 0] / (1 + law.excess.values[0]) for kappa in (kappa1, kappa2)]
    axes.fill(*(np.append(part, 0) for part in edge), color=INSIDE, label="barrier, $D = 0$")
    axes.fill([], [], color=_UNRESOLVED, label="too slow, or no $D$")
    axes.plot(*edge, color=colour_of(3), lw=1.6, label=r"$\mathit{CB}_\mathrm{gt}$")
    powers = {"edgecolor": "0.6", "facecolor": "white", "label": "white lines: powers of 10"}
    axes.fill([], [], **powers, lw=0.8)
    axes.plot(
        [], [], ".", color="white", ms=5, mec="0.3", label="computed; interpolated in between"
    )
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", xlim=(0, reach), ylim=(0, reach))
    axes.set(title="Diffusion of momentum", facecolor=_UNRESOLVED, aspect="equal")
    legend_below(axes, 2, 2)
