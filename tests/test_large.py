"""Sweeps over many tiles.

Run as a program, `python test_large.py OUT TILES`, this file sweeps tiles that cost nothing to
compute, with dask's scheduler in the same process. It prints how many tiles were committed, and the
time and memory that the driver used.
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
    """A progress line that counts the batches returned by workers."""

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
def test_the_driver_needs_little_time_and_memory_for_many_tiles(tmp_path, n_tiles):
    out = tmp_path / "out"
    command = [sys.executable, __file__, str(out), str(n_tiles)]
    report = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
    assert (report["committed"], report["remaining"]) == (n_tiles, 0)
    assert len(store.missing(store.place_of(out), toy.line(n_tiles).cube)) == 0
    assert report["bytes"] < 250e6
    # The driver needs 0.2 ms of CPU time per tile, because workers return batches of 166 tiles.
    assert report["batches"] < n_tiles / 50


if __name__ == "__main__":
    main(*sys.argv[1:])
