"""Computations outside the event loop: threads pass their results to the document of a tab.

The functions that compute run in daemon threads, so that neither a closed tab nor Ctrl-C waits for
them; kernels release the GIL. Everything else is called on the event loop, unless its docstring
says otherwise.
"""

from contextlib import suppress
from functools import partial
from inspect import isgenerator
from threading import Thread

from pipeline.store import Refused
from pipeline.sweep.submit import as_completed

_YIELD_SECONDS = 0.1  # time between the yields of a generator; it can be closed only at a yield


class Work:
    """The computations of one tab. They begin at `start`, and end at `close`.

    document : the Bokeh document.
    client : function that returns a dask Client; it is called only in threads, because it may wait
        for the workers.
    loaded : {name of kernels: Event, set when they are loaded}.
    busy : {name of a computation: its progress as text}.
    failed : {name of a computation that failed: the reason}, until it is started again.
    show : function without arguments, called whenever `busy` or `failed` changes.
    """

    def __init__(self, document, client, loaded=None):
        self.document, self.client, self.loaded = document, client, loaded or {}
        self.busy, self.failed, self.show = {}, {}, lambda: None
        self.closed, self._lanes = True, []

    def latest(self, name, kernels="verdict"):
        """Return a Latest; the page shows its `name`, e.g. "portrait", while it computes.

        kernels : name of the kernels that it waits for; None to start at once.
        """
        self._lanes.append(Latest(self, name, self.loaded.get(kernels)))
        return self._lanes[-1]

    def start(self):
        """Start the computations submitted so far; to be called on the event loop."""
        self.closed = False
        for lane in self._lanes:
            lane.start()

    def close(self):
        """Drop all remaining computations, because the tab is closed."""
        self.closed = True

    def tick(self, callback):
        """From any thread, run `callback` on the event loop, unless the tab is closed."""
        if not self.closed:
            with suppress(AttributeError):  # Bokeh dismantles the document of a closed tab
                self.document.add_next_tick_callback(callback)

    def progress(self, name, text=None):
        """Record the progress of a computation; `text` is None when it ends."""
        self.busy[name] = text
        if text is None:
            del self.busy[name]
        self.show()

    def fail(self, name, error):
        """Record that a computation failed."""
        is_sentence = isinstance(error, ValueError | OSError | Refused)
        self.failed[name] = str(error) if is_sentence else repr(error)
        self.show()


class Latest:
    """Computations of one kind; only the result of the latest one is used."""

    def __init__(self, work, name, loaded):
        self.work, self.name, self._loaded = work, name, loaded
        self._number, self._runs, self._waiting = 0, False, None

    def submit(self, function, *args, done):
        """Compute function(*args) in a thread, and call done(result) on the event loop.

        A newer call voids an older one, whose result is dropped. One call runs at a time, and only
        the newest one waits. If the function is a generator, done(value) is
        called for each value that is not None. A generator that has become void is closed at its
        next `yield`, so it should yield often: None if there is nothing new to show.
        """
        self.cancel()
        self._waiting = self._number, function, args, done
        self.start()

    def cancel(self):
        """Void the running computation and the waiting one."""
        self._number += 1
        self._waiting = None

    def is_void(self, number):
        """Return True if a newer computation was submitted, or the tab is closed."""
        return self.work.closed or number != self._number

    def start(self):
        """Start the waiting computation, unless another one is running."""
        if self._waiting and not self._runs and not self.work.closed:
            job, self._waiting = self._waiting, None
            self._runs = True
            self.work.failed.pop(self.name, None)
            self.work.progress(self.name, "")
            Thread(target=self._compute, args=job, daemon=True).start()

    def _compute(self, number, function, args, done):
        try:
            if self._loaded:
                self._loaded.wait()
            result = None if self.is_void(number) else function(*args)
            for value in result if isgenerator(result) else [result]:
                if self.is_void(number):
                    break
                if value is not None:
                    self._deliver(number, done, value)
            if isgenerator(result):
                result.close()
        except Exception as error:
            self._deliver(number, lambda error: self.work.fail(self.name, error), error)
        finally:
            self.work.tick(self._end)

    def _deliver(self, number, done, value):
        self.work.tick(lambda: None if self.is_void(number) else done(value))

    def _end(self):
        self._runs = False
        self.work.progress(self.name)
        self.start()


def spread(client, calls, leaves_one=False, priority=0):
    """Run calls on the workers; yield (key, result) as each one ends, and None while waiting.

    client : dask Client. calls : iterable of (key, function, *args), or None while there is no
    call to make. leaves_one : as for `submit.as_completed`; for calls that take long, because they
    cannot be interrupted. Otherwise four calls are in flight for each worker, so that the scheduler
    always has one to run before any call with a lower `priority`. All calls in flight are cancelled
    when this generator is closed.
    """
    next_call = partial(next, iter(calls), None)
    for item in as_completed(client, next_call, 4, leaves_one, _YIELD_SECONDS, priority):
        if item and isinstance(item[1], Exception):
            raise item[1]
        yield item
