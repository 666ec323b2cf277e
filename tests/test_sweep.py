"""Sweeps of a cube that is quick to compute (toy.py), with workers and drivers that die."""

import asyncio
import errno
import heapq
import io
import json
import os
import re
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from asyncio import CancelledError
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from http.client import HTTPException
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from urllib.request import urlopen

import dask
import numpy as np
import psutil
import pytest
import toy
from cases import thirds
from dask.utils import parse_timedelta
from distributed.security import Security

from pipeline import store
from pipeline.provenance import EVERYTHING
from pipeline.sweep import cluster, submit
from pipeline.sweep import sweep as sweeps
from pipeline.sweep.cluster import ClusterError, connect
from pipeline.sweep.progress import Progress
from pipeline.sweep.sweep import _complaint, _pack, sweep


@pytest.fixture(scope="module")
def client():
    with connect(n_workers=1) as client:
        yield client


@pytest.mark.parametrize("tile", thirds([3, 1, 10, 50]))
def test_a_sweep_equals_a_serial_computation_whatever_the_tiling(here, tmp_path, tile):
    plan = toy.cube(tile=tile)
    outcome = toy.watched_sweep(here, tmp_path, plan)
    assert (outcome.failed, outcome.interrupted, outcome.remaining) == ({}, False, 0)
    toy.assert_complete(tmp_path, plan)
    assert outcome.committed == len(toy.COMPUTED) == len(set(toy.COMPUTED))  # each tile once
    assert toy.watched_sweep(here, tmp_path, plan).committed == len(toy.COMPUTED) == 0


class WordlessError(Exception):
    def __str__(self):
        raise RuntimeError("no words")


def fail(error):
    raise error


ODD = {
    "short": (lambda tile: tile["wave"][:, :1], "wave has the shape (2, 1, 3) instead of"),
    "wordless": (lambda tile: fail(WordlessError()), "WordlessError: <exception str() failed>"),
    "long": (lambda tile: fail(OSError("a\nb\x1b[31m" + "x" * 10**7)), "OSError: a b [31mxxx"),
    "cancelled": (lambda tile: fail(CancelledError()), "CancelledError"),
    "base": (lambda tile: fail(GeneratorExit()), "GeneratorExit"),
}


def compute_oddly(coords, settings):
    tile = toy.compute(coords, settings)
    if (coords["row"][0], coords["column"][0]) == (0.0, -1.0):
        return tile | {"wave": ODD[settings["odd"]][0](tile)}
    return tile


@pytest.mark.parametrize("odd", ODD)
def test_a_wrong_shape_or_an_odd_exception_affects_only_its_own_tile(here, tmp_path, odd):
    outcome = toy.run(here, tmp_path, toy.cube(odd=odd), compute=compute_oddly)
    assert (outcome.committed, list(outcome.failed)) == (19, [(0, 0)])
    assert ODD[odd][1] in outcome.failed[0, 0]
    assert len(outcome.failed[0, 0]) <= 500
    assert reasons(tmp_path) == outcome.failed


def test_dask_does_not_give_up_on_a_worker_that_the_sweep_still_waits_for(client):
    client()
    given_up_after = parse_timedelta(dask.config.get("distributed.deploy.lost-worker-timeout"))
    assert given_up_after >= submit._STARTING


@pytest.mark.parametrize("attempts", thirds([1, 2]))  # attempts with the tile alone; 2 by default
def test_a_tile_that_kills_its_workers_harms_no_other_tile(client, tmp_path, monkeypatch, attempts):
    if attempts == 1:
        monkeypatch.setattr(sweeps, "_ATTEMPTS_ALONE", 1)
    outcome = toy.run(client, tmp_path, toy.cube(poison=[0.0, -1.0], pids=str(tmp_path / "pids")))
    # The workers were the first one, one per attempt, and one for the batch's other tiles.
    assert len({*(tmp_path / "pids").read_text().split()}) == 2 + attempts
    assert list(outcome.failed) == [(0, 0)]
    assert "its worker died" in outcome.failed[0, 0]
    assert (outcome.committed, outcome.remaining) == (19, 1)
    assert reasons(tmp_path) == outcome.failed


