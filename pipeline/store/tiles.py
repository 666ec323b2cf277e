"""Tiles of a cube: list the missing ones, commit a tile, and read all tiles.

Every tiled variable has one chunk for each tile: uncompressed numbers, followed by their CRC-32C.
The commit record is stored in the same way, in a separate group that readers of the cube do not
see. The checksum in the record covers the tile's data, its place and the code that computed it, so
that a chunk from another tile or cube does not match.
"""

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from math import prod
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from zarr import Array, AsyncArray
from zarr.storage import StorePath

from nasm.types import BoolArray, FloatArray, IntArray
from pipeline.store.decoding import MAX_METADATA, Files, arrays_in, usual_codecs
from pipeline.store.place import Place, Refused, printable, store_errors

if TYPE_CHECKING:
    from zarr.abc.store import ByteRequest
    from zarr.core.buffer import Buffer, BufferPrototype

    from pipeline.cubes.cube import Cube

CERTIFICATES = "certificates"

COMMIT = "tiles/commit"
"""Name of the array of commit records."""

ENTRIES = "cpu_seconds", "crc32"
"""Entries of a commit record."""

ENTRY = "commit_entry"
"""Name of the first dimension of `COMMIT`, which runs over the entries."""

FORMAT = 2
"""Version of the cube format; version 1 had no checksum of a tile's data."""

_CRC_BYTES = 4  # size of the checksum after the numbers of a chunk
_MAX_REASON = 500  # maximum length of the stored reason for a failure, in characters

DAMAGED = ArithmeticError, AttributeError, FileNotFoundError, LookupError, RecursionError
DAMAGED += TypeError, ValueError  # type: ignore[assignment]
"""Errors raised by reading metadata that are lost, truncated or changed."""


@lru_cache
def arrays_of(place: Place, name: str) -> dict[str, Array]:
    """Return the zarr arrays of the cube by name, and keep them open.

    Raises
    ------
    Refused
        If the cube's metadata are lost, or were written by another program.
    """
    with suppress(*DAMAGED):
        root = json.loads(place.read(f"{name}.zarr/zarr.json", MAX_METADATA))
        if root["attributes"]["store_format"] == FORMAT:
            return opened(place, name, root)
    raise _damaged(place, name)


def _damaged(place: Place, name: str) -> Refused:
    """Return the error for metadata that cannot be read."""
    return Refused(
        f"the metadata of {place.cube(name)} are damaged, from another program, or in an earlier "
        "format; rerun the workflow that computed the cube: it rewrites them or says why it cannot"
    )


forget = arrays_of.cache_clear
"""Close the arrays of all cubes; they are reopened when they are next needed."""


def opened(place: Place, name: str, root: dict[str, Any]) -> dict[str, Array]:
    """Return the zarr arrays of a cube, given the parsed zarr.json of its group, `root`."""
    store, arrays = Files(place.objects()), {}
    for key, metadata in arrays_in(root, place.cube(name)).items():
        path = StorePath(store, f"{name}.zarr/{key}")
        with usual_codecs():  # a tile of fill values must be stored like any other
            arrays[key] = Array(AsyncArray(metadata, path, {"write_empty_chunks": True}))
    if COMMIT in arrays:
        _check_tiles(arrays)
    return arrays


def _check_tiles(arrays: dict[str, Array]) -> None:
    """Raise a DAMAGED error unless each tile has one record and one chunk of each variable."""
    n_entries, *counts = arrays[COMMIT].shape
    last = tuple(n - 1 for n in counts)
    places = blocks(arrays, last)
    attributes = _attributes(arrays[COMMIT])
    named = {COMMIT, *attributes.get("of_tiles", places)}
    if n_entries != len(ENTRIES) or named != {*places} or len(places) < 2:
        raise ValueError("the tiles have no records, or no data")
    if not isinstance(attributes["cube"], dict):
        raise TypeError("the records do not name their cube")
    for key, (array, block) in places.items():
        if array.cdata_shape != tuple(i + 1 for i in block):
            raise ValueError(f"the chunks of {key} do not match the tiles")


