"""The bracket of the last barrier that is proved, around the plane and by angle."""

import matplotlib.pyplot as plt
import numpy as np

from workflows.figures.style import letters

_SIDES = {"upper": ("transport proved", "#D55E00"), "lower": ("barrier proved", "#0072B2")}


def draw_proved_boundary(barrier):
    """Draw the forcings that are proved, and how near they are; the caption has the widths."""
    figure, (plane, near) = plt.subplots(1, 2, figsize=(12, 5.4), layout="constrained")
    direction = [barrier[name] / barrier.critical_scale for name in ("kappa1", "kappa2")]
    plane.plot(barrier.kappa1, barrier.kappa2, color="0.6", lw=0.8)
    for side, (label, colour) in _SIDES.items():
        scale = barrier[f"proved_{side}"]
        plane.plot(*(scale * part for part in direction), ".", color=colour, ms=3)
        distance = abs(scale / barrier.critical_scale - 1)
        style = {"color": colour, "marker": "^" if side == "upper" else "v", "ms": 3, "lw": 0.8}
        near.plot(barrier.angle, distance, label=label, **style)
    plane.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    plane.set_title("Forcings that are proved")
    near.set(yscale="log", xlim=(0, 90), xticks=range(0, 91, 15))
    near.set(xlabel=r"angle $\varphi$ of the ray (degrees)", ylabel=r"$|s/s_c - 1|$")
    near.set_title("How far from the breakup; other angles are images")
    near.legend()
    letters([plane, near])
    return figure, _caption(barrier)


def _caption(barrier):
    width = ((barrier.proved_upper - barrier.proved_lower) / barrier.critical_scale).values
    proved = np.isfinite(width)
    if not proved.any():
        return "Nothing was proved on both sides of any ray; allow more --seconds."
    return (
        f"On {proved.sum()} of {width.size} rays around the plane a barrier is proved to exist at "
        "one forcing and transport to be global at another one, in the median "
        f"{np.nanmedian(width):.1e} of the scale apart, at most {np.nanmax(width):.1e}. Below the "
        "lower one nothing is proved by that, as a circle might break and come back; between the "
        "two nothing at all. The proofs assume IEEE arithmetic, and FLINT's balls."
    )
