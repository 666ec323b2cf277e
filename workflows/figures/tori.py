"""Breakup of tori of irrational frequency, and tori."""

import matplotlib.pyplot as plt
import numpy as np

from workflows.figures.style import colour_of, line_of, panels, size

_CURVE = 12  # rays of a quarter plane, from which on the points are joined


def draw_breakups(breakups):
    """Draw where tori break in the quarter plane of κ̄ and Δκ, with the certified scales as dots."""
    figure, (axes,) = panels(1, 1, 6.5, 6)
    for i, vector in enumerate(breakups.vector.values):
        here = breakups.isel(vector=i)
        omega, frequency = (float(number) for number in vector.split(","))
        label = rf"$(\omega, \Omega) = ({omega:.6g}, {frequency:.6g})$"
        style = line_of(i)
        style |= {} if here.angle.size >= _CURVE else {"ls": "", "marker": "s", "mfc": "none"}
        axes.plot(here.kappa_mean, here.kappa_amplitude, label=label, **style)
        radians = np.deg2rad(here.angle)
        dots = here.lower * np.cos(radians), here.lower * np.sin(radians)
        axes.plot(*dots, ".", color=colour_of(i), ms=4)
        ends = here.upper * np.cos(radians), here.upper * np.sin(radians)
        axes.plot(*ends, ":" if here.angle.size >= _CURVE else "v", color=colour_of(i), lw=1, ms=4)
    axes.set(xlabel=r"$\bar\kappa$", ylabel=r"$\Delta\kappa$", aspect="equal")
    axes.set(xlim=(0, None), ylim=(0, None), title="Breakup of two-dimensional tori")
    axes.legend()
    wide = 100 * float((breakups.error / breakups.critical_scale).median())
    error = (
        f"the estimated error is {wide:.2g}% in the median" if np.isfinite(wide) else "none found"
    )
    return figure, (
        "Breakup of invariant tori of κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ) by continuation (lines, or "
        f"squares of few rays; {error}), and the last "
        "torus that is certified on each ray (dots; "
        f"{int(np.isfinite(breakups.lower).sum())} of {breakups.lower.size} rays). "
        "Beyond the dotted lines, or triangles, converse KAM leaves no torus of that Ω that is a "
        "graph, of any ω. "
        "Angles of rays (κ̄, Δκ) = s·(cos θ, sin θ)."
    )


def draw_pictures(torus):
    """Draw h - θ over (θ, φ) on the way to the breakup."""
    count, layout = torus.scale.size, {"layout": "constrained", "sharey": True}
    figure, drawn = plt.subplots(1, count, figsize=size(11, 4), **layout)
    reach = float(abs(torus.deviation).max())
    style = {"origin": "lower", "extent": (0, 1, 0, 1), "aspect": "auto", "cmap": "cividis"}
    for axes, (scale, here) in zip(drawn, torus.groupby("scale"), strict=True):
        picture = axes.imshow(here.squeeze().deviation, vmin=-reach, vmax=reach, **style)
        axes.set(xlabel=r"$\theta$ (turns)", title=f"$s = {scale:.5f}$", xticks=(0, 0.5, 1))
    drawn[0].set_ylabel(r"$\varphi$ (turns)")
    figure.colorbar(picture, ax=drawn, label=r"$h - \theta$ (turns)")
    figure.suptitle("A torus on the way to its breakup")
    known = torus.least_slope.fillna(0).values
    slopes = ", ".join(f"{slope:.3f}" if slope else "not known (no torus)" for slope in known)
    return figure, (
        f"The torus of rotation vector ({torus.attrs['vector']}) on the ray of "
        f"{torus.attrs['angle']:g}°: h(θ, φ) - θ at 0.7, 0.95 and 0.99 times the last "
        f"scale at which it is certified. The least slope of h along θ is {slopes}; it is 0 at "
        "the breakup."
    )
