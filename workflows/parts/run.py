"""The run of a command: it holds the store, sweeps, writes, and says what it found and where it is.

Exit codes: 0 done; 1 tiles failed, or the workers are gone, or the disk or the object store failed;
2 bad input, nothing touched; 130 stopped by Ctrl-C.
"""

import os
import sys
from contextlib import contextmanager, nullcontext
from functools import cache, partial
from tempfile import TemporaryDirectory

import click
import numpy as np

from pipeline import store
from pipeline.cubes.cube import Cube
from pipeline.sweep.cluster import ClusterError, connect, credentials
from pipeline.sweep.grid import tile_slices
from pipeline.sweep.progress import Progress, duration
from pipeline.sweep.sweep import sweep
from workflows.figures.style import save
from workflows.parts.cli import announce_kernels
from workflows.parts.tables import write

MAX_REASONS = 10  # failed tiles whose reasons are printed
_PROBES = 10  # tiles that a first estimate of a sweep's time looks at


def place_of(out, url=None):
    """Return the Place of the cubes: the URL if there is one, or else the directory `out`."""
    try:
        return store.place_of(url or out)
    except store.Refused as error:
        raise click.UsageError(str(error)) from None


class Run:
    """The run of one command: it writes cubes into its place, tables and figures into OUT.

    out : directory of tables and figures.
    place : Place of the cubes.
    cluster : arguments of `cluster.connect`.
    """

    def __init__(self, out, place, cluster=None):
        self.out, self.place, self.cluster = out, place, cluster
        self.client, self.started = None, False
        self.sweeps, self.begun = 1, {}
        self.line, self.expected = None, {}
        self.words, self.written = [], {}

    @contextmanager
    def driving(self):
        """Hold the place as its one driver; at the end print what was found, and where it is."""
        with explained(self.place), store.driving(self.place):
            self.started = True
            os.makedirs(self.out, exist_ok=True)
            announce_kernels()
            yield self
        self._finish()

    @contextmanager
    def sweeping(self, *jobs, sweeps=None):
        """As `driving`, with workers for the sweeps; refuse a place with other settings first.

        sweeps : how many there will be, if that is not one for each job.
        """
        self.sweeps = sweeps or len(jobs)
        with explained(self.place):
            for job in jobs:
                self.check(job.cube)
            with connect(**self.cluster) as client, self.driving():
                self.client = partial(_told, client, self.cluster.get("scheduler"))
                if self.sweeps > 1:
                    self._foresee(jobs)
                yield self

    def _foresee(self, jobs):
        """Say how long the sweeps will take that are planned, and count them on the line."""
        self.line = Progress("all sweeps", sys.stderr)
        # A composed cube has the levels of refinement as sweeps, which depend on one another.
        known = [job for job in jobs if "levels" not in job.cube.settings]
        self.expected = {job.cube.name: _expected(self.place, job) for job in known}
        tiles, seconds = np.sum([(0, 0), *self.expected.values()], axis=0)
        self.line.begin(int(tiles), seconds)
        if seconds > 0:
            words = f"{len(known)} of {self.sweeps} sweeps are planned: {tiles:.0f} tiles"
            click.echo(f"{words}, about {duration(seconds)} of CPU time", err=True)

    def check(self, cube):
        """Refuse to go on if the place holds this cube with other settings."""
        store.check(self.place, cube, store.computed_by())

    def sweep(self, job, wanted=None, line_stays=False):
        """Compute the missing tiles of the job's cube, or those `wanted`; return it as a Dataset.

        `line_stays`: the next sweep goes on with its line. The program ends if tiles fail, and on
        Ctrl-C.
        """
        name = job.cube.name
        number = self.begun.setdefault(name, len(self.begun) + 1)
        if self.line:
            self.line.name = f"sweep {number} of {self.sweeps}, {name}"
            self.line.begin(*(-foreseen for foreseen in self.expected.pop(name, (0, 0))))
        with self.line if self.line and not line_stays else nullcontext():
            outcome = sweep(self.client, self.place, job, wanted, self.line)
        _go_on(outcome)
        self._note("cubes", self.place.cube(name))
        return store.read(self.place, name)

    def keep(self, name, dataset, tile=None, **settings):
        """Write a cube that no sweep computes, whole; return it as a Dataset."""
        cube = Cube(name, dataset, tile or {}, settings)
        store.replace(self.place, cube, store.computed_by())
        self._note("cubes", self.place.cube(name))
        return dataset.assign_attrs(settings)

    def table(self, name, dataset):
        """Write a Dataset as OUT/NAME.csv."""
        write(dataset, self.path("tables", f"{name}.csv"))

    def figure(self, name, figure, caption=""):
        """Write OUT/NAME.png and .pdf, and the caption beside them; the caption is printed too."""
        for path in save(figure, self.out, name, caption):
            self._note("figures", path)
        self.say(caption)

    def path(self, kind, name):
        """Return the path OUT/NAME of a file, named at the end among those of its kind."""
        return self._note(kind, f"{self.out}/{name}")

    def say(self, words):
        """Print a finding at the end, before the paths."""
        self.words.append(words)

    def _note(self, kind, path):
        self.written.setdefault(kind, {})[path] = None  # once, in order
        return path

    def _finish(self):
        for line in "\n".join(self.words).splitlines():
            click.echo(click.wrap_text(line, 100))
        for kind, paths in self.written.items():
            click.echo(f"{kind + ':':9}{', '.join(paths)}")


