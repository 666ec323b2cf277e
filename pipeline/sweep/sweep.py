"""The sweep: compute the missing tiles of a cube on a dask cluster.

1. List the missing tiles. If there are any, connect to the workers and predict the cost of each
   tile. The first batches are empty: they make the workers load or compile their kernels.
2. Pack cheap tiles into batches, which are longer if there are more workers. Submit the most
   expensive batches first, never more than a few at a time for each worker.
3. A worker whose versions differ from the driver's, or that cannot see the cube, reports this
   instead of computing. It is retired, and its batch is given to another worker.
4. Tiles whose worker died are suspects: they are rerun alone at the end. A tile whose worker dies
   twice more, or that raises an error, has failed: it stays missing, the store records the reason,
   and the sweep continues with the other tiles.
5. At the end, list the missing tiles once more, to find tiles that were lost, e.g. because a file
   system was unmounted.
6. On Ctrl-C, submit no more batches, wait for the tiles in flight, and report what remains. If the
   store fails, stop at once: on a full disk all tiles would fail in turn.

Results do not depend on the number of workers, on batches, or on interruptions.
"""

import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain
from math import ceil, prod
from traceback import format_exception_only
from typing import TYPE_CHECKING, Any, NoReturn

import cloudpickle
import numpy as np

from nasm.types import FloatArray, IntArray
from pipeline import store
from pipeline.cubes.cube import Arrays, Coords, Job, Settings
from pipeline.provenance import Code
from pipeline.store import Place
from pipeline.sweep.cluster import ClusterError
from pipeline.sweep.grid import tile_coords
from pipeline.sweep.progress import Progress, plural
from pipeline.sweep.submit import as_completed

if TYPE_CHECKING:
    from distributed import Client

COMMIT_SECONDS = 0.003
"""CPU seconds to commit a tile, however cheap the tile is."""

_MIN_BATCH_SECONDS = 0.5  # predicted CPU time of a batch: long compared with 2 ms of scheduling
_BATCH_SECONDS_PER_WORKER = 0.005  # so that the driver spends less than half its time scheduling
_MAX_PREDICTED = 10_000  # tiles; each prediction takes a millisecond, during which workers wait
_SIGHT = 2  # seconds that a file system shared by several machines may take to show a file
_ATTEMPTS_ALONE = 2  # a tile fails if its worker dies in both; one death may be a coincidence


@dataclass(frozen=True)
class _Report:
    """The outcome of a batch on a worker."""

    failed: dict[tuple[int, ...], str]  # {tile index: reason}
    used: float  # CPU seconds
    wall: float  # seconds


@dataclass(frozen=True)
class Outcome:
    """The outcome of a sweep.

    Attributes
    ----------
    committed : int
        Tiles that were committed.
    failed : dict
        The reason for each failure, by tile index.
    interrupted : bool
        True if Ctrl-C ended the sweep.
    remaining : int
        Tiles that are still missing.
    """

    committed: int
    failed: dict[tuple[int, ...], str]
    interrupted: bool
    remaining: int


def sweep(
    client: Callable[[], "Client"],
    place: Place,
    job: Job,
    progress: Progress,
    wanted: set[tuple[int, ...]] | None = None,
    call: str = "",
) -> Outcome:
    """Compute the missing tiles of the job's cube and commit them to the store.

    Parameters
    ----------
    client : callable
        () → distributed.Client; called only if tiles are missing. See `cluster.connect`.
    place : Place
        Where the cube is kept; this process must hold its lock, see `store.driver_lock`.
    job : Job
        The cube and the functions that compute it.
    progress : Progress
        The progress line of the run.
    wanted : set of tuple of int, optional
        Indices of the tiles to compute; by default all.
    call : str
        The command or call, for the attribute `history` of a new cube.

    Raises
    ------
    store.Refused
        If the store holds a different cube of that name, or an incomplete one started by other
        code.
    store.StoreFailed
        If the store fails.
    ClusterError
        If no worker is fit to compute.
    ConnectionError
        If the scheduler or all workers are lost. Committed tiles are kept in all these cases.
    """
    name = job.cube.name
    store.create(place, job.cube, job.code.computed_by, call)
    tiles, n_tiles = store.missing(place, job.cube), prod(job.cube.tile_counts)
    n_done = n_tiles - len(tiles)
    if wanted is not None:
        tiles = tiles[[tuple(index) in wanted for index in tiles.tolist()]]
        place.write(store.wanted_key(name), str(n_done + len(tiles)).encode())
    if not len(tiles):
        return Outcome(0, {}, False, 0)
    workers = client()
    # An adaptive cluster starts workers when there is work for them.
    run, n_workers = _Run(workers, place, job, tiles), max(1, sum(workers.nthreads().values()))
    with _draining_on_interrupt() as interrupt:
        progress.add_work((run.costs + COMMIT_SECONDS).sum(), n_workers)
        empty = [np.array([], int)] * n_workers
        batches = chain(empty, _pack(run.costs, n_workers))
        for tile in run.compute(batches, interrupt, progress):
            alone = [np.array([tile])]
            if all(run.compute(alone, interrupt, progress) for _ in range(_ATTEMPTS_ALONE)):
                index, reason = tuple(tiles[tile].tolist()), "its worker died each time, even alone"
                run.failed[index] = store.record_failure(place, name, index, reason)
    if not interrupt.is_set():  # find tiles that were unmounted or deleted meanwhile
        n_lost = n_done + run.committed + len(store.missing(place, job.cube)) - n_tiles
        if n_lost > 0:
            lost = plural(n_lost, "written tile")
            raise store.StoreFailed(f"{place.cube(name)} has lost {lost}")
    return Outcome(run.committed, run.failed, interrupt.is_set(), len(tiles) - run.committed)


