"""The precision of FLINT's balls, in bits: all threads of a process share it."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

__all__ = ["working_precision"]

try:
    from flint import ctx
except ImportError:  # the extra `proof` is not installed
    ctx = None  # type: ignore[assignment]

_LOCK = RLock()


@contextmanager
def working_precision(bits: int) -> Iterator[None]:
    """Compute with balls of this precision; other threads wait until that is done.

    Bounds hold at any precision, but a thread that changed it would make those of another too wide.
    """
    with _LOCK, ctx.workprec(bits):
        yield
