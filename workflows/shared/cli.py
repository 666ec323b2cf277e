"""The command line that all commands share: options, and how a command is made.

Heavy imports wait until the options are parsed, so that --help is fast.
"""

import functools
import os
import sys
from contextlib import suppress
from difflib import get_close_matches
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import click

for name in ("nasm", "pipeline"):
    ours, found = Path(__file__).parents[2] / name, getattr(find_spec(name), "origin", None)
    if found is None or not ours.samefile(Path(found).parent):
        words = f"the package {name} in {ours} is hidden by another one of that name, {found}"
        sys.exit(f"{words}; install this program into an environment of its own")

if sys.flags.optimize:
    words = "python -O, or PYTHONOPTIMIZE, removes checks that libraries rely on; run without it"
    sys.exit(words)

from nasm import __version__  # noqa: E402
from nasm.arithmetic.memory import keep_freed_memory  # noqa: E402
from nasm.texts import abbreviate, parse_float, parse_integer, short_repr  # noqa: E402
from workflows.shared import streams  # noqa: E402

COMMON = {"help_option_names": ["-h", "--help"]}
# Options that nobody needs daily.
_ADVANCED = (
    *("follow", "max_cpu_seconds", "n_cusp_rays", "picture_angle", "precision", "release"),
    *("scheduler", "store", "tile", "tls", "yes"),
)
version = click.version_option(__version__, message="nasm %(version)s")


class Strength(click.ParamType):
    """A number, which may be negative; what begins with a dash and is none, is an option."""

    name = "number"

    def convert(self, value, parameter, context):
        try:
            return parse_float(value)
        except ValueError as error:
            if str(value).startswith("-"):
                raise no_such_option(context, value) from None
            return self.fail(str(error), parameter, context)


def no_such_option(context, word):
    """Return the error of a mistyped option, which names the options nearest to it."""
    word = word.partition("=")[0]
    names = [name for parameter in context.command.get_params(context) for name in parameter.opts]
    near = get_close_matches(word, [name for name in names if name.startswith("-")])
    return click.NoSuchOption(word, possibilities=near, ctx=context)


class _Command(streams.Prepared, click.Command):
    """A command that names the options nearest to a mistyped one, also after a single dash; its
    help shows `advanced` options last."""

    def format_options(self, context, formatter):
        shown = {"Options": [], "Advanced options": []}
        for option in self.get_params(context):
            if row := option.get_help_record(context):
                heading = "Advanced options" if option.name in _ADVANCED else "Options"
                shown[heading].append(row)
        for heading, rows in shown.items():
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)

    def parse_args(self, context, args):
        words = [*args]
        try:
            return super().parse_args(context, args)
        except click.NoSuchOption as error:  # of "-out" click has seen "-o" alone
            typed = error.option_name
            whole = next((word for word in words if word.startswith(typed)), typed)
            raise no_such_option(context, whole) from None


def command(**settings):
    """Make a click command of a function, and run it if its module is run by `python -m`.

    Its help is what its module says, and --out is out/COMMAND, a folder of its own, unless
    `settings` have another default. Ctrl-C ends it with code 130, a lack of FLINT with 1, and one
    of Numba's compiler with 2.
    """

    def decorate(function):
        module = sys.modules[function.__module__]
        own = {"default_map": {"out": f"out/{_name_of(Path(module.__file__))}"}}

        @click.command(cls=_Command, help=module.__doc__, context_settings=COMMON | own | settings)
        @version
        @functools.wraps(function)
        def wrapped(**options):
            keep_freed_memory()
            os.environ.pop("MPLBACKEND", None)  # figures go to files; an unknown one is an error
            # The user's file may not even be text, which ends the import of matplotlib.
            origin = Path(find_spec("matplotlib").origin)
            os.environ["MATPLOTLIBRC"] = str(origin.parent / "mpl-data" / "matplotlibrc")
            try:
                return function(**options)
            except KeyboardInterrupt:
                click.echo("abandoned; run the same command again to resume", err=True)
                sys.exit(130)
            except ImportError as error:
                if error.name == "flint":
                    raise click.ClickException(str(error)) from None
                if error.name == "numba":
                    raise click.UsageError(str(error)) from None
                raise

        if function.__module__ == "__main__":
            wrapped()
        return wrapped

    return decorate


