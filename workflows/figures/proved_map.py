"""The map of forcings for which transport is proved to be global, or a barrier to exist."""

from itertools import product

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from workflows.figures.style import COLOURS, outer_legend, panels

_STATES = {
    "open": ("0.9", "open"),
    "transport_is_global": (COLOURS[1], "transport is proved to be global"),
}


def draw_proved_map(cube, triangles, barrier):
    """Draw the four quadrants of the plane, and CB_gt by residues as a line; and the caption.

    cube : `proved_map`; its half κ2 > κ1 is filled by reflection. triangles : `proved_triangles`.
    barrier : CB_gt from 0° to 45°.
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
    colour, words = COLOURS[0], "a barrier is proved to exist"
    for sides in ([0, 1], [1, 0]):
        for signs in product((1, -1), repeat=2):
            for corners in _far_sides(triangles):
                axes.fill(*(signs * corners[:, sides]).T, color=colour, lw=0, aa=False)
    x = np.append(barrier.kappa1, barrier.kappa2[::-1])
    y = np.append(barrier.kappa2, barrier.kappa1[::-1])
    for sign1, sign2 in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        axes.plot(sign1 * x, sign2 * y, color="black", lw=0.8)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    legend = [*_STATES.values(), (colour, words)]
    patches = [Patch(color=colour, label=words) for colour, words in legend]
    outer_legend(figure, 3, 1, "upper", handles=patches, frameon=False, fontsize=None)
    return figure, _caption(cube, states, codes, triangles, barrier)


def _far_sides(triangles):
    """Corners (n, 3, 2) of what is proved of the triangles."""
    names = [[f"kappa{i}_{end}" for i in (1, 2)] for end in ("low", "high")]
    far = np.array([[triangles[name].values for name in row] for row in names])
    far = np.moveaxis(triangles.proved_below.values * far, 2, 0)
    return np.concatenate([np.zeros_like(far[:, :1]), far], axis=1)


def _caption(cube, states, codes, triangles, barrier):
    kappa1, kappa2 = np.meshgrid(cube.kappa1, cube.kappa2)
    angle = np.rad2deg(np.arctan2(kappa2, kappa1))
    excess = np.hypot(kappa1, kappa2) / np.interp(angle, barrier.angle, barrier.critical_scale) - 1

    there = (excess > 0) & (kappa2 <= kappa1)
    open_ = 100 * excess[there & (states != codes["transport_is_global"])]
    within = "Nothing is open there."
    if open_.size:
        half, most, last = np.quantile(open_, [0.5, 0.95, 1])
        within = (
            f"Half of what is open there is within {half:.3g}% of the boundary, 95% within "
            f"{most:.3g}%, all within {last:.3g}%."
        )
    share = 100 * (states[there] == codes["transport_is_global"]).mean()
    # How far from CB_gt the proved triangles end, on its rays.
    rays = np.stack([barrier.kappa1, barrier.kappa2], -1)
    ends = np.zeros(len(rays))
    for _, low, high in _far_sides(triangles):
        at = np.linalg.solve(np.stack([low, high], 1) + 1e-300 * np.eye(2), rays.T)
        ends = np.where((at >= -1e-9).all(axis=0), np.maximum(ends, 1 / at.sum(axis=0)), ends)
    half, most, last = 100 * (1 - np.quantile(ends, [0.5, 0.05, 0]))
    return (
        f"Transport is proved to be global for every forcing of {share:.1f}% of what is outside "
        f"CB_gt (by residues, the line), in cells down to 1/{cube.attrs['cells']}. {within} A "
        f"barrier is proved to exist in {triangles.sizes['triangle']} triangles from 0 on and "
        f"their images: on half of the rays of CB_gt to {half:.3g}% below it, on 95% to "
        f"{most:.3g}%, on all to {last:.3g}%."
    )
