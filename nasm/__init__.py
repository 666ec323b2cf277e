"""Mathematics of the nonautonomous standard map: arrays in, arrays out.

`barriers.critical_scale` finds the last circle to break on a ray of forcings, `verdict.verdict`
decides one forcing. Below them are the methods: `cones` (converse KAM), `periodic` (Greene's
residue), `circles` and `continuation` (invariant circles), `escape` (direct iteration). `maps`
defines the map, `numbers` exact rotation numbers: `numbers.parse("gamma")`.
"""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("nasm-transport")
except PackageNotFoundError:  # a copy of the sources that is not installed
    __version__ = "0+source"
