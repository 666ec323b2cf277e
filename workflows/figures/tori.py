"""Breakup of tori of irrational frequency, and tori."""

import matplotlib.pyplot as plt
import numpy as np

from workflows.figures.style import colour_of, line_of


def draw_breakups(breakups):
    """Draw where tori break in the quarter plane of κ̄ and Δκ, with the certified scales as dots."""
    figure, axes = plt.subplots(figsize=(6.5, 6), layout="constrained")
    for i, vector in enumerate(breakups.vector.values):
        here = breakups.isel(vector=i)
        omega, frequency = (float(number) for number in vector.split(","))
        label = rf"$(\omega, \Omega) = ({omega:.6g}, {frequency:.6g})$"
        axes.plot(here.kappa_mean, here.kappa_amplitude, label=label, **line_of(i))
        radians = np.deg2rad(here.angle)
        dots = here.lower * np.cos(radians), here.lower * np.sin(radians)
        axes.plot(*dots, ".", color=colour_of(i))
        ends = here.upper * np.cos(radians), here.upper * np.sin(radians)
        axes.plot(*ends, ":", color=colour_of(i), lw=1)
    axes.set(xlabel=r"$\bar\kappa$", ylabel=r"$\Delta\kappa$", aspect="equal")
    axes.set(xlim=(0, None), ylim=(0, None), title="Breakup of two-dimensional tori")
    axes.legend()
    wide = 100 * float((breakups.error / breakups.critical_scale).median())
    return figure, (
        "Breakup of invariant tori of κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ) by continuation (lines; the "
        f"estimated error is {wide:.2g}% in the median), and the last torus that is certified on "
        f"each ray (dots; {int(np.isfinite(breakups.lower).sum())} of {breakups.lower.size} rays). "
        "Beyond the dotted lines converse KAM leaves no torus of that Ω that is a graph, of any ω. "
        "Angles of rays (κ̄, Δκ) = s·(cos θ, sin θ)."
    )


def draw_pictures(torus):
    """Draw h - θ over (θ, φ) on the way to the breakup."""
    figure, panels = plt.subplots(1, torus.scale.size, figsize=(11, 4), layout="constrained")
    for axes, (scale, here) in zip(panels, torus.groupby("scale"), strict=True):
        here = here.squeeze()
        picture = axes.imshow(
            here.deviation, origin="lower", extent=(0, 1, 0, 1), aspect="auto", cmap="cividis"
        )
        figure.colorbar(picture, ax=axes, location="bottom", label=r"$h - \theta$")
        axes.set(xlabel=r"$\theta$", ylabel=r"$\varphi$", title=f"$s = {scale:.5f}$")
        axes.label_outer()
    slopes = ", ".join(f"{float(slope):.3f}" for slope in torus.least_slope)
    return figure, (
        f"The torus of rotation vector ({torus.attrs['vector']}) on the ray of "
        f"{torus.attrs['angle']:g}°: h(θ, φ) - θ at 0.7, 0.95 and 0.99 times the last "
        f"scale at which it is certified. The least slope of h along θ is {slopes}; it is 0 at "
        "the breakup."
    )
