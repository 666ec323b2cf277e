"""How far a run is, and when it will end: one line, in predicted CPU seconds over all its sweeps.

What remains is estimated from the batches of tiles that have come in:

    remaining = pace · Σ correction · CPU seconds left

The pace is wall time over the CPU time of all workers together, in the run so far: other work on
the machine raises it, and so does what workers wait for. The correction of the sweep under way is
its CPU time over what was predicted for it; that of later ones is 1. The time until a first worker
has its kernels is in neither; each later sweep is expected to wait as long, or for the time of
loading where the first had to compile them.
"""

import shutil
import threading
import time
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass

_TRUST = 0.02  # part of a sweep for which its prediction counts as much as what is measured
_LOADING = 5  # seconds: kernels that take longer to come are being compiled
_BAR = 20  # characters


@dataclass
class _Amounts:
    """CPU seconds of one sweep, or of all."""

    begun: float = 0.0  # predicted
    done: float = 0.0  # predicted, of what has come in
    used: float = 0.0  # measured, of what has come in
    batches: int = 0


class Progress(AbstractContextManager):
    """The line of a run, that of `name` at first; on a terminal with a bar, which never goes back.

    On a terminal it is rewritten; in a log there is a new one every ten seconds, and at the end of
    each sweep.

    stream : where to write; None for silence.
    foreseen : {name of a sweep: predicted CPU seconds}.
    after : CPU seconds of what the driver does after the sweeps.
    clock : function () → seconds.
    """

    def __init__(self, name, stream, foreseen=(), after=0.0, clock=time.monotonic):
        self.name, self.stream, self.clock = name, stream, clock
        self.foreseen, self.after = dict(foreseen), after
        self.sweep, self.workers = None, 1
        self.all, self.current = _Amounts(), _Amounts()
        self.wall = 0.0  # of batches, as `all.used`
        self.working = 0.0  # seconds in which workers had work
        self.warming = None  # since when the kernels of a sweep are waited for
        self.warm_up = 0.0  # seconds for which those of the latest sweep were
        self.start = self.latest = clock()
        self.drawn = 0.0  # part of the bar
        self.is_terminal = stream is not None and stream.isatty()
        self.lock, self.over = threading.RLock(), threading.Event()

    def __enter__(self):
        if self.stream is not None:
            threading.Thread(target=self._keep_writing, daemon=True).start()
        return self

    def __exit__(self, *error):
        self.over.set()
        self.hide()

    def show(self, name):
        """Write `name` as what is under way, from now on."""
        self.name = name
        if self.is_terminal:
            self.write("\r")

    def hide(self):
        """End the line, so that others may write; `show` begins a new one."""
        with self.lock:
            if self.all.begun or self.is_terminal:
                self.write("\n")
            self.name = None

    def finish(self):
        """End the line: all is done."""
        self.name, self.drawn = "done", 1.0
        self.hide()

    def go_on(self, name, sweep):
        """Count what begins next as of the sweep, and show `name` for it."""
        if sweep != self.sweep:
            self.foreseen.pop(self.sweep, None)  # it has ended
            self.sweep, self.current = sweep, _Amounts()
        self.show(name)

    def end_sweep(self):
        """Write a line for the sweep in a log; show that the driver computes."""
        if self.all.begun and not self.is_terminal:
            self.write("\n")
        self.show("computing")

    def begin(self, seconds, workers=1):
        """Add tiles of so many predicted CPU seconds, by workers that have no kernels yet."""
        self.foreseen[self.sweep] = max(0.0, self.foreseen.get(self.sweep, 0.0) - seconds)
        self.workers, self.warming = workers, self.clock()
        if self.all.batches:  # what the driver does between sweeps keeps them waiting
            self.working += self.warming - self.latest
        self.all.begun += seconds
        self.current.begun += seconds

    def warmed_up(self):
        """Note that a worker has its kernels."""
        if self.warming is not None:
            self.latest = self.clock()
            self.warm_up, self.warming = self.latest - self.warming, None

    def advance(self, seconds, used, wall):
        """Count tiles of so many predicted seconds, CPU seconds and wall seconds as done."""
        self.warmed_up()
        for amounts in self.all, self.current:
            amounts.done += seconds
            amounts.used += used
            amounts.batches += 1
        before, self.latest = self.latest, self.clock()
        self.wall += wall
        self.working += self.latest - before

    def studied(self, seconds):
        """Count so many predicted CPU seconds of the driver's own work as done."""
        seconds = min(seconds, self.after)
        self.after -= seconds
        self.all.begun += seconds
        self.all.done += seconds
        self.latest = self.clock()

    def part(self):
        """Return the part of the bar that is drawn: of predicted CPU seconds, those done."""
        total = self.all.begun + sum(self.foreseen.values()) + self.after
        self.drawn = max(self.drawn, self.all.done / total if total else 0.0)
        return self.drawn

    def remaining(self):
        """Estimate the seconds until the run has ended; None until a first batch has come in."""
        if not self.all.used:
            return None
        current, later = self.current, dict(self.foreseen)
        predicted = current.begun + later.pop(self.sweep, 0.0)
        trusted = _TRUST * predicted
        correction = (current.used + trusted) / (current.done + trusted) if predicted else 1.0
        left = correction * (predicted - current.done) + sum(later.values())
        # When a batch comes in, the other workers are halfway through theirs.
        in_flight = (self.workers - 1) / (2 * self.all.batches)
        pace = self.working / (self.all.used * (1 + in_flight))
        seconds = pace * left + self.wall / self.all.used * self.after
        loading = min(self.warm_up, _LOADING)
        seconds += loading * sum(amount > 0 for amount in later.values())
        since = self.clock() - self.latest
        return max(seconds - since, seconds / 4)  # what takes longer than expected still takes long

    def line(self):
        """Return what is to be written: bar, what is under way, times."""
        now, part, name = self.clock(), self.part(), self.name
        if self.warming is not None:
            is_long = now - self.warming > _LOADING
            name += ", compiling kernels (about 20 s, once)" if is_long else ", loading kernels"
        words = [f"{part:.0%}"] * bool(self.all.begun) + [f"elapsed {minutes(now - self.start)}"]
        if part < 1 and (remaining := self.remaining()) is not None:
            words.append(f"remaining about {minutes(max(1.0, remaining))}")
        line = f"{name}: {', '.join(words)}"
        if not self.is_terminal:
            return line
        if self.all.begun:
            full = round(_BAR * part)
            line = f"[{'#' * full}{'-' * (_BAR - full)}] {line}"
        width = shutil.get_terminal_size().columns - 1  # a line that wraps is not rewritten
        return line[:width].ljust(width)

    def write(self, end):
        """Write the line, if one is shown."""
        with self.lock:
            if self.name is not None and self.stream is not None:
                with suppress(OSError, ValueError):  # a full disk, or a closed log, ends no run
                    print(self.line(), end=end, file=self.stream, flush=True)

    def _keep_writing(self):
        interval, end = (0.5, "\r") if self.is_terminal else (10.0, "\n")
        while not self.over.wait(interval):
            self.write(end)


def minutes(seconds):
    """Return a time as a clock shows it: 0:29, 12:05, 1:02:03."""
    seconds = round(seconds)
    hours, seconds = divmod(seconds, 3600)
    words = f"{seconds // 60:02}:{seconds % 60:02}"
    return f"{hours}:{words}" if hours else words.removeprefix("0")


def plural(n, word, form=""):
    """Return a number of things in words: 1 tile, 0 tiles, 12 tiles."""
    return f"{n:{form}} {word}{'' if n == 1 else 's'}"


def duration(seconds):
    """Return a time in words: 45 s, 12 min, 3.2 h."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
