"""One line that tells how far a sweep is: tiles done, rate, time left by predicted cost."""

import time
from contextlib import AbstractContextManager, suppress


class Progress(AbstractContextManager):
    """The line of a sweep, or of a series of sweeps that go on where the last one ended.

    On a terminal it is rewritten; in a log a new one is written every ten seconds. The tiles and
    the time left are those of the sweeps that have begun.
    """

    def __init__(self, name, stream):
        self.name, self.stream = name, stream
        self.tiles = self.tiles_done = 0
        self.seconds = self.seconds_done = 0.0
        self.start = self.shown = time.monotonic()
        self.interval, self.end = (0.2, "\r") if stream.isatty() else (10.0, "\n")

    def __exit__(self, *error):
        if self.tiles:
            self._show("\n")

    def begin(self, tiles, seconds):
        """Add tiles to be done, and the seconds predicted for them."""
        self.tiles += tiles
        self.seconds += seconds
        if self.stream.isatty():
            self._show("\r")

    def advance(self, tiles, seconds):
        """Count tiles as done."""
        self.tiles_done += tiles
        self.seconds_done += seconds
        if time.monotonic() - self.shown > self.interval:
            self._show(self.end)

    def _show(self, end):
        self.shown = time.monotonic()
        gone, left = self.shown - self.start, "?"
        if self.seconds_done > 0:
            left = duration(gone * max(0.0, self.seconds / self.seconds_done - 1))
        line = f"{self.name}: {self.tiles_done}/{self.tiles} tiles, "
        line += f"{self.tiles_done / max(gone, 1e-9):.1f}/s, {duration(gone)} gone, {left} left"
        with suppress(OSError):  # a log that is full, or closed, does not end the sweep
            print(line.ljust(78), end=end, file=self.stream, flush=True)


def duration(seconds):
    """Return a time in words: 45 s, 12 min, 3.2 h."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
