"""Faults by schedule: a seed decides what befalls the drivers and workers of a sweep, and when.

A schedule is a few runs of one sweep with faults, and then one without, which completes the cube.
Drivers run on workers of their own (`local`: `python campaign.py …`, as a user starts it), or on a
`Pool`: a scheduler and two workers, each a process, which are restarted when they die. These and
their drivers are forked from one process that has all imports behind it.

After each run of a driver `observe` compares the store with what it held before and with a serial
computation. Progress, by which faults are timed, is what tiles write into a pipe as they begin; so
is what a driver prints, for files cannot be written while the disk is full.
"""

import asyncio
import ctypes
import fcntl
import json
import multiprocessing
import os
import random
import re
import resource
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import forkserver
from pathlib import Path

import click
import numpy as np
import pipeline.tasks  # noqa: F401 (imported once, before processes are forked)
import psutil
import pytest
import toy
from click.testing import CliRunner
from distributed import Scheduler, Worker
from pipeline.grid import tile_indices
from pipeline.layout import COMMIT
from workflows.cli import Job, carry_out, cluster_options, session, store_option

import workflows.verify
from pipeline import lease, objects, status, store, verify

ROWS = COLUMNS = 8
VARIABLES = ("wave", "sign", COMMIT)
LEASE = 2  # seconds
ENDS_WITHIN = 60  # seconds for one run; a driver that takes longer hangs


# The sweep: what drivers and workers run.


def compute(coords, settings):
    control = Path(settings["control"])
    name = _name(coords["row"][0], coords["column"][0])
    tell(control / "log", f"{name} {_is_there(control.parent / 'out', _index(name))}\n")
    arrays = toy.compute(coords, settings)
    if (control / f"poison {name}").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    if (control / f"raise {name}").exists():
        raise ArithmeticError("no answer here")
    if (control / "slow").exists():
        return {name: Slow(array) for name, array in arrays.items()}
    return arrays


class Slow:
    """An array that is slow to write: the store takes its time before each chunk."""

    def __init__(self, array):
        self.array = array

    def __array__(self, dtype=None, copy=None):
        time.sleep(0.05)
        return self.array


def predict(coords, settings):
    return 0.3 if coords["row"][0] > 0.6 else 0.15  # batches of one tile, and of three


def _name(row, column):
    return f"{row:.6f} {column:.6f}"


def _index(name):
    row, column = map(float, name.split())
    return round(row * (ROWS - 1)), round((column + 1) / 2 * (COLUMNS - 1))


def _chunks(out, index):
    row, column = map(str, index)
    group = Path(out, store.STORE, "toy")
    return {
        "wave": group / "wave" / "c" / "0" / row / column,
        "sign": group / "sign" / "c" / row / column,
        COMMIT: group / COMMIT / "c" / row / column,
    }


_BYTES = {"wave": 2 * 8 + 4, "sign": 1 + 4, COMMIT: 8 + 4}


def _is_there(out, index):
    """Whether the tile is committed, without a line of the store's."""
    try:
        return all(
            os.path.getsize(path) == _BYTES[name] for name, path in _chunks(out, index).items()
        )
    except OSError:
        return False


@click.command()
@store_option
@cluster_options
@click.argument("settings")
def main(out, place, cluster, settings):
    settings = json.loads(settings)
    tell(Path(settings["control"], "log"), f"driver {os.getpid()}\n")
    plan = toy.cube(ROWS, COLUMNS, tile=1, **settings)
    with session(out, cluster, (), [plan], place) as client:
        carry_out(client, place, Job(plan, compute, predict))


# Pipes with names.


def pipe(path):
    os.mkfifo(path)
    end = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    fcntl.fcntl(end, fcntl.F_SETPIPE_SZ, 2**20)
    return end


def tell(path, line):
    end = os.open(path, os.O_WRONLY)
    os.write(end, line.encode())
    os.close(end)


def told(end):
    heard = b""
    with suppress(BlockingIOError):
        while part := os.read(end, 2**16):
            heard += part
    return heard.decode()