def test_a_sweep_without_a_fit_worker_ends_with_one_message(here, tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.sweep.sweep._complaint", lambda *_: "is unfit")
    with pytest.raises(ClusterError, match=r"no worker is fit to compute: .* unfit") as refusal:
        toy.run(here, tmp_path, toy.cube())
    assert "\n" not in str(refusal.value)
    assert toy.commit_times(tmp_path) == {}


def reasons(out):
    (state,) = store.status(store.place_of(out))
    return state.reasons


ctrl_c = partial(os.kill, os.getpid(), signal.SIGINT)


def test_ctrl_c_drains_the_sweep_unless_ignored_and_the_next_run_resumes(here, tmp_path, capsys):
    plan = toy.cube(5, 5, tile=1)
    # A program that was started with SIGINT ignored continues to ignore Ctrl-C.
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    outcome = toy.watched_sweep(here, tmp_path / "ignored", plan, {5: ctrl_c})
    signal.signal(signal.SIGINT, previous)
    assert (outcome.interrupted, outcome.remaining) == (False, 0)
    outcome = toy.watched_sweep(here, tmp_path, plan, {5: ctrl_c})
    assert outcome.interrupted
    assert 5 <= outcome.committed == len(toy.COMPUTED) == 25 - outcome.remaining < 15
    assert "waiting for the tiles in flight" in capsys.readouterr().err
    assert toy.watched_sweep(here, tmp_path, plan).committed == outcome.remaining
    toy.assert_complete(tmp_path, plan)


def test_a_second_ctrl_c_abandons_the_tiles_in_flight(tmp_path):
    begun = tmp_path / "begun"

    def interrupt():
        toy.wait_until(begun.exists)
        ctrl_c()
        time.sleep(0.5)
        ctrl_c()

    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt), connect(n_workers=1) as client:
        toy.run(client, tmp_path / "out", toy.cube(seconds=30, log=str(begun)))
    assert time.time() - begun.stat().st_mtime < 20
    assert toy.commit_times(tmp_path / "out") == {}


class Full(io.StringIO):
    """A log that cannot be written to; a sweep continues nevertheless."""

    def write(self, text):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("n_workers", [2, 1024])
def test_one_driver_keeps_a_thousand_workers_busy(n_workers):
    """Simulate 0.5-s tiles, two minutes of work per worker, and 2 ms to schedule a batch."""
    tiles = 240 * n_workers
    batches = list(_pack(np.full(tiles, 0.5), n_workers))
    assert np.array_equal(np.sort(np.concatenate(batches)), np.arange(tiles))
    free, now, end = [0.0] * n_workers, 0.0, 0.0
    for batch in batches:
        now += 0.002
        end = max(now, heapq.heappop(free)) + 0.5 * len(batch)
        heapq.heappush(free, end)
    assert 120 / max(free) > 0.95


def test_the_most_expensive_tiles_come_first_and_cheap_ones_share_batches():
    first, second, *others = _pack(np.array([0.0] * 1000 + [9.0, 0.2, 0.2]), 2)
    assert first.tolist() == [1000]
    assert (set(second[:2].tolist()), len(second)) == ({1001, 1002}, 33)
    assert max(map(len, others)) < 200  # committing tiles takes time, too


def test_tiles_of_equal_cost_come_in_random_order():
    batches = list(_pack(np.full(1000, 0.5), 2))
    rank = np.concatenate(batches)
    assert np.array_equal(np.sort(rank), np.arange(1000))
    correlation = np.corrcoef(rank, np.arange(1000))[0, 1]
    assert abs(correlation) < 0.15  # 4.7 standard deviations