class _Run:
    """The tiles of a sweep, their predicted costs, how many were committed, and which failed.

    A tile is represented by its position in `tiles`, the array of tile indices, and a batch by an
    array of positions. With a million tiles, there is memory for little else per tile.
    """

    def __init__(self, client: "Client", place: Place, job: Job, tiles: IntArray) -> None:
        self.client, self.place, self.job, self.tiles = client, place, job, tiles
        self.committed = 0
        self.failed: dict[tuple[int, ...], str] = {}
        self.unfit: set[str] = set()  # addresses of workers
        stride = ceil(len(tiles) / _MAX_PREDICTED)  # neighbours cost about the same
        parts = tile_coords(job.cube, tiles[::stride])
        costs = [job.predict(coords, job.cube.settings) for _, coords in parts]
        self.costs = np.repeat(np.array(costs, float), stride)[: len(tiles)]

    def compute(
        self, batches: Iterable[IntArray], interrupt: threading.Event, progress: Progress
    ) -> list[int]:
        """Run the batches; return the tiles whose worker died."""
        from distributed import KilledWorker, get_worker  # see `cluster`

        queue, cube = iter(batches), self.job.cube
        suspects: list[int] = []
        function = partial(
            _compute_batch,
            self.place,
            cube.name,
            cube.config_hash,
            cube.settings,
            self.job.code,
            self.job.code.computed_by,
            cloudpickle.dumps(self.job.warm_up),
            self.job.compute,
        )
        work = cloudpickle.dumps(function)

        def run(work: bytes, parcel: bytes) -> Any:
            # Dask sends a nested function as code, which runs even if the worker lacks the package.
            try:
                compute_batch = pickle.loads(work)
            except Exception as error:
                return get_worker().address, f"cannot run this package ({error})"
            return compute_batch(parcel)

        def next_call() -> tuple[Any, ...] | None:
            batch = None if interrupt.is_set() else next(queue, None)
            if batch is None:
                return None
            # The tiles are pickled here, because dask would otherwise send each array separately.
            tiles = list(tile_coords(cube, self.tiles[batch]))
            return batch, run, work, pickle.dumps(tiles, protocol=5)

        for batch, result in filter(None, as_completed(self.client, next_call)):
            if isinstance(result, KilledWorker):
                suspects += batch.tolist()
            elif isinstance(result, store.Refused):  # the driver accepted the cube earlier
                self.fail(result)
            elif isinstance(result, Exception):
                raise result
            elif isinstance(result, tuple):
                self.retire(*result)
                queue = chain([batch], queue)
            elif len(batch):
                self.committed += len(batch) - len(result.failed)
                self.failed |= result.failed
                cost = (self.costs[batch] + COMMIT_SECONDS).sum()
                progress.advance(cost, result.used, result.wall)
            else:
                progress.warmed_up()
        return suspects

    def fail(self, reason: Exception | None = None) -> NoReturn:
        """Raise StoreFailed."""
        raise store.StoreFailed(f"{self.place} was moved, or deleted, during the sweep") from reason

    def retire(self, address: str, complaint: str) -> None:
        """Remove an unfit worker; raise ClusterError if no fit worker remains."""
        cube, message = self.job.cube, f"the worker {address} {complaint}"
        if not store.is_visible(self.place, cube.name, cube.config_hash):
            self.fail()
        if address not in self.unfit:
            self.unfit.add(address)
            print(f"retired: {message}", file=sys.stderr)
        if self.client.nthreads().keys() <= self.unfit:
            raise ClusterError(
                f"no worker is fit to compute: {message}. Give all machines the same versions, and "
                "an --out that they share, or an object store with its credentials in their "
                "environment"
            )
        self.client.retire_workers([address])


