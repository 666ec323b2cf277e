"""Tiles: list the missing ones, commit one, read them all.

Every tiled variable has one chunk for each tile, raw numbers with their CRC-32C behind. So has the
commit record, in a group of its own where readers of the cube do not meet it. Its checksum is of
the tile's data, its place and who computed it: a chunk of another tile or cube does not match it.
"""

import json
import warnings
from contextlib import suppress
from functools import lru_cache
from math import prod
from zlib import crc32

import numpy as np
import xarray as xr
from zarr import Array, AsyncArray
from zarr.storage import StorePath

from pipeline.store.decoding import MAX_METADATA, Files, arrays_in, usual_codecs
from pipeline.store.place import Refused, printable, store_errors

CERTIFICATES = "certificates"
COMMIT = "tiles/commit"
ENTRIES = "cpu_seconds", "crc32"  # of a commit record
ENTRY = "commit_entry"  # their dimension, the first
FORMAT = 2  # of cubes; 1 had no checksum of a tile's data
_CRC_BYTES = 4  # the checksum behind the numbers of a chunk
_LONGEST_REASON = 500  # characters of the reason of a failure that are kept
# What reading metadata raises that are lost, cut or changed.
DAMAGED = ArithmeticError, AttributeError, FileNotFoundError, LookupError, RecursionError
DAMAGED += TypeError, ValueError


@lru_cache
def arrays_of(place, name):
    """{name: zarr array} of the cube, kept open; Refused if its metadata are lost or not ours."""
    with suppress(*DAMAGED):
        root = json.loads(place.read(f"{name}.zarr/zarr.json", MAX_METADATA))
        if root["attributes"]["store_format"] == FORMAT:
            return opened(place, name, root)
    raise _damaged(place, name)


def _damaged(place, name):
    return Refused(
        f"the metadata of {place.cube(name)} are damaged, or another program's, or in an earlier "
        "format; run the workflow that computed it again, to have them written anew or refused"
    )


forget = arrays_of.cache_clear  # open the arrays anew when they are needed next


def opened(place, name, root):
    """{name: zarr array} of a cube whose group has the zarr.json `root`, parsed."""
    store, arrays = Files(place.objects()), {}
    for key, metadata in arrays_in(root, place.cube(name)).items():
        path = StorePath(store, f"{name}.zarr/{key}")
        with usual_codecs():  # a tile of fill values must be stored like any other
            arrays[key] = Array(AsyncArray(metadata, path, {"write_empty_chunks": True}))
    if COMMIT in arrays:
        _check_tiles(arrays)
    return arrays


def _check_tiles(arrays):
    """Raise what is in DAMAGED unless a tile has one record, and one chunk of each variable."""
    n_entries, *counts = arrays[COMMIT].shape
    last = tuple(n - 1 for n in counts)
    places = blocks(arrays, last)
    attributes = arrays[COMMIT].metadata.attributes
    named = {COMMIT, *attributes.get("of_tiles", places)}
    if n_entries != len(ENTRIES) or named != {*places} or len(places) < 2:
        raise ValueError("the tiles have no records, or nothing else")
    if not isinstance(attributes["cube"], dict):
        raise TypeError("the records do not name their cube")
    for key, (array, block) in places.items():
        if array.cdata_shape != tuple(i + 1 for i in block):
            raise ValueError(f"the chunks of {key} are not those of the tiles")


def tile_at(arrays, index):
    """{dim: i} of the tile."""
    _, *dims = arrays[COMMIT].metadata.dimension_names
    return {dim.removeprefix("tile_"): i for dim, i in zip(dims, index, strict=True)}


def blocks(arrays, index):
    """{name: (zarr array, where the tile's chunk is in its grid)}, of its data and its record."""
    tile, found, n_tiles = tile_at(arrays, index), {}, prod(arrays[COMMIT].cdata_shape)
    # Cubes that were made earlier do not say so, and may have coordinates of cells, each in one
    # chunk, beside these.
    for key in arrays[COMMIT].metadata.attributes.get("of_tiles", arrays):
        dims = [dim.removeprefix("tile_") for dim in arrays[key].metadata.dimension_names]
        is_tiled = prod(arrays[key].cdata_shape) == n_tiles
        if is_tiled and tile.keys() <= {*dims} and dims != [key]:
            found[key] = arrays[key], tuple(tile.get(dim, 0) for dim in dims)
    return found


def chunk_key(array, block):
    """Key of the array's chunk."""
    return f"{array.path}/{array.metadata.encode_chunk_key(block)}"


def commit_times(place, arrays):
    """List the chunks of all tiles. Returns arrays over the tiles: whether its record and all its
    data are there, in full length; and the time of its record in seconds, NaN if there is none."""
    counts = arrays[COMMIT].shape[1:]
    chunked = {key: array for key, (array, _) in blocks(arrays, (0,) * len(counts)).items()}
    records = chunked.pop(COMMIT)
    written = np.full(records.cdata_shape, np.nan)
    # The records come first: the data of each are older, so that a tile which is committed during
    # the listing does not seem to lack them.
    done = _listed(place, records, written)
    for array in chunked.values():
        done &= _listed(place, array).reshape(done.shape)
    return done.reshape(counts), written.reshape(counts)


