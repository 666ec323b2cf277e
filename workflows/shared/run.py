"""The run of a command: it locks the store, sweeps, and writes tables, figures and findings.

Exit codes: 0 success; 1 tiles or figures failed, or the workers were lost, or the disk or the
object store failed; 2 bad input, nothing was changed; 130 stopped by Ctrl-C.
"""

import hashlib
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NoReturn

import click
import numpy as np
import xarray as xr
from dask.system import CPU_COUNT

from pipeline import store
from pipeline.cubes.cube import Cube, Job
from pipeline.sweep.cluster import connect, write_credentials
from pipeline.sweep.estimate import Estimate, estimate
from pipeline.sweep.fill import Interrupted, TilesFailed, compute_missing, connected
from pipeline.sweep.progress import Progress, duration, plural
from workflows.figures.style import drawn
from workflows.shared.cli import command_line
from workflows.shared.places import usage_errors
from workflows.shared.tables import write

Wanted = set[tuple[int, ...]] | None
"""Indices of tiles; None for all."""

MAX_REASONS = 10  # maximum number of failed tiles whose reasons are printed
_MIN_ANNOUNCED_SECONDS = 5  # a run is announced if its predicted CPU time is longer
_DRAWING_SECONDS = 7  # typical CPU time of findings, of one or two figures, and of stopping workers
LONGEST = 600  # seconds that a run may take without --yes

# Cubes without tiles depend on the mathematics and on this package, except its figures, which
# only draw what the cubes contain.
_FOLDER = Path(__file__).parents[1]
_SOURCES = sorted([*_FOLDER.glob("**/*.py"), *_FOLDER.glob("**/*.toml")])
_STUDIES = b"".join(path.read_bytes() for path in _SOURCES if path.parent.name != "figures")
_CODE = {  # attributes of cubes without tiles
    "computed_by": store.COMPUTED_BY,
    "studied_by": f"workflows {hashlib.sha256(_STUDIES).hexdigest()[:12]}",
}


