"""First escape times at the resolution of a view: what is known, and coarse to fine what is not.

A view is cut into pixels, computed in blocks of 16, 8, 4, 2 and 1. Escape is quick and a matter of
chance in each pixel; no escape costs all N steps. So blocks without an escape, all of whose
neighbours are without one, are not cut further.
"""

from dataclasses import dataclass
from time import monotonic

import numpy as np

from nasm import escape
from pipeline.cubes.escape import SECONDS_PER_KICK
from pipeline.sweep.refine import boundary_cells, halved
from workflows.explorer.work import spread

BLOCKS = (16, 8, 4, 2, 1)  # pixels along each side
ORBITS = 64
_FIRST_STEPS = 1000  # of the first look, if N is more
_BATCH = 0.06  # CPU seconds of a task
_PATIENCE = 0.3  # seconds between two pictures of one size of blocks


@dataclass(frozen=True)
class View:
    """A rectangle of a plane in pixels.

    a, b : (lo, hi) of the two coordinates. shape : (rows, columns), multiples of 16.
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


@dataclass(frozen=True)
class Field:
    """First escape times that are known somewhere.

    a, b : centres of cells, equally spaced. times : array or xarray.DataArray (b, a), inf for none
    within `steps`, NaN for not known. cells : of these that one value fills, along each side.
    stays : pixels of a view that a value may fill without being computed again.
    """

    a: np.ndarray
    b: np.ndarray
    times: object
    steps: int
    cells: int = 1
    stays: float = 1.1

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
        return found, cell * self.cells

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
        pixels = times.repeat(block, axis=0).repeat(block, axis=1)
        pixels = np.where(np.isnan(pixels) | (cell < block), backdrop, pixels)
        return np.where(np.isnan(final), pixels, final), block, words

    if not np.isnan(final).any():
        yield final, 1, ""
        return
    if not np.isnan(backdrop).all():
        yield picture("what is known", BLOCKS[0])

    def fill(wanted, steps):
        """Compute the blocks that are wanted, and yield pictures."""
        rows, columns = np.nonzero(wanted)
        likely = np.where(np.isfinite(times[wanted]), times[wanted], steps)
        seconds = np.cumsum(likely) * SECONDS_PER_KICK * ORBITS * len(plane.origin)
        if not rows.size:
            return
        batch = np.floor(seconds / min(_BATCH, seconds[-1] / 4)).astype(int)
        parts = np.split(np.arange(rows.size), np.flatnonzero(np.diff(batch)) + 1)
        a, b = view.centres(block)
        kappas = plane.forcing(a[columns], b[rows])
        calls = ((part.tobytes(), _escapes, kappas[part], steps) for part in parts)
        count, told = 0, monotonic()
        for ended in spread(workers, calls):
            if ended is not None:
                part = np.frombuffer(ended[0], np.int64)
                times[rows[part], columns[part]] = ended[1]
                count += part.size
            if monotonic() - told < _PATIENCE or ended is None:
                yield None
            else:
                yield picture(f"{block} px, {count / rows.size:.0%}", block)
                told = monotonic()
        yield picture(f"{block} px", block)

    workers = client()
    for block in BLOCKS:
        n = view.shape[0] // block, block, view.shape[1] // block, block
        known = (~np.isnan(final)).reshape(n).all(axis=(1, 3))
        if block == BLOCKS[0]:
            wanted = ~known
            if steps > _FIRST_STEPS:  # a first look, before what may take long
                yield from fill(wanted, _FIRST_STEPS)
                wanted = ~(times <= steps) & ~known
        else:
            times = halved(times)
            wanted = ((times <= steps) | _at_boundary(times, steps)) & ~known
        times[known] = final[block // 2 :: block, block // 2 :: block][known]
        done = known | wanted
        yield from fill(wanted, steps)
    # The finest blocks may show that the boundary runs on: follow it.
    while (wanted := _at_boundary(times, steps) & ~done).any():
        done |= wanted
        yield from fill(wanted, steps)
    yield picture("", 1)


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
