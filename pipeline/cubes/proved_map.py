"""What is proved of forcings? Cells of the (κ1, κ2) plane, by the quadtree of `nasm.proofs`.

Tiles of κ2 > κ1 are not computed: they are images (arXiv:1606.04824, Sec. III).
"""

import numpy as np
import xarray as xr

from nasm import proofs
from nasm.numbers import parse
from nasm.planes import TWO_KICKS_AXES
from pipeline.cubes.certificates import of_certificate, packed
from pipeline.cubes.cube import NOT_COMPUTED, Cube, Job, blank, coordinate

REACH = 1.125  # of both strengths; CB_gt ends before
_BLOCKS = 36  # along an axis; each is a tile
_STATES = {
    NOT_COMPUTED: "not_computed",
    proofs.cells.OPEN: "open",
    proofs.cells.TRANSPORT: "transport_is_global",
    proofs.cells.BARRIER: "barrier_exists",
}


def proved_map(rays, cells, seconds):
    """Return the Job of the cube `proved_map`.

    rays : list of (angle in degrees, scale of the last breakup, text of the last circle's ω or ""),
    from 0 to 45 degrees. They tell where to try. cells : finest cells per unit of κ, 16 times a
    power of two. seconds : CPU time for a cell's proof of transport.
    """
    n = round(REACH * cells)
    axes = {
        name: coordinate(name, (np.arange(n) + 0.5) / cells, TWO_KICKS_AXES[name])
        for name in ("kappa2", "kappa1")
    }
    proved = blank(
        axes,
        "what is proved for all forcings of the cell",
        np.int8(0),
        flag_values=list(_STATES),
        flag_meanings=" ".join(_STATES.values()),
        source="nasm/proofs/README.md",
    )
    title = "Forcings for which transport is proved to be global, or a barrier to exist"
    template = xr.Dataset({"proved": proved}, axes, {"title": title})
    settings = {"rays": rays, "cells": cells, "seconds": seconds}
    cube = Cube("proved_map", template, dict.fromkeys(axes, n // _BLOCKS), settings)
    return Job(cube, _compute, _predict, proofs.cells.warm_up_cells)


def _compute(coords, settings):
    n, size = coords["kappa1"].size, 1 / settings["cells"]
    low1, low2 = (round(coords[name][0] - size / 2, 9) for name in ("kappa1", "kappa2"))
    if low2 > low1:
        return {"proved": np.full((n, n), NOT_COMPUTED, np.int8)}
    depth, boundary = n.bit_length() - 1, _boundary(settings)
    proved, found = proofs.proved_cells(
        (low1, low2), n * size, depth, boundary, settings["seconds"]
    )
    if low1 == low2:  # the other side of the diagonal is its image
        proved = np.where(np.tri(n, dtype=bool), proved.T, proved)
    return {"proved": proved} | packed(found)


def uncertified(tile, certificates):
    """Say what a tile of the cube calls proved without a certificate that claims it; else ""."""
    kappa1, kappa2 = np.meshgrid(tile.kappa1, tile.kappa2)
    found, half = np.zeros(kappa1.shape, np.int8), 0.5 / tile.attrs["cells"]
    for certificate in certificates:
        (k1, k2), (h1, h2) = (of_certificate(certificate, f) for f in ("kappa", "half_width"))
        inside = (np.abs(kappa1 - k1) + half <= h1) & (np.abs(kappa2 - k2) + half <= h2)
        found[inside] = proofs.cells.BARRIER if "omega" in certificate else proofs.cells.TRANSPORT
    proved = tile.proved.isin([proofs.cells.TRANSPORT, proofs.cells.BARRIER]).values & (
        kappa2 <= kappa1
    )
    n = np.count_nonzero(proved & (found != tile.proved.values))
    return f"{n} cells are called proved, and no certificate claims it" if n else ""


def _boundary(settings):
    angles, scales, circles = zip(*settings["rays"], strict=True)
    known = {text: parse(text) if text else None for text in {*circles}}
    return proofs.Boundary(np.array(angles), np.array(scales), [known[text] for text in circles])


def _predict(coords, settings):
    """Half the time for each finest cell near CB_gt, and a second for each cell with a barrier."""
    kappa1, kappa2 = np.meshgrid(coords["kappa1"], coords["kappa2"])
    size = 1 / settings["cells"]
    distance, critical = _boundary(settings).distance(kappa1, kappa2)
    near = (distance < 3 * size) & (distance > -0.03)
    largest = 2 * proofs.cells.barrier_size(np.maximum(distance, 0), critical).clip(0, 1 / 32)
    barriers = np.where(largest < size, 0, (size / np.maximum(largest, size)) ** 2)
    return 0.01 + float((0.5 * settings["seconds"] * near + barriers)[kappa2 <= kappa1].sum())
