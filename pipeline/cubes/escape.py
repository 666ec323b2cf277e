"""First escape times n* of nested ensembles, by direct iteration.

The forcings fill a plane, which is computed in full or by levels of refinement; for rays, see
`pipeline.cubes.beyond`.
{n* ≤ N} is the region of global transport within N steps, for every N ≤ n_max;
see arXiv:1606.04824, Eq. (4), Proposition 1 and Sec. V.B.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from nasm import escape
from nasm.escape import PAPER_WINDOW
from nasm.planes import Plane, plane_of
from nasm.types import FloatArray
from pipeline.cubes.cube import (
    PAPER,
    Arrays,
    Coords,
    Cube,
    Job,
    Labels,
    Settings,
    blank,
    cells_along,
    coordinate,
)

if TYPE_CHECKING:
    from pipeline.sweep.grid import Axis

SECONDS_PER_KICK = {"double": 0.4e-9, "single": 0.17e-9}
"""CPU seconds per kick and orbit, for each precision."""

_PROBE_STEPS = 2000
_COMMENT = (
    "steps of {} kicks; NaN: not computed; inf: no escape up to n_max. "
    "escape_time <= N means global transport within N steps, for every N <= n_max."
)


def over_plane(
    name: str,
    plane: Plane,
    axes: Sequence["Axis"],
    sizes: Sequence[int],
    n_max: int,
    tile: int,
    precision: str = "double",
) -> Job:
    """Return the Job of escape times over a plane; dims (ensemble, second axis, first axis).

    Parameters
    ----------
    name : str
        Name of the cube.
    plane : Plane
        The plane of forcings.
    axes : sequence of two Axis
        Cells along the plane's axes, in the order of these axes.
    sizes : sequence of int
        Numbers of orbits in the nested ensembles, in increasing order.
    n_max : int
        Maximum number of steps (periods of the forcing); orbits that stay inside the window for
        all n_max steps count as not escaping.
    tile : int
        Cells along each side of a tile.
    precision : {"double", "single"}
        Floating-point precision, as for `nasm.escape.first_escape`.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.escape import over_plane
    >>> from pipeline.sweep.grid import Axis
    >>> job = over_plane("escape", two_kicks(), [Axis(0, 1, 8), Axis(0, 1, 6)], [16, 64], 100, 4)
    >>> dict(job.cube.template.escape_time.sizes)
    {'ensemble': 2, 'kappa2': 6, 'kappa1': 8}
    >>> job.cube.tile_counts
    (2, 2)
    """
    coords, tile_sizes = axes_of_plane(plane, axes), dict.fromkeys(list(plane.axes)[::-1], tile)
    settings = {"n_max": n_max, "precision": precision}
    title = "First escape times"
    return job(name, plane, sizes, coords, tile_sizes, settings, title, _on_plane, _predict_plane)


def axes_of_plane(plane: Plane, axes: Sequence["Axis"]) -> Labels:
    """Return the coordinates of the cells along the axes of a plane, the second axis first.

    axes : cells along the first and the second axis.
    """
    return cells_along(axes, plane.axes)


def composed(cube: Cube, levels: int, follow: Sequence[int]) -> Cube:
    """Return the Cube that combines the levels of refinement of a plane.

    Its variable `level` contains the refinement level of each value.

    Parameters
    ----------
    cube : Cube
        Cube of the whole plane at the finest level.
    levels : int
        Number of levels.
    follow : sequence of int
        Values of N; the levels of refinement follow the boundary of {n* ≤ N} for each N.
    """
    axes = {dim: cube.template[dim].variable for dim in cube.tile}
    comment = "0 is the coarsest; each level halves the cell size"
    level = blank(axes, "level of refinement of the value", np.int8(-1), comment=comment)
    settings = {"levels": levels, "follow": follow, **cube.settings}
    return replace(cube, template=cube.template.assign(level=level), settings=settings)


def job(
    name: str,
    plane: Plane,
    sizes: Sequence[int],
    coords: Mapping[str, xr.Variable],
    tile: dict[str, int],
    settings: Settings,
    title: str,
    compute: Callable[[Coords, Settings], Arrays],
    predict: Callable[[Coords, Settings], float],
) -> Job:
    """Return the Job of escape times over `coords`; `compute` and `predict` act on one tile."""
    ensemble = coordinate("ensemble", sizes, "number of orbits in the ensemble")
    coords, n_kicks = {"ensemble": ensemble, **coords}, len(plane.origin)
    references = f"{PAPER}, Eq. (4), Proposition 1 and Sec. V.B"
    long_name = "first step at which an orbit of the ensemble is outside the window"
    times = blank(coords, long_name, comment=_COMMENT.format(n_kicks), references=references)
    labels = {"title": f"{title} of the nonautonomous standard map", "references": references}
    template = xr.Dataset({"escape_time": times}, coords, labels)
    (x, y), precision = escape.ensemble(1), settings["precision"]
    warm_up = partial(escape.first_escape, [[0.0, 0.0]], x, y, [1], 1, precision=precision)
    settings = plane.record | {"window": list(PAPER_WINDOW)} | settings
    return Job(Cube(name, template, tile, settings), compute, predict, warm_up)


def times_of(forcings: FloatArray, coords: Coords, settings: Settings) -> Arrays:
    """Compute the arrays of a tile from its forcings, an array of shape (…, P)."""
    sizes = coords["ensemble"]
    x, y = escape.ensemble(int(sizes[-1]))
    n_max, window, precision = (settings[name] for name in ("n_max", "window", "precision"))
    return {"escape_time": escape.first_escape(forcings, x, y, sizes, n_max, window, precision)}


def _on_plane(coords: Coords, settings: Settings) -> Arrays:
    """Compute a tile of a plane."""
    plane = plane_of(settings)
    forcings = plane.forcing(*np.meshgrid(*(coords[name] for name in plane.axes)))
    return times_of(forcings, coords, settings)


def _predict_plane(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds from 64 orbits in each of a few cells, over at most 2000 steps.

    The cost of a cell is the number of orbits in the ensemble times the first escape time in this
    sample, or times n_max if none of the 64 orbits escapes.
    """
    axes, n_max = {dim: coords[dim] for dim in plane_of(settings).axes}, settings["n_max"]
    probed = {dim: axis[:: max(1, axis.size // 3)] for dim, axis in axes.items()}
    probed |= {"ensemble": np.array([64])}
    short = settings | {"n_max": min(n_max, _PROBE_STEPS)}
    times = _on_plane(probed, short)["escape_time"]
    steps = np.minimum(times, n_max).mean()
    return seconds(coords, settings, steps * np.prod([axis.size for axis in axes.values()]))


def seconds(coords: Coords, settings: Settings, steps: float) -> float:
    """Return the CPU seconds needed to advance every orbit of the ensemble by `steps` steps."""
    n_kicks = steps * len(plane_of(settings).origin)
    return SECONDS_PER_KICK[settings["precision"]] * n_kicks * int(coords["ensemble"][-1])
