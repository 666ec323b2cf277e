"""The state of the cubes in a store: progress of sweeps (`status`), damaged tiles (`verify`).

A tile is done if its commit record and all its data exist. If only the record exists, the data of
the tile are lost. A tile without a record failed at its last attempt if the store contains a reason
for the failure; otherwise it has not been attempted yet, or is not wanted. A tile is damaged if it
has a record, but a chunk is lost, or does not match its own checksum or the checksum in the record.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from math import nan, prod

import numpy as np

from pipeline.store import tiles
from pipeline.store.decoding import MAX_TILE
from pipeline.store.metadata import changes, has_digests, names
from pipeline.store.place import Place, Refused, printable
from pipeline.store.tiles import COMMIT, chunk_key

RECENT = 300
"""The rate is measured over this number of seconds before the last commit."""

_MAX_REASONS = 10  # maximum number of failures whose reasons are read
_MAX_SUBMITTED = 1024  # maximum number of tiles that are submitted together
_MAX_THREADS = 8  # fewer threads if their tiles would together exceed MAX_TILE bytes


@dataclass(frozen=True)
class State:
    """The state of one cube.

    Attributes
    ----------
    name : str
    tiles : int
        Tiles wanted so far; 0 for a cube that has no tiles or is damaged.
    done : int
        Tiles that are committed, with all their data.
    lost : int
        Tiles that were committed, but have lost data since.
    failed : int
        Tiles that failed at their last attempt.
    reasons : dict
        The reasons for the first few failures, by the index of the tile.
    rate : float
        Tiles per second in the minutes before the last commit.
    damage : str
        Why the state is unknown; "" if it is known.
    """

    name: str
    tiles: int = 0
    done: int = 0
    lost: int = 0
    failed: int = 0
    reasons: dict[tuple[int, ...], str] = field(default_factory=dict)
    rate: float = nan
    damage: str = ""


def status(place: Place) -> Iterator[State]:
    """Yield the State of each cube in the place; raise Refused if the place does not exist."""
    tiles.forget()
    for name in names(place):
        try:
            damage = changes(place, name)
            yield State(name, damage=damage) if damage else _state(place, name)
        except Refused as refusal:
            yield State(name, damage=str(refusal))


def _state(place: Place, name: str) -> State:
    """Return the State of a cube."""
    arrays = tiles.arrays_of(place, name)
    if COMMIT not in arrays:
        return State(name)
    done, committed = tiles.commit_times(place, arrays)
    has_record = np.isfinite(committed)
    failed: list[tuple[int, ...]] = []
    for file in place.files(f"{name}.zarr/.failed"):
        with suppress(ValueError, IndexError):  # the file belongs to no tile
            index = tuple(map(int, file["path"].rpartition("/")[2].split(".")))
            failed += [] if has_record[index] else [index]
    files = {i: place.read(tiles.failure_key(name, i)) for i in sorted(failed)[:_MAX_REASONS]}
    reasons = {i: printable(reason.decode(errors="replace")) for i, reason in files.items()}
    times = committed[done]
    recent = times[times >= times.max(initial=0) - RECENT]
    span = np.ptp(recent) if recent.size else 0
    rate = float((recent.size - 1) / span) if span > 0 else nan
    n_done, n_tiles = int(done.sum()), done.size
    with suppress(ValueError):  # if no number is stored, all tiles are wanted
        # A number smaller than n_done is outdated, e.g. in a copy of a running sweep.
        if n_done <= (wanted := int(place.read(tiles.wanted_key(name)))) <= n_tiles:
            n_tiles = wanted
    return State(name, n_tiles, n_done, int(has_record.sum()) - n_done, len(failed), reasons, rate)


def verify(place: Place, name: str, repair: bool = False) -> Iterator[tuple[tuple[int, ...], str]]:
    """Yield (index, fault) for each damaged tile of the cube, in tile order.

    The index () denotes the metadata, the coordinates, or a cube without tiles. The next run of the
    cube's command rewrites these; until then the tiles are not verified.

    Parameters
    ----------
    place : Place
        Where the cube is stored.
    name : str
        Name of the cube.
    repair : bool
        If True, delete damaged tiles, which then count as missing. This is done only if digests
        show that the metadata are unchanged (see `has_digests`), because intact tiles would look
        damaged if the metadata were wrong.
    """
    tiles.forget()
    try:
        if changed := changes(place, name):
            raise Refused(changed)
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
    committed = np.argwhere(np.isfinite(tiles.commit_times(place, arrays)[1]))
    tile_bytes = sum(array.dtype.itemsize * prod(array.chunks) for array, _ in tiled.values())
    n_threads = max(1, min(_MAX_THREADS, MAX_TILE // tile_bytes))
    with ThreadPoolExecutor(n_threads) as pool:  # object stores are slow to answer
        for first in range(0, len(committed), _MAX_SUBMITTED):
            indices = list(map(tuple, committed[first : first + _MAX_SUBMITTED].tolist()))
            faults = pool.map(partial(tiles.damage, place, arrays), indices)
            for index, fault in zip(indices, faults, strict=True):
                if fault and repair:
                    free(place, name, index)
                if fault:
                    yield index, fault


def free(place: Place, name: str, index: Sequence[int]) -> None:
    """Make a tile missing: delete its commit record first, then its data."""
    arrays = tiles.arrays_of(place, name)
    of_tile = tiles.blocks(arrays, index)
    keys = [chunk_key(*of_tile.pop(COMMIT)), *(chunk_key(*at) for at in of_tile.values())]
    for key in [*keys, tiles.failure_key(name, index), tiles.certificates_key(name, index)]:
        place.delete(key)
