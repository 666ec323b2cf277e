"""The store: each cube is a zarr group, PLACE/NAME.zarr, with one chunk per tile.

A tile passes through these states: missing → data chunks written → commit record written. The
record contains the tile's CPU seconds and the checksum of its data. *A tile is done if its record
and its data exist*; there is no separate list of done tiles. A copy made during a sweep may contain
records without data: their tiles count as missing. Each file appears whole or not at all.
Workers and drivers may write in any order: data written twice are identical, except for proofs,
whose bounds depend on the speed of the machine. The store depends neither on the mathematics nor on
clusters. Modules are imported when they are first used, because xarray and zarr take half a second;
`__init__.pyi` lists them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
