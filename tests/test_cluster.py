"""Clusters of schedulers and workers in processes of their own, as on other machines."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import toy
from distributed import Client
from distributed.security import Security

from pipeline.sweep.cluster import _LOCAL, ClusterError, connect

ROOT = Path(__file__).parents[1]
SOURCES = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
# What a worker may run before anything else, to be like one on another machine, and what is said of
# it then; the other complaints are in `test_sweep`.
UNFIT = "import sys; sys.modules['pipeline'] = None", "cannot run this package .*pipeline"


def certificate(path):
    """A certificate that is its own CA, and its key: their paths."""
    made = Security.temporary()
    Path(f"{path}.crt").write_text(made.tls_ca_file)
    Path(f"{path}.key").write_text(made.tls_client_key)
    return f"{path}.crt", f"{path}.key"


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A scheduler and a worker that speak TLS: a Client, the scheduler's file, a function that
    starts more workers, after Python of their own, and the CA, certificate and key."""
    here, processes = tmp_path_factory.mktemp("cluster"), []
    crt, key = certificate(here / "ours")
    tls = ["--protocol", "tls", "--tls-ca-file", crt, "--tls-cert", crt, "--tls-key", key]
    file, local = here / "scheduler.json", ["--host", "127.0.0.1"]

    def start(*command):
        with open(here / f"{len(processes)}.log", "wb") as log:
            command = [sys.executable, "-m", "dask", *map(str, command), *local, *tls]
            there = os.environ | {"PYTHONPATH": SOURCES}
            processes.append(subprocess.Popen(command, env=there, stdout=log, stderr=log))
        return processes[-1]

    def start_worker(preload=""):
        script = here / f"preload{len(processes)}.py"
        script.write_text(preload)
        work = ["--no-nanny", "--no-dashboard", "--memory-limit", "0", "--nthreads", "1"]
        places = ["--local-directory", here, "--scheduler-file", file, "--preload", script]
        return start("worker", *work, *places)

    try:
        start("scheduler", "--port", "0", "--scheduler-file", file)
        toy.wait_until(lambda: file.exists() and file.read_text().endswith("}"))
        start_worker()
        address = json.loads(file.read_text())["address"]
        security = Security(tls_ca_file=crt, tls_client_cert=crt, tls_client_key=key)
        with Client(address, security=security, set_as_default=False) as waiting:
            waiting.wait_for_workers(1)
        with connect(scheduler=str(file), tls=(crt, crt, key)) as client:
            yield client, str(file), start_worker, (crt, crt, key)
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_an_unfit_worker_computes_nothing_and_another_sweeps_over_tls(cluster, tmp_path, capfd):
    client, _, start_worker, _ = cluster
    pids, (preload, told) = tmp_path / "pids", UNFIT
    plan = toy.cube(seconds=0.1, pids=str(pids))
    assert client().scheduler.address.startswith("tls://")
    worker = start_worker(preload)
    toy.wait_until(lambda: len(client().nthreads()) == 2)
    outcome = toy.run(client, tmp_path / "out", plan)
    worker.wait(timeout=30)
    assert (outcome.failed, outcome.remaining) == ({}, 0)
    toy.assert_complete(tmp_path / "out", plan)
    assert str(worker.pid) not in pids.read_text().split()
    assert re.search(rf"retired: the worker tls://\S+ {told}", capfd.readouterr().err)


def test_a_worker_that_dies_as_it_starts_is_one_clear_error(monkeypatch):
    monkeypatch.setitem(_LOCAL, "distributed.worker.preload", ["import os; os._exit(1)"])
    told = pytest.raises(ConnectionError, match="ended while it was being started; run again")
    with told, connect(n_workers=1) as client:
        client()


def test_tls_that_does_not_match_is_one_clear_message(cluster, tmp_path):
    _, file, _, (ca, _, key) = cluster
    other, other_key = certificate(tmp_path / "other")
    address = json.loads(Path(file).read_text())["address"]
    for scheduler, tls, told in (
        (file, (ca, other, other_key), "scheduler answers at .* PEM files: its CA"),
        (file, (file, ca, key), "scheduler answers at .* PEM files: its CA"),
        (address.replace("tls", "tcp"), None, "scheduler answers at .* needs a tls:// address"),
        (file, None, "needs TLS files: CA, CERT and KEY"),
        ("tcp://127.0.0.1:9", None, r"no dask scheduler answers at tcp://127\.0\.0\.1:9"),
        ("tcp://127.0.0.1:9", (ca, ca, key), "needs TLS files: CA, CERT and KEY; others take none"),
    ):
        with pytest.raises(ClusterError, match=told), connect(scheduler, tls=tls) as client:
            client()
