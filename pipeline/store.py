"""The store: one zarr v3 hierarchy, a group per cube, a chunk per tile, on a disk or elsewhere.

The life of a tile: missing → (leased in memory) → data chunks written → commit record written last.
The commit record is the tile's chunk of `cpu_seconds`: *a tile is done if that chunk exists*. The
store is the only truth; there is no other list of what is done. What appears in it appears whole,
so that a killed process leaves nothing half-written. If a tile fails, the reason is written beside
the place of its commit record, and means something as long as that is missing.

One driver at a time may write to a store. Several workers may commit tiles at once, even the same
tile: they write the same bytes.

Where the bytes go is a place's matter: `directory.Directory`, or `objects.Objects` for a URL. A
place has keys `a/b/c` of bytes, puts them whole, lists them, and can be held by one driver.

Every chunk ends in its CRC-32C, which any reader of zarr checks. Those of tiles are raw numbers
before it (`layout`), written straight to their places: zarr's own writer takes 1.6 ms for the two
chunks of a tile, this 0.2 ms. All else goes through xarray and zarr.
"""

import os
from contextlib import contextmanager, suppress
from math import prod

import numpy as np
import xarray as xr

from pipeline import metadata
from pipeline.directory import Directory
from pipeline.faults import StorageError, StoreError
from pipeline.grid import MAX_TILES, tile_counts
from pipeline.layout import FORMAT, STORE, layout_of
from pipeline.provenance import computed_by, provenance
from pipeline.seal import is_intact


def place_of(out):
    """The place that `out` names: a directory's path, or the URL of a prefix in an object store."""
    if "://" not in str(out):
        return Directory(os.path.abspath(out))
    try:
        from pipeline.objects import Objects, parse
    except ModuleNotFoundError as error:
        raise StoreError(
            f"object stores need the package {error.name}; install this one with pip as "
            "nasm-transport[objects]"
        ) from None
    parse(out)
    return Objects(out.rstrip("/"))


@contextmanager
def explained(out):
    """What xarray and zarr raise inside, reading a store that fails, becomes a StorageError."""
    place = place_of(out)
    try:
        with place.explained():
            yield
    except ValueError as error:
        if "computed checksum" not in str(error):
            raise
        raise StorageError(
            f"{place} holds damaged chunks; run `python -m workflows.verify --repair` on it, to "
            "have them computed again"
        ) from None


@contextmanager
def driving(out):
    """Hold the place `out` as its one driver; makes it, checks it, clears a killed one's mess.

    StoreError if it is not ours, of another version, not writable, or driven by someone else.
    Nothing in a place that is refused is touched.
    """
    refuse_foreign(out)
    place = place_of(out)
    with place.held():
        if not metadata.has_root(place):
            metadata.put_root(place)
        yield


def refuse_foreign(out):
    """StoreError if `out` holds other things than a store of this version; touches nothing."""
    place = place_of(out)
    try:
        found = place.names()
    except StorageError as fault:
        raise StoreError(str(fault)) from None
    if not found:
        return
    if STORE not in found:
        raise StoreError(
            f"{place} holds other files and no {STORE}; choose a new or empty --out or --store"
        )
    written_as = metadata.format_of(place)
    if written_as != FORMAT:
        raise StoreError(
            f"{place}/{STORE} is a store of version {written_as!r}, this program writes "
            f"{FORMAT!r}; choose another --out or --store"
        )


def refuse_different(out, cube):
    """StoreError, naming what differs, if another cube of this name is in the store.

    Returns the attributes of the one that is there; None if there is none.
    """
    place = place_of(out)
    counts = tile_counts(cube.sizes, cube.tile)
    if prod(counts.values()) > MAX_TILES:
        raise StoreError(
            f"{cube.name} would have {' × '.join(map(str, counts.values()))} tiles, more than "
            f"{MAX_TILES}; choose larger tiles, or fewer cells"
        )
    attributes = metadata.attributes(place, cube.name)
    if attributes is None:
        if metadata.has_files(place, cube.name):
            raise metadata.lost(place, cube.name)
        return None
    if attributes.get("config_hash") == cube.config_hash:
        return attributes
    differences = [
        f"{key} is {attributes.get(key)}, not {value}"
        for key, value in cube.settings.items()
        if attributes.get(key) != value
    ]
    if not differences:
        found, _ = metadata.stored(place, cube.name)
        differences = [
            f"the values of {dim} differ"
            for dim, coordinate in cube.template.coords.items()
            if dim not in found or not np.array_equal(found[dim][...], coordinate.values)
        ]
    raise StoreError(
        f"{place}/{STORE}/{cube.name} was computed with other settings: "
        f"{'; '.join(differences) or 'its tiles or variables differ'}. "
        "Repeat the old settings to resume it, or choose another --out or --store"
    )


