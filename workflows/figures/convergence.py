"""Error against effort, Fig. 7 and its likes, with their captions."""

import matplotlib.pyplot as plt
import numpy as np

from workflows.figures.style import CIRCLE_COLOURS, letter, power


def draw_convergence(bias, others, fits):
    """Draw error against effort of four methods, Fig. 7 and its likes, on logarithmic axes."""
    figure, panels = plt.subplots(2, 2, figsize=(11, 9), layout="constrained")
    direct, orbits, cones, sharp = panels.flat
    for i, angle in enumerate(bias.angle.values):
        dashes = (2 * i, (4, 4)) if i else "-"  # where curves coincide, all are seen
        colour, words = CIRCLE_COLOURS[i], rf"$\varphi = {angle:g}°$"
        eta, deviation = fits[angle]
        label = rf"{words}: $\eta = {eta:.2f} \pm {deviation:.2f}$"
        direct.plot(bias.n, bias.sel(angle=angle)[-1], ".", color=colour, label=label)
        ratio = bias.sel(angle=angle) / bias.sel(angle=angle).isel(ensemble=-1)
        orbits.plot(bias.ensemble, ratio.mean("n"), ".", ls=dashes, color=colour, label=words)
        here = others.sel(angle=angle)
        cones.plot(here.steps, here.cones_raw, "o", ls=dashes, color=colour, label=words)
        cones.plot(here.steps, here.cones_corrected, "s", ls=dashes, color=colour, mfc="none")
        q = here.residue.dropna("q")
        sharp.plot(q.q, q, ".", ls=dashes, color=colour, label=words)
        sharp.plot(here.modes, here.circles_raw, "^", ls=dashes, color=colour, mfc="none")
    n = bias.n.values
    middle = float(bias[-1].median())
    for slope, style in ((2.681, ":"), (3.012, "-"), (3.322, "--")):
        guide = middle * (n / np.sqrt(n[0] * n[-1])) ** (-1 / slope)
        direct.plot(n, guide, style, color="0.6", lw=1, label=rf"$\eta = {slope}$")
    count = [int(size) for size in bias.ensemble]
    direct.set(title=f"Direct iteration, {count[-1]} orbits", xlabel="steps $N$")
    direct.set_ylabel(r"$\kappa_N/\kappa_c - 1$")
    orbits.set(title=f"Bias in parts of that with {count[-1]} orbits", xlabel="orbits $M$")
    orbits.set_ylabel("mean over $N$")
    cones.set(title="Converse KAM", xlabel="steps $N$", ylabel="relative error")
    sharp.set(
        title="Greene's residue, and certified circles",
        xlabel="period $q$, or grid points $n$",
        ylabel="relative error",
    )
    for axes, mark, words in (
        (cones, "o", "upper bound"),
        (cones, "s", "corrected for $N$"),
        (sharp, ".", "residue crossing, by $q$"),
        (sharp, "^", "last certified circle, by $n$"),
    ):
        axes.plot([], [], mark, color="0.4", mfc="none" if mark in "s^" else None, label=words)
    for axes, name in zip(panels.flat, "abcd", strict=True):
        letter(axes, name)
        axes.set(xscale="log", yscale="linear" if axes is orbits else "log")
        axes.grid(lw=0.3)
        axes.legend(fontsize="x-small")
    return figure


def describe(bias, fits):
    """Describe `draw_convergence`, with the fitted exponents."""
    etas = ", ".join(
        f"{eta:.2f} ± {error:.2f} at {angle:g}°" for angle, (eta, error) in fits.items()
    )
    orbits, steps = int(bias.ensemble[-1]), int(bias.n[-1])
    return (
        f"Error against effort on rays at {', '.join(f'{angle:g}°' for angle in fits)}, in parts "
        "of the breakup by residues. Direct iteration (above): the excess over the breakup from "
        f"which on some of {orbits} orbits escapes within N ≤ {steps} steps falls like N^(-1/η), "
        f"with η = {etas}; grey: the paper's η and renormalisation's, 3.012. Below: converse KAM, "
        "Greene's residue and certified circles."
    )


def draw_diagonal(diagonal):
    """Draw direct iteration on the diagonal in the paper's axes, with a line for each half of N."""
    figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
    axes.plot(diagonal.n, diagonal.distance, "ko", ms=4, mfc="none")
    for half, words in enumerate(diagonal.half.attrs["names"]):
        here = diagonal.isel(n=np.flatnonzero(diagonal.upper_half.values == half))
        eta, error = float(diagonal.eta[half]), float(diagonal.eta_error[half])
        axes.plot(
            here.n,
            here.fit,
            "-" if half else "--",
            color=CIRCLE_COLOURS[half],
            label=rf"{words}: $\eta = {eta:.2f} \pm {error:.2f}$",
        )
    axes.set(xscale="log", yscale="log", xlabel="steps $N$", ylabel=r"$\kappa_N - \kappa_G$")
    axes.set_title(
        rf"${power(diagonal.n_orbits)}$ orbits on $(\kappa_1, \kappa_2) = (\kappa, \kappa)$"
    )
    axes.grid(lw=0.3)
    axes.legend()
    return figure


def describe_diagonal(diagonal):
    """Describe `draw_diagonal`, with the fitted exponents."""
    etas = [
        f"{float(diagonal.eta[half]):.2f} ± {float(diagonal.eta_error[half]):.2f}"
        for half in (0, 1)
    ]
    small, large = int(diagonal.n[diagonal.upper_half == 0][-1]), int(diagonal.n[-1])
    return (
        "The boundary of global transport by direct iteration at the cusp of the horn, on (κ, κ), "
        f"less the breakup κ_G = {diagonal.critical:.9f} by residues, with {diagonal.n_orbits} "
        f"orbits; (κ_N - κ_G) ~ N^(-1/η) with η = {etas[0]} for N up to {small}, and "
        f"{etas[1]} beyond, up to {large} (errors of the fit alone; the paper has 2.681, "
        "and 3.322 for large N)."
    )
