"""The sweep, on a cube that is quick to compute (toy.py), with workers and drivers that die."""

import errno
import io
import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
from asyncio import CancelledError
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import toy

from pipeline import store
from pipeline.cubes.cube import Job
from pipeline.sweep.cluster import ClusterError, connect
from pipeline.sweep.progress import Progress, duration
from pipeline.sweep.sweep import _ended, _pack, sweep


@pytest.fixture(scope="module")
def client():
    with connect(n_workers=2) as client:
        yield client


def run(client, out, plan, wanted=None, **functions):
    place, job = store.place_of(out), Job(plan, toy.compute, toy.predict, toy.no_warm_up)
    with store.driving(place):
        return sweep(client, place, replace(job, **functions), wanted, toy.silent())


def assert_complete(out, plan):
    cube = store.read(store.place_of(out), plan.name)
    for name, values in toy.serial(plan).items():
        assert np.array_equal(cube[name].values, values)
    assert np.isfinite(cube.cpu_seconds).all()


@pytest.mark.parametrize("tile", [1, 3, 10, 50])
def test_a_sweep_equals_a_serial_computation_whatever_the_tiling(client, tmp_path, tile):
    plan = toy.cube(tile=tile)
    outcome = run(client, tmp_path, plan)
    assert (outcome.failed, outcome.interrupted, outcome.remaining) == ({}, False, 0)
    assert_complete(tmp_path, plan)


def test_a_sweep_equals_a_serial_computation_with_another_number_of_workers(tmp_path):
    with connect(n_workers=1) as client:
        run(client, tmp_path, toy.cube())
    assert_complete(tmp_path, toy.cube())


def test_every_tile_is_computed_once_and_none_again(client, tmp_path):
    log = tmp_path / "log"
    plan = toy.cube(log=str(log))
    assert run(client, tmp_path / "out", plan).committed == 20
    assert run(client, tmp_path / "out", plan).committed == 0
    lines = log.read_text().splitlines()
    assert len(lines) == len(set(lines)) == 20


def test_only_the_wanted_tiles_are_computed(client, tmp_path):
    plan = toy.cube()
    assert run(client, tmp_path, plan, wanted={(0, 0), (2, 1)}).committed == 2
    seconds = store.read(store.place_of(tmp_path), "toy").cpu_seconds.values
    assert set(zip(*map(list, np.nonzero(np.isfinite(seconds))), strict=True)) == {(0, 0), (2, 1)}


def test_a_tile_that_raises_fails_and_the_others_go_on(client, tmp_path):
    plan = toy.cube(raises=[0.0, -1.0])
    outcome = run(client, tmp_path, plan)
    assert outcome.failed == {(0, 0): "ArithmeticError: no answer here"}
    assert (outcome.committed, outcome.remaining) == (19, 1)


class Terminal(io.StringIO):
    def isatty(self):
        return True


class WordlessError(Exception):
    def __str__(self):
        raise RuntimeError("no words")


def fail(error):
    raise error


ODD = {
    "short": (
        lambda tile: tile["wave"][:, :1],
        "wave has the shape (2, 1, 3) instead of (2, 3, 3)",
    ),
    "long": (lambda tile: np.tile(tile["wave"], 2), "wave has the shape (2, 3, 6) instead of"),
    "scalar": (lambda tile: 1.0, "wave has the shape () instead of"),
    "complex": (lambda tile: tile["wave"] * 1j, "wave is of complex128, and does not fit into"),
    "text": (lambda tile: tile["wave"].astype(str), "does not fit into float64"),
    "wordless": (lambda tile: fail(WordlessError()), "WordlessError: <exception str() failed>"),
    "long words": (lambda tile: fail(OSError("x" * 10**7)), "OSError: xxx"),
    "lines": (lambda tile: fail(OSError("a\nb\x1b[31m")), "OSError: a b [31m"),
    "cancelled": (lambda tile: fail(CancelledError()), "CancelledError"),
    "base": (lambda tile: fail(GeneratorExit()), "GeneratorExit"),
}


def compute_oddly(coords, settings):
    tile = toy.compute(coords, settings)
    if (coords["row"][0], coords["column"][0]) == (0.0, -1.0):
        return tile | {"wave": ODD[settings["odd"]][0](tile)}
    return tile