class Run:
    """The run of one command: its files, and the cubes that it keeps or sweeps at a Place.

    Parameters
    ----------
    out : str or Path
        Directory for tables and figures; it must exist by the time something is written.
    place : Place
        Place where the cubes are stored.
    cluster : dict
        Arguments of `cluster.connect`.
    dry : bool
        Print what would be computed, and exit.
    column : bool
        Draw figures for one journal column.
    quiet : bool
        Print no progress.
    shorter : str, optional
        Advice on how to shorten the run. If it is given, a run that is predicted to take longer
        than LONGEST is refused; otherwise any run is allowed.
    """

    line: Progress

    def __init__(
        self,
        out: str | Path,
        place: store.Place,
        cluster: dict[str, Any],
        dry: bool,
        column: bool = False,
        quiet: bool = False,
        shorter: str | None = None,
    ) -> None:
        self.out, self.quiet, self.column = out, quiet, column
        self.findings: list[str] = []
        self.written: dict[str, dict[str, None]] = {}
        self.figures: dict[str, tuple[Callable[[], Any], str]] = {}
        self.place, self.cluster, self.dry, self.shorter = place, cluster, dry, shorter
        self.client: Any = None
        self.started = False
        self.plan: dict[str, Estimate] = {}
        self.begun: dict[str, int] = {}
        self.studies: dict[str, float] = {}

    @contextmanager
    def driving(
        self, *studies: tuple[Cube, float], drawing: float = _DRAWING_SECONDS
    ) -> Iterator["Run"]:
        """Lock the place against other runs; at the end print the findings and draw the figures.

        Parameters
        ----------
        studies : (Cube, float)
            Each cube that `kept` will compute without sweeps, and its approximate CPU seconds.
        drawing : float
            Approximate CPU seconds of findings and figures.
        """
        with usage_errors(self.place):
            self.studies = {cube.name: cost for cube, cost in studies if not self.holds(cube)}
            seconds = sum(self.studies.values())
            self._announce(seconds)
            with store.driver_lock(self.place):
                self.started = True
                os.makedirs(self.out, exist_ok=True)
                predicted = {name: cpu for name, (*_, cpu) in self.plan.items()}
                stream = None if self.quiet else sys.stderr
                after = seconds + drawing
                with Progress("computing", stream, predicted, after) as self.line:
                    yield self
                    self.line.hide()
                    for line in "\n".join(self.findings).splitlines():
                        click.echo(click.wrap_text(line, 100))
                    for kind, paths in self.written.items():
                        _echo_paths(kind, paths)
                    self._draw()

    @contextmanager
    def sweeping(
        self,
        *jobs: Job,
        later: Iterable[tuple[Job, Wanted]] = (),
        studies: Iterable[tuple[Cube, float]] = (),
        drawing: float = _DRAWING_SECONDS,
    ) -> Iterator["Run"]:
        """Do what `driving` does and connect to workers; first refuse cubes whose settings differ.

        Parameters
        ----------
        jobs : Job
            Jobs of the sweeps.
        later : iterable of (Job, set of tiles or None)
            Sweeps that depend on the results of `jobs`: for each, a job of about the same cost,
            and the tiles that will be wanted, or None for all.
        studies, drawing
            As for `driving`.
        """
        with usage_errors(self.place):
            for job in jobs:
                self.check(job.cube, job.code.computed_by)
            for job, wanted in [*((job, None) for job in jobs), *later]:
                self.plan[job.cube.name] = estimate(job, self.place, wanted)
            workers = connect(**self.cluster, without_scipy=True)
            with workers as client, self.driving(*studies, drawing=drawing):
                is_local = self.cluster.get("scheduler") is None
                self.client = cache(partial(connected, client, self.line, is_local))
                yield self

    def _announce(self, serial: float) -> None:
        """Print the predicted time; end the program after a dry run, or if the run is too long.

        serial : CPU seconds of the computations outside the sweeps, which one process performs.
        """
        total = np.sum([(0, 0, 0, serial), *self.plan.values()], axis=0)
        if self.dry:
            for name, (tiles, files, size, seconds) in {
                **self.plan,
                "in all": tuple(total),
            }.items():
                n_tiles, n_files = plural(tiles, "tile", "8.0f"), plural(files, "file", "9.0f")
                hours = f"{seconds / 3600:.2g} CPU hours"
                click.echo(f"{name:24} {n_tiles:14} {n_files:15} {size:9.3g} MB {hours:>18}")
            sys.exit()
        tiles, _, _, seconds = total
        workers = self.cluster.get("n_workers") or CPU_COUNT
        elapsed = serial + (seconds - serial) / workers
        if self.shorter is not None and elapsed > LONGEST:
            raise click.UsageError(
                f"predicted to take {duration(elapsed)} on {plural(workers, 'core')} "
                f"({duration(seconds)} of CPU time), more than {duration(LONGEST)}. To shorten the "
                f"run, {self.shorter}. To run it anyway, add --yes"
            )
        if seconds > _MIN_ANNOUNCED_SECONDS:
            swept = plural(len(self.plan), "sweep"), plural(tiles, "tile", ".0f")
            parts = [*swept * bool(self.plan), f"about {duration(seconds)} of CPU time"]
            self.tell(", ".join(parts))

    def tell(self, message: str) -> None:
        """Print a message on stderr, unless this run is quiet."""
        if not self.quiet:
            click.echo(message, err=True)

    def check(self, cube: Cube, computed_by: str | None = None) -> dict[str, Any]:
        """Return the attributes of the cube in the place; {} if the place has no such cube.

        A cube with different settings is refused. computed_by : `code.computed_by` of the cube's
        job, if a job computes the cube.
        """
        return store.check(self.place, cube, computed_by or store.COMPUTED_BY)

    def sweep(self, job: Job, wanted: Wanted = None) -> xr.Dataset:
        """Compute the missing tiles of the job's cube, or only those in `wanted`; return the cube.

        If tiles fail, or on Ctrl-C, the program ends and prints how to resume.
        """
        name = job.cube.name
        number = self.begun.setdefault(name, len(self.begun) + 1)
        self.line.begin_sweep(f"sweep {number} of {len(self.plan)}, {name}", name)
        try:
            cube = compute_missing(self.client, self.place, job, self.line, wanted, command_line())
        except (TilesFailed, Interrupted) as stop:
            self._end(stop)
        self.line.end_sweep()
        self.note("cubes", self.place.cube(name))
        return cube

    def _end(self, stop: TilesFailed | Interrupted) -> NoReturn:
        """Print why tiles are missing, and end the program."""
        self.line.end_sweep()
        self.line.hide()
        failed = sorted(stop.failed.items())
        for index, reason in failed[:MAX_REASONS]:
            click.echo(f"tile {index} failed: {reason}", err=True)
        if len(failed) > MAX_REASONS:
            click.echo(f"... and {len(failed) - MAX_REASONS} more", err=True)
        if isinstance(stop, Interrupted):
            missing = f"stopped; {plural(stop.remaining, 'tile')} of this sweep missing"
            click.echo(f"{missing}; run the same command again to resume", err=True)
            sys.exit(130)
        missing = f"{plural(len(failed), 'tile')} failed"
        click.echo(f"{missing}; run the same command again to retry", err=True)
        sys.exit(1)

    def holds(self, cube: Cube, *parts: str) -> bool:
        """Return whether the place holds an undamaged cube that this version of the code wrote.

        A cube with different settings is refused.

        Parameters
        ----------
        cube : Cube
            As for `kept`.
        parts : str
            Names of the sweeps from which the cube was made; none of their tiles may be missing.
        """
        attributes = self.check(cube)
        if any(attributes.get(name) != by for name, by in _CODE.items()):
            return False
        if parts:  # otherwise the store need not be listed
            known = [state for state in store.status(self.place) if not state.damage]
            done = {state.name for state in known if state.done >= state.tiles}
            if not done.issuperset(parts):
                return False
        return not any(store.verify(self.place, cube.name))

    def kept(self, cube: Cube, compute: Callable[[], xr.Dataset], *parts: str) -> xr.Dataset:
        """Return a cube that needs no sweep; compute it unless the place `holds` it.

        Parameters
        ----------
        cube : Cube
            The cube's name and all settings that determine it, from `pipeline.cubes.cube.untiled`.
        compute : callable
            () → Dataset; called if the place does not hold the cube, which is then written.
        parts : str
            As for `holds`.
        """
        if not self.holds(cube, *parts):
            filled = replace(cube, template=compute().assign_attrs(studied_by=_CODE["studied_by"]))
            store.replace(self.place, filled, store.COMPUTED_BY, command_line())
            self.line.count_study(self.studies.get(cube.name, 0))
        self.note("cubes", self.place.cube(cube.name))
        return store.read(self.place, cube.name).load()

    def table(self, name: str, dataset: xr.Dataset) -> None:
        """Write a Dataset as OUT/NAME.csv."""
        write(dataset, self.path("tables", f"{name}.csv"))

    def figure(self, name: str, draw: Callable[..., Any], *data: Any, caption: str = "") -> None:
        """Schedule `draw(*data)` for OUT/NAME.png and .pdf, with the caption in a file beside them.

        Figures are drawn at the end of the run, when all captions have been printed.
        """
        self.figures[name] = partial(draw, *data), caption
        self.say(caption)

    def _draw(self) -> None:
        """Draw all figures, and end the program with code 1 if one cannot be drawn."""
        if self.figures:
            self.line.show("drawing figures")
        paths: list[str] = []
        reasons: list[str] = []
        for name, (draw, caption) in self.figures.items():
            saved, reason = drawn(draw, self.out, name, caption, column=self.column)
            paths += saved
            reasons += [reason] if reason else []
        self.line.finish()
        if paths:
            _echo_paths("figures", paths)
        if reasons:
            raise click.ClickException("\n".join(reasons))

    def path(self, kind: str, name: str) -> str:
        """Return the path OUT/NAME of a file, and list it at the end among files of its kind."""
        return self.note(kind, f"{self.out}/{name}")

    def say(self, finding: str) -> None:
        """Print a finding at the end, before the paths."""
        self.findings.append(finding)

    def note(self, kind: str, path: str) -> str:
        """List a path at the end, among paths of its kind; return the path."""
        self.written.setdefault(kind, {})[path] = None  # a dict keeps each path once, in order
        return path


def _echo_paths(kind: str, paths: Iterable[str]) -> None:
    click.echo(f"{kind + ':':9}{', '.join(paths)}")


@contextmanager
def shared_workers(
    scheduler: str | None, n_workers: int | None, tls: tuple[str, str, str] | None
) -> Iterator[list[str]]:
    """Yield the options that let several commands, run in turn, share the same workers."""
    if scheduler is not None:
        yield ["--scheduler", scheduler, *(["--tls", *tls] if tls else [])]
        return
    workers = connect(n_workers=n_workers, without_scipy=True)
    with workers as client, TemporaryDirectory() as folder:
        files = write_credentials(client(), folder)
        yield ["--scheduler", client().scheduler.address, "--tls", *files]
