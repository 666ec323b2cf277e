"""The run of a command: it holds the store, sweeps, and writes tables, figures and findings.

Exit codes: 0 done; 1 tiles or figures failed, or the workers are gone, or the disk or the object
store failed; 2 bad input, nothing touched; 130 stopped by Ctrl-C.
"""

import hashlib
import os
import sys
import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from dask.system import CPU_COUNT

from pipeline import store
from pipeline.sweep.cluster import ClusterError, connect, write_credentials
from pipeline.sweep.grid import tile_coords
from pipeline.sweep.progress import Progress, duration, plural
from pipeline.sweep.sweep import COMMIT_SECONDS, sweep
from workflows.figures.style import drawn
from workflows.shared.tables import write

MAX_REASONS = 10  # failed tiles whose reasons are printed
_PROBING = 0.3  # CPU seconds for which an estimate of a sweep's time looks at its tiles
_LONG = 5  # CPU seconds of work that are announced
_DRAWING = 2  # CPU seconds, as of a run with one or two figures
LONGEST = 600  # seconds that a run may take if it is not said that it may take longer

# What decides cubes without tiles: besides the mathematics all of this package but the figures,
# which draw what the cubes hold.
_FOLDER = Path(__file__).parents[1]
_SOURCES = sorted([*_FOLDER.glob("**/*.py"), *_FOLDER.glob("**/*.toml")])
_STUDIES = b"".join(path.read_bytes() for path in _SOURCES if path.parent.name != "figures")
_CODE = {  # attributes of these cubes
    "computed_by": store.COMPUTED_BY,
    "studied_by": f"workflows {hashlib.sha256(_STUDIES).hexdigest()[:12]}",
}


def place_of(out, url=None):
    """Return the Place of the cubes: the URL if there is one, or else the directory `out`."""
    with usage_errors(url or out):
        return store.place_of(url or out)


@contextmanager
def runs_of(out, url):
    """Yield the Places in `out`, or at the URL, that hold cubes, by what tells their names apart.

    {path below `out`, with a / at its end: Place}; the path of `out` itself is "". Of a directory
    these are all folders in it. A usage error if there are none.
    """
    with usage_errors(place := place_of(out, url)):
        places = {"": place}
        if place.is_directory:
            places |= {f"{path}/": store.place_of(f"{place}/{path}") for path in _folders(place)}
        runs = {path: each for path, each in places.items() if store.names(each)}
        if not runs:
            raise store.Refused(f"{place} holds no cubes; give the --out or --store of a run")
        yield runs


def _folders(place):
    """Return the paths of the folders below a directory, of cubes and in them excepted."""
    found = []
    for folder, below, _ in os.walk(place.root):
        below[:] = sorted(name for name in below if not name.endswith(".zarr"))
        found += [os.path.relpath(os.path.join(folder, name), place.root) for name in below]
    return found


