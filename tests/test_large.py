"""Sweeps of many tiles.

As a program, `python test_large.py OUT TILES`, it sweeps tiles that cost nothing, with dask's
scheduler in the same process, and prints what it did and what the driver needed for it.
"""

import json
import subprocess
import sys
import time

import pytest
import toy

from pipeline import store
from pipeline.sweep.cluster import connect
from pipeline.sweep.progress import Progress
from pipeline.sweep.sweep import sweep


class Counting(Progress):
    """Counts the batches that come back from workers."""

    batches = 0

    def advance(self, *args):
        self.batches += 1
        super().advance(*args)


def main(out, n_tiles):
    place, job = store.place_of(out), toy.line(int(n_tiles))
    with store.driver_lock(place), connect(n_workers=2) as client:
        client()
        start = time.process_time()
        line = Counting("line", sys.stderr)
        outcome = sweep(client, place, job, line)
        seconds = time.process_time() - start
    done = {"committed": outcome.committed, "remaining": outcome.remaining}
    needed = {"batches": line.batches, "seconds": seconds, "bytes": toy.peak_memory()}
    print(json.dumps(done | needed))


@pytest.mark.parametrize("n_tiles", [
    pytest.param(10_000, marks=pytest.mark.slow),
    pytest.param(100_000, marks=pytest.mark.release),
])  # fmt: skip
def test_many_tiles_take_little_of_the_driver_s_time_and_memory(tmp_path, n_tiles):
    out = tmp_path / "out"
    command = [sys.executable, __file__, str(out), str(n_tiles)]
    report = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
    assert (report["committed"], report["remaining"]) == (n_tiles, 0)
    assert len(store.missing(store.place_of(out), toy.line(n_tiles).cube)) == 0
    assert report["bytes"] < 250e6
    # 0.2 ms of CPU time per tile, as they come in batches of 166.
    assert report["batches"] < n_tiles / 50


if __name__ == "__main__":
    main(*sys.argv[1:])
