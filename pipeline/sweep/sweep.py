"""The sweep: compute what a cube misses, tile by tile, on a dask cluster.

1. List the missing tiles. If there are any, connect to the workers and predict the cost of each.
   The first batches are empty: with these workers load or compile their kernels.
2. Pack cheap tiles into batches, the longer the more workers there are; submit batches, the most
   expensive first, never more than a few at a time for each worker.
3. A worker whose versions are not the driver's, or who does not see the cube, says so instead of
   computing. It is retired, and its batch goes to another.
4. Tiles that were with a worker that died are suspects: they are rerun alone at the end. A tile
   that fails alone, or raises an error, has failed: it stays missing, the store keeps the reason,
   and the sweep goes on with the others.
5. At the end list the missing tiles once more: what was written to a disk that was away is gone.
6. On Ctrl-C submit no more, wait for the tiles in flight, and say what is left. If the store fails,
   end at once: a full disk would fail all tiles in turn.

Results do not depend on the number of workers, on batches, or on interruptions.
"""

import pickle
import signal
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain
from math import ceil, prod
from traceback import format_exception_only

import cloudpickle
import numpy as np
from distributed import KilledWorker, get_worker

from pipeline import store
from pipeline.sweep.cluster import ClusterError
from pipeline.sweep.grid import tile_coords
from pipeline.sweep.progress import plural
from pipeline.sweep.submit import ended

_BATCH = 0.5  # seconds of predicted CPU time in a batch: long against 2 ms of scheduling,
_SCHEDULING = 0.005  # and for each worker: the driver then schedules for less than half its time
_PREDICTED = 10_000  # costs, at most, a millisecond each: workers wait meanwhile
COMMIT = 0.003  # CPU seconds to commit a tile, however cheap
_SIGHT = 2  # seconds that a file system of several machines may take to show a file
_ATTEMPTS_ALONE = 2  # worker deaths that condemn a tile: one may be somebody else's doing


@dataclass(frozen=True)
class _Report:
    """What a worker did with a batch."""

    failed: dict[tuple[int, ...], str]  # {tile index: reason}
    used: float  # CPU seconds
    wall: float  # seconds


@dataclass(frozen=True)
class Outcome:
    """What a sweep did."""

    committed: int  # tiles
    failed: dict[tuple[int, ...], str]  # {tile index: reason}
    interrupted: bool  # by Ctrl-C
    remaining: int  # tiles that are still missing


def sweep(client, place, job, progress, wanted=None):
    """Compute the missing tiles of the job's cube into the store; returns an Outcome.

    client : () → distributed.Client; called only if tiles are missing. See `cluster.connect`.
    place : Place, held by `store.driving`.
    wanted : set of tile indices, default all.

    store.Refused if the store holds another cube of that name, or one that other code has begun.
    StoreFailed if the store fails, ClusterError if no worker is fit, ConnectionError if the
    scheduler or all workers are gone; what is committed stays.
    """
    name = job.cube.name
    store.create(place, job.cube, store.COMPUTED_BY)
    tiles, n_tiles = store.missing(place, job.cube), prod(job.cube.tile_counts)
    done = n_tiles - len(tiles)
    if wanted is not None:
        tiles = tiles[[tuple(index) in wanted for index in tiles.tolist()]]
        place.write(store.wanted_key(name), str(done + len(tiles)).encode())
    if not len(tiles):
        return Outcome(0, {}, False, 0)
    client = client()
    run, n_workers = _Run(client, place, job, tiles), sum(client.nthreads().values())
    with _draining_on_interrupt() as interrupt:
        progress.begin((run.costs + COMMIT).sum(), n_workers)
        empty = [np.array([], int)] * n_workers
        batches = chain(empty, _pack(run.costs, n_workers))
        for tile in run.compute(batches, interrupt, progress):
            alone = [np.array([tile])]
            if all(run.compute(alone, interrupt, progress) for _ in range(_ATTEMPTS_ALONE)):
                index, words = tuple(tiles[tile].tolist()), "its worker died each time, also alone"
                run.failed[index] = store.record_failure(place, name, index, words)
    if not interrupt.is_set():  # a disk was away, or somebody deletes
        gone = done + run.committed + len(store.missing(place, job.cube)) - n_tiles
        if gone > 0:
            raise store.StoreFailed(f"{place.cube(name)} has lost {plural(gone, 'written tile')}")
    return Outcome(run.committed, run.failed, interrupt.is_set(), len(tiles) - run.committed)


