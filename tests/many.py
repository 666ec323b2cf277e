"""A sweep of many tiles that cost nothing, in a process of its own:

`python many.py OUT TILES [joined]`.

Prints what it did, and what the driver needed for it, with dask's scheduler in the same process.
"""

import json
import sys
import time

import toy

from pipeline import store
from pipeline.sweep import grid
from pipeline.sweep.cluster import connect
from pipeline.sweep.progress import Progress
from pipeline.sweep.sweep import sweep


def peak_memory():
    """Bytes of memory that this process has held at most. getrusage would count its parent's."""
    with open("/proc/self/status") as status:
        return 1024 * next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


def main(out, n_tiles, *joined):
    place, job = store.place_of(out), toy.line(n_tiles)
    job = grid.joined(job) if joined else job
    with store.driving(place), connect(n_workers=2) as client:
        client()
        start = time.process_time()
        outcome = sweep(client, place, job, Progress("line", sys.stderr))
        seconds = time.process_time() - start
    done = {"committed": outcome.committed, "remaining": outcome.remaining}
    print(json.dumps({**done, "seconds": seconds, "bytes": peak_memory()}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:])