@pytest.fixture(scope="module")
def here():
    """Workers in this process, for functions that no other can import."""
    with toy.workers_here() as client:
        yield client


@pytest.mark.parametrize("odd", ODD)
def test_a_tile_of_another_shape_or_an_odd_exception_fails_alone(here, tmp_path, odd):
    outcome = run(here, tmp_path, toy.cube(odd=odd), compute=compute_oddly)
    assert (outcome.committed, list(outcome.failed)) == (19, [(0, 0)])
    assert ODD[odd][1] in outcome.failed[0, 0]
    assert len(outcome.failed[0, 0]) <= 500
    assert reasons(tmp_path) == outcome.failed


@pytest.mark.parametrize("cost", ["a second", np.ones(2), None, np.nan, -1.0, np.inf])
def test_an_invalid_cost_falls_back_to_a_default(here, tmp_path, cost, capsys):
    place, job = store.place_of(tmp_path), toy.job(predict=lambda *_: cost)
    with store.driving(place):
        sweep(here, place, job)
    assert_complete(tmp_path, job.cube)
    assert "nan" not in capsys.readouterr().err


def test_a_log_that_cannot_be_written_does_not_end_the_sweep(client, tmp_path):
    class Full(Terminal):
        def write(self, text):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    place = store.place_of(tmp_path)
    with store.driving(place):
        sweep(client, place, toy.job(), progress=Progress("toy", Full()))
    assert_complete(tmp_path, toy.cube())


def test_no_tile_is_added_by_other_mathematics(client, tmp_path, monkeypatch):
    plan = toy.cube()
    assert run(client, tmp_path, plan, wanted={(0, 0)}).committed == 1
    before = commit_times(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(store, "computed_by", lambda: "mathematics 0123456789ab")
        with pytest.raises(store.Refused, match="this is mathematics 0123456789ab"):
            run(client, tmp_path, plan)
    assert commit_times(tmp_path) == before
    run(client, tmp_path, plan)
    assert_complete(tmp_path, plan)


def test_a_complete_cube_needs_no_workers(client, tmp_path, capsys):
    place, job = store.place_of(tmp_path), toy.job()
    run(client, tmp_path, job.cube)
    with store.driving(place):
        assert sweep(None, place, job).committed == 0
    assert capsys.readouterr().err == "toy: nothing to compute\n"


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.3, "0 s"), (90, "90 s"), (720, "12 min"), (3600 * 3.2, "3.2 h")]
)
def test_times_are_told_in_words(seconds, words):
    assert duration(seconds) == words


def test_a_tile_that_kills_its_workers_fails_alone(client, tmp_path):
    plan = toy.cube(poison=[0.0, -1.0])
    outcome = run(client, tmp_path, plan)
    assert list(outcome.failed) == [(0, 0)]
    assert "its worker died" in outcome.failed[0, 0]
    assert (outcome.committed, outcome.remaining) == (19, 1)
    assert reasons(tmp_path) == outcome.failed


def test_a_sweep_survives_workers_killed_at_random(tmp_path):
    plan = toy.cube(tile=1, seconds=0.03)
    choose = random.Random(1)

    def kill_three(client):
        for _ in range(3):
            time.sleep(0.7)
            pids = []
            while not pids:  # both may be on their way back
                pids = list(client.run(os.getpid, on_error="ignore").values())
            os.kill(choose.choice(pids), signal.SIGKILL)

    with connect(n_workers=2) as client:
        killer = threading.Thread(target=kill_three, args=[client()])
        killer.start()
        first = run(client, tmp_path, plan)
        killer.join()
    # A tile may have had the bad luck to be killed each time; it is only missing, not lost.
    assert first.committed + len(first.failed) == 130
    committed = commit_times(tmp_path)
    with connect(n_workers=2) as client:
        run(client, tmp_path, plan)
    assert_complete(tmp_path, plan)
    assert committed.items() <= commit_times(tmp_path).items()


def test_a_sweep_without_workers_gives_up_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.sweep.sweep._PATIENCE", 1)
    with connect(n_workers=1) as client:

        def retire():
            while not commit_times(tmp_path):
                time.sleep(0.05)
            client().cluster.scale(0)

        threading.Thread(target=retire).start()
        with pytest.raises(ConnectionError, match="no workers are left; run again to resume"):
            run(client, tmp_path, toy.cube(tile=1, seconds=0.1))
    assert 0 < len(commit_times(tmp_path)) < 130


