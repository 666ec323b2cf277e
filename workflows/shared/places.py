"""Where the cubes of a command are, and errors that its user can fix."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from pipeline import store
from pipeline.sweep.cluster import ClusterError


def place_of(out: str | Path, url: str | None = None) -> store.Place:
    """Return the Place of the cubes: the URL if there is one, otherwise the directory `out`."""
    with usage_errors(url or out):
        return store.place_of(url or out)


@contextmanager
def runs_of(out: str, url: str | None) -> Iterator[dict[str, store.Place]]:
    """Yield the Places that hold cubes, in all folders of `out` or at the URL.

    The yielded value is a dict {path below `out`, ending with a /: Place}; the path of `out` itself
    is "". If there are no cubes, the program ends with a usage error.
    """
    with usage_errors(place := place_of(out, url)):
        places = {"": place}
        if place.is_directory:
            places |= {f"{path}/": store.place_of(f"{place}/{path}") for path in _folders(place)}
        runs = {path: each for path, each in places.items() if store.names(each)}
        if not runs:
            raise store.Refused(f"{place} holds no cubes; give the --out or --store of a run")
        yield runs


def _folders(place: store.Place) -> list[str]:
    """Return the paths of the folders below a directory, except cubes and folders in them."""
    paths: list[str] = []
    for folder, below, _ in os.walk(place.root):
        below[:] = sorted(name for name in below if not name.endswith(".zarr"))
        paths += [os.path.relpath(os.path.join(folder, name), place.root) for name in below]
    return paths


@contextmanager
def usage_errors(place: Any) -> Iterator[None]:
    """Turn errors that a user can fix into one line and exit code 2 or 1.

    place : Place or str, for the messages.
    """
    try:
        with store.store_errors(place):
            yield
    except (store.Refused, ClusterError) as error:
        raise click.UsageError(store.printable(str(error))) from None
    except store.StoreFailed as fault:
        message = f"{fault}. Finished tiles are kept; run the same command again to resume"
        raise click.ClickException(store.printable(message)) from None
    except OSError as error:  # no workers, or no room for a table
        raise click.ClickException(str(error)) from None