def _compute_batch(
    place: Place,
    name: str,
    config_hash: str,
    settings: Settings,
    code: Code,
    computed_by: str,
    warm_up: bytes,
    compute: Callable[[Coords, Settings], Arrays],
    parcel: bytes,
) -> _Report | tuple[str, str]:
    """Compute and commit tiles on a worker; return a _Report, or (address, complaint).

    parcel : pickled [(index, coords)].
    """
    from distributed import get_worker

    if complaint := _complaint(place, name, config_hash, code, computed_by):
        return get_worker().address, complaint
    _call_once(warm_up)
    began, used = time.monotonic(), time.thread_time()
    errors: dict[tuple[int, ...], str] = {}
    for index, coords in pickle.loads(parcel):
        try:
            # Dask may run a task twice, e.g. when it loses touch with a worker.
            if not store.is_committed(place, name, index):
                start = time.thread_time()
                arrays = compute(coords, settings)
                store.commit(place, name, index, arrays, time.thread_time() - start)
        except (store.StoreFailed, store.Refused, KeyboardInterrupt, SystemExit):
            raise  # the tile did not cause it
        except BaseException as exception:  # dask hangs if it is not an Exception
            reason = "".join(format_exception_only(exception))
            errors[index] = store.record_failure(place, name, index, reason)
    return _Report(errors, time.thread_time() - used, time.monotonic() - began)


@cache
def _call_once(warm_up: bytes) -> None:
    """Compile kernels once in each process, so that compilation does not count towards a tile."""
    pickle.loads(warm_up)()


def _complaint(place: Place, name: str, config_hash: str, code: Code, computed_by: str) -> str:
    """Return why this worker must not compute the cube; "" if it may.

    computed_by : `code.computed_by` on the driver, whose files and libraries may differ from the
    worker's.
    """
    ours, theirs = code.computed_by.split(", "), computed_by.split(", ")
    if ours != theirs:
        other = [[x for x in a if x not in b] for a, b in ((ours, theirs), (theirs, ours))]
        return f"has {' instead of '.join(map(', '.join, other))}"
    end = time.monotonic() + _SIGHT
    while not store.is_visible(place, name, config_hash):
        if time.monotonic() > end:
            return f"does not see {place} as the driver does"
        time.sleep(0.1)
    return ""


def _pack(costs: FloatArray, n_workers: int) -> Iterator[IntArray]:
    """Yield batches of tiles, the most expensive first; cheap tiles share a batch.

    Tiles of equal predicted cost are in random order, so that the first to run are representative.
    """
    shuffled = np.random.default_rng(0).permutation(costs.size)
    order = shuffled[np.argsort(-costs[shuffled], kind="stable")]
    ends = np.cumsum(costs[order] + COMMIT_SECONDS)
    first, packed = 0, 0.0
    while first < len(order):
        fair_share = (ends[-1] - packed) / max(1, n_workers)
        seconds = max(_MIN_BATCH_SECONDS, min(_BATCH_SECONDS_PER_WORKER * n_workers, fair_share))
        last = max(first + 1, int(np.searchsorted(ends, packed + seconds, side="right")))
        yield order[first:last]
        first, packed = last, ends[last - 1]


@contextmanager
def _draining_on_interrupt() -> Iterator[threading.Event]:
    """Yield an Event that the first Ctrl-C sets; the second interrupts at once.

    Outside the main thread, or if the previous handler was not set by Python, nothing sets
    the Event.
    """
    interrupt, previous = threading.Event(), signal.getsignal(signal.SIGINT)
    if previous is None or threading.current_thread() is not threading.main_thread():
        yield interrupt
        return

    def drain(signum: int, frame: object) -> None:
        if interrupt.is_set():
            raise KeyboardInterrupt
        interrupt.set()
        message = "stopping: waiting for the tiles in flight (Ctrl-C again to abandon them)"
        print(f"\n{message}", file=sys.stderr)

    # A process that was started in the background, with Ctrl-C ignored, continues to ignore it.
    signal.signal(signal.SIGINT, signal.SIG_IGN if previous is signal.SIG_IGN else drain)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, previous)
