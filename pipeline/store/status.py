"""How far a sweep is, from its store alone: writes nothing, disturbs no driver.

A tile was done when its commit record was written. One that is missing failed when it was last
tried, if the store has the reason; otherwise it has not had its turn, or was not wanted.
"""

from contextlib import suppress
from dataclasses import dataclass, field
from math import nan

import numpy as np

from pipeline.store.metadata import names
from pipeline.store.place import Refused
from pipeline.store.tiles import COMMIT, arrays_of, failure_key, forget, survey, wanted_key

RECENT = 300  # seconds before the last commit over which the rate is taken
_TOLD = 10  # failures whose reasons are read


@dataclass(frozen=True)
class State:
    """How far one cube is."""

    name: str
    tiles: int = 0  # wanted so far; 0 for a cube that was written whole, or is damaged
    done: int = 0  # tiles that are committed
    failed: int = 0  # tiles that failed when they were last tried
    reasons: dict[tuple[int, ...], str] = field(default_factory=dict)  # of the first few failures
    rate: float = nan  # tiles per second in the last minutes before the last commit
    damage: str = ""  # what hides the cube's state


def status(place):
    """Yield the State of each cube in the place; Refused if the place does not exist."""
    forget()
    for name in names(place):
        try:
            yield _state(place, name)
        except Refused as damage:
            yield State(name, damage=str(damage))


def _state(place, name):
    if COMMIT not in arrays_of(place, name):
        return State(name)
    done, written = survey(place, name)
    failed = []
    for file in place.files(f"{name}.zarr/.failed"):
        with suppress(ValueError, IndexError):  # somebody else's file
            index = tuple(map(int, file["path"].rpartition("/")[2].split(".")))
            failed += [] if done[index] else [index]
    told = {i: place.read(failure_key(name, i)) for i in sorted(failed)[:_TOLD]}
    reasons = {i: reason.decode(errors="replace") for i, reason in told.items()}
    times = written[done]
    recent = times[times >= times.max(initial=0) - RECENT]
    span = np.ptp(recent) if recent.size else 0
    rate = float((recent.size - 1) / span) if span > 0 else nan
    wanted = place.read(wanted_key(name))
    tiles = int(wanted) if wanted.isdigit() else done.size
    return State(name, tiles, int(done.sum()), len(failed), reasons, rate)
