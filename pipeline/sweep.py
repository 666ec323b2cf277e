"""The sweep: compute what a cube misses, tile by tile, on a dask cluster.

1. List the missing tiles and predict the cost of each.
2. Pack cheap tiles into batches; submit batches, the most expensive first, never more than a few
   per worker at a time.
3. Tiles that were with a worker that died are suspects: rerun alone at the end. A tile that fails
   alone, or raises an error, has failed: it stays missing, and the sweep goes on with the others.
4. On Ctrl-C submit no more, wait for the tiles in flight, and say what is left. Likewise if the
   store fails: a full disk would fail all tiles in turn.

The sweep knows nothing of what it computes: `compute(coords, settings)` returns the arrays of one
tile, `predict(coords, settings)` its cost in CPU seconds. Both must be importable by the workers.
Results do not depend on the number of workers, on batches, or on interruptions.
"""

import signal
import sys
import threading
import time
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from distributed import KilledWorker, wait
from distributed.comm import CommClosedError

from pipeline import store
from pipeline.faults import StorageError
from pipeline.grid import tile_slices

BATCH_SECONDS = 0.5  # of predicted CPU time in a batch: long against 2 ms of scheduling
BATCH_TILES = 256
_IN_FLIGHT = 2  # batches per worker: one computing, one waiting
_PATIENCE = 30  # seconds without any worker, after which the sweep gives up
_REPORT = 5  # seconds to fetch the report of a batch that has ended
_NO_SCHEDULER = "the dask scheduler is gone; run again to resume"
_ATTEMPTS_ALONE = 2  # worker deaths that condemn a tile: one may be somebody else's doing


@dataclass(frozen=True)
class Outcome:
    """What a sweep did. failed : {tile index: reason}. interrupted : stopped by Ctrl-C."""

    committed: int
    failed: dict[tuple[int, ...], str]
    interrupted: bool
    remaining: int


def sweep(client, out, cube, compute, predict, wanted=None, report=sys.stderr):
    """Compute the missing tiles of `cube` into the store in `out`.

    Parameters
    ----------
    client : distributed.Client, see `pipeline.cluster`.
    out : the place of a store, held by `store.driving`.
    cube : schema.Cube; created in the store if it is not there.
    compute, predict : functions (coords, settings), see above; coords are {dim: ndarray}.
    wanted : iterable of tile indices, default all.
    report : text stream for progress.

    Returns
    -------
    Outcome. StoreError if the store holds another cube of that name; no tile is then computed.
    StorageError if the disk or the object store fails; what is committed stays, here and below.
    ConnectionError if the scheduler or all workers are gone.
    """
    layout = store.create(out, cube)
    missing = store.missing(layout, cube)
    if wanted is not None:
        wanted = set(wanted)
        missing = [index for index in missing if index in wanted]
    if not missing:
        return Outcome(0, {}, False, 0)
    tiles = {index: _tile_coords(cube, index) for index in missing}
    costs = _predict_all(client, tiles, predict, cube.settings)
    progress = _Progress(cube.name, costs, report)
    with _draining_on_interrupt() as interrupt:
        run = _Run(client, layout, compute, cube.settings, tiles, interrupt, progress)
        window = _IN_FLIGHT * max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
        suspects = run.all(_pack(costs), window)
        failed = run.failed
        for index in suspects:
            for _ in range(_ATTEMPTS_ALONE):
                if not run.all([[index]], 1):
                    break
            else:
                failed[index] = "its worker died each time, also when it ran alone"
    progress.end()
    if run.fault:
        raise run.fault
    return Outcome(run.committed, failed, interrupt.is_set(), len(missing) - run.committed)


class _Run:
    """The submission loop and what it has counted so far."""

    def __init__(self, client, layout, compute, settings, tiles, interrupt, progress):
        self.client, self.layout, self.compute, self.settings = client, layout, compute, settings
        self.tiles, self.interrupt, self.progress = tiles, interrupt, progress
        self.committed, self.failed, self.fault = 0, {}, None

    def all(self, batches, window):
        """Run the batches, at most `window` at a time; returns tiles whose worker died."""
        suspects = []
        batches = iter(batches)
        in_flight = {}
        while True:
            while len(in_flight) < window and not (self.fault or self.interrupt.is_set()):
                batch = next(batches, None)
                if batch is None:
                    break
                tiles = [(index, self.tiles[index]) for index in batch]
                future = self.client.submit(
                    _compute_batch, self.layout, self.compute, self.settings, tiles, pure=False
                )
                in_flight[future] = batch
            if not in_flight:
                return suspects
            for future in _first_completed(self.client, list(in_flight)):
                batch = in_flight.pop(future)
                try:
                    # A worker may die between the end of a batch and its report: dask then runs
                    # the batch again, which may end in any of these ways.
                    self._count(_report_of(future))
                except TimeoutError:
                    in_flight[future] = batch
                    continue
                except KilledWorker:
                    suspects += batch
                except StorageError as fault:
                    self.fault = fault
                future.release()

    def _count(self, results):
        for index, error in results:
            if error is None:
                self.committed += 1
            else:
                self.failed[index] = error
        self.progress.advance([index for index, _ in results])