def _attributes(array: Array) -> dict[str, Any]:
    """Return the attributes of an array."""
    return dict(array.metadata.attributes)


def _dims(array: Array) -> list[str]:
    """Return an array's dimension names; raise TypeError (see DAMAGED) if they are missing."""
    metadata: Any = array.metadata
    return list(metadata.dimension_names)


def tile_at(arrays: dict[str, Array], index: Sequence[int]) -> dict[str, int]:
    """Return the index of the tile along each tiled dimension, by name."""
    _, *dims = _dims(arrays[COMMIT])
    return {dim.removeprefix("tile_"): i for dim, i in zip(dims, index, strict=True)}


def blocks(
    arrays: dict[str, Array], index: Sequence[int]
) -> dict[str, tuple[Array, tuple[int, ...]]]:
    """Return the chunks of a tile: {name: (zarr array, index of the chunk in its grid)}.

    These are the chunks of its data and of its commit record.
    """
    tile, n_tiles = tile_at(arrays, index), prod(arrays[COMMIT].cdata_shape)
    chunks = {}
    # Cubes written by earlier versions lack `of_tiles`, and may also have coordinates of cells,
    # each in one chunk.
    for key in _attributes(arrays[COMMIT]).get("of_tiles", arrays):
        dims = [dim.removeprefix("tile_") for dim in _dims(arrays[key])]
        is_tiled = prod(arrays[key].cdata_shape) == n_tiles
        if is_tiled and tile.keys() <= {*dims} and dims != [key]:
            chunks[key] = arrays[key], tuple(tile.get(dim, 0) for dim in dims)
    return chunks


def chunk_key(array: Array, block: tuple[int, ...]) -> str:
    """Return the key of the array's chunk."""
    return f"{array.path}/{array.metadata.encode_chunk_key(block)}"


def commit_times(place: Place, arrays: dict[str, Array]) -> tuple[BoolArray, FloatArray]:
    """Find which tiles are complete, and when they were committed, by listing their chunks.

    Returns
    -------
    done : ndarray of bool, over the tiles
        True if the record and all data of the tile exist at full length.
    times : ndarray, over the tiles
        Time of the record, in seconds since 1970; NaN if there is none.
    """
    counts = arrays[COMMIT].shape[1:]
    chunked = {key: array for key, (array, _) in blocks(arrays, (0,) * len(counts)).items()}
    records = chunked.pop(COMMIT)
    times = np.full(records.cdata_shape, np.nan)
    # The records are listed first. As data are written before their record, a tile committed during
    # the listing does not appear to lack data.
    done = _listed(place, records, times)
    for array in chunked.values():
        done &= _listed(place, array).reshape(done.shape)
    return done.reshape(counts), times.reshape(counts)


def _listed(place: Place, array: Array, times: FloatArray | None = None) -> BoolArray:
    """List the array's chunks; return an array over its grid, True where a chunk has full length.

    times : array over the grid, to be filled with the times of existing chunks, in seconds.
    """
    is_complete, n_bytes = np.zeros(array.cdata_shape, bool), _bytes_of_chunk(array)
    root, rows, (*grid, n) = f"{array.path}/c", {}, array.cdata_shape
    for file in place.files(root):
        # A folder contains a row of the grid. Its path is parsed only once, as there may be a
        # million files.
        folder, _, last = file["path"].rpartition("/")
        if folder not in rows:
            rows[folder] = _index(folder.removeprefix(root).split("/")[1:], grid)
        row = rows[folder]
        if row is not None and last.isdecimal() and (i := int(last)) < n:
            is_complete[*row, i] = file["size"] == n_bytes
            if times is not None:
                times[*row, i] = file["last_modified"].timestamp()
    return is_complete


