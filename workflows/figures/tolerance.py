"""Loss of the threshold against the ripple, its exponents, and random forcings against κ_G."""

import numpy as np

from workflows.figures import style

COSINE, ONE = "cosine", "one kick"  # shapes of ripples
CLEAR = 0.2  # of the loss: the largest error of a loss that is drawn


def draw_tolerance(cube, laws, tried, summits):
    """Draw loss against ripple, exponents as measured and predicted by P, and how strong random
    forcings may be.

    cube : ripples with their `loss`. laws : `exponent` and `predicted`, dims (shape, period).
    tried, summits : random forcings, and climbs, with `upper` and `reached`.
    """
    figure, (price, slopes, strengths) = style.panels(1, 3, 14, 5)
    _draw_losses(price, cube)
    _draw_exponents(slopes, laws)
    _draw_strengths(strengths, tried, summits)
    return figure


def _draw_losses(axes, cube):
    cube = cube.isel(forcing=np.flatnonzero(cube.loss_error < CLEAR * cube.loss))
    for period in np.unique(cube.period).tolist():
        for shape, line in ((COSINE, "-"), (ONE, ":")):
            mine = (cube.family == shape) & (cube.period == period)
            if not mine.any():
                continue
            here = cube.isel(forcing=np.flatnonzero(mine)).sortby("parameter")
            look = {"color": style.colour_of(period - 2), "marker": style.MARKERS[period % 5]}
            label = f"$P = {period}$" if shape == COSINE else None
            lines = {"ls": line, "lw": 1, "ms": 4, "mfc": None if shape == COSINE else "none"}
            axes.errorbar(here.parameter, here.loss, here.loss_error, label=label, **look, **lines)
    if (cube.family == ONE).any():
        style.key(axes, {"-": "cosine", ":": "one kick in $P$ is stronger"})
    axes.set(xscale="log", yscale="log", xlabel=r"ripple $d$ (rms over mean)")
    axes.set(ylabel=r"loss of threshold, $1 - s_c\,\mathrm{rms}/\kappa_G$")
    axes.set_title("What a ripple costs")
    axes.legend(fontsize="small")


def _draw_exponents(axes, laws):
    for i, shape in enumerate(laws.shape.values):
        here = laws.sel(shape=shape)
        x, look = here.period + 0.12 * i, {"color": style.colour_of(i), "ls": ""}
        given = {"marker": "_", "ms": 16, "mew": 2, "label": f"{shape}, predicted"}
        axes.errorbar(x, here.predicted, here.predicted_error, **given, **look)
        fits = {"marker": "os"[i], "ms": 5, "capsize": 3, "label": f"{shape}, measured"}
        axes.errorbar(x, here.exponent, here.exponent_error, **fits, **look)
    axes.set(xlabel="kicks $P$ in a period", ylabel="exponent of the loss", ylim=(0, None))
    axes.set_title(r"Loss $\propto d^{\,\mathrm{exponent}}$")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend(fontsize="small")


def _draw_strengths(axes, tried, summits):
    golden = tried.attrs["golden"]
    upper, bins = (tried.upper / golden).values, np.linspace(0, 1, 41)
    near = tried.parameter.values < 0.1
    parts = [upper[near & np.isfinite(upper)], upper[~near & np.isfinite(upper)]]
    shades, labels = [style.colour_of(3), style.colour_of(0)], ["ripple below 10%", "others"]
    axes.hist(parts, bins, stacked=True, color=shades, label=labels)
    axes.axvline(1, color="black", lw=1, label="constant kicks")
    reached = (summits.reached / golden).values
    foot = {"transform": axes.get_xaxis_transform(), "clip_on": False, "ls": "", "ms": 6}
    look = {"marker": "^", "color": style.VERMILION, "label": "ends of climbs"}
    axes.plot(reached, np.full(reached.size, 0.02), **look, **foot)
    axes.set(xlabel=r"rms strength without a barrier, over $\kappa_G$", xlim=(0, 1.08))
    axes.set(ylabel="random forcings of 2 to 8 kicks")
    axes.set_title("Random forcings against constant kicks")
    axes.legend(fontsize="small")