def test_sweeps_in_a_series_share_one_progress_line_and_repeat_no_tile(here, tmp_path):
    report, place = io.StringIO(), store.place_of(tmp_path)
    with store.driver_lock(place):
        with Progress("series", report, {"toy": 1.0}) as progress:
            for wanted in ({(0, 0)}, {(1, 0), (2, 0)}):
                sweep(here, place, toy.job(), progress, wanted)
            begun = progress.begun
            sweep(None, place, toy.job(), progress, {(1, 0)})  # requests no workers
            assert progress.begun == begun
        assert progress.done == pytest.approx(begun)
        assert 0 < progress.used < progress.wall
        output = report.getvalue().splitlines()[-1]  # on a slow machine there are several lines
        assert re.match(r"series: \d+%, elapsed 0:\d\d, remaining about [\d:]+$", output)
        with Progress("toy", Full()) as progress:
            sweep(here, place, toy.job(), progress, {(3, 0)})
        (state,) = store.status(place)
    assert (state.done, state.tiles) == (4, 4)  # the other 16 were not requested


def test_a_store_deleted_during_a_sweep_ends_it_with_one_message(here, tmp_path):
    plan, out, away = toy.cube(5, 5, tile=1), tmp_path / "out", tmp_path / "away"
    # A worker may find that another worker has recreated `out`, without metadata.
    message = "out: .* does not exist|was moved, or deleted|out/toy.zarr are damaged"
    with pytest.raises((store.StoreFailed, store.Refused), match=message):
        toy.watched_sweep(here, out, plan, {5: partial(out.rename, away)})
    assert len(toy.commit_times(out)) <= 2  # tiles that the workers were writing
    for place in (away, out):  # `out` may contain tiles that were in flight, but no metadata
        assert toy.watched_sweep(here, place, plan).remaining == 0
        toy.assert_complete(place, plan)


def test_a_sweep_fails_if_a_written_tile_is_missing_at_the_end(here, tmp_path):
    plan = toy.cube(5, 5, tile=1)

    def lose_one():
        next(iter(toy.commit_times(tmp_path))).unlink()

    with pytest.raises(store.StoreFailed, match=r"toy\.zarr has lost 1 written tile$"):
        toy.watched_sweep(here, tmp_path, plan, {5: lose_one})
    assert toy.watched_sweep(here, tmp_path, plan).committed == 1
    toy.assert_complete(tmp_path, plan)


@pytest.mark.skipif(
    not Path("/proc/self/statm").exists() or "CS_GNU_LIBC_VERSION" not in os.confstr_names,
    reason="other C libraries manage freed memory differently",
)
def test_workers_keep_freed_memory_but_programs_that_import_nasm_do_not(client):
    assert client().submit(toy.kept_memory).result() > 120
    program = "import toy, nasm.barriers, nasm.tori; print(toy.kept_memory())"
    here = Path(__file__).parent
    environment = os.environ | {"PYTHONPATH": f"{here}{os.pathsep}{here.parent}"}
    run = [sys.executable, "-c", program]
    output = subprocess.run(run, env=environment, capture_output=True, check=True).stdout
    assert float(output) < 8


