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
    """A rectangle of a plane in pixels.

    a, b : (lo, hi) of the two coordinates. shape : (rows, columns), multiples of 27.
    """

    a: tuple[float, float]
    b: tuple[float, float]
    shape: tuple[int, int]

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
    """First escape times that are known somewhere.

    a, b : centres of cells, equally spaced. times : array or xarray.DataArray (b, a), inf for none
    within `steps`, NaN for not known. cells : of these that one value fills, along each side.
    stays : pixels of a view that a value may fill without being computed again. apart : as `cells`,
    away from the boundary of {n* ≤ steps}.
    """

    a: np.ndarray
    b: np.ndarray
    times: object
    steps: int
    cells: int = 1
    stays: float = 1.1
    apart: int = 1

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

    client : function → dask Client. plane : of forcings. view : View. steps : int, N.
    fields : Fields that are known, best first.

    Times have the view's shape; inf for no escape within N, NaN for not known yet; one value may
    fill `block` pixels along each side. It also yields None, at least ten times a second.
    """
    final, backdrop, cell = _known(view, steps, fields)
    times = np.full([n // BLOCKS[0] for n in view.shape], np.nan)

    def picture(words, block):
        pixels = _cut(times, block)
        pixels = np.where(np.isnan(pixels) | (cell < block), backdrop, pixels)
        return np.where(np.isnan(final), pixels, final), block, words

    if not np.isnan(final).any():
        yield final, 1, ""
        return
    if not np.isnan(backdrop).all():
        yield picture("what is known", BLOCKS[0])
    workers, told, pause = client(), monotonic(), _PATIENCE

    def fill(wanted, block, steps):
        """Compute the blocks that are wanted, of pixels also those beside one with another answer;
        and yield pictures."""
        images = _images(plane, view, block)
        found, calls = np.full(images.size, np.nan), deque()
        asked, fresh = np.zeros((2, images.size), bool)

        def ask(pixels):
            cells = np.unique(images[pixels])
            cells = cells[~asked[cells]]
            if not cells.size:
                return
            asked[cells] = True
            likely = times.ravel()[cells]
            likely = np.where(likely <= steps, likely, steps)  # also if not known
            seconds = np.cumsum(_seconds(likely, plane))
            batch = np.floor(seconds / np.clip(seconds[-1] / 4, _LEAST, _BATCH)).astype(int)
            a, b = view.centres(block)
            for part in np.split(cells, np.flatnonzero(np.diff(batch)) + 1):
                rows, columns = np.divmod(part, images.shape[1])
                calls.append((part, _escapes, plane.forcing(a[columns], b[rows]), steps))

        def take():
            now = found[images[wanted]]
            times[wanted] = np.where(np.isnan(now), times[wanted], now)

        nonlocal told, pause
        ask(wanted)
        for ended in spread(workers, calls):
            if ended is not None:
                cells, found[ended[0]] = ended
                fresh[cells] = True
            if block == 1 and not calls:
                rows, columns = np.nonzero(fresh[images])
                fresh[:] = False
                near = _beside(rows, columns, images.shape)
                differ = (times[near] <= steps) != (found[images[rows, columns]] <= steps)
                more = np.zeros_like(wanted)
                more[near[0][differ], near[1][differ]] = True
                more &= ~(known | wanted)
                wanted |= more
                ask(more)
            if monotonic() - told < pause:
                yield None
                continue
            take()
            yield picture(f"{block} px, {1 - np.isnan(found[asked]).mean():.0%}", block)
            told, pause = monotonic(), min(2 * pause, _LONGEST)
        take()
        if block == BLOCKS[0]:
            yield picture(f"{block} px", block)

    for block in BLOCKS:
        rows, columns = (n // block for n in view.shape)
        known = (~np.isnan(final)).reshape(rows, block, columns, block).all(axis=(1, 3))
        if block < BLOCKS[0]:
            times = _cut(times, _CUT)
        times[known] = final[block // 2 :: block, block // 2 :: block][known]
        if block == BLOCKS[0]:
            wanted = ~known
            if steps > _FIRST_STEPS:  # a first look, before what may take long
                yield from fill(wanted, block, _FIRST_STEPS)
                wanted = wanted & ~(times <= steps)
        else:
            wanted = _at_boundary(times, steps)
            escapes = times <= steps
            wanted |= escapes if block > 1 else _soonest(escapes, _seconds(times, plane))
            known[_CUT // 2 :: _CUT, _CUT // 2 :: _CUT] = True  # a centre was the whole block's
            wanted &= ~known
        yield from fill(wanted, block, steps)
        if block == BLOCKS[1]:  # a short look everywhere, for what is thinner than the first blocks
            yield from fill(~known & ~wanted, block, min(steps, _FIRST_STEPS))
    yield picture("", block)


def _seconds(times, plane):
    """Return the CPU seconds in which the ensemble takes so many steps."""
    return times * (SECONDS_PER_KICK * ORBITS * len(plane.origin))


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
    return escape.first_escape(kappas, *escape.ensemble(ORBITS), [ORBITS], steps)[0]
