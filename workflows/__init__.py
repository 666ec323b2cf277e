"""One question each: a command is a module or a package with a `__main__`."""

import sys
from importlib.util import find_spec

if find_spec("resource") is None:
    try:
        import nasm
    except ImportError as error:  # on Windows: the sentence alone
        sys.exit(str(error))
