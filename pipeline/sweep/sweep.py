"""The sweep: compute what a cube misses, tile by tile, on a dask cluster.

1. List the missing tiles. If there are any, connect to the workers and predict the cost of each.
2. Pack cheap tiles into batches; submit batches, the most expensive first, never more than a few
   at a time for each worker.
3. A worker whose versions are not the driver's, or who does not see the cube, says so instead of
   computing. It is retired, and its batch goes to another.
4. Tiles that were with a worker that died are suspects: they are rerun alone at the end. A tile
   that fails alone, or raises an error, has failed: it stays missing, the store keeps the reason,
   and the sweep goes on with the others.
5. On Ctrl-C submit no more, wait for the tiles in flight, and say what is left. If the store fails,
   end at once: a full disk would fail all tiles in turn.

Results do not depend on the number of workers, on batches, or on interruptions.
"""

import pickle
import signal
import sys
import threading
import time
from concurrent.futures import CancelledError
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain
from math import inf, prod
from queue import Empty, SimpleQueue
from traceback import format_exception_only

import cloudpickle
import numpy as np
from distributed import KilledWorker, get_worker
from distributed.comm import CommClosedError

from pipeline import store
from pipeline.sweep.cluster import NO_SCHEDULER, ClusterError
from pipeline.sweep.grid import tile_slices
from pipeline.sweep.progress import Progress, duration

BATCH_SECONDS = 0.5  # of predicted CPU time in a batch: long against 2 ms of scheduling
BATCH_TILES = 256
_PROBES = 1000  # about, at most: each costs the driver some milliseconds, whatever is in it
_IN_FLIGHT = 2  # batches per worker: one computing, one waiting
_ROLL_CALL = 1  # seconds after which the workers are counted again: they join and leave
_UNKNOWN_COST = 1.0  # CPU seconds, where the probe failed
_PATIENCE = 30  # seconds without any worker, after which the sweep gives up
_SIGHT = 2  # seconds that a file system of several machines may take to show a file
_LONG = 5  # seconds of work that are announced
_REPORT = 5  # seconds to fetch the report of a batch that has ended
_ATTEMPTS_ALONE = 2  # worker deaths that condemn a tile: one may be somebody else's doing


@dataclass(frozen=True)
class Outcome:
    """What a sweep did.

    committed : tiles computed and committed.
    failed : {tile index: reason}.
    interrupted : whether Ctrl-C stopped it.
    remaining : tiles that are still missing.
    """

    committed: int
    failed: dict[tuple[int, ...], str]
    interrupted: bool
    remaining: int


def sweep(client, place, job, wanted=None, progress=None, label=None):
    """Compute the missing tiles of the job's cube into the store.

    Parameters
    ----------
    client : () → distributed.Client; called only if tiles are missing. See `cluster.connect`.
    place : Place of the store, held by `store.driving`.
    job : Job; its cube is created in the store if it is not there.
    wanted : iterable of tile indices, default all.
    progress : the Progress of a series of sweeps, instead of a line for this one.
    label : text that names this sweep on its lines, default the name of the cube.

    Returns
    -------
    Outcome.

    Raises
    ------
    store.Refused if the store holds another cube of that name, or one that other code has begun;
    no tile is then computed. store.StoreFailed if the disk or the object store fails. ClusterError
    if no worker is fit. ConnectionError if the scheduler or all workers are gone. What is committed
    stays.
    """
    cube, computed_by = job.cube, store.computed_by()
    label = label or cube.name
    store.create(place, cube, computed_by)
    tiles = store.missing(place, cube)
    if wanted is not None:
        wanted = set(wanted)
        tiles = tiles[[tuple(index) in wanted for index in tiles.tolist()]]
    if not len(tiles):
        if progress is None:
            print(f"{label}: nothing to compute", file=sys.stderr)
        return Outcome(0, {}, False, 0)
    client = client()
    costs = _predict_all(client, job, tiles)
    if progress is None:
        _announce(label, cube, costs, sum(client.nthreads().values()))
    line = Progress(label, sys.stderr) if progress is None else nullcontext(progress)
    with _draining_on_interrupt() as interrupt, line as progress:
        progress.begin(len(tiles), costs.sum())
        run = _Run(client, place, job, computed_by, tiles, costs, interrupt, progress)
        for tile in run.all(_pack(costs)):
            alone = [np.array([tile])]
            if all(run.all(alone, most=1) for _ in range(_ATTEMPTS_ALONE)):
                index = tuple(tiles[tile].tolist())
                words = "its worker died each time, also when it ran alone"
                run.failed[index] = store.record_failure(place, cube.name, index, words)
    return Outcome(run.committed, run.failed, interrupt.is_set(), len(tiles) - run.committed)


