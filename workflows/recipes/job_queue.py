"""A sweep on a cluster with a queue, its workers as jobs: Slurm here, PBS and others alike.

    python workflows/recipes/job_queue.py WORKFLOW OPTIONS...

e.g. `job_queue.py last_barrier --out /shared/out`. Edit the first cell for your machine; needs
`pip install dask-jobqueue`. The driver is one process that lasts as long as the sweep, so make it a
job too: `sbatch --cpus-per-task 2 --time 3-0 --wrap "python workflows/recipes/..."`. If its time
ends before the sweep does, submit it again: it resumes.
"""

# %% A job: a node's cores, each a worker of one thread. For PBS: PBSCluster, "resource_spec".
import subprocess
import sys

from dask_jobqueue import SLURMCluster
from distributed import Client

JOBS = 8
JOB = {
    "queue": "normal",
    "cores": 16,
    "processes": 16,
    "memory": "32GB",
    "walltime": "02:00:00",
    "interface": "ib0",  # the network that all nodes share; the scheduler listens there, to anyone
    "local_directory": "/tmp",  # of the node: dask writes nothing to the shared disk
    "worker_extra_args": [
        # Workers end before the queue kills them, and not all at once. The tile that each computes
        # then is computed again elsewhere, so tiles should be much shorter than this.
        *("--lifetime", "110m"),
        *("--lifetime-stagger", "5m"),
        *("--memory-limit", "0"),  # tiles are small: dask need not watch the memory
        *("--preload", "nasm.circles"),  # it keeps memory, which saves time
    ],
}

# %% Submit that many jobs, and a new one for each that ends. (Dask could not choose the number:
# few tasks wait at the scheduler, however much is left to do.)
if len(sys.argv) < 2:
    print(__doc__, file=sys.stderr)
    sys.exit(2)
workflow, *options = sys.argv[1:]
with SLURMCluster(**JOB) as cluster:
    cluster.adapt(minimum_jobs=JOBS, maximum_jobs=JOBS)
    with Client(cluster) as client:
        print(f"waiting in the queue for the first of {JOBS} jobs", file=sys.stderr)
        client.wait_for_workers(1)
    # The other jobs join when they start.
    command = [sys.executable, "-m", f"workflows.{workflow}", *options]
    ended = subprocess.run([*command, "--scheduler", cluster.scheduler_address])
if ended.returncode:
    sys.exit(ended.returncode)