# Processes.


def without_privileges():
    """Subject to permissions, even if the user is root; so are the processes that we start."""
    libc = ctypes.CDLL(None)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)
    sets = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable; and their upper halves
    libc.capget(header, sets)
    for capability in (1, 2):  # to override permissions on files, and to search directories
        libc.prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP
        for i in range(3):
            sets[i] &= ~(1 << capability)
    libc.capset(header, sets)


_PATH = os.pathsep.join(map(str, [Path(store.__file__).parents[1], Path(__file__).parent]))
_forked = multiprocessing.get_context("forkserver")
_forked.set_forkserver_preload(["campaign"])


def prepare():
    """Start the process that others are forked from, with all imports behind it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", _PATH)
        patch.setenv("OPENBLAS_NUM_THREADS", "1")  # a process with threads is not to be forked
        forkserver.ensure_running()


def in_a_session():
    """Of its own, which a Ctrl-C elsewhere does not reach; and not for longer than the tests."""
    os.setsid()
    ctypes.CDLL(None).prctl(1, signal.SIGKILL, 0, 0, 0)  # PR_SET_PDEATHSIG


def in_the_environment(variables):
    """With the credentials of an object store, and less patience with it."""
    os.environ.update(variables)
    objects.PATIENCE, lease.LEASE = 1, LEASE


def drive(output, arguments, environment):
    in_a_session()
    in_the_environment(environment)
    without_privileges()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    end = os.open(output, os.O_WRONLY)
    os.dup2(end, 1)
    os.dup2(end, 2)
    main(arguments, prog_name="campaign")


def serve(folder, port):
    in_a_session()

    async def run():
        async with Scheduler(host="127.0.0.1", port=port, dashboard=False) as scheduler:
            tell(folder / "ready", f"{os.getpid()} {scheduler.address}\n")
            await scheduler.finished()

    _silently(run)


def work(folder, address, environment):
    in_a_session()
    in_the_environment(environment)
    without_privileges()

    async def run():
        async with Worker(address, nthreads=1, memory_limit=0, local_directory=folder) as worker:
            tell(folder / "ready", f"{os.getpid()} worker\n")
            await worker.finished()

    _silently(run)


def _silently(run):
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    asyncio.run(run())


def start(function, *arguments):
    process = _forked.Process(target=function, args=arguments)
    process.start()
    return process


def end(process):
    process.kill()
    process.join()


class Pool:
    """A scheduler and two workers, each of which is started again when it died."""

    def __init__(self, folder, environment):
        self.folder, self.environment = folder, environment
        self.ready, self.known = pipe(folder / "ready"), {}
        self.scheduler = start(serve, folder, 0)
        while self.scheduler.pid not in self.known:
            self._listen()
        self.address = self.known[self.scheduler.pid]
        self.workers = [start(work, folder, self.address, environment) for _ in range(2)]
        self.stop = threading.Event()
        self.keeper = threading.Thread(target=self._keep)
        self.keeper.start()

    def _listen(self):
        self.known.update(
            (int(p), what) for p, what in map(str.split, told(self.ready).split("\n")[:-1])
        )
        time.sleep(0.01)

    def _keep(self):
        while not self.stop.is_set():
            self._listen()
            if not self.scheduler.is_alive():
                for worker in self.workers:
                    end(worker)
                self.scheduler = start(serve, self.folder, int(self.address.rpartition(":")[2]))
            for i, worker in enumerate(self.workers):
                if not worker.is_alive():
                    self.workers[i] = start(work, self.folder, self.address, self.environment)

    def wait(self):
        """Until all are there."""
        deadline = time.monotonic() + ENDS_WITHIN
        while not all(
            p.is_alive() and p.pid in self.known for p in (self.scheduler, *self.workers)
        ):
            assert time.monotonic() < deadline, "the scheduler and its workers do not come back"
            time.sleep(0.01)

    def close(self):
        self.stop.set()
        self.keeper.join()
        for process in (self.scheduler, *self.workers):
            end(process)
        os.close(self.ready)


@contextmanager
def pool(folder, environment=()):
    """`environment`: variables for the workers and for the drivers that work with them."""
    prepare()
    pool = Pool(folder, dict(environment))
    try:
        yield pool
    finally:
        pool.close()


def limit_files(process):
    """Let no file of the process grow beyond ten bytes: a full disk. Returns what undoes it."""
    before = resource.prlimit(process, resource.RLIMIT_FSIZE)
    resource.prlimit(process, resource.RLIMIT_FSIZE, (10, before[1]))
    return lambda: resource.prlimit(process, resource.RLIMIT_FSIZE, before)


class Driver:
    """A driver in a process of its own, on the pool's workers or on its own if that is None."""

    def __init__(self, stage):
        stage.n_drivers += 1
        self.pool = stage.pool
        path = stage.folder / f"output-{stage.n_drivers}"
        self.output, self.text = pipe(path), ""
        arguments = [*stage.places, json.dumps(stage.settings)]
        if self.pool is None:
            self._start_alone([*arguments, "--workers", "2"], path)
        else:
            self.pool.wait()
            arguments += ["--scheduler", self.pool.address]
            self.process = start(drive, str(path), arguments, self.pool.environment)
        self.pid = self.process.pid

    def _start_alone(self, arguments, path):
        with open(path, "wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, __file__, *arguments],
                stdout=output,
                stderr=output,
                start_new_session=True,
                env={**os.environ, "PYTHONPATH": _PATH},
            )

    @property
    def code(self):
        """The exit code, or None."""
        return self.process.poll() if self.pool is None else self.process.exitcode

    @property
    def alive(self):
        return self.code is None

    def workers(self):
        """The pids of its workers."""
        if self.pool is not None:
            return [worker.pid for worker in self.pool.workers]
        with suppress(psutil.NoSuchProcess):
            children = psutil.Process(self.pid).children(recursive=True)
            return [p.pid for p in children if "spawn_main" in " ".join(p.cmdline())]
        return []

    def wait(self, seconds=ENDS_WITHIN):
        """Whether it ended within the time."""
        deadline = time.monotonic() + seconds
        while self.alive and time.monotonic() < deadline:
            time.sleep(0.005)
        return not self.alive

    def finish(self):
        """(exit code, what it printed); all its processes are gone."""
        hung = not self.wait()
        if hung:
            os.kill(self.pid, signal.SIGKILL)
            self.wait()
        left = self._left()
        self.text += told(self.output)
        os.close(self.output)
        assert not hung, f"the driver hung:\n{self.text}"
        assert not left, f"processes of a driver outlived it: {left}"
        return self.code, self.text

    def _left(self):
        """Processes of its session that are still there some seconds after its end."""
        deadline = time.monotonic() + 15
        while left := [p for p in psutil.process_iter() if _session(p) == self.pid]:
            if time.monotonic() > deadline:
                found = [p.info for p in left]
                for process in left:
                    process.kill()
                return found
            time.sleep(0.02)
        return []


