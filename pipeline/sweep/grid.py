"""Planes of cells, and tiles that cover them exactly once.

A tile is the unit of work and of storage: it is computed by one task, and stored in one file for
each variable and one for the commit record. An axis LO:HI:N consists of N cells of equal width,
each represented by its centre. Cutting each cell of an axis in half preserves its edges, so
levels of refinement nest.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf, prod
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from nasm.texts import MAX_DIGITS, parse_float, parse_integer, short_repr
from nasm.types import FloatArray, IntArray

if TYPE_CHECKING:
    from pipeline.cubes.cube import Coords, Cube, Job

MAX_CELLS = 2**20
"""Maximum number of cells along an axis."""

_MIN_TILES = 4096  # with fewer tiles, many of a thousand workers would be idle at the end
_MAX_TILE_SECONDS = 3  # maximum predicted CPU time for a tile made of smaller ones
_N_SAMPLED = 32  # number of tiles whose costs are predicted


@dataclass(frozen=True)
class Axis:
    """An interval cut into cells of equal width.

    Attributes
    ----------
    lo, hi : float
        Ends of the interval, lo < hi.
    n : int
        Number of cells, 1 to 2²⁰.

    Raises
    ------
    ValueError
        If the ends are not finite and in order, or n is out of range.

    Examples
    --------
    >>> from pipeline.sweep.grid import Axis
    >>> axis = Axis(0, 1, 4)
    >>> print(axis, axis.centres)
    0:1:4 [0.125 0.375 0.625 0.875]
    """

    lo: float
    hi: float
    n: int

    def __post_init__(self) -> None:
        if not -inf < self.lo < self.hi < inf:
            reason = "the ends must be finite and the lower one first, e.g. 0:1:128"
            raise ValueError(f"axis {self}: {reason}")
        if not 1 <= self.n <= MAX_CELLS:
            raise ValueError(f"axis {self}: the number of cells must be from 1 to {MAX_CELLS}")

    def __str__(self) -> str:
        return f"{self.lo:g}:{self.hi:g}:{self.n}"

    @property
    def centres(self) -> FloatArray:
        """The centres of the cells, shape (n,)."""
        return self.lo + (np.arange(self.n, dtype=float) + 0.5) * ((self.hi - self.lo) / self.n)

    @property
    def bounds(self) -> FloatArray:
        """The ends of each cell, shape (n, 2)."""
        edges: FloatArray = np.linspace(self.lo, self.hi, self.n + 1)
        return sliding_window_view(edges, 2)

    def coarsened(self, factor: int) -> "Axis":
        """Return the same interval cut into n/factor cells; ValueError unless factor divides n."""
        if self.n % factor:
            reason = f"{self.n} cells cannot be halved that many times; use a multiple of {factor}"
            raise ValueError(f"axis {self}: {reason}")
        return Axis(self.lo, self.hi, self.n // factor)


def parse_axis(text: str) -> Axis:
    """Parse an Axis from "LO:HI:N"; raise a ValueError with an example for any other string.

    Examples
    --------
    >>> from pipeline.sweep.grid import parse_axis
    >>> parse_axis("-1:1:256")
    Axis(lo=-1.0, hi=1.0, n=256)
    """
    try:
        lo_text, hi_text, n_text = text.split(":")
        lo, hi, n = (
            parse_float(lo_text),
            parse_float(hi_text),
            parse_integer(n_text, 0, 10**MAX_DIGITS),
        )
    except ValueError:
        cure = "write LO:HI:N, two numbers and a number of cells, e.g. -1:1:256"
        raise ValueError(f"{short_repr(text)} is not an axis; {cure}") from None
    return Axis(lo, hi, n)


def tile_slices(index: Iterable[int], tile: Mapping[str, int]) -> dict[str, slice]:
    """Return the cells of one tile along each dimension; the last tiles may have fewer cells.

    Parameters
    ----------
    index : iterable of int
        Index of the tile along each of its dims.
    tile : mapping of str to int
        Number of cells of a tile along each dim.

    Examples
    --------
    >>> from pipeline.sweep.grid import tile_slices
    >>> tile_slices((0, 2), {"angle": 1, "excess": 4})
    {'angle': slice(0, 1, None), 'excess': slice(8, 12, None)}
    """
    places = zip(index, tile.items(), strict=True)
    return {dim: slice(i * n, (i + 1) * n) for i, (dim, n) in places}


def tile_coords(cube: "Cube", indices: IntArray) -> Iterator[tuple[tuple[int, ...], "Coords"]]:
    """Yield the index of each tile, and the values of the cube's coordinates in it.

    Parameters
    ----------
    cube : Cube
        The plan.
    indices : ndarray of int, shape (tiles, tiled dims)
        Indices of the tiles, one tile in each row.
    """
    coords, computed = cube.template.coords, {*cube.computed}
    known = {str(name): (c.values, c.dims) for name, c in coords.items() if name not in computed}
    for index in map(tuple, indices.tolist()):
        cells, parts = tile_slices(index, cube.tile), {}
        for name, (values, dims) in known.items():
            part = tuple(cells.get(str(dim), slice(None)) for dim in dims)
            # All tiles share an array without tiled dims, so that pickle writes it only once.
            parts[name] = values[part] if cells.keys() & {*dims} else values
        yield index, parts


def join_tiles(job: "Job") -> "Job":
    """Repeatedly double the size of a job's tiles along all dims while at least 4096 tiles remain.

    Doubling ends before any tile of a sample would take more than 3 s of predicted CPU time. The
    result depends on the job alone, so the command that started a cube can also resume it.
    """
    while True:
        sizes, tile = job.cube.template.sizes, job.cube.tile
        doubled = {dim: min(2 * n, sizes[dim]) for dim, n in tile.items()}
        larger = replace(job, cube=replace(job.cube, tile=doubled))
        counts = larger.cube.tile_counts
        if prod(counts) < _MIN_TILES:
            return job
        sample = np.random.default_rng(0).integers(0, counts, (_N_SAMPLED, len(counts)))
        coords = (of_tile for _, of_tile in tile_coords(larger.cube, sample))
        longest = max(job.predict(one, job.cube.settings) for one in coords)
        if not longest <= _MAX_TILE_SECONDS:
            return job
        job = larger
