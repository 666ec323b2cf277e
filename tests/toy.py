"""A cube that is quick to compute and easy to check, with tiles that misbehave on request."""

import io
import os
import re
import signal
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Lock

import dask
import numpy as np
import xarray as xr
from distributed import Client
from zarr.storage import ObjectStore

from pipeline import store
from pipeline.cubes.cube import Cube, Job, blank
from pipeline.provenance import EVERYTHING
from pipeline.sweep.progress import Progress
from pipeline.sweep.sweep import sweep


def cube(rows=10, columns=13, tile=3, **settings):
    """Return a Cube with two variables over (row, column), and a coordinate that labels each cell.

    One variable has a further dimension, which is not tiled. The coordinate `cell` is known in
    advance; cubes of a million cells or more lack it, as it would take half a gigabyte.
    """
    coords = {
        "part": np.arange(2),
        "row": np.linspace(0, 1, rows),
        "column": np.linspace(-1, 1, columns),
    }
    flat = {dim: xr.Variable(dim, coords[dim]) for dim in ("row", "column")}
    deep = {"part": xr.Variable("part", coords["part"]), **flat}
    variables = {"wave": blank(deep, "wave", 0.0), "sign": blank(flat, "sign", np.int8(0))}
    if rows * columns < 10**6:
        coords["cell"] = ("row", "column"), np.arange(rows * columns).reshape(rows, columns)
    template = xr.Dataset(variables, coords, {"title": "toy"})
    return Cube("toy", template, {"row": tile, "column": tile}, settings)


def job(*args, compute=None, predict=None, **settings):
    """Return the Job that computes `cube`, by default with the functions of this module."""
    plan = cube(*args, **settings)
    functions = compute or globals()["compute"], predict or globals()["predict"], no_warm_up
    return of_one_code(Job(plan, *functions))


def of_one_code(job):
    """Return the job, with all modules declared as its code.

    Jobs with different functions can then share its cube.
    """
    vars(job)["code"] = EVERYTHING
    return job


def compute(coords, settings):
    if settings.get("log"):
        with open(settings["log"], "a") as log:
            log.write(f"{coords['row'][0]:.6f} {coords['column'][0]:.6f}\n")
    if settings.get("pids"):
        with open(settings["pids"], "a") as pids:
            pids.write(f"{os.getpid()}\n")
    time.sleep(settings.get("seconds", 0.0))
    at = [float(coords["row"][0]), float(coords["column"][0])]
    if settings.get("poison") == at:
        os.kill(os.getpid(), signal.SIGKILL)
    if settings.get("raises") == at:
        raise ArithmeticError("no answer here")
    row, column = np.meshgrid(coords["row"], coords["column"], indexing="ij")
    wave = np.stack([np.sin(7 * row + part) * np.exp(column) for part in coords["part"]])
    return {"wave": wave, "sign": np.sign(column).astype("int8")}


COMPUTED = []  # first coordinates of tiles, in the order in which `watched` computed them
EVENTS = {}  # {n: function called before `watched` computes the n-th tile, n ≥ 1}
_ONE_BY_ONE = Lock()  # during an event the other thread commits at most its current tile


def watched(coords, settings):
    with _ONE_BY_ONE:
        COMPUTED.append((coords["row"][0], coords["column"][0]))
        EVENTS.pop(len(COMPUTED), no_warm_up)()
        return compute(coords, settings)


def watched_sweep(client, place, plan, events=()):
    """Sweep with a worker in this process; call the `events` as it runs, and fill COMPUTED."""
    COMPUTED.clear()
    EVENTS.clear()
    EVENTS.update(events)
    return run(client, place, plan, compute=watched)


@contextmanager
def workers_here():
    """Yield a function that returns a Client, as `connect` does; its worker is in this process.

    The worker has two threads.
    """
    how = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "protocol": "tcp"}
    how |= {"processes": False, "n_workers": 1, "threads_per_worker": 2}
    # The preload of `connect` is meant for separate worker processes, so it is disabled here.
    with dask.config.set({"distributed.worker.preload": []}), Client(**how) as client:
        yield lambda: client


def predict(coords, settings):
    # The costs are uneven, so that there are batches of one tile and of many.
    return 0.3 if coords.get("row", [0.0])[0] > 0.6 else 0.01


def serial(plan):
    """Compute the whole cube at once."""
    coords = {name: coordinate.values for name, coordinate in plan.template.coords.items()}
    return compute(coords, {})


def records(place):
    """Return the commit records of `cube`: the CPU seconds of each tile."""
    objects = ObjectStore(place.objects("toy"), read_only=True)
    return xr.open_zarr(objects, group="tiles").commit[0]


def run(client, out, plan, wanted=None, **functions):
    """Sweep the cube silently into a place that no other driver uses; return the outcome."""
    place, job = store.place_of(out), Job(plan, compute, predict, no_warm_up)
    job = of_one_code(replace(job, **functions))
    with store.driver_lock(place):
        return sweep(client, place, job, Progress("toy", io.StringIO()), wanted)


def assert_complete(out, plan):
    """Assert that all cells equal a serial computation, and that `verify` finds no damage."""
    cube = store.read(store.place_of(out), plan.name)
    for name, values in serial(plan).items():
        assert np.array_equal(cube[name].values, values)
        assert cube[name].dtype == values.dtype
    assert np.isfinite(records(store.place_of(out))).all()
    assert list(store.verify(store.place_of(out), plan.name)) == []


def commit_times(out):
    """Return {path: time} of the commit records in a directory, except those being written."""
    records = (out / "toy.zarr/tiles/commit/c/0").glob("*/*")
    return {path: path.stat().st_mtime_ns for path in records if "#" not in path.name}


def wait_until(condition, patience=60):
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def kept_memory():
    """Return how many of 128 temporarily used megabytes this process does not release."""

    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    before = resident()
    np.ones(2**24).sum()
    return (resident() - before) / 2**20


def peak_memory():
    """Return the peak memory of this process, in bytes; getrusage would include its parent's."""
    return 1024 * int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1])


def line(n_tiles):
    """Return a Job with tiles of 2 kB along one axis, which take no time to compute."""
    coords = {dim: xr.Variable(dim, np.arange(n)) for dim, n in (("tile", n_tiles), ("cell", 256))}
    template = xr.Dataset({"level": blank(coords, "level")}, coords)
    return Job(Cube("line", template, {"tile": 1}, {}), level, nothing, no_warm_up)


def level(coords, settings):
    return {"level": np.ones((coords["tile"].size, 256))}


def nothing(coords, settings):
    return 0.0


def no_warm_up():
    pass