def _session(process):
    try:
        return os.getsid(process.pid) if process.status() != psutil.STATUS_ZOMBIE else None
    except (psutil.NoSuchProcess, ProcessLookupError):
        return None


# Faults. Each is a function of the stage, the driver and the random numbers, which applies it and
# ends it, and returns whether it is known to have befallen a sweep under way; None if that is to be
# seen from how the driver ends, by ENDS.


def kill_worker(stage, driver, choose):
    workers = driver.workers()
    if not workers or not stage.missing():
        return False
    _signal(choose.choice(workers), signal.SIGKILL)
    return driver.alive


def stop_worker(stage, driver, choose, seconds=None):
    workers = driver.workers()
    if not workers:
        return False
    worker = choose.choice(workers)
    _signal(worker, signal.SIGSTOP)
    driver.wait(seconds or choose.uniform(0.2, 1.0))
    under_way = driver.alive
    _signal(worker, signal.SIGCONT)
    return under_way


def stop_worker_for_a_minute(stage, driver, choose):
    return stop_worker(stage, driver, choose, 60)


def kill_driver(stage, driver, choose):
    _signal(driver.pid, signal.SIGKILL)


def kill_scheduler(stage, driver, choose):
    """On its own workers it is a part of the driver, and dies with it."""
    _signal(driver.pid if driver.pool is None else driver.pool.scheduler.pid, signal.SIGKILL)
    driver.wait()


