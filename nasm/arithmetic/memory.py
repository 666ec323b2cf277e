"""Keep memory in the process after arrays are freed.

Tori, and circles near their breakup, are arrays of up to 10⁶ points. Each step of Newton's method
allocates many such arrays, and by default the C library requests memory for each from the system
and returns it afterwards: a third of the time is spent in page faults.
"""

import ctypes
from contextlib import suppress

__all__ = ["keep_freed_memory"]

_GIGABYTE = 2**30


def keep_freed_memory() -> None:
    """Let the whole process keep freed memory; programs that compute circles should call this.

    Call it in programs, such as workers and commands; no module calls it on import. It affects
    threads that start after the call. With a C library other than GNU's it does nothing.

    Examples
    --------
    >>> from nasm.arithmetic.memory import keep_freed_memory
    >>> keep_freed_memory()  # doctest: +SKIP
    """
    with suppress(OSError, AttributeError):
        set_option = ctypes.CDLL(None).mallopt
        set_option(-3, _GIGABYTE)  # M_MMAP_THRESHOLD: smaller blocks come from the heap
        set_option(-1, _GIGABYTE)  # M_TRIM_THRESHOLD: the heap keeps freed blocks
        set_option(-8, 1)  # M_ARENA_MAX: one heap serves all threads
