"""Look at every chunk of a cube, and free damaged tiles for a new computation.

A tile is damaged if it has a commit record, and one of its chunks is gone, or does not match its
own checksum, or that of the record. All that is needed is in the store.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from pipeline.store import tiles
from pipeline.store.place import Refused
from pipeline.store.tiles import COMMIT, chunk_key

_AT_ONCE = 1024  # tiles that are looked at together


def verify(place, name, repair=False):
    """Yield (index, what is wrong) for each damaged tile of the cube, in tile order.

    The index () stands for metadata, coordinates, and all of a cube that was written whole: the
    next run of its workflow writes these anew, and its tiles are looked at no sooner. With
    `repair`, damaged tiles become missing.
    """
    tiles.forget()
    try:
        arrays = tiles.arrays_of(place, name)
        tiled = tiles.blocks(arrays, (0,) * (arrays[COMMIT].ndim - 1)) if COMMIT in arrays else {}
        for key in arrays.keys() - tiled.keys():
            for block in np.ndindex(arrays[key].cdata_shape):
                tiles.chunk(place, key, arrays[key], block)
    except (Refused, ValueError) as what:
        yield (), str(what)
        return
    if not tiled:
        return
    written = np.argwhere(np.isfinite(tiles.survey(place, name)[1]))
    with ThreadPoolExecutor(8) as pool:  # an object store takes its time for each
        for some in np.split(written, range(_AT_ONCE, len(written), _AT_ONCE)):
            indices = list(map(tuple, some.tolist()))
            found = pool.map(partial(tiles.damage, place, arrays), indices)
            for index, what in zip(indices, found, strict=True):
                if what and repair:
                    free(place, name, index)
                if what:
                    yield index, what


def free(place, name, index):
    """Make a tile missing: delete its commit record first, then its data."""
    arrays = tiles.arrays_of(place, name)
    of_tile = tiles.blocks(arrays, index)
    keys = [chunk_key(*of_tile.pop(COMMIT)), *(chunk_key(*at) for at in of_tile.values())]
    for key in [*keys, tiles.failure_key(name, index), tiles.certificates_key(name, index)]:
        place.delete(key)
