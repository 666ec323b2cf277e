"""Clusters of schedulers and workers in processes of their own, as on other machines."""

import json
import re
import subprocess
import sys

import pytest
import toy
from distributed.security import Security

from pipeline.sweep.cluster import _LOCAL, ClusterError, connect, credentials

# What a worker may run before anything else, to be like one on another machine, and what is said of
# it then; the other complaints are in `test_sweep`.
UNFIT = "import sys; sys.modules['pipeline'] = None", "cannot run this package .*pipeline"


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A scheduler and a worker, to which this process speaks TLS as to those of another machine: a
    Client, the scheduler's file, and the CA, certificate and key."""
    here = tmp_path_factory.mktemp("cluster")
    with connect(n_workers=1) as ours:
        file, tls = here / "scheduler.json", credentials(ours(), here)
        file.write_text(json.dumps({"address": ours().scheduler.address}))
        with connect(str(file), tls=tls) as client:
            yield client, file, tls


def test_an_unfit_worker_computes_nothing_and_another_sweeps_over_tls(cluster, tmp_path, capfd):
    client, file, (ca, cert, key) = cluster
    pids, script, (preload, told) = tmp_path / "pids", tmp_path / "preload.py", UNFIT
    script.write_text(preload)
    places = ["--scheduler-file", file, "--local-directory", tmp_path, "--preload", script]
    tls = ["--tls-ca-file", ca, "--tls-cert", cert, "--tls-key", key, "--host", "127.0.0.1"]
    command = [sys.executable, "-m", "dask", "worker", "--no-nanny", "--no-dashboard", *places]
    plan = toy.cube(seconds=0.1, pids=str(pids))
    with subprocess.Popen([*map(str, command), *tls], stderr=subprocess.DEVNULL) as worker:
        try:
            toy.wait_until(lambda: len(client().nthreads()) == 2)
            outcome = toy.run(client, tmp_path / "out", plan)
            worker.wait(timeout=30)
        finally:
            worker.kill()
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
    _, file, (ca, _, key) = cluster
    other, made = tmp_path / "other.pem", Security.temporary()
    other.write_text(made.tls_client_key + made.tls_ca_file)
    address = json.loads(file.read_text())["address"]
    for scheduler, tls, told in (
        (str(file), (ca, other, other), "scheduler answers at .* PEM files: its CA"),
        (str(file), (str(file), ca, key), "scheduler answers at .* PEM files: its CA"),
        (address.replace("tls", "tcp"), None, "scheduler answers at .* needs a tls:// address"),
        (str(file), None, "needs TLS files: CA, CERT and KEY"),
        ("tcp://127.0.0.1:9", None, r"no dask scheduler answers at tcp://127\.0\.0\.1:9"),
        ("tcp://127.0.0.1:9", (ca, ca, key), "needs TLS files: CA, CERT and KEY; others take none"),
    ):
        with pytest.raises(ClusterError, match=told), connect(scheduler, tls=tls) as client:
            client()
