"""Run calls on dask workers, a few per worker at a time, and yield each result as its call ends.

All computations on workers, for sweeps and the explorer, use this module. Workers may join and
leave at any time.
"""

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from math import inf
from queue import Empty, SimpleQueue
from time import monotonic
from typing import TYPE_CHECKING, Any

from pipeline.sweep.cluster import NO_SCHEDULER, are_on_this_machine, are_starting

if TYPE_CHECKING:
    from distributed import Client, Future

_ROLL_CALL = 1  # seconds after which the workers are counted again
_PATIENCE = 30  # seconds to wait without any worker before giving up
_STARTING = 300  # the same while workers are starting, which takes a minute at a load average of 20
_FETCHING = 5  # seconds to fetch the result of a call that has ended


def as_completed(
    client: "Client",
    next_call: Callable[[], tuple[Any, ...] | None],
    each: int = 2,
    leaves_one: bool = False,
    look: float = _ROLL_CALL,
    priority: int = 0,
) -> Iterator[tuple[Any, Any] | None]:
    """Yield (key, result or exception) for each call that ends, or None after `look` idle seconds.

    Closing this generator cancels the calls in flight.

    Parameters
    ----------
    client : distributed.Client
        Connection to the workers.
    next_call : callable
        () → (key, function, *args), or None while there is no call to make. The iteration stops
        when `next_call` returns None and all calls have ended.
    each : int
        Maximum number of calls in flight for each worker.
    leaves_one : bool
        True to leave one of several workers to other tasks. Then each of the others has one call
        in flight.
    look : float
        Seconds to wait for a call to end before None is yielded.
    priority : int
        Priority of the calls; higher ones run first.

    Raises
    ------
    ConnectionError
        If the scheduler has disappeared, or this machine has had no worker for half a minute (for
        five minutes while workers are starting). If the scheduler is on another machine, there
        is no limit, because its workers may have to wait in a batch queue.
    """
    from distributed.comm import CommClosedError  # see `cluster`

    in_flight: dict[Future, Any] = {}
    done: SimpleQueue[Future] = SimpleQueue()
    workers, counted, alive = 0, -inf, monotonic()
    try:
        while True:
            now = monotonic()
            if now - counted >= _ROLL_CALL:
                try:
                    workers, counted = sum(client.nthreads().values()), now
                except OSError:
                    raise ConnectionError(NO_SCHEDULER) from None
                if workers:
                    alive = now
                elif now - alive > (_STARTING if are_starting(client) else _PATIENCE):
                    if are_on_this_machine(client):
                        raise ConnectionError("no workers are left; run again to resume")
                    print("no workers are left; waiting until some join", file=sys.stderr)
                    alive = inf  # print this only once
            window = max(1, workers - 1) if leaves_one else each * max(1, workers)
            while len(in_flight) < window and (call := next_call()) is not None:
                key, function, *args = call
                future = client.submit(function, *args, pure=False, priority=priority)
                in_flight[future] = key
                future.add_done_callback(done.put)
            if not in_flight:
                return
            try:
                future = done.get(timeout=look)
            except Empty:
                yield None
                continue
            try:
                result = future.result(timeout=_FETCHING)
            except TimeoutError:
                # The worker died before its result was fetched, so dask repeats the call.
                future.add_done_callback(done.put)
                continue
            except (CancelledError, CommClosedError):
                raise ConnectionError(NO_SCHEDULER) from None
            except Exception as exception:
                result = exception
            future.release()
            yield in_flight.pop(future), result
    except GeneratorExit:
        if client.status == "running":
            client.cancel(list(in_flight))
        raise
