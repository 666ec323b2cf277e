"""Sweeps survive faults: a seed decides what happens to the driver and its workers, and when.

A driver is a program that starts workers, by default two, and sweeps with them. After each run with
faults, the store is compared with its contents before the run, and with a serial computation. A
final run without faults completes the cube.
"""

import os
import random
import re
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import click
import numpy as np
import psutil
import pytest
import toy

from pipeline import store
from workflows.shared.cli import command, sweeps

SIDE = 8  # number of tiles, of one cell each, along each axis


@command()
@click.argument("log")
@sweeps
def main(run, log):
    job = toy.job(SIDE, SIDE, 1, log=log, seconds=0.02)
    with run.sweeping(job):
        run.sweep(job)


def driver(out, n_workers=2):
    arguments = [sys.executable, __file__, str(out.parent / "log"), "--out", str(out)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    paths = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    arguments += ["--workers", str(n_workers)]
    return subprocess.Popen(arguments, env=paths, start_new_session=True, **pipes)


def begun(out):
    """Return the tiles in the order in which workers started them."""
    log = out.parent / "log"
    lines = log.read_text().splitlines() if log.exists() else []
    places = [map(float, line.split()) for line in lines]
    return [(round(x * (SIDE - 1)), round((y + 1) / 2 * (SIDE - 1))) for x, y in places]


def kill_worker(process, choose):
    with suppress(psutil.Error, IndexError):  # there may be no worker
        children = psutil.Process(process.pid).children()
        choose.choice([one for one in children if "spawn_main" in str(one.cmdline())]).kill()


def kill_driver(process, choose):
    process.kill()


def interrupt(process, choose):
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, so that workers are interrupted too


# Nonzero exit codes of a driver after a fault, as a shell reports them.
ENDS = {kill_worker: 1, kill_driver: 137, interrupt: 130}


def in_session(leader):
    """Return True if a process from a driver's session remains: workers may outlive the driver."""
    for pid in psutil.pids():
        with suppress(OSError):
            if os.getsid(pid) == leader:
                return True
    return False


def run(out, faults, choose, n_workers=2):
    """Run a driver, and cause each fault after workers have started some of the missing tiles."""
    place, log_before, codes = store.place_of(out), len(begun(out)), {0}
    before = whole(place)
    with driver(out, n_workers) as process:
        for fault in faults if len(before) < SIDE**2 else []:
            enough = log_before + choose.uniform(0.1, 0.6) * (SIDE**2 - len(before))
            toy.wait_until(lambda e=enough: process.poll() is not None or len(begun(out)) >= e)
            if process.poll() is None:
                fault(process, choose)
                codes.add(ENDS[fault])
        output, _ = process.communicate(timeout=60)
    toy.wait_until(lambda: not in_session(process.pid))
    code = process.returncode if process.returncode >= 0 else 128 - process.returncode
    context = f"exit code {code} after {[fault.__name__ for fault in faults]}:\n{output}"
    assert code in codes, context
    assert "Traceback" not in output, context
    assert code in (0, 137) or "again" in output, context
    assert len(re.findall("^Error: ", output, re.MULTILINE)) <= 1, context
    assert not before & set(begun(out)[log_before:])  # no tile is computed again
    now = whole(place)
    assert before <= now  # no tile is lost
    if code == 0:
        assert now == set(np.ndindex(SIDE, SIDE)), context
    return now


def whole(place):
    """Return the committed tiles, after comparing them with a serial computation."""
    if not toy.commit_times(Path(place.root)):
        return set()
    assert list(store.verify(place, "toy")) == []
    done = set(map(tuple, np.argwhere(np.isfinite(toy.records(place).values)).tolist()))
    cube, serial = store.read(place, "toy"), toy.serial(toy.cube(SIDE, SIDE, tile=1))
    for index in done:
        for name, values in serial.items():
            assert np.array_equal(cube[name].values[..., *index], values[..., *index])
    return done


def test_a_sweep_survives_the_loss_of_a_worker_and_of_its_driver(here, tmp_path):
    out = tmp_path / "out"
    done = run(out, [kill_worker, kill_driver], random.Random(0), n_workers=1)
    plan = toy.cube(SIDE, SIDE, tile=1, log=str(tmp_path / "log"), seconds=0.02)
    assert toy.run(here, out, plan).committed >= SIDE**2 - len(done) > 0
    toy.assert_complete(out, plan)


@pytest.mark.parametrize("seed", [
    *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 3)),
    *(pytest.param(seed, marks=pytest.mark.release) for seed in range(3, 13)),
])  # fmt: skip
def test_a_sweep_survives_a_schedule_of_faults(tmp_path, seed):
    choose, out = random.Random(seed), tmp_path / "out"
    schedule = [choose.choices(list(ENDS), k=choose.randint(1, 3)) for _ in range(2)]
    for faults in [*schedule, []]:
        done = run(out, faults, choose)
    assert len(done) == SIDE**2
    toy.assert_complete(out, toy.cube(SIDE, SIDE, tile=1))
