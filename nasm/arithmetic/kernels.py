"""Compiled kernels, kept on disk: each is compiled once per machine, not once per process.

`@kernel` is Numba's `njit(nogil=True)` with Numba's own cache on disk and three further guarantees.

- *Never stale.* Numba checks only whether the file that defines a kernel has changed, but code from
  other files is compiled into the kernel. Here the directory is named after a digest of all sources
  of this package and the version of rocket-fft, so every version of the sources has its own
  directory. Within it, Numba distinguishes its own version, the processor and the argument types. A
  process whose sources have been edited or upgraded since it imported them may contain code from
  both versions, so it neither loads nor stores kernels.
- *Many processes.* If several processes need the same missing kernel, one compiles it while the
  others wait and then load it: a lock is held until the kernel is stored. On a file system without
  locks each may compile it; files are replaced atomically, so none is corrupted.
- *No harm.* If a file cannot be written or read, because the disk is full or the file is damaged,
  the kernel is compiled as if there were no cache; kernels are still loaded from a read-only
  directory. Each file ends with a digest of its content, because machine code with one flipped bit
  could crash every process that loads it. A kernel runs with its user's permissions, so directories
  and files are not used if they belong to anyone but this user or root, or if others can write to
  them.

The directory is in NUMBA_CACHE_DIR if that is set, otherwise in the user's cache folder. Only
functions called from Python need to be kernels; the functions that kernels call are compiled into
them and need only `njit`.
"""

import hashlib
import os
import pickle
import secrets
import shutil
import stat
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

from numba import config, njit
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
)
from numba.misc.appdirs import AppDirs

from nasm import sources

__all__ = ["are_missing", "begin_without_scipy", "directory", "kernel"]

_EXPIRY_SECONDS = 30 * 24 * 3600
"""Age at which kernels from another version are deleted."""

_LOCK_TIMEOUT = 60
"""Seconds to wait for another process that is compiling the same kernel."""


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function as `njit(nogil=True, **options)` does, and store the result on disk.

    Parameters
    ----------
    function : callable
        Function to compile; None to return a decorator with these options.
    **options
        Options of `numba.njit`.

    Returns
    -------
    Dispatcher
        Numba's compiled function.

    Examples
    --------
    >>> from nasm.arithmetic.kernels import kernel
    >>> kernel(nogil=True)  # doctest: +ELLIPSIS
    functools.partial(...)
    """
    if function is None:
        return partial(kernel, **options)
    dispatcher = njit(nogil=True, **options)(function)
    if directory() is not None:
        dispatcher._cache = _Cache(function)  # as cache=True would, but with our own cache
    return dispatcher


def begin_without_scipy() -> None:
    """Import what Numba needs for its first kernel, except scipy.fft and scipy.linalg.

    Those two make up half of what Numba imports. Programs should call this function; no module
    calls it on import. Afterwards Numba can compile neither np.cov nor scipy.fft, but no kernel of
    nasm calls either of them.
    """
    if unused := {"scipy.fft", "scipy.linalg"} - sys.modules.keys():
        sys.modules.update(dict.fromkeys(unused))  # type: ignore[arg-type]  # None hides a module
        import_module("numba.np.arraymath")
        import_module("rocket_fft")

        for name in unused:
            del sys.modules[name]


@cache
def directory() -> Path | None:
    """Return the directory for kernels compiled from these sources; create it if necessary.

    Returns
    -------
    Path or None
        None if the directory cannot be created, or if anyone but this user or root can write to it.
        In the latter case, a warning is issued once.
    """
    digest = sources.digest()
    digest.update(version("rocket-fft").encode())
    folder = config.CACHE_DIR  # type: ignore[attr-defined]
    root = Path(folder or AppDirs("nasm", appauthor=False).user_cache_dir)
    path = root / f"kernels-{digest.hexdigest()[:16]}"
    with suppress(OSError):
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.utime(path)
        for other in root.glob("kernels-" + "?" * 16):
            if other.stat().st_mtime < time.time() - _EXPIRY_SECONDS:
                shutil.rmtree(other, ignore_errors=True)
    if not path.is_dir():
        return None
    if not _is_trusted(path.stat()):
        warnings.warn(
            f"compiled kernels are neither loaded from {path} nor stored there, because another "
            "user owns it or can write to it; set NUMBA_CACHE_DIR to a directory of your own",
            RuntimeWarning,
            stacklevel=2,
        )
        return None
    return path


def _is_trusted(file):
    """Return True if only this user or root can write to a file or directory, given its stat."""
    return file.st_uid in (os.geteuid(), 0) and not file.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def are_missing() -> bool:
    """Return True if the kernels of these sources have yet to be compiled on this machine."""
    path = directory()
    return path is not None and os.access(path, os.W_OK) and not any(path.glob("*.nbc"))


@cache
def _warn_of_changed_sources():
    warnings.warn(
        "the sources of nasm have changed since this process imported them; until it is "
        "restarted, it keeps the kernels it has loaded, and compiles any others itself",
        RuntimeWarning,
        stacklevel=1,
    )


class _Locator(_CacheLocator):
    """Tells Numba's cache where to store the compiled code of a function."""

    def __init__(self, function, source):
        self._py_file, self._line = source, function.__code__.co_firstlineno
        self._module = function.__module__

    @classmethod
    def from_function(cls, function, source):
        return cls(function, source)

    def get_cache_path(self):
        return str(directory())

    def get_source_stamp(self):
        return directory().name

    def get_disambiguator(self):
        # Numba would use only the last part of the module name, which is the same for
        # circles.newton and tori.newton.
        return f"{self._module}-{self._line}"


