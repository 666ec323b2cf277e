"""Source files of this package: their digest, and a check that they have not changed since import.

The package imports this module before its other modules. As long as no file has changed since
then, every module that the process has imported agrees with the files on disk.
"""

import hashlib
import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the type of hashlib's hash objects
    from hashlib import _Hash

__all__ = ["are_unchanged", "digest"]

DISTRIBUTION = "nasm-transport"
"""Name of the installed distribution."""

_ROOT = Path(__file__).parent


def _stamps(folder: str | Path) -> dict[str, tuple[int, int, int]]:
    """Return the times and sizes of all .py files below a folder.

    The times are those of the last modification and of the last change of status (ctime); programs
    cannot set the latter back.
    """
    stamps: dict[str, tuple[int, int, int]] = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                stamps |= _stamps(entry.path)
            elif entry.name.endswith(".py"):
                status = entry.stat()
                stamps[entry.path] = status.st_mtime_ns, status.st_ctime_ns, status.st_size
    return stamps


def _current() -> dict[str, tuple[int, int, int]]:
    try:
        return _stamps(_ROOT)
    except OSError:  # the package is in a zip archive, or was removed
        return {}


_AT_IMPORT = _current()


def are_unchanged() -> bool:
    """Return True if the source files exist and have not changed since import.

    Examples
    --------
    >>> from nasm.sources import are_unchanged
    >>> are_unchanged() in (True, False)
    True
    """
    return bool(_AT_IMPORT) and _current() == _AT_IMPORT


def digest() -> "_Hash":
    """Return the SHA-256 of the names and contents of all source files, as a hashlib object.

    Examples
    --------
    >>> from nasm.sources import digest
    >>> len(digest().hexdigest())
    64
    """
    sha = hashlib.sha256()
    for path in sorted(_ROOT.rglob("*.py")):
        sha.update(path.relative_to(_ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return sha
