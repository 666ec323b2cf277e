"""Tiles: list the missing ones, commit one, read them all.

Every tiled variable has one chunk for each tile, raw numbers with their CRC-32C behind. So has the
commit record, in a group of its own inside the cube, where readers of the cube do not meet it.
"""

from functools import lru_cache

import numpy as np
import xarray as xr
import zarr
from zarr.storage import ObjectStore

from pipeline.store.place import Refused, explained

RECORDS = "tiles"
COMMIT = f"{RECORDS}/cpu_seconds"
_RECORD_BYTES = 12  # a float64 and its checksum
_LONGEST_REASON = 500  # characters of the reason of a failure that are kept
_DAMAGED = AttributeError, FileNotFoundError, KeyError, RecursionError, TypeError, ValueError


@lru_cache
def arrays_of(place, name):
    """{name: zarr array} of the cube, kept open; Refused if its metadata are lost or damaged."""
    # A tile of fill values must be stored like any other.
    with explained(place), zarr.config.set({"array.write_empty_chunks": True}):
        store = ObjectStore(place.objects())
        try:
            group = zarr.open_group(store, path=f"{name}.zarr", mode="r+", zarr_format=3)
            members = group.members(max_depth=None)
            arrays = {key: member for key, member in members if isinstance(member, zarr.Array)}
            if all(array.metadata.dimension_names for array in arrays.values()):
                return arrays
        except _DAMAGED:
            pass
    raise Refused(
        f"the metadata of {place.cube(name)} are damaged; run the workflow that computed it again, "
        "to have them written anew"
    )


def forget():
    """Open the arrays anew when they are needed next."""
    arrays_of.cache_clear()


def tiled_arrays(arrays):
    """{name: (zarr array, its axes that count tiles)} of the arrays whose chunks are tiles."""
    tiled = [dim.removeprefix("tile_") for dim in arrays[COMMIT].metadata.dimension_names]
    found = {}
    for key, array in arrays.items():
        dims = [dim.removeprefix("tile_") for dim in array.metadata.dimension_names]
        if set(tiled) <= set(dims) and array.metadata.dimension_names != (key,):
            found[key] = array, [dims.index(dim) for dim in tiled]
    return found


def chunk_of(array, axes, index):
    """Where the tile's chunk is in the array's grid of chunks."""
    chunk = [0] * array.ndim
    for axis, i in zip(axes, index, strict=True):
        chunk[axis] = i
    return tuple(chunk)


def survey(place, name):
    """List the commit records: returns (done, written), arrays over the tiles.

    done : whether the tile has one, in full length.
    written : its time in seconds, NaN if there is none.
    """
    written = np.full(arrays_of(place, name)[COMMIT].shape, np.nan)
    done = np.zeros(written.shape, dtype=bool)
    with explained(place):
        for page in place.objects().list(f"{name}.zarr/{COMMIT}/c", chunk_size=10_000):
            for file in page:
                try:
                    tile = tuple(map(int, file["path"].split("/")[4:]))
                    written[tile] = file["last_modified"].timestamp()
                    done[tile] = file["size"] == _RECORD_BYTES
                except (ValueError, IndexError):  # somebody else's file
                    continue
    return done, written


def missing(place, cube):
    """Indices of the tiles that are not committed, in tile order: int array (tiles, dims)."""
    if COMMIT not in arrays_of(place, cube.name):  # written whole
        return np.empty((0, len(cube.tile)), dtype=int)
    return np.argwhere(~survey(place, cube.name)[0])


def is_committed(place, name, index):
    """Whether the tile has a commit record."""
    with explained(place):
        try:
            head = place.objects().head(f"{name}.zarr/{COMMIT}/c/{'/'.join(map(str, index))}")
        except FileNotFoundError:
            return False
    return head["size"] == _RECORD_BYTES


def commit(place, name, index, arrays, seconds):
    """Write the tile's data, then its commit record: the CPU seconds that it took.

    ValueError if an array does not have the shape and kind of numbers that the cube has.
    """
    opened = arrays_of(place, name)
    tiled = tiled_arrays(opened)
    parts = {key: _part(*tiled[key], index, key, values) for key, values in arrays.items()}
    with explained(place):
        for key, (region, values) in parts.items():
            opened[key][region] = values
        opened[COMMIT][tuple(index)] = seconds


def _part(array, axes, index, key, values):
    """(region of the array that the tile fills, its values); zarr would cast and broadcast."""
    grid = zip(chunk_of(array, axes, index), array.chunks, array.shape, strict=True)
    region = tuple(slice(i * n, min((i + 1) * n, whole)) for i, n, whole in grid)
    shape = tuple(part.stop - part.start for part in region)
    values = np.asarray(values)
    if values.shape != shape:
        raise ValueError(f"{key} has the shape {values.shape} instead of {shape}")
    fits = values.dtype.kind in "biuf"
    if fits and array.dtype.kind != "f":
        with np.errstate(invalid="ignore"):
            fits = np.array_equal(values.astype(array.dtype), values)
    if not fits:
        raise ValueError(f"{key} is of {values.dtype}, and does not fit into {array.dtype}")
    return region, values


def record_failure(place, name, index, reason):
    """Write why a tile that is not committed has failed; to zarr it is no chunk.

    Returns the reason as it is kept: one line of bounded length that a terminal obeys in nothing.
    """
    line = reason.strip()[:_LONGEST_REASON]
    line = "".join(character if character.isprintable() else " " for character in line)
    with explained(place):
        place.objects().put(failure_key(name, index), line.encode(errors="replace"))
    return line


def failure_key(name, index):
    """Key of the reason why the tile has failed."""
    return f"{name}.zarr/.failed/{'.'.join(map(str, index))}"


def read(place, name):
    """The cube as a Dataset, read lazily. To read a damaged chunk is a ValueError."""
    with explained(place):
        # Version 3 alone: what others wrote as version 2 may name codecs that unpickle.
        store = ObjectStore(place.objects(name), read_only=True)
        return xr.open_zarr(store, chunks=None, zarr_format=3)