def interrupt(stage, driver, choose):
    with suppress(ProcessLookupError):
        os.killpg(driver.pid, signal.SIGINT)  # as a terminal does: to its workers too


def fill_disk(stage, driver, choose):
    undo = []
    for worker in driver.workers():
        with suppress(ProcessLookupError):
            undo.append(limit_files(worker))
    driver.wait(3)
    for restore in undo:
        with suppress(ProcessLookupError):
            restore()


def move_store(stage, driver, choose):
    moved = choose.choice([stage.out, stage.out / store.STORE, stage.out / store.STORE / "toy"])
    try:
        os.rename(moved, stage.folder / "elsewhere")
    except FileNotFoundError:
        return False
    driver.wait(choose.uniform(0.05, 0.5))
    if made_anew := moved.exists():
        stage.made_anew = True
        # It went before the driver had looked for it, which has begun another in its place.
        stage.applied.append(kill_driver)
        kill_driver(stage, driver, choose)
        driver.wait()
        os.rename(moved, stage.folder / f"anew {time.monotonic()}")
    os.rename(stage.folder / "elsewhere", moved)
    return False if made_anew else None


def lose_permissions(stage, driver, choose):
    group = stage.out / store.STORE / "toy"
    lost, mode = choose.choice(
        [(stage.out, 0o000), (group.parent, 0o000), (group, 0o000), (stage.out / ".partial", 0o500)]
    )
    try:
        lost.chmod(mode)
    except FileNotFoundError:
        return False
    driver.wait(choose.uniform(0.05, 0.5))
    with suppress(FileNotFoundError):
        lost.chmod(0o755)


def cut_chunk(stage, driver, choose):
    return _corrupt(stage, driver, choose, lambda data: data[: choose.randrange(len(data))])


def flip_bit(stage, driver, choose):
    def flipped(data):
        i = choose.randrange(len(data))
        return data[:i] + bytes([data[i] ^ 1 << choose.randrange(8)]) + data[i + 1 :]

    return _corrupt(stage, driver, choose, flipped)


def _corrupt(stage, driver, choose, damaged):
    """Damage a chunk of a tile that is committed; `observe` asserts that it is found."""
    whole = sorted(set(stage.committed()) - stage.corrupted.keys())
    if not whole or not driver.alive:
        return False
    index = choose.choice(whole)
    path = _chunks(stage.out, index)[choose.choice(VARIABLES)]
    data = damaged(path.read_bytes())
    stage.corrupted[index] = path, data
    path.write_bytes(data)
    return True


def poison(stage, driver, choose):
    _curse(stage, choose, "poison")


def fail_tile(stage, driver, choose):
    _curse(stage, choose, "raise")


def _curse(stage, choose, how):
    stage.listen()
    names = [stage.names[index] for index in stage.missing()]
    if to_come := [name for name in names if name not in stage.begun]:
        (stage.control / f"{how} {choose.choice(to_come)}").touch()


def slow_store(stage, driver, choose):
    (stage.control / "slow").touch()
    before = len(stage.begun)
    driver.wait(choose.uniform(0.1, 0.6))
    (stage.control / "slow").unlink()
    stage.listen()
    return len(stage.begun) > before


def second_driver(stage, driver, choose):
    """At once, or when the first is at work. One of them computes."""
    second = Driver(stage)
    code, text = second.finish()
    first_is_on = driver.alive
    stage.check_end(code, text)
    return code == 2 or (first_is_on and None)  # or the first may have come second


