"""How far a sweep is, from its store alone: writes nothing, disturbs no driver.

A tile was done when its commit record was written. One that is missing failed when it was last
tried, if the store has the reason; otherwise it has not had its turn, or was not wanted.
"""

from contextlib import suppress
from dataclasses import dataclass, field
from math import nan

import numpy as np

from pipeline.store.metadata import names
from pipeline.store.place import Refused, explained
from pipeline.store.tiles import COMMIT, arrays_of, failure_key, forget, survey

RECENT = 300
"""Seconds before the last commit over which the rate is taken."""

_TOLD = 10  # failures whose reasons are read


@dataclass(frozen=True)
class State:
    """How far one cube is.

    name : of the cube.
    tiles : their number; 0 for a cube that was written whole, or whose metadata are damaged.
    done : tiles that are committed.
    failed : tiles that failed when they were last tried.
    reasons : {index: why it failed}, of the first few.
    rate : tiles per second in the last minutes before the last commit; NaN if unknown.
    damage : what hides the cube's state, "" if nothing does.
    """

    name: str
    tiles: int = 0
    done: int = 0
    failed: int = 0
    reasons: dict[tuple[int, ...], str] = field(default_factory=dict)
    rate: float = nan
    damage: str = ""

    @property
    def seconds_left(self):
        """Time to the end at that rate; NaN if the rate is unknown."""
        return (self.tiles - self.done) / self.rate if self.rate > 0 else nan


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
    with explained(place):
        failed = sorted(_failed(place, name, done))
        files = [(index, place.objects().get(failure_key(name, index))) for index in failed[:_TOLD]]
        reasons = {index: bytes(file.bytes()).decode(errors="replace") for index, file in files}
    return State(name, done.size, int(done.sum()), len(failed), reasons, _rate(written[done]))


def _failed(place, name, done):
    """Yield the indices of the missing tiles of which the store has a reason."""
    for page in place.objects().list(f"{name}.zarr/.failed"):
        for file in page:
            with suppress(ValueError, IndexError):  # somebody else's file
                index = tuple(map(int, file["path"].rpartition("/")[2].split(".")))
                if not done[index]:
                    yield index


def _rate(times):
    """Commits per second in the last minutes before the last one."""
    recent = times[times >= times.max(initial=0) - RECENT]
    span = np.ptp(recent) if recent.size else 0
    return float((recent.size - 1) / span) if span > 0 else nan
