"""Mathematics of the nonautonomous standard map: arrays in, arrays out.

    nasm.verdict((0.3, 0.5))             is transport global under this forcing?
    nasm.boundary([0, 30, 45])           where does the last barrier break at these angles?
    nasm.critical_scale((1, 0.5))        where does it break on this ray of forcings?

These functions build on the methods in `converse_kam`, `periodic` (Greene's residue), `circles` and
`circles.continuation` (invariant circles), and `escape` (direct iteration). `maps` defines the map,
and `numbers` defines exact rotation numbers, e.g. `nasm.parse("gamma")`. Modules are imported when
they are first used; `__init__.pyi` lists them.
"""

from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

import lazy_loader

from nasm import sources

if find_spec("resource") is None:  # Windows, which also lacks the locks and signals used here
    reason = "nasm runs on Linux and macOS; on Windows, install it in WSL, its Linux subsystem"
    raise ImportError(reason)

try:
    __version__ = version("nasm-transport")
except PackageNotFoundError:  # run from sources that are not installed
    __version__ = "0+source"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
