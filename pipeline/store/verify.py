"""What the store tells of its cubes: what is damaged, and how far sweeps are (`status`).

A tile is done if its commit record and all its data are there. One that has a record alone has
lost its data. One without a record failed when it was last tried, if the store has the reason;
otherwise it has not had its turn, or was not wanted. A tile is damaged if it has a record, and a
chunk is gone or does not match its checksum, or the record's.
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from math import nan, prod

import numpy as np

from pipeline.store import tiles
from pipeline.store.decoding import MAX_TILE
from pipeline.store.metadata import changes, has_digests, names
from pipeline.store.place import Refused, printable
from pipeline.store.tiles import COMMIT, chunk_key

RECENT = 300  # seconds before the last commit over which the rate is taken
_TOLD = 10  # failures whose reasons are read
_AT_ONCE = 1024  # tiles that are looked at together
_THREADS = 8  # fewer where the tiles that they read would take more than MAX_TILE together


@dataclass(frozen=True)
class State:
    """How far one cube is."""

    name: str
    tiles: int = 0  # wanted so far; 0 for a cube that was written whole, or is damaged
    done: int = 0  # tiles that are committed, with all their data
    lost: int = 0  # tiles that were committed, and have lost data since
    failed: int = 0  # tiles that failed when they were last tried
    reasons: dict[tuple[int, ...], str] = field(default_factory=dict)  # of the first few failures
    rate: float = nan  # tiles per second in the last minutes before the last commit
    damage: str = ""  # what hides the cube's state


def status(place):
    """Yield the State of each cube in the place; Refused if the place does not exist."""
    tiles.forget()
    for name in names(place):
        try:
            damage = changes(place, name)
            yield State(name, damage=damage) if damage else _state(place, name)
        except Refused as refusal:
            yield State(name, damage=str(refusal))


def _state(place, name):
    arrays = tiles.arrays_of(place, name)
    if COMMIT not in arrays:
        return State(name)
    done, written = tiles.commit_times(place, arrays)
    has_record, failed = np.isfinite(written), []
    for file in place.files(f"{name}.zarr/.failed"):
        with suppress(ValueError, IndexError):  # somebody else's file
            index = tuple(map(int, file["path"].rpartition("/")[2].split(".")))
            failed += [] if has_record[index] else [index]
    told = {i: place.read(tiles.failure_key(name, i)) for i in sorted(failed)[:_TOLD]}
    reasons = {i: printable(reason.decode(errors="replace")) for i, reason in told.items()}
    times = written[done]
    recent = times[times >= times.max(initial=0) - RECENT]
    span = np.ptp(recent) if recent.size else 0
    rate = float((recent.size - 1) / span) if span > 0 else nan
    n_done, n_tiles = int(done.sum()), done.size
    with suppress(ValueError):  # none was noted
        # Less than what is done was noted before, e.g. where a copy was made while a sweep ran.
        if n_done <= (wanted := int(place.read(tiles.wanted_key(name)))) <= n_tiles:
            n_tiles = wanted
    return State(name, n_tiles, n_done, int(has_record.sum()) - n_done, len(failed), reasons, rate)


def verify(place, name, repair=False):
    """Yield (index, what is wrong) for each damaged tile of the cube, in tile order.

    The index () stands for metadata, coordinates, and all of a cube that was written whole: the
    next run of its workflow writes these anew, and its tiles are looked at no sooner. With
    `repair`, damaged tiles become missing, if it is known that the metadata are as they were
    written: by wrong ones, sound tiles look damaged. See `has_digests`.
    """
    tiles.forget()
    try:
        if what := changes(place, name):
            raise Refused(what)
        repair = repair and has_digests(place, name)
        arrays = tiles.arrays_of(place, name)
        tiled = tiles.blocks(arrays, (0,) * (arrays[COMMIT].ndim - 1)) if COMMIT in arrays else {}
        for key in arrays.keys() - tiled.keys():
            for block in np.ndindex(arrays[key].cdata_shape):
                tiles.chunk(place, key, arrays[key], block)
    except (Refused, ValueError) as error:
        yield (), str(error)
        return
    if not tiled:
        return
    written = np.argwhere(np.isfinite(tiles.commit_times(place, arrays)[1]))
    tile_bytes = sum(array.dtype.itemsize * prod(array.chunks) for array, _ in tiled.values())
    n_threads = max(1, min(_THREADS, MAX_TILE // tile_bytes))
    with ThreadPoolExecutor(n_threads) as pool:  # an object store takes its time for each
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