class _CompileResults(CompileResultCacheImpl):
    _locator_classes = (_Locator,)  # type: ignore[assignment]


class _Files(IndexDataCacheFile):
    """Numba's cache files for a function: an index, and one file per signature.

    Reading a damaged file raises OSError.
    """

    def _data_name(self, number):
        # Random, so that processes without a lock do not store two signatures in the same file.
        return super()._data_name(secrets.randbits(64))

    def _dump(self, obj):
        data = super()._dump(obj)
        return data + hashlib.sha256(data).digest()

    @contextmanager
    def _open_for_write(self, path):
        with super()._open_for_write(path) as file:
            os.fchmod(file.fileno(), 0o600)  # regardless of the umask
            yield file

    def _load_index(self):
        if os.path.exists(self._index_path):
            _check(self._index_path, len(pickle.dumps(self._version, protocol=-1)))
        return super()._load_index()

    def _load_data(self, name):
        _check(self._data_path(name))
        return super()._load_data(name)


def _check(path, start=0):
    """Raise OSError if the file is damaged or `_is_trusted` rejects it.

    The last 32 bytes must be the digest of everything from `start` up to that point.
    """
    with open(path, "rb") as file:
        if not _is_trusted(os.fstat(file.fileno())):
            raise OSError(f"{path} can be written by other users")
        content = file.read()[start:]
    if hashlib.sha256(content[:-32]).digest() != content[-32:]:
        raise OSError(f"{path} is damaged")


class _Cache(FunctionCache):
    """Numba's cache for a function; if it fails, the function is silently compiled instead."""

    _impl_class = _CompileResults

    def __init__(self, function):
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _Files(self._cache_path, self._impl.filename_base, stamp)
        self._lock = None

    def load_overload(self, sig, target_context):
        if not sources.are_unchanged():
            _warn_of_changed_sources()
            return None
        with suppress(Exception):  # a damaged file may raise anything when it is unpickled
            if (overload := super().load_overload(sig, target_context)) is not None:
                return overload
        from filelock import FileLock  # 0.1 s to import, and rarely needed

        self._lock = self._lock or FileLock(f"{self._cache_file._index_path}.lock")
        with suppress(Exception):  # without the lock, others may compile the kernel too
            self._lock.acquire(timeout=_LOCK_TIMEOUT)
        overload = None
        try:
            overload = super().load_overload(sig, target_context)
        except Exception:
            with suppress(OSError):
                self.flush()
        if overload is not None:
            self._lock.release()
        return overload

    def save_overload(self, sig, data):
        if sources.are_unchanged():
            with suppress(OSError):
                super().save_overload(sig, data)
        if self._lock is not None:
            self._lock.release()
