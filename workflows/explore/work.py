"""Work off the event loop: threads compute, the document of a tab gets the results.

Everything here is called on the event loop, but for the functions that compute. They run in daemon
threads, so that neither a closed tab nor Ctrl-C waits for them; kernels release the GIL.
"""

from contextlib import suppress
from inspect import isgenerator
from math import inf
from threading import Thread

from pipeline.store import Refused
from pipeline.sweep.submit import as_completed

_LOOK = 0.1  # seconds after which a generator yields, to be closed if it is void


class Work:
    """The work of one tab.

    document : of Bokeh.
    client : function → dask Client; called in threads only, as it may wait for the workers.
    loaded : {name of kernels: Event, set when they are loaded}.
    busy : {name of what is being computed for the page: how far that is, in words}.
    failed : {name of what could not be: why, in words}, until it is tried again.
    show : function without arguments, called whenever `busy` or `failed` changes.

    Nothing is computed before `start` is called, nor after `close`.
    """

    def __init__(self, document, client, loaded=None):
        self.document, self.client, self.loaded = document, client, loaded or {}
        self.busy, self.failed, self.show = {}, {}, lambda: None
        self.closed, self._lanes = True, []

    def latest(self, name, kernels="verdict"):
        """Return a Latest; `name` says in the page what is being computed, "portrait".

        kernels : name of those that it waits for; None if it waits for none.
        """
        self._lanes.append(Latest(self, name, self.loaded.get(kernels)))
        return self._lanes[-1]

    def start(self):
        """Begin with what was submitted so far; called on the event loop."""
        self.closed = False
        for lane in self._lanes:
            lane.start()

    def close(self):
        """Drop all that is still to come: the tab is closed."""
        self.closed = True

    def tick(self, callback):
        """Call back on the event loop, from any thread, unless the tab is closed."""
        if not self.closed:
            with suppress(AttributeError):  # Bokeh takes the document of a closed tab apart
                self.document.add_next_tick_callback(callback)

    def progress(self, name, words=None):
        """Note how far the computation is, or that it ends."""
        self.busy[name] = words
        if words is None:
            del self.busy[name]
        self.show()

    def fail(self, name, error):
        is_sentence = isinstance(error, ValueError | OSError | Refused)
        self.failed[name] = str(error) if is_sentence else repr(error)
        self.show()


class Latest:
    """Computations of one kind, of which only the last one that was asked for counts."""

    def __init__(self, work, name, loaded):
        self.work, self.name, self._loaded = work, name, loaded
        self._number, self._runs, self._waiting = 0, False, None

    def submit(self, function, *args, done):
        """Compute function(*args) in a thread, and call done(result) on the event loop.

        A newer call makes an older one void: its result is dropped. One runs at a time; of those
        that wait the newest is kept. A function that is a generator has done(value) called
        for each value that it yields, and is closed at the next `yield` once it is void, so it
        should yield often; what is not worth showing it yields as None.
        """
        self.cancel()
        self._waiting = self._number, function, args, done
        self.start()

    def cancel(self):
        """Make what runs or waits void."""
        self._number += 1
        self._waiting = None

    def is_void(self, number):
        return self.work.closed or number != self._number

    def start(self):
        """Compute what waits, if nothing runs."""
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


def spread(client, calls, most=inf, priority=0):
    """Yield (key, result) of calls on the workers as they end, and None while nothing ends.

    client : dask Client. calls : deque of (key, function, *args). most, priority : as for
    `submit.as_completed`, which has four in flight for each worker, so that the scheduler always
    has one that it prefers to those of a lower priority, and which cancels them when this is
    closed.
    """
    for item in as_completed(
        client, lambda: calls.popleft() if calls else None, 4, most, _LOOK, priority
    ):
        if item and isinstance(item[1], Exception):
            raise item[1]
        yield item
