"""The command line that all commands share: options, the run of a command, and how it ends.

Exit codes: 0 done; 1 tiles failed, or the workers are gone, or the disk or the object store failed;
2 bad input, nothing touched; 130 stopped by Ctrl-C.

Heavy imports wait until the options are parsed, so that --help comes at once.
"""

import functools
import os
import sys
from contextlib import contextmanager
from importlib import import_module

import click

MAX_REASONS = 10  # failed tiles whose reasons are printed


def command(**settings):
    """Make a function a click command; Ctrl-C before or after its sweeps ends it with code 130."""

    def decorate(function):
        @click.command(context_settings={"help_option_names": ["-h", "--help"], **settings})
        @functools.wraps(function)
        def wrapped(**options):
            try:
                return function(**options)
            except KeyboardInterrupt:
                click.echo("abandoned; run the same command again to resume", err=True)
                sys.exit(130)

        return wrapped

    return decorate


def main_of(name):
    """Return the click command of `workflows.NAME`, a module or a package."""
    module = import_module(f"workflows.{name}")
    return getattr(module, "main", None) or import_module(f"{module.__name__}.__main__").main


def together(*options):
    """Make one decorator of several options; --help shows them in this order."""
    return lambda function: functools.reduce(lambda f, option: option(f), options[::-1], function)


def whole(name, default, low, high, help):
    """Make an option that takes a whole number from low to high."""
    kind = click.IntRange(low, high)
    return click.option(name, default=default, show_default=True, type=kind, help=help)


def real(name, default, low, high, help, multiple=False):
    """Make an option that takes a number from low to high; `multiple` lets it be repeated."""
    kind = click.FloatRange(low, high)
    return click.option(
        name, default=default, show_default=True, type=kind, help=help, multiple=multiple
    )


def parsed(name, default, parse, metavar, help, multiple=False):
    """Make an option whose text, or tuple of texts, `parse` reads or refuses by ValueError."""

    def callback(context, parameter, text):
        try:
            return parse(text)
        except ValueError as error:
            raise click.BadParameter(str(error)) from None

    return click.option(
        name,
        default=default,
        show_default=True,
        metavar=metavar,
        callback=callback,
        help=help,
        multiple=multiple,
    )


def axis(name, default, help):
    """Make an option LO:HI:N that gives a grid.Axis."""

    def parse(text):
        from pipeline.sweep.grid import parse_axis

        return parse_axis(text)

    return parsed(name, default, parse, "LO:HI:N", help)


def increasing(name, default, largest, help):
    """Make an option N[,N...] that gives a list of increasing whole numbers from 1, or None."""

    def parse(text):
        if text is None:
            return None
        numbers = [int(number) if number.isdecimal() else 0 for number in text.split(",")]
        if sorted(set(numbers)) != numbers or numbers[0] < 1 or numbers[-1] > largest:
            raise ValueError(
                f"{text!r} must be increasing whole numbers from 1 to {largest}, e.g. 100,1000"
            )
        return numbers

    return parsed(name, default, parse, "N[,N...]", help)


def ray_options(default):
    """--angles and --tips, the rays of the upper half plane."""
    return together(
        whole("--angles", default, 2, 10**6, "Rays, from 0 to 180 degrees."),
        whole("--tips", 8, 0, 1000, "More rays on each side of the cusps at 45 and 135 degrees."),
    )


def plane_options(kappa1, kappa2, n_max, n_orbits, tile, levels):
    """The options of a plane of escape times, as `parts.plane.plane_of` takes them."""
    return together(
        axis("--kappa1", kappa1, "First kick's strength: lower end, upper end, cells."),
        axis("--kappa2", kappa2, "Second kick's strength, likewise."),
        whole("--n-max", n_max, 1, 10**12, "Steps of two kicks up to which orbits are followed."),
        increasing(
            "--n-orbits", str(n_orbits), 10**8, "Orbits; several numbers: nested ensembles."
        ),
        whole("--tile", tile, 1, 4096, "Cells along each side of a tile, the unit of work."),
        whole("--levels", levels, 1, 12, "Levels of refinement; 1 computes every cell."),
        increasing(
            "--follow",
            None,
            10**12,
            "Refine along, and draw, the boundaries {n* <= N} of these N.  [default: n-max]",
        ),
    )


quick_option = click.option("--quick", is_flag=True, help="A preview: less, and shorter, of all.")


def _directory(context, parameter, out):
    if "://" in out:  # the message does not repeat a URL, which may hold a password
        raise click.UsageError(
            "--out is a directory, for tables and figures too; only the cubes of a sweep can be "
            "elsewhere, by --store URL"
        )
    return out


def _url(context, parameter, store):
    if store is not None and "://" not in store:
        raise click.BadParameter("--store is a URL, s3://BUCKET/PREFIX; a directory goes to --out")
    return store


