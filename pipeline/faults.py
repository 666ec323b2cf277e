"""What can go wrong with a store or a cluster, in words for the one who runs the program."""

NO_SCHEDULER = "the dask scheduler is gone; run again to resume"


class StoreError(Exception):
    """The store cannot take this sweep; the message says why, and what to do. Nothing was done."""


class StorageError(OSError):
    """The disk or the object store failed under way; the message says how, and what to do.

    What is committed stays: run again to go on.
    """


LONGEST_REASON = 2000
"""Bytes of what the store keeps of an exception; a character may take four."""


def reason_of(exception):
    """An exception in one line of bounded length, whatever it is."""
    try:
        words = str(exception)
    except Exception:
        words = "(which has no words)"
    return in_one_line(f"{type(exception).__name__}: {words}"[: LONGEST_REASON // 4])


def in_one_line(text):
    """Without what a terminal would obey."""
    return "".join(character if character.isprintable() else " " for character in text)
