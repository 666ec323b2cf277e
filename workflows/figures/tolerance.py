"""Lowering of the threshold by a ripple; random forcings compared with constant kicks."""

import numpy as np

from workflows.figures import style

_BINS = np.linspace(0, 1, 41)  # bins of strengths without a barrier, relative to κ_G


def draw_tolerance(cube, laws, tried):
    """Draw the loss against the ripple with predicted laws, and a histogram of `tried.upper`."""
    figure, (price, strengths) = style.panels(1, 2, 12, 5)
    _draw_losses(price, cube, laws)
    _draw_strengths(strengths, tried)
    return figure


def _draw_losses(axes, cube, laws):
    lost = cube.isel(forcing=np.flatnonzero(cube.loss > 0))
    for period, rows in style.of_family(lost, "cosine").groupby("period"):
        options = {"color": style.colour_of(period - 2), "marker": style.MARKERS[period % 5]}
        label = rf"$P = {period}$: $d^{{\,{float(laws.predicted.sel(period=period)):.2f}}}$"
        axes.errorbar(
            rows.parameter, rows.loss, rows.loss_error, lw=1, ms=4, label=label, **options
        )
    options = {"ls": "", "ms": 4, "mew": 0.7, "color": "0.3", "marker": "D"}
    for family, fill in (("one kick", "none"), ("square", "0.7")):
        rows = style.of_family(lost, family)
        if rows.sizes["forcing"]:
            label = f"{family}, $P = 4, 6, 8$"
            axes.plot(rows.parameter, rows.loss, label=label, mfc=fill, **options)
    d, exponent = np.array([lost.parameter.min(), 1e-2]), float(laws.predicted.sel(period=2))
    options = {"color": "0.4", "lw": 1, "ls": "--", "label": rf"$\propto d^{{\,{exponent:.3f}}}$"}
    axes.plot(d, 0.01 * (d / 1e-3) ** exponent, **options)
    axes.set(xscale="log", yscale="log", title="Cost of a ripple")
    axes.set_xlabel(r"ripple $d$ (rms over mean)")
    axes.set_ylabel(r"relative loss, $1 - s_c\,\mathrm{rms}/\kappa_G$")
    style.legend_below(axes, 3, 2, title="exponents from renormalisation", title_fontsize="small")


def _draw_strengths(axes, tried):
    random, ends = (style.of_family(tried, family) for family in ("random", "climb"))
    upper, near = (random.upper / tried.golden).values, random.parameter.values < 0.1
    # Escapes are sought up to 1.001 κ_G; if no orbit escapes, `upper` is above 1.
    escaping = upper <= 1
    kinds = {"ripple below 10%": near & escaping, "larger ripple": ~near & escaping}
    kinds |= {"hatched: upper bounds, by converse KAM": near & ~escaping, "": ~near & ~escaping}
    options = {
        "color": 2 * [style.colour_of(3), style.colour_of(0)],
        "stacked": True,
        "ec": "white",
    }
    options |= {"lw": 0.3, "hatch": ["", "", "////", "////"], "label": [*kinds]}
    has_barrier = np.isinf(upper)
    axes.hist(
        [np.minimum(upper[kind & ~has_barrier], 1) for kind in kinds.values()], _BINS, **options
    )
    if has_barrier.any():
        axes.hist(
            np.full(has_barrier.sum(), 1.01), [1, 1.025], color="black", label="a barrier exists"
        )
    axes.axvline(1, color="black", lw=1, label="constant kicks")
    options = {"transform": axes.get_xaxis_transform(), "clip_on": False, "ls": "", "ms": 5}
    options |= {"marker": "|", "color": style.VERMILION, "label": "results of hill climbs"}
    upper = np.minimum(ends.upper / tried.golden, 1)
    axes.plot(upper, np.full(upper.size, -0.02), **options)
    axes.set(xlabel=r"rms strength without a barrier, relative to $\kappa_G$", xlim=(0, 1.03))
    axes.set(yscale="log", ylabel="random forcings of 2 to 8 kicks")
    axes.set_title("Random forcings against constant kicks")
    axes.tick_params(axis="x", pad=6)
    style.legend_below(axes, 3, 2)
