"""Places where cubes are stored: a directory or a prefix in an object store, accessed by obstore.

The driver and each worker read credentials, endpoint and region from their own environment
(AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL, …); the driver does not pass them on to workers.
"""

import errno
import os
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

from filelock import FileLock, Timeout
from obstore.exceptions import AlreadyExistsError, BaseError
from obstore.store import LocalStore, from_url

if TYPE_CHECKING:
    from obstore import ObjectMeta
    from obstore.store import ObjectStore

MAX_FILE = 2**27
"""Size of the largest file that is read, in bytes."""

PATIENCE = 30
"""Seconds for which a request is retried while an object store does not answer."""

_NO_LOCKS = errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS
_NOT_THERE = FileNotFoundError, ValueError  # ValueError for a key that cannot be a file name
_URL = re.compile(r"(s3|gs|az)://[a-z0-9][a-z0-9._-]+(/[\w.=+-]+)+", re.ASCII)


class Refused(Exception):
    """The store cannot accept this sweep; nothing was done.

    The message gives the reason and the remedy.
    """


class StoreFailed(OSError):
    """The disk or the object store failed during a sweep. Committed tiles are preserved."""


def printable(text: str) -> str:
    """Return the text as one line; control characters, e.g. from an unknown store, become spaces.

    Examples
    --------
    >>> from pipeline.store import printable
    >>> printable("two\\nlines")
    'two lines'
    """
    return "".join(character if character.isprintable() else " " for character in text)


@dataclass(frozen=True)
class Place:
    """A place where cubes are stored, made by `place_of`. Keys are paths relative to the place.

    Attributes
    ----------
    root : str
        Absolute path of a directory, or URL of a prefix in an object store.
    """

    root: str

    def __str__(self) -> str:
        return self.root

    @property
    def is_directory(self) -> bool:
        """True for a directory, False for an object store."""
        return "://" not in self.root

    def cube(self, name: str) -> str:
        """Return the path or URL of the cube's zarr group."""
        return f"{self.root}/{name}.zarr"

    def objects(self, name: str | None = None) -> "ObjectStore":
        """Return the obstore store that contains all files, or only the files of one cube.

        Raises
        ------
        FileNotFoundError
            If the directory, or the cube in it, does not exist.
        """
        path = self.cube(name) if name else self.root
        exists = os.path.isfile(f"{path}/zarr.json") if name else os.path.isdir(path)
        if self.is_directory and not exists:  # obstore would create it
            raise FileNotFoundError(f"{path} does not exist, was moved, or its disk was removed")
        return _opened(path)

    def read(self, key: str, most: int = MAX_FILE) -> bytes:
        """Return the bytes of a file, b"" if missing; raise Refused if it exceeds `most` bytes."""
        with store_errors(self), suppress(*_NOT_THERE):
            file = self.objects().get(key)
            if (size := file.meta["size"]) > most:
                raise Refused(f"{self}/{key} has {size} bytes; at most {most} are read")
            return bytes(file.bytes())
        return b""

    def size(self, key: str) -> int:
        """Return the size of a file in bytes; 0 if it is missing."""
        with store_errors(self), suppress(*_NOT_THERE):
            return self.objects().head(key)["size"]
        return 0

    def write(
        self, key: str, data: bytes, mode: Literal["create", "overwrite"] = "overwrite"
    ) -> None:
        """Write a file completely or not at all; in mode "create", only if it does not exist."""
        with store_errors(self), suppress(AlreadyExistsError):
            self.objects().put(key, data, mode=mode)

    def delete(self, key: str) -> None:
        """Delete a file, if it exists."""
        with store_errors(self), suppress(FileNotFoundError):
            self.objects().delete(key)

    def files(self, prefix: str) -> Iterator["ObjectMeta"]:
        """Yield path, size and last_modified of each file below the prefix."""
        with store_errors(self), suppress(*_NOT_THERE):
            for page in self.objects().list(prefix, chunk_size=10_000):
                yield from page


