"""What the process does with memory that its arrays no longer need.

Circles near their breakup and tori are arrays of up to 10⁶ points, each step of Newton's method
makes many of them, and the C library takes memory for each from the system and returns it: a third
of the time is spent in page faults.
"""

import ctypes
from contextlib import suppress

__all__ = ["keep_freed_memory"]

_GIGABYTE = 2**30


def keep_freed_memory():
    """Let the whole process keep memory that is freed, as programs should that compute circles.

    It is for programs, such as workers and commands, and no module calls it when it is imported. It
    holds for threads that start later. With another C library than GNU's it does nothing.
    """
    with suppress(OSError, AttributeError):
        tell = ctypes.CDLL(None).mallopt
        tell(-3, _GIGABYTE)  # M_MMAP_THRESHOLD: smaller blocks come from the heap,
        tell(-1, _GIGABYTE)  # M_TRIM_THRESHOLD: which keeps them,
        tell(-8, 1)  # M_ARENA_MAX: and serves all threads
