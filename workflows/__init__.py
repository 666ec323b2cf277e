"""The commands, one for each question; each is a module or a package with a `__main__`."""

import sys
from importlib.util import find_spec

if find_spec("resource") is None:
    try:
        import nasm
    except ImportError as error:  # on Windows: print the reason without a traceback
        sys.exit(str(error))
