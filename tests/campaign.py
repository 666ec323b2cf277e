"""Faults by schedule: a seed decides what befalls the drivers and workers of a sweep, and when.

A schedule is a few runs of one sweep with faults, and then one without, which completes the cube.
Drivers are processes that run a command on two workers of their own, or on two that are there, a
dask Client of which is the `pool`. After each run `observe` compares the store with what it held
before and with a serial computation; it looks at bytes, not through zarr.
"""

import json
import multiprocessing
import os
import random
import re
import signal
import time
from collections import Counter
from contextlib import contextmanager, suppress
from multiprocessing import forkserver
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
import psutil
import pytest
import toy

from pipeline import store
from pipeline.cubes.cube import Job
from pipeline.sweep.cluster import connect, credentials
from workflows.shared.cli import command, sweeps

SIDE = 8  # tiles, of one cell each, along rows and columns
TILES = set(np.ndindex(SIDE, SIDE))
ENDS_WITHIN = 60  # seconds for one run; a driver that takes longer hangs
_CHUNKS = {
    "wave": ("0/", 20),
    "sign": ("", 5),
    "tiles/commit": ("0/", 20),
}  # bytes with checksum


# The sweep: what drivers and workers run.


def compute(coords, settings):
    control, name = Path(settings["control"]), f"{coords['row'][0]:.6f} {coords['column'][0]:.6f}"
    again = _index(name) in records(store.place_of(settings["place"]))
    _tell(control / "log", f"{name} {again}\n")
    if (control / f"poison {name}").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    if (control / f"raise {name}").exists():
        raise ArithmeticError("no answer here")
    return toy.compute(coords, settings)


def predict(coords, settings):
    return 0.3 if coords["row"][0] > 0.6 else 0.15  # batches of one tile, and of three


@command()
@click.argument("settings")
@sweeps
def main(run, settings):
    settings = json.loads(settings)
    _tell(settings["control"] + "/log", f"driver {os.getpid()}\n")
    job = Job(toy.cube(SIDE, SIDE, tile=1, **settings), compute, predict, toy.no_warm_up)
    with run.sweeping(job):
        run.sweep(job)


def _tell(path, line):
    end = os.open(path, os.O_WRONLY | os.O_APPEND)
    os.write(end, line.encode())
    os.close(end)


def _index(name):
    row, column = map(float, name.split())
    return round(row * (SIDE - 1)), round((column + 1) / 2 * (SIDE - 1))


def _name(index):
    return f"{index[0] / (SIDE - 1):.6f} {2 * index[1] / (SIDE - 1) - 1:.6f}"


# What the store holds, byte by byte.


def key(variable, index):
    return f"toy.zarr/{variable}/c/{_CHUNKS[variable][0]}{index[0]}/{index[1]}"


def read(place, key):
    with suppress(FileNotFoundError):
        return bytes(place.objects().get(key).bytes())
    return b""


def records(place):
    """{index: (bytes, time) of its commit record} of the tiles that are there in full length."""
    try:
        files = {f["path"]: f for page in place.objects().list("toy.zarr") for f in page}
    except FileNotFoundError:
        return {}
    sizes = {path: file["size"] for path, file in files.items()}
    whole = [i for i in TILES if all(sizes.get(key(v, i)) == n for v, (_, n) in _CHUNKS.items())]
    found = {index: key("tiles/commit", index) for index in whole}
    return {i: (read(place, path), files[path]["last_modified"]) for i, path in found.items()}


# Processes.

_forked = multiprocessing.get_context("forkserver")
_forked.set_forkserver_preload(["campaign"])


@contextmanager
def own():
    """Make ready to start drivers; None, the pool of those that have workers of their own."""
    with pytest.MonkeyPatch.context() as patch:
        here = Path(__file__).parent
        patch.setenv("PYTHONPATH", os.pathsep.join(map(str, [here.parent, here])))
        patch.setenv("OPENBLAS_NUM_THREADS", "1")  # a process with threads is not to be forked
        forkserver.ensure_running()
        yield None


@contextmanager
def pool():
    """A Client of two workers, which are started again when they die."""
    with own(), connect(n_workers=2) as client, TemporaryDirectory() as folder:
        client().tls = credentials(client(), folder)
        yield client()


def _replenish(pool):
    """Wait until both workers are there; Dask gives up one that was killed while it started."""
    workers = pool.cluster.workers
    for name in [name for name, nanny in workers.items() if nanny.status.name != "running"]:
        workers.pop(name)
    pool.cluster.scale(2)  # starts those that are not in the list
    pool.wait_for_workers(2, timeout=ENDS_WITHIN)


def _in_session(leader):
    """The pids of the processes of a driver's session: its own workers, also after its death."""
    found = set()
    for pid in psutil.pids():
        with suppress(OSError):
            found |= {pid} if os.getsid(pid) == leader else set()
    return found


