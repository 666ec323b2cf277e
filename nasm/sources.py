"""The source files of this package: their digest, and whether they still are what was imported.

This module is imported with the package, before all others. As long as no file has changed since,
everything that the process has imported from here was made of the files that it finds.
"""

import hashlib
import os
from pathlib import Path

__all__ = ["are_unchanged", "digest"]

_ROOT = Path(__file__).parent


def _stamps(folder):
    """Times and sizes of the .py files in a folder and below; none of them can be set back."""
    stamps = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                stamps |= _stamps(entry.path)
            elif entry.name.endswith(".py"):
                status = entry.stat()
                stamps[entry.path] = status.st_mtime_ns, status.st_ctime_ns, status.st_size
    return stamps


def _current():
    try:
        return _stamps(_ROOT)
    except OSError:  # in a zip archive, or removed
        return {}


_AT_IMPORT = _current()


def are_unchanged():
    """Return whether the files, if there are any, are those that were there at the import."""
    return bool(_AT_IMPORT) and _current() == _AT_IMPORT


def digest():
    """Return the SHA-256 of the names and contents of all files, as a hashlib object."""
    sha = hashlib.sha256()
    for path in sorted(_ROOT.rglob("*.py")):
        sha.update(path.relative_to(_ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return sha
