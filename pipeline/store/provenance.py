"""Who computed a cube: the versions of all that decides its numbers."""

import hashlib
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from nasm import __version__

_PACKAGE = Path(__file__).parents[2]
_MATHEMATICS = sorted([*_PACKAGE.glob("nasm/**/*.py"), *_PACKAGE.glob("pipeline/cubes/**/*.py")])
_DECIDING = "llvmlite", "numba", "numpy", "rocket-fft", "scipy", "xarray", "zarr"
# Of the files as they are imported: a process that runs on while they are edited has the old ones.
# The version of the package alone would miss an edit.
_FILES = b"".join(
    path.relative_to(_PACKAGE).as_posix().encode() + path.read_bytes() for path in _MATHEMATICS
)
_VERSIONS = (f"{package} {version(package)}" for package in _DECIDING)
# What decides the numbers of a cube besides its plan, in one line: source and libraries.
COMPUTED_BY = ", ".join([f"mathematics {hashlib.sha256(_FILES).hexdigest()[:12]}", *_VERSIONS])


def provenance(computed_by):
    """Attributes of a new cube: who computes it, which version of the package, and when."""
    return {
        "computed_by": computed_by,
        "package_version": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }
