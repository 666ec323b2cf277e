"""Tiles that cost a given time and compute nothing, to measure the pipeline itself.

`crowd` gives them many workers on few cores: a real scheduler, real connections, and as many worker
objects as asked for in one process, whose tiles sleep instead of computing.
"""

import asyncio
import hashlib
import logging
import multiprocessing
import time
from contextlib import contextmanager

import dask
import dask.array
import numpy as np
import xarray as xr
from distributed import LocalCluster, Worker

from pipeline import store
from pipeline.cluster import QUIET, connect
from pipeline.schema import Cube

CELLS = 256  # in a tile: 2 kB
_BLOCK = bytes(2**15)


def cube(n_tiles, seconds, burn):
    """The cube of `n_tiles` tiles of `seconds` each: of CPU time if `burn`, asleep otherwise.

    `when` : the first cell of a tile is when it began, the others when it ended, in seconds since
        the epoch.
    """
    when = dask.array.full((n_tiles, CELLS), np.nan, chunks=-1)
    attrs = {"long_name": "when the tile began, and ended", "units": "s"}
    coords = {"tile": np.arange(n_tiles), "cell": np.arange(CELLS)}
    template = xr.Dataset({"when": (("tile", "cell"), when, attrs)}, coords)
    settings = {"seconds": float(seconds), "burn": bool(burn)}
    return Cube("synthetic", template, {"tile": 1}, settings)


def tile(coords, settings):
    """{"when": array (tile, cell)}, after the given time."""
    began = time.time()
    if settings["burn"]:
        end = time.thread_time() + settings["seconds"]
        while time.thread_time() < end:
            hashlib.sha256(_BLOCK)  # without the interpreter's lock, like the kernels
    else:
        time.sleep(settings["seconds"])
    when = np.full((coords["tile"].size, CELLS), time.time())
    when[:, 0] = began
    return {"when": when}


def cost(coords, settings):
    """Predicted CPU seconds of `tile`, exactly."""
    return settings["seconds"]


def commit_all(layout, indices):
    """Commit tiles of the cube, one after the other; the CPU seconds that one takes."""
    arrays = {"when": np.zeros((1, CELLS))}
    start = time.process_time()
    for i in indices:
        store.commit(layout, (i,), arrays, 0.0)
    return (time.process_time() - start) / len(indices)


def no_warm_up():
    """Nothing to compile."""


@contextmanager
def crowd(n_workers):
    """A dask Client with n_workers workers of one thread each, all in one further process."""
    with (
        dask.config.set(QUIET),
        LocalCluster(
            n_workers=0,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            silence_logs="CRITICAL",
        ) as cluster,
    ):
        address = cluster.scheduler_address
        process = multiprocessing.get_context("spawn").Process(
            target=_workers, args=(address, n_workers), daemon=True
        )
        process.start()
        try:
            _wait_for_workers(cluster, n_workers)
            with connect(no_warm_up, scheduler=address) as client:
                yield client
        finally:
            process.kill()
            process.join()


def _wait_for_workers(cluster, n_workers, patience=120):
    end = time.monotonic() + patience
    while len(cluster.scheduler.workers) < n_workers:
        if time.monotonic() > end:
            raise ConnectionError(f"{n_workers} workers did not start within {patience} s")
        time.sleep(0.05)


def _workers(address, n_workers):
    """In a process of its own: many workers, until it is killed or their scheduler is gone."""
    logging.disable(logging.CRITICAL)

    async def work():
        workers = [
            Worker(address, nthreads=1, memory_limit=0, dashboard=False, host="127.0.0.1")
            for _ in range(n_workers)
        ]
        for worker in workers:
            await worker
        await asyncio.gather(*(worker.finished() for worker in workers))

    with dask.config.set(QUIET):
        asyncio.run(work())