def _listed(place, array, times=None):
    """List the array's chunks; return an array over its grid, whether each is there in full length.

    times : array over the grid, to be filled with the times of those that are there, in seconds.
    """
    is_whole, n_bytes = np.zeros(array.cdata_shape, bool), _bytes_of_chunk(array)
    root, rows, (*grid, n) = f"{array.path}/c", {}, array.cdata_shape
    for file in place.files(root):
        # A folder holds a row of the grid. It is parsed once, as there may be a million files.
        folder, _, last = file["path"].rpartition("/")
        if folder not in rows:
            rows[folder] = _index(folder.removeprefix(root).split("/")[1:], grid)
        row = rows[folder]
        if row is not None and last.isdecimal() and (i := int(last)) < n:
            is_whole[*row, i] = file["size"] == n_bytes
            if times is not None:
                times[*row, i] = file["last_modified"].timestamp()
    return is_whole


def _index(texts, shape):
    """The index that the texts spell in an array of the shape; None if they are no index of it, as
    in somebody else's files."""
    if len(texts) == len(shape) and all(map(str.isdecimal, texts)):
        index = tuple(map(int, texts))
        return index if all(i < n for i, n in zip(index, shape, strict=True)) else None
    return None


def _bytes_of_chunk(array):
    """The length of the file of each chunk, whether or not the array ends within it."""
    return prod(array.chunks) * array.dtype.itemsize + _CRC_BYTES


def missing(place, cube):
    """Indices of the tiles that are not committed, or have lost data: int array (tiles, dims)."""
    arrays = arrays_of(place, cube.name)
    if COMMIT not in arrays:  # written whole
        return np.empty((0, len(cube.tile)), dtype=int)
    return np.argwhere(~commit_times(place, arrays)[0])


def is_committed(place, name, index):
    """Whether the tile's commit record and all its data are there, in full length."""
    chunks = blocks(arrays_of(place, name), index)
    record = chunks.pop(COMMIT)  # it comes first: usually it is not there
    return all(
        place.size(chunk_key(array, block)) == _bytes_of_chunk(array)
        for array, block in (record, *chunks.values())
    )


def commit(place, name, index, arrays, seconds):
    """Write the tile's data, then its commit record: the CPU seconds that it took.

    arrays : of its variables; and `certificates`, bytes that are kept in a file, if there are any.
    ValueError if a variable is missing, or an array does not have the shape and kind of numbers
    that the cube has.
    """
    known, arrays = arrays_of(place, name), dict(arrays)
    certificates = arrays.pop(CERTIFICATES, b"")
    places = blocks(known, index)
    if lacking := places.keys() - arrays.keys() - {COMMIT}:
        raise ValueError(f"the tile has no {', '.join(sorted(lacking))}")
    chunks = {key: _fitting(key, *places[key], values) for key, values in arrays.items()}
    record = seconds, _checksum(known, index, chunks, certificates)
    chunks[COMMIT] = np.reshape(record, (len(ENTRIES), *(1 for _ in index)))
    with store_errors(place):
        place.objects(name)  # its disk may be away
        if certificates:
            place.write(certificates_key(name, index), certificates)
        for key, values in chunks.items():
            place.objects(name)
            array, block = places[key]
            array.set_block_selection(block, values)


def _fitting(key, array, block, values):
    """Return the values in the array's kind of numbers; zarr would cast and broadcast unseen."""
    values = np.asarray(values)
    grid = zip(block, array.chunks, array.shape, strict=True)
    shape = tuple(min(n, whole - i * n) for i, n, whole in grid)
    if values.shape != shape:
        raise ValueError(f"{key} has the shape {values.shape} instead of {shape}")
    with np.errstate(invalid="ignore"):
        cast = values.astype(array.dtype) if values.dtype.kind in "biuf" else None
    if cast is None or (array.dtype.kind != "f" and not np.array_equal(cast, values)):
        raise ValueError(f"{key} is of {values.dtype}, and does not fit into {array.dtype}")
    return cast


def certificates_key(name, index):
    """Key of the bytes that were committed with a tile as its certificates; empty if none were."""
    return f"{CERTIFICATES}/{name}/{'.'.join(map(str, index))}.json.xz"


def _checksum(arrays, index, values, certificates=b""):
    """CRC-32 of the cube's settings, who computed it, the tile's place, {variable: values} and its
    certificates."""
    cube = arrays[COMMIT].metadata.attributes["cube"]
    decisive = cube.get("config_hash"), cube.get("computed_by"), tile_at(arrays, index)
    found = crc32(json.dumps(decisive).encode())
    for key in sorted(values):
        found = crc32(np.ascontiguousarray(values[key]), found)
    return crc32(certificates, found)