def place_of(out: str | os.PathLike[str]) -> Place:
    """Return the Place that `out` names: a directory, or s3://, gs:// or az://BUCKET/PREFIX.

    Raises
    ------
    Refused
        If a URL has any other form.

    Examples
    --------
    >>> from pipeline.store import place_of
    >>> place = place_of("s3://bucket/run")
    >>> print(place, place.is_directory)
    s3://bucket/run False
    >>> place.cube("escape")
    's3://bucket/run/escape.zarr'
    """
    out = str(out)
    if "://" not in out:
        return Place(os.path.abspath(os.path.expanduser(out)))
    if not _URL.fullmatch(out.rstrip("/")):
        # The message does not repeat the URL, which may contain a password.
        raise Refused(
            "the URL of the store must be s3://BUCKET/PREFIX (or gs://, az://), made of letters, "
            "digits and ._=+-, without user, password or '?'; credentials go into the environment, "
            "e.g. AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
        )
    return Place(out.rstrip("/"))


def without_password(text: str) -> str:
    """Return the text without the user names and passwords in its URLs.

    Examples
    --------
    >>> from pipeline.store import without_password
    >>> without_password("http://me:secret@host:9000")
    'http://host:9000'
    """
    return re.sub(r"(?<=://)\S*@", "", text)


@lru_cache
def _opened(path: str) -> "ObjectStore":
    """Return the obstore store for a directory or a URL."""
    if "://" not in path:
        return LocalStore(path)
    # Retries are limited only by time: obstore's default of ten retries is used up in 2 to 8 s.
    timeout = timedelta(seconds=PATIENCE)
    return from_url(path, retry_config={"max_retries": 10**6, "retry_timeout": timeout})


@contextmanager
def driver_lock(place: Place) -> Iterator[None]:
    """Lock a directory, creating it if necessary, so that no second driver writes to it.

    Object stores and directories on file systems without locks are not locked. Two drivers that
    write to the same one duplicate each other's work.

    Raises
    ------
    Refused
        If another driver holds the lock, or the directory cannot be written to.

    Examples
    --------
    >>> from pipeline.store import driver_lock, place_of
    >>> with driver_lock(place := place_of("run")):
    ...     place.write("note", b"written by one driver")
    """
    lock: AbstractContextManager[object] = nullcontext()
    if place.is_directory:
        try:
            os.makedirs(place.root, exist_ok=True)
            lock = FileLock(f"{place}/.lock").acquire(timeout=0)
        except NotImplementedError:  # filelock's error for a file system without locks
            pass
        except Timeout:
            cure = "wait for it, stop it, or choose another --out"
            raise Refused(f"{place} is being written by another run; {cure}") from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                reason = f"cannot write to {place}: {error.strerror}"
                raise Refused(f"{reason}; choose another --out") from None
    with lock:
        yield


@contextmanager
def store_errors(place: Place) -> Iterator[None]:
    """Convert errors of obstore and zarr that indicate a failure of the store to StoreFailed."""
    try:
        yield
    except BaseException as error:
        if isinstance(error, ValueError) and "computed checksum" in str(error):
            reason = "some chunks are damaged; run `python -m workflows.verify --repair` on it"
        # Errors from local files have an errno. A setting that obstore cannot parse, e.g.
        # an endpoint that is not a URL, raises a PanicException.
        elif (
            isinstance(error, BaseError)
            or type(error).__name__ == "PanicException"
            or (isinstance(error, FileNotFoundError | PermissionError) and error.errno is None)
        ):
            # The rest of the message and a URL's query string may contain a signature.
            reason = without_password(re.split(r"[\n<]|Debug source", str(error))[0])
            reason = re.sub(r"\?\S+", "", reason).strip(" :")
        else:
            raise
        raise StoreFailed(f"{place}: {reason}") from None