def reasons(out):
    (state,) = store.status(store.place_of(out))
    return state.reasons


def commit_times(out):
    records = (out / "toy.zarr/cpu_seconds/c").rglob("*")
    return {path: path.stat().st_mtime_ns for path in records if path.is_file()}


def start_driver(out, seconds=0.05, interrupt=signal.default_int_handler):
    command = [sys.executable, str(Path(__file__).with_name("toy.py")), str(out), str(seconds)]
    return subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        cwd=out.parent,
        preexec_fn=lambda: signal.signal(signal.SIGINT, interrupt),
    )


def wait_for_commits(out, n, driver):
    deadline = time.monotonic() + 60
    while len(commit_times(out)) < n:
        assert driver.poll() is None, driver.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("kills", [2, pytest.param(10, marks=pytest.mark.slow)])
def test_a_driver_killed_at_random_loses_nothing_and_repeats_nothing(tmp_path, kills):
    choose = random.Random(kills)
    plan = toy.cube(tile=1, seconds=0.05)
    committed = {}
    for i in range(kills):
        driver = start_driver(tmp_path / "out")
        wait_for_commits(tmp_path / "out", (i + 1) * 120 // (kills + 1), driver)
        time.sleep(choose.uniform(0, 0.1))
        driver.kill()
        driver.communicate()
        now = commit_times(tmp_path / "out")
        assert committed.items() <= now.items()
        committed = now
    driver = start_driver(tmp_path / "out")
    _, error = driver.communicate(timeout=60)
    assert driver.returncode == 0, error
    assert committed.items() <= commit_times(tmp_path / "out").items()
    assert_complete(tmp_path / "out", plan)


def test_ctrl_c_drains_and_the_next_run_resumes(tmp_path):
    driver = start_driver(tmp_path / "out")
    wait_for_commits(tmp_path / "out", 10, driver)
    os.killpg(driver.pid, signal.SIGINT)  # as a terminal does: to the driver and its workers
    _, error = driver.communicate(timeout=60)
    assert driver.returncode == 130, error
    assert "waiting for the tiles in flight" in error
    committed = commit_times(tmp_path / "out")
    assert 10 <= len(committed) < 130
    driver = start_driver(tmp_path / "out", seconds=0.05)
    _, error = driver.communicate(timeout=60)
    assert driver.returncode == 0, error
    assert committed.items() <= commit_times(tmp_path / "out").items()
    assert_complete(tmp_path / "out", toy.cube(tile=1, seconds=0.05))


def test_a_program_started_with_ctrl_c_ignored_ignores_it(tmp_path):
    driver = start_driver(tmp_path / "out", 0.02, interrupt=signal.SIG_IGN)
    wait_for_commits(tmp_path / "out", 10, driver)
    os.killpg(driver.pid, signal.SIGINT)
    _, error = driver.communicate(timeout=60)
    assert driver.returncode == 0, error
    assert_complete(tmp_path / "out", toy.cube(tile=1, seconds=0.02))


def test_a_second_ctrl_c_abandons_the_tiles_in_flight(tmp_path):
    driver = start_driver(tmp_path / "out", seconds=30)
    for line in driver.stderr:
        if "connected" in line:
            break
    time.sleep(2)
    os.kill(driver.pid, signal.SIGINT)
    time.sleep(0.5)
    start = time.monotonic()
    os.kill(driver.pid, signal.SIGINT)
    driver.communicate(timeout=60)
    assert driver.returncode != 0
    assert time.monotonic() - start < 20
    assert commit_times(tmp_path / "out") == {}


def test_batches_hold_every_tile_once_and_start_with_the_most_expensive():
    costs = np.array([0.01, 3.0, 0.2, 0.4, 0.02, 0.0])
    batches = list(_pack(costs))
    assert batches[0].tolist() == [1]
    assert sorted(np.concatenate(batches)) == list(range(len(costs)))
    assert (np.diff(costs[np.concatenate(batches)]) <= 0).all()
    assert all(costs[batch].sum() <= 0.5 or len(batch) == 1 for batch in batches)
    assert len(batches) < len(costs)


def test_progress_tells_tiles_rate_and_time_left(client, tmp_path, capsys):
    place = store.place_of(tmp_path)
    with store.driving(place):
        sweep(client, place, toy.job())
    said = capsys.readouterr().err
    assert "toy: 20/20 tiles" in said
    assert "0 s left" in said


def test_a_series_of_sweeps_shares_one_line_of_progress(client, tmp_path):
    report, place = io.StringIO(), store.place_of(tmp_path)
    with store.driving(place), Progress("series", report) as progress:
        for wanted in ({(0, 0)}, {(1, 0), (2, 0)}, {(1, 0)}):
            sweep(client, place, toy.job(), wanted, progress)
        assert "1/1 tiles" not in report.getvalue()
    assert report.getvalue().splitlines()[-1].startswith("series: 3/3 tiles")


def predict_slowly(coords, settings):
    time.sleep(0.002)
    return 0.01


def test_to_predict_many_costs_shows_progress(client, tmp_path, monkeypatch):
    report, place = Terminal(), store.place_of(tmp_path)
    monkeypatch.setattr(sys, "stderr", report)
    with store.driving(place):
        sweep(client, place, toy.job(30, 30, tile=1, predict=predict_slowly))
    first, *_, last = report.getvalue().split("\r")
    assert re.match(r"toy: costs: \d+/900 tiles", first)
    assert re.match(r"toy: 900/900 tiles", last)


def test_a_store_that_is_deleted_under_way_ends_the_sweep_with_one_message(client, tmp_path):
    def delete():
        wait_until(lambda: len(commit_times(tmp_path / "out")) > 5)
        (tmp_path / "out").rename(tmp_path / "away")

    thread = threading.Thread(target=delete)
    thread.start()
    with pytest.raises(store.StoreFailed, match=r"out: .* does not exist|was moved, or deleted"):
        run(client, tmp_path / "out", toy.cube(tile=1, seconds=0.05))
    thread.join()
    assert len(commit_times(tmp_path / "out")) <= 2  # what the workers were writing
    run(client, tmp_path / "away", toy.cube(tile=1, seconds=0.05))
    assert_complete(tmp_path / "away", toy.cube(tile=1))


def wait_until(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


class Promise:
    """A dask future that ends when it is told to."""

    def add_done_callback(self, end):
        self.end = end

    def result(self, timeout):
        return None

    def release(self):
        pass


def test_the_batches_in_flight_follow_the_workers_that_there_are(monkeypatch):
    monkeypatch.setattr("pipeline.sweep.sweep._ROLL_CALL", 0)
    workers = [1] * 10 + [4] * 20 + [0] * 10 + [2] * 60
    in_flight, seen = [], []

    def nthreads():
        seen.append(len(in_flight))
        if in_flight:
            promise = in_flight.pop(0)
            promise.end(promise)
        return range(workers[len(seen) - 1])

    def submit(batch):
        in_flight.append(Promise())
        return in_flight[-1]

    client = SimpleNamespace(nthreads=nthreads)
    next_batch = partial(next, iter(range(90)), None)
    assert [batch for batch, _ in _ended(client, submit, next_batch)] == list(range(90))
    # Two per worker, and one as long as there is none; one of them has ended a moment before.
    assert [seen[i] for i in (9, 29, 39, 59)] == [1, 7, 1, 3]


def test_workers_listen_on_loopback_only(client):
    client()
    here = psutil.Process()
    listening = [
        connection.laddr.ip
        for process in [here, *here.children(recursive=True)]
        for connection in process.net_connections()
        if connection.status == psutil.CONN_LISTEN
    ]
    assert len(listening) >= 3  # the scheduler and two workers
    assert set(listening) == {"127.0.0.1"}


def test_a_scheduler_that_does_not_answer_is_one_clear_error():
    with (
        pytest.raises(ClusterError, match=r"no dask scheduler answers at tcp://127\.0\.0\.1:9"),
        connect(scheduler="tcp://127.0.0.1:9") as client,
    ):
        client()


def test_a_running_scheduler_is_used_by_its_address(client, tmp_path):
    with connect(scheduler=client().scheduler.address) as other:
        run(other, tmp_path, toy.cube())
    assert_complete(tmp_path, toy.cube())