def _first_completed(client, futures):
    """Wait until some of the futures are done, and return those."""
    alive = time.monotonic()
    while True:
        try:
            with client.as_current():
                return wait(futures, timeout=1, return_when="FIRST_COMPLETED").done
        except CancelledError:
            raise ConnectionError(_NO_SCHEDULER) from None
        except TimeoutError:
            if client.scheduler_info(n_workers=-1)["workers"]:
                alive = time.monotonic()
            elif time.monotonic() - alive > _PATIENCE:
                raise ConnectionError("no workers are left; run again to resume") from None


def _report_of(future):
    """What a task that is done returned, or raises what it raised."""
    try:
        return future.result(timeout=_REPORT)
    except (CancelledError, CommClosedError):
        raise ConnectionError(_NO_SCHEDULER) from None


def _compute_batch(layout, compute, settings, tiles):
    """On a worker: compute and commit each tile; returns [(index, None or what went wrong)].

    A store that fails is no fault of the tile, and raises.
    """
    results = []
    for index, coords in tiles:
        error = None
        try:
            # Dask may run a task twice, e.g. when it loses touch with a worker.
            if not store.is_committed(layout, index):
                start = time.thread_time()
                arrays = compute(coords, settings)
                store.commit(layout, index, arrays, time.thread_time() - start)
        except StorageError:
            raise
        except Exception as exception:
            error = f"{type(exception).__name__}: {exception}"
        results.append((index, error))
    return results


def _tile_coords(cube, index):
    slices = tile_slices(index, cube.sizes, cube.tile)
    return {
        str(dim): coordinate.values[slices.get(dim, slice(None))]
        for dim, coordinate in cube.template.coords.items()
    }


def _predict_all(client, tiles, predict, settings):
    """{index: predicted CPU seconds}, probed on the workers; 1 s for tiles whose probe failed."""
    costs = dict.fromkeys(tiles, 1.0)
    indices = list(tiles)
    parts = [indices[i : i + BATCH_TILES] for i in range(0, len(indices), BATCH_TILES)]
    pending = {
        client.submit(_predict_batch, predict, settings, [tiles[i] for i in part], pure=False): part
        for part in parts
    }
    while pending:
        for future in _first_completed(client, list(pending)):
            part = pending.pop(future)
            if future.status == "finished":
                # A worker's death between the probe and its report costs the prediction only.
                with suppress(KilledWorker, TimeoutError):
                    costs.update(zip(part, _report_of(future), strict=True))
            future.release()
    return costs


def _predict_batch(predict, settings, tiles):
    return [predict(coords, settings) for coords in tiles]


def _pack(costs):
    """Batches of tiles, the most expensive first; each batch of cheap ones up to half a second."""
    batch, seconds = [], 0.0
    for index in sorted(costs, key=costs.get, reverse=True):
        if batch and (seconds + costs[index] > BATCH_SECONDS or len(batch) == BATCH_TILES):
            yield batch
            batch, seconds = [], 0.0
        batch.append(index)
        seconds += costs[index]
    if batch:
        yield batch


@contextmanager
def _draining_on_interrupt():
    """An Event that the first Ctrl-C sets; the second interrupts at once."""
    interrupt = threading.Event()
    if threading.current_thread() is not threading.main_thread():
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


class _Progress:
    """One line: tiles done, rate, time left by predicted cost. On a terminal it is rewritten; in
    a log a new one is written every ten seconds."""

    def __init__(self, name, costs, stream):
        self.name, self.costs, self.stream = name, costs, stream
        self.total = sum(costs.values())
        self.done, self.tiles = 0.0, 0
        self.start = self.shown = time.monotonic()
        self.interval = 0.2 if stream.isatty() else 10.0

    def advance(self, indices):
        self.tiles += len(indices)
        self.done += sum(self.costs[index] for index in indices)
        if time.monotonic() - self.shown > self.interval:
            self._show("\r" if self.stream.isatty() else "\n")

    def end(self):
        self._show("\n")

    def _show(self, end):
        self.shown = time.monotonic()
        elapsed = self.shown - self.start
        left = elapsed * max(0.0, self.total / self.done - 1) if self.done > 0 else float("nan")
        line = (
            f"{self.name}: {self.tiles}/{len(self.costs)} tiles, "
            f"{self.tiles / max(elapsed, 1e-9):.1f}/s, {elapsed:.0f} s gone, {left:.0f} s left"
        )
        print(line.ljust(78), end=end, file=self.stream, flush=True)
