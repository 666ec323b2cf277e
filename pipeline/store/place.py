"""Where cubes are kept: a directory, or a prefix in an object store, both through obstore.

Credentials, endpoint and region come from the environment (AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL, …)
of the driver and of each worker, and go nowhere from there.
"""

import errno
import os
import re
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache

from filelock import FileLock, Timeout
from obstore.exceptions import AlreadyExistsError, BaseError
from obstore.store import LocalStore, from_url

MAX_FILE = 2**27  # bytes of a file that is read
PATIENCE = 30  # seconds for which a request is repeated while an object store does not answer
_NO_LOCKS = errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS
_NOT_THERE = FileNotFoundError, ValueError  # the second for a key that no file can have
_URL = re.compile(r"(s3|gs|az)://[a-z0-9][a-z0-9._-]+(/[\w.=+-]+)+", re.ASCII)


class Refused(Exception):
    """The store cannot take this sweep; the message says why, and what to do. Nothing was done."""


class StoreFailed(OSError):
    """The disk or the object store failed under way. What is committed stays."""


def printable(text):
    """The text in one line, without control characters, which a stranger's store may hold."""
    return "".join(character if character.isprintable() else " " for character in text)


@dataclass(frozen=True)
class Place:
    """Where cubes are kept; see `place_of`. Keys are paths of files below it."""

    root: str  # absolute path of a directory, or URL of a prefix in an object store

    def __str__(self):
        return self.root

    @property
    def is_directory(self):
        return "://" not in self.root

    def cube(self, name):
        """Path or URL of the cube's zarr group."""
        return f"{self.root}/{name}.zarr"

    def objects(self, name=None):
        """The obstore store of all files, or of those of one cube, which must be there."""
        path = self.cube(name) if name else self.root
        is_there = os.path.isfile(f"{path}/zarr.json") if name else os.path.isdir(path)
        if self.is_directory and not is_there:  # obstore would make it anew
            raise FileNotFoundError(f"{path} does not exist, was moved, or its disk is gone")
        return _opened(path)

    def read(self, key, most=MAX_FILE):
        """The bytes of a file; empty if it is missing; Refused if there are more than `most`."""
        with store_errors(self), suppress(*_NOT_THERE):
            file = self.objects().get(key)
            if (size := file.meta["size"]) > most:
                raise Refused(f"{self}/{key} has {size} bytes, and {most} are read at most")
            return bytes(file.bytes())
        return b""

    def size(self, key):
        """The bytes that a file has; 0 if it is missing."""
        with store_errors(self), suppress(*_NOT_THERE):
            return self.objects().head(key)["size"]
        return 0

    def write(self, key, data, mode="overwrite"):
        """Write a file, whole or not at all; with the mode "create" only if it is not there."""
        with store_errors(self), suppress(AlreadyExistsError):
            self.objects().put(key, data, mode=mode)

    def delete(self, key):
        """Delete a file, if it is there."""
        with store_errors(self), suppress(FileNotFoundError):
            self.objects().delete(key)

    def files(self, prefix):
        """Yield what the store tells of each file below the prefix: path, size, last_modified."""
        with store_errors(self), suppress(*_NOT_THERE):
            for page in self.objects().list(prefix, chunk_size=10_000):
                yield from page


def place_of(out):
    """Return the Place that `out` names: a directory, or s3://, gs:// or az://BUCKET/PREFIX."""
    out = str(out)
    if "://" not in out:
        return Place(os.path.abspath(os.path.expanduser(out)))
    if not _URL.fullmatch(out.rstrip("/")):
        # The URL is not repeated: what is wrong with it may be a password in it.
        raise Refused(
            "the URL of the store must be s3://BUCKET/PREFIX (or gs://, az://), of letters, digits "
            "and ._=+-, without user, password or '?'; credentials go into the environment, "
            "e.g. AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
        )
    return Place(out.rstrip("/"))


def without_password(text):
    """Return the text, whose URLs may be those of an environment, without the users in them."""
    return re.sub(r"(?<=://)\S*@", "", text)


@lru_cache
def _opened(path):
    if "://" not in path:
        return LocalStore(path)
    # The time alone decides: ten retries, obstore's default, are over after two to eight seconds.
    retries = {"max_retries": 10**6, "retry_timeout": timedelta(seconds=PATIENCE)}
    return from_url(path, retry_config=retries)


@contextmanager
def driver_lock(place):
    """Keep a second driver off a directory, which is made if need be.

    Nothing keeps one off an object store, or off a directory of a file system without locks: two
    drivers then write the same bytes twice.
    """
    lock = nullcontext()
    if place.is_directory:
        try:
            os.makedirs(place.root, exist_ok=True)
            lock = FileLock(f"{place}/.lock").acquire(timeout=0)
        except NotImplementedError:  # a file system without locks, by filelock's word
            pass
        except Timeout:
            words = "is being written by another run; wait for it, stop it, or choose another --out"
            raise Refused(f"{place} {words}") from None
        except OSError as e:
            if e.errno not in _NO_LOCKS:
                words = f"cannot write to {place}: {e.strerror}; choose another --out"
                raise Refused(words) from None
    with lock:
        yield


@contextmanager
def store_errors(place):
    """Turn what obstore and zarr raise inside, because the store fails, into a StoreFailed."""
    try:
        yield
    except BaseException as error:
        if isinstance(error, ValueError) and "computed checksum" in str(error):
            words = "some chunks are damaged; run `python -m workflows.verify --repair` on it"
        # About a file of this machine there is a number. A setting that obstore cannot digest, e.g.
        # an endpoint that is no URL, is a PanicException.
        elif (
            isinstance(error, BaseError)
            or type(error).__name__ == "PanicException"
            or (isinstance(error, FileNotFoundError | PermissionError) and error.errno is None)
        ):
            # The rest of the message and a URL's query string may contain a signature.
            words = without_password(re.split(r"[\n<]|Debug source", str(error))[0])
            words = re.sub(r"\?\S+", "", words).strip(" :")
        else:
            raise
        raise StoreFailed(f"{place}: {words}") from None
