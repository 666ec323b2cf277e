"""The map of forcings for which global transport, or the existence of a barrier, is proved."""

from math import ceil, log2

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from nasm.planes import plane_of, two_kicks
from workflows.figures.planes import label_plane
from workflows.figures.style import COLOURS, outer_legend, panels

_LEGEND = {
    "open": "0.9",
    "transport is proved to be global": COLOURS[1],
    "a barrier is proved to exist": COLOURS[0],
}
_INSET = 0.36  # width of the inset, relative to the map
_CELLS_IN_INSET = 48  # finest cells across the inset
_LEAST_MAGNIFICATION = 5
_MAX_DRAWN = 3000  # cells along an axis; more would take gigabytes, and cannot be seen


def draw_proved_map(whole, triangles, barrier):
    """Draw the whole plane, including images under its symmetries, and CB_gt by residues as a line.

    If cells are fine and there is room in the middle, an inset magnifies the open cells on one ray.

    whole : cells of the whole plane. triangles : `proved_triangles`. barrier : CB_gt in the part of
    the plane whose images cover the whole plane.
    """
    figure, (axes,) = panels(1, 1, 7.5, 7.4)
    reach = _reach(whole)
    label_plane(axes, barrier)
    _draw(axes, whole, triangles, barrier, (0, 0), reach)
    if _magnification(whole, barrier):
        x, y = _rays(barrier)[barrier.sizes["angle"] // 2]
        half = 0.5 * _CELLS_IN_INSET / whole.attrs["cells"]
        inset = axes.inset_axes([0.5 - _INSET / 2, 0.5 - _INSET / 2, _INSET, _INSET])
        _draw(inset, whole, triangles, barrier, (x, y), half)
        inset.set(xticks=[], yticks=[])
        axes.indicate_inset_zoom(inset, edgecolor="black")
    patches = [Patch(color=colour, label=label) for label, colour in _LEGEND.items()]
    patches.append(Line2D([], [], color="black", lw=0.8, label=r"$\mathit{CB}_{gt}$ by residues"))
    outer_legend(figure, 2, 1, "upper", handles=patches, frameon=False, fontsize=None)
    return figure


def _magnification(whole, barrier):
    """Return how much the inset magnifies, or 0 if there is no inset."""
    reach = _reach(whole)
    room = np.abs(_rays(barrier)).max(axis=1).min()
    times = _INSET * 2 * reach * whole.attrs["cells"] / _CELLS_IN_INSET
    fits = 1.1 * _INSET * reach < room and times >= _LEAST_MAGNIFICATION
    return times if fits else 0


def _reach(whole):
    """Return half the width of the map."""
    return float(whole[whole.proved.dims[0]][-1]) + 0.5 / whole.attrs["cells"]


def _draw(axes, whole, triangles, barrier, middle, half):
    """Draw the square of the map within a distance `half` of its middle along both axes."""
    plane, cell = plane_of(whole.attrs), 1 / whole.attrs["cells"]
    limits = [(at - half, at + half) for at in middle]
    window = {
        name: slice(low - cell, high + cell)
        for name, (low, high) in zip(plane.axes, limits, strict=True)
    }
    cells = whole.proved.sel(window)
    ends = [cells[name].values[[0, -1]] + (-0.5 * cell, 0.5 * cell) for name in plane.axes]
    # The number of cells along an axis is a multiple of this power of two.
    stride = 2 ** max(0, ceil(log2(max(cells.shape) / _MAX_DRAWN)))
    axes.imshow(
        cells.values[stride // 2 :: stride, stride // 2 :: stride],
        cmap=ListedColormap([*_LEGEND.values()][:2]),
        vmin=0,
        vmax=1,
        origin="lower",
        extent=np.concatenate(ends),
        interpolation="nearest",
    )
    corners, rays = _corners(triangles, plane), _rays(barrier)
    for mirrored, turn, _ in plane.exact_symmetries:
        for one in corners:
            axes.fill(*_image(one, mirrored, turn).T, color=COLOURS[0], lw=0, aa=False)
    for mirrored, turn, _ in plane.exact_symmetries:
        axes.plot(*_image(rays, mirrored, turn).T, color="black", lw=0.8)
    axes.set(xlim=limits[0], ylim=limits[1])


def _image(points, mirrored, turn):
    """Return the image of points, shape (n, 2), under a symmetry listed in `Plane.symmetries`."""
    angle = np.deg2rad(turn)
    cos, sin = round(np.cos(angle)), round(np.sin(angle))
    a, b = points[:, 0], -points[:, 1] if mirrored else points[:, 1]
    return np.stack([cos * a - sin * b, sin * a + cos * b], -1)


def _rays(barrier):
    return np.stack([barrier[name] for name in plane_of(barrier.attrs).axes], -1)


def _corners(triangles, plane):
    """Return the corners (n, 3, 2) of the proved parts of the triangles."""
    names = [f"{name}_{end}" for end in ("low", "high") for name in plane.axes]
    far = np.reshape([triangles[name].values for name in names], (2, 2, -1))
    far = np.moveaxis(triangles.proved_below.values * far, 2, 0)
    return np.concatenate([np.zeros_like(far[:, :1]), far], axis=1)


def proved_map_caption(whole, triangles, barrier):
    """Describe how close the proofs come to CB_gt on both sides; arguments as for the figure."""
    plane, rays = plane_of(whole.attrs), _rays(barrier)
    proved, excess = whole.proved.values, whole.excess.values
    there = excess > 0
    open_ = 100 * excess[there & ~proved]
    within = "No cell is open there."
    if open_.size:
        half, most, last = np.quantile(open_, [0.5, 0.95, 1])
        within = (
            f"Half of the open cells there are within {half:.3g}% of the boundary, 95% within "
            f"{most:.3g}%, and all within {last:.3g}%."
        )
    if len(plane.origin) > 2 and open_.size:
        beyond = 100 * whole.outside_theorem.values[there & ~proved].mean()
        if beyond >= 0.5:
            within += (
                f" The theorem does not apply to {beyond:.0f}% of them, because strong kicks "
                "come one after another."
            )
    share = 100 * proved[there].mean()
    # Scales at which the proved triangles end on the rays of CB_gt, relative to CB_gt.
    ends = np.zeros(len(rays))
    for _, low, high in _corners(triangles, plane):
        parts = np.linalg.solve(np.stack([low, high], 1) + 1e-300 * np.eye(2), rays.T)
        inside = (parts >= -1e-9).all(axis=0)
        ends = np.where(inside, np.maximum(ends, 1 / parts.sum(axis=0)), ends)
    half, most, last = 100 * (1 - np.quantile(ends, [0.5, 0.05, 0]))
    place = "" if plane == two_kicks() else f"Plane of forcings: {plane.name}. "
    times = _magnification(whole, barrier)
    inset = f" Inset: the open cells on one ray, {times:.0f} times magnified." if times else ""
    return (
        f"{place}Transport is proved to be global for every forcing in {share:.1f}% of the area "
        "shown outside CB_gt (line, by residues); the smallest cells measure "
        f"1/{whole.attrs['cells']}. "
        f"{within} A "
        f"barrier is proved to exist in {triangles.sizes['triangle']} triangles with a corner at 0 "
        f"and their images: they reach to within {half:.3g}% of CB_gt on half of its rays, "
        f"{most:.3g}% on 95%, and {last:.3g}% on all.{inset}"
    )
