"""Clusters of schedulers and workers in processes of their own, as on other machines."""

import datetime
import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

import click
import dask
import numpy as np
import pytest
import toy
from click.testing import CliRunner
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from distributed import Client, LocalCluster, Status
from distributed.security import Security

from pipeline import store
from pipeline.admission import ClusterError, sharing
from pipeline.cluster import _interrupts_kept, connect
from pipeline.layout import COMMIT
from pipeline.sweep import _draining_on_interrupt, sweep
from workflows import last_barrier
from workflows.cli import session

ROOT = Path(__file__).parents[1]
SOURCES = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
# What a worker may run before anything else, to be like one on another machine; dask runs it twice.
OTHER_NUMBA = """
from pipeline import admission
ours = admission.libraries()
admission.libraries = lambda: ours | {"numba": "0.1"}
"""
OTHER_SOURCE = "from pipeline import admission; admission._SOURCE = '0123456789ab'"
NO_PACKAGE = "import sys; sys.modules['pipeline'] = None"
OTHER_DISK = """
from pipeline.directory import Directory
Directory.read = lambda directory, key: None
from pipeline import admission
from pipeline.layout import COMMIT
admission._SIGHT = 0
"""


@contextmanager
def scheduling(here, *options):
    """A dask scheduler: yields its scheduler file, and a function that starts a worker of it.

    That takes Python to run in the worker before anything else, and returns its process.
    """
    file = here / "scheduler.json"
    environment = os.environ | {"PYTHONPATH": SOURCES}
    processes = []

    def start(*command):
        with open(here / f"{len(processes)}.log", "wb") as log:
            command = [sys.executable, "-m", "dask", *map(str, command), *options]
            processes.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log))
        return processes[-1]

    def start_worker(preload="", *more):
        (here / f"preload{len(processes)}.py").write_text(preload)
        local = ["--host", "127.0.0.1", "--no-nanny", "--no-dashboard", "--memory-limit", "0"]
        work = ["--nthreads", "1", "--local-directory", here, "--scheduler-file", file]
        preload = ["--preload", here / f"preload{len(processes)}.py"]
        return start("worker", *local, *work, *preload, *more)

    try:
        start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", file)
        wait_until(file.exists)
        yield str(file), start_worker
    finally:
        for process in processes:
            process.kill()
            process.wait()


