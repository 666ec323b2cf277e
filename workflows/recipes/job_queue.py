"""A sweep on a cluster with a queue, its workers as jobs: Slurm here, PBS and others alike.

    python workflows/recipes/job_queue.py WORKFLOW OPTIONS...

e.g. `job_queue.py last_barrier --out /shared/out`. Edit the first cell for your machine; needs
`pip install dask-jobqueue`. The driver is one process and needs to last as long as the sweep, so
make it a job too, as `sbatch --cpus-per-task 2 --time 3-0 --wrap "python workflows/recipes/..."`.
If its time ends before the sweep does, submit it again: it resumes.
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
    "local_directory": "/tmp",  # of the node: nothing of dask's goes to the shared disk
    "worker_extra_args": [
        # Workers end before the queue kills them, and not all at once. A tile under way is lost
        # then, and computed again elsewhere; so tiles should be short against this.
        *("--lifetime", "110m"),
        *("--lifetime-stagger", "5m"),
        *("--memory-limit", "0"),  # tiles are small: no watch on memory, and no spilling to disk
    ],
}

# %% As many jobs as there should be; for those that end, new ones are submitted. (To let dask
# choose a number is of no use: few tasks wait at the scheduler, however much is left to do.)
if len(sys.argv) < 2:
    print(__doc__, file=sys.stderr)
    sys.exit(2)
workflow, *options = sys.argv[1:]
with SLURMCluster(**JOB) as cluster:
    cluster.adapt(minimum_jobs=JOBS, maximum_jobs=JOBS)
    with Client(cluster) as client:
        print(f"waiting in the queue for the first of {JOBS} jobs", file=sys.stderr)
        client.wait_for_workers(1)
    # The others join as the queue lets them.
    command = [sys.executable, "-m", f"workflows.{workflow}", *options]
    ended = subprocess.run([*command, "--scheduler", cluster.scheduler_address])
if ended.returncode:
    sys.exit(ended.returncode)
