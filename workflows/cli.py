"""The command line that all workflows share: where to write, what to compute on, how to end.

Exit codes: 0 done; 1 some tiles failed, or the workers are gone, or the disk or the object store
failed; 2 bad input, nothing touched; 130 stopped by Ctrl-C.
"""

import functools
import os
import sys
from contextlib import contextmanager, nullcontext

import click

_TOLD = 10  # failed tiles whose reasons are told

HELP = {"help_option_names": ["-h", "--help"]}


def axis_option(name, default, help):
    """An option LO:HI:N, given to the function as a grid.Axis."""

    def parse(context, parameter, value):
        from pipeline.grid import parse_axis

        try:
            return parse_axis(value)
        except ValueError as error:
            raise click.BadParameter(str(error)) from None

    return click.option(
        name, default=default, show_default=True, metavar="LO:HI:N", callback=parse, help=help
    )


def integers_option(name, default, largest, help):
    """An option N[,N...]: increasing whole numbers from 1 to `largest`, given as a list or None."""

    def parse(context, parameter, value):
        if value is None:
            return None
        try:
            numbers = [int(number) for number in value.split(",")]
        except ValueError:
            numbers = []
        if (
            not numbers
            or sorted(set(numbers)) != numbers
            or numbers[0] < 1
            or numbers[-1] > largest
        ):
            raise click.BadParameter(
                f"{value!r} must be increasing whole numbers from 1 to {largest}, e.g. 100,1000"
            )
        return numbers

    return click.option(
        name, default=default, show_default=True, metavar="N[,N...]", callback=parse, help=help
    )


def angles_option(default):
    """--angles, the number of rays."""
    return click.option(
        "--angles",
        default=default,
        show_default=True,
        type=click.IntRange(2, 10**6),
        help="Rays, from 0 to 180 degrees.",
    )


def _refuse_url(out):
    if "://" in out:
        # It is not repeated: there may be a password in it.
        raise click.UsageError(
            "--out is a directory, for tables and figures too; only the cubes of a sweep can be "
            "elsewhere, by --store URL"
        )
    return out


def _out_option(help):
    return click.option(
        "--out",
        default="out",
        show_default=True,
        type=click.Path(path_type=str),
        callback=lambda context, parameter, value: _refuse_url(value),
        help=help,
    )


out_option = _out_option("Directory of the results; an earlier run in it is resumed.")
run_option = _out_option("Directory of a run.")


def cluster_options(function):
    """--out, passed on as `out`; --scheduler, --workers and --tls, as the dict `cluster`."""

    @out_option
    @click.option(
        "--workers",
        type=click.IntRange(1, 4096),
        help="Worker processes on this machine.  [default: one per core]",
    )
    @click.option(
        "--scheduler",
        metavar="ADDRESS|FILE",
        help="Compute on a running dask scheduler, tcp://HOST:PORT, tls://HOST:PORT or the path of "
        "its scheduler file, whose workers see the same files, instead of on this machine.",
    )
    @click.option(
        "--tls",
        nargs=3,
        type=click.Path(exists=True, dir_okay=False),
        metavar="CA CERT KEY",
        help="Certificate files for a tls:// scheduler.",
    )
    @functools.wraps(function)
    def wrapped(*args, workers, scheduler, tls, **kwargs):
        cluster = {"n_workers": workers, "scheduler": scheduler, "tls": tls}
        with _abandoned_on_interrupt():
            return function(*args, cluster=cluster, **kwargs)

    return wrapped


def store_option(function):
    """--store, passed on as `place`: where the cubes are, which is OUT unless told otherwise."""

    @click.option(
        "--store",
        metavar="URL",
        help="Keep the cubes in an object store, s3://BUCKET/PREFIX (or gs://, az://), not in OUT. "
        "Credentials come from the environment.",
    )
    @functools.wraps(function)
    def wrapped(*args, out, store, **kwargs):
        if store is not None and "://" not in store:
            raise click.BadParameter(
                "--store is a URL, s3://BUCKET/PREFIX; a directory goes to --out"
            )
        return function(*args, out=out, place=store or out, **kwargs)

    return wrapped


