"""Mathematics of the nonautonomous standard map: arrays in, arrays out.

    nasm.verdict((0.3, 0.5))                    is transport global under this forcing?
    nasm.boundary([0, 30, 45])                  where does the last barrier break at these angles?
    nasm.barriers.critical_scale((1, 0.5))      … and on this ray of forcings?

Below them are the methods: `cones` (converse KAM), `periodic` (Greene's residue), `circles` and
`continuation` (invariant circles), `escape` (direct iteration). `maps` defines the map, `numbers`
exact rotation numbers: `nasm.parse("gamma")`. All are imported when they are first named.
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

__all__ = ["barriers", "boundary", "circles", "cones", "continuation", "critical", "escape"]
__all__ += ["first_breakup", "fixed_points", "flux", "last_torus", "maps", "memory", "numbers"]
__all__ += ["orbits", "parse", "periodic", "phases", "planes", "proofs", "self_consistent"]
__all__ += ["symmetries", "tori", "transversals", "verdict"]

_HOMES = {"boundary": "nasm.barriers", "parse": "nasm.numbers"}

try:
    __version__ = version("nasm-transport")
except PackageNotFoundError:  # a copy of the sources that is not installed
    __version__ = "0+source"


def __getattr__(name):
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    if name in __all__:
        return import_module(f"nasm.{name}")
    raise AttributeError(f"module 'nasm' has no attribute {name!r}")


def __dir__():
    return [*__all__, "__version__"]
