"""Name the kernels that tiles load after a worker's first call: `first_calls.py N COMMAND ...`.

Prints as JSON how many jobs the command plans, the name of the cube of job N, and the kernels that
its first tiles had to load or compile. One job in each process: a kernel that another one has
loaded would not be missed.
"""

import gc
import json
import sys
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from pipeline.sweep.grid import tile_coords
from workflows.shared.cli import main_of
from workflows.shared.run import Run

N_TILES = 4


class Planned(Exception):
    pass


def jobs_of(command, options):
    """List the jobs that a command plans."""

    def plan(self, *jobs, later=(), **_):
        raise Planned([*jobs, *(job for job, _ in later)])

    with pytest.MonkeyPatch.context() as patch, TemporaryDirectory() as out:
        patch.setattr(Run, "sweeping", plan)
        try:
            main_of(command).main([*options, "--out", out], standalone_mode=False)
        except Planned as planned:
            return planned.args[0]


def loaded():
    """Return the kernels that this process has, with the types of their arguments."""
    kernels = (each for each in gc.get_objects() if isinstance(each, Dispatcher))
    return {
        (f"{kernel.py_func.__module__}.{kernel.py_func.__name__}", str(types))
        for kernel in kernels
        for types in kernel.signatures
    }


def late(job):
    """Return the names of kernels that tiles load after the first call."""
    tiles = np.argwhere(np.ones(job.cube.tile_counts))
    tiles = np.random.default_rng(0).permutation(tiles)[:N_TILES]
    job.warm_up()
    before = loaded()
    for _, coords in tile_coords(job.cube, tiles):
        job.compute(coords, job.cube.settings)
    return sorted({name for name, _ in loaded() - before})


if __name__ == "__main__":
    number, command, *options = sys.argv[1:]
    jobs = jobs_of(command, options)
    job = jobs[int(number)]
    print(json.dumps([len(jobs), job.cube.name, late(job)]))
