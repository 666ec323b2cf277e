"""First escape times n* of nested ensembles, by direct iteration.

Over a plane of forcings, in full or composed of levels of refinement; on rays in `beyond`.
{n* ≤ N} is global transport within N steps, for every N ≤ n_max.
arXiv:1606.04824, Eq. (4), Proposition 1 and Sec. V.B.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr

from nasm import escape
from nasm.escape import PAPER_WINDOW
from nasm.planes import plane_of
from pipeline.cubes.cube import PAPER, Cube, Job, blank, coordinate

SECONDS_PER_KICK = {"double": 0.4e-9, "single": 0.17e-9}  # CPU time of one orbit
_PROBE_STEPS = 2000
_COMMENT = (
    "steps of {} kicks; NaN: not computed; inf: no escape up to n_max. "
    "escape_time <= N is global transport within N steps, for every N <= n_max."
)


def over_plane(name, plane, axes, sizes, n_max, tile, precision="double"):
    """Return the Job of escape times over a plane; dims (ensemble, second axis, first axis).

    plane : nasm.planes.Plane. axes : two grid.Axis, in its order.
    sizes : increasing ints, the nested ensembles.
    n_max : int, steps (periods of the forcing) after which an orbit counts as not escaping.
    tile : int, cells along each side of a tile.
    precision : of the arithmetic, as for `escape.first_escape`.
    """
    coords, names = {}, list(plane.axes)[::-1]
    for dim, axis in zip(names, axes[::-1], strict=True):
        ends = f"{dim}_bounds"
        coords[dim] = coordinate(dim, axis.centres, plane.axes[dim], bounds=ends)
        coords[ends] = coordinate((dim, "bound"), axis.bounds, "ends of the cells")
    tiles, settings = dict.fromkeys(names, tile), {"n_max": n_max, "precision": precision}
    how = "First escape times", _on_plane, _predict_plane
    return job(name, plane, sizes, coords, tiles, settings, *how)


def composed(cube, levels, follow):
    """Return the plan of a plane that is composed of levels of refinement; it has the `level` of
    each value.

    cube : the plane in full at the finest level. levels : int, number of levels.
    follow : list of N, whose boundaries {n* ≤ N} the levels follow.
    """
    axes, words = {dim: cube.template[dim] for dim in cube.tile}, "level of refinement of the value"
    level = blank(axes, words, np.int8(-1), comment="0 is the coarsest; each halves the cells")
    settings = {"levels": levels, "follow": follow, **cube.settings}
    return replace(cube, template=cube.template.assign(level=level), settings=settings)


def job(name, plane, sizes, coords, tiles, settings, title, compute, predict):
    """Return the Job of escape times over `coords`; compute and predict are those of a tile."""
    ensemble = coordinate("ensemble", sizes, "number of orbits in the ensemble")
    coords, n_kicks = {"ensemble": ensemble, **coords}, len(plane.origin)
    source = f"{PAPER}, Eq. (4), Proposition 1 and Sec. V.B"
    words = "first step at which an orbit of the ensemble is outside the window"
    times = blank(coords, words, comment=_COMMENT.format(n_kicks), source=source)
    labels = {"title": f"{title} of the nonautonomous standard map", "source": source}
    template = xr.Dataset({"escape_time": times}, coords, labels)
    settings = plane.record | {"window": list(PAPER_WINDOW)} | settings
    least = [[0.0, 0.0]], *escape.ensemble(1), [1], 1
    warm_up = partial(escape.first_escape, *least, precision=settings["precision"])
    return Job(Cube(name, template, tiles, settings), compute, predict, warm_up)


def times_of(forcings, coords, settings):
    """Return the arrays of a tile that holds these forcings."""
    sizes, limits = coords["ensemble"], map(settings.get, ("n_max", "window", "precision"))
    starts = escape.ensemble(int(sizes[-1]))
    return {"escape_time": escape.first_escape(forcings, *starts, sizes, *limits)}


def _on_plane(coords, settings):
    plane = plane_of(settings)
    forcings = plane.forcing(*np.meshgrid(*map(coords.get, plane.axes)))
    return times_of(forcings, coords, settings)


def _predict_plane(coords, settings):
    """Predict from a few cells, 64 orbits, up to 2000 steps.

    A cell that the probe sees escape costs its escape time, any other one n_max; times all orbits.
    """
    axes, n_max = {dim: coords[dim] for dim in plane_of(settings).axes}, settings["n_max"]
    probed = {dim: axis[:: max(1, axis.size // 3)] for dim, axis in axes.items()}
    probed |= {"ensemble": np.array([64])}
    short = settings | {"n_max": min(n_max, _PROBE_STEPS)}
    times = _on_plane(probed, short)["escape_time"]
    steps = np.where(np.isinf(times), n_max, times).mean()
    return seconds(coords, settings, steps * np.prod([axis.size for axis in axes.values()]))


def seconds(coords, settings, steps):
    """Return the CPU time of so many steps of all orbits."""
    n_kicks = steps * len(plane_of(settings).origin)
    return SECONDS_PER_KICK[settings["precision"]] * n_kicks * int(coords["ensemble"][-1])
