"""For which forcings is transport proved to be global? Cells of the (κ1, κ2) plane, by a quadtree.

A cell is proved for all forcings in it, by `nasm.proof_cells`; one that is not proved within its
time is cut into four, down to the finest. Tiles of κ2 > κ1 stay 0: they are images
(arXiv:1606.04824, Sec. III). That a barrier exists is not proved for cells: one set of deviations
u serves strengths that differ by 10⁻⁶ at most, and by 10⁻¹¹ at 0.9 of the breakup.
"""

import numpy as np
import xarray as xr

from nasm import proof_cells
from pipeline.cubes.cube import KICKS, Cube, Job, blank, coordinate
from pipeline.cubes.escape import by_angle

REACH = 1.125  # of both strengths; CB_gt ends before
_BLOCKS = 18  # along an axis; each is a tile
OPEN, TRANSPORT = 1, 2


def transport_proved(scales, cells, seconds):
    """Return the Job of the cube `proved_map`.

    scales : {angle in degrees, from 0 to 45: scale of the last breakup}. It tells where to try.
    cells : finest cells per unit of κ, 16 times a power of two. seconds : CPU time for a cell.
    """
    n = round(REACH * cells)
    axes = {
        name: coordinate(name, (np.arange(n) + 0.5) / cells, KICKS[name])
        for name in ("kappa2", "kappa1")
    }
    template = xr.Dataset(
        {
            "proved": blank(
                axes,
                "what is proved for all forcings of the cell",
                np.int8(0),
                flag_values=[0, OPEN, TRANSPORT],
                flag_meanings="not_computed open transport_is_global",
                source="nasm/PROOFS.md, Transport is global",
            )
        },
        axes,
        {"title": "Forcings for which transport is proved to be global"},
    )
    settings = {"critical_scales": by_angle(scales), "cells": cells, "seconds": seconds}
    tile = dict.fromkeys(axes, n // _BLOCKS)
    cube = Cube("proved_map", template, tile, settings)
    return Job(cube, _compute, _predict, _warm_up)


def _compute(coords, settings):
    boundary = _boundary(settings)
    places = coords["kappa2"], coords["kappa1"]
    proved = np.full(tuple(place.size for place in places), OPEN, np.int8)
    half = 0.5 / settings["cells"]
    lows = [round(place[0] - half, 9) for place in places]  # of multiples of 1/16
    if lows[0] > lows[1]:
        return {"proved": 0 * proved}
    _prove(proved, *lows, boundary, settings)
    if lows[0] == lows[1]:  # the other side of the diagonal is its image
        proved = np.where(np.tri(*proved.shape, dtype=bool), proved.T, proved)
    return {"proved": proved}


def _prove(proved, low2, low1, boundary, settings):
    """Fill the square of cells from (low1, low2) on, which is proved at once or by quarters."""
    size = proved.shape[0] / settings["cells"]
    if low2 >= low1 + size:
        return
    corners = low1 + np.array([0, size, 0, size]), low2 + np.array([0, 0, size, size])
    outside = _beyond(*corners, boundary)
    if not outside.any():
        return
    if outside.all():
        centre = low1 + size / 2, low2 + size / 2
        if proof_cells.prove_cell(centre, size / 2, settings["seconds"]).proved:
            proved[:] = TRANSPORT
            return
    half = proved.shape[0] // 2
    if half:
        for i, low in ((slice(half), low2), (slice(half, None), low2 + size / 2)):
            _prove(proved[i, :half], low, low1, boundary, settings)
            _prove(proved[i, half:], low, low1 + size / 2, boundary, settings)


def _boundary(settings):
    """Angles and scales of the given rays."""
    return np.array([[float(a), s] for a, s in settings["critical_scales"].items()]).T


def _beyond(kappa1, kappa2, boundary):
    """Whether forcings are beyond the breakup, as far as the given rays tell."""
    angle = np.rad2deg(np.arctan2(np.minimum(kappa1, kappa2), np.maximum(kappa1, kappa2)))
    return np.hypot(kappa1, kappa2) > np.interp(angle, *boundary)


def _predict(coords, settings):
    """Predict that of the cells that CB_gt crosses, and their neighbours, none is proved."""
    kappa1, kappa2 = np.meshgrid(coords["kappa1"], coords["kappa2"])
    ratio, boundary = 1 + 3 / settings["cells"], _boundary(settings)
    here = _beyond(kappa1 * ratio, kappa2 * ratio, boundary)
    near = here & ~_beyond(kappa1 / 1.03, kappa2 / 1.03, boundary)
    return 0.01 + 0.5 * settings["seconds"] * float((near & (kappa2 <= kappa1)).sum())


def _warm_up():
    proof_cells.prove_cell((1.0, 0.5), 2.0**-8)
