"""Write output files so that each appears complete, or not at all."""

import os
import secrets
from contextlib import suppress
from pathlib import Path

BESIDE = ".part"  # suffix of the name of a file that is being written


def write(path, content):
    """Write text or bytes to a temporary file in the same folder, then rename it to `path`.

    If the process is killed or the disk is full, the file from an earlier run remains complete.
    """
    path = Path(path)
    beside = path.with_name(f".{path.name}.{secrets.token_hex(4)}{BESIDE}")
    try:
        beside.write_bytes(content.encode() if isinstance(content, str) else content)
        os.replace(beside, path)
    except BaseException as error:
        with suppress(OSError):
            beside.unlink()
        if isinstance(error, OSError) and error.filename is None:  # e.g. if the disk is full
            error.filename = str(path)
        raise
