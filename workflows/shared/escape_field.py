"""The field of first escape times over a plane, refined along its boundaries."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from math import ceil, prod

import numpy as np
import xarray as xr

from nasm.escape import MAX_SINGLE_STEPS, boundary
from nasm.maps import forcing
from nasm.planes import Plane
from nasm.symmetries import ray
from nasm.types import FloatArray
from pipeline.cubes import escape
from pipeline.cubes.cube import Cube, Job
from pipeline.sweep import refine
from pipeline.sweep.grid import Axis, join_tiles, tile_slices
from workflows.shared.run import Run

_PREVIEW_SIZE = 4000  # limit on cells and on steps of the preview that predicts the refinement

Wanted = set[tuple[int, ...]] | None
"""Indices of the wanted tiles; None if all tiles are wanted."""


@dataclass(frozen=True)
class Grid:
    """Settings for the field.

    Attributes
    ----------
    plane : Plane
        The plane of forcings.
    axes : tuple of two Axis
        The finest grid, along the plane's two axes.
    n_max : int
        Maximum number of steps (periods of the forcing) for which orbits are followed.
    n_orbits : list of int
        Increasing sizes of the nested ensembles.
    tile : int
        Minimum number of cells along each side of a tile; see `grid.join_tiles`.
    levels : int
        Number of levels; the cells of each level are half as wide as those of the level before.
    follow : list of int
        Increasing step numbers N whose boundaries {n* ≤ N} are refined.
    precision : str
        Floating-point precision, as for `escape.first_escape`.
    """

    plane: Plane
    axes: tuple[Axis, Axis]
    n_max: int
    n_orbits: list[int]
    tile: int
    levels: int
    follow: list[int]
    precision: str

    @property
    def drawn(self) -> list[int]:
        """The values of N whose boundaries are resolved everywhere and can be drawn.

        Without refinement these are n_max/10, n_max/2 and n_max, as in Fig. 5.
        """
        if self.levels > 1:
            return self.follow
        return sorted({max(1, self.n_max // 10), max(1, self.n_max // 2), self.n_max})


def grid_of(
    plane: Plane,
    first: Axis,
    second: Axis,
    n_max: int,
    n_orbits: list[int],
    tile: int,
    levels: int,
    follow: list[int] | None,
    precision: str,
) -> Grid:
    """Return the Grid for `cli.plane_options`; raise ValueError if options are inconsistent."""
    follow = follow or [n_max]
    for axis in first, second:
        axis.coarsened(2 ** (levels - 1))
    for a, b in product((first.lo, first.hi), (second.lo, second.hi)):
        forcing(plane.forcing(a, b))
    if follow[-1] > n_max:
        raise ValueError(f"--follow {follow[-1]} must be at most n-max={n_max}")
    if precision == "single" and n_max > MAX_SINGLE_STEPS:
        raise ValueError(
            f"--n-max {n_max} needs --precision double: above {MAX_SINGLE_STEPS} steps the "
            "rounding of single precision carries orbits across circles"
        )
    return Grid(plane, (first, second), n_max, n_orbits, tile, levels, follow, precision)


def field_cube(grid: Grid) -> Cube:
    """Return the plan of the cube `escape`, composed of its levels if there are several."""
    cube = _level_job(grid, "escape", grid.levels - 1).cube
    return escape.composed(cube, grid.levels, grid.follow) if grid.levels > 1 else cube


def estimate_tiles(run: Run, grid: Grid) -> Iterator[tuple[Job, Wanted]]:
    """Yield (job, wanted tiles) for each sweep of `escape_plane`; None means all tiles.

    With one level all tiles are wanted. With several levels, no tiles are wanted if the run's place
    already contains the field; otherwise a coarse preview of the plane predicts where levels are
    refined. If the place contains a field with other settings, the program ends with a usage error.
    """
    if grid.levels == 1:
        job = _level_job(grid, "escape", 0)
        run.check(job.cube, job.code.computed_by)
        yield job, None
        return
    field = field_cube(grid)
    if run.holds(field, *_level_names(grid)):
        yield from ((_level_job(grid, *each), set()) for each in _level_names(grid).items())
        return
    first, tiles = _level_job(grid, "escape_level0", 0), {}
    coords = {dim: first.cube.template[dim].values for dim in first.cube.tile}
    stride = ceil(max(1, prod(map(len, coords.values())) / _PREVIEW_SIZE) ** 0.5)
    preview = {dim: axis[::stride] for dim, axis in coords.items()} | {"ensemble": np.array([16])}
    short = first.cube.settings | {"n_max": min(grid.n_max, _PREVIEW_SIZE)}
    field = first.compute(preview, short)["escape_time"].repeat(stride, -2).repeat(stride, -1)
    rows, columns = map(len, coords.values())
    field = field[:, :rows, :columns]

    def compute(level, wanted):
        tiles[level] = wanted
        finer = field
        for _ in range(level):
            finer = refine.subdivided(finer)
        return finer

    refine.refine(compute, partial(_is_within, grid), grid.levels, grid.tile)
    for level, wanted in tiles.items():
        yield _level_job(grid, f"escape_level{level}", level), wanted


def _is_within(grid, field):
    return np.concatenate([field <= n for n in grid.follow])


def _level_names(grid):
    return {f"escape_level{level}": level for level in range(grid.levels)}


def _level_job(grid, name, level):
    factor = refine.FACTOR ** (grid.levels - 1 - level)
    axes = [axis.coarsened(factor) for axis in grid.axes]
    settings = grid.n_orbits, grid.n_max, grid.tile, grid.precision
    job = escape.over_plane(name, grid.plane, axes, *settings)
    return join_tiles(job) if grid.levels == 1 else job


def escape_plane(run: Run, grid: Grid) -> xr.Dataset:
    """Compute the field of first escape times, and return the cube `escape`.

    With one level the sweep computes every cell. With several levels, each level is a separate
    cube, `escape_level0` and so on. `escape` is composed of these cubes; its variable `level`
    contains the level of each cell.
    """
    if grid.levels == 1:
        return run.sweep(_level_job(grid, "escape", 0))

    fields: dict[int, tuple[FloatArray, set[tuple[int, ...]]]] = {}  # and the tiles in them

    def swept(level, wanted):
        job = _level_job(grid, f"escape_level{level}", level)
        times = run.sweep(job, wanted).escape_time
        if wanted is None:
            return times.values
        # A level has thousands of chunks; only those of new tiles are read.
        field, known = fields.setdefault(level, (np.full(times.shape, np.nan), set()))
        for index in sorted(wanted - known):
            cells = tile_slices(index, job.cube.tile)
            part = tuple(cells.get(str(dim), slice(None)) for dim in times.dims)
            field[part] = times[part]
        known |= wanted
        return field

    def compute():
        field, level = refine.refine(swept, partial(_is_within, grid), grid.levels, grid.tile)
        return cube.filled({"escape_time": field, "level": level})

    cube = field_cube(grid)
    for name in _level_names(grid):
        run.note("cubes", run.place.cube(name))
    return run.kept(cube, compute, *_level_names(grid))


def boundary_table(dataset: xr.Dataset, angles: FloatArray, steps: Sequence[int]) -> xr.Dataset:
    """Find the boundary of {n* ≤ N} for the largest ensemble, on rays.

    Parameters
    ----------
    dataset : xarray.Dataset
        The cube `escape`.
    angles : array
        Angles of the rays, in degrees.
    steps : sequence of int
        The step numbers N.

    Returns
    -------
    xarray.Dataset
        Dims (n, angle). `critical_scale` is the distance of the boundary from the origin, and
        `resolution` is the width of the cells at the boundary.
    """
    field = dataset.escape_time.isel(ensemble=-1).load()
    names = field.dims[::-1]
    first, second = (field[name].values for name in names)
    scale = xr.DataArray(
        [boundary(field.values, first, second, angles, n) for n in steps],
        {"n": steps, "angle": angles},
        ("n", "angle"),
    )
    parts = [scale * xr.DataArray(part, dims="angle") for part in ray(angles).T]
    table = xr.Dataset(dict(zip(names, parts, strict=True))).assign(critical_scale=scale)
    cell = max(np.ptp(axis[:2]) for axis in (first, second))
    if "level" in dataset:
        level = dataset.level
        points = {name: table[name].fillna(0) for name in names}  # NaN has no nearest cell
        local = level.sel(points, method="nearest").drop_vars(names)
        cell = cell * 2.0 ** (level.max() - local)
    table["resolution"] = cell + 0 * scale
    return table
