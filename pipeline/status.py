"""How far a sweep is, from its store alone: nothing is written, and no driver is disturbed.

A tile is done if its commit record is there in full length, and was done when that was written. Why
a tile is missing is recorded nowhere: it has not had its turn, was not wanted, or has failed.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import nan, prod

import numpy as np

from pipeline.layout import COMMIT, STORE, is_sound, stored_layout
from pipeline.store import opened, place_of

RECENT = 300
"""Seconds before the last commit over which the rate is taken."""

_READ = 1024  # commit records that are read; of more, these are a sample


@dataclass(frozen=True)
class State:
    """Of one cube: numbers of tiles; CPU seconds, of which `sampled` says if they are estimated;
    bytes; the time of the last commit; tiles per second in the last minutes before it.

    tiles is 0 for a cube that is no sweep's: it was written whole.
    """

    name: str
    tiles: int
    done: int
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
    group = opened(place, name)
    layout = stored_layout(place, name, group)
    if not layout:
        size = sum(size for _, size in place.sizes(f"{STORE}/{name}"))
        return State(name, 0, 0, nan, False, size, nan, nan)
    records = {
        key: time
        for key, (size, time) in place.changes(f"{STORE}/{name}/{COMMIT}/c").items()
        if size == layout.record.chunk_bytes
    }
    every = -(-len(records) // _READ) or 1
    seconds = _cpu_seconds(place, sorted(records)[::every])
    last, rate = _rate(np.fromiter(records.values(), float, len(records)))
    return State(
        name,
        tiles=prod(group[COMMIT].shape),
        done=len(records),
        cpu_seconds=float(np.mean(seconds) * len(records)) if seconds else 0.0,
        sampled=every > 1,
        # Every tile has one chunk of each variable, and all have the same length.
        size=len(records) * sum(v.chunk_bytes for v in (layout.record, *layout.variables)),
        last=last,
        rate=rate,
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