def _index(texts: Sequence[str], shape: Sequence[int]) -> tuple[int, ...] | None:
    """Parse an index into an array of this shape.

    Return None if the index is invalid, e.g. in the name of an unrelated file.
    """
    if len(texts) == len(shape) and all(map(str.isdecimal, texts)):
        index = tuple(map(int, texts))
        return index if all(i < n for i, n in zip(index, shape, strict=True)) else None
    return None


def _bytes_of_chunk(array: Array) -> int:
    """Return the size of a chunk's file; it is the same for chunks that extend beyond the array."""
    return prod(array.chunks) * array.dtype.itemsize + _CRC_BYTES


def missing(place: Place, cube: "Cube") -> IntArray:
    """Return the indices of the tiles that are not committed or have lost data.

    Returns
    -------
    ndarray of int, shape (tiles, tiled dims)
    """
    arrays = arrays_of(place, cube.name)
    if COMMIT not in arrays:  # a cube without tiles
        return np.empty((0, len(cube.tile)), dtype=int)
    return np.argwhere(~commit_times(place, arrays)[0])


def is_committed(place: Place, name: str, index: Sequence[int]) -> bool:
    """Return True if the tile's commit record and all its data exist at full length."""
    chunks = blocks(arrays_of(place, name), index)
    record = chunks.pop(COMMIT)  # checked first: usually it does not exist
    return all(
        place.size(chunk_key(array, block)) == _bytes_of_chunk(array)
        for array, block in (record, *chunks.values())
    )


def commit(
    place: Place, name: str, index: Sequence[int], arrays: Mapping[str, Any], seconds: float
) -> None:
    """Write the tile's data, then its commit record.

    Parameters
    ----------
    place, name, index
        Where the cube is stored, its name, and the index of the tile.
    arrays : mapping of str to ndarray
        The values of each variable; the optional entry `certificates` consists of bytes, which
        are written to a separate file.
    seconds : float
        CPU seconds that the tile took.

    Raises
    ------
    ValueError
        If a variable is missing, or an array differs from the cube in shape or data type.
    StoreFailed
        If the store fails.
    """
    known, values_of = arrays_of(place, name), dict(arrays)
    certificates = values_of.pop(CERTIFICATES, b"")
    places = blocks(known, index)
    if lacking := places.keys() - values_of.keys() - {COMMIT}:
        raise ValueError(f"the tile has no {', '.join(sorted(lacking))}")
    chunks = {key: _fitting(key, *places[key], values) for key, values in values_of.items()}
    record = seconds, _checksum(known, index, chunks, certificates)
    chunks[COMMIT] = np.reshape(record, (len(ENTRIES), *(1 for _ in index)))
    with store_errors(place):
        place.objects(name)  # raises if its file system is unmounted
        if certificates:
            place.write(certificates_key(name, index), certificates)
        for key, values in chunks.items():
            place.objects(name)
            array, block = places[key]
            array.set_block_selection(block, values)


def _fitting(key: str, array: Array, block: tuple[int, ...], values: ArrayLike) -> np.ndarray:
    """Cast values to the array's dtype if they fit; zarr would cast or broadcast silently."""
    values = np.asarray(values)
    grid = zip(block, array.chunks, array.shape, strict=True)
    shape = tuple(min(n, size - i * n) for i, n, size in grid)
    if values.shape != shape:
        raise ValueError(f"{key} has the shape {values.shape} instead of {shape}")
    with np.errstate(invalid="ignore"):
        cast = values.astype(array.dtype) if values.dtype.kind in "biuf" else None
    if cast is None or (array.dtype.kind != "f" and not np.array_equal(cast, values)):
        raise ValueError(f"{key} has dtype {values.dtype}, which does not fit into {array.dtype}")
    return cast


def certificates_key(name: str, index: Sequence[int]) -> str:
    """Return the key of the certificates that were committed with a tile, if there are any."""
    return f"{CERTIFICATES}/{name}/{'.'.join(map(str, index))}.json.xz"


