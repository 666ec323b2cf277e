"""First escape times at the resolution of a view; unknown ones are computed from coarse to fine.

A view is computed in blocks that are 27, 9, 3 and finally 1 pixel wide. A block in which orbits
escape is subdivided. A block without an escape costs all N steps, so it is subdivided only if a
neighbour has an escape: near the boundary, whether an orbit escapes is partly a matter of chance.
Single pixels are computed along the boundary; elsewhere, only the pixels with the earliest escapes
are computed, up to 0.3 s of CPU time.
"""

from dataclasses import dataclass
from time import monotonic

import numpy as np

from nasm import escape
from pipeline.sweep.refine import boundary_cells
from workflows.explore.work import spread

BLOCKS = (27, 9, 3, 1)  # pixels along each side
_CUT = 3  # number of parts into which each side of a block is divided
ORBITS = 64
_FIRST_STEPS = 1000  # steps of the first pass, if N is larger
_MIN_BATCH, _MAX_BATCH = 0.02, 0.1  # CPU seconds of a task
_SPARE = 0.3  # CPU seconds for single pixels that are not at the boundary
_ROUNDING = 1e-9  # rounding error allowed for, relative to the size of a block
_FIRST_PAUSE, _MAX_PAUSE = 0.3, 2.0  # seconds between pictures; the pause doubles each time