def commands():
    """Return the names of all commands: each .py of `workflows`, and each package that runs."""
    here = Path(__file__).parents[1]
    return sorted(map(_name_of, [*here.glob("[!_]*.py"), *here.glob("*/__main__.py")]))


def _name_of(file):
    """Return the name of the command in a file, NAME.py or NAME/__main__.py."""
    return file.parent.name if file.stem == "__main__" else file.stem


def main_of(name):
    """Return the click command of `workflows.NAME`, a module or a package."""
    module = import_module(f"workflows.{name}")
    return getattr(module, "main", None) or import_module(f"{module.__name__}.__main__").main


def together(*options):
    """Make one decorator of several options; --help shows them in this order."""
    return lambda function: functools.reduce(lambda f, option: option(f), options[::-1], function)


def _number(kind, name, default, low, high, help, multiple=False):
    return click.option(
        name, default=default, show_default=True, type=kind(low, high), help=help, multiple=multiple
    )


class _WholeRange(click.IntRange):
    def convert(self, value, parameter, context):
        try:
            return parse_integer(str(value), self.min, self.max)
        except ValueError as error:
            return self.fail(str(error), parameter, context)


class _RealRange(click.FloatRange):
    def convert(self, value, parameter, context):
        try:
            number = parse_float(value)
        except ValueError as error:
            return self.fail(str(error), parameter, context)
        if not self.min <= number <= self.max:  # NaN neither
            words = f"{short_repr(value)} must be a number from {self.min} to {self.max}"
            self.fail(words, parameter, context)
        return number


# Options that take a number from low to high; `multiple` lets them be repeated.
whole = functools.partial(_number, _WholeRange)
real = functools.partial(_number, _RealRange)


def choice(name, values, default, help, multiple=False):
    """Make an option that takes one of the texts `values`, or several of them."""
    how = {"type": click.Choice(values), "help": help, "multiple": multiple}
    return click.option(name, default=default, show_default=not multiple, **how)


def flag(name, help):
    """Make an option that is given or not."""
    return click.option(name, is_flag=True, help=help)


def parsed(name, default, parse, metavar, help, multiple=False, shown=True):
    """Make an option whose text, or tuple of texts, `parse` reads or refuses by ValueError.

    name : of the option, or several with spaces between. shown : the default in words, if it is not
    to be written out.
    """

    def callback(context, parameter, text):
        try:
            return parse(text)
        except ValueError as error:
            raise click.BadParameter(str(error)) from None

    how = {"show_default": shown, "metavar": metavar, "help": help, "multiple": multiple}
    return click.option(*name.split(), default=default, callback=callback, **how)


def several(name, default, read, metavar, help, shown=True):
    """Make an option that may be repeated: {text: the number that it spells}, in increasing order.

    read : function of a text, which refuses it by ValueError. Equal numbers count once.
    shown : as of `parsed`.
    """

    def parse(texts):
        numbers = {read(text): text for text in texts}
        return {numbers[number]: number for number in sorted(numbers, key=float)}

    return parsed(name, default, parse, metavar, f"{help} May be repeated.", True, shown)


def axis(name, default, help):
    """Make an option LO:HI:N, which is read as a grid.Axis."""

    def parse(text):
        from pipeline.sweep.grid import parse_axis

        return parse_axis(text)

    return parsed(name, default, parse, "LO:HI:N", help)


def increasing(name, default, largest, help):
    """Make an option N[,N...], which is read as a list of increasing whole numbers, or None."""

    def parse(text):
        if not text:
            return None
        with suppress(ValueError):
            numbers = [parse_integer(n, 1, largest) for n in text.split(",")]
            if sorted({*numbers}) == numbers:
                return numbers
        words = f"must be increasing whole numbers from 1 to {largest}, e.g. 100,1000"
        raise ValueError(f"{short_repr(text)} {words}")

    return parsed(name, default, parse, "N[,N...]", help)


