"""Sweeps of many tiles.

As a program, `python test_large.py OUT TILES`, it sweeps tiles that cost nothing, and
prints what it did, and what the driver needed for it, with dask's scheduler in the same process.
"""

import json
import re
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
    with store.driver_lock(place), connect(n_workers=2) as client:
        client()
        start = time.process_time()
        outcome = sweep(client, place, job, Progress("line", sys.stderr))
        seconds = time.process_time() - start
    # getrusage would count its parent's memory.
    peak = 1024 * int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1])
    done = {"committed": outcome.committed, "remaining": outcome.remaining}
    print(json.dumps({**done, "seconds": seconds, "bytes": peak}))


@pytest.mark.slow
def test_many_tiles_need_little_of_the_driver(tmp_path):
    n_tiles, out = 100_000, tmp_path / "out"
    command = [sys.executable, __file__, str(out), str(n_tiles)]
    report = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
    assert (report["committed"], report["remaining"]) == (n_tiles, 0)
    assert len(store.missing(store.place_of(out), toy.line(n_tiles).cube)) == 0
    assert report["bytes"] < 250e6
    assert report["seconds"] < 0.5 + 2e-4 * n_tiles  # it needs half a second to start


if __name__ == "__main__":
    main(*sys.argv[1:])
