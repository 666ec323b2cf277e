"""Keep memory in the process after its arrays are freed.

Circles near their breakup and tori are arrays of up to 10⁶ points, each step of Newton's method
makes many of them, and the C library takes memory for each from the system and returns it: a third
of the time is spent in page faults.
"""

import ctypes
from contextlib import suppress

__all__ = ["keep_freed_memory"]

_GIGABYTE = 2**30


def keep_freed_memory() -> None:
    """Let the whole process keep memory that is freed, as programs that compute circles should.

    Call it in programs, such as workers and commands; no module calls it on import. It applies to
    threads that start later. With a C library other than GNU's it does nothing.

    Examples
    --------
    >>> from nasm.arithmetic.memory import keep_freed_memory
    >>> keep_freed_memory()  # doctest: +SKIP
    """
    with suppress(OSError, AttributeError):
        set_option = ctypes.CDLL(None).mallopt
        set_option(-3, _GIGABYTE)  # M_MMAP_THRESHOLD: smaller blocks come from the heap,
        set_option(-1, _GIGABYTE)  # M_TRIM_THRESHOLD: which keeps them,
        set_option(-8, 1)  # M_ARENA_MAX: and serves all threads
