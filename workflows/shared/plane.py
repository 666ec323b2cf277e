"""The field of first escape times over a plane, refined where its boundaries run."""

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
from pipeline.cubes import escape
from pipeline.sweep import refine
from pipeline.sweep.grid import Axis, join_tiles

_GLANCE = 4000  # cells, and steps, of the coarse look by which refinement is foreseen


@dataclass(frozen=True)
class Grid:
    """What to compute."""

    plane: Plane  # of forcings
    axes: tuple[Axis, Axis]  # of the finest grid, along the plane's two
    n_max: int  # steps up to which orbits are followed
    n_orbits: list[int]  # increasing sizes of the nested ensembles
    tile: int  # cells along each side of a tile, at least; see `grid.join_tiles`
    levels: int  # of refinement, each of cells half as wide
    follow: list[int]  # increasing N of the boundaries {n* ≤ N} that the levels follow
    precision: str  # of the arithmetic, as for `escape.first_escape`

    @property
    def drawn(self):
        """The N whose boundaries are resolved everywhere, to be drawn.

        In a plane that is computed in full n_max/10, n_max/2 and n_max, as in Fig. 5.
        """
        if self.levels > 1:
            return self.follow
        return sorted({max(1, self.n_max // 10), max(1, self.n_max // 2), self.n_max})


def grid_of(plane, first, second, n_max, n_orbits, tile, levels, follow, precision):
    """Return the Grid of `cli.plane_options`; ValueError if they do not fit together."""
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


def planned(grid):
    """Return the cube `escape`: all cells, or composed of levels."""
    cube = _level_job(grid, "escape", grid.levels - 1).cube
    return escape.composed(cube, grid.levels, grid.follow) if grid.levels > 1 else cube


def foreseen(run, grid):
    """Yield (job, tiles that it wants, or None for all) of each sweep that `escape_plane` does.

    They want no tiles if the run's place holds the field. Else where the levels will be refined is
    taken from a coarse look at the plane. A usage error if it holds one of other settings.
    """
    field = planned(grid)
    if grid.levels == 1:
        run.check(field)
        yield _level_job(grid, "escape", 0), None
        return
    if run.holds(field, *_level_names(grid)):
        yield from ((_level_job(grid, *each), set()) for each in _level_names(grid).items())
        return
    first, asked = _level_job(grid, "escape_level0", 0), {}
    coords = {dim: first.cube.template[dim].values for dim in first.cube.tile}
    stride = ceil(max(1, prod(map(len, coords.values())) / _GLANCE) ** 0.5)
    look = {dim: axis[::stride] for dim, axis in coords.items()} | {"ensemble": np.array([16])}
    short = first.cube.settings | {"n_max": min(grid.n_max, _GLANCE)}
    field = first.compute(look, short)["escape_time"].repeat(stride, -2).repeat(stride, -1)
    rows, columns = map(len, coords.values())
    field = field[:, :rows, :columns]

    def compute(level, wanted):
        asked[level] = wanted
        finer = field
        for _ in range(level):
            finer = refine.subdivided(finer)
        return finer

    refine.refine(compute, partial(_is_within, grid), grid.levels, grid.tile)
    for level, wanted in asked.items():
        yield _level_job(grid, f"escape_level{level}", level), wanted


def _is_within(grid, field):
    return np.concatenate([field <= n for n in grid.follow])


def _level_names(grid):
    return {f"escape_level{level}": level for level in range(grid.levels)}


def _level_job(grid, name, level):
    factor = refine.FACTOR ** (grid.levels - 1 - level)
    axes = [axis.coarsened(factor) for axis in grid.axes]
    sizes, how = grid.n_orbits, (grid.n_max, grid.tile, grid.precision)
    job = escape.over_plane(name, grid.plane, axes, sizes, *how)
    return join_tiles(job) if grid.levels == 1 else job


def escape_plane(run, grid):
    """Compute the field of first escape times, and return the cube `escape` as a Dataset.

    With one level the cube holds every cell. With more every level is a cube of its own,
    `escape_level0` and so on, and `escape` is composed of them, with the `level` of each cell.
    """
    if grid.levels == 1:
        return run.sweep(_level_job(grid, "escape", 0))

    def swept(level, wanted):
        return run.sweep(_level_job(grid, f"escape_level{level}", level), wanted).escape_time.values

    def compute():
        field, level = refine.refine(swept, partial(_is_within, grid), grid.levels, grid.tile)
        return cube.filled({"escape_time": field, "level": level})

    cube = planned(grid)
    for name in _level_names(grid):
        run.note("cubes", run.place.cube(name))
    return run.kept(cube, compute, *_level_names(grid))


def boundary_table(dataset, angles, steps):
    """Find the boundary of the largest ensemble on rays: a Dataset with dims (n, angle).

    critical_scale is the distance from the origin, resolution the cell's width there.
    """
    field = dataset.escape_time.isel(ensemble=-1).load()
    names = field.dims[::-1]
    axes = [field[name].values for name in names]
    scale = xr.DataArray(
        [boundary(field.values, *axes, angles, n) for n in steps],
        {"n": steps, "angle": angles},
        ("n", "angle"),
    )
    parts = [scale * xr.DataArray(part, dims="angle") for part in ray(angles).T]
    table = xr.Dataset(dict(zip(names, parts, strict=True))).assign(critical_scale=scale)
    cell = max(np.ptp(axis[:2]) for axis in axes)
    if "level" in dataset:
        level = dataset.level
        there = {name: table[name].fillna(0) for name in names}  # NaN has no nearest cell
        here = level.sel(there, method="nearest").drop_vars(names)
        cell = cell * 2.0 ** (level.max() - here)
    table["resolution"] = cell + 0 * scale
    return table