out_option = click.option(
    "--out",
    default="out",
    show_default=True,
    callback=_directory,
    help="Directory of the results; an earlier run in it is resumed.",
)
store_option = click.option(
    "--store",
    metavar="URL",
    callback=_url,
    help="Keep the cubes in an object store, s3://BUCKET/PREFIX (or gs://, az://), not in OUT. "
    "Credentials come from the environment.",
)
cluster_options = together(
    click.option(
        "--workers",
        type=click.IntRange(1, 4096),
        help="Worker processes on this machine.  [default: one per core]",
    ),
    click.option(
        "--scheduler",
        metavar="ADDRESS|FILE",
        help="Compute on a running dask scheduler, tcp://HOST:PORT, tls://HOST:PORT or the path of "
        "its scheduler file, whose workers see the same files, instead of on this machine.",
    ),
    click.option(
        "--tls",
        nargs=3,
        type=click.Path(exists=True, dir_okay=False),
        metavar="CA CERT KEY",
        help="Certificate files for a tls:// scheduler.",
    ),
)


def place_options(function):
    """Add --out and --store, and pass the Place of the cubes on as `place`."""

    @out_option
    @store_option
    @functools.wraps(function)
    def wrapped(out, store, **options):
        return function(place=_place(out, store), **options)

    return wrapped


def writes(function):
    """Add --out and --store, and pass a Run on as `run`."""

    @out_option
    @store_option
    @functools.wraps(function)
    def wrapped(out, store, **options):
        return function(run=Run(out, _place(out, store)), **options)

    return wrapped


def sweeps(function):
    """Add --out, --store and the options of the cluster, and pass a Run on as `run`."""

    @out_option
    @store_option
    @cluster_options
    @functools.wraps(function)
    def wrapped(out, store, workers, scheduler, tls, **options):
        cluster = {"n_workers": workers, "scheduler": scheduler, "tls": tls}
        return function(run=Run(out, _place(out, store), cluster), **options)

    return wrapped


def _place(out, store):
    from pipeline.store import Refused, place_of

    try:
        return place_of(store or out)
    except Refused as error:
        raise click.UsageError(str(error)) from None


class Run:
    """The run of one command: it writes cubes into its place, tables and figures into OUT.

    out : directory of tables and figures.
    place : Place of the cubes.
    cluster : arguments of `cluster.connect`.
    """

    def __init__(self, out, place, cluster=None):
        self.out, self.place, self.cluster = out, place, cluster
        self.client = None
        self.words, self.written = [], {}

    @contextmanager
    def driving(self):
        """Hold the place as its one driver; at the end print what was found, and where it is."""
        with explained(self.place):
            from pipeline import store

            with store.driving(self.place):
                os.makedirs(self.out, exist_ok=True)
                yield self
        for words in filter(None, self.words):
            click.echo(click.wrap_text(words, 100))
        for kind, paths in self.written.items():
            click.echo(f"{kind + ':':9}{', '.join(paths)}")

    @contextmanager
    def sweeping(self, *jobs):
        """As `driving`, with workers for the sweeps; refuse a place with other settings first."""
        with explained(self.place):
            from pipeline.sweep.cluster import connect

            for job in jobs:
                self.check(job.cube)
            with connect(**self.cluster) as self.client, self.driving():
                yield self

    def check(self, cube):
        """Refuse to go on if the place holds this cube with other settings."""
        from pipeline import store

        store.check(self.place, cube, store.computed_by())

    def sweep(self, job, wanted=None, progress=None):
        """Compute the missing tiles of the job's cube, or those `wanted`; return it as a Dataset.

        `progress` is the line of a series of sweeps. The program ends if tiles fail, and on Ctrl-C.
        """
        from pipeline import store
        from pipeline.sweep.sweep import sweep

        _go_on(sweep(self.client, self.place, job, wanted, progress))
        self._note("cubes", self.place.cube(job.cube.name))
        return store.read(self.place, job.cube.name)

    def keep(self, name, dataset, tile=None, **settings):
        """Write a cube that no sweep computes, whole; return it as a Dataset."""
        from pipeline import store
        from pipeline.cubes.cube import Cube

        cube = Cube(name, dataset, tile or {}, settings)
        store.replace(self.place, cube, store.computed_by())
        self._note("cubes", self.place.cube(name))
        return dataset.assign_attrs(settings)

    def table(self, name, dataset):
        """Write a Dataset as OUT/NAME.csv."""
        from workflows.parts.tables import write

        write(dataset, self.path("tables", f"{name}.csv"))

    def figure(self, name, figure, caption=""):
        """Write OUT/NAME.png and .pdf, and the caption beside them; the caption is printed too."""
        from workflows.figures.style import save

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
        paths = self.written.setdefault(kind, [])
        if path not in paths:
            paths.append(path)
        return path


@contextmanager
def explained(place):
    """End the program with one line and exit code 2 or 1 for what the user can mend."""
    from pipeline import store
    from pipeline.sweep.cluster import ClusterError

    try:
        with store.explained(place):
            yield
    except (store.Refused, ClusterError) as error:
        raise click.UsageError(str(error)) from None
    except OSError as error:  # the store, the workers, or no room for a table
        again = "What is committed stays; run the same command again to resume"
        raise click.ClickException(f"{error}. {again}") from None


@contextmanager
def shared_workers(scheduler, n_workers, tls):
    """Yield the options by which several commands, run in turn, compute on the same workers."""
    if scheduler is not None:
        yield ["--scheduler", scheduler, *(["--tls", *tls] if tls else [])]
        return
    from pipeline.sweep.cluster import connect

    with connect(n_workers=n_workers) as client:
        yield ["--scheduler", client().scheduler.address]


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
