"""The command line that all commands share: options, and the decorator that makes a command.

Heavy imports are delayed until the options are parsed, so that --help is fast.
"""

import functools
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from difflib import get_close_matches
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from nasm.planes import Plane
    from pipeline.sweep.grid import Axis

for name in ("nasm", "pipeline"):
    own, imported = Path(__file__).parents[2] / name, getattr(find_spec(name), "origin", None)
    if imported is None or not own.samefile(Path(imported).parent):
        reason = f"the package {name} in {own} is hidden by another package {name}, {imported}"
        sys.exit(f"{reason}; install this program into a separate environment")

if sys.flags.optimize:
    reason = "python -O, or PYTHONOPTIMIZE, removes checks that libraries rely on; run without it"
    sys.exit(reason)

from nasm import __version__  # noqa: E402
from nasm.arithmetic.memory import keep_freed_memory  # noqa: E402
from nasm.texts import abbreviate, parse_float, parse_integer, short_repr  # noqa: E402
from workflows.shared import streams  # noqa: E402

Decorator = Callable[[Any], Any]

COMMON: dict[str, Any] = {"help_option_names": ["-h", "--help"]}
# Options that are rarely needed.
_ADVANCED = (
    *("follow", "max_cpu_seconds", "n_cusp_rays", "n_image_rays", "picture_angle", "precision"),
    *("release", "scheduler", "store", "tile", "tls", "yes"),
)
_ARGUMENTS, _LINE = "workflows.arguments", "workflows.line"  # keys in the `meta` of a context
version = click.version_option(__version__, message="nasm %(version)s")


class Strength(click.ParamType):
    """A number, which may be negative; any other word that begins with a dash is an option."""

    name = "number"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> float:
        """Parse a number; raise NoSuchOption for a mistyped option."""
        try:
            return parse_float(value)
        except ValueError as error:
            if context is not None and str(value).startswith("-"):
                raise no_such_option(context, value) from None
            return self.fail(str(error), parameter, context)


class StrengthOrFile(Strength):
    """A number, or the path of a text file of numbers."""

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Any:
        """Return a float or a Path."""
        with suppress(ValueError):
            return parse_float(value)  # even if a file has this name
        if os.path.isfile(value):
            return Path(value)
        if os.path.splitext(str(value))[1][1:].isalpha():
            self.fail(f"{value}: no such file", parameter, context)
        return super().convert(value, parameter, context)


def no_such_option(context: click.Context, word: str) -> click.NoSuchOption:
    """Return the error for a mistyped option; the error suggests similar options."""
    word = word.partition("=")[0]
    names = [name for parameter in context.command.get_params(context) for name in parameter.opts]
    similar = get_close_matches(word, [name for name in names if name.startswith("-")])
    return click.NoSuchOption(word, possibilities=similar, ctx=context)


class _Command(streams.Prepared, click.Command):
    """A command that suggests similar options for a mistyped one, and lists advanced ones last.

    It also recognizes mistyped options after a single dash.
    """

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under two headings."""
        sections: dict[str, list] = {"Options": [], "Advanced options": []}
        for option in self.get_params(context):
            if row := option.get_help_record(context):
                heading = "Advanced options" if option.name in _ADVANCED else "Options"
                sections[heading].append(row)
        for heading, rows in sections.items():
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Parse the options; for a mistyped one, suggest similar options."""
        arguments = context.meta[_ARGUMENTS] = [*args]
        if context.ignore_unknown_options:  # click would read -h in "-scheduler"
            mistyped = filter(re.compile("-(?!inf|nan)[A-Za-z]{2}").match, args)
            if word := next(mistyped, None):
                raise no_such_option(context, word)
        try:
            return super().parse_args(context, args)
        except click.NoSuchOption as error:  # for "-out" click reports "-o"
            typed = error.option_name
            word = next((word for word in arguments if word.startswith(typed)), typed)
            raise no_such_option(context, word) from None


def command_line() -> str:
    """Return the running command as a command line of `python -m`; "" if none is running."""
    context = click.get_current_context(silent=True)
    return context.meta.get(_LINE, "") if context else ""


