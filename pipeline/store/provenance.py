"""Who computed a cube: the versions of all that decides its numbers, and of the rest."""

import hashlib
import platform
import subprocess
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGE = Path(__file__).parents[2]
_MATHEMATICS = sorted([*_PACKAGE.glob("nasm/**/*.py"), *_PACKAGE.glob("pipeline/cubes/**/*.py")])
_DECIDING = "llvmlite", "numba", "numpy", "rocket-fft", "scipy", "xarray", "zarr"


def _versions(*packages):
    found = []
    for package in packages:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} missing")
    return ", ".join(found)


# Of the files as they are imported: a process that runs on while they are edited has the old ones.
# The version of the package alone would miss an edit.
_FILES = b"".join(
    path.relative_to(_PACKAGE).as_posix().encode() + path.read_bytes() for path in _MATHEMATICS
)
_COMPUTED_BY = f"mathematics {hashlib.sha256(_FILES).hexdigest()[:12]}, {_versions(*_DECIDING)}"


def computed_by():
    """What decides the numbers of a cube besides its plan, in one line: source and libraries."""
    return _COMPUTED_BY


def provenance(computed_by):
    """Attributes of a new cube: who computes it, versions, git commit, time of creation."""
    return {
        "computed_by": computed_by,
        "package_version": _versions("nasm-transport").rpartition(" ")[2],
        "git_commit": _git_commit(),
        "python_version": platform.python_version(),
        "library_versions": _versions("dask", "obstore"),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _git_commit():
    """The commit of the source tree, "-dirty" if it was edited; "unknown" outside a checkout."""
    if not (_PACKAGE / ".git").exists():  # we may be installed inside another project's checkout
        return "unknown"
    command = ["git", "-C", str(_PACKAGE), "describe", "--always", "--dirty", "--abbrev=40"]
    with suppress(OSError):
        return subprocess.run(command, capture_output=True, text=True).stdout.strip() or "unknown"
    return "unknown"