@dataclass(frozen=True)
class View:
    """A rectangle of a plane in pixels."""

    a: tuple[float, float]  # low and high ends of the first coordinate
    b: tuple[float, float]
    shape: tuple[int, int]  # rows, columns: multiples of 27

    def centres(self, block=1):
        """Return the coordinates a and b of the centres of blocks, as two vectors."""
        sides = zip((self.a, self.b), self.shape[::-1], strict=True)
        return [lo + (np.arange(n // block) + 0.5) * block * (hi - lo) / n for (lo, hi), n in sides]

    @property
    def pixel(self):
        return np.array([np.ptp(self.a), np.ptp(self.b)]) / self.shape[::-1]


@dataclass(frozen=True, eq=False)
class Field:
    """Known first escape times on a grid."""

    a: np.ndarray  # centres of cells, equally spaced
    b: np.ndarray
    times: np.ndarray  # (b, a); inf: no escape within `steps`, NaN: not known
    steps: int
    cells: int = 1  # cells that share a value, along each side
    stays: float = 1.1  # cells up to this size, in pixels of a view, are not recomputed
    apart: int = 1  # like `cells`, but away from the boundary between escape and no escape

    def on(self, view, steps):
        """Return known times up to `steps` at the pixels of a view, and the cell size in pixels.

        Times are NaN where they are not known.
        """
        column, row = map(_cells, (self.a, self.b), view.centres())
        part = self.times[: row.max() + 1, : column.max() + 1]
        times = np.pad(part, (0, 1), constant_values=np.nan)[np.ix_(row, column)]
        times[np.isinf(times) & (self.steps < steps)] = np.nan
        cell = max((self.a[1] - self.a[0], self.b[1] - self.b[0]) / view.pixel)
        # With fewer steps the boundary is elsewhere, possibly where cells share a value.
        return times, cell * max(self.cells, self.apart if steps < self.steps else 1)

    def at(self, a, b):
        """Return the time at a point; NaN if the point is outside the grid."""
        cell = _cells(self.b, b), _cells(self.a, a)
        return self.times[cell] if min(cell) >= 0 else np.nan


def _cells(axis, values):
    """Return the indices of the cells, given by their centres, that contain values; -1 outside."""
    index = np.rint((values - axis[0]) / np.ptp(axis) * (axis.size - 1))
    return np.where((index >= 0) & (index < axis.size), index, -1).astype(int)


def computed(client, plane, view, steps, fields):
    """Yield (times, block, progress): pictures of the view, from coarse to fine.

    client : function → dask Client. plane, view, steps, fields : as for `Quadtree`; times, block :
    as returned by `Quadtree.picture`; progress : text. The generator also yields None, at least ten
    times a second.
    """
    tree = Quadtree(plane, view, steps, fields)
    if not np.isnan(tree.final).any():
        yield tree.final, 1, ""
        return
    if not np.isnan(tree.backdrop).all():
        yield *tree.picture(), "known times"
    workers, shown, pause = client(), monotonic(), _FIRST_PAUSE
    for calls in tree.rounds():
        for ended in spread(workers, calls) if calls else ():
            if ended is not None:
                tree.accept(*ended)
            if monotonic() - shown < pause:
                yield None
                continue
            yield *tree.picture(), f"{tree.block} px, {tree.progress:.0%}"
            shown, pause = monotonic(), min(2 * pause, _MAX_PAUSE)
        if tree.block == BLOCKS[0]:
            yield *tree.picture(), f"{tree.block} px"
    yield *tree.picture(), ""


class Quadtree:
    """The escape times of a view, refined from blocks to single pixels.

    A Quadtree determines what is computed next, and returns the picture.

    plane : the plane of forcings. view : View. steps : int, N. fields : known Fields, best first.
    """

    def __init__(self, plane, view, steps, fields):
        self.plane, self.view, self.steps = plane, view, steps
        # `final` contains the known times that are fine enough; `backdrop` also contains coarser
        # ones, which are shown meanwhile; `_coarse` is the cell size of the best coarser field.
        self.final, self.backdrop = np.full((2, *view.shape), np.nan)
        self._coarse = np.inf
        for field in fields:
            times, cell = field.on(view, steps)
            if cell <= field.stays:
                self.final = np.where(np.isnan(self.final), times, self.final)
            elif self._coarse == np.inf and not np.isnan(times).all():
                self._coarse = cell
            self.backdrop = np.where(np.isnan(self.backdrop), times, self.backdrop)
        self.block, self._images = BLOCKS[0], None
        self._times = np.full([n // self.block for n in view.shape], np.nan)
        self._selected = np.zeros(self._times.shape, bool)

    def rounds(self):
        """Yield the calls of each round: a list of (cells, function, forcings, steps).

        The caller passes the cells and the result of each call to `accept`. The next round depends
        on the results.
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
                if steps > _FIRST_STEPS:  # a fast pass before the slow one
                    yield from self._round(wanted, _FIRST_STEPS)
                    wanted = wanted & ~(self._times <= steps)
            else:
                wanted, escapes = _at_boundary(self._times, steps), self._times <= steps
                wanted |= escapes if block > 1 else _soonest(escapes, self._seconds(self._times))
                known[_CUT // 2 :: _CUT, _CUT // 2 :: _CUT] = True  # centre of the coarser block
                wanted &= ~known
            yield from self._round(wanted, steps)
            if block == BLOCKS[1]:  # a fast pass for thin structures
                yield from self._round(~known & ~wanted, min(steps, _FIRST_STEPS))
        done = known | wanted
        while (
            wanted := _at_boundary(self._times, steps) & ~done
        ).any():  # new pixels move the boundary
            done |= wanted
            yield from self._round(wanted, steps)

    def accept(self, cells, times):
        """Store the escape times of the cells of a call."""
        self._results[cells] = times

    def picture(self):
        """Return the times in the view, and the largest size, in pixels, of a block of equal times.

        Times have the shape of the view; they are inf if no orbit escapes within N steps, NaN if
        not known.
        """
        if self._selected.any():
            now = self._results[self._images[self._selected]]
            self._times[self._selected] = np.where(np.isnan(now), self._times[self._selected], now)
        pixels = _cut(self._times, self.block)
        coarser = np.isnan(pixels) | (self._coarse < self.block)
        pixels = np.where(coarser, self.backdrop, pixels)
        return np.where(np.isnan(self.final), pixels, self.final), self.block

    @property
    def progress(self):
        """Fraction of the cells of this round that are known."""
        return 1 - np.isnan(self._results[self._computed]).mean()

    def _round(self, wanted, steps):
        if self._selected.shape != wanted.shape or self._images is None:
            self._images = _images(self.plane, self.view, self.block)
        self._selected = wanted
        self._computed = cells = np.unique(self._images[wanted])
        self._results, calls = np.full(self._images.size, np.nan), []
        likely = self._times.ravel()[cells]
        seconds = np.cumsum(self._seconds(np.where(likely <= steps, likely, steps)))  # NaN → steps
        batch = seconds // np.clip(seconds[-1:] / 4, _MIN_BATCH, _MAX_BATCH)
        a, b = self.view.centres(self.block)
        for part in np.split(cells, np.flatnonzero(np.diff(batch)) + 1) if cells.size else ():
            rows, columns = np.divmod(part, self._images.shape[1])
            calls.append((part, _escapes, self.plane.forcing(a[columns], b[rows]), steps))
        yield calls
        self.picture()

    def _seconds(self, times):
        from pipeline.cubes.escape import SECONDS_PER_KICK

        return times * (SECONDS_PER_KICK["single"] * ORBITS * len(self.plane.origin))


def _soonest(escapes, seconds):
    """Select the cells with the earliest escapes, up to a total cost of `_SPARE`."""
    ordered = np.sort(seconds[escapes])
    most = np.searchsorted(np.cumsum(ordered), _SPARE)
    return escapes & (seconds < ordered[most]) if most < ordered.size else escapes


def _cut(times, n):
    """Divide every cell into n × n cells with the same value."""
    return times.repeat(n, axis=0).repeat(n, axis=1)


def _images(plane, view, block):
    """Return for each block the index of the block that is computed in its place.

    Forcings related by a symmetry have the same transport, so only the image with the smallest
    angle is computed, if it lies in the view.
    """
    a, b = np.meshgrid(*view.centres(block))
    itself = np.arange(a.size).reshape(a.shape)
    turned = np.deg2rad(plane.fold(np.rad2deg(np.arctan2(b, a)))[0])
    radius, (width, height) = np.hypot(a, b), view.pixel * block
    columns = np.floor((radius * np.cos(turned) - view.a[0]) / width + _ROUNDING).astype(int)
    rows = np.floor((radius * np.sin(turned) - view.b[0]) / height + _ROUNDING).astype(int)
    inside = (columns >= 0) & (columns < a.shape[1]) & (rows >= 0) & (rows < a.shape[0])
    return np.where(inside, rows * a.shape[1] + columns, itself)


def _at_boundary(times, steps):
    return boundary_cells((times <= steps)[None])


def _escapes(kappas, steps):
    """Compute the first escape times for many forcings, on a worker."""
    starts, options = escape.ensemble(ORBITS), {"precision": precision_of(steps)}
    return escape.first_escape(kappas, *starts, [ORBITS], steps, **options)[0]


def precision_of(steps):
    """Return the precision for fields: single up to the number of steps for which it is allowed."""
    return "single" if steps <= escape.MAX_SINGLE_STEPS else "double"
