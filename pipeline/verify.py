"""Look at every chunk of a store, and free what is damaged for a new computation.

A tile is damaged if it is committed and one of its chunks is gone, cut short, or does not match its
checksum. Its commit record is deleted first, so that the next sweep computes it, and no other.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import product

import zarr

from pipeline.layout import COMMIT, STORE, checksum, stored_layout
from pipeline.store import consolidate, opened, place_of, unreadable

_AT_ONCE = 1024  # tiles that are looked at together


def names(out):
    """Names of the cubes in the store."""
    return sorted(zarr.open_group(place_of(out).zarr_store(STORE), mode="r").group_keys())


def verify(out, name):
    """Yield (index, what is damaged, or None) for the cube and each of its tiles that is committed.

    The cube itself has the index (): its coordinates, and all of a cube that is no sweep's.
    """
    place = place_of(out)
    group = opened(place, name)
    layout = stored_layout(place, name, group)
    tiled = {COMMIT, *(variable.name for variable in layout.variables)} if layout else set()
    damaged = unreadable(group, sorted(set(group.array_keys()) - tiled))
    yield (), f"{', '.join(damaged)} cannot be read" if damaged else None
    if not layout:
        return
    records = place.sizes(f"{STORE}/{name}/{COMMIT}")
    indices = product(*map(range, group[COMMIT].shape))
    committed = [index for index in indices if layout.key(layout.record, index) in records]
    with ThreadPoolExecutor(8) as pool:  # an object store takes its time for each
        for i in range(0, len(committed), _AT_ONCE):
            some = committed[i : i + _AT_ONCE]
            yield from zip(some, pool.map(partial(_damage, layout), some), strict=True)


def free(out, name, index):
    """Make a tile missing; or, for (), the cube, unless it is a sweep's, which mends itself."""
    place = place_of(out)
    layout = stored_layout(place, name, opened(place, name))
    if layout and index:
        place.delete([layout.key(layout.record, index)])
        place.delete([layout.key(variable, index) for variable in layout.variables])
    elif not layout:
        place.delete([f"{STORE}/{name}/zarr.json"])
        place.delete(list(place.sizes(f"{STORE}/{name}")))
        consolidate(place)


def _damage(layout, index):
    """What is wrong with a committed tile, or None."""
    for variable in (layout.record, *layout.variables):
        data = layout.place.read(layout.key(variable, index))
        if data is None:
            return f"{variable.name} is gone"
        if len(data) != variable.chunk_bytes:
            return f"{variable.name} has {len(data)} bytes instead of {variable.chunk_bytes}"
        if checksum(data[:-4]) != data[-4:]:
            return f"{variable.name} does not match its checksum"
    return None
