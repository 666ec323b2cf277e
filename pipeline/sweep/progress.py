"""One line that tells how far sweeps are: tiles done, rate, time left by predicted cost."""

import threading
import time
from contextlib import AbstractContextManager, suppress

import numpy as np

_SILENCE = 5  # seconds after which the line is shown again, whatever happens
_PRIOR = 5  # seconds for which the workers are taken to be as fast as predicted


class Progress(AbstractContextManager):
    """The line of a sweep, or of a series of sweeps that go on where the last one ended.

    On a terminal it is rewritten; in a log a new one is written every ten seconds, and after five
    in which no tile has ended. The tiles and the time left are those of the sweeps that have begun,
    and of those that are foreseen.

    name : what is under way, at first. stream : where to write.
    foreseen : {name of a sweep: (tiles, predicted CPU seconds)}. All amounts are such pairs.
    """

    def __init__(self, name, stream, foreseen=()):
        self.name, self.stream, self.foreseen = name, stream, dict(foreseen)
        self.sweep, self.swept, self.workers = None, name, 1
        self.begun, self.done = np.zeros(2), np.zeros(2)
        self.start = self.shown = time.monotonic()
        self.first = None  # when the first tiles were begun
        self.interval, self.end = (0.2, "\r") if stream.isatty() else (10.0, "\n")
        self.over = threading.Event()

    def __enter__(self):
        threading.Thread(target=self._break_silence, daemon=True).start()
        return self

    def __exit__(self, *error):
        self.over.set()
        self.foreseen.clear()
        self.name = self.swept
        if self.begun[0]:
            self._show("\n")

    def go_on(self, name, sweep):
        """Count the tiles that begin next as those of the sweep; `name` is written for it."""
        if sweep != self.sweep:
            self.foreseen.pop(self.sweep, None)  # it has ended
            self.name = self.swept
            if self.done[0]:
                self._show("\n")
        self.name, self.swept, self.sweep = name, name, sweep

    def begin(self, tiles, seconds, workers=1):
        """Add tiles to be done, and the seconds predicted for them, by so many workers."""
        left = np.subtract(self.foreseen.get(self.sweep, 0), (tiles, seconds))
        self.foreseen[self.sweep] = np.maximum(0, left)
        self.first, self.workers = self.first or time.monotonic(), workers
        self.begun += tiles, seconds
        if self.stream.isatty():
            self._show("\r")

    def advance(self, tiles, seconds):
        """Count tiles as done."""
        self.done += tiles, seconds
        if time.monotonic() - self.shown > self.interval:
            self._show(self.end)

    def _break_silence(self):
        while not self.over.wait(_SILENCE / 5):
            if time.monotonic() - self.shown > _SILENCE:
                self._show(self.end)

    def _show(self, end):
        self.shown = time.monotonic()
        line, gone = f"{self.name}: ", self.shown - self.start
        tiles, seconds = np.sum([self.begun, *self.foreseen.values()], axis=0)
        done, seconds_done = self.done
        if tiles:
            line += f"{done:.0f}/{plural(tiles, 'tile', '.0f')}, {done / max(1e-9, gone):.1f}/s, "
        line += f"{duration(gone)} gone"
        if done < tiles and self.first:
            speed = (seconds_done + _PRIOR * self.workers) / (self.shown - self.first + _PRIOR)
            line += f", about {duration(max(1, (seconds - seconds_done) / speed))} left"
        with suppress(OSError, ValueError):  # a log that is full, or closed, does not end the sweep
            print(line.ljust(78), end=end, file=self.stream, flush=True)


def plural(n, word, form=""):
    """Return a number of things in words: 1 tile, 0 tiles, 12 tiles."""
    return f"{n:{form}} {word}{'' if n == 1 else 's'}"


def duration(seconds):
    """Return a time in words: 45 s, 12 min, 3.2 h."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
