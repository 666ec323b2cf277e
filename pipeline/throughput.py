"""What a sweep adds to its tiles' own time, and how many workers it can feed: a model.

A sweep of n tiles of c seconds packs b = min(256, max(1, ⌊0.5/c⌋)) tiles into a batch, B = ⌈n/b⌉
batches (`pipeline.sweep`). One driver, which holds the scheduler too, spends s = t_batch + b·t_tile
on each; a worker takes d = w_batch + b·(c + w_tile), commits included. W workers need

    T(W) = T_0 + n·t_list + max( ⌈B/W⌉·d + min(B, W)·s,    the workers, after a first hand-out
                                 B·s + d,                  the driver, then the last batch
                                 n·t_store )               a store that commits one tile at a time

for equal tiles. Of unequal ones the longest may come last: ⌈B/W⌉·d is then, at worst,
B·d/W + longest. Efficiency is n·c/(W·T). Workers that share a process add one more bound to the
maximum, B·w_batch + n·w_tile + b·c.
"""

from dataclasses import dataclass, fields
from functools import reduce

import numpy as np

from pipeline.sweep import BATCH_SECONDS, BATCH_TILES


@dataclass(frozen=True)
class Constants:
    """Seconds. start: T_0; listing: t_list; batch, tile: the driver's; worker_batch, worker_tile:
    a worker's; store: t_store."""

    start: float
    listing: float
    batch: float
    tile: float
    worker_batch: float
    worker_tile: float
    store: float

    def times(self, factor):
        """On a machine that is slower by a factor."""
        return Constants(*(factor * getattr(self, field.name) for field in fields(self)))


def packing(n, cost):
    """(tiles in a batch, batches) of n equal tiles, as `pipeline.sweep` packs them."""
    size = np.floor(BATCH_SECONDS / np.maximum(cost, 1e-9) + 1e-9)
    size = np.minimum(np.minimum(np.maximum(size, 1), BATCH_TILES), n)
    return size, np.ceil(n / size)


def sweep_seconds(n, cost, workers, constants, crowded=False, slowness=1.0, longest=None):
    """T(W) of the module's docstring. Arrays or numbers.

    crowded : all workers are in one process. slowness : the factor by which the machine's other
    load slows all that computes; tiles that sleep, in a crowd, are not slowed. longest : seconds of
    the longest tile, if they are not equal.
    """
    k = constants.times(slowness)
    size, batches = packing(n, cost)
    cost = cost if crowded else cost * slowness
    serve = k.batch + size * k.tile
    batch = k.worker_batch + size * (cost + k.worker_tile)
    if longest is None:
        working = np.ceil(batches / workers) * batch
    else:
        working = batches / workers * batch + longest
    bounds = [
        working + np.minimum(batches, workers) * serve,
        batches * serve + batch,
        n * k.store,
    ]
    if crowded:
        bounds.append(batches * k.worker_batch + n * k.worker_tile + size * cost)
    return k.start + n * k.listing + reduce(np.maximum, bounds)


def efficiency(n, cost, workers, seconds):
    """The part of the workers' time that went into the tiles."""
    return n * cost / (workers * seconds)


def fit(measured, simulated, store):
    """The Constants that explain all sweeps' CPU times best, in parts of each; none is negative."""
    import pandas as pd
    from scipy.optimize import nnls

    runs = [
        dataset.to_dataframe().dropna(subset="wall").reset_index()
        for dataset in (measured, simulated)
    ]
    runs = pd.concat(runs, ignore_index=True)
    n = runs.tiles.values
    _, batches = packing(n, runs.cost.values)
    one = np.ones(n.size)

    def explain(seconds, *columns):
        scale = np.maximum(seconds, 0.05)
        return nnls(np.stack(columns, axis=1) / scale[:, None], seconds / scale)[0]

    start, listing = explain((runs["first"] / runs.slowness).values, one, n)
    _, batch, tile = explain(runs.driver_cpu.values, one, batches, n)
    _, worker_batch, worker_tile = explain(runs.workers_cpu.values, one, batches, n)
    return Constants(start, listing, batch, tile, worker_batch, worker_tile, store)