def wait_until(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def n_workers(file, tls=None):
    address = json.loads(Path(file).read_text())["address"]
    with Client(address, security=tls, set_as_default=False) as client:
        return len(client.scheduler_info(n_workers=-1)["workers"])


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A scheduler with one worker: its file, and a function that starts more."""
    with scheduling(tmp_path_factory.mktemp("cluster")) as (file, start_worker):
        start_worker()
        wait_until(lambda: n_workers(file) == 1)
        yield file, start_worker


def assert_complete(out, plan):
    cube = store.read(out, plan.name)
    for name, values in toy.serial(plan).items():
        assert np.array_equal(cube[name].values, values)
    assert np.isfinite(cube.cpu_seconds).all()


def run(client, out, plan):
    with store.driving(out), sharing(client, out):
        return sweep(client, out, plan, toy.compute, toy.predict, report=io.StringIO())


def commit_times(out):
    records = (out / store.STORE / "toy" / COMMIT / "c").glob("*/*")
    return {path: path.stat().st_mtime_ns for path in records}


def test_workers_come_and_go_and_nothing_is_committed_twice(cluster, tmp_path):
    file, start_worker = cluster
    out, log = tmp_path / "out", tmp_path / "log"
    plan = toy.cube(tile=1, seconds=0.03, log=str(log))
    seen, changed, finished = {}, [], threading.Event()

    def watch():
        while not finished.is_set():
            now = commit_times(out)
            changed.extend(path for path in seen if now.get(path) != seen[path])
            seen.update(now)
            time.sleep(0.02)

    def come_and_go():
        two = start_worker(), start_worker()
        wait_until(lambda: n_workers(file) == 3)
        for worker, leave in zip(two, ("terminate", "kill"), strict=True):
            time.sleep(0.3)
            getattr(worker, leave)()

    with connect(toy.no_warm_up, scheduler=file) as client:
        threads = [threading.Thread(target=target) for target in (watch, come_and_go)]
        for thread in threads:
            thread.start()
        outcome = run(client, out, plan)
        finished.set()
        for thread in threads:
            thread.join()
    wait_until(lambda: n_workers(file) == 1)
    assert (outcome.failed, outcome.remaining) == ({}, 0)
    assert_complete(out, plan)
    assert len(seen) > 50
    assert not changed
    # What a worker was at when it went is computed again, and nothing else.
    again = [tile for tile, n in Counter(log.read_text().splitlines()).items() if n > 1]
    assert len(again) <= 2


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "there is no such file"),
        ("", "is no scheduler file"),
        ("tcp://127.0.0.1:8786", "is no scheduler file"),
        ("[]", "is no scheduler file"),
        ("{}", "is no scheduler file"),
        ('{"address": null}', "is no scheduler file"),
        ('{"address": "inproc://1/2"}', "is no scheduler file"),
        (b"\xff\xfe", "is no scheduler file"),
        ('{"address": "tls://127.0.0.1:9"}', "needs TLS files"),
    ],
)
def test_a_scheduler_file_that_is_none_is_one_clear_message(tmp_path, content, told):
    file = tmp_path / "scheduler.json"
    if content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    options = ["--out", str(tmp_path / "out"), "--scheduler", str(file)]
    result = CliRunner().invoke(last_barrier.main, options)
    assert result.exit_code == 2
    assert told in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("preload", "told"),
    [
        (OTHER_NUMBA, r"^the worker tcp://\S+ on \S+ has numba 0\.1 instead of \d"),
        pytest.param(
            OTHER_SOURCE,
            r"^the worker tcp://\S+ on \S+ has nasm-transport \S+ source 0123456789ab",
            marks=pytest.mark.slow,
        ),
        (NO_PACKAGE, r"^the worker tcp://\S+ lacks the package pipeline: install the same"),
        (OTHER_DISK, r"^the worker tcp://\S+ on \S+ does not see /\S+/out as this machine does"),
    ],
    ids=["numba", "source", "package", "disk"],
)
def test_a_worker_that_is_not_fit_is_one_clear_message(cluster, tmp_path, preload, told):
    file, start_worker = cluster
    worker = start_worker(preload)
    wait_until(lambda: n_workers(file) == 2)
    options = {"scheduler": file, "n_workers": None, "tls": None}
    with (
        pytest.raises(click.UsageError, match=told) as refusal,
        session(str(tmp_path / "out"), options, [], []),
    ):
        pass
    worker.kill()
    wait_until(lambda: n_workers(file) == 1)
    assert refusal.value.exit_code == 2
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "preload",
    [
        pytest.param(OTHER_NUMBA, id="numba"),
        pytest.param(NO_PACKAGE, id="package", marks=pytest.mark.slow),
        pytest.param(OTHER_DISK, id="disk", marks=pytest.mark.slow),
    ],
)
def test_a_worker_that_joins_and_is_not_fit_computes_nothing(cluster, tmp_path, preload, capfd):
    file, start_worker = cluster
    pids = tmp_path / "pids"
    plan = toy.cube(tile=1, seconds=0.03, pids=str(pids))
    with connect(toy.no_warm_up, scheduler=file) as client:
        worker = start_worker(preload)
        outcome = run(client, tmp_path / "out", plan)
        worker.wait(timeout=30)
        time.sleep(0.1)
    assert (outcome.failed, outcome.remaining) == ({}, 0)
    assert_complete(tmp_path / "out", plan)
    assert str(worker.pid) not in pids.read_text().split()
    if preload != NO_PACKAGE:  # that says so in its own log only
        assert "sent away: the worker tcp://" in capfd.readouterr().err


@pytest.mark.slow
def test_a_driver_that_is_gone_turns_no_worker_away(cluster):
    file, start_worker = cluster
    code = "import sys, os, toy; from pipeline.cluster import connect\n"
    code += "connect(toy.no_warm_up, sys.argv[1]).__enter__(); os._exit(0)"
    environment = os.environ | {"PYTHONPATH": SOURCES}
    subprocess.run([sys.executable, "-c", code, file], env=environment, check=True)
    worker = start_worker(OTHER_NUMBA)
    wait_until(lambda: n_workers(file) == 2)
    time.sleep(0.5)
    assert n_workers(file) == 2
    worker.kill()
    wait_until(lambda: n_workers(file) == 1)


@pytest.mark.slow
def test_workers_end_by_their_lifetime_and_are_replaced(tmp_path):
    # As jobs of a queue with a wall time; see the recipe job_queue.
    pids = tmp_path / "pids"
    plan = toy.cube(tile=1, seconds=0.08, pids=str(pids))
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "100ms"}),
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,
            lifetime="3s",
            lifetime_stagger="1s",
            silence_logs="CRITICAL",
        ) as workers,
    ):
        workers.adapt(minimum=2, maximum=2, interval="100ms")
        with connect(toy.no_warm_up, scheduler=workers.scheduler_address) as client:
            outcome = run(client, tmp_path / "out", plan)
    assert (outcome.failed, outcome.remaining) == ({}, 0)
    assert_complete(tmp_path / "out", plan)
    assert len(set(pids.read_text().split())) > 2


def test_ctrl_c_while_the_workers_start_comes_when_they_have_started(monkeypatch):
    clusters = []

    def start(**options):
        os.kill(os.getpid(), signal.SIGINT)
        clusters.append(LocalCluster(**options))
        return clusters[0]

    monkeypatch.setattr("pipeline.cluster.LocalCluster", start)
    with pytest.raises(KeyboardInterrupt), connect(toy.no_warm_up, n_workers=1):
        pass
    assert clusters[0].status == Status.closed
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_program_that_was_started_with_ctrl_c_ignored_ignores_it():
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with _interrupts_kept() as kept, _draining_on_interrupt() as interrupt:
            os.kill(os.getpid(), signal.SIGINT)
        assert kept == []
        assert not interrupt.is_set()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, previous)


def test_workers_are_deaf_to_ctrl_c_also_when_they_are_started_again():
    with connect(toy.no_warm_up, n_workers=1) as client:
        (pid,) = client.run(os.getpid).values()
        os.kill(pid, signal.SIGKILL)
        wait_until(lambda: pids(client) not in ([], [pid]))
        (again,) = pids(client)
        os.kill(again, signal.SIGINT)
        assert client.submit(os.getpid).result(timeout=30) == again


def pids(client):
    return list(client.run(os.getpid, on_error="ignore").values())


def test_a_sites_demand_for_encryption_is_not_for_loopback():
    with (
        dask.config.set({"distributed.comm.require-encryption": True}),
        connect(toy.no_warm_up, n_workers=1) as client,
    ):
        assert client.submit(sum, [1, 2]).result() == 3


PEM = serialization.Encoding.PEM


def certificate(path):
    """A certificate that is its own CA, and its key: their paths."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, path.name)])
    now, day = datetime.datetime.now(datetime.UTC), datetime.timedelta(days=1)
    builder = x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(now - day).not_valid_after(now + day)
    builder = builder.add_extension(x509.BasicConstraints(True, None), critical=True)
    Path(f"{path}.crt").write_bytes(builder.sign(key, hashes.SHA256()).public_bytes(PEM))
    form = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    Path(f"{path}.key").write_bytes(key.private_bytes(PEM, *form))
    return f"{path}.crt", f"{path}.key"


@pytest.fixture(scope="module")
def secured(tmp_path_factory):
    """A scheduler and a worker that speak TLS: their file and the CA, certificate and key."""
    here = tmp_path_factory.mktemp("tls")
    crt, key = certificate(here / "ours")
    options = ["--protocol", "tls", "--tls-ca-file", crt, "--tls-cert", crt, "--tls-key", key]
    security = Security(tls_ca_file=crt, tls_client_cert=crt, tls_client_key=key)
    with scheduling(here, *options) as (file, start_worker):
        start_worker()
        wait_until(lambda: n_workers(file, security) == 1)
        yield file, (crt, crt, key)


def test_a_sweep_over_tls(secured, tmp_path):
    file, tls = secured
    with connect(toy.no_warm_up, scheduler=file, tls=tls) as client:
        assert client.scheduler.address.startswith("tls://")
        run(client, tmp_path, toy.cube())
    assert_complete(tmp_path, toy.cube())


def test_tls_that_does_not_match_is_one_clear_message(secured, tmp_path):
    file, (ca, _, key) = secured
    other, other_key = certificate(tmp_path / "other")
    address = json.loads(Path(file).read_text())["address"]
    for scheduler, tls, told in (
        (file, (other, other, other_key), "answers, but hangs up: .* certificates of the CA"),
        (file, (ca, other, other_key), "answers, but hangs up: .* certificates of the CA"),
        (address.replace("tls", "tcp"), None, "answers, but hangs up: .* needs a tls:// address"),
        (file, None, "needs TLS files: CA, CERT and KEY"),
        (file, (ca, ca, other_key), "cannot be used .* the key of that"),
        (file, (ca, ca, key + "s"), r"cannot be used \(\[Errno 2\] No such file"),
        (file, (file, ca, key), "cannot be used .* in PEM format"),
        ("tcp://127.0.0.1:9", (ca, ca, key), "TLS files are for a tls:// address"),
    ):
        with pytest.raises(ClusterError, match=told), connect(toy.no_warm_up, scheduler, tls=tls):
            pass
