"""List the kernels that tiles load after the warm-up of a job: `first_calls.py FILE`.

FILE contains a pickled list of Jobs. The script prints a JSON list with, for each job, the kernels
that some tiles still have to load or compile. The script must run in a process of its own, because
the process that planned the jobs may already have loaded some of the kernels; it forks a process
for each job.
"""

import gc
import json
import multiprocessing
import pickle
import sys
from pathlib import Path

import numpy as np
from numba.core.dispatcher import Dispatcher

from pipeline.sweep.grid import tile_coords

N_TILES = 2


def loaded():
    """Return the kernels loaded in this process, with the types of their arguments."""
    kernels = (each for each in gc.get_objects() if isinstance(each, Dispatcher))
    return {
        (f"{kernel.py_func.__module__}.{kernel.py_func.__name__}", str(types))
        for kernel in kernels
        for types in kernel.signatures
    }


def late(job):
    """Return the names of the kernels that some tiles load after the warm-up."""
    tiles = np.argwhere(np.ones(job.cube.tile_counts))
    tiles = np.random.default_rng(0).permutation(tiles)[:N_TILES]
    job.warm_up()
    before = loaded()
    for _, coords in tile_coords(job.cube, tiles):
        job.compute(coords, job.cube.settings)
    return sorted({name for name, _ in loaded() - before})


def late_of(index):
    return late(jobs[index])


if __name__ == "__main__":
    jobs = pickle.loads(Path(sys.argv[1]).read_bytes())
    with multiprocessing.get_context("fork").Pool(1, maxtasksperchild=1) as pool:
        print(json.dumps(pool.map(late_of, range(len(jobs)), chunksize=1)))
