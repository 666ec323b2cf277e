"""The map of forcings for which global transport, or the existence of a barrier, is proved."""

from itertools import product

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from workflows.figures.style import COLOURS, has_flag, outer_legend, panels

_LEGEND = {
    "open": "0.9",
    "transport is proved to be global": COLOURS[1],
    "a barrier is proved to exist": COLOURS[0],
}


def draw_proved_map(cube, triangles, barrier):
    """Draw the four quadrants of the plane, and CB_gt, computed by residues, as a line.

    cube : `proved_map`; its half κ2 > κ1 is filled by reflection. triangles : `proved_triangles`.
    barrier : CB_gt from 0° to 45°.
    """
    proved = _transport(cube)
    whole = np.block([[proved[::-1, ::-1], proved[::-1]], [proved[:, ::-1], proved]])
    figure, (axes,) = panels(1, 1, 7.5, 7.4)
    reach = float(cube.kappa1[-1] + cube.kappa1[0])
    style = {"origin": "lower", "extent": 2 * (-reach, reach), "interpolation": "nearest"}
    axes.imshow(whole, cmap=ListedColormap([*_LEGEND.values()][:2]), vmin=0, vmax=1, **style)
    rays, corners = _rays(barrier), _corners(triangles)
    line = np.concatenate([rays, rays[::-1, ::-1]])
    for signs in product((1, -1), repeat=2):
        for sides, one in product(([0, 1], [1, 0]), corners):
            axes.fill(*(signs * one[:, sides]).T, color=COLOURS[0], lw=0, aa=False)
        axes.plot(*(signs * line).T, color="black", lw=0.8)
    axes.set(xlabel=r"$\kappa_1$", ylabel=r"$\kappa_2$", aspect="equal")
    patches = [Patch(color=colour, label=label) for label, colour in _LEGEND.items()]
    patches.append(Line2D([], [], color="black", lw=0.8, label=r"$\mathit{CB}_{gt}$ by residues"))
    outer_legend(figure, 2, 1, "upper", handles=patches, frameon=False, fontsize=None)
    return figure


def _transport(cube):
    """Return an array (κ2, κ1), True where transport is proved; half of it is a reflection."""
    proved = np.triu(has_flag(cube.proved, "transport_is_global"))
    return proved | proved.T


def _rays(barrier):
    return np.stack([barrier.kappa1, barrier.kappa2], -1)


def _corners(triangles):
    """Return the corners (n, 3, 2) of the proved parts of the triangles."""
    names = [[f"kappa{i}_{end}" for i in (1, 2)] for end in ("low", "high")]
    far = np.array([[triangles[name].values for name in row] for row in names])
    far = np.moveaxis(triangles.proved_below.values * far, 2, 0)
    return np.concatenate([np.zeros_like(far[:, :1]), far], axis=1)


def proved_map_caption(cube, triangles, barrier):
    """Describe how close to CB_gt the proofs come on either side; arguments as for the figure."""
    proved, rays = _transport(cube), _rays(barrier)
    kappa1, kappa2 = np.meshgrid(cube.kappa1, cube.kappa2)
    angle = np.rad2deg(np.arctan2(kappa2, kappa1))
    excess = np.hypot(kappa1, kappa2) / np.interp(angle, barrier.angle, barrier.critical_scale) - 1

    there = (excess > 0) & (kappa2 <= kappa1)
    open_ = 100 * excess[there & ~proved]
    within = "No cell is open there."
    if open_.size:
        half, most, last = np.quantile(open_, [0.5, 0.95, 1])
        within = (
            f"Half of the open cells there are within {half:.3g}% of the boundary, 95% within "
            f"{most:.3g}%, all within {last:.3g}%."
        )
    share = 100 * proved[there].mean()
    # Scales at which the proved triangles end on the rays of CB_gt, relative to CB_gt.
    ends = np.zeros(len(rays))
    for _, low, high in _corners(triangles):
        at = np.linalg.solve(np.stack([low, high], 1) + 1e-300 * np.eye(2), rays.T)
        ends = np.where((at >= -1e-9).all(axis=0), np.maximum(ends, 1 / at.sum(axis=0)), ends)
    half, most, last = 100 * (1 - np.quantile(ends, [0.5, 0.05, 0]))
    return (
        f"Transport is proved to be global for every forcing in {share:.1f}% of the area shown "
        f"outside CB_gt (line, by residues), in cells down to 1/{cube.attrs['cells']}. {within} A "
        f"barrier is proved to exist in {triangles.sizes['triangle']} triangles with a corner at 0 "
        f"and their images: on half of the rays of CB_gt to {half:.3g}% below it, on 95% to "
        f"{most:.3g}%, on all to {last:.3g}%."
    )
