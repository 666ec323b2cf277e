"""What can go wrong with a store, in words for the one who runs the program."""


class StoreError(Exception):
    """The store cannot take this sweep; the message says why, and what to do. Nothing was done."""


class StorageError(OSError):
    """The disk or the object store failed under way; the message says how, and what to do.

    What is committed stays: run again to go on.
    """
