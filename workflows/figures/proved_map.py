"""The map of forcings for which transport is proved to be global, or a barrier to exist."""

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from workflows.figures.style import COLOURS, outer_legend, panels

_STATES = {
    "open": ("0.9", "open"),
    "transport_is_global": (COLOURS[1], "transport is proved to be global"),
    "barrier_exists": (COLOURS[0], "a barrier is proved to exist"),
}


def draw_proved_map(cube, barrier):
    """Draw the four quadrants of the plane, and CB_gt by residues as a line; and the caption.

    cube : `proved_map`; its half κ2 > κ1 is filled by reflection. barrier : CB_gt from 0° to 45°.
    """
    flags = cube.proved.attrs
    codes = dict(zip(flags["flag_meanings"].split(), flags["flag_values"], strict=True))
    states = np.triu(cube.proved.values)
    states = np.maximum(states, states.T)
    whole = np.block([[states[::-1, ::-1], states[::-1]], [states[:, ::-1], states]])
    figure, (axes,) = panels(1, 1, 7.5, 7.4)
    reach = float(cube.kappa1[-1] + cube.kappa1[0])
    style = {"origin": "lower", "extent": 2 * (-reach, reach), "interpolation": "nearest"}
    colours = ListedColormap([colour for colour, _ in _STATES.values()])
    index = np.select([whole == codes[name] for name in _STATES], range(len(_STATES)))
    axes.imshow(index, cmap=colours, vmin=0, vmax=len(_STATES) - 1, **style)
    x = np.append(barrier.kappa1, barrier.kappa2[::-1])
    y = np.append(barrier.kappa2, barrier.kappa1[::-1])
    for sign1, sign2 in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        axes.plot(sign1 * x, sign2 * y, color="black", lw=0.8)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    patches = [Patch(color=colour, label=words) for colour, words in _STATES.values()]
    outer_legend(figure, 3, 1, "upper", handles=patches, frameon=False, fontsize=None)
    return figure, _caption(cube, states, codes, barrier)


def _caption(cube, states, codes, barrier):
    kappa1, kappa2 = np.meshgrid(cube.kappa1, cube.kappa2)
    angle = np.rad2deg(np.arctan2(kappa2, kappa1))
    excess = np.hypot(kappa1, kappa2) / np.interp(angle, barrier.angle, barrier.critical_scale) - 1

    def side(name, there):
        there = there & (kappa2 <= kappa1)
        open_ = 100 * np.abs(excess[there & (states != codes[name])])
        within = "Nothing is open there."
        if open_.size:
            half, most, last = np.quantile(open_, [0.5, 0.95, 1])
            within = (
                f"Half of what is open there is within {half:.3g}% of the boundary, 95% within "
                f"{most:.3g}%, all within {last:.3g}%."
            )
        return f"for every forcing of {100 * (states[there] == codes[name]).mean():.1f}%", within

    outside, left = side("transport_is_global", excess > 0)
    inside, left_inside = side("barrier_exists", excess < 0)
    return (
        f"Transport is proved to be global {outside} of what is outside CB_gt (by residues, "
        f"the line), in cells down to 1/{cube.attrs['cells']}. {left} A barrier is proved to exist "
        f"{inside} of what is inside. {left_inside}"
    )
