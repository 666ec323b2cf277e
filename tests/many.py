"""A sweep of many tiles that cost nothing, in a process of its own: `python many.py OUT TILES`.

Prints what it did, and what the driver needed for it, with dask's scheduler in the same process.
"""

import json
import sys
import time

import toy

from pipeline import store
from pipeline.cluster import connect
from pipeline.sweep import sweep


def peak_memory():
    """Bytes of memory that this process has held at most. getrusage would count its parent's."""
    with open("/proc/self/status") as status:
        return 1024 * next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


def main(out, n_tiles):
    job = toy.line(n_tiles)
    with store.driving(out), connect(toy.no_warm_up, n_workers=2) as client:
        start = time.process_time()
        outcome = sweep(client, out, job.cube, job.compute, job.predict)
        seconds = time.process_time() - start
    done = {"committed": outcome.committed, "remaining": outcome.remaining}
    print(json.dumps({**done, "seconds": seconds, "bytes": peak_memory()}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