def chunk(place, key, array, block):
    """Read a chunk of the array `key`; ValueError, which says what is wrong with it."""
    with store_errors(place):
        try:
            place.objects().head(chunk_key(array, block))  # else zarr reads fill values
            return array.get_block_selection(block)
        except FileNotFoundError:
            raise ValueError(f"a chunk of {key} is gone") from None
        except (*DAMAGED, MemoryError, RuntimeError) as error:
            is_cut = "checksum" in str(error)
            what = "does not match its checksum" if is_cut else "cannot be read"
            raise ValueError(f"{key} {what}") from None


def damage(place, arrays, index):
    """Read the tile's chunks, and its certificates; return what is wrong with them, or ""."""
    try:
        values = {key: chunk(place, key, *at) for key, at in blocks(arrays, index).items()}
    except ValueError as error:
        return str(error)
    checksum = values.pop(COMMIT).flat[1]
    # It is of the data alone where there are no certificates, and in tiles of earlier versions.
    if checksum == _checksum(arrays, index, values):
        return ""
    name = arrays[COMMIT].path.split("/")[0].removesuffix(".zarr")
    certificates = place.read(certificates_key(name, index))
    if checksum == _checksum(arrays, index, values, certificates):
        return ""
    return "its data are not those that were committed"


def tiles_of(place, name):
    """Yield the index of each committed tile of a cube, and the tile as a Dataset, not yet read."""
    cube, arrays = read(place, name), arrays_of(place, name)
    if COMMIT not in arrays:  # written whole
        return
    tiled = [array for array, _ in blocks(arrays, (0,) * (arrays[COMMIT].ndim - 1)).values()]
    sizes = {d: n for a in tiled for d, n in zip(a.metadata.dimension_names, a.chunks, strict=True)}
    for index in map(tuple, np.argwhere(commit_times(place, arrays)[0]).tolist()):
        places = tile_at(arrays, index).items()
        yield index, cube.isel({d: slice(i * sizes[d], (i + 1) * sizes[d]) for d, i in places})


def record_failure(place, name, index, reason):
    """Record why a tile failed, as one short line without control characters; return the line."""
    line = printable(reason.strip()[:_LONGEST_REASON])
    with store_errors(place):
        place.objects(name)  # its disk may be away
        place.write(failure_key(name, index), line.encode(errors="replace"))
    return line


def wanted_key(name):
    """Key of the number of tiles that are wanted, where these are not all."""
    return f"{name}.zarr/.wanted"


def failure_key(name, index):
    """Key of the reason why the tile has failed."""
    return f"{name}.zarr/.failed/{'.'.join(map(str, index))}"


def read(place, name):
    """The cube as a Dataset, read lazily; its texts at once, "" where there is none.

    Refused if its metadata are not those of a cube. To read a damaged chunk is a ValueError. To
    read one that is lost is a warning; without it nothing would tell that from a tile which is not
    yet computed.
    """
    with store_errors(place), usual_codecs():
        store = _Watched(place, name)
        try:
            root = json.loads(place.read(f"{name}.zarr/zarr.json", MAX_METADATA))
            arrays_in(root, place.cube(name))
            # Of zarr 3 alone, and of no arrays but those that were looked at.
            cube = xr.open_zarr(store, chunks=None, zarr_format=3, consolidated=True)
            texts = {k: v.fillna("") for k, v in cube.variables.items() if v.dtype == object}
            return cube.assign({key: text for key, text in texts.items() if key not in cube.dims})
        except (*DAMAGED, MemoryError, RuntimeError) as error:
            if "checksum" in str(error):  # of a chunk
                raise
            raise _damaged(place, name) from None


class _Watched(Files):
    """The files of one cube, for zarr to read. Warns of chunks that were written and are lost."""

    def __init__(self, place, name):
        super().__init__(place.objects(name), read_only=True)
        self.cube, self.tile_axes = place.cube(name), {}
        with suppress(Refused):  # of an earlier format: not watched
            self.tile_axes = _tile_axes(arrays_of(place, name))

    async def get(self, key, *how, **more):
        data = await super().get(key, *how, **more)
        variable, _, block = key.partition("/c")
        if data is None and variable in self.tile_axes and await self._was_written(variable, block):
            warnings.warn(
                f"{self.cube}: chunks of {variable} are lost, which read as not computed; run "
                "again the command that computed it",
                stacklevel=2,
            )
        return data

    async def _was_written(self, variable, block):
        """Whether the chunk's tile has a record; true of what is written before any tile."""
        axes = self.tile_axes[variable]
        index = [block.split("/")[1 + axis] for axis in axes]
        return not axes or await self.exists("/".join([COMMIT, "c", "0", *index]))


def _tile_axes(arrays):
    """{variable: its axes along which there are tiles, in their order}, of all in a cube."""
    found = {key: [] for key in arrays}
    if COMMIT in arrays:
        first = (0,) * (arrays[COMMIT].ndim - 1)
        for key in blocks(arrays, first).keys() - {COMMIT}:
            dims = arrays[key].metadata.dimension_names
            found[key] = [dims.index(dim) for dim in tile_at(arrays, first)]
    return found
