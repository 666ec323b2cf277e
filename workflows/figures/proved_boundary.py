"""Figure of the proved bracket of the last barrier, in the plane and against the angle."""

import numpy as np

from workflows.figures.style import COLOURS, VERMILION, outer_legend, panels

_CURVE = 90  # with at least this many rays around the plane, CB_gt is drawn as a line
_SIDES = {
    "upper": ("transport proved", VERMILION, "^-"),
    "lower": ("barrier proved", COLOURS[0], "v-"),
    "below": ("barrier proved for all weaker kicks too", COLOURS[3], "s-"),
}


def draw_proved_boundary(barrier):
    """Draw the forcings with a proof, and their distance from the boundary."""
    figure, (plane, near) = panels(1, 2, 12, 5.4)
    direction = [barrier[name] / barrier.critical_scale for name in ("kappa1", "kappa2")]
    curve = "-" if barrier.angle.size >= _CURVE else "+"
    words = r"$\mathit{CB}_{gt}$ by residues"
    plane.plot(barrier.kappa1, barrier.kappa2, curve, color="0.6", lw=0.8, label=words)
    quadrant = barrier.sel(angle=slice(0, 90))
    for side, (label, colour, form) in _SIDES.items():
        scale = barrier[f"proved_{side}"]
        plane.plot(*(scale * part for part in direction), form[0], color=colour, ms=2)
        distance = abs(quadrant[f"proved_{side}"] / quadrant.critical_scale - 1)
        near.plot(quadrant.angle, distance, form, color=colour, ms=3, lw=0.8, label=label)
    plane.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    plane.set_title("Forcings with a proof")
    near.set(yscale="log", xlim=(0, 90), xticks=range(0, 91, 15))
    near.set(xlabel=r"angle $\varphi$ of the ray (degrees)", ylabel=r"$|s/s_c - 1|$")
    near.set_title("Distance from the breakup; other angles by symmetry")
    outer_legend(figure, 4)
    return figure


def proved_boundary_caption(barrier):
    """Describe the width of the proved bracket, and the reach of the proofs along rays."""
    width = ((barrier.proved_upper - barrier.proved_lower) / barrier.critical_scale).values
    proved = np.isfinite(width)
    if not proved.any():
        return "No ray has a proof on both sides; increase --cpu-seconds."
    below = float((barrier.proved_below / barrier.critical_scale).median())
    return (
        f"On {proved.sum()} of {width.size} rays around the plane a barrier is proved to exist at "
        "one forcing, and transport is proved to be global at another. The relative distance "
        f"between the two has a median of {100 * np.nanmedian(width):.2g}% and a maximum of "
        f"{100 * np.nanmax(width):.2g}%; between them nothing is proved. A proof at one forcing "
        "says nothing about weaker kicks, because a circle might break and reappear. Other proofs "
        f"cover the ray from the origin to {np.ceil(1e4 * (1 - below)) / 100:g}% below the breakup "
        "(median of the rays on which they succeed): there a barrier is proved to exist at every "
        "forcing. The proofs rely on IEEE-754 arithmetic and FLINT."
    )
