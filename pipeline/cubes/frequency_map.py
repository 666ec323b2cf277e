"""Frequency maps: rotation numbers over part of phase space, and how many digits are reliable.

    ω(x, y) = Σ_t w(t/n) (x_{t+1} - x_t) / Σ_t w(t/n)                  (`nasm.orbits`)

Where averages over the whole orbit and over its halves share many digits, motion is regular; where
they share few, it is chaotic (J. Laskar, Physica D 67 (1993) 257).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from nasm import orbits
from pipeline.cubes.cube import Arrays, Coords, Cube, Job, Settings, blank, cells_along

if TYPE_CHECKING:
    from pipeline.sweep.grid import Axis

_SECONDS_PER_KICK = 2.6e-8
"""CPU seconds per kick and orbit: 2.5e-8 to 2.8e-8 for forcings of one, two and six kicks."""

_PLACES = {"x": "position of the start, in turns", "y": "momentum of the start, in turns per kick"}


def frequency_map(kappa: Sequence[float], axes: Sequence["Axis"], n_max: int, tile: int) -> Job:
    """Return the Job of a cube of rotation numbers over phase space, with the dims (y, x).

    Parameters
    ----------
    kappa : sequence of float
        Strengths of the kicks, first kick first.
    axes : sequence of two Axis
        Cells along x and y; orbits start at the centres of the cells.
    n_max : int
        Number of steps (periods of the forcing) to average over.
    tile : int
        Number of cells along each side of a tile.

    Examples
    --------
    >>> from pipeline.cubes.frequency_map import frequency_map
    >>> from pipeline.sweep.grid import Axis
    >>> job = frequency_map((0.3, 0.2), [Axis(0, 1, 8), Axis(0, 0.5, 4)], 1000, 4)
    >>> dict(job.cube.template.omega.sizes), job.cube.tile_counts
    ({'y': 4, 'x': 8}, (1, 2))
    """
    coords = cells_along(axes, _PLACES)
    kicks = f"steps of {len(kappa)} kicks"
    chaotic = f"NaN where fewer than {orbits.REGULAR_DIGITS} digits are reliable"
    shared = "by the averages over the whole orbit and over its halves; few in chaotic regions"
    variables = {
        "omega": blank(coords, "rotation number, in turns per step", comment=f"{kicks}; {chaotic}"),
        "digits": blank(coords, "reliable digits of omega", comment=f"digits shared {shared}"),
    }
    references = "arXiv:1606.04824, Eq. (23)"
    labels = {"title": "Rotation number over phase space", "references": references}
    template = xr.Dataset(variables, coords, labels)
    settings = {
        "kappa": list(kappa),
        "n_max": n_max,
        "regular_digits": orbits.REGULAR_DIGITS,
    }
    cube = Cube("frequency_map", template, {"y": tile, "x": tile}, settings)
    return Job(cube, _compute, _predict, _load)


def _compute(coords: Coords, settings: Settings) -> Arrays:
    """Compute the rotation numbers and digits of a tile."""
    x, y = np.meshgrid(coords["x"], coords["y"])
    omega, digits = orbits.rotation_number(settings["kappa"], x, y, settings["n_max"])
    return {"omega": omega, "digits": digits}


def _predict(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds from the number of kicks."""
    n_kicks = settings["n_max"] * len(settings["kappa"])
    return _SECONDS_PER_KICK * n_kicks * coords["x"].size * coords["y"].size


def _load() -> None:
    """Compile the kernel of `_compute`."""
    orbits.rotation_number((0.1,), 0.0, 0.0, 4)
