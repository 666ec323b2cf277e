"""Calls on dask workers, a few at a time for each, and their results as they end.

Whoever computes on workers goes through here: sweeps, and the explorer. Workers may join and leave.
"""

import sys
from concurrent.futures import CancelledError
from math import inf
from queue import Empty, SimpleQueue
from time import monotonic

from distributed.comm import CommClosedError

from pipeline.sweep.cluster import NO_SCHEDULER, are_starting

_ROLL_CALL = 1  # seconds after which the workers are counted again
_PATIENCE = 30  # seconds without any worker, after which to give up
_STARTING = 300  # seconds instead, while workers are being started: at load 20 that takes a minute
_REPORT = 5  # seconds to fetch the result of a call that has ended


def ended(client, next_call, each=2, most=inf, look=_ROLL_CALL, priority=0):
    """Yield (key, result or exception) of each call when it has ended, and None while none ends.

    client : distributed.Client.
    next_call : () → (key, function, *args), or None while there is no call to make; the end is when
        there is none, and all have ended.
    each, most : calls in flight, for each worker and in all.
    look : seconds, at most, until it yields None.
    priority : of the calls; higher ones go first.

    To close this generator cancels what is in flight. ConnectionError if the scheduler is gone, or
    all workers of this machine for half a minute; others are waited for, as their queue decides.
    """
    in_flight, done = {}, SimpleQueue()
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
                    if client.cluster:
                        raise ConnectionError("no workers are left; run again to resume")
                    print("no workers are left; waiting until some join", file=sys.stderr)
                    alive = inf  # it is said once
            window = min(most, each * max(1, workers))
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
                result = future.result(timeout=_REPORT)
            except TimeoutError:
                # Its worker died between the end of the call and its report: dask runs it again.
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
