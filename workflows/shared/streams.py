"""Make standard output and standard error safe to write to, whatever their state.

Characters that a stream's encoding lacks, e.g. κ in latin-1, are written as \\u03ba. If the reader
(`| head -1`) or the terminal disappears, the run continues: later output is dropped, and files are
still written. A closed stream is replaced by /dev/null. If writing to standard output fails for
another reason, e.g. on a full disk, the command fails; failures on standard error are ignored.
"""

import errno
import io
import os
import select
import sys
from typing import Any

import click

_READER_GONE = errno.EPIPE, errno.EIO, errno.ECONNRESET  # the reader or the terminal disappeared


class _Stream(io.FileIO):
    """A file descriptor that ignores all writes after one has failed."""

    failed = False

    def write(self, data: Any) -> int:
        while not self.failed:
            try:
                if (written := super().write(data)) is not None:
                    return written
                select.select([], [self], [])  # another process may have made it non-blocking
            except OSError as error:
                self.failed = True
                if self.fileno() == 1 and error.errno not in _READER_GONE:
                    reason = f"standard output cannot be written: {error.strerror}"
                    raise click.ClickException(reason) from None
        return len(data)


def prepare() -> None:
    """Make the standard streams of this process safe, except those that a program has replaced."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:  # it is closed, and the next file to be opened would get its number
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        if (stream := getattr(sys, name)) is getattr(sys, f"__{name}__"):
            raw = io.BufferedWriter(_Stream(descriptor, "w", closefd=False))
            encoding = getattr(stream, "encoding", "utf-8")  # a closed stream is None
            safe = io.TextIOWrapper(raw, encoding, "backslashreplace", line_buffering=True)
            setattr(sys, name, safe)


class Prepared:
    """A click command, or group, that prepares the streams before it writes anything."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Prepare the streams and run the command."""
        prepare()
        return super().main(*args, **kwargs)  # type: ignore[misc]  # super() is a click.Command