def test_workers_listen_on_loopback_only_and_answer_only_their_own_driver(client):
    cluster = client().cluster
    nannied = [psutil.Process(nanny.pid) for nanny in cluster.workers.values() if nanny.pid]
    workers = [one for process in nannied for one in (process, *process.children(recursive=True))]
    ours = {cluster.scheduler.port, cluster.scheduler.http_server.port}
    ours |= {nanny.port for nanny in cluster.workers.values()}
    listening = [
        connection.laddr
        for process in [psutil.Process(), *workers]
        for connection in process.net_connections()
        if connection.status == psutil.CONN_LISTEN
        and (process in workers or connection.laddr.port in ours)
    ]
    assert len(listening) >= 3  # at least the scheduler, a nanny and its worker
    assert {address.ip for address in listening} == {"127.0.0.1"}
    # Without this cluster's certificate, neither a TLS client nor a browser gets an answer.
    anyone = ssl.create_default_context()
    anyone.check_hostname, anyone.verify_mode = False, ssl.CERT_NONE

    spoke = []

    def talk_to(port):
        with pytest.raises((OSError, HTTPException)):
            urlopen(f"http://127.0.0.1:{port}/info/main/workers.html", timeout=1)
        with (
            suppress(OSError),
            socket.create_connection(("127.0.0.1", port), timeout=1) as other,
            anyone.wrap_socket(other) as secret,
        ):
            spoke.append(port)
            assert secret.recv(99) == b""

    with ThreadPoolExecutor() as pool:  # some ports are silent until the timeout
        assert list(pool.map(talk_to, [port for _, port in listening]))
    assert len(spoke) >= 3


def elsewhere(client, folder):
    """Write the client's scheduler file; return its path and the paths of the three TLS files."""
    file = folder / "scheduler.json"
    file.write_text(json.dumps({"address": client().scheduler.address}))
    return str(file), cluster.write_credentials(client(), folder)


def test_an_unfit_worker_computes_nothing_while_another_sweeps_over_tls(client, tmp_path, capfd):
    """This process connects to the scheduler as if the scheduler ran on another machine."""
    file, (ca, cert, key) = elsewhere(client, tmp_path)
    pids, script = tmp_path / "pids", tmp_path / "preload.py"
    script.write_text("import sys; sys.modules['pipeline'] = None")
    places = ["--scheduler-file", file, "--local-directory", tmp_path, "--preload", script]
    tls = ["--tls-ca-file", ca, "--tls-cert", cert, "--tls-key", key, "--host", "127.0.0.1"]
    command = [sys.executable, "-m", "dask", "worker", "--no-nanny", "--no-dashboard", *places]
    plan = toy.cube(seconds=0.1, pids=str(pids))
    with (
        connect(file, tls=(ca, cert, key)) as guest,
        subprocess.Popen([*map(str, command), *tls], stderr=subprocess.DEVNULL) as worker,
    ):
        try:
            toy.wait_until(lambda: len(guest().nthreads()) == 2)
            outcome = toy.run(guest, tmp_path / "out", plan)
            worker.wait(timeout=30)
        finally:
            worker.kill()
    assert (outcome.failed, outcome.remaining) == ({}, 0)
    toy.assert_complete(tmp_path / "out", plan)
    assert str(worker.pid) not in pids.read_text().split()
    message = r"retired: the worker tls://\S+ cannot run this package .*pipeline"
    assert re.search(message, capfd.readouterr().err)


def test_a_worker_that_dies_while_starting_raises_one_clear_error(monkeypatch):
    monkeypatch.setitem(cluster._LOCAL, "distributed.worker.preload", ["import os; os._exit(1)"])
    refusal = pytest.raises(ConnectionError, match=r"cannot be started: .*Nanny")
    with refusal, connect(n_workers=1) as client:
        client()


@pytest.mark.parametrize(
    ("lacking", "expected"),
    [
        ("resource.getrlimit", "1 worker and their driver need about 60 open files, and 20 are"),
        ("multiprocessing.get_context", "semaphores, in /dev/shm: .*Read-only file system"),
        ("socket.create_connection", r"the address 127\.0\.0\.1: .*Read-only"),
    ],
)
def test_one_clear_error_reports_a_machine_on_which_workers_would_hang(
    monkeypatch, lacking, expected
):
    error = OSError(errno.EROFS, os.strerror(errno.EROFS))
    limit = (
        (lambda _: (20, 20)) if lacking == "resource.getrlimit" else lambda *_, **__: fail(error)
    )
    monkeypatch.setattr(f"pipeline.sweep.cluster.{lacking}", limit)
    monkeypatch.setattr("pipeline.sweep.cluster.resource.setrlimit", lambda *_: None)
    with pytest.raises(ConnectionError, match=expected), connect(n_workers=1) as client:
        client()


