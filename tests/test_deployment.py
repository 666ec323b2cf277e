"""Test a sweep that runs as it would on a cluster and writes to an object store.

Scheduler, workers and driver are separate processes that communicate over TLS. The object store is
a real S3 server.

Run as `python test_deployment.py SCHEDULER_FILE PEM URL SIDE`, this file acts as the driver: a
script in which a user sweeps a function of their own. At the end it prints the CPU time and the
memory that it used.
"""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from itertools import product

import numpy as np
import pytest
import seaweed
import toy
from distributed import Client
from distributed.security import Security

import pipeline
from nasm import periodic
from pipeline import store

SIDE = 25
NAME = "unhurried"
LEAST_SECONDS = 0.02  # of a tile
PATIENCE = 600  # seconds; workers may have to compile kernels


def least_residue(kappa):
    """Return the smaller of the residues of the orbits 13/34 and 21/55."""
    return min(periodic.residue(kappa, 13, 34), periodic.residue(kappa, 21, 55))


def unhurried(kappa):
    """Return `least_residue`, but late, so that no sweep ends before it has been interrupted."""
    time.sleep(LEAST_SECONDS)
    return least_residue(kappa)


def residues(side):
    """Return a Job in which each forcing is a separate tile."""
    axis = f"0:1:{side}"
    options = {"tile": 1, "seconds": LEAST_SECONDS}
    return pipeline.over_plane(unhurried, "two-kicks", axis, axis, **options)


def trusted(pem):
    names = "tls_ca_file", "tls_client_cert", "tls_client_key"
    return Security(require_encryption=True, **dict.fromkeys(names, str(pem)))


def main(file, pem, url, side):
    with Client(scheduler_file=file, security=trusted(pem)) as client:
        client.wait_for_workers(2)
        begun = time.process_time()
        try:
            pipeline.fill(residues(int(side)), url, client)
        except pipeline.Interrupted as stopped:
            print(json.dumps({"remaining": stopped.remaining}))
            sys.exit(130)
    seconds = time.process_time() - begun
    print(json.dumps({"seconds": seconds, "bytes": toy.peak_memory()}))


@contextmanager
def cluster(folder):
    """Run a scheduler and two workers with their nannies; yield the arguments for a driver."""
    file, pem = folder / "scheduler.json", folder / "cluster.pem"
    made = Security.temporary()
    pem.touch(0o600)
    pem.write_text(made.tls_client_key + made.tls_ca_file)
    shared = ["--scheduler-file", file, "--host", "127.0.0.1"]
    shared += ["--tls-ca-file", pem, "--tls-cert", pem, "--tls-key", pem]
    parts = (
        ["scheduler", "--protocol", "tls", "--port", "0", "--no-dashboard"],
        ["worker", "--nworkers", "2", "--nthreads", "1", "--local-directory", folder],
    )
    with ExitStack() as running, (folder / "log").open("wb") as log:
        for part in parts:
            command = map(str, [sys.executable, "-m", "dask", *part, *shared])
            process = running.enter_context(subprocess.Popen(command, stdout=log, stderr=log))
            running.callback(process.terminate)
            toy.wait_until(lambda: file.exists() and file.read_text(), PATIENCE)
        yield file, pem


@contextmanager
def driver(cluster, url, side):
    """Run a driver, and kill it at the end."""
    command = map(str, [sys.executable, __file__, *cluster, url, side])
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def committed(place):
    return sum(state.done for state in store.status(place))


def sweep_with_interruptions(folder, side):
    """Interrupt a sweep in four ways, and let it finish.

    Returns the swept cube, the report of the last driver, and any damage found in the cube.
    """
    with seaweed.serving(folder) as (kill_server, start_server), cluster(folder) as here:
        url = "s3://cubes/run"
        place, reached = store.place_of(url), []

        def advance(process):
            """Wait until another tenth of the sweep is done."""
            before = committed(place)

            def is_further():
                assert process.poll() is None
                return committed(place) > before + side * side / 10

            toy.wait_until(is_further, PATIENCE)
            reached.append(committed(place))

        with driver(here, url, side) as stopped:
            advance(stopped)
            stopped.send_signal(signal.SIGINT)
            assert stopped.wait(PATIENCE) == 130
            remaining = json.load(stopped.stdout)["remaining"]
        assert remaining == side * side - committed(place)

        with driver(here, url, side) as killed:
            advance(killed)

        with driver(here, url, side) as last:
            advance(last)
            with Client(scheduler_file=str(here[0]), security=trusted(here[1])) as client:
                worker, _ = client.run(os.getpid).values()
            os.kill(worker, signal.SIGKILL)
            advance(last)
            kill_server()
            time.sleep(2)
            start_server()
            report, _ = last.communicate(timeout=PATIENCE)
        assert last.returncode == 0, (folder / "log").read_text()[-2000:]
        assert sorted(reached) == reached
        return (
            store.read(place, NAME).load(),
            json.loads(report),
            list(store.verify(place, NAME)),
        )


@pytest.mark.slow
def test_a_sweep_on_a_cluster_into_an_object_store_survives_interruptions(tmp_path):
    cube, report, damage = sweep_with_interruptions(tmp_path, SIDE)
    strengths = product(cube.kappa2.values, cube.kappa1.values)
    expected = [least_residue((first, second)) for second, first in strengths]
    np.testing.assert_array_equal(cube[NAME], np.reshape(expected, (SIDE, SIDE)))
    assert damage == []
    assert report["bytes"] < 300e6


if __name__ == "__main__":
    main(*sys.argv[1:])
