"""Error against effort, Fig. 7 and its likes, with their captions."""

import numpy as np
from matplotlib.ticker import LogLocator

from workflows.figures.style import colour_of, in_column, key, mark_gaps, names_of, panels, power


def draw_convergence(bias, others, fits):
    """Draw error against effort of four methods, Fig. 7 and its likes, on logarithmic axes."""
    figure, (direct, orbits, cones, sharp) = panels(2, 2, 11, 9)
    count, n = [int(size) for size in bias.ensemble], bias.n.values
    for i, angle in enumerate(bias.angle.values):
        (eta, error), here, other = fits[angle], bias.sel(angle=angle), others.sel(angle=angle)
        label = rf"$\varphi = {angle:g}°$"
        label += rf": $\eta = {eta:.2f} \pm {error:.2f}$" if np.isfinite(eta) else ""
        # Where curves coincide, all are seen: dashes, and smaller marks, in front of the first.
        look = {"color": colour_of(i), "ls": (2 * i, (4, 4)) if i else "-"}
        small, q = look | {"ms": 10 / (1 + i)}, other.residue.dropna("q")
        direct.plot(n, here[-1], ".", color=colour_of(i), label=label)
        orbits.plot(bias.ensemble, (here / here.isel(ensemble=-1)).mean("n"), ".", **small)
        cones.plot(other.steps, other.cones_raw, ".", **small)
        cones.plot(other.steps, other.cones_corrected, "s", ms=5, mfc="none", **look)
        sharp.plot(q.q, q, ".", **small)
        sharp.plot(other.modes, other.circles_raw, "^", ms=9 - 4 * i, mfc="none", **look)
    middle = float(bias[-1].median())
    for slope, style in ((2.681, ":"), (3.012, "-"), (3.322, "--")):
        guide = middle * (n / np.sqrt(n[0] * n[-1])) ** (-1 / slope)
        direct.plot(n, guide, style, color="0.6", lw=1, label=rf"$\eta = {slope}$")
    mark_gaps(direct, n, bias[-1].isnull().any("angle").values)
    mark_gaps(cones, others.steps.values, others.cones_raw.isnull().any("angle").values)
    mark_gaps(sharp, others.modes.values, others.circles_raw.isnull().any("angle").values)
    key(cones, {".": "upper bound", "s": "corrected for $N$"}, "s")
    key(sharp, {".": "residue crossing, by $q$", "^": "last certified circle, by $n$"}, "^")
    bias_of = f"Bias of $M$ orbits over that of {count[-1]}"
    residues, periods = "Greene's residue, and certified circles", "period $q$, or grid points $n$"
    for axes, title, x, y in (
        (direct, f"Direct iteration, {count[-1]} orbits", "steps $N$", r"$\kappa_N/\kappa_c - 1$"),
        (orbits, bias_of, "orbits $M$", f"bias over that of {count[-1]} orbits"),
        (cones, "Converse KAM", "steps $N$", "relative error"),
        (sharp, residues, periods, "relative error"),
    ):
        axes.set(title=title, xlabel=x, ylabel=y, xscale="log")
        axes.set_yscale("linear" if axes is orbits else "log")
        axes.grid(lw=0.3)
        if axes in (cones, sharp):
            axes.legend(fontsize="small", loc="lower left")
    _plain(direct.yaxis)
    if in_column():
        figure.legend(*direct.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    else:
        direct.legend(fontsize="x-small", loc="upper right")
    etas = ", ".join(f"{_fitted(*fit)} at {angle:g}°" for angle, fit in fits.items())
    return figure, (
        f"Error against effort on rays at {', '.join(f'{angle:g}°' for angle in fits)}, in parts "
        "of the breakup by residues. Direct iteration (above): the excess over the breakup from "
        f"which on some of {count[-1]} orbits escapes within N ≤ {int(n[-1])} steps falls like "
        f"N^(-1/η), with η = {etas}; grey: the paper's η and renormalisation's, 3.012. Below: "
        "converse KAM, Greene's residue and certified circles."
    )


def _fitted(eta, error):
    return f"{eta:.2f} ± {error:.2f}" if np.isfinite(eta) else "not found"


def _plain(axis):
    """Let a logarithmic axis have labels 0.1, 0.2, 0.5, 1, …"""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("")


def draw_diagonal(diagonal):
    """Draw direct iteration on the diagonal in the paper's axes, with a line for each half of N."""
    figure, (axes,) = panels(1, 1, 7, 5)
    axes.plot(diagonal.n, diagonal.distance, "ko", ms=4, mfc="none")
    etas = []
    for half, words in enumerate(names_of(diagonal.half)):
        here = diagonal.isel(n=np.flatnonzero(diagonal.upper_half.values == half))
        etas.append(_fitted(float(diagonal.eta[half]), float(diagonal.eta_error[half])))
        label = rf"{words.replace('N', '$N$')}: $\eta$ = {etas[-1]}"
        axes.plot(here.n, here.fit, "-" if half else "--", color=colour_of(half), label=label)
    mark_gaps(axes, diagonal.n.values, diagonal.distance.isnull().values)
    axes.set(xscale="log", yscale="log", xlabel="steps $N$", ylabel=r"$\kappa_N - \kappa_G$")
    _plain(axes.yaxis)
    orbits = rf"${power(diagonal.n_orbits)}$ orbits"
    axes.set_title(rf"{orbits} on $(\kappa_1, \kappa_2) = (\kappa, \kappa)$")
    axes.grid(lw=0.3)
    axes.legend()
    small, large = int(diagonal.n[diagonal.upper_half == 0][-1]), int(diagonal.n[-1])
    return figure, (
        "The boundary of global transport by direct iteration at the cusp of the horn, on (κ, κ), "
        f"less the breakup κ_G = {diagonal.critical:.9f} by residues, with {diagonal.n_orbits} "
        f"orbits; (κ_N - κ_G) ~ N^(-1/η) with η = {etas[0]} for N up to {small}, and "
        f"{etas[1]} beyond, up to {large} (errors of the fit alone; the paper has 2.681, "
        "and 3.322 for large N)."
    )