def refuse_other_mathematics(out, cube):
    """StoreError if the tiles that are there were computed by other code: none are mixed."""
    place = place_of(out)
    theirs, ours = metadata.attributes(place, cube.name).get("computed_by"), computed_by()
    if theirs != ours:
        raise StoreError(
            f"{place}/{STORE}/{cube.name} was computed by {theirs}; this is {ours}. Resume it with "
            "those versions, or choose another --out or --store"
        )


def create(out, cube):
    """Make the cube's group, all tiles missing, or check that the one that is there is the same.

    Returns its Layout. StoreError, naming what differs, if a cube of this name with other
    coordinates or settings is there. Damaged metadata or coordinates are written anew.
    """
    layout = layout_of(place_of(out), cube)
    place, attributes = layout.place, refuse_different(out, cube)
    if attributes is None:
        metadata.put_group(place, cube, metadata.empty_files(layout, cube, provenance()))
    elif not is_intact(place, f"{STORE}/{cube.name}", layout.tiled):
        # Who computed the tiles that are there is told nowhere else.
        kept = {key: attributes[key] for key in provenance() if key in attributes}
        place.put_files(f"{STORE}/{cube.name}", metadata.empty_files(layout, cube, kept))
    metadata.gather(place, cube.name)
    return layout


def replace(out, cube):
    """Write a cube that is computed in full, compressed, in place of an earlier state of itself.

    Nothing is written if that state is the same. StoreError if another cube of this name is there.
    """
    place, attributes = place_of(out), refuse_different(out, cube)
    if attributes is not None and is_intact(place, f"{STORE}/{cube.name}", ()):
        metadata.gather(place, cube.name)
        if read(out, cube.name).equals(cube.template):
            return
    metadata.put_group(place, cube, metadata.whole_files(cube, provenance()))


def missing(layout):
    """Indices of the tiles that are not committed, in tile order: int array (tiles, dims)."""
    committed = np.ones(layout.record.shape, dtype=bool)
    for variable in (layout.record, *layout.variables):
        committed &= tiles_with(layout, variable, variable.chunk_bytes)
    return np.argwhere(~committed)


def tiles_with(layout, variable, size=None):
    """For each of the tiles, whether the variable has a chunk, of that size if one is given.

    One pass over the files, which may be millions: nothing is kept of them but a bit for each tile.
    """
    chunks = layout.chunks(variable)
    found = np.zeros(layout.record.shape, dtype=bool)
    for key, length in layout.place.sizes(chunks):
        if length == size or size is None:
            with suppress(ValueError, IndexError):  # others' files, e.g. of a file browser
                found[variable.tile_of(key[len(chunks) + 1 :])] = True
    return found


def is_committed(layout, index):
    """Whether the tile's commit record and data are there, in full length.

    The record alone would do after a kill; after a power cut the disk may have kept the record and
    lost the data, as nothing here waits for the disk.
    """
    return all(
        layout.place.size(layout.key(variable, index)) == variable.chunk_bytes
        for variable in (layout.record, *layout.variables)
    )


def commit(layout, index, arrays, seconds):
    """Write the tile's data, then its commit record: the CPU seconds that it took."""
    chunks = {
        layout.key(variable, index): variable.encoded(arrays[variable.name], index)
        for variable in layout.variables
    }
    record = np.full(layout.record.chunk_shape, seconds)
    for key, data in chunks.items():
        layout.place.put(key, data)
    layout.place.put(layout.key(layout.record, index), layout.record.encoded(record, index))


def record_failure(layout, index, reason):
    """Write why a tile that is not committed has failed, beside the place of its commit record."""
    layout.place.put(layout.failure_key(index), reason.encode(errors="replace"))


def read(out, name):
    """The cube `name` as a Dataset, read lazily. To read a damaged chunk is a ValueError."""
    # Version 3 alone: what others wrote as version 2 may name codecs that run what they decode.
    store = place_of(out).zarr_store(STORE)
    return xr.open_zarr(store, group=name, chunks=None, zarr_format=3)