class Run:
    """The run of one command: what it writes, and the cubes that it keeps or sweeps in its place.

    out : directory of tables and figures; it must exist when something is written.
    place : Place of the cubes.
    cluster : arguments of `cluster.connect`.
    dry : only say what would be computed, and end.
    column : draw figures for a column of a journal.
    quiet : write no progress.
    shorter : by which options it takes less time, in words: it ends before it begins if it is
        predicted to take longer than LONGEST. None if it may.
    """

    def __init__(self, out, place, cluster, dry, column=False, quiet=False, shorter=None):
        self.out, self.words, self.written = out, [], {}
        self.quiet = quiet
        self.figures, self.column = {}, column
        self.place, self.cluster, self.dry, self.shorter = place, cluster, dry, shorter
        self.client, self.started = None, False
        self.plan, self.begun, self.studies = {}, {}, {}

    @contextmanager
    def driving(self, *studies, drawing=_DRAWING):
        """Hold the place as its one driver; at the end print what was found, and where it is, and
        then draw the figures.

        studies : what is computed without sweeps, (Cube as `kept` takes it, CPU seconds, about).
        drawing : CPU seconds in which findings are put into words and figures drawn, about.
        """
        with usage_errors(self.place):
            self.studies = {cube.name: cost for cube, cost in studies if not self.holds(cube)}
            seconds = sum(self.studies.values())
            self._announce(seconds)
            with store.driver_lock(self.place):
                self.started = True
                os.makedirs(self.out, exist_ok=True)
                foreseen = {name: cpu for name, (*_, cpu) in self.plan.items()}
                stream = None if self.quiet else sys.stderr
                after = seconds + drawing
                with Progress("computing", stream, foreseen, after) as self.line:
                    yield self
                    self.line.hide()
                    for line in "\n".join(self.words).splitlines():
                        click.echo(click.wrap_text(line, 100))
                    for kind, paths in self.written.items():
                        _echo_paths(kind, paths)
                    self._draw()

    @contextmanager
    def sweeping(self, *jobs, later=(), studies=(), drawing=_DRAWING):
        """As `driving`, with workers for the sweeps; refuse a place with other settings first.

        jobs : the Jobs of sweeps.
        later : of further sweeps, which depend on the results of these: (Job that costs about as
            much, the set of tiles that it will want, or None for all).
        """
        with usage_errors(self.place):
            for job in jobs:
                self.check(job.cube)
            for job, wanted in [*((job, None) for job in jobs), *later]:
                self.plan[job.cube.name] = _expected(self.place, job, wanted)
            with connect(**self.cluster) as client, self.driving(*studies, drawing=drawing):
                self.client = cache(partial(self._connected, client))
                yield self

    def _announce(self, besides):
        """Say how long it will take; end the program here if this is all that was asked for, or if
        it would take too long.

        besides : CPU seconds of what is not swept, and so computed by one process.
        """
        total = np.sum([(0, 0, 0, besides), *self.plan.values()], axis=0)
        if self.dry:
            for name, (tiles, files, size, seconds) in {**self.plan, "in all": total}.items():
                n_tiles, n_files = plural(tiles, "tile", "8.0f"), plural(files, "file", "9.0f")
                hours = f"{seconds / 3600:.2g} CPU hours"
                click.echo(f"{name:24} {n_tiles:14} {n_files:15} {size:9.3g} MB {hours:>18}")
            sys.exit()
        tiles, _, _, seconds = total
        workers = self.cluster.get("n_workers") or CPU_COUNT
        elapsed = besides + (seconds - besides) / workers
        if self.shorter is not None and elapsed > LONGEST:
            raise click.UsageError(
                f"predicted to take {duration(elapsed)} on {plural(workers, 'core')}, "
                f"{duration(seconds)} of CPU time, which is more than {duration(LONGEST)}. To "
                f"shorten it, {self.shorter}. To run it as it is, add --yes"
            )
        if seconds > _LONG:
            swept = plural(len(self.plan), "sweep"), plural(tiles, "tile", ".0f")
            parts = [*swept * bool(self.plan), f"about {duration(seconds)} of CPU time"]
            self.tell(", ".join(parts))

    def tell(self, words):
        """Print what is under way, unless this run is quiet."""
        if not self.quiet:
            click.echo(words, err=True)

    def check(self, cube):
        """Refuse to go on if the place holds this cube with other settings; true if it is there."""
        return store.check(self.place, cube, store.COMPUTED_BY)

    def _connected(self, connect):
        """Connect to the workers; show that they, and their kernels, are waited for."""
        shown = self.line.name
        here = self.cluster.get("scheduler") is None
        self.line.show("starting workers on this machine" if here else "connecting to the workers")
        client = connect()
        self.line.show(shown)
        return client

    def sweep(self, job, wanted=None):
        """Compute the missing tiles of the job's cube, or those `wanted`; return it as a Dataset.

        The program ends if tiles fail, and on Ctrl-C, and says how to resume.
        """
        name = job.cube.name
        number = self.begun.setdefault(name, len(self.begun) + 1)
        self.line.begin_sweep(f"sweep {number} of {len(self.plan)}, {name}", name)
        outcome = sweep(self.client, self.place, job, self.line, wanted)
        self.line.end_sweep()
        if outcome.failed or outcome.interrupted:
            self.line.hide()
        failed = sorted(outcome.failed.items())
        for index, reason in failed[:MAX_REASONS]:
            click.echo(f"tile {index} failed: {reason}", err=True)
        if len(failed) > MAX_REASONS:
            click.echo(f"... and {len(failed) - MAX_REASONS} more", err=True)
        if outcome.interrupted:
            missing = f"stopped with {plural(outcome.remaining, 'tile')} of this sweep missing"
            click.echo(f"{missing}; run the same command again to resume", err=True)
            sys.exit(130)
        if failed:
            missing = f"not computed, as they failed: {plural(len(failed), 'tile')}"
            click.echo(f"{missing}; run the same command again to retry", err=True)
            sys.exit(1)
        self.note("cubes", self.place.cube(name))
        return store.read(self.place, name)

    def holds(self, cube, *parts):
        """Tell whether the place holds a cube that `kept` wrote, sound, and by the code as it is.

        parts : names of the sweeps that it was made from, of which no tile may be missing.
        A usage error if the cube has other settings.
        """
        here = self.check(cube)
        if any(here.get(name) != by for name, by in _CODE.items()):
            return False
        if parts:  # else the store need not be listed
            known = [state for state in store.status(self.place) if not state.damage]
            done = {state.name for state in known if state.done >= state.tiles}
            if not done.issuperset(parts):
                return False
        return not any(store.verify(self.place, cube.name))

    def kept(self, cube, compute, *parts):
        """Return a cube that no sweep computes, as a Dataset: as the place `holds` it, or else
        computed, and written whole.

        cube : its name and all settings that decide it, by `pipeline.cubes.cube.untiled`.
        compute : () → Dataset.
        """
        if not self.holds(cube, *parts):
            filled = replace(cube, template=compute().assign_attrs(studied_by=_CODE["studied_by"]))
            store.replace(self.place, filled, store.COMPUTED_BY)
            self.line.count_study(self.studies.get(cube.name, 0))
        self.note("cubes", self.place.cube(cube.name))
        return store.read(self.place, cube.name).load()

    def table(self, name, dataset):
        """Write a Dataset as OUT/NAME.csv."""
        write(dataset, self.path("tables", f"{name}.csv"))

    def figure(self, name, draw, *data, caption=""):
        """Have `draw(*data)` drawn at the end, as OUT/NAME.png and .pdf with the caption beside
        them; the caption is printed before."""
        self.figures[name] = partial(draw, *data), caption
        self.say(caption)

    def _draw(self):
        """Draw all figures, and end the program with code 1 if one cannot be drawn."""
        if self.figures:
            self.line.show("drawing figures")
        paths, reasons = [], []
        for name, (draw, caption) in self.figures.items():
            saved, reason = drawn(draw, self.out, name, caption, column=self.column)
            paths += saved
            reasons += [reason] if reason else []
        self.line.finish()
        if paths:
            _echo_paths("figures", paths)
        if reasons:
            raise click.ClickException("\n".join(reasons))

    def path(self, kind, name):
        """Return the path OUT/NAME of a file, named at the end among those of its kind."""
        return self.note(kind, f"{self.out}/{name}")

    def say(self, words):
        """Print a finding at the end, before the paths."""
        self.words.append(words)

    def note(self, kind, path):
        """Have the path named after what was found, among those of its kind; return it."""
        self.written.setdefault(kind, {})[path] = None  # once, in order
        return path


