"""Error against effort, Fig. 7 and its likes."""

import matplotlib.pyplot as plt
import numpy as np

from workflows.figures.style import CIRCLE_COLOURS


def draw_convergence(bias, others, fits):
    """Error against effort of four methods, Fig. 7 and its likes, on logarithmic axes."""
    figure, panels = plt.subplots(2, 2, figsize=(11, 9), layout="constrained")
    direct, orbits, cones, sharp = panels.flat
    for i, angle in enumerate(bias.angle.values):
        colour, words = CIRCLE_COLOURS[i], rf"$\varphi = {angle:g}°$"
        eta, deviation = fits[angle]
        label = rf"{words}: $\eta = {eta:.2f} \pm {deviation:.2f}$"
        direct.plot(bias.n, bias.sel(angle=angle)[-1], ".", color=colour, label=label)
        ratio = bias.sel(angle=angle) / bias.sel(angle=angle).isel(ensemble=-1)
        orbits.plot(bias.ensemble, ratio.mean("n"), ".-", color=colour, label=words)
        here = others.sel(angle=angle)
        cones.plot(here.steps, here.cones_raw, "o-", color=colour, label=f"{words}: upper")
        cones.plot(here.steps, here.cones_corrected, "s--", color=colour, mfc="none")
        q = here.residue.dropna("q")
        sharp.plot(q.q, q, ".-", color=colour, label=f"{words}: residues")
        sharp.plot(here.modes, here.circles_raw, "^--", color=colour, mfc="none")
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
    cones.set(title="Converse KAM; dashed: corrected", xlabel="steps $N$", ylabel="relative error")
    sharp.set(
        title="Residue crossings; dashed: last certified circle",
        xlabel="period $q$, or grid points $n$",
        ylabel="relative error",
    )
    for axes in panels.flat:
        axes.set(xscale="log", yscale="linear" if axes is orbits else "log")
        axes.grid(lw=0.3)
        axes.legend(fontsize="x-small")
    return figure
