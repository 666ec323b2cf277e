"""Look at every chunk of a cube, and free damaged tiles for a new computation.

A tile is damaged if it has a commit record, and one of its chunks is gone, or does not match its
checksum. All that is needed is in the store.
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial

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
        whole = {key: (arrays[key], range(arrays[key].ndim))}
        blocks = np.ndindex(*arrays[key].cdata_shape)
        wrong = {_wrong(place, whole, block) for block in blocks}
        yield from (((), what) for what in sorted(wrong - {""}))
    if not tiled:
        return
    indices = np.argwhere(np.isfinite(survey(place, name)[1]))
    with ThreadPoolExecutor(8) as pool:  # an object store takes its time for each
        for start in range(0, len(indices), _AT_ONCE):
            tiles = list(map(tuple, indices[start : start + _AT_ONCE].tolist()))
            found = pool.map(partial(_wrong, place, tiled), tiles)
            for index, what in zip(tiles, found, strict=True):
                if what and repair:
                    _free(place, name, tiled, index)
                if what:
                    yield index, what


def _wrong(place, arrays, index):
    """Read the chunks of the index; return what is wrong with them, "" if nothing is."""
    with explained(place):
        for key, (array, axes) in arrays.items():
            chunk = chunk_of(array, axes, index)
            try:
                place.objects().head(
                    _key(array, chunk)
                )  # zarr reads a chunk that is gone as fill values
                array.get_block_selection(chunk)
            except FileNotFoundError:
                return f"a chunk of {key} is gone"
            except ValueError:
                return f"{key} does not match its checksum"
    return ""


def _free(place, name, tiled, index):
    """Make the tile missing, its commit record first."""
    arrays = [tiled[COMMIT], *tiled.values()]
    keys = [_key(array, chunk_of(array, axes, index)) for array, axes in arrays]
    with explained(place):
        for key in [*keys, failure_key(name, index)]:
            with suppress(FileNotFoundError):
                place.objects().delete(key)


def _key(array, chunk):
    return f"{array.path}/{array.metadata.encode_chunk_key(chunk)}"
