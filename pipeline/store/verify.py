"""Look at every chunk of a cube, and free damaged tiles for a new computation.

A tile is damaged if it has a commit record, and one of its chunks is gone, was cut, or does not
match its checksum. All that is needed is in the store.
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import numpy as np

from pipeline.store.metadata import copies_agree
from pipeline.store.place import Refused, explained
from pipeline.store.tiles import (
    COMMIT,
    arrays_of,
    chunk_of,
    failure_key,
    forget,
    survey,
    tiled_arrays,
)

_AT_ONCE = 1024  # tiles that are looked at together


def verify(place, name, repair=False):
    """Yield (index, what is wrong) for each damaged tile of the cube, in tile order.

    The index () stands for metadata, coordinates, and all of a cube that was written whole: the
    next run of its workflow writes these anew. With `repair`, damaged tiles become missing.
    """
    forget()
    try:
        arrays = arrays_of(place, name)
    except Refused:
        yield (), "its metadata are lost or damaged"
        return
    if not copies_agree(place, name):
        yield (), "copies of its metadata differ"
        return
    tiled = tiled_arrays(arrays) if COMMIT in arrays else {}
    for key in sorted(arrays.keys() - tiled.keys()):
        array = arrays[key]
        blocks = np.ndindex(*array.cdata_shape)
        wrong = {_look(place, {key: (array, range(array.ndim))}, block) for block in blocks}
        if array.nchunks_initialized < array.nchunks:
            wrong.add(f"a chunk of {key} is gone")
        yield from (((), what) for what in sorted(wrong - {""}))
    if not tiled:
        return
    done, written = survey(place, name)
    indices = np.argwhere(np.isfinite(written))

    def look(index):
        return _look(place, tiled, index) if done[index] else "a chunk is gone, or was cut short"

    with ThreadPoolExecutor(8) as pool:  # an object store takes its time for each
        for start in range(0, len(indices), _AT_ONCE):
            tiles = list(map(tuple, indices[start : start + _AT_ONCE].tolist()))
            for index, what in zip(tiles, pool.map(look, tiles), strict=True):
                if what and repair:
                    _free(place, name, tiled, index)
                if what:
                    yield index, what


def _look(place, arrays, index):
    """Read the chunks of the index; what is wrong with them, "" if nothing is."""
    with explained(place):
        for key, (array, axes) in arrays.items():
            try:
                array.get_block_selection(chunk_of(array, axes, index))
            except ValueError:
                return f"{key} does not match its checksum"
    return ""


def _free(place, name, tiled, index):
    """Make the tile missing, its commit record first."""
    keys = [COMMIT, *sorted(tiled.keys() - {COMMIT})]
    with explained(place):
        for key in keys:
            array, axes = tiled[key]
            with suppress(FileNotFoundError):
                chunk = "/".join(map(str, chunk_of(array, axes, index)))
                place.objects().delete(f"{name}.zarr/{key}/c/{chunk}")
        with suppress(FileNotFoundError):
            place.objects().delete(failure_key(name, index))
