"""The sweep: compute what a cube misses, tile by tile, on a dask cluster.

1. List the missing tiles and predict the cost of each.
2. Pack cheap tiles into batches; submit batches, the most expensive first, never more than a few
   at a time for each worker that there is.
3. Tiles that were with a worker that died are suspects: rerun alone at the end. A tile that fails
   alone, or raises an error, has failed: it stays missing, the store keeps the reason, and the
   sweep goes on with the others.
4. On Ctrl-C submit no more, wait for the tiles in flight, and say what is left. Likewise if the
   store fails: a full disk would fail all tiles in turn.

The sweep knows nothing of what it computes: `compute(coords, settings)` returns the arrays of one
tile, `predict(coords, settings)` its cost in CPU seconds. Both must be importable by the workers.
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
from itertools import takewhile
from math import inf
from queue import Empty, SimpleQueue

import numpy as np
from distributed import KilledWorker
from distributed.comm import CommClosedError

from pipeline import store
from pipeline.faults import NO_SCHEDULER, StorageError, reason_of
from pipeline.grid import tile_counts, tile_slices
from pipeline.progress import Progress

BATCH_SECONDS = 0.5  # of predicted CPU time in a batch: long against 2 ms of scheduling
BATCH_TILES = 256
_PROBES = 1000  # about, at most: each costs the driver some milliseconds, whatever is in it
_IN_FLIGHT = 2  # batches per worker: one computing, one waiting
_ROLL_CALL = 1  # seconds after which the workers are counted again: they join and leave
_UNKNOWN_COST = 1.0  # CPU seconds, where the probe failed
_PATIENCE = 30  # seconds without any worker, after which the sweep gives up
_REPORT = 5  # seconds to fetch the report of a batch that has ended
_ATTEMPTS_ALONE = 2  # worker deaths that condemn a tile: one may be somebody else's doing


@dataclass(frozen=True)
class Outcome:
    """What a sweep did. failed : {tile index: reason}. interrupted : stopped by Ctrl-C."""

    committed: int
    failed: dict[tuple[int, ...], str]
    interrupted: bool
    remaining: int


def sweep(client, out, cube, compute, predict, wanted=None, report=sys.stderr, progress=None):
    """Compute the missing tiles of `cube` into the store in `out`.

    Parameters
    ----------
    client : distributed.Client, see `pipeline.cluster`.
    out : the place of a store, held by `store.driving`.
    cube : schema.Cube; created in the store if it is not there.
    compute, predict : functions (coords, settings), see above; coords are {dim: ndarray}.
    wanted : iterable of tile indices, default all.
    report : text stream for progress.
    progress : the Progress of a series of sweeps, instead of a line for this one in `report`.

    Returns
    -------
    Outcome. StoreError if the store holds another cube of that name, or one that other code has
    begun; no tile is then computed.
    StorageError if the disk or the object store fails; what is committed stays, here and below.
    ConnectionError if the scheduler or all workers are gone.
    """
    layout = store.create(out, cube)
    tiles = store.missing(layout)
    if wanted is not None:
        tiles = tiles[_among(tiles, wanted, cube)]
    if not len(tiles):
        return Outcome(0, {}, False, 0)
    store.refuse_other_mathematics(out, cube)
    costs = _predict_all(client, cube, tiles, predict, Progress(f"{cube.name}: costs", report))
    line = Progress(cube.name, report) if progress is None else nullcontext(progress)
    with _draining_on_interrupt() as interrupt, line as progress:
        progress.begin(len(tiles), costs.sum())
        run = _Run(client, layout, compute, cube, tiles, costs, interrupt, progress)
        suspects = run.all(_pack(costs))
        for tile in suspects:
            for _ in range(_ATTEMPTS_ALONE):
                if not run.all([np.array([tile])], most=1):
                    break
            else:
                run.condemn(tile, "its worker died each time, also when it ran alone")
    if run.fault:
        raise run.fault
    failed = {tuple(tiles[tile].tolist()): reason for tile, reason in run.failed.items()}
    return Outcome(run.committed, failed, interrupt.is_set(), len(tiles) - run.committed)


def _among(tiles, wanted, cube):
    """For each of the tiles whether its index is wanted."""
    chosen = np.zeros(tuple(tile_counts(cube.sizes, cube.tile).values()), dtype=bool)
    for index in wanted:
        chosen[index] = True
    return chosen[tuple(tiles.T)]


# Below, a tile is a place in `tiles`, the array of the indices of all tiles of the sweep, and a
# batch is an array of places. With a million tiles little else may be kept of each.


class _Run:
    """The submission of batches, and what has been counted of those that have ended."""

    def __init__(self, client, layout, compute, cube, tiles, costs, interrupt, progress):
        self.client, self.layout, self.compute, self.cube = client, layout, compute, cube
        self.tiles, self.costs, self.interrupt, self.progress = tiles, costs, interrupt, progress
        self.committed, self.failed, self.fault = 0, {}, None

    def all(self, batches, most=inf):
        """Run the batches, at most `most` at a time; returns tiles whose worker died."""
        suspects = []
        going_on = takewhile(lambda _: not (self.fault or self.interrupt.is_set()), batches)
        for batch, errors, exception in _ended(self.client, self._submit, going_on, most):
            if exception is None:
                self._count(batch, errors)
            elif isinstance(exception, KilledWorker):
                suspects += batch.tolist()
            elif isinstance(exception, StorageError):
                self.fault = exception
            else:
                raise exception
        return suspects

    def condemn(self, tile, reason):
        """Count a tile as failed that left no word of its own in the store."""
        self.failed[tile] = reason
        try:
            store.record_failure(self.layout, tuple(self.tiles[tile].tolist()), reason)
        except StorageError as fault:
            self.fault = fault

    def _submit(self, batch):
        return self.client.submit(
            _compute_batch,
            self.layout,
            self.compute,
            self.cube.settings,
            _parcel(self.cube, self.tiles[batch]),
            pure=False,
        )

    def _count(self, batch, errors):
        self.committed += len(batch) - len(errors)
        self.failed |= {int(batch[place]): error for place, error in errors.items()}
        self.progress.advance(len(batch), self.costs[batch].sum())


def _ended(client, submit, batches, most=inf):
    """Submit the batches in turn, a few per worker and at most `most` at a time.

    Yields (batch, result, None) or (batch, None, exception) of each when it has ended.
    """
    batches, in_flight, done = iter(batches), {}, SimpleQueue()
    crew = _Crew(client)
    while True:
        window = min(most, _IN_FLIGHT * max(1, crew.size()))
        while len(in_flight) < window and (batch := next(batches, None)) is not None:
            future = submit(batch)
            in_flight[future] = batch
            future.add_done_callback(done.put)
        if not in_flight:
            return
        try:
            future = done.get(timeout=_ROLL_CALL)
        except Empty:
            continue
        result = failure = None
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
            failure = exception
        future.release()
        yield in_flight.pop(future), result, failure


class _Crew:
    """The workers that there are, counted once in a while: they join and leave."""

    def __init__(self, client):
        self.client, self.workers = client, 0
        self.counted, self.alive = -inf, time.monotonic()

    def size(self):
        """How many they are; ConnectionError if there have been none for long."""
        now = time.monotonic()
        if now - self.counted >= _ROLL_CALL:
            try:
                self.workers = len(self.client.nthreads())
            except OSError:
                raise ConnectionError(NO_SCHEDULER) from None
            self.counted = now
            if self.workers:
                self.alive = now
            elif now - self.alive > _PATIENCE:
                raise ConnectionError("no workers are left; run again to resume")
        return self.workers


def _parcel(cube, indices):
    """The tiles [(index, coords)] of a batch, as bytes: dask would send each array by itself."""
    sizes = cube.sizes
    axes = {str(dim): coordinate.values for dim, coordinate in cube.template.coords.items()}
    tiles = []
    for index in map(tuple, indices.tolist()):
        slices = tile_slices(index, sizes, cube.tile)
        coords = {dim: axis[slices[dim]] if dim in slices else axis for dim, axis in axes.items()}
        tiles.append((index, coords))
    return pickle.dumps(tiles, protocol=5)


def _compute_batch(layout, compute, settings, parcel):
    """On a worker: compute and commit each tile; returns {place in the batch: what went wrong}.

    A store that fails is no fault of the tile, and raises.
    """
    errors = {}
    for place, (index, coords) in enumerate(pickle.loads(parcel)):
        try:
            # Dask may run a task twice, e.g. when it loses touch with a worker.
            if not store.is_committed(layout, index):
                start = time.thread_time()
                arrays = compute(coords, settings)
                store.commit(layout, index, arrays, time.thread_time() - start)
        except (StorageError, KeyboardInterrupt, SystemExit):
            raise
        except BaseException as exception:  # dask would neither go on nor end
            errors[place] = reason_of(exception)
            store.record_failure(layout, index, errors[place])
    return errors


def _predict_all(client, cube, tiles, predict, progress):
    """Predicted CPU seconds of each tile, probed on the workers."""
    costs = np.full(len(tiles), _UNKNOWN_COST)
    progress.begin(len(tiles), len(tiles))  # its line is shown only if this takes long
    many = max(BATCH_TILES, len(tiles) // _PROBES)
    batches = np.split(np.arange(len(tiles)), range(many, len(tiles), many))

    def submit(batch):
        parcel = _parcel(cube, tiles[batch])
        return client.submit(_predict_batch, predict, cube.settings, parcel, pure=False)

    for batch, seconds, failure in _ended(client, submit, batches):
        if failure is None:
            costs[batch] = seconds
        progress.advance(len(batch), len(batch))
    return costs


def _predict_batch(predict, settings, parcel):
    costs = [float(predict(coords, settings)) for _, coords in pickle.loads(parcel)]
    return [cost if 0 <= cost < inf else _UNKNOWN_COST for cost in costs]


def _pack(costs):
    """Batches of tiles, the most expensive first; each batch of cheap ones up to half a second."""
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
    """An Event that the first Ctrl-C sets; the second interrupts at once.

    A program that was started with Ctrl-C ignored, as in the background of a script, ignores it.
    """
    interrupt = threading.Event()
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    if ignored or threading.current_thread() is not threading.main_thread():
        yield interrupt
        return

    def drain(signum, frame):
        if interrupt.is_set():
            raise KeyboardInterrupt
        interrupt.set()
        print(
            "\nstopping: waiting for the tiles in flight (Ctrl-C again to abandon them)",
            file=sys.stderr,
        )

    previous = signal.signal(signal.SIGINT, drain)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, previous)
