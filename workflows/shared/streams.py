"""Standard output and error in any state that a session leaves them in.

What the encoding of a stream lacks, as κ in latin-1, is written as \\u03ba. A reader that goes away
(`| head -1`), or a terminal, ends nothing: what is written after it is dropped, and files are kept.
A closed stream is /dev/null. Where findings cannot be written, as on a full disk, is an error; of
messages it is none.
"""

import errno
import io
import os
import select
import sys

import click

_GONE = errno.EPIPE, errno.EIO, errno.ECONNRESET  # the reader, or the terminal


class _Stream(io.FileIO):
    """A descriptor to which writing goes on, and does nothing, once it has failed."""

    failed = False

    def write(self, data):
        while not self.failed:
            try:
                if (written := super().write(data)) is not None:
                    return written
                select.select([], [self], [])  # it does not block, which others may have asked for
            except OSError as error:
                self.failed = True
                if self.fileno() == 1 and error.errno not in _GONE:
                    words = f"standard output cannot be written: {error.strerror}"
                    raise click.ClickException(words) from None
        return len(data)


def prepare():
    """Make the standard streams of this process safe, but for those that a program has replaced."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:  # closed: the next file that is opened would get its number
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        if (stream := getattr(sys, name)) is getattr(sys, f"__{name}__"):
            raw = io.BufferedWriter(_Stream(descriptor, "w", closefd=False))
            encoding = getattr(stream, "encoding", "utf-8")  # None, where it is closed, has none
            safe = io.TextIOWrapper(raw, encoding, "backslashreplace", line_buffering=True)
            setattr(sys, name, safe)


class Prepared:
    """A click command, or a group of them, that prepares the streams before it writes anything."""

    def main(self, *args, **how):
        prepare()
        return super().main(*args, **how)