def _plane(text):
    from nasm.planes import from_json, parse

    try:
        if text is None or not text.endswith(".json"):
            return text and parse(text)
        return from_json(Path(_at_home(text)).read_bytes())
    except (OSError, ValueError) as error:
        raise ValueError(f"{abbreviate(text)}: {error}") from None


_PLANES = "two-kicks, rotating:1/3,1/48 (frequency, phase), three-kicks:0.2 or FILE.json."
plane_option = parsed("--plane", "two-kicks", _plane, "PLANE", f"Plane of forcings: {_PLANES}")
point_option = parsed("--plane", None, _plane, "PLANE", f"KAPPA is a point of it: {_PLANES}")


def preset(name, what, **settings):
    """Make a flag by which other options have other defaults; `what` they make, in words."""

    def callback(context, parameter, value):
        if value:
            context.default_map = settings | (context.default_map or {})

    words = " ".join(
        f"--{name.replace('_', '-')} {each}"
        for name, value in settings.items()
        for each in ([value] if isinstance(value, str | int | float) else value)
    )
    how = {"is_eager": True, "expose_value": False, "callback": callback}
    return click.option(name, is_flag=True, help=f"{what}: {words}, unless given.", **how)


def ray_options(default):
    """Make --n-rays and --n-cusp-rays, the rays that `rays.ray_angles` returns."""
    return together(
        whole(
            *("--n-rays", default, 2, 10**6),
            "Rays, from 0 to 180 degrees, or to 360 where κ and -κ differ, as in three-kicks:0.2.",
        ),
        whole(
            *("--n-cusp-rays", 8, 0, 1000),
            "Extra rays on either side of the cusps at 45° and 135° (two kicks only).",
        ),
    )


def plane_options(n_max, tile, levels, precision):
    """Make the options of a plane of escape times, as `plane.grid_of` takes them."""
    return together(
        axis("--first", "-1.1:1.1:256", "First coordinate: lower end, upper end, cells."),
        axis("--second", "0:1.1:128", "Second coordinate: the same."),
        whole("--n-max", n_max, 1, 10**12, "Steps (periods of the forcing) of each orbit."),
        increasing("--n-orbits", "64", 10**8, "Orbits; several: nested ensembles."),
        choice(
            *("--precision", ["double", "single"], precision),
            "Floating-point precision; single is 2.5 times faster, allowed up to 10⁶ steps.",
        ),
        whole("--tile", tile, 1, 4096, "Cells along each side of a tile, at least."),
        whole("--levels", levels, 1, 12, "Levels of refinement; 1 computes every cell."),
        increasing(
            *("--follow", None, 10**12),
            "Step numbers N whose boundaries {n* ≤ N} are refined and drawn.  [default: n-max]",
        ),
    )


def _at_home(path):
    """Return the path with ~ as the home directory, which a shell leaves as it is after --out=."""
    if (expanded := os.path.expanduser(path)).startswith("~"):
        words = f"{path}: no such home directory is known; write ./{path} for a folder of that name"
        raise click.BadParameter(words)
    return expanded


class _File(click.Path):
    """A file that exists."""

    def convert(self, value, parameter, context):
        return super().convert(_at_home(value), parameter, context)


class _Directory(click.ParamType):
    """A directory, which need not exist, or a URL if that is allowed."""

    name = "directory"

    def __init__(self, url=False):
        self.url = url

    def convert(self, value, parameter, context):
        if not value:
            self.fail("it is empty, as if a variable is not set; write . for the current directory")
        if "://" not in value:
            return _at_home(value)
        if not self.url:  # the message does not repeat a URL, which may hold a password
            self.fail(
                "a directory is needed, for tables and figures too; cubes can be at a --store"
            )
        return value