def command(**settings: Any) -> Decorator:
    """Turn a function into a click command, and run it if its module is run by `python -m`.

    The help is the docstring of the module. --out defaults to out/COMMAND unless `settings`
    contain another default. Exit codes: 130 after Ctrl-C, 1 if FLINT is missing, 2 if Numba's
    compiler is missing.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        module = sys.modules[function.__module__]
        name = _name_of(Path(str(module.__file__)))
        defaults = {"default_map": {"out": f"out/{name}"}}
        context_settings = COMMON | defaults | settings

        @click.command(cls=_Command, help=module.__doc__, context_settings=context_settings)
        @version
        @functools.wraps(function)
        def wrapped(**options: Any) -> Any:
            meta = click.get_current_context().meta
            words = ["python", "-m", f"workflows.{name}", *meta[_ARGUMENTS]]
            meta[_LINE] = shlex.join(words)
            keep_freed_memory()
            os.environ.pop("MPLBACKEND", None)  # figures go to files; an unknown backend would fail
            # A user's matplotlibrc that is not a text file would break the import of matplotlib.
            origin = Path(str(find_spec("matplotlib").origin))  # type: ignore[union-attr]
            os.environ["MATPLOTLIBRC"] = str(origin.parent / "mpl-data" / "matplotlibrc")
            try:
                return function(**options)
            except KeyboardInterrupt:
                click.echo("interrupted; run the same command again to resume", err=True)
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


def commands() -> list[str]:
    """Return the names of all commands: modules of `workflows`, and packages with a __main__."""
    folder = Path(__file__).parents[1]
    return sorted(map(_name_of, [*folder.glob("[!_]*.py"), *folder.glob("*/__main__.py")]))


def _name_of(file: Path) -> str:
    """Return the name of the command in a file, NAME.py or NAME/__main__.py."""
    return file.parent.name if file.stem == "__main__" else file.stem


def main_of(name: str) -> click.Command:
    """Return the click command of `workflows.NAME`, a module or a package."""
    module = import_module(f"workflows.{name}")
    return getattr(module, "main", None) or import_module(f"{module.__name__}.__main__").main


def together(*options: Decorator) -> Decorator:
    """Combine several options in one decorator; --help shows them in the given order."""

    def decorate(function: Any) -> Any:
        for option in reversed(options):
            function = option(function)
        return function

    return decorate


def _number(
    kind: Callable[[Any, Any], click.ParamType],
    name: str,
    default: Any,
    low: float,
    high: float,
    help: str,
    multiple: bool = False,
) -> Decorator:
    return click.option(
        name, default=default, show_default=True, type=kind(low, high), help=help, multiple=multiple
    )


class _WholeRange(click.IntRange):
    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> int:
        try:
            return parse_integer(str(value), self.min, self.max)  # type: ignore[arg-type]
        except ValueError as error:
            return self.fail(str(error), parameter, context)


class _RealRange(click.FloatRange):
    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> float:
        try:
            number = parse_float(value)
        except ValueError as error:
            return self.fail(str(error), parameter, context)
        if not self.min <= number <= self.max:  # type: ignore[operator]  # also refuses NaN
            message = f"{short_repr(value)} must be a number from {self.min} to {self.max}"
            self.fail(message, parameter, context)
        return number


# Options that take a number from low to high; with `multiple` they may be repeated.
whole = functools.partial(_number, _WholeRange)
real = functools.partial(_number, _RealRange)


def choice(
    name: str, values: Sequence[str], default: Any, help: str, multiple: bool = False
) -> Decorator:
    """Make an option that takes one of the `values`; with `multiple`, it may be repeated."""
    return click.option(
        name,
        default=default,
        show_default=not multiple,
        type=click.Choice(values),
        help=help,
        multiple=multiple,
    )


def flag(name: str, help: str) -> Decorator:
    """Make an option without a value."""
    return click.option(name, is_flag=True, help=help)


def parsed(
    name: str,
    default: Any,
    parse: Callable[[Any], Any],
    metavar: str,
    help: str,
    multiple: bool = False,
    shown: bool | str = True,
) -> Decorator:
    """Make an option whose value is parsed by a function.

    Parameters
    ----------
    name : str
        Name of the option; several names are separated by spaces.
    default : str or tuple of str
        The text that is parsed by default.
    parse : callable
        Function that converts the text, or the tuple of texts; it raises ValueError for a bad one.
    metavar, help : str
        As shown by --help.
    multiple : bool
        Whether the option may be repeated.
    shown : bool or str
        Whether --help shows the default; or the text that --help shows instead of it.
    """

    def callback(context: click.Context, parameter: click.Parameter, text: Any) -> Any:
        try:
            return parse(text)
        except ValueError as error:
            raise click.BadParameter(str(error)) from None

    return click.option(
        *name.split(),
        default=default,
        callback=callback,
        show_default=shown,
        metavar=metavar,
        help=help,
        multiple=multiple,
    )


def several(
    name: str,
    default: Iterable[str] | None,
    read: Callable[[str], Any],
    metavar: str,
    help: str,
    shown: bool | str = True,
) -> Decorator:
    """Make an option that may be repeated; its value is {text: number}, in increasing order.

    `read` parses one text and raises ValueError for a bad one; equal numbers count once. The other
    parameters are those of `parsed`.
    """

    def parse(texts: Iterable[str]) -> dict[str, Any]:
        numbers = {read(text): text for text in texts}
        return {numbers[number]: number for number in sorted(numbers, key=float)}

    return parsed(name, default, parse, metavar, f"{help} May be repeated.", True, shown)


def axis(name: str, default: str, help: str) -> Decorator:
    """Make an option LO:HI:N, which is parsed as a grid.Axis."""

    def parse(text: str) -> "Axis":
        from pipeline.sweep.grid import parse_axis

        return parse_axis(text)

    return parsed(name, default, parse, "LO:HI:N", help)


def increasing(name: str, default: str | None, largest: int, help: str) -> Decorator:
    """Make an option N[,N...], which is parsed as a list of increasing whole numbers, or None."""

    def parse(text: str | None) -> list[int] | None:
        if not text:
            return None
        with suppress(ValueError):
            numbers = [parse_integer(n, 1, largest) for n in text.split(",")]
            if sorted({*numbers}) == numbers:
                return numbers
        rule = f"must be increasing whole numbers from 1 to {largest}, e.g. 100,1000"
        raise ValueError(f"{short_repr(text)} {rule}")

    return parsed(name, default, parse, "N[,N...]", help)


def _plane(text: str | None) -> "Plane | None":
    from nasm.planes import from_json, parse

    try:
        if text is None or not text.endswith(".json"):
            return parse(text) if text else None
        return from_json(Path(_at_home(text)).read_bytes())
    except (OSError, ValueError) as error:
        raise ValueError(f"{abbreviate(str(text))}: {error}") from None


_PLANES = (
    "two-kicks, rotating:1/3,1/48 (frequency, phase), three-kicks:0.2, pairs:1/3 (delay), "
    "or FILE.json."
)
plane_option = parsed("--plane", "two-kicks", _plane, "PLANE", f"Plane of forcings: {_PLANES}")
point_option = parsed(
    "--plane", None, _plane, "PLANE", f"Plane in which KAPPA is a point: {_PLANES}"
)


def preset(name: str, purpose: str, **settings: Any) -> Decorator:
    """Make a flag that changes the defaults of other options; `purpose` begins its help."""

    def callback(context: click.Context, parameter: click.Parameter, value: bool) -> None:
        if value:
            context.default_map = {**settings, **(context.default_map or {})}

    options = " ".join(
        f"--{name.replace('_', '-')} {each}"
        for name, value in settings.items()
        for each in ([value] if isinstance(value, str | int | float) else value)
    )
    return click.option(
        name,
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=callback,
        help=f"{purpose}: defaults become {options}.",
    )


def ray_options(default: int) -> Decorator:
    """Make --n-rays and --n-cusp-rays, the arguments of `rays.ray_angles`."""
    return together(
        whole(
            *("--n-rays", default, 2, 10**6),
            "Rays, from 0 to 180 degrees, or to 360 where κ and -κ are not equivalent, as in "
            "three-kicks:0.2.",
        ),
        whole(
            *("--n-cusp-rays", 8, 0, 1000),
            "Extra rays on each side of the cusps at 45° and 135° (two kicks only).",
        ),
    )


def plane_options(n_max: int, tile: int, levels: int, precision: str) -> Decorator:
    """Make the options for a plane of escape times, the arguments of `escape_field.grid_of`."""
    return together(
        axis("--first", "-1.1:1.1:256", "First coordinate: lower end, upper end, cells."),
        axis("--second", "0:1.1:128", "Second coordinate: as for --first."),
        whole("--n-max", n_max, 1, 10**12, "Steps (periods of the forcing) of each orbit."),
        increasing(
            *("--n-orbits", "64", 10**8),
            "Orbits per forcing; several numbers give nested ensembles.",
        ),
        choice(
            *("--precision", ["double", "single"], precision),
            "Floating-point precision; single is 2.5 times faster, allowed up to 10⁶ steps.",
        ),
        whole("--tile", tile, 1, 4096, "Minimum number of cells along each side of a tile."),
        whole("--levels", levels, 1, 12, "Levels of refinement; 1 computes every cell."),
        increasing(
            *("--follow", None, 10**12),
            "Step numbers N; the boundaries of {n* ≤ N} are refined and drawn.  [default: n-max]",
        ),
    )


def proof_options(
    coarsest: int, cells: int = 512, seconds: float = 0.02, distance: float = 0.09
) -> Decorator:
    """Make the options for proofs in a plane, the arguments of `proved_plane.ProvedPlane`.

    coarsest : smallest number of cells per unit of strength. The other arguments are defaults.
    """
    allowed = [str(2**n) for n in range(3, 13) if 2**n >= coarsest]
    return together(
        choice("--cells", allowed, str(cells), "Number of finest cells per unit of strength."),
        real(
            *("--cpu-seconds", seconds, 1e-3, 1e4),
            "CPU time limit per cell; a cell not proved in time is subdivided, or left open if "
            "finest.",
        ),
        real(
            *("--distance", distance, 1e-3, 0.5),
            "Relative distance from the boundary at which proofs of barriers stop.",
        ),
    )


def _at_home(path: str) -> str:
    """Expand ~ in a path to the home directory; after --out= shells do not expand it."""
    if (expanded := os.path.expanduser(path)).startswith("~"):
        reason = f"{path}: no such home directory; write ./{path} for a folder of that name"
        raise click.BadParameter(reason)
    return expanded


class _File(click.Path):
    """A parameter type: the path of a file that exists."""

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> Any:
        return super().convert(_at_home(value), parameter, context)


class _Directory(click.ParamType):
    """A parameter type: a directory, which need not exist, or, if `url` is true, a URL."""

    name = "directory"

    def __init__(self, url: bool = False) -> None:
        self.url = url

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> str:
        if not value:
            self.fail("it is empty (an unset variable?); write . for the current directory")
        if "://" not in value:
            return _at_home(value)
        if not self.url:  # the message does not repeat a URL, which may contain a password
            self.fail(
                "a directory is needed for tables and figures; only cubes can go to a --store"
            )
        return value


FILE, DIRECTORY = _File(exists=True, dir_okay=False), _Directory()
_WORKERS = "Worker processes on this machine.  [default: one per core, and one more for explore]"
_OUT = "Directory for the results; an earlier run in it is resumed."
_RUNS = "Directory of one or more runs; every folder in it that contains cubes is a run."
_STORE = """Keep the cubes in an object store, s3://BUCKET/PREFIX (or gs://, az://), or in another
directory instead of OUT. Credentials come from the environment."""
_SCHEDULER = """Compute on a running dask cluster instead of this machine: address of its scheduler,
tcp://HOST:PORT or tls://HOST:PORT, or path of its scheduler file. Its workers must see the same
files."""
_TLS = "Certificate files for a tls:// scheduler."
_YES = "Run even if the predicted time exceeds ten minutes."
# Options that shorten a run when reduced, and options that shorten it when increased.
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
        "--delay",
    ),
    *("--omega", "--vector", "--coupling", "--method", "--ray"),
)
_LARGER = "--tol", "--least-excess", "--distance"


def directory(help: str) -> Decorator:
    """Make the option --out, a directory; `help` explains its use."""
    return click.option("--out", metavar="DIR", show_default=True, type=DIRECTORY, help=help)


out_option = directory(_OUT)
store_option = click.option("--store", metavar="URL", type=_Directory(url=True), help=_STORE)
_COLUMN = "Draw figures for one journal column: 3.4 in wide, 8 pt, without titles."
column_option = flag("--column", _COLUMN)
place_options = together(directory(_RUNS), store_option)
cluster_options = together(
    whole("--workers", None, 1, 4096, _WORKERS),
    click.option("--scheduler", metavar="ADDRESS|FILE", help=_SCHEDULER),
    click.option("--tls", nargs=3, type=FILE, metavar="CA CERT KEY", help=_TLS),
)


quiet_option = flag("--quiet", "Print findings and errors only, no progress.")


def shortening(context: click.Context) -> str:
    """Return advice on the options that shorten the run of a command."""
    names = [option.opts[0] for option in context.command.params]
    source = context.get_parameter_source("full") if "--full" in names else None
    full = source is not None and source.name == "COMMANDLINE"
    ways = ["leave --full out"] if full else ["add --quick"] if "--quick" in names else []
    for change, options in (("reduce", _SMALLER), ("increase", _LARGER)):
        if own := [name for name in names if name in options]:
            ways.append(f"{change} {' or '.join(own)}")
    return "; ".join(ways)


def announce_kernels(quiet: bool = False) -> None:
    """Import what the kernels need; print a message if they have to be compiled first."""
    from nasm.arithmetic.kernels import are_missing, begin_without_scipy

    begin_without_scipy()
    if are_missing() and not quiet:
        click.echo("compiling kernels, once per machine: about half a minute", err=True)


def writes(function: Callable[..., Any]) -> Any:
    """Add --out, --column and other options of a run, and pass a Run as `run`."""

    @column_option
    @out_option
    @quiet_option
    @flag("--yes", _YES)
    @flag("--dry-run", "Estimate tiles, files, disk space and CPU time, then exit.")
    @functools.wraps(function)
    def wrapped(
        out: str, column: bool, quiet: bool, yes: bool, dry_run: bool, **options: Any
    ) -> Any:
        sweep_options = "store", "workers", "scheduler", "tls"
        store, workers, scheduler, tls = (options.pop(name, None) for name in sweep_options)
        if not (dry_run or quiet):
            click.echo(f"loading; results go to {out}", err=True)  # the imports take seconds
        from workflows.shared.places import place_of
        from workflows.shared.run import Run

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


def sweeps(function: Callable[..., Any]) -> Any:
    """Like `writes`, but also add --store and the cluster options."""
    return writes(together(store_option, cluster_options)(function))
