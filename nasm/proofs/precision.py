"""Working precision of FLINT's ball arithmetic, in bits; all threads of a process share it."""

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
    """Set the precision in a `with` block; other threads that set it wait until the block ends.

    Bounds are valid at any precision, but if one thread lowered it while another was computing, the
    latter's bounds would become too wide.
    """
    with _LOCK, ctx.workprec(bits):
        yield
