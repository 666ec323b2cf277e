"""Look at every chunk of a store, and free what is damaged for a new computation.

A tile is damaged if it is committed and one of its chunks is gone, cut short, or does not match its
checksum. Its commit record is deleted first, so that the next sweep computes it, and no other.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from pipeline import metadata
from pipeline.faults import StoreError
from pipeline.layout import COMMIT, STORE, is_sound
from pipeline.seal import is_intact
from pipeline.store import place_of, refuse_foreign, tiles_with

_AT_ONCE = 1024  # tiles that are looked at together


def names(out):
    """Names of the cubes in the store; StoreError if there is none of this version."""
    refuse_foreign(out)
    place = place_of(out)
    if STORE not in place.names():
        raise StoreError(f"{out} holds no {STORE}; give the --out or --store of a run")
    return metadata.names(place)


def committed(out, name):
    """Indices of a cube's tiles that have a commit record, be it damaged: int array (tiles, dims).

    A cube that is no sweep's has no tiles. StoreError if its metadata are damaged, here and below.
    """
    _, layout = metadata.stored(place_of(out), name)
    if not layout:
        return np.empty((0, 0), dtype=int)
    return np.argwhere(tiles_with(layout, layout.record))


def verify(out, name, tiles):
    """Yield (index, what is damaged, or None) for the cube, and for each of the tiles.

    The index of the cube is (): its metadata and coordinates, and all of a cube that is no sweep's.
    By metadata that are damaged no tile can be judged, and none is.
    """
    place = place_of(out)
    _, layout = metadata.stored(place, name)
    if not is_intact(place, f"{STORE}/{name}", layout.tiled if layout else ()):
        yield (), "its metadata or coordinates" if layout else "its metadata or numbers"
        return
    own, copies = metadata.with_copies(place, name)
    misleading = any(own[key] != copy for key, copy in copies.items())
    yield (), "the copy of its metadata at the root" if misleading else None
    with ThreadPoolExecutor(8) as pool:  # an object store takes its time for each
        for i in range(0, len(tiles), _AT_ONCE):
            some = [tuple(index) for index in tiles[i : i + _AT_ONCE].tolist()]
            yield from zip(some, pool.map(partial(_damaged_tile, layout), some), strict=True)


def free(out, name, index):
    """Make a tile missing; or, for (), the cube, but not a sweep's: its next run mends it."""
    place = place_of(out)
    _, layout = metadata.stored(place, name)
    if layout and index:
        place.delete([layout.key(layout.record, index)])
        chunks = [layout.key(variable, index) for variable in layout.variables]
        place.delete([*chunks, layout.failure_key(index)])
    elif not layout and not any(place.sizes(f"{STORE}/{name}/{COMMIT}")):
        place.delete_group(f"{STORE}/{name}")
        metadata.consolidate(place)


def _damaged_tile(layout, index):
    for variable in (layout.record, *layout.variables):
        key = layout.key(variable, index)
        size = layout.place.size(key)
        if size is None:
            return f"{variable.name} is gone"
        if size != variable.chunk_bytes:  # it is not read then: it may be of any length
            return f"{variable.name} has {size} bytes instead of {variable.chunk_bytes}"
        if not is_sound(layout.place.read(key) or b""):
            return f"{variable.name} does not match its checksum"
    return None