def jump_clocks(stage, driver, choose):
    paths = [path for path in stage.out.rglob("*") if choose.random() < 0.5]
    for path in paths:
        with suppress(FileNotFoundError):
            os.utime(path, (0, 0) if choose.random() < 0.5 else (4e9, 4e9))
    return driver.alive and bool(stage.committed())


def _signal(pid, number):
    with suppress(ProcessLookupError):
        os.kill(pid, number)


_DIED = (1, r"tile \(\d, \d\) failed: its worker died each time, also when it ran alone\n")
ENDS = {
    kill_driver: [(-signal.SIGKILL, "")],
    kill_scheduler: [
        (-signal.SIGKILL, ""),
        (1, r"Error: the dask scheduler is gone; run again to resume"),
        (2, r"Error: no dask scheduler answers at tcp://\S+ \(.*\); start one"),
        (2, r"Error: tcp://\S+ answers, but hangs up: .* being stopped, to be started again"),
        (2, r"Error: the scheduler at tcp://\S+ has no workers; start `dask worker`s"),
    ],
    interrupt: [(130, r"stopped with \d+ tiles|abandoned; run the same command again to resume")],
    fill_disk: [(1, r"Error: cannot write to .*; raise the limit on the size of files\. What is")],
    move_store: [
        (1, r"Error: .*it was moved or deleted under way; put it back\. What is commit"),
        (1, r"Error: .* does not exist"),  # found out by zarr, reading the cube when it is complete
    ],
    lose_permissions: [
        # Coordinates are read by zarr, and what the system says of them is in its words.
        (1, r"Error: (cannot (write to|read) .*: |\[Errno 13\] )Permission denied"),
        (2, r"Error: (cannot (write to|read) .*: Permission denied|.* is not readable\.)"),
    ],
    poison: [_DIED],
    kill_worker: [_DIED],
    fail_tile: [(1, r"tile \(\d, \d\) failed: ArithmeticError: no answer here\n")],
    second_driver: [(2, r"Error: .* is being written by another run \(process \d+\); wait for")],
}
"""How a driver may end on account of a fault: exit code, and what it prints."""

WEIGHTS = {
    kill_worker: 4,
    stop_worker: 2,
    kill_driver: 4,
    kill_scheduler: 1,
    interrupt: 2,
    fill_disk: 3,
    move_store: 3,
    lose_permissions: 3,
    cut_chunk: 2,
    flip_bit: 2,
    poison: 1,
    fail_tile: 2,
    slow_store: 3,
    second_driver: 2,
    jump_clocks: 3,
}


NOT_AT_THE_START = {
    stop_worker,
    fill_disk,
    move_store,
    cut_chunk,
    flip_bit,
    slow_store,
    jump_clocks,
}
"""Others may come in the first half second too, in which a driver connects and makes its store."""


# The campaign.


@dataclass
class Report:
    """What a campaign did, and what went wrong: nothing, or a test fails."""

    schedules: int = 0
    runs: int = 0
    tiles: int = 0
    faults: Counter = field(default_factory=Counter)
    late: Counter = field(default_factory=Counter)
    lost: int = 0
    twice: int = 0
    overtaken: int = 0
    false_verdicts: int = 0

    def __str__(self):
        kinds = sorted(self.faults | self.late)
        lines = [
            f"  {kind}: {self.faults[kind]} (without effect: {self.late[kind]})" for kind in kinds
        ]
        return "\n".join(
            [
                f"{self.schedules} schedules, {self.runs} runs of drivers, {self.tiles} tiles, "
                f"{self.faults.total()} faults with an effect:",
                *lines,
                f"tiles lost: {self.lost}; committed twice: {self.twice}; false verdicts: "
                f"{self.false_verdicts}; committed by a worker whose driver was dead, and by "
                f"its successor's: {self.overtaken}",
            ]
        )


