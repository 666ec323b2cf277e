"""How far a sweep is, from its store alone: nothing is written, and no driver is disturbed.

A tile is done if its commit record is there in full length, and was done when that was written. One
that is missing failed when it was last tried, if the store has the reason; or it has not had its
turn, or was not wanted.
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from math import nan, prod

import numpy as np

from pipeline.faults import LONGEST_REASON, in_one_line
from pipeline.layout import FAILURE, STORE, is_sound
from pipeline.metadata import stored
from pipeline.store import place_of

RECENT = 300
"""Seconds before the last commit over which the rate is taken."""

_READ = 1024  # commit records that are read; of more, these are a sample
_TOLD = 10  # failures whose reasons are read


@dataclass(frozen=True)
class State:
    """Of one cube: numbers of tiles; CPU seconds, of which `sampled` says if they are estimated;
    bytes; the time of the last commit; tiles per second in the last minutes before it.

    tiles is 0 for a cube that is no sweep's: it was written whole. reasons : {index: why it failed}
    of the first few of the failed tiles.
    """

    name: str
    tiles: int
    done: int
    failed: int
    reasons: dict[tuple[int, ...], str]
    cpu_seconds: float
    sampled: bool
    size: int
    last: float
    rate: float

    @property
    def missing(self):
        return self.tiles - self.done

    @property
    def seconds_left(self):
        """If it goes on at that rate; NaN if there is none."""
        return self.missing / self.rate if self.rate > 0 else nan


def driver(out):
    """Who drives the store in `out` now, in words; "" if nobody does."""
    return place_of(out).driver()


def state(out, name):
    """The State of the cube `name`; StoreError if its metadata are damaged."""
    place = place_of(out)
    _, layout = stored(place, name)
    if not layout:
        size = sum(size for _, size in place.sizes(f"{STORE}/{name}"))
        return State(name, 0, 0, 0, {}, nan, False, size, nan, nan)
    changes = place.changes(layout.chunks(layout.record))
    whole = layout.record.chunk_bytes
    records = {
        key: time
        for key, (size, time) in changes.items()
        if size == whole and not key.endswith(FAILURE)
    }
    failed = _failed_tiles(layout, changes.keys(), records)
    every = -(-len(records) // _READ) or 1
    seconds = _cpu_seconds(place, sorted(records)[::every])
    last, rate = _rate(np.fromiter(records.values(), float, len(records)))
    return State(
        name,
        tiles=prod(layout.record.shape),
        done=len(records),
        failed=len(failed),
        reasons={
            index: _reason(layout, index, changes[layout.failure_key(index)][0])
            for index in failed[:_TOLD]
        },
        cpu_seconds=float(np.mean(seconds) * len(records)) if seconds else 0.0,
        sampled=every > 1,
        # Every tile has one chunk of each variable, and all have the same length.
        size=len(records) * sum(v.chunk_bytes for v in (layout.record, *layout.variables)),
        last=last,
        rate=rate,
    )


def _failed_tiles(layout, keys, records):
    """Indices of the tiles that have a reason and no commit record, in tile order."""
    start, end = len(layout.chunks(layout.record)) + 1, -len(FAILURE)
    failed = []
    for key in keys:
        if key.endswith(FAILURE) and key[:end] not in records:
            with suppress(ValueError):  # others' files
                index = layout.record.tile_of(key[start:end])
                if layout.failure_key(index) == key:
                    failed.append(index)
    return sorted(failed)


def _reason(layout, index, size):
    """In one line that is safe to print: whoever made the store may have written anything."""
    if size > LONGEST_REASON:
        return "for a reason too long to be one of ours"
    return in_one_line(
        (layout.place.read(layout.failure_key(index)) or b"").decode(errors="replace")
    )


def _cpu_seconds(place, keys):
    with ThreadPoolExecutor(8) as pool:  # an object store takes its time for each
        chunks = [data for data in pool.map(place.read, keys) if data]
    return [np.frombuffer(data[:-4], "<f8")[0] for data in chunks if is_sound(data)]


def _rate(times):
    """(time of the last commit, commits per second in the last minutes before it)."""
    if not times.size:
        return nan, nan
    last = times.max()
    recent = times[times >= last - RECENT]
    span = last - recent.min()
    return float(last), float((recent.size - 1) / span) if span > 0 else nan
