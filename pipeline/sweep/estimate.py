"""Estimate, before a run, how much of a cube remains to be computed."""

import time
from contextlib import suppress
from math import prod
from os import PathLike
from typing import NamedTuple

import numpy as np

from pipeline import store
from pipeline.cubes.cube import Job
from pipeline.store import Place
from pipeline.sweep.grid import tile_coords
from pipeline.sweep.sweep import COMMIT_SECONDS

_MAX_SECONDS = 0.3  # limit on the CPU time spent on the prediction


class Estimate(NamedTuple):
    """The part of a cube that remains to be computed.

    Attributes
    ----------
    tiles, files : float
        Number of missing tiles, and of the files in which they will be stored.
    megabytes, cpu_seconds : float
        Predicted size and CPU time of the missing tiles.
    """

    tiles: float
    files: float
    megabytes: float
    cpu_seconds: float


def estimate(
    job: Job,
    out: str | PathLike[str] | Place,
    wanted: set[tuple[int, ...]] | None = None,
) -> Estimate:
    """Estimate, within half a second, how much of the job's cube is missing in `out`.

    The CPU time is predicted from a sample of the tiles; for most jobs it is correct to within a
    factor of two.

    Parameters
    ----------
    job : Job
        The cube, and how it is computed.
    out : str, path or Place
        Where the cube is stored, as for `fill`; this place need not exist.
    wanted : set of tuple of int, optional
        Indices of the tiles to count; by default all.

    Examples
    --------
    >>> import pipeline
    >>> pipeline.estimate(pipeline.last_barrier([10, 30], tol=1e-2), "run").tiles
    1
    """
    place = out if isinstance(out, Place) else store.place_of(out)
    cube = job.cube
    tiles = np.argwhere(np.ones(cube.tile_counts))
    with suppress(store.Refused):  # the place does not exist, or the cube was just deleted
        if cube.name in store.names(place):
            tiles = store.missing(place, cube)
    if wanted is not None:
        tiles = tiles[[tuple(index) in wanted for index in tiles.tolist()]]
    costs: list[float] = []
    end = time.thread_time() + _MAX_SECONDS
    for _, coords in tile_coords(cube, np.random.default_rng(0).permutation(tiles)):
        costs.append(float(job.predict(coords, cube.settings)))
        if time.thread_time() > end:
            break
    files = len(tiles) * (len(cube.computed) + 1)  # + 1 for the commit record
    megabytes = cube.template.nbytes / 1e6 * len(tiles) / prod(cube.tile_counts)
    mean_cost = sum(costs) / max(1, len(costs)) + COMMIT_SECONDS
    return Estimate(len(tiles), files, megabytes, len(tiles) * mean_cost)
