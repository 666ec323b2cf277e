"""Look at every chunk of a store, and free what is damaged for a new computation.

A tile is damaged if it is committed and one of its chunks is gone, cut short, or does not match its
checksum. Its commit record is deleted first, so that the next sweep computes it, and no other.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import zarr

from pipeline.faults import StoreError
from pipeline.layout import COMMIT, STORE, is_sound, stored_layout
from pipeline.store import consolidate, opened, place_of, refuse_foreign, tiles_with, unreadable

_AT_ONCE = 1024  # tiles that are looked at together


def names(out):
    """Names of the cubes in the store; StoreError if there is none of this version."""
    refuse_foreign(out)
    try:
        return sorted(zarr.open_group(place_of(out).zarr_store(STORE), mode="r").group_keys())
    except FileNotFoundError:
        raise StoreError(f"{out} holds no {STORE}; give the --out or --store of a run") from None


def committed(out, name):
    """Indices of a cube's tiles that have a commit record, be it damaged: int array (tiles, dims).

    A cube that is no sweep's has no tiles.
    """
    place = place_of(out)
    group = opened(place, name)
    layout = stored_layout(place, name, group)
    if not layout:
        return np.empty((0, 0), dtype=int)
    return np.argwhere(tiles_with(layout, layout.record, group[COMMIT].shape))


def verify(out, name, tiles):
    """Yield (index, what is damaged, or None) for the cube, and for each of the tiles.

    The index of the cube is (): its coordinates, and all of a cube that is no sweep's.
    """
    place = place_of(out)
    group = opened(place, name)
    layout = stored_layout(place, name, group)
    yield (), _damaged_cube(group, layout)
    with ThreadPoolExecutor(8) as pool:  # an object store takes its time for each
        for i in range(0, len(tiles), _AT_ONCE):
            some = [tuple(index) for index in tiles[i : i + _AT_ONCE].tolist()]
            yield from zip(some, pool.map(partial(_damaged_tile, layout), some), strict=True)


def free(out, name, index):
    """Make a tile missing; or, for (), the cube, unless it is a sweep's, which mends itself."""
    place = place_of(out)
    layout = stored_layout(place, name, opened(place, name))
    if layout and index:
        place.delete([layout.key(layout.record, index)])
        chunks = [layout.key(variable, index) for variable in layout.variables]
        place.delete([*chunks, layout.failure_key(index)])
    elif not layout:
        place.delete_group(f"{STORE}/{name}")
        consolidate(place)


def _damaged_cube(group, layout):
    tiled = {COMMIT, *(variable.name for variable in layout.variables)} if layout else set()
    damaged = unreadable(group, sorted(set(group.array_keys()) - tiled))
    return f"{', '.join(damaged)} cannot be read" if damaged else None


def _damaged_tile(layout, index):
    for variable in (layout.record, *layout.variables):
        data = layout.place.read(layout.key(variable, index))
        if data is None:
            return f"{variable.name} is gone"
        if len(data) != variable.chunk_bytes:
            return f"{variable.name} has {len(data)} bytes instead of {variable.chunk_bytes}"
        if not is_sound(data):
            return f"{variable.name} does not match its checksum"
    return None
