"""A store's place on a disk: a directory, its files named by keys `a/b/c`.

Every file is written aside and renamed into place, and so is every group, so that a killed process
leaves nothing half-written. One driver at a time: a lock that dies with its process.
"""

import errno
import fcntl
import os
import shutil
import stat
import time
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from typing import ClassVar
from uuid import uuid4

from pipeline.faults import StorageError, StoreError

_ASIDE = ".partial"
_LOCK = ".lock"
_CURES = {
    errno.ENOSPC: "make room on the disk",
    errno.EDQUOT: "make room within the disk quota",
    errno.EFBIG: "raise the limit on the size of files",
    errno.ENOENT: "it was moved or deleted under way; put it back",
    errno.ENOTDIR: "it was moved or deleted under way; put it back",
}


@dataclass(frozen=True)
class Directory:
    """root : str, absolute: workers need not share our working directory."""

    root: str
    groups_appear_whole: ClassVar[bool] = True
    probe: ClassVar[str] = f"{_ASIDE}/probe"
    """Key of a file that says whose directory it is, while it is held."""

    def __str__(self):
        return self.root

    def names(self, key=""):
        """Names of what others have put there, or we before; empty if there is no directory."""
        if os.path.exists(self.root) and not os.path.isdir(self.root):
            raise StoreError(f"{self} is a file; --out must be a directory")
        try:
            return set(os.listdir(f"{self.root}/{key}")) - {_ASIDE, _LOCK}
        except FileNotFoundError:
            return set()
        except OSError as error:
            raise StoreError(
                f"cannot read {self}: {error.strerror}; choose another --out"
            ) from None

    @contextmanager
    def held(self):
        """Hold the directory as its one driver; makes it, clears a killed one's mess."""
        try:
            os.makedirs(self.root, exist_ok=True)
            lock = self._open_lock(os.O_RDWR | os.O_CREAT)
        except OSError as error:
            why = f"cannot write to {self}: {error.strerror}; choose another --out"
            raise StoreError(why) from None
        with lock:
            if not _locked(lock):
                lock.seek(0)
                raise StoreError(
                    f"{self} is being written by another run (process "
                    f"{lock.read().strip() or '?'}); wait for it, stop it, or choose another --out"
                )
            aside = f"{self.root}/{_ASIDE}"
            with self._failing():
                lock.truncate(0)
                lock.write(str(os.getpid()))
                lock.flush()
                shutil.rmtree(aside, ignore_errors=True)
                os.makedirs(aside, exist_ok=True)  # a worker of a driver that died may write there
            try:
                yield
            finally:
                shutil.rmtree(aside, ignore_errors=True)

    def _open_lock(self, flags):
        """The lock file; OSError if it is none, for it is written: no link, and no pipe."""
        path = f"{self.root}/{_LOCK}"
        lock = os.fdopen(os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644), "r+")
        if stat.S_ISREG(os.fstat(lock.fileno()).st_mode):
            return lock
        lock.close()
        raise OSError(errno.EINVAL, f"{_LOCK} is no file of ours")

    def driver(self):
        """Who holds the directory now, in words; "" if nobody does."""
        try:
            with self._open_lock(os.O_RDONLY) as lock:
                try:
                    # Given back at once, as the file is closed.
                    fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
                except OSError:
                    return f"process {lock.read().strip() or '?'}"
        except FileNotFoundError:
            return ""
        except OSError as error:
            raise StoreError(f"cannot read {self}: {error.strerror}") from None
        return ""

    def put(self, key, data):
        """Write the file, which appears whole or not at all."""
        with self._failing():
            aside = self._aside()
            try:
                with open(aside, "xb") as file:
                    file.write(data)
                self._place(aside, key)
            except OSError:
                with suppress(OSError):
                    os.unlink(aside)
                raise

    def _place(self, aside, key):
        target = f"{self.root}/{key}"
        try:
            os.rename(aside, target)
        except FileNotFoundError:
            # The first chunk of its row. An array that is gone was moved away: it must not grow
            # again here, without its metadata; so make what is below it only.
            path, chunks, below = target.rpartition("/c/")
            if not chunks:
                raise
            for part in ["c", *below.split("/")[:-1]]:
                path = f"{path}/{part}"
                with suppress(FileExistsError):
                    os.mkdir(path)
            os.rename(aside, target)

    def put_files(self, key, files):
        """Write the files {name below the key: bytes}, each whole, beside what else is there."""
        for name, data in files.items():
            with self._failing():
                os.makedirs(os.path.dirname(f"{self.root}/{key}/{name}"), exist_ok=True)
            self.put(f"{key}/{name}", data)

    def put_group(self, key, files):
        """Write the files {key in the group: bytes} in place of what is there, in one rename."""
        with self._failing():
            aside, target = self._aside(), f"{self.root}/{key}"
            for name, data in files.items():
                os.makedirs(os.path.dirname(f"{aside}/{name}"), exist_ok=True)
                with open(f"{aside}/{name}", "xb") as file:
                    file.write(data)
                    file.flush()
                    os.fsync(file.fileno())  # tiles that a power cut takes can be computed again
            self.delete_group(key)
            os.rename(aside, target)

    def delete_group(self, key):
        """Delete a group and all below, if it is there; it vanishes in one rename."""
        with self._failing(), suppress(FileNotFoundError):
            aside = self._aside()
            os.rename(f"{self.root}/{key}", aside)
            shutil.rmtree(aside, ignore_errors=True)

    def read(self, key):
        """The bytes of a file, or None if it is not there."""
        with self._failing("read"):
            try:
                with open(f"{self.root}/{key}", "rb") as file:
                    return file.read()
            except (FileNotFoundError, NotADirectoryError):
                return None

    def size(self, key):
        """The length of a file in bytes, or None if it is not there."""
        with self._failing("read"):
            try:
                return os.path.getsize(f"{self.root}/{key}")
            except (FileNotFoundError, NotADirectoryError):
                return None

    def sizes(self, prefix):
        """Yield (key, bytes) of all files below; no list of them is kept."""
        start = len(self.root) + 1
        with self._failing("read"):
            for entry in _files(f"{self.root}/{prefix}"):
                yield entry.path[start:], entry.stat().st_size

    def changes(self, prefix):
        """{key: (bytes, time of its last change in seconds)} of all files below."""
        start = len(self.root) + 1
        with self._failing("read"):
            found = (
                (entry.path[start:], entry.stat()) for entry in _files(f"{self.root}/{prefix}")
            )
            return {key: (status.st_size, status.st_mtime) for key, status in found}

    def delete(self, keys):
        """Delete the files; one that is not there is none to delete."""
        with self._failing():
            for key in keys:
                with suppress(FileNotFoundError):
                    os.unlink(f"{self.root}/{key}")

    def explained(self):
        """Others' errors as they read here, in words: the operating system's are in words."""
        return nullcontext()

    def zarr_store(self, key):
        """What zarr reads there."""
        from zarr.storage import LocalStore

        return LocalStore(f"{self.root}/{key}", read_only=True)

    def _aside(self):
        return f"{self.root}/{_ASIDE}/{uuid4().hex}"

    @contextmanager
    def _failing(self, doing="write to"):
        try:
            yield
        except StorageError:  # in words already
            raise
        except OSError as error:
            cure = _CURES.get(error.errno, "put that right")
            raise StorageError(f"cannot {doing} {self}: {error.strerror}; {cure}") from None


def _files(directory):
    """Yield the os.DirEntry of each file in the directory, if it is there, and below."""
    with suppress(FileNotFoundError), os.scandir(directory) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                yield from _files(entry.path)
            else:
                yield entry


def _locked(file):
    """Lock the file, if no other driver has. `driver` locks it for a moment too: try again."""
    for _ in range(3):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except OSError:
            time.sleep(0.05)
    return False