FILE, DIRECTORY = _File(exists=True, dir_okay=False), _Directory()
_WORKERS = "Worker processes on this machine.  [default: one per core]"
_OUT = "Directory of the results; an earlier run in it is resumed."
_RUNS = "Directory of a run, or of several: all folders in it that hold cubes."
_STORE = """Keep the cubes in an object store, s3://BUCKET/PREFIX (or gs://, az://), or in another
directory, not in OUT. Credentials come from the environment."""
_SCHEDULER = """Compute on a running dask scheduler, tcp://HOST:PORT, tls://HOST:PORT or the path of
its scheduler file, whose workers see the same files, instead of on this machine."""
_TLS = "Certificate files for a tls:// scheduler."
_YES = "Run although it is predicted to take more than ten minutes, as --full does on few cores."
# The options that make a run shorter, if they are smaller or fewer; and if they are larger.
_SMALLER = (
    *("--n-rays", "--n-cusp-rays", "--first", "--second", "--primary", "--secondary", "--cells"),
    *("--n-max", "--n-orbits", "--n-particles", "--q-max", "--max-denominator"),
    *(
        "--cpu-seconds",
        "--n-forcings",
        "--n-climbs",
        "--n-phases",
        "--phase",
        "--frequency",
        "--angle",
    ),
    *("--omega", "--vector", "--coupling", "--method", "--ray"),
)
_LARGER = "--tol", "--least-excess", "--distance"


def directory(help):
    """Make the option --out of a command whose directory is for what `help` says."""
    how = {"metavar": "DIR", "show_default": True, "type": DIRECTORY, "help": help}
    return click.option("--out", **how)


out_option = directory(_OUT)
store_option = click.option("--store", metavar="URL", type=_Directory(url=True), help=_STORE)
_COLUMN = "Figures for a column of a journal: 3.4 in wide, 8 pt, without titles."
column_option = flag("--column", _COLUMN)
place_options = together(directory(_RUNS), store_option)
cluster_options = together(
    whole("--workers", None, 1, 4096, _WORKERS),
    click.option("--scheduler", metavar="ADDRESS|FILE", help=_SCHEDULER),
    click.option("--tls", nargs=3, type=FILE, metavar="CA CERT KEY", help=_TLS),
)


quiet_option = flag("--quiet", "Print findings and errors only, no progress.")


def shortening(context):
    """Return by which of its options the run of a command takes less time, in words."""
    names = [option.opts[0] for option in context.command.params]
    full = "--full" in names and context.get_parameter_source("full").name == "COMMANDLINE"
    ways = ["leave --full out"] if full else ["add --quick"] if "--quick" in names else []
    for change, which in (("reduce", _SMALLER), ("increase", _LARGER)):
        if found := [name for name in names if name in which]:
            ways.append(f"{change} {' or '.join(found)}")
    return "; ".join(ways)


def announce_kernels(quiet=False):
    """Load what kernels need, and say so if they have to be compiled first."""
    from nasm.arithmetic.kernels import are_missing, begin_without_scipy

    begin_without_scipy()
    if are_missing() and not quiet:
        click.echo("compiling kernels, once per machine: about 20 s", err=True)


def writes(function):
    """Add --out and --column, and pass a Run without workers on as `run`."""

    @column_option
    @out_option
    @quiet_option
    @flag("--yes", _YES)
    @flag("--dry-run", "Estimate tiles, files, disk space and CPU time, then exit.")
    @functools.wraps(function)
    def wrapped(out, column, quiet, yes, dry_run, **options):
        of_sweeps = "store", "workers", "scheduler", "tls"
        store, workers, scheduler, tls = (options.pop(name, None) for name in of_sweeps)
        if not (dry_run or quiet):
            click.echo(f"loading; results go to {out}", err=True)  # the imports take seconds
        from workflows.shared.run import Run, place_of

        announce_kernels(quiet)
        cluster = {"n_workers": workers, "scheduler": scheduler, "tls": tls}
        shorter = None if yes or scheduler else shortening(click.get_current_context())
        run = Run(out, place_of(out, store), cluster, dry_run, column, quiet, shorter)
        try:
            return function(run=run, **options)
        except ValueError as error:
            if run.started:
                raise
            raise click.UsageError(str(error)) from None

    return wrapped


def sweeps(function):
    """Add --out, --store and the options of the cluster, and pass a Run on as `run`."""
    return writes(together(store_option, cluster_options)(function))
