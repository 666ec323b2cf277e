"""Keep memory in the process after arrays are freed.

Tori, and circles near their breakup, are stored in arrays of up to 10⁶ points. Each step of
Newton's method allocates many such arrays. By default the C library requests memory for each of
them from the system and returns it afterwards. A third of the run time is then spent on page
faults.
"""

import ctypes
from contextlib import suppress

__all__ = ["keep_freed_memory"]


def keep_freed_memory() -> None:
    """Make the whole process keep freed memory for reuse.

    Programs that compute circles, such as workers and commands, should call this function; no
    module calls it on import. Call it before starting threads: those that started earlier may keep
    heaps of their own. With a C library other than GNU's it has no effect.

    Examples
    --------
    >>> from nasm.arithmetic.memory import keep_freed_memory
    >>> keep_freed_memory()  # doctest: +SKIP
    """
    with suppress(OSError, AttributeError):
        set_option, gigabyte = ctypes.CDLL(None).mallopt, 2**30
        set_option(-3, gigabyte)  # M_MMAP_THRESHOLD: smaller blocks come from the heap
        set_option(-1, gigabyte)  # M_TRIM_THRESHOLD: the heap keeps freed blocks
        set_option(-8, 1)  # M_ARENA_MAX: one heap serves all threads
