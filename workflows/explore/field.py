"""First escape times at the resolution of a view: what is known, and coarse to fine what is not.

A view is computed in blocks of 27, 9, 3 pixels and 1. Whether a block escapes is partly chance. Far
outside the boundary orbits escape quickly; a block that never escapes costs all N steps. So a block
without an escape is not cut further if none of its neighbours has one either. Single pixels are
computed along the boundary; elsewhere only the soonest escapes, as many as cost a second.
"""

from collections import deque
from dataclasses import dataclass
from time import monotonic

import numpy as np

from nasm import escape
from pipeline.cubes.escape import SECONDS_PER_KICK
from pipeline.sweep.refine import boundary_cells
from workflows.explore.work import spread

BLOCKS = (27, 9, 3, 1)  # pixels along each side
_CUT = 3
ORBITS = 64
_FIRST_STEPS = 1000  # of the first look, if N is more
_LEAST, _BATCH = 0.02, 0.1  # CPU seconds of a task
_SPARE = 1.0  # CPU seconds for single pixels that are not at the boundary
_EDGE = 1e-9  # of a block: rounding
_PATIENCE, _LONGEST = 0.3, 2.0  # seconds between two pictures, more and more


@dataclass(frozen=True)
class View:
    """A rectangle of a plane in pixels."""

    a: tuple[float, float]  # lo, hi of the first coordinate
    b: tuple[float, float]
    shape: tuple[int, int]  # rows, columns: multiples of 27

    def centres(self, block=1):
        """Return the coordinates a and b of the centres of blocks, two vectors."""
        sides = zip((self.a, self.b), self.shape[::-1], strict=True)
        return [lo + (np.arange(n // block) + 0.5) * block * (hi - lo) / n for (lo, hi), n in sides]

    @property
    def pixel(self):
        """Width and height of a pixel."""
        return np.array([np.ptp(self.a), np.ptp(self.b)]) / self.shape[::-1]


@dataclass(frozen=True, eq=False)
class Field:
    """First escape times that are known somewhere."""

    a: np.ndarray  # centres of cells, equally spaced
    b: np.ndarray
    times: object  # array or DataArray (b, a); inf: no escape within `steps`, NaN: not known
    steps: int
    cells: int = 1  # that one value fills, along each side
    stays: float = 1.1  # pixels of a view that a value may fill without being computed again
    apart: int = 1  # as `cells`, away from the boundary of {n* ≤ steps}

    def on(self, view, steps):
        """Return what it knows of {n* ≤ steps} in the view's pixels, NaN elsewhere; and how many
        pixels wide its cells are."""
        found = np.full(view.shape, np.nan)
        cells, cell = [], 0.0
        for axis, centres, width in zip((self.a, self.b), view.centres(), view.pixel, strict=True):
            step = (axis[-1] - axis[0]) / (axis.size - 1)
            index = np.rint((centres - axis[0]) / step)
            cells.append(np.where((index >= 0) & (index < axis.size), index, -1).astype(int))
            cell = max(cell, step / width)
        column, row = cells
        # The slices are read from disk only here.
        box = [slice(i[i >= 0].min(initial=0), i.max() + 1) for i in (row, column)]
        part = np.asarray(self.times[tuple(box)])
        inside = np.ix_(row >= 0, column >= 0)
        found[inside] = part[
            np.ix_(row[row >= 0] - box[0].start, column[column >= 0] - box[1].start)
        ]
        found[np.isinf(found) & (self.steps < steps)] = np.nan
        # Fewer steps have another boundary.
        return found, cell * max(self.cells, self.apart if steps < self.steps else 1)

    def at(self, a, b):
        """Return the time at a point, NaN outside."""
        cells = [
            round((value - axis[0]) / (axis[1] - axis[0]))
            for value, axis in ((b, self.b), (a, self.a))
        ]
        inside = all(0 <= i < n for i, n in zip(cells, self.times.shape, strict=True))
        return self.times[tuple(cells)] if inside else np.nan


def computed(client, plane, view, steps, fields):
    """Yield (times, block, words): the view's picture, better each time, and how far that is.

    client : function → dask Client. plane, view, steps, fields : as for `Quadtree`; times, block :
    as of its pictures. It also yields None, at least ten times a second.
    """
    tree = Quadtree(plane, view, steps, fields)
    if not np.isnan(tree.final).any():
        yield tree.final, 1, ""
        return
    if not np.isnan(tree.backdrop).all():
        yield *tree.picture(), "what is known"
    workers, shown, pause = client(), monotonic(), _PATIENCE
    for calls in tree.rounds():
        for ended in spread(workers, calls):
            if ended is not None:
                tree.accept(*ended)
            if monotonic() - shown < pause:
                yield None
                continue
            yield *tree.picture(), f"{tree.block} px, {tree.progress:.0%}"
            shown, pause = monotonic(), min(2 * pause, _LONGEST)
        if tree.block == BLOCKS[0]:
            yield *tree.picture(), f"{tree.block} px"
    yield *tree.picture(), ""


class Quadtree:
    """The escape times of a view, from blocks to pixels: what to compute next, and the picture.

    plane : of forcings. view : View. steps : int, N. fields : Fields that are known, best first.
    """

    def __init__(self, plane, view, steps, fields):
        self.plane, self.view, self.steps = plane, view, steps
        self.final, self.backdrop, self._coarse = _known(view, steps, fields)
        self.block = BLOCKS[0]
        self._times = np.full([n // self.block for n in view.shape], np.nan)
        self._begin(np.zeros(self._times.shape, bool), 0)

    def rounds(self):
        """Yield the calls of each round: a deque of (cells, function, forcings, steps).

        Whoever takes a call off gives its cells and its result to `accept`, until none is left;
        which round comes next, if any, depends on the results.
        """
        steps = self.steps
        for self.block in BLOCKS:
            block, (rows, columns) = self.block, (n // self.block for n in self.view.shape)
            known = (~np.isnan(self.final)).reshape(rows, block, columns, block).all(axis=(1, 3))
            if block < BLOCKS[0]:
                self._times = _cut(self._times, _CUT)
            middle = slice(block // 2, None, block)
            self._times[known] = self.final[middle, middle][known]
            if block == BLOCKS[0]:
                wanted = ~known
                if steps > _FIRST_STEPS:  # a first look, before what may take long
                    yield from self._round(wanted, _FIRST_STEPS)
                    wanted = wanted & ~(self._times <= steps)
            else:
                wanted, escapes = _at_boundary(self._times, steps), self._times <= steps
                wanted |= escapes if block > 1 else _soonest(escapes, self._seconds(self._times))
                known[_CUT // 2 :: _CUT, _CUT // 2 :: _CUT] = True  # was the whole block's centre
                wanted &= ~known
            self._known = known
            yield from self._round(wanted, steps)
            if block == BLOCKS[1]:  # a short look everywhere, for what is thinner than that
                yield from self._round(~known & ~wanted, min(steps, _FIRST_STEPS))

    def accept(self, cells, times):
        """Take the escape times of the cells of a call; of pixels this may ask for neighbours."""
        self._found[cells], self._fresh[cells] = times, True
        if self.block > 1 or self._calls:
            return
        rows, columns = np.nonzero(self._fresh[self._images])
        self._fresh[:] = False
        near = _beside(rows, columns, self._images.shape)
        now = self._found[self._images[rows, columns]] <= self.steps
        differ = (self._times[near] <= self.steps) != now
        more = np.zeros_like(self._wanted)
        more[near[0][differ], near[1][differ]] = True
        more &= ~(self._known | self._wanted)
        self._wanted |= more
        self._ask(more)

    def picture(self):
        """Return the times of the view, and how many pixels along each side one may fill.

        Times have the view's shape; inf for no escape within N, NaN for not known yet.
        """
        now = self._found[self._images[self._wanted]]
        self._times[self._wanted] = np.where(np.isnan(now), self._times[self._wanted], now)
        pixels = _cut(self._times, self.block)
        coarser = np.isnan(pixels) | (self._coarse < self.block)
        pixels = np.where(coarser, self.backdrop, pixels)
        return np.where(np.isnan(self.final), pixels, self.final), self.block

    @property
    def progress(self):
        """The part of the cells of this round that is known."""
        return 1 - np.isnan(self._found[self._asked]).mean()

    def _round(self, wanted, steps):
        self._begin(wanted, steps)
        self._ask(wanted)
        yield self._calls
        self.picture()

    def _begin(self, wanted, steps):
        self._wanted, self._limit, self._calls = wanted, steps, deque()
        self._images = _images(self.plane, self.view, self.block)
        self._found = np.full(self._images.size, np.nan)
        self._asked, self._fresh = np.zeros((2, self._images.size), bool)

    def _ask(self, pixels):
        cells = np.unique(self._images[pixels])
        cells = cells[~self._asked[cells]]
        if not cells.size:
            return
        self._asked[cells] = True
        likely = self._times.ravel()[cells]
        likely = np.where(likely <= self._limit, likely, self._limit)  # also if not known
        seconds = np.cumsum(self._seconds(likely))
        batch = np.floor(seconds / np.clip(seconds[-1] / 4, _LEAST, _BATCH)).astype(int)
        a, b = self.view.centres(self.block)
        for part in np.split(cells, np.flatnonzero(np.diff(batch)) + 1):
            rows, columns = np.divmod(part, self._images.shape[1])
            forcings = self.plane.forcing(a[columns], b[rows])
            self._calls.append((part, _escapes, forcings, self._limit))

    def _seconds(self, times):
        """Return the CPU seconds in which the ensemble takes so many steps."""
        return times * (SECONDS_PER_KICK["single"] * ORBITS * len(self.plane.origin))


def _soonest(escapes, seconds):
    """Mark of the cells that escape the soonest ones, as many as cost `_SPARE` together."""
    ordered = np.sort(seconds[escapes])
    most = np.searchsorted(np.cumsum(ordered), _SPARE)
    return escapes & (seconds < ordered[most]) if most < ordered.size else escapes


def _beside(rows, columns, shape):
    """Return rows and columns of n cells of a field and of their neighbours, arrays (3, 3, n)."""
    side = np.array([-1, 0, 1])
    near = np.broadcast_arrays(rows + side[:, None, None], columns + side[:, None])
    return tuple(np.clip(i, 0, n - 1) for i, n in zip(near, shape, strict=True))


def _cut(times, n):
    """Return the field with every cell cut into n × n of its value."""
    return times.repeat(n, axis=0).repeat(n, axis=1)


def _images(plane, view, block):
    """Return for each block the index of the one that is computed for it.

    Forcings related by a symmetry have the same transport, so only the image with the smallest
    angle is computed, if it lies in the view.
    """
    a, b = np.meshgrid(*view.centres(block))
    itself = np.arange(a.size).reshape(a.shape)
    turned = np.deg2rad(plane.fold(np.rad2deg(np.arctan2(b, a)))[0])
    radius, (width, height) = np.hypot(a, b), view.pixel * block
    columns = np.floor((radius * np.cos(turned) - view.a[0]) / width + _EDGE).astype(int)
    rows = np.floor((radius * np.sin(turned) - view.b[0]) / height + _EDGE).astype(int)
    inside = (columns >= 0) & (columns < a.shape[1]) & (rows >= 0) & (rows < a.shape[0])
    return np.where(inside, rows * a.shape[1] + columns, itself)


def _known(view, steps, fields):
    """Return the times that can stay, those that are too coarse to, and how coarse these are."""
    final, backdrop, coarse = np.full(view.shape, np.nan), np.full(view.shape, np.nan), np.inf
    for field in fields:
        times, cell = field.on(view, steps)
        if cell <= field.stays:
            final = np.where(np.isnan(final), times, final)
        elif coarse == np.inf and not np.isnan(times).all():
            coarse = cell
        backdrop = np.where(np.isnan(backdrop), times, backdrop)
    return final, backdrop, coarse


def _at_boundary(times, steps):
    return boundary_cells((times <= steps)[None])


def _escapes(kappas, steps):
    """On a worker: the first escape times of many forcings."""
    starts, how = escape.ensemble(ORBITS), {"precision": precision_of(steps)}
    return escape.first_escape(kappas, *starts, [ORBITS], steps, **how)[0]


def precision_of(steps):
    """Return the precision of a field's arithmetic: single as far as that may be used."""
    return "single" if steps <= escape.MAX_SINGLE_STEPS else "double"