@contextmanager
def explained(place):
    """End the program with one line and exit code 2 or 1 for what the user can mend."""
    try:
        with store.explained(place):
            yield
    except (store.Refused, ClusterError) as error:
        raise click.UsageError(str(error)) from None
    except store.StoreFailed as fault:
        again = "What is committed stays; run the same command again to resume"
        raise click.ClickException(f"{fault}. {again}") from None
    except OSError as error:  # no workers, or no room for a table
        raise click.ClickException(str(error)) from None


@cache
def _told(connect, scheduler):
    """Connect to the workers, and say that they are waited for."""
    words = "starting workers on this machine" if scheduler is None else "connecting to the workers"
    click.echo(words, err=True)
    return connect()


@contextmanager
def shared_workers(scheduler, n_workers, tls):
    """Yield the options by which several commands, run in turn, compute on the same workers."""
    if scheduler is not None:
        yield ["--scheduler", scheduler, *(["--tls", *tls] if tls else [])]
        return
    with connect(n_workers=n_workers) as client, TemporaryDirectory() as folder:
        tls = credentials(client(), folder)
        yield ["--scheduler", client().scheduler.address, "--tls", *tls]


def _expected(place, job):
    """Return how many tiles of the job's cube are missing, and the CPU seconds predicted for them.

    By some of these tiles.
    """
    cube = job.cube
    begun = cube.name in store.names(place)
    tiles = store.missing(place, cube) if begun else np.argwhere(np.ones(store.tile_counts(cube)))
    axes = {dim: cube.template[dim].values for dim in cube.sizes if dim in cube.template.coords}
    costs = [0.0]
    for index in tiles[:: -(-len(tiles) // _PROBES) or 1].tolist():
        cells = tile_slices(index, cube.sizes, cube.tile)
        coords = {dim: axis[cells.get(dim, slice(None))] for dim, axis in axes.items()}
        costs.append(float(job.predict(coords, cube.settings)))
    return len(tiles), len(tiles) * sum(costs) / max(1, len(costs) - 1)


def _go_on(outcome):
    """Go on after a complete sweep; after any other end the program and say how to resume."""
    failed = sorted(outcome.failed.items())
    for index, reason in failed[:MAX_REASONS]:
        click.echo(f"tile {index} failed: {reason}", err=True)
    if len(failed) > MAX_REASONS:
        click.echo(f"... and {len(failed) - MAX_REASONS} more", err=True)
    if outcome.interrupted:
        missing = f"stopped with {outcome.remaining} tiles of this sweep missing"
        click.echo(f"{missing}; run the same command again to resume", err=True)
        sys.exit(130)
    if failed:
        missing = f"{len(failed)} tiles failed and stay missing"
        click.echo(f"{missing}; run the same command again to retry them", err=True)
        sys.exit(1)