class _Run:
    """The tiles of a sweep, their costs, and what has been counted of those that have ended.

    A tile is a place in `tiles`, the array of their indices, and a batch is an array of places.
    With a million tiles little else may be kept of each.
    """

    def __init__(self, client, place, job, tiles):
        self.client, self.place, self.job, self.tiles = client, place, job, tiles
        self.committed, self.failed, self.unfit = 0, {}, set()
        alike = ceil(len(tiles) / _PREDICTED)  # neighbours, which cost about the same
        parts = tile_coords(job.cube, tiles[::alike])
        costs = [job.predict(coords, job.cube.settings) for _, coords in parts]
        self.costs = np.repeat(np.array(costs, float), alike)[: len(tiles)]

    def compute(self, batches, interrupt, progress):
        """Run the batches; return the tiles whose worker died."""
        batches, suspects, cube = iter(batches), [], self.job.cube
        of_cube = self.place, cube.name, cube.config_hash, cube.settings
        functions = cloudpickle.dumps(self.job.warm_up), self.job.compute
        work = partial(_compute_batch, *of_cube, store.COMPUTED_BY, *functions)
        work = cloudpickle.dumps(work)

        def run(work, parcel):  # a nested function is sent whole: the package may be missing there
            try:
                work = pickle.loads(work)
            except Exception as error:
                return get_worker().address, f"cannot run this package ({error})"
            return work(parcel)

        def next_call():
            batch = None if interrupt.is_set() else next(batches, None)
            if batch is None:
                return None
            # As bytes: dask would send each array alone.
            tiles = list(tile_coords(cube, self.tiles[batch]))
            return batch, run, work, pickle.dumps(tiles, protocol=5)

        for batch, result in filter(None, ended(self.client, next_call)):
            if isinstance(result, KilledWorker):
                suspects += batch.tolist()
            elif isinstance(result, store.Refused):  # the driver had accepted the cube
                self.fail(result)
            elif isinstance(result, Exception):
                raise result
            elif isinstance(result, tuple):
                self.retire(*result)
                batches = chain([batch], batches)
            elif len(batch):
                self.committed += len(batch) - len(result.failed)
                self.failed |= result.failed
                progress.advance((self.costs[batch] + COMMIT).sum(), result.used, result.wall)
            else:
                progress.warmed_up()
        return suspects

    def fail(self, reason=None):
        raise store.StoreFailed(f"{self.place} was moved, or deleted, under way") from reason

    def retire(self, address, complaint):
        """Send an unfit worker away; ClusterError if there is no other."""
        cube, words = self.job.cube, f"the worker {address} {complaint}"
        if not store.sees(self.place, cube.name, cube.config_hash):
            self.fail()
        if address not in self.unfit:
            self.unfit.add(address)
            print(f"retired: {words}", file=sys.stderr)
        if self.client.nthreads().keys() <= self.unfit:
            raise ClusterError(
                f"no worker is fit to compute: {words}. Give all machines the same versions, and "
                "an --out that they share, or an object store and its environment"
            )
        self.client.retire_workers([address])


def _compute_batch(place, name, config_hash, settings, computed_by, warm_up, compute, parcel):
    """Compute and commit tiles on a worker; return a _Report, or (address, complaint).

    parcel : pickled [(index, coords)].
    """
    if complaint := _complaint(place, name, config_hash, computed_by):
        return get_worker().address, complaint
    _called_once(warm_up)
    errors, began, used = {}, time.monotonic(), time.thread_time()
    for index, coords in pickle.loads(parcel):
        try:
            # Dask may run a task twice, e.g. when it loses touch with a worker.
            if not store.is_committed(place, name, index):
                start = time.thread_time()
                arrays = compute(coords, settings)
                store.commit(place, name, index, arrays, time.thread_time() - start)
        except (store.StoreFailed, store.Refused, KeyboardInterrupt, SystemExit):
            raise  # no fault of the tile
        except BaseException as exception:  # dask hangs on those that are no Exception
            words = "".join(format_exception_only(exception))
            errors[index] = store.record_failure(place, name, index, words)
    return _Report(errors, time.thread_time() - used, time.monotonic() - began)


# Kernels are compiled once in each process; no tile is to be charged for it.
_called_once = cache(lambda warm_up: pickle.loads(warm_up)())


def _complaint(place, name, config_hash, computed_by):
    """Return why this worker must not compute the cube; "" if it may."""
    ours, theirs = store.COMPUTED_BY.split(", "), computed_by.split(", ")
    if ours != theirs:
        other = [[x for x in a if x not in b] for a, b in ((ours, theirs), (theirs, ours))]
        return f"has {' instead of '.join(map(', '.join, other))}"
    end = time.monotonic() + _SIGHT
    while not store.sees(place, name, config_hash):
        if time.monotonic() > end:
            return f"does not see {place} as the driver does"
        time.sleep(0.1)
    return ""


def _pack(costs, n_workers):
    """Yield batches of tiles, the most expensive first; cheap ones together.

    Tiles that are predicted to cost the same come in random order: the first are like the others.
    """
    shuffled = np.random.default_rng(0).permutation(costs.size)
    order = shuffled[np.argsort(-costs[shuffled], kind="stable")]
    ends = np.cumsum(costs[order] + COMMIT)
    first = gone = 0
    while first < len(order):
        fair = (ends[-1] - gone) / max(1, n_workers)
        seconds = max(_BATCH, min(_SCHEDULING * n_workers, fair))
        last = max(first + 1, np.searchsorted(ends, gone + seconds, side="right"))
        yield order[first:last]
        first, gone = last, ends[last - 1]


@contextmanager
def _draining_on_interrupt():
    """Yield an Event that the first Ctrl-C sets; the second interrupts at once.

    Outside the main thread, or under a handler that is not of Python, nothing sets it.
    """
    interrupt, previous = threading.Event(), signal.getsignal(signal.SIGINT)
    if previous is None or threading.current_thread() is not threading.main_thread():
        yield interrupt
        return

    def drain(signum, frame):
        if interrupt.is_set():
            raise KeyboardInterrupt
        interrupt.set()
        words = "waiting for the tiles in flight (Ctrl-C again to abandon them)"
        print(f"\nstopping: {words}", file=sys.stderr)

    # A program that was started with Ctrl-C ignored, in the background of a script, ignores it.
    signal.signal(signal.SIGINT, signal.SIG_IGN if previous is signal.SIG_IGN else drain)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, previous)