@dataclass
class Stage:
    """One sweep, what is known of it, and where it happens."""

    folder: Path
    pool: object
    report: Report
    seconds: float
    url: str | None = None
    n_drivers: int = 0
    seen: dict = field(default_factory=dict)  # {index: (inode, bytes) of its commit record}
    corrupted: dict = field(default_factory=dict)  # {index: (path, bytes that we left there)}
    made_anew: bool = False
    begun: list = field(default_factory=list)  # names of tiles, as often as they were begun
    drivers: set = field(default_factory=set)  # pids of those that have begun

    def __post_init__(self):
        self.out, self.control = self.folder / "out", self.folder / "control"
        self.places = ["--out", str(self.out), *(["--store", self.url] if self.url else [])]
        self.control.mkdir()
        self.log = pipe(self.control / "log")
        self.settings = {"control": str(self.control), "seconds": self.seconds}
        self.plan = toy.cube(ROWS, COLUMNS, tile=1, **self.settings)
        self.indices = tile_indices(self.plan.sizes, self.plan.tile)
        self.serial = toy.serial(self.plan)
        rows, columns = (self.plan.template[dim].values for dim in ("row", "column"))
        self.names = {(i, j): _name(rows[i], columns[j]) for i, j in self.indices}

    def committed(self):
        return [index for index in self.indices if _is_there(self.out, index)]

    def missing(self):
        return [index for index in self.indices if not _is_there(self.out, index)]

    def listen(self):
        """Hear which tiles have begun; none was committed before."""
        for line in told(self.log).splitlines():
            name, _, again = line.rpartition(" ")
            if name == "driver":
                self.drivers.add(int(again))
                continue
            self.begun.append(name)
            self.report.tiles += 1
            self.report.twice += again == "True"
            assert again == "False", f"tile {_index(name)} was computed after its commit"

    def run(self, faults, choose):
        """One run of a driver, with faults [(after what part of the tiles, fault)]."""
        driver, self.applied, effects = Driver(self), [], Counter()
        todo, begun = len(self.missing()), None
        self.until(driver, lambda: driver.pid in self.drivers)
        for part, fault in sorted(faults, key=lambda one: one[0]):
            if part:
                self.until(driver, lambda: self.is_held_by(driver))
                if begun is None:
                    begun = len(self.begun)  # some perhaps by workers of a driver that was killed
                enough = begun + part * todo
                self.until(driver, lambda enough=enough: len(self.begun) >= enough)
            else:
                driver.wait(choose.uniform(0, 0.4) if self.pool else choose.uniform(0, 6))
            if driver.alive:
                self.applied.append(fault)
                effects[fault] = fault(self, driver, choose)
        code, text = driver.finish()
        self.listen()
        self.check_end(code, text)
        for fault in {fault for _, fault in faults}:
            effect = effects[fault]
            if effect is None:
                effect = _ended_by(fault, code, text)
            (self.report.faults if effect else self.report.late)[words(fault)] += 1
        self.observe()
        return code, text

    def until(self, driver, condition):
        """Wait for the condition, or the driver's end."""
        while driver.alive and not condition():
            time.sleep(0.002)
            self.listen()

    def is_held_by(self, driver):
        with suppress(FileNotFoundError, PermissionError):
            return (self.out / ".lock").read_text() == str(driver.pid)
        return False

    def check_end(self, code, text):
        """The exit code and the message are those of one of the faults, or of a complete sweep."""
        self.report.runs += 1
        faults = self.applied
        said = f"exit code {code} after {[words(f) for f in faults]}:\n{text}"
        assert "Traceback" not in text, said
        assert len(re.findall("^Error: ", text, re.MULTILINE)) <= 1, said
        if code == 0:
            assert set(self.missing()) <= self.corrupted.keys(), said
        else:
            assert any(_ended_by(fault, code, text) for fault in faults), said
        if code == 1 and "tiles failed and stay missing" in text:
            failed = {tuple(map(int, pair)) for pair in re.findall(r"tile \((\d), (\d)\) f", text)}
            assert failed == set(self.missing()) - self.corrupted.keys(), said
            assert status.state(self.out, "toy").failed == len(failed), said

    def observe(self):
        """Nothing that was committed is lost or other than it was; all of it is right."""
        now = {}
        for index in self.committed():
            record = _chunks(self.out, index)[COMMIT]
            now[index] = record.stat().st_ino, record.read_bytes()
        damaged = {index for index, (path, data) in self.corrupted.items() if _read(path) == data}
        lost = self.seen.keys() - now.keys() - self.corrupted.keys()
        changed = {
            index
            for index in self.seen.keys() & now.keys() - self.corrupted.keys()
            if self.seen[index] != now[index]
        }
        wrong = {index for index in now.keys() - damaged if not self._is_right(index)}
        self.report.lost += len(lost)
        self.report.overtaken += len(changed)
        self.report.false_verdicts += len(wrong)
        assert not lost, f"committed and gone: {lost}"
        assert not wrong, f"committed and not what a serial computation gives: {wrong}"
        if now:
            self._verify(damaged)
        self.corrupted = {index: self.corrupted[index] for index in damaged & set(self.committed())}
        self.seen = {index: now[index] for index in now if index not in damaged}

    def _is_right(self, index):
        row, column = index
        paths = _chunks(self.out, index)
        wave = np.frombuffer(paths["wave"].read_bytes()[:-4], "<f8")
        sign = np.frombuffer(paths["sign"].read_bytes()[:-4], "i1")
        return np.array_equal(wave, self.serial["wave"][:, row, column]) and np.array_equal(
            sign, [self.serial["sign"][row, column]]
        )

    def _verify(self, damaged):
        """`verify` names what we damaged and nothing else; what it repairs is missing again."""
        found = dict(verify.verify(self.out, "toy", verify.committed(self.out, "toy")))
        named = {index for index, what in found.items() if what}
        if self.made_anew:  # the root has the metadata of the other one, until the next run
            named.discard(())
        self.report.false_verdicts += len(named ^ damaged)
        assert named == damaged, f"damaged: {damaged}, found: {named}"
        if damaged:
            invoke = CliRunner().invoke
            assert invoke(workflows.verify.main, ["--out", str(self.out)]).exit_code == 1
            repair = invoke(workflows.verify.main, ["--out", str(self.out), "--repair"])
            assert repair.exit_code == 0, repair.output
            assert damaged <= set(self.missing())

    def close(self):
        os.close(self.log)