def drive(output, arguments, environment):
    os.setsid()  # a Ctrl-C reaches us and our workers, and nobody else
    os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with open(output, "wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    main(arguments, prog_name="campaign")


class Driver:
    """A driver in a process of its own, on the pool's workers, or on two of its own."""

    def __init__(self, stage):
        self.pool, self.output = stage.pool, stage.folder / f"output {time.monotonic()}"
        workers = ["--workers", "2"]
        if self.pool:
            _replenish(self.pool)
            workers = ["--scheduler", self.pool.scheduler.address, "--tls", *self.pool.tls]
        arguments = [json.dumps(stage.settings), *stage.options, *workers]
        aws = {name: value for name, value in os.environ.items() if name.startswith("AWS_")}
        self.process = _forked.Process(target=drive, args=(str(self.output), arguments, aws))
        self.process.start()
        self.pid = self.process.pid

    @property
    def alive(self):
        return self.process.exitcode is None

    def workers(self):
        """The pids of its workers."""
        if self.pool:
            return [nanny.pid for nanny in self.pool.cluster.workers.values() if nanny.pid]
        with suppress(psutil.Error):
            children = psutil.Process(self.pid).children()
            return [child.pid for child in children if "spawn_main" in str(child.cmdline())]
        return []

    def finish(self):
        """(exit code, what it printed), once its own workers are gone too."""
        self.process.join(ENDS_WITHIN)
        hung = self.alive
        self.process.kill()
        self.process.join()
        toy.wait_until(lambda: self.pool or not _in_session(self.pid))
        text = self.output.read_text() if self.output.exists() else ""
        assert not hung, f"the driver hung:\n{text}"
        return self.process.exitcode, text


# Faults: functions of the stage, the driver and the random numbers.


def kill_worker(stage, driver, choose):
    if workers := driver.workers():
        _signal(choose.choice(workers), signal.SIGKILL)


def stop_worker(stage, driver, choose):
    if workers := driver.workers():
        worker = choose.choice(workers)
        _signal(worker, signal.SIGSTOP)
        driver.process.join(choose.uniform(0.2, 1.0))
        _signal(worker, signal.SIGCONT)


def kill_driver(stage, driver, choose):
    _signal(driver.pid, signal.SIGKILL)


def interrupt(stage, driver, choose):
    with suppress(ProcessLookupError):
        os.killpg(driver.pid, signal.SIGINT)  # as a terminal does: to its workers too


def cut_chunk(stage, driver, choose):
    _corrupt(stage, choose, lambda data: data[: choose.randrange(len(data))])


def flip_bit(stage, driver, choose):
    def flipped(data):
        i = choose.randrange(len(data))
        return data[:i] + bytes([data[i] ^ 1 << choose.randrange(8)]) + data[i + 1 :]

    _corrupt(stage, choose, flipped)


def _corrupt(stage, choose, damaged):
    """Damage a chunk of a tile that is committed; `observe` asserts that it is found."""
    if whole := sorted(records(stage.place).keys() - stage.corrupted.keys()):
        index = choose.choice(whole)
        chunk = key(choose.choice(list(_CHUNKS)), index)
        data = damaged(read(stage.place, chunk))
        stage.corrupted[index] = chunk, data
        stage.place.objects().put(chunk, data)


def poison(stage, driver, choose):
    _curse(stage, choose, "poison")


def fail_tile(stage, driver, choose):
    _curse(stage, choose, "raise")


def _curse(stage, choose, how):
    stage.listen()
    if to_come := sorted(TILES - stage.begun.keys()):
        (stage.control / f"{how} {_name(choose.choice(to_come))}").touch()


def second_driver(stage, driver, choose):
    """On a disk one of them computes; in an object store both do."""
    stage.two_drivers |= not stage.place.is_directory
    stage.check_end(*Driver(stage).finish())


def _signal(pid, number):
    with suppress(ProcessLookupError):
        os.kill(pid, number)


ENDS = {
    kill_worker: 1,
    stop_worker: 0,
    kill_driver: -signal.SIGKILL,
    interrupt: 130,
    cut_chunk: 0,
    flip_bit: 0,
    poison: 1,
    fail_tile: 1,
    second_driver: 2,
}
"""The exit code with which a driver may end on account of a fault, if not with 0."""

WEIGHTS = [4, 2, 4, 2, 2, 2, 1, 2, 2]
NEEDS_TILES = stop_worker, cut_chunk, flip_bit


# The campaign.


class Stage:
    """One sweep, what is known of it, and where it happens."""

    def __init__(self, folder, pool, report, seconds, url=None):
        self.folder, self.pool, self.report = folder, pool, report
        self.place = store.place_of(url or folder / "out")
        self.options = ["--out", str(folder / "out"), *(["--store", url] if url else [])]
        self.control, self.log = folder / "control", folder / "control" / "log"
        self.control.mkdir()
        self.log.touch()
        self.settings = {"control": str(self.control), "seconds": seconds, "place": str(self.place)}
        self.serial = toy.serial(toy.cube(SIDE, SIDE, tile=1))
        self.seen = {}  # {index: commit record}
        self.corrupted = {}  # {index: (key, bytes that we left there)}
        self.begun = Counter()  # {index: how often}
        self.two_drivers = False  # whether two of them have been at work at once

    def listen(self):
        """Hear which drivers and tiles have begun; none of these was committed before."""
        lines = [line.rpartition(" ") for line in self.log.read_text().splitlines()]
        self.drivers = {int(pid) for name, _, pid in lines if name == "driver"}
        tiles = [(_index(name), again) for name, _, again in lines if name != "driver"]
        self.begun = Counter(index for index, _ in tiles)
        twice = [index for index, again in tiles if again == "True"]
        if self.two_drivers:  # in an object store nothing keeps them apart: they lose time
            return
        self.report["twice"] += len(twice)
        assert not twice, f"tiles were computed after their commit: {twice}"

    def run(self, faults, choose):
        """One run of a driver, with faults [(after what part of the tiles, fault)]."""
        driver, self.applied = Driver(self), []
        self.until(driver, lambda: driver.pid in self.drivers)
        begun, todo = self.begun.total(), len(TILES - records(self.place).keys())
        for part, fault in sorted(faults, key=lambda one: one[0]):
            if part:
                enough = begun + part * todo
                self.until(driver, lambda enough=enough: self.begun.total() >= enough)
            else:
                driver.process.join(choose.uniform(0, 0.4))
            if driver.alive:
                self.applied.append(fault)
                self.report[fault.__name__] += 1
                fault(self, driver, choose)
        code, text = driver.finish()
        time.sleep(0.3)  # what workers of a driver that was killed are at is committed too
        self.listen()
        self.check_end(code, text)
        self.observe()
        return code, text

    def until(self, driver, condition):
        self.listen()
        while driver.alive and not condition():
            time.sleep(0.005)
            self.listen()

    def check_end(self, code, text):
        """The exit code and the message are those of one of the faults, or of a complete sweep."""
        self.report["runs"] += 1
        said = f"exit code {code} after {[f.__name__ for f in self.applied]}:\n{text}"
        assert "Traceback" not in text, said
        assert len(re.findall("^Error: ", text, re.MULTILINE)) <= 1, said
        missing = TILES - records(self.place).keys() - self.corrupted.keys()
        if code == 0:
            assert not missing, said
            return
        assert code in [ENDS[fault] for fault in self.applied], said
        if "tiles failed and stay missing" in text:
            failed = {tuple(map(int, two)) for two in re.findall(r"tile \((\d), (\d)\) f", text)}
            assert failed == missing, said

    def observe(self):
        """Nothing that was committed is lost; all of it is right; what is damaged is found."""
        now = records(self.place)
        damaged = {i for i, (key, data) in self.corrupted.items() if read(self.place, key) == data}
        lost = self.seen.keys() - now.keys() - self.corrupted.keys()
        kept = self.seen.keys() & now.keys() - self.corrupted.keys()
        wrong = {index for index in now.keys() - damaged if not self._is_right(index)}
        self.report["lost"] += len(lost)
        self.report["written again"] += sum(self.seen[index] != now[index] for index in kept)
        assert not lost, f"committed and gone: {lost}"
        found = set()
        if now:
            found = {index for index, _ in store.verify(self.place, "toy", repair=True)}
            assert not damaged & records(self.place).keys()
        self.report["false"] += len(wrong) + len(found ^ damaged)
        assert not wrong, f"committed and not what a serial computation gives: {wrong}"
        assert found == damaged, f"damaged: {damaged}, found: {found}"
        self.corrupted, self.seen = {}, {index: now[index] for index in now.keys() - damaged}

    def _is_right(self, index):
        for name, values in self.serial.items():
            stored = np.frombuffer(read(self.place, key(name, index))[:-4], values.dtype)
            if not np.array_equal(stored, np.atleast_1d(values[(..., *index)])):
                return False
        return True


def schedule(choose):
    """[[(after what part of the tiles that are missing, fault)] for each run with faults]."""
    return [
        [
            (0 if early and fault not in NEEDS_TILES else choose.uniform(0.05, 0.7), fault)
            for fault in choose.choices(list(ENDS), WEIGHTS, k=choose.randint(1, 3))
            for early in [choose.random() < 0.3]
        ]
        for _ in range(choose.randint(1, 2))
    ]


def carry_out(seed, folder, pool, report, url=None, faults=None):
    """Run the schedule of the seed, then the sweep until it is complete; asserts all invariants.

    Returns the exit codes of the runs.
    """
    choose = random.Random(seed)
    stage = Stage(folder, pool, report, choose.choice([0.005, 0.02]), url)
    report.update(dict.fromkeys(("lost", "twice", "false", "written again"), 0))
    codes = []
    for together in [*(faults or schedule(choose)), []]:
        codes.append(stage.run(together, choose)[0])
        for curse in [*stage.control.glob("poison*"), *stage.control.glob("raise*")]:
            curse.unlink()
    assert codes[-1] == 0
    assert records(stage.place).keys() == TILES
    report["schedules"] += 1
    report["tiles begun"] += stage.begun.total()
    return codes
