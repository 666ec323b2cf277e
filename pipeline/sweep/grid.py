"""Planes of cells, and tiles that cover them exactly once.

A tile is the unit of work, of storage and of record: one task, a file for every variable, and one
for its record. An axis LO:HI:N is N cells of equal width; a cell is represented by its centre.
Halving the cells of an axis keeps its edges, so that levels of refinement nest.
"""

from dataclasses import dataclass, replace
from math import inf, prod

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from nasm.texts import parse_float, parse_integer, short_repr

MAX_CELLS = 2**20
_ENOUGH = 4096  # tiles: with fewer, a thousand workers would not end together
_LONG = 3  # predicted CPU seconds of a tile
_SAMPLE = 32  # tiles whose costs are predicted


@dataclass(frozen=True)
class Axis:
    """[lo, hi] cut into n cells."""

    lo: float
    hi: float
    n: int

    def __post_init__(self):
        if not -inf < self.lo < self.hi < inf:
            words = "the ends must be finite and the lower one first, e.g. 0:1:128"
            raise ValueError(f"axis {self}: {words}")
        if not 1 <= self.n <= MAX_CELLS:
            raise ValueError(f"axis {self}: the number of cells must be from 1 to {MAX_CELLS}")

    def __str__(self):
        return f"{self.lo:g}:{self.hi:g}:{self.n}"

    @property
    def centres(self):
        """ndarray of the n cell centres."""
        return self.lo + (np.arange(self.n) + 0.5) * ((self.hi - self.lo) / self.n)

    @property
    def bounds(self):
        """ndarray (n, 2) of the ends of each cell."""
        return sliding_window_view(np.linspace(self.lo, self.hi, self.n + 1), 2)

    def coarsened(self, factor):
        """Return the same interval in n/factor cells; n must be a multiple of factor."""
        if self.n % factor:
            words = f"{self.n} cells cannot be halved to that level; use a multiple of {factor}"
            raise ValueError(f"axis {self}: {words}")
        return Axis(self.lo, self.hi, self.n // factor)


def parse_axis(text):
    """Parse an Axis from "LO:HI:N"; ValueError with an example otherwise."""
    try:
        lo, hi, n = text.split(":")
        lo, hi, n = parse_float(lo), parse_float(hi), parse_integer(n, 0, inf)
    except ValueError:
        words = "write LO:HI:N, two numbers and a number of cells, e.g. -1:1:256"
        raise ValueError(f"{short_repr(text)} is not an axis; {words}") from None
    return Axis(lo, hi, n)


def tile_slices(index, tile):
    """Return {dim: slice} of the cells of one tile; there may be fewer cells in the last ones."""
    parts = zip(index, tile.items(), strict=True)
    return {dim: slice(i * n, (i + 1) * n) for i, (dim, n) in parts}


def tile_coords(cube, indices):
    """Yield (index, {name: values}) of tiles: what the cube's coordinates are in each of them.

    indices : int array (tiles, tiled dims).
    """
    coords, computed = cube.template.coords, {*cube.computed}
    known = {name: (c.values, c.dims) for name, c in coords.items() if name not in computed}
    for index in map(tuple, indices.tolist()):
        cells, parts = tile_slices(index, cube.tile), {}
        for name, (values, dims) in known.items():
            part = tuple(cells.get(dim, slice(None)) for dim in dims)
            # What is whole is one object for all tiles: pickle then writes it once.
            parts[name] = values[part] if cells.keys() & dims else values
        yield index, parts


def joined(job):
    """Return the job with tiles doubled along all dims, as often as 4096 are left or more.

    None of a sample may be predicted to take more than 3 s. The choice depends on nothing but the
    job, so that the command that began a cube resumes it.
    """
    while True:
        sizes, tile = job.cube.template.sizes, job.cube.tile
        doubled = {dim: min(2 * n, sizes[dim]) for dim, n in tile.items()}
        larger = replace(job, cube=replace(job.cube, tile=doubled))
        counts = larger.cube.tile_counts
        if prod(counts) < _ENOUGH:
            return job
        sample = np.random.default_rng(0).integers(0, counts, (_SAMPLE, len(counts)))
        coords = (of_tile for _, of_tile in tile_coords(larger.cube, sample))
        if not max(job.predict(one, job.cube.settings) for one in coords) <= _LONG:
            return job
        job = larger