def test_a_user_s_dask_settings_apply_only_to_workers_on_other_machines(client, monkeypatch):
    """Some of these settings would make workers on this machine hang."""
    monkeypatch.setattr(cluster, "_ANSWER_PATIENCE", 0.5)
    theirs = {
        "temporary-directory": "/proc/nowhere",
        "distributed.worker.multiprocessing-method": "fork",
        "distributed.worker.lifetime.duration": "1s",
        "distributed.scheduler.idle-timeout": "1s",
        "distributed.scheduler.worker-saturation": "much",
        "distributed.comm.timeouts.connect": "1us",
        "distributed.nanny.preload": ["nowhere.py"],
    }
    with dask.config.set(theirs):
        with connect(n_workers=1) as start:
            start()
            seen = {key: dask.config.get(key) for key in theirs}
        assert not {key for key in theirs if seen[key] == theirs[key]}
        assert {key: dask.config.get(key) for key in theirs} == theirs
        with connect("tcp://127.0.0.1:9") as start:
            with pytest.raises(ClusterError, match="no dask scheduler answers"):
                start()
            assert {key: dask.config.get(key) for key in theirs} == theirs


def test_a_sweep_runs_in_a_thread_and_in_an_event_loop(here, tmp_path):
    """Web applications use threads, which cannot handle Ctrl-C; notebooks use event loops."""
    outcomes = []

    def work(out):
        outcomes.append(toy.run(here, out, toy.cube()))

    thread = threading.Thread(target=work, args=(tmp_path / "thread",))
    thread.start()
    thread.join()

    async def main():
        work(tmp_path / "loop")

    asyncio.run(main())
    assert [outcome.remaining for outcome in outcomes] == [0, 0]
    toy.assert_complete(tmp_path / "thread", toy.cube())


def test_connect_waits_for_the_scheduler_file(client, tmp_path, monkeypatch):
    file, tls = elsewhere(client, tmp_path)
    late = tmp_path / "home" / "late.json"
    late.parent.mkdir()
    monkeypatch.setenv("HOME", str(late.parent))
    threading.Timer(0.3, os.rename, (file, late)).start()
    with connect("~/late.json", tls=tls) as guest:
        assert guest().nthreads()
    monkeypatch.setattr(cluster, "_FILE_PATIENCE", 0.1)
    refusal = pytest.raises(ClusterError, match=f"scheduler='{file}': no such file")
    with refusal, connect(file):
        pass


def test_mismatched_tls_files_or_addresses_give_one_clear_message(client, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "_ANSWER_PATIENCE", 0.5)
    file, (ca, _, key) = elsewhere(client, tmp_path)
    plain = client().scheduler.address.replace("tls", "tcp")
    other, made = tmp_path / "other.pem", Security.temporary()
    other.write_text(made.tls_client_key + made.tls_ca_file)
    for scheduler, tls, message in (
        (file, (ca, other, other), "scheduler answers at .* PEM files: its CA"),
        (file, (file, ca, key), "scheduler answers at .* PEM files: its CA"),
        (plain, None, "scheduler answers at .* needs a tls:// address"),
        (file, None, "needs TLS files: CA, CERT and KEY"),
        ("tcp://127.0.0.1:9", None, r"no dask scheduler answers at tcp://127\.0\.0\.1:9"),
        ("tcp://127.0.0.1:9", (ca, ca, key), "needs TLS files: CA, CERT and KEY; others take none"),
    ):
        with pytest.raises(ClusterError, match=message), connect(scheduler, tls=tls) as guest:
            guest()