@contextmanager
def explained(place=None):
    """What a user can mend ends the program with one line, and exit code 2 or 1."""
    with _abandoned_on_interrupt():
        from pipeline import store
        from pipeline.cluster import ClusterError
        from pipeline.faults import StorageError, StoreError

        try:
            with store.explained(place) if place else nullcontext():
                yield
        except (StoreError, ClusterError) as error:
            raise click.UsageError(str(error)) from None
        except StorageError as fault:
            again = "What is committed stays; run the same command again to resume"
            raise click.ClickException(f"{fault}. {again}") from None
        except OSError as error:  # no workers, or no room for a table
            raise click.ClickException(str(error)) from None


@contextmanager
def _abandoned_on_interrupt():
    """A Ctrl-C while no sweep is under way, e.g. before it, while its cube is being described."""
    try:
        yield
    except KeyboardInterrupt:
        click.echo("abandoned; run the same command again to resume", err=True)
        sys.exit(130)


@contextmanager
def driver(out):
    """Hold the directory `out` as its driver, without a cluster."""
    _refuse_url(out)
    with explained(out):
        from pipeline import store

        with store.driving(out):
            yield


@contextmanager
def session(out, cluster, jobs, place=None):
    """Hold the store as its driver and connect to the workers: yields the dask client.

    The store is in `place`, by default in `out`. The workers are warmed up for the `jobs`. Before
    they start, the place is refused if it holds one of their cubes with other settings.
    """
    place = place or out
    with explained(place):
        from pipeline import store
        from pipeline.admission import sharing
        from pipeline.cluster import connect

        if place != out and store.STORE in store.place_of(out).names():
            raise store.StoreError(f"{out} holds cubes of its own; choose another --out for tables")
        store.refuse_foreign(place)
        for job in jobs:
            store.refuse_different(place, job.cube)
        warm_up = functools.partial(_warm_up, [job.warm_up for job in jobs])
        with (
            connect(warm_up, **cluster) as client,
            store.driving(place),
            sharing(client, place),
        ):
            os.makedirs(out, exist_ok=True)
            yield client


def _warm_up(functions):
    for function in functions:
        function()


@contextmanager
def shared_workers(scheduler, n_workers, tls):
    """The options by which several workflows, run in turn, compute on the same workers.

    Those of the cluster that the arguments name, or workers on this machine for all of them.
    """
    if scheduler is not None:
        yield ["--scheduler", scheduler, *(["--tls", *tls] if tls else [])]
        return
    with explained():
        from pipeline.cluster import connect

        with connect(lambda: None, n_workers=n_workers) as client:
            yield ["--scheduler", client.scheduler.address]


def carry_out(client, place, job, wanted=None, progress=None):
    """Sweep the job's cube, or the tiles `wanted` of it, into the store in `place`.

    `progress` is the line of a series of sweeps. Returns the cube as a Dataset.
    """
    from pipeline import store
    from pipeline.sweep import sweep

    finish(sweep(client, place, job.cube, job.compute, job.predict, wanted, progress=progress))
    return store.read(place, job.cube.name)


def finish(outcome):
    """Go on after a complete sweep; end the program, saying how to go on, after any other."""
    for index, reason in sorted(outcome.failed.items())[:_TOLD]:
        click.echo(f"tile {index} failed: {reason}", err=True)
    if len(outcome.failed) > _TOLD:
        click.echo(f"... and {len(outcome.failed) - _TOLD} more", err=True)
    if outcome.interrupted:
        click.echo(
            f"stopped with {outcome.remaining} tiles of this sweep missing; run the same command "
            "again to resume",
            err=True,
        )
        sys.exit(130)
    if outcome.failed:
        click.echo(
            f"{len(outcome.failed)} tiles failed and stay missing; run the same command again to "
            "retry them",
            err=True,
        )
        sys.exit(1)
