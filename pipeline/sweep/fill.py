"""Fill a cube: compute its missing tiles, and return it as a Dataset.

`fill` is for scripts, notebooks and programs. Like the commands, it calls `compute_missing`.
Whatever happens, committed tiles are kept, and the same call resumes the sweep.
"""

import sys
from collections.abc import Callable
from contextlib import nullcontext
from functools import cache, partial
from os import PathLike
from typing import TYPE_CHECKING

import xarray as xr

from pipeline import store
from pipeline.cubes.cube import Job
from pipeline.store import Place
from pipeline.sweep.cluster import ClusterError, connect
from pipeline.sweep.progress import Progress, plural
from pipeline.sweep.sweep import sweep

if TYPE_CHECKING:
    from distributed import Client

_MAX_REASONS = 3  # maximum number of failures that a message lists


class TilesFailed(RuntimeError):
    """Some tiles failed. The others are kept; the same call retries the failed ones.

    Attributes
    ----------
    failed : dict
        The reason for each failure, by the index of the tile.

    Examples
    --------
    >>> from pipeline import TilesFailed
    >>> print(TilesFailed("squares", {(0, 1): "ZeroDivisionError: division by zero"}))
    1 tile of squares failed: (0, 1), ZeroDivisionError: division by zero
    """

    def __init__(self, name: str, failed: dict[tuple[int, ...], str]) -> None:
        self.failed = failed
        reasons = [f"{index}, {failed[index]}" for index in sorted(failed)]
        if len(reasons) > _MAX_REASONS:
            reasons[_MAX_REASONS:] = [f"and {len(reasons) - _MAX_REASONS} more"]
        super().__init__(f"{plural(len(failed), 'tile')} of {name} failed: {'; '.join(reasons)}")


class Interrupted(KeyboardInterrupt):
    """Ctrl-C stopped a sweep once its tiles in flight were committed; the same call resumes it.

    Attributes
    ----------
    remaining : int
        Number of tiles that are still missing.
    failed : dict
        The reason for each failure before the interruption, by the index of the tile.

    Examples
    --------
    >>> from pipeline import Interrupted
    >>> print(Interrupted("squares", 12, {}))
    stopped; 12 tiles of squares are missing, and the same call computes them
    """

    def __init__(self, name: str, remaining: int, failed: dict[tuple[int, ...], str]) -> None:
        self.remaining, self.failed = remaining, failed
        verb = "is" if remaining == 1 else "are"
        missing = f"{plural(remaining, 'tile')} of {name} {verb} missing"
        super().__init__(f"stopped; {missing}, and the same call computes them")


def fill(
    job: Job,
    out: str | PathLike[str],
    client: "Client | None" = None,
    workers: int | None = None,
    progress: bool = True,
) -> xr.Dataset:
    """Compute what is missing from the job's cube in `out`, and return the cube.

    If nothing is missing, the cube is read and no worker is started. `fill` may be called in a
    script, a notebook or a thread, even while an event loop is running. After Ctrl-C it waits for
    the tiles in flight, and a second Ctrl-C abandons them; a call outside the main thread does not
    receive Ctrl-C.

    Parameters
    ----------
    job : Job
        The cube and how to compute it, as returned by a function like `pipeline.last_barrier`.
    out : str or path
        Directory of the cube, or URL of an object store, s3://BUCKET/PREFIX (or gs://, az://). The
        cube is OUT/NAME.zarr; other cubes in the directory remain unchanged.
    client : distributed.Client, optional
        Client of any cluster whose workers can access `out` and import this package. By default,
        workers are started on this machine, and stopped at the end of the call.
    workers : int, optional
        Number of worker processes to start on this machine, at least 1; by default one per core.
    progress : bool
        If True, write a progress line to stderr.

    Returns
    -------
    xr.Dataset
        The cube; its numbers are read only when they are used.

    Raises
    ------
    TilesFailed
        If tiles failed; the others are computed first.
    Interrupted
        On Ctrl-C; this exception is a KeyboardInterrupt.
    store.Refused
        If `out` contains that cube with different settings, or an incomplete cube started by
        different code, or if another run is writing to `out`. Nothing has been changed.
    store.StoreFailed
        If the disk or the object store fails.
    ClusterError
        If no worker is suitable, or if `client` is unusable or given together with `workers`.
    ConnectionError
        If workers cannot be started, or all of them are lost.

    Examples
    --------
    >>> import pipeline
    >>> job = pipeline.escape("two-kicks", "0:1:4", "0:1:2", n_max=1000)
    >>> escape = pipeline.fill(job, "run", workers=1, progress=False)
    >>> dict(escape.escape_time.sizes), bool(escape.escape_time.isnull().any())
    ({'ensemble': 1, 'kappa2': 2, 'kappa1': 4}, False)
    """
    place, name = store.place_of(out), job.cube.name
    workers_of = connect(n_workers=workers) if client is None else _using(client, workers)
    with (
        store.store_errors(place),
        workers_of as connection,
        store.driver_lock(place),
        Progress(name, sys.stderr if progress else None) as line,
    ):
        line.begin_sweep(name, name)
        start = cache(partial(connected, connection, line, is_local=client is None))
        call = f"pipeline.fill({job.call or f'<{name}>'}, {str(out)!r})"
        filled = compute_missing(start, place, job, line, call=call)
        line.finish()
        return filled


def compute_missing(
    client: Callable[[], "Client"],
    place: Place,
    job: Job,
    progress: Progress,
    wanted: set[tuple[int, ...]] | None = None,
    call: str = "",
) -> xr.Dataset:
    """Compute the missing tiles of the job's cube, or only those in `wanted`; return the cube.

    See `sweep` for the parameters and the other errors.

    Raises
    ------
    TilesFailed, Interrupted
        As for `fill`.
    """
    name = job.cube.name
    outcome = sweep(client, place, job, progress, wanted, call)
    if outcome.interrupted:
        raise Interrupted(name, outcome.remaining, outcome.failed)
    if outcome.failed:
        raise TilesFailed(name, outcome.failed)
    return store.read(place, name)


def connected(connection: Callable[[], "Client"], line: Progress, is_local: bool) -> "Client":
    """Connect to the workers; meanwhile, show in the progress line that they are starting."""
    previous = line.name or ""
    line.show("starting workers on this machine" if is_local else "connecting to the workers")
    client = connection()
    line.show(previous)
    return client


def _using(client: "Client", workers: int | None) -> nullcontext[Callable[[], "Client"]]:
    """Return a context like that of `connect`, but for the user's client; it is not closed."""
    if workers is not None:
        raise ClusterError(f"the client has its own workers; leave workers={workers} out")
    if client.asynchronous:
        raise ClusterError("the client is asynchronous; use Client(…, asynchronous=False)")
    if client.status != "running":
        raise ClusterError(f"the client is {client.status}; connect a new one")
    return nullcontext(lambda: client)
