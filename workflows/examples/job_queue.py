"""Run a sweep on a cluster with a queue; the workers are a job array.

This script is for Slurm; other queues are similar.

    python workflows/examples/job_queue.py WORKFLOW OPTIONS...

e.g. `job_queue.py last_barrier --out /shared/out`. Edit the first cell for your machine. The driver
is one process that runs as long as the sweep, so submit it as a job too: `sbatch --cpus-per-task 2
--time 3-0 --wrap "python workflows/examples/..."`. If its time limit ends the sweep early, submit
it again: it resumes.
"""

# %% Up to eight jobs run at a time, each on the cores of one node; when one ends, the queue starts
# the next one in the array. For PBS, use qsub -J 1-1000%8 and qdel.
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from distributed import Client
from distributed.security import Security
from distributed.utils import get_ip_interface

SUBMIT = "sbatch --parsable --array=1-1000%8 --cpus-per-task=16 --time=02:00:00 --partition=normal"
CANCEL = "scancel"
INTERFACE = "ib0"  # the network that all nodes share; the scheduler listens on it
SHARED = Path.home()  # a directory that all nodes can access
# Workers end before the queue kills them, and not all at once. The tile that a worker is computing
# when it ends is recomputed elsewhere, so a tile should take much less time than a worker's
# lifetime.
WORKER = "--nworkers 16 --nthreads 1 --memory-limit 0 --lifetime 110m --lifetime-stagger 5m"
JOB = """#!/bin/bash
here=$(mktemp -d)  # on the node's disk: kernels, compiled once per job, and dask's files
trap 'rm -rf "$here"' EXIT
export NUMBA_CACHE_DIR=$here
{python} -m dask worker {security} {worker} --local-directory "$here" \\
    --preload "from nasm.arithmetic.memory import keep_freed_memory; keep_freed_memory()"
"""

# %% Start a scheduler, then the jobs. TLS is required because clients can execute arbitrary code.
if len(sys.argv) < 2:
    sys.exit(__doc__)
workflow, *options = sys.argv[1:]
with TemporaryDirectory(dir=SHARED, prefix=".queue-") as folder:
    file, pem = Path(folder) / "scheduler.json", Path(folder) / "cluster.pem"
    made = Security.temporary()
    pem.touch(0o600)
    pem.write_text(made.tls_client_key + made.tls_ca_file)
    names = "tls_ca_file", "tls_client_cert", "tls_client_key"
    trusted = Security(require_encryption=True, **dict.fromkeys(names, str(pem)))
    security = f"--scheduler-file {file} --tls-ca-file {pem} --tls-cert {pem} --tls-key {pem}"
    command = [sys.executable, "-m", "dask", "scheduler", "--protocol", "tls", "--port", "0"]
    host = get_ip_interface(INTERFACE)
    scheduler = subprocess.Popen([*command, "--host", host, "--no-dashboard", *security.split()])
    script = JOB.format(python=sys.executable, security=security, worker=WORKER)
    array = subprocess.run(SUBMIT.split(), input=script, stdout=-1, text=True, check=True).stdout
    try:
        with Client(scheduler_file=file, security=trusted) as client:
            print("waiting for the queue to start the first job", file=sys.stderr)
            client.wait_for_workers(1)
        # The other jobs join when they start.
        command = [sys.executable, "-m", f"workflows.{workflow}", *options, "--scheduler", file]
        ended = subprocess.run([*command, "--tls", pem, pem, pem])
    finally:
        subprocess.run([*CANCEL.split(), array.strip()])
        scheduler.terminate()
        scheduler.wait()
if ended.returncode:
    sys.exit(ended.returncode)
