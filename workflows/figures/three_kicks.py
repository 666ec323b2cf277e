"""Boundaries of the rotating standard map with Ω = 1/3 against that of T."""

import matplotlib.pyplot as plt
import numpy as np

from workflows.figures.rotating import draw_diamond, fill_diamond
from workflows.figures.stretches import where_above
from workflows.figures.style import line_of, mark_gaps


def draw_three_kicks(three, two):
    """Draw the boundaries in the (κ̄, Δκ) plane, and by angle in parts of that of T.

    The caption says where three kicks outlast two.
    """
    layout = {"layout": "constrained", "width_ratios": [1.25, 1]}
    figure, (plane, strip) = plt.subplots(1, 2, figsize=(13, 5.6), **layout)
    fill_diamond(plane, two, r"$\mathit{CB}_{gt}$ of $T$ ($\Omega = 1/2$)")
    strip.axhline(1, color="black", lw=1)
    for i, text in enumerate(three.phase.attrs["exact"]):
        curve = three.isel(phase=i)
        line = {"lw": 1.1, "label": rf"$\varphi_0 = {text}$", **line_of(i)}
        draw_diamond(plane, curve, **line)
        strip.plot(three.angle, curve.ratio, **line)
        half = curve.error / curve.critical_scale * curve.ratio
        band, style = (curve.ratio - half, curve.ratio + half), {"alpha": 0.25, "lw": 0}
        strip.fill_between(three.angle, *band, color=line["color"], **style)
    mark_gaps(strip, three.angle.values, np.isnan(three.ratio.values).any(axis=0))
    plane.set(xlabel=r"$\bar\kappa$", ylabel=r"$\Delta\kappa$", aspect="equal")
    plane.set_title(r"Onset of global transport for $\Omega = 1/3$ and $1/2$")
    plane.legend(loc="upper right", fontsize="small")
    strip.set(xlabel=r"angle $\theta$ of the ray in the plane (degrees)", xlim=(0, 180))
    strip.set_ylabel(r"scale of the breakup over that of $T$")
    strip.set_xticks(range(0, 181, 30))
    strip.set_title("Above 1: three kicks outlast two")
    strip.grid(lw=0.3)
    relative = three.error / three.critical_scale
    parts = [
        "Boundary of global transport of the rotating standard map with Ω = 1/3 for several phases "
        "φ0, by converse KAM on transversals, against that of T (Ω = 1/2, black and grey): in the "
        "plane of the mean strength κ̄ and the amplitude Δκ, and as the ratio of the scales along "
        "rays (κ̄, Δκ) = s·(cos θ, sin θ).",
        f"Bands: estimated errors, {float(relative.median()):.1e} of the scale in the median and "
        f"{float(relative.max()):.1e} at most. Three kicks outlast two:",
    ]
    for i, phase in enumerate(three.phase.attrs["exact"]):
        parts.append(f"φ0 = {phase}: {where_above(three.angle.values, three.ratio.values[i])}.")
    return figure, " ".join(parts)
