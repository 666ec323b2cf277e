"""Information for bug reports: versions of this program, of Python and of the libraries in use."""

import os
import platform
import re
import sys
from importlib.metadata import PackageNotFoundError, requires, version

from nasm import sources
from nasm.sources import DISTRIBUTION

__all__ = ["show_versions"]


def show_versions() -> None:
    """Print the versions that a bug report needs, one per line.

    These are the versions of this program, of Python, and of all libraries that the program or one
    of its extras may use; a library that is absent is marked "not installed". The machine and its
    number of cores are printed, too. `digest` identifies the source files of `nasm`: it differs
    from the digest of the release if the files were edited.

    Examples
    --------
    >>> import nasm
    >>> nasm.show_versions()  # doctest: +ELLIPSIS
    nasm-transport ...
    digest         ...
    python         3...
    machine        ...
    cores          ...
    ...
    numba          ...
    """
    about = {
        DISTRIBUTION: _version(DISTRIBUTION),
        "digest": sources.digest().hexdigest()[:16],
        "python": sys.version.split()[0],
        "machine": f"{platform.system()} {platform.machine()}",
        "cores": str(os.cpu_count()),
    }
    about |= {name: _version(name) for name in _libraries()}
    width = max(map(len, about))
    for name, value in about.items():
        print(f"{name:{width}} {value}")


def _libraries() -> list[str]:
    """Return the names of all declared libraries, except those for tests and docs."""
    try:
        declared = requires(DISTRIBUTION) or []
    except PackageNotFoundError:  # the program runs from a copy that is not installed
        return []
    wanted = [line for line in declared if not re.search(r"extra == .(test|docs)", line)]
    return sorted({re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in wanted}, key=str.lower)


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "not installed"