def _read(path):
    return path.read_bytes() if path.exists() else None


def words(fault):
    return fault.__name__.replace("_", " ")


def _ended_by(fault, code, text):
    return any(
        code == expected and re.search(message, text) for expected, message in ENDS.get(fault, [])
    )


def schedule(choose):
    """[[(after what part of the tiles that are missing, fault)] for each run with faults]."""
    kinds, weights = list(WEIGHTS), list(WEIGHTS.values())
    return [
        [
            (0 if early and fault not in NOT_AT_THE_START else choose.uniform(0.05, 0.7), fault)
            for fault in choose.choices(kinds, weights, k=choose.randint(1, 3))
            for early in [choose.random() < 0.3]
        ]
        for _ in range(choose.randint(1, 2))
    ]


def carry_out_schedule(seed, folder, pool, report, faults=None):
    """Run the schedule of the seed, then the sweep until it is complete; asserts all invariants."""
    choose = random.Random(seed)
    stage = Stage(folder, pool, report, seconds=choose.choice([0.005, 0.02]))
    try:
        for together in schedule(choose) if faults is None else faults:
            stage.run(together, choose)
            for curse in [*stage.control.glob("poison*"), *stage.control.glob("raise*")]:
                curse.unlink()
        code, text = stage.run([], choose)
        assert code == 0, text
        assert not stage.missing()
        cube = store.read(stage.out, "toy")
        for name, values in stage.serial.items():
            assert np.array_equal(cube[name].values, values)
        report.schedules += 1
    finally:
        stage.close()


if __name__ == "__main__":
    import campaign

    without_privileges()
    campaign.main()
