"""Mathematics of the nonautonomous standard map: arrays in, arrays out.

    nasm.verdict((0.3, 0.5))                    is transport global under this forcing?
    nasm.boundary([0, 30, 45])                  where does the last barrier break at these angles?
    nasm.barriers.critical_scale((1, 0.5))      … and on this ray of forcings?

Below them are the methods: `converse_kam`, `periodic` (Greene's residue), `circles` and
`circles.continuation` (invariant circles), `escape` (direct iteration). `maps` defines the map,
`numbers` exact rotation numbers: `nasm.parse("gamma")`. All are imported when they are first named.
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

from nasm import sources

try:
    __version__ = version("nasm-transport")
except PackageNotFoundError:  # a copy of the sources that is not installed
    __version__ = "0+source"


def face(package, **modules):
    """`__getattr__` and `__dir__` of a package that imports its modules when they are first named.

    modules : of each module, the names that the package shows of it, in one text.
    """
    homes = {name: module for module, names in modules.items() for name in names.split()}

    def get(name):
        if name in homes:
            return getattr(import_module(f"{package}.{homes[name]}"), name)
        if name in modules:
            return import_module(f"{package}.{name}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return get, lambda: sorted({*modules, *homes})


_ROOMS = "arithmetic circles converse_kam proofs tori"
_MODULES = "action checks critical diffusion escape farey fixed_points flux manifolds maps orbits "
_MODULES += "periodic planes self_consistent sources symmetries texts verdict"

__getattr__, __dir__ = face(
    __name__,
    barriers="boundary",
    numbers="parse",
    **dict.fromkeys(f"{_ROOMS} {_MODULES}".split(), ""),
)
