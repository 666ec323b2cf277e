"""Breakup of tori with irrational frequency, and pictures of a torus."""

import numpy as np

from workflows.figures.style import colour_of, in_column, key, line_of, outer_legend, panels

_CURVE = 12  # points are connected if a quarter plane has at least this many rays


def draw_breakups(breakups):
    """Draw breakups of tori in the quarter plane of κ̄ and Δκ, with certified scales as dots."""
    figure, (axes,) = panels(1, 1, 6.5, 6)
    radians, few = np.deg2rad(breakups.angle), breakups.angle.size < _CURVE
    direction = np.array([np.cos(radians), np.sin(radians)])
    for i in range(breakups.vector.size):
        of_vector, colour = breakups.isel(vector=i), colour_of(i)
        vector = f"{float(of_vector.omega):.6g}, {float(of_vector.frequency):.6g}"
        label = rf"$(\omega, \Omega) = ({vector})$"
        options = line_of(i) | ({"ls": "", "marker": "s", "mfc": "none"} if few else {})
        axes.plot(of_vector.kappa_mean, of_vector.kappa_amplitude, label=label, **options)
        axes.plot(*(of_vector.lower.values * direction), ".", color=colour, ms=4)
        mark = "v" if few else ":"
        axes.plot(*(of_vector.upper.values * direction), mark, color=colour, lw=1, ms=4)
    marks = "s" if few else "-", ".", "v" if few else ":"
    labels = "breakup", "last certified torus", r"no torus beyond, for any $\omega$"
    key(axes, dict(zip(marks, labels, strict=True)), "s")
    axes.set(xlabel=r"$\bar\kappa$", ylabel=r"$\Delta\kappa$", aspect="equal")
    axes.set(xlim=(0, None), ylim=(0, None), title="Breakup of two-dimensional tori")
    outer_legend(figure, 2)
    return figure


def breakups_caption(breakups):
    wide = 100 * float((breakups.error / breakups.critical_scale).median())
    error = f"median estimated error {wide:.2g}%" if np.isfinite(wide) else "none found"
    n_certified = f"{int(np.isfinite(breakups.lower).sum())} of {breakups.lower.size}"
    silent = int(breakups.critical_scale.isnull().sum())
    gaps = f"; {silent} of {breakups.lower.size} not found" if np.isfinite(wide) * silent else ""
    return (
        "Breakup of invariant tori of κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ) on rays (κ̄, Δκ) = s·(cos θ, "
        f"sin θ), by continuation (lines, or squares on few rays; {error}{gaps}), and the last "
        f"certified torus on each ray (dots; {n_certified}). Beyond the dotted lines, or "
        "triangles, converse KAM excludes all tori with the same Ω that are graphs, for any ω."
    )


def draw_pictures(torus):
    """Draw h - θ over (θ, φ) at scales that approach the breakup."""
    height = 7 if in_column() else 4
    figure, drawn = panels(1, torus.scale.size, 11, height, stack=False, sharey=True)
    reach = float(abs(torus.deviation).max())
    style = {"origin": "lower", "extent": (0, 1, 0, 1), "aspect": "auto", "cmap": "cividis"}
    for axes, (scale, of_scale) in zip(drawn, torus.groupby("scale"), strict=True):
        picture = axes.imshow(of_scale.squeeze().deviation, vmin=-reach, vmax=reach, **style)
        axes.set(xlabel=r"$\theta$ (turns)", title=f"$s = {scale:.5f}$", xticks=(0, 0.5, 1))
    drawn[0].set_ylabel(r"$\varphi$ (turns)")
    where = {"location": "bottom", "aspect": 40} if in_column() else {}
    figure.colorbar(picture, ax=drawn, label=r"$h - \theta$ (turns)", **where)
    figure.suptitle("A torus approaching its breakup")
    return figure


def pictures_caption(torus):
    known = torus.least_slope.fillna(0).values
    slopes = ", ".join(f"{slope:.3f}" if slope else "unknown (no torus)" for slope in known)
    return (
        f"The torus with rotation vector ({torus.attrs['vector']}) on the ray at "
        f"{torus.attrs['angle']:g}°: h(θ, φ) - θ at 0.7, 0.95 and 0.99 times the last certified "
        f"scale. The minimum slope ∂h/∂θ is {slopes}; it stays positive as long as h is monotonic, "
        "and vanishes at the breakup."
    )