def _checksum(
    arrays: dict[str, Array],
    index: Sequence[int],
    values: Mapping[str, np.ndarray],
    certificates: bytes = b"",
) -> int:
    """Compute the CRC-32 of a tile.

    The CRC-32 covers the cube's settings, the code that computed the cube, and the tile's place,
    values and certificates.
    """
    cube = _attributes(arrays[COMMIT])["cube"]
    decisive = cube.get("config_hash"), cube.get("computed_by"), tile_at(arrays, index)
    checksum = crc32(json.dumps(decisive).encode())
    for key in sorted(values):
        checksum = crc32(np.ascontiguousarray(values[key]).data, checksum)
    return crc32(certificates, checksum)


def chunk(place: Place, key: str, array: Array, block: tuple[int, ...]) -> Any:
    """Read a chunk of array `key`; raise ValueError with the reason if it is damaged or lost."""
    with store_errors(place):
        try:
            place.objects().head(chunk_key(array, block))  # otherwise zarr would return fill values
            return array.get_block_selection(block)
        except FileNotFoundError:
            raise ValueError(f"a chunk of {key} is lost") from None
        except (*DAMAGED, MemoryError, RuntimeError) as error:
            is_cut = "checksum" in str(error)
            fault = "does not match its checksum" if is_cut else "cannot be read"
            raise ValueError(f"{key} {fault}") from None


def damage(place: Place, arrays: dict[str, Array], index: Sequence[int]) -> str:
    """Read the tile's chunks and certificates; return the first fault, "" if there is none."""
    try:
        values = {key: chunk(place, key, *at) for key, at in blocks(arrays, index).items()}
    except ValueError as error:
        return str(error)
    checksum = values.pop(COMMIT).flat[1]
    # The checksum covers no certificates if the tile has none, or is from an earlier version.
    if checksum == _checksum(arrays, index, values):
        return ""
    name = arrays[COMMIT].path.split("/")[0].removesuffix(".zarr")
    certificates = place.read(certificates_key(name, index))
    if checksum == _checksum(arrays, index, values, certificates):
        return ""
    return "its data differ from what was committed"


def tiles_of(place: Place, name: str) -> Iterator[tuple[tuple[int, ...], xr.Dataset]]:
    """Yield the index of each committed tile of a cube, and the tile as a lazy Dataset."""
    cube, arrays = read(place, name), arrays_of(place, name)
    if COMMIT not in arrays:  # a cube without tiles
        return
    tiled = [array for array, _ in blocks(arrays, (0,) * (arrays[COMMIT].ndim - 1)).values()]
    sizes = {dim: n for a in tiled for dim, n in zip(_dims(a), a.chunks, strict=True)}
    for index in map(tuple, np.argwhere(commit_times(place, arrays)[0]).tolist()):
        places = tile_at(arrays, index).items()
        yield index, cube.isel({d: slice(i * sizes[d], (i + 1) * sizes[d]) for d, i in places})


def record_failure(place: Place, name: str, index: Sequence[int], reason: str) -> str:
    """Record why a tile failed, as one short line without control characters; return the line."""
    line = printable(reason.strip()[:_MAX_REASON])
    with store_errors(place):
        place.objects(name)  # raises if its file system is unmounted
        place.write(failure_key(name, index), line.encode(errors="replace"))
    return line


def wanted_key(name: str) -> str:
    """Return the key of the file with the number of wanted tiles; only partial sweeps write it."""
    return f"{name}.zarr/.wanted"


def failure_key(name: str, index: Sequence[int]) -> str:
    """Return the key of the file that states why the tile failed."""
    return f"{name}.zarr/.failed/{'.'.join(map(str, index))}"


