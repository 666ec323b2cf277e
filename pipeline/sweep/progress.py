"""The progress line of a run: the fraction done, in predicted CPU seconds, and the time remaining.

The time remaining for the sweeps is their remaining predicted CPU time, multiplied by the pace:

    pace = seconds in which workers had work / predicted CPU seconds of the completed tiles

Predictions need only be right relative to each other: a slow processor, other programs on it, and
waiting between tiles raise the pace for all tiles alike. The time until the first worker has loaded
its kernels is not counted. The driver's own work after the sweeps is added separately, in seconds.
"""

import shutil
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from typing import Self, TextIO

_LOADING = 5  # seconds: kernels that take longer to load are being compiled
_BAR_LENGTH = 20  # characters


class Progress(AbstractContextManager):
    """The progress line of a run; on a terminal it has a bar, which never moves back.

    On a terminal the line is rewritten; a log gets a new line every ten seconds, and at the end of
    each sweep.

    Parameters
    ----------
    name : str
        The activity to show at the start.
    stream : file or None
        Where to write; None to write nothing.
    predicted : mapping of str to float
        Predicted CPU seconds of each sweep, by its name.
    after : float
        CPU seconds of the driver's own work after the sweeps.
    clock : callable
        Function without arguments that returns the time in seconds.

    Examples
    --------
    >>> from pipeline.sweep.progress import Progress
    >>> progress = Progress("escape", None, {"escape": 10.0})
    >>> progress.begin_sweep("escape", "escape")
    >>> progress.add_work(10.0)
    >>> progress.advance(4.0, used=4.0, wall=4.0)
    >>> progress.line()
    'escape: 40%, elapsed 0:00, remaining about 0:01'
    """

    def __init__(
        self,
        name: str,
        stream: TextIO | None,
        predicted: Mapping[str, float] | None = None,
        after: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name: str | None = name
        self.stream, self.clock = stream, clock
        self.predicted = dict[str | None, float]((predicted or {}).items())
        self.after, self.studied = after, 0.0
        self.sweep: str | None = None
        self.workers = 1
        self.begun = 0.0  # predicted CPU seconds of all tiles of the sweeps that have begun
        self.done = 0.0  # predicted CPU seconds of the completed tiles
        self.n_batches = 0  # completed batches of tiles
        self.used = self.wall = 0.0  # CPU and elapsed seconds of these batches
        self.working = 0.0  # seconds in which workers had work
        self.warming: float | None = None  # when workers began to load the kernels of a sweep
        self.start = self.latest = clock()
        self.drawn = 0.0  # fraction of the bar that is filled
        self.is_terminal = stream is not None and stream.isatty()
        self.lock, self.over = threading.RLock(), threading.Event()

    def __enter__(self) -> Self:
        if self.stream is not None:
            threading.Thread(target=self._keep_writing, daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self.over.set()
        self.hide()

    def show(self, name: str) -> None:
        """Show `name` as the current activity."""
        self.name = name
        if self.is_terminal:
            self.write("\r")

    def hide(self) -> None:
        """End the line, so that other output can follow; `show` begins a new one."""
        with self.lock:
            if self.begun or self.is_terminal:
                self.write("\n")
            self.name = None

    def finish(self) -> None:
        """Show that the run is done, and end the line."""
        self.name, self.drawn = "done", 1.0
        self.hide()

    def begin_sweep(self, name: str, sweep: str) -> None:
        """Count tiles towards this sweep from now on, and show `name`; calls may be repeated."""
        if sweep != self.sweep:
            self.predicted.pop(self.sweep, None)  # the previous sweep has ended
            self.sweep = sweep
        self.show(name)

    def end_sweep(self) -> None:
        """Write a line for the sweep if the stream is a log; show that the driver is computing."""
        if self.begun and not self.is_terminal:
            self.write("\n")
        self.show("computing")

    def add_work(self, seconds: float, workers: int = 1) -> None:
        """Add tiles to the current sweep, whose workers have yet to load their kernels.

        Parameters
        ----------
        seconds : float
            Predicted CPU seconds of the tiles.
        workers : int
            Number of workers.
        """
        self.predicted[self.sweep] = max(0.0, self.predicted.get(self.sweep, 0.0) - seconds)
        self.workers, self.warming = workers, self.clock()
        if self.n_batches:  # workers wait while the driver computes between sweeps
            self.working += self.warming - self.latest
        self.begun += seconds

    def warmed_up(self) -> None:
        """Record that a worker has loaded its kernels."""
        if self.warming is not None:
            self.latest, self.warming = self.clock(), None

    def advance(self, seconds: float, used: float, wall: float) -> None:
        """Count a batch of tiles as done.

        Parameters
        ----------
        seconds, used : float
            CPU seconds, predicted and measured.
        wall : float
            Seconds that the batch took.
        """
        self.warmed_up()
        self.n_batches += 1
        self.done += seconds
        self.used += used
        self.wall += wall
        before, self.latest = self.latest, self.clock()
        self.working += self.latest - before

    def count_study(self, seconds: float) -> None:
        """Count predicted CPU seconds of the driver's own work as done."""
        seconds = min(seconds, self.after)
        self.after -= seconds
        self.studied += seconds
        self.latest = self.clock()

    def fraction(self) -> float:
        """Return the fraction of the predicted CPU seconds that is done; it never decreases."""
        done = self.done + self.studied
        total = done + self._sweeps_left() + self.after
        self.drawn = max(self.drawn, done / total if total else 0.0)
        return self.drawn

    def _sweeps_left(self) -> float:
        """Return the predicted CPU seconds of the tiles that are not yet complete."""
        return self.begun - self.done + sum(self.predicted.values())

    def remaining(self) -> float | None:
        """Estimate the seconds until the run ends; None until the first batch is completed."""
        if not (self.done and self.used):
            return None
        # When a batch is completed, the other workers are halfway through theirs, on average.
        in_flight = (self.workers - 1) / (2 * self.n_batches)
        pace = self.working / (self.done * (1 + in_flight))
        # Workers share the processors with each other and with other programs; later the driver
        # shares them only with the other programs.
        driver_pace = max(1.0, self.wall / self.used - 1 + 1 / self.workers)
        seconds = pace * self._sweeps_left() + driver_pace * self.after
        since = self.clock() - self.latest
        return max(seconds - since, seconds / 2)  # overdue work still takes some time

    def line(self) -> str:
        """Return the line: the bar, the current activity, and the times."""
        now, fraction, name = self.clock(), self.fraction(), self.name or ""
        if self.warming is not None:
            is_long = now - self.warming > _LOADING
            name += ", compiling kernels (half a minute, once)" if is_long else ", loading kernels"
        times = [f"{fraction:.0%}"] if self.begun else []
        times.append(f"elapsed {clock_time(now - self.start)}")
        if fraction < 1 and (remaining := self.remaining()) is not None:
            times.append(f"remaining about {clock_time(max(1.0, remaining))}")
        line = f"{name}: {', '.join(times)}"
        if not self.is_terminal:
            return line
        if self.begun:
            n_full = round(_BAR_LENGTH * fraction)
            line = f"[{'#' * n_full}{'-' * (_BAR_LENGTH - n_full)}] {line}"
        width = shutil.get_terminal_size().columns - 1  # a line that wraps cannot be rewritten
        return line[:width].ljust(width)

    def write(self, end: str) -> None:
        """Write the line, if one is shown."""
        with self.lock:
            if self.name is not None and self.stream is not None:
                with suppress(OSError, ValueError):  # continue despite a full disk or a closed log
                    print(self.line(), end=end, file=self.stream, flush=True)

    def _keep_writing(self) -> None:
        """Write the line at regular intervals until the run is over."""
        interval, end = (0.5, "\r") if self.is_terminal else (10.0, "\n")
        while not self.over.wait(interval):
            self.write(end)


def clock_time(seconds: float) -> str:
    """Format a time as on a digital clock.

    Examples
    --------
    >>> from pipeline.sweep.progress import clock_time
    >>> clock_time(29), clock_time(725), clock_time(3723)
    ('0:29', '12:05', '1:02:03')
    """
    hours, rest = divmod(round(seconds), 3600)
    text = f"{rest // 60:02}:{rest % 60:02}"
    return f"{hours}:{text}" if hours else text.removeprefix("0")


def plural(n: float, word: str, form: str = "") -> str:
    """Return a number with its noun; `form` is the format of the number.

    Examples
    --------
    >>> from pipeline.sweep.progress import plural
    >>> plural(1, "tile"), plural(12_000, "tile", ",")
    ('1 tile', '12,000 tiles')
    """
    return f"{n:{form}} {word}{'' if n == 1 else 's'}"


def duration(seconds: float) -> str:
    """Return a time with its unit.

    Examples
    --------
    >>> from pipeline.sweep.progress import duration
    >>> duration(45), duration(725), duration(11_500)
    ('45 s', '12 min', '3.2 h')
    """
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
