"""Figures of the bias of direct iteration against steps and orbits, as in Fig. 7 but on any ray."""

import numpy as np
from matplotlib.ticker import LogLocator

from workflows.figures.style import MARKERS, colour_of, mark_gaps, outer_legend, panels, power


def draw_convergence(bias, fits):
    """Draw the bias against steps and orbits on each ray, as in Fig. 7.

    bias : result of `direct_bias`. fits : {angle: (η, its error)}.
    """
    figure, (direct, orbits) = panels(1, 2, 11, 4.8)
    count, n = [int(size) for size in bias.ensemble], bias.n.values
    for i, (angle, (eta, error)) in enumerate(fits.items()):
        here, label = bias.sel(angle=angle), rf"$\varphi = {angle:g}°$"
        label += rf": $\eta = {eta:.2f} \pm {error:.2f}$" if np.isfinite(eta) else ""
        options = {"color": colour_of(i), "marker": MARKERS[i % len(MARKERS)], "ms": 3.5}
        direct.plot(n, here[-1], ls="", label=label, **options)
        ratio = (here / here.isel(ensemble=-1)).mean("n")
        orbits.plot(bias.ensemble, ratio, **options)
    middle = float(bias[-1].median())
    for slope, style in ((2.681, ":"), (3.012, "-"), (3.322, "--")):
        guide = middle * (n / np.sqrt(n[0] * n[-1])) ** (-1 / slope)
        direct.plot(n, guide, style, color="0.6", lw=1, label=rf"$\eta = {slope}$")
    mark_gaps(direct, n, bias[-1].isnull().any("angle").values, "no answer on some ray")
    direct.set(xscale="log", yscale="log", xlabel="steps $N$", ylabel=r"$\kappa_N/\kappa_c - 1$")
    direct.set_title(f"Direct iteration, {count[-1]} orbits")
    orbits.set(xscale="log", xlabel="orbits $M$", ylabel=f"bias relative to {count[-1]} orbits")
    orbits.set_title(f"Bias of $M$ orbits relative to {count[-1]}")
    for axes in (direct, orbits):
        axes.grid(lw=0.3)
    _plain(direct.yaxis)
    outer_legend(figure, 4, 2)
    return figure


def convergence_caption(bias, fits):
    count, n = [int(size) for size in bias.ensemble], bias.n.values
    etas = ", ".join(f"{_fitted(*fit)} at {angle:g}°" for angle, fit in fits.items())
    return (
        f"(a) Bias of direct iteration on rays at {', '.join(f'{angle:g}°' for angle in fits)}: "
        "the smallest excess over the breakup (by residues) at which at least one of "
        f"{count[-1]} orbits escapes within N steps (periods of the forcing), N ≤ {int(n[-1])}. It "
        f"falls like N^(-1/η), with η = {etas} (statistical errors of the fit; the grid of "
        "excesses "
        "and differences between rays contribute more). Grey lines: η from arXiv:1606.04824, "
        "and 3.012 from renormalisation. (b) Bias of smaller ensembles relative to the largest."
    )


def _fitted(eta, error):
    return f"{eta:.2f} ± {error:.2f}" if np.isfinite(eta) else "not found"


def _plain(axis):
    """Label a logarithmic axis at 0.1, 0.2, 0.5, 1 and so on."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("")


def draw_diagonal(diagonal):
    """Draw the bias of direct iteration on the diagonal, with fits for small and large N.

    The axes are those of the paper.
    """
    figure, (axes,) = panels(1, 1, 7, 5)
    axes.plot(diagonal.n, diagonal.distance, "ko", ms=4, mfc="none")
    etas = _etas(diagonal)
    for half, words in enumerate(diagonal.half.values):
        half_range = diagonal.isel(n=np.flatnonzero(diagonal.upper_half.values == half))
        label = rf"{words.replace('N', '$N$')}: $\eta$ = {etas[half]}"
        line = "-" if half else "--"
        axes.plot(half_range.n, half_range.fit, line, color=colour_of(half), label=label)
    mark_gaps(axes, diagonal.n.values, diagonal.distance.isnull().values)
    axes.set(xscale="log", yscale="log", xlabel="steps $N$", ylabel=r"$\kappa_N - \kappa_G$")
    _plain(axes.yaxis)
    orbits = rf"${power(diagonal.n_orbits)}$ orbits"
    axes.set_title(rf"{orbits} on $(\kappa_1, \kappa_2) = (\kappa, \kappa)$")
    axes.grid(lw=0.3)
    axes.legend()
    return figure


def _etas(diagonal):
    """Return η for small N and for large N, each with its error, as text."""
    fits = zip(diagonal.eta.values, diagonal.eta_error.values, strict=True)
    return [_fitted(*fit) for fit in fits]


def diagonal_caption(diagonal):
    etas = _etas(diagonal)
    small, large = int(diagonal.n[diagonal.upper_half == 0][-1]), int(diagonal.n[-1])
    return (
        "The boundary κ_N of global transport by direct iteration at the cusp, on (κ, κ), minus "
        "the "
        f"breakup κ_G = {diagonal.critical:.9f} by residues, with {diagonal.n_orbits} orbits. Fit: "
        f"(κ_N - κ_G) ~ N^(-1/η) with η = {etas[0]} for N up to {small}, and {etas[1]} from there "
        f"up to {large} (statistical errors of the fit; arXiv:1606.04824 gives 2.681, and 3.322 "
        "for large N)."
    )
