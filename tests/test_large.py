"""Sweeps of many tiles.

As a program, `python test_large.py OUT TILES`, it sweeps tiles that cost nothing, and
prints what it did, and what the driver needed for it, with dask's scheduler in the same process.
"""

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import toy

from pipeline import store
from pipeline.sweep.cluster import connect
from pipeline.sweep.progress import Progress
from pipeline.sweep.sweep import sweep


def main(out, n_tiles):
    place, job = store.place_of(out), toy.line(int(n_tiles))
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


if __name__ == "__main__":
    main(*sys.argv[1:])
