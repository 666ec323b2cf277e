"""How a cube is cut into chunks: the key and the bytes of each.

A chunk of a tile is raw little-endian numbers and then their CRC-32C, which zarr's codecs `bytes`
and `crc32c` check as they read.
"""

from dataclasses import dataclass
from math import prod

import numpy as np
from google_crc32c import value as crc32c

from pipeline.grid import MAX_TILES, tile_counts

STORE = "cubes.zarr"
FORMAT = "nasm-cubes/3"
"""Version of the store's layout; a store of another version is refused."""

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
    shape: tuple[int, ...]
    chunk_shape: tuple[int, ...]
    tiled_axes: tuple[int | None, ...]

    @property
    def chunk_bytes(self):
        return prod(self.chunk_shape) * np.dtype(self.dtype).itemsize + 4

    def tile_of(self, chunk):
        """The index of the tile whose key ends like this; the inverse of `Layout.key`."""
        numbers = zip(chunk.split("/"), self.tiled_axes, strict=True)
        return tuple(int(number) for number, axis in numbers if axis is not None)

    def tile_shape(self, index):
        """The shape of the variable in a tile: a chunk's, but less at the end of an axis."""
        return tuple(
            length if axis is None else min(length, whole - index[axis] * length)
            for length, whole, axis in zip(
                self.chunk_shape, self.shape, self.tiled_axes, strict=True
            )
        )

    def encoded(self, array, index):
        """The bytes of a tile's chunk: numbers, then their checksum.

        ValueError if the array is not what the plan says: nothing is cut, padded or wrapped round.
        """
        array, shape = np.asarray(array), self.tile_shape(index)
        if array.shape != shape:
            raise ValueError(f"{self.name} has the shape {array.shape} instead of {shape}")
        array = self._converted(array)
        if shape != self.chunk_shape:  # zarr stores a whole chunk
            lengths = zip(self.chunk_shape, shape, strict=True)
            array = np.pad(array, [(0, whole - part) for whole, part in lengths])
        numbers = array.astype(array.dtype.newbyteorder("<")).tobytes()
        return numbers + _checksum(numbers)

    def _converted(self, array):
        dtype = np.dtype(self.dtype)
        if array.dtype == dtype:
            return array
        fits = array.dtype.kind in "biuf"
        if fits:
            with np.errstate(invalid="ignore"):
                converted = array.astype(dtype)
            fits = dtype.kind == "f" or np.array_equal(converted, array)
        if not fits:
            raise ValueError(f"{self.name} is of {array.dtype}, and does not fit into {dtype}")
        return converted


@dataclass(frozen=True)
class Layout:
    """What a worker must know to commit a tile: a small, picklable part of a Cube; its place."""

    place: object
    name: str
    variables: tuple[Variable, ...]
    record: Variable

    @property
    def tiled(self):
        """Names of the arrays whose chunks are tiles."""
        return {variable.name for variable in (self.record, *self.variables)}

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
            shape=variable.shape,
            chunk_shape=tuple(cube.tile.get(dim, sizes[dim]) for dim in variable.dims),
            tiled_axes=_tiled_axes(variable.dims, tiled),
        )
        for name, variable in cube.template.data_vars.items()
    )
    counts = tuple(tile_counts(sizes, cube.tile).values())
    return Layout(place, cube.name, variables, _record(counts))


def stored_layout(place, name, group):
    """The Layout of a sweep's cube, from its metadata; None for a cube that is no sweep's.

    ValueError if no cube of ours has such metadata.
    """
    if COMMIT not in group:
        return None
    arrays = dict(group.arrays())
    if COMMIT not in arrays or any(a.metadata.dimension_names is None for a in arrays.values()):
        raise ValueError("arrays without dimensions")
    tiled = [dim.removeprefix("tile_") for dim in arrays[COMMIT].metadata.dimension_names]
    variables = tuple(
        Variable(
            name=key,
            dtype=str(array.dtype),
            shape=array.shape,
            chunk_shape=array.chunks,
            tiled_axes=_tiled_axes(dims, tiled),
        )
        for key, array in arrays.items()
        if set(tiled) <= set(dims := array.metadata.dimension_names) and [key] != list(dims)
    )
    counts = arrays[COMMIT].shape
    lengths = [length for variable in variables for length in variable.chunk_shape]
    if not counts or not all((*counts, *lengths)) or prod(counts) > MAX_TILES:
        raise ValueError("no tiles, or too many")
    return Layout(place, name, variables, _record(counts))


def _tiled_axes(dims, tiled):
    return tuple(tiled.index(dim) if dim in tiled else None for dim in dims)


def _record(counts):
    ones = (1,) * len(counts)
    return Variable(COMMIT, "float64", counts, ones, tuple(range(len(counts))))


def is_sound(data):
    """Whether the bytes of a chunk match the checksum in which they end."""
    return _checksum(data[:-4]) == data[-4:]


def _checksum(data):
    """CRC-32C, four bytes."""
    return crc32c(data).to_bytes(4, "little")