def during(out, act):
    """Start and return a thread that calls `act` once the first tile is committed."""

    def wait_and_act():
        toy.wait_until(lambda: toy.commit_times(out))
        act()

    thread = threading.Thread(target=wait_and_act)
    thread.start()
    return thread


def test_ctrl_c_does_not_stop_workers(client):
    """Ctrl-C stops neither a worker that is starting nor one that has started."""
    (nanny,) = client().cluster.workers.values()
    worker = client().submit(os.getpid, pure=False).result(timeout=60)
    os.kill(worker, signal.SIGKILL)
    toy.wait_until(lambda: nanny.pid not in (worker, None))  # its replacement is starting
    os.kill(worker := nanny.pid, signal.SIGINT)
    assert client().submit(os.getpid, pure=False).result(timeout=60) == worker
    os.kill(worker, signal.SIGINT)
    assert client().submit(os.getpid, pure=False).result(timeout=60) == worker


@pytest.fixture
def messages(monkeypatch):
    """Collect what a sweep prints about workers; make the sweep notice quickly if none are left."""
    printed = []
    monkeypatch.setattr(submit, "print", lambda text, file: printed.append(text), raising=False)
    monkeypatch.setattr(submit, "_PATIENCE", 0.2)
    monkeypatch.setattr(submit, "_ROLL_CALL", 0.1)
    return printed


def test_a_sweep_waits_for_new_workers_of_a_remote_scheduler(client, tmp_path, messages):
    processes = client().cluster

    def leave_and_join():
        processes.scale(0)
        toy.wait_until(lambda: messages)
        processes.scale(1)

    leaver = during(tmp_path / "there", leave_and_join)
    file, tls = elsewhere(client, tmp_path)
    with connect(file, tls=tls) as guest:
        assert toy.run(guest, tmp_path / "there", toy.cube(seconds=0.1)).remaining == 0
    leaver.join()
    assert messages == ["no workers are left; waiting until some join"]


def test_a_sweep_on_this_machine_gives_up_once_its_workers_are_gone(client, tmp_path, messages):
    """This must be the last test that needs the worker, because it stops the worker."""
    leaver = during(tmp_path, lambda: client().cluster.scale(0))
    with pytest.raises(ConnectionError, match="no workers are left; run again to resume"):
        toy.run(client, tmp_path, toy.cube(seconds=0.5))
    leaver.join()
    assert 0 < len(toy.commit_times(tmp_path)) < 20


def test_workers_that_are_slow_to_stop_do_not_make_their_work_fail(monkeypatch):
    def slow(*args, **options):
        return SimpleNamespace(close=partial(fail, TimeoutError("of the end")))

    monkeypatch.setattr("distributed.LocalCluster", slow)
    monkeypatch.setattr("distributed.Client", slow)

    def work(outcome):
        with connect(n_workers=1) as client:
            client()
            outcome()

    work(toy.no_warm_up)
    with pytest.raises(TimeoutError, match="of the work"):
        work(partial(fail, TimeoutError("of the work")))


def test_a_worker_with_different_libraries_or_a_different_disk_is_unfit(tmp_path, monkeypatch):
    place, ours = store.place_of(tmp_path), store.COMPUTED_BY
    for library in ("numba", "xarray", "zarr"):
        driver = re.sub(rf"\b{library} [^,]+", f"{library} 0.1", ours)
        message = f"has {library} {version(library)} instead of {library} 0.1"
        assert _complaint(place, "toy", "", EVERYTHING, driver) == message
    monkeypatch.setattr("pipeline.sweep.sweep._SIGHT", 0)
    assert (
        _complaint(place, "toy", "", EVERYTHING, ours) == f"does not see {place} as the driver does"
    )
    store.create(place, toy.cube(), ours)
    other = toy.cube(depth=2).config_hash
    assert _complaint(place, "toy", other, EVERYTHING, ours).startswith("does not see")
    assert _complaint(place, "toy", toy.cube().config_hash, EVERYTHING, ours) == ""