def read(place: Place, name: str) -> xr.Dataset:
    """Return the cube as a Dataset.

    Numbers are read lazily, strings at once; a missing string is "". `flag_values` have the dtype
    of their variable, as the CF conventions require, including in files written by `to_netcdf`.
    In the JSON of a zarr store, and if read with `xr.open_zarr` alone, they are plain integers.

    Raises
    ------
    Refused
        If its metadata do not describe a cube.
    ValueError
        When a damaged chunk is read.

    Warns
    -----
    UserWarning
        When a chunk that was written has been lost: it is read as if its tile had not yet been
        computed.

    Examples
    --------
    >>> from pipeline import store
    >>> from pipeline.cubes.cube import Cube, blank, coordinate
    >>> import xarray as xr
    >>> labels = {"n": coordinate("n", range(4), "number")}
    >>> template = xr.Dataset({"square": blank(labels, "its square")}, labels)
    >>> place, cube = store.place_of("run"), Cube("squares", template, {"n": 2}, {})
    >>> with store.driver_lock(place):
    ...     store.create(place, cube, store.COMPUTED_BY)
    ...     store.commit(place, "squares", (0,), {"square": [0, 1]}, seconds=0.1)
    >>> store.missing(place, cube)
    array([[1]])
    >>> store.read(place, "squares").square.values
    array([ 0.,  1., nan, nan])
    """
    with store_errors(place), usual_codecs():
        store = _Watched(place, name)
        try:
            root = json.loads(place.read(f"{name}.zarr/zarr.json", MAX_METADATA))
            arrays_in(root, place.cube(name))
            # Read zarr 3 only, and only arrays that were checked.
            cube = xr.open_zarr(store, chunks=None, zarr_format=3, consolidated=True)
            for variable in cube.variables.values():
                if (codes := variable.attrs.get("flag_values")) is not None:
                    variable.attrs["flag_values"] = np.array(codes, variable.dtype)
            texts = {k: v.fillna("") for k, v in cube.variables.items() if v.dtype == object}
            return cube.assign({key: text for key, text in texts.items() if key not in cube.dims})
        except (*DAMAGED, MemoryError, RuntimeError) as error:
            if "checksum" in str(error):  # raised for a damaged chunk
                raise
            raise _damaged(place, name) from None


class _Watched(Files):
    """A zarr store of one cube; it warns of chunks that were written but have been lost."""

    def __init__(self, place: Place, name: str) -> None:
        super().__init__(place.objects(name), read_only=True)
        self.cube = place.cube(name)
        self.tile_axes: dict[str, list[int]] = {}
        with suppress(Refused):  # cubes in an earlier format are not watched
            self.tile_axes = _tile_axes(arrays_of(place, name))

    async def get(
        self, key: str, prototype: "BufferPrototype", byte_range: "ByteRequest | None" = None
    ) -> "Buffer | None":
        data = await super().get(key, prototype, byte_range)
        variable, _, block = key.partition("/c")
        if data is None and variable in self.tile_axes and await self._was_written(variable, block):
            warnings.warn(
                f"{self.cube}: chunks of {variable} are lost and read as if not yet computed; "
                "rerun the command that computed the cube",
                stacklevel=2,
            )
        return data

    async def _was_written(self, variable: str, block: str) -> bool:
        """Return True if the chunk's tile has a record, or the variable has no tiles."""
        axes = self.tile_axes[variable]
        index = [block.split("/")[1 + axis] for axis in axes]
        return not axes or await self.exists("/".join([COMMIT, "c", "0", *index]))


def _tile_axes(arrays: dict[str, Array]) -> dict[str, list[int]]:
    """Return the tiled axes of each variable, in the order of a tile's index."""
    axes: dict[str, list[int]] = {key: [] for key in arrays}
    if COMMIT in arrays:
        first = (0,) * (arrays[COMMIT].ndim - 1)
        for key in blocks(arrays, first).keys() - {COMMIT}:
            dims = _dims(arrays[key])
            axes[key] = [dims.index(dim) for dim in tile_at(arrays, first)]
    return axes
