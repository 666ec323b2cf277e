"""Who computed a cube: the versions of all that decides its numbers, and of the rest."""

import hashlib
import platform
import subprocess
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGE = Path(__file__).parents[1]
_DECIDING = ("llvmlite", "numba", "numpy", "rocket-fft", "scipy")


def digest_of(*patterns):
    """Of those files of the package: its version alone would miss an edit."""
    digest = hashlib.sha256()
    for path in sorted(path for pattern in patterns for path in _PACKAGE.glob(pattern)):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:12]


# Of the files as they are imported: a process that runs on while they are edited has the old ones.
_MATHEMATICS = digest_of("nasm/*.py", "pipeline/cubes/*.py")


def libraries():
    """{library: version} of those that decide the last digits, in this process."""
    return dict(zip(_DECIDING, map(_installed, _DECIDING), strict=True))


def computed_by():
    """In one line, what decides the numbers of a cube besides its plan: source and libraries."""
    found = {"mathematics": _MATHEMATICS, **libraries()}
    return ", ".join(f"{name} {which}" for name, which in found.items())


def provenance():
    """Attributes of a cube: versions of the package and its libraries, git commit, creation."""
    others = ("xarray", "zarr", "dask")
    return {
        "package_version": version("nasm-transport"),
        "computed_by": computed_by(),
        "git_commit": _git_commit(),
        "python_version": platform.python_version(),
        "library_versions": ", ".join(f"{name} {version(name)}" for name in others),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _installed(package):
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"


def _git_commit():
    """The commit of the source tree, "-dirty" if it was edited; "unknown" outside a checkout."""
    here = Path(__file__).parent
    command = ["git", "-C", str(here), "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        # Installed inside some other project's checkout, we would name that one's commit.
        tracked = subprocess.run(
            ["git", "-C", str(here), "ls-files", "--error-unmatch", Path(__file__).name],
            capture_output=True,
        )
        described = subprocess.run(command, capture_output=True, text=True)
    except OSError:
        return "unknown"
    if tracked.returncode or described.returncode:
        return "unknown"
    return described.stdout.strip()