def _announce(label, cube, costs, n_threads):
    """Say how long a sweep will take, and how much it will write, unless that is little."""
    seconds = costs.sum() / max(1, n_threads)
    if seconds > _LONG:
        share = costs.size / prod(store.tile_counts(cube))
        print(
            f"{label}: {costs.size} tiles, about {duration(seconds)} on {n_threads} workers, "
            f"{share * cube.template.nbytes / 1e6:.3g} MB",
            file=sys.stderr,
        )


# Below, a tile is a place in `tiles`, the array of the indices of all tiles of the sweep, and a
# batch is an array of places. With a million tiles little else may be kept of each.


class _Run:
    """The submission of batches, and what has been counted of those that have ended."""

    def __init__(self, client, place, job, computed_by, tiles, costs, interrupt, progress):
        self.client, self.place, self.cube = client, place, job.cube
        self.costs, self.interrupt, self.progress = costs, interrupt, progress
        warm_up = cloudpickle.dumps(job.warm_up)
        of_cube = self.cube.name, self.cube.config_hash, self.cube.settings
        work = partial(_compute_batch, place, *of_cube, computed_by, warm_up, job.compute)
        self.submit = _submitter(client, work, self.cube, tiles)
        self.committed, self.failed, self.unfit = 0, {}, set()

    def all(self, batches, most=inf):
        """Run the batches, at most `most` at a time; return the tiles whose worker died."""
        batches, suspects = iter(batches), []

        def next_batch():
            return None if self.interrupt.is_set() else next(batches, None)

        for batch, result in _ended(self.client, self.submit, next_batch, most):
            if isinstance(result, KilledWorker):
                suspects += batch.tolist()
            elif isinstance(result, Exception):
                raise result
            elif isinstance(result, tuple):
                self._retire(*result)
                batches = chain([batch], batches)
            else:
                self.committed += len(batch) - len(result)
                self.failed |= result
                self.progress.advance(len(batch), self.costs[batch].sum())
        return suspects

    def _retire(self, address, complaint):
        """Send an unfit worker away; ClusterError if there is no other."""
        if not store.sees(self.place, self.cube.name, self.cube.config_hash):
            raise store.StoreFailed(f"{self.place} was moved, or deleted, under way")
        words = f"the worker {address} {complaint}"
        if address not in self.unfit:
            self.unfit.add(address)
            print(f"retired: {words}", file=sys.stderr)
        if self.client.nthreads().keys() <= self.unfit:
            raise ClusterError(
                f"no worker is fit to compute: {words}. Give all machines the same versions, and "
                "an --out that they share, or an object store and its environment"
            )
        self.client.retire_workers([address])


def _ended(client, submit, next_batch, most=inf):
    """Submit batches until next_batch() is None, a few per worker and at most `most` at a time.

    Yields (batch, result or exception) of each when it has ended.
    """
    in_flight, done = {}, SimpleQueue()
    workers, counted, alive = 0, -inf, time.monotonic()
    while True:
        now = time.monotonic()
        if now - counted >= _ROLL_CALL:
            try:
                workers, counted = len(client.nthreads()), now
            except OSError:
                raise ConnectionError(NO_SCHEDULER) from None
            if workers:
                alive = now
            elif now - alive > _PATIENCE:
                raise ConnectionError("no workers are left; run again to resume")
        window = min(most, _IN_FLIGHT * max(1, workers))
        while len(in_flight) < window and (batch := next_batch()) is not None:
            future = submit(batch)
            in_flight[future] = batch
            future.add_done_callback(done.put)
        if not in_flight:
            return
        try:
            future = done.get(timeout=_ROLL_CALL)
        except Empty:
            continue
        try:
            result = future.result(timeout=_REPORT)
        except TimeoutError:
            # Its worker died between the end of the batch and its report: dask runs it again, which
            # may end in any of these ways.
            future.add_done_callback(done.put)
            continue
        except (CancelledError, CommClosedError):
            raise ConnectionError(NO_SCHEDULER) from None
        except Exception as exception:
            result = exception
        future.release()
        yield in_flight.pop(future), result


def _submitter(client, work, cube, tiles):
    """Return a function that submits a batch: a worker does `work` with its parcel of tiles."""
    work = cloudpickle.dumps(work)

    def run(work, parcel):  # a nested function is sent whole: the package may be missing there
        try:
            work = pickle.loads(work)
        except Exception as error:
            return get_worker().address, f"cannot run this package ({error})"
        return work(parcel)

    return lambda batch: client.submit(run, work, _parcel(cube, tiles[batch]), pure=False)


