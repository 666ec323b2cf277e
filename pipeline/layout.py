"""How a cube is cut into chunks: the key and the bytes of each.

A chunk of a tile is raw little-endian numbers and then their CRC-32C, which zarr's codecs `bytes`
and `crc32c` check as they read.
"""

from dataclasses import dataclass
from math import prod

import numpy as np
from google_crc32c import value as crc32c

STORE = "cubes.zarr"
COMMIT = "cpu_seconds"
FAILURE = ".failed"


@dataclass(frozen=True)
class Variable:
    """How one variable is cut into chunks.

    tiled_axes : for each of its axes which number of a tile's index counts chunks along it, or None
        for an axis that is not tiled.
    """

    name: str
    dtype: str
    chunk_shape: tuple[int, ...]
    tiled_axes: tuple[int | None, ...]

    @property
    def chunk_bytes(self):
        return prod(self.chunk_shape) * np.dtype(self.dtype).itemsize + 4

    def tile_of(self, chunk):
        """The index of the tile whose key ends like this; the inverse of `Layout.key`."""
        numbers = zip(chunk.split("/"), self.tiled_axes, strict=True)
        return tuple(int(number) for number, axis in numbers if axis is not None)

    def encoded(self, array):
        """The bytes of a chunk: numbers, then their checksum."""
        array = array.astype(np.dtype(self.dtype).newbyteorder("<"))
        if array.shape != self.chunk_shape:  # a short last tile; zarr stores a whole chunk
            lengths = zip(self.chunk_shape, array.shape, strict=True)
            array = np.pad(array, [(0, whole - part) for whole, part in lengths])
        numbers = array.tobytes()
        return numbers + _checksum(numbers)


@dataclass(frozen=True)
class Layout:
    """What a worker must know to commit a tile: a small, picklable part of a Cube; its place."""

    place: object
    name: str
    variables: tuple[Variable, ...]
    record: Variable

    def key(self, variable, index):
        """Of the chunk that holds the tile of that index."""
        chunk = "/".join("0" if axis is None else str(index[axis]) for axis in variable.tiled_axes)
        return f"{self.chunks(variable)}/{chunk}"

    def failure_key(self, index):
        """Of the reason why the tile of that index has failed. It is no chunk's key to zarr."""
        return self.key(self.record, index) + FAILURE

    def chunks(self, variable):
        """What the keys of all chunks of a variable begin with."""
        return f"{STORE}/{self.name}/{variable.name}/c"


def layout_of(place, cube):
    """The Layout of a cube in a place."""
    sizes, tiled = cube.sizes, list(cube.tile)
    variables = tuple(
        Variable(
            name=str(name),
            dtype=str(variable.dtype),
            chunk_shape=tuple(cube.tile.get(dim, sizes[dim]) for dim in variable.dims),
            tiled_axes=_tiled_axes(variable.dims, tiled),
        )
        for name, variable in cube.template.data_vars.items()
    )
    return Layout(place, cube.name, variables, _record(len(tiled)))


def stored_layout(place, name, group):
    """The Layout of a sweep's cube, from its metadata; None for a cube that is no sweep's."""
    if COMMIT not in group:
        return None
    tiled = [dim.removeprefix("tile_") for dim in group[COMMIT].metadata.dimension_names]
    variables = tuple(
        Variable(
            name=key,
            dtype=str(array.dtype),
            chunk_shape=array.chunks,
            tiled_axes=_tiled_axes(dims, tiled),
        )
        for key, array in group.arrays()
        if set(tiled) <= set(dims := array.metadata.dimension_names) and [key] != list(dims)
    )
    return Layout(place, name, variables, _record(len(tiled)))


def _tiled_axes(dims, tiled):
    return tuple(tiled.index(dim) if dim in tiled else None for dim in dims)


def _record(n_dims):
    return Variable(COMMIT, "float64", (1,) * n_dims, tuple(range(n_dims)))


def is_sound(data):
    """Whether the bytes of a chunk match the checksum in which they end."""
    return _checksum(data[:-4]) == data[-4:]


def _checksum(data):
    """CRC-32C, four bytes."""
    return crc32c(data).to_bytes(4, "little")