def _echo_paths(kind, paths):
    click.echo(f"{kind + ':':9}{', '.join(paths)}")


@contextmanager
def usage_errors(place):
    """End the program with one line and exit code 2 or 1 for what the user can mend."""
    try:
        with store.store_errors(place):
            yield
    except (store.Refused, ClusterError) as error:
        raise click.UsageError(store.printable(str(error))) from None
    except store.StoreFailed as fault:
        words = f"{fault}. What is committed stays; run the same command again to resume"
        raise click.ClickException(store.printable(words)) from None
    except OSError as error:  # no workers, or no room for a table
        raise click.ClickException(str(error)) from None


@contextmanager
def shared_workers(scheduler, n_workers, tls):
    """Yield the options by which several commands, run in turn, compute on the same workers."""
    if scheduler is not None:
        yield ["--scheduler", scheduler, *(["--tls", *tls] if tls else [])]
        return
    with connect(n_workers=n_workers) as client, TemporaryDirectory() as folder:
        tls = write_credentials(client(), folder)
        yield ["--scheduler", client().scheduler.address, "--tls", *tls]


def _expected(place, job, wanted):
    """Return what is to be computed of the job's cube: tiles, files, MB, CPU seconds.

    The seconds are predicted from some of the tiles. wanted : set of tiles, or None for all.
    """
    cube = job.cube
    tiles = np.argwhere(np.ones(cube.tile_counts))
    with suppress(store.Refused):  # the place does not exist, or the cube was deleted under way
        if cube.name in store.names(place):
            tiles = store.missing(place, cube)
    if wanted is not None:
        tiles = tiles[[tuple(index) in wanted for index in tiles.tolist()]]
    costs, end = [], time.thread_time() + _PROBING
    for _, coords in tile_coords(cube, np.random.default_rng(0).permutation(tiles)):
        costs.append(float(job.predict(coords, cube.settings)))
        if time.thread_time() > end:
            break
    files = len(tiles) * (len(cube.computed) + 1)  # the commit record is one, too
    size = cube.template.nbytes / 1e6 * len(tiles) / prod(cube.tile_counts)
    return len(tiles), files, size, len(tiles) * (sum(costs) / max(1, len(costs)) + COMMIT_SECONDS)