def _parcel(cube, indices):
    """Return the tiles [(index, coords)] of a batch as bytes; dask would send each array alone."""
    sizes = cube.sizes
    axes = {dim: cube.template[dim].values for dim in sizes if dim in cube.template.coords}
    tiles = []
    for index in map(tuple, indices.tolist()):
        slices = tile_slices(index, sizes, cube.tile)
        coords = {dim: axis[slices[dim]] if dim in slices else axis for dim, axis in axes.items()}
        tiles.append((index, coords))
    return pickle.dumps(tiles, protocol=5)


def _compute_batch(place, name, config_hash, settings, computed_by, warm_up, compute, parcel):
    """On a worker: compute and commit each tile.

    Returns {index: what went wrong}, or (address, complaint) of a worker that is not fit. A store
    that fails is no fault of the tile, and raises.
    """
    if complaint := _complaint(place, name, config_hash, computed_by):
        return get_worker().address, complaint
    _warmed_up(warm_up)
    errors = {}
    for index, coords in pickle.loads(parcel):
        try:
            # Dask may run a task twice, e.g. when it loses touch with a worker.
            if not store.is_committed(place, name, index):
                start = time.thread_time()
                arrays = compute(coords, settings)
                store.commit(place, name, index, arrays, time.thread_time() - start)
        except (store.StoreFailed, store.Refused, KeyboardInterrupt, SystemExit):
            raise
        except BaseException as exception:  # dask hangs on those that are no Exception
            words = "".join(format_exception_only(exception))
            errors[index] = store.record_failure(place, name, index, words)
    return errors


def _complaint(place, name, config_hash, computed_by):
    """Return why this worker must not compute the cube; "" if it may."""
    ours, theirs = store.computed_by().split(", "), computed_by.split(", ")
    if ours != theirs:
        other = [[x for x in a if x not in b] for a, b in ((ours, theirs), (theirs, ours))]
        return f"has {' instead of '.join(map(', '.join, other))}"
    end = time.monotonic() + _SIGHT
    while not store.sees(place, name, config_hash):
        if time.monotonic() > end:
            return f"does not see {place} as the driver does"
        time.sleep(0.1)
    return ""


@cache
def _warmed_up(warm_up):
    """Compile a job's kernels, once in each process; no tile is to be charged for it."""
    pickle.loads(warm_up)()


def _predict_all(client, job, tiles):
    """Return predicted CPU seconds of each tile, probed on the workers."""
    costs = np.full(len(tiles), _UNKNOWN_COST)
    many = max(BATCH_TILES, len(tiles) // _PROBES)
    batches = iter(np.split(np.arange(len(tiles)), range(many, len(tiles), many)))
    submit = _submitter(
        client, partial(_predict_batch, job.predict, job.cube.settings), job.cube, tiles
    )
    progress = Progress(f"{job.cube.name}: costs", sys.stderr)
    progress.begin(len(tiles), len(tiles))  # the line is shown only if this takes long
    for batch, seconds in _ended(client, submit, partial(next, batches, None)):
        if isinstance(seconds, list):
            costs[batch] = seconds
        progress.advance(len(batch), len(batch))
    return costs


def _predict_batch(predict, settings, parcel):
    costs = [float(predict(coords, settings)) for _, coords in pickle.loads(parcel)]
    return [cost if 0 <= cost < inf else _UNKNOWN_COST for cost in costs]


def _pack(costs):
    """Yield batches of tiles, the most expensive first; cheap ones up to half a second together."""
    order = np.argsort(-costs, kind="stable")
    start = 0
    while start < len(order):
        batch = order[start : start + BATCH_TILES]
        fit = np.searchsorted(np.cumsum(costs[batch]), BATCH_SECONDS, side="right")
        batch = batch[: max(1, fit)]
        yield batch
        start += len(batch)


@contextmanager
def _draining_on_interrupt():
    """Yield an Event that the first Ctrl-C sets; the second interrupts at once.

    A program that was started with Ctrl-C ignored, in the background of a script, ignores it.
    """
    interrupt, previous = threading.Event(), signal.getsignal(signal.SIGINT)

    def drain(signum, frame):
        if interrupt.is_set():
            raise KeyboardInterrupt
        interrupt.set()
        words = "waiting for the tiles in flight (Ctrl-C again to abandon them)"
        print(f"\nstopping: {words}", file=sys.stderr)

    signal.signal(signal.SIGINT, signal.SIG_IGN if previous is signal.SIG_IGN else drain)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, previous)
