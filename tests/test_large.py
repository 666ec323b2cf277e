"""Sweeps of many tiles, and fields larger than the memory.

As a program, `python test_large.py OUT TILES [joined]`, it sweeps tiles that cost nothing, and
prints what it did, and what the driver needed for it, with dask's scheduler in the same process.
"""

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import dask.array
import numpy as np
import pytest
import toy
import xarray as xr

from pipeline import store
from pipeline.sweep import grid
from pipeline.sweep.cluster import connect
from pipeline.sweep.progress import Progress
from pipeline.sweep.sweep import sweep

CUBES = Path(__file__).parents[1] / "workflows" / "examples" / "cubes.ipynb"


def main(out, n_tiles, *joined):
    place, job = store.place_of(out), toy.line(int(n_tiles))
    job = grid.joined(job) if joined else job
    with store.driving(place), connect(n_workers=2) as client:
        client()
        start = time.process_time()
        outcome = sweep(client, place, job, Progress("line", sys.stderr))
        seconds = time.process_time() - start
    # getrusage would count its parent's memory.
    peak = 1024 * int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1])
    done = {"committed": outcome.committed, "remaining": outcome.remaining}
    print(json.dumps({**done, "seconds": seconds, "bytes": peak}))


def start_driver(out, *arguments):
    command = [sys.executable, __file__, str(out), *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def report_of(driver):
    said, error = driver.communicate(timeout=1500)
    assert driver.returncode == 0, error
    return json.loads(said)


@pytest.mark.slow
def test_many_tiles_need_little_of_the_driver_also_when_interrupted(tmp_path):
    n_tiles, megabytes = 100_000, 250
    cube, place = toy.line(n_tiles).cube, store.place_of(tmp_path / "out")
    driver = start_driver(tmp_path / "out", n_tiles)
    while not (tmp_path / f"out/line.zarr/tiles/commit/c/0/{n_tiles // 3}").exists():
        assert driver.poll() is None, driver.communicate()
        time.sleep(0.1)
    driver.send_signal(signal.SIGINT)
    first = report_of(driver)
    assert n_tiles // 4 < first["committed"] < n_tiles
    assert first["committed"] + first["remaining"] == n_tiles
    assert len(store.missing(place, cube)) == first["remaining"]
    second = report_of(start_driver(tmp_path / "out", n_tiles))
    assert (second["committed"], second["remaining"]) == (first["remaining"], 0)
    assert len(store.missing(place, cube)) == 0
    assert max(first["bytes"], second["bytes"]) < megabytes * 1e6
    # Each of the two drivers needs half a second to start.
    assert first["seconds"] + second["seconds"] < 2 * 0.5 + 2e-4 * n_tiles


@pytest.mark.slow
def test_a_million_tiles_are_a_few_thousand_files_and_take_a_minute(tmp_path):
    done = report_of(start_driver(tmp_path / "out", 10**6, "joined"))
    files = sum(path.is_file() for path in (tmp_path / "out").rglob("*"))
    assert done["remaining"] == 0
    assert files < 0.1 * 10**6
    assert done["seconds"] < 10
    assert done["bytes"] < 300e6
    assert (store.read(store.place_of(tmp_path / "out"), "line").level == 1).all()


def written_field(out, cells):
    """Write a field of made-up escape times, cells × cells and four ensembles, block by block.

    Returns how many cells of the last ensemble have each escape time.
    """
    axis = (np.arange(cells) + 0.5) / cells
    last = np.ceil(5 / (1e-3 + np.add.outer(axis, axis) ** 3))
    counts = np.bincount(np.minimum(last, 1001).astype(int).ravel(), minlength=1002)
    last[last > 1000] = np.inf
    last = dask.array.from_array(last, chunks=64)
    times = dask.array.stack([8 * last] * 3 + [last]).rechunk((4, 64, 64))
    variables = {"escape_time": (("ensemble", "kappa2", "kappa1"), times)}
    field = xr.Dataset(variables, {"kappa1": axis, "kappa2": axis}, {"n_max": 1000})
    # Not by way of a cluster that another file's tests have left as the default.
    with dask.config.set(scheduler="threads"):
        field.to_zarr(f"{out}/escape.zarr", consolidated=False)
    return counts


_LIMITED = """
import json, resource
import dask.array, numpy, numpy as np, xarray, xarray as xr, zarr
resource.setrlimit(resource.RLIMIT_DATA, ({limit}, {limit}))
{statement}
"""


@pytest.mark.slow
def test_a_field_larger_than_the_memory_is_analysed_by_blocks(tmp_path):
    cells = 4096
    times = written_field(tmp_path / "out", cells)

    def limited(statement):
        """Run it in a process of its own that cannot hold the field."""
        code = _LIMITED.format(limit=400_000_000, statement=statement)
        program = [sys.executable, "-c", code]
        return subprocess.run(program, cwd=tmp_path, capture_output=True, text=True)

    whole = 'xarray.open_zarr("out/escape.zarr").escape_time.values'
    assert "MemoryError" in limited(whole).stderr
    last = limited("".join(json.loads(CUBES.read_text(encoding="utf-8"))["cells"][-1]["source"]))
    assert last.returncode == 0, last.stderr
    found = re.findall(r"^(\d+) +([\d.]+)$", last.stdout, re.MULTILINE)
    assert len(found) == 9
    for n, part in found:
        assert float(part) == pytest.approx(times[: int(n) + 1].sum() / cells**2, abs=1e-6)
    earliest = np.flatnonzero(times)[0]
    assert f"coarse field (1024, 1024), earliest escape {earliest}" in last.stdout


if __name__ == "__main__":
    main(*sys.argv[1:])
