"""First escape times n* of nested ensembles, by direct iteration of T_{κ1κ2}.

Over the (κ1, κ2) plane, in full or composed of levels of refinement; or along rays, near and beyond
a breakup that is known. {n* ≤ N} is global transport within N steps, for every N ≤ n_max.
arXiv:1606.04824, Eq. (mapaut), Proposition 1 and Sec. V.B.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr

from nasm import escape
from nasm.escape import PAPER_WINDOW
from nasm.symmetries import ray
from pipeline.cubes.cube import KICKS, PAPER, Cube, Job, angles_of_rays, blank, coordinate

SECONDS_PER_STEP = 0.8e-9  # CPU time of one orbit and one step of two kicks
_PROBE_STEPS = 2000
_COMMENT = (
    "steps of two kicks; NaN: not computed; inf: no escape up to n_max. "
    "escape_time <= N is global transport within N steps, for every N <= n_max."
)


def plane(name, kappa1, kappa2, sizes, n_max, tile):
    """Return the Job of escape times over the (κ1, κ2) plane.

    kappa1, kappa2 : grid.Axis.
    sizes : increasing ints, the nested ensembles.
    n_max : int, steps (periods of the forcing) after which an orbit counts as not escaping.
    tile : int, cells along each side of a tile.
    """
    coords = {}
    for dim, axis in (("kappa2", kappa2), ("kappa1", kappa1)):
        ends = f"{dim}_bounds"
        coords[dim] = coordinate(dim, axis.centres, KICKS[dim], bounds=ends)
        coords[ends] = coordinate((dim, "bound"), axis.bounds, "ends of the cells")
    title = "First escape times of the nonautonomous standard map"
    tiles, settings = {"kappa2": tile, "kappa1": tile}, {"cells_per_tile": tile}
    return _job(name, sizes, n_max, coords, tiles, settings, title, _on_plane, _predict_plane)


def composed(cube, levels, follow, field=None, level=None):
    """Return the cube of a plane composed of levels of refinement, or its plan without values.

    cube : the plane in full at the finest level.
    levels : int, number of levels.
    follow : list of N, whose boundaries {n* ≤ N} the levels follow.
    field : array (ensemble, kappa2, kappa1), the values.
    level : int8 array (kappa2, kappa1), which level each value is from.
    """
    axes = {dim: cube.template[dim] for dim in ("kappa2", "kappa1")}
    words = "level of refinement of the cell's value"
    comment = "0 is the coarsest; each level halves the cells"
    dims, values, attrs = blank(axes, words, np.int8(-1), comment=comment)
    template = cube.template.assign(level=(dims, values if level is None else level, attrs))
    if field is not None:
        template["escape_time"] = template.escape_time.copy(data=field)
    settings = {"levels": levels, "follow": follow, **cube.settings}
    return replace(cube, template=template, settings=settings)


def beyond(name, scales, excesses, sizes, n_max):
    """Return the Job of escape times at κ = s_c·(1 + excess)·(cos, sin) on rays.

    scales : {angle in degrees: scale s_c of the breakup on the ray}.
    excesses : increasing floats.
    name, sizes, n_max : as for `plane`. A tile is one forcing.
    """
    axes, title = beyond_breakup(scales, excesses), "First escape times beyond the last barrier"
    tiles, settings = {"angle": 1, "excess": 1}, {"critical_scales": by_angle(scales)}
    return _job(name, sizes, n_max, axes, tiles, settings, title, _beyond, _predict_beyond)


def beyond_breakup(scales, excesses):
    """Return the coordinates of forcings s_c·(1 + excess)·(cos, sin) on the rays of `scales`."""
    excess = coordinate("excess", excesses, "scale in parts of the breakup's, less 1")
    return {"angle": angles_of_rays(list(scales)), "excess": excess}


def by_angle(quantities):
    """Return {angle: …} with keys that JSON keeps."""
    return {str(float(angle)): quantity for angle, quantity in quantities.items()}


def _job(name, sizes, n_max, axes, tiles, settings, title, forcings, predict):
    ensemble = coordinate("ensemble", sizes, "number of orbits in the ensemble")
    coords = {"ensemble": ensemble, **axes}
    source = f"{PAPER}, Eq. (mapaut), Proposition 1 and Sec. V.B"
    words = "first step at which an orbit of the ensemble is outside the window"
    times = blank(coords, words, comment=_COMMENT, source=source)
    template = xr.Dataset({"escape_time": times}, coords, {"title": title, "source": source})
    settings = {"n_max": n_max, "window": list(PAPER_WINDOW), **settings}
    cube = Cube(name, template, tiles, settings)
    return Job(cube, partial(_compute, forcings), predict, warm_up_escape)


def _compute(forcings, coords, settings):
    sizes, limits = coords["ensemble"], (settings["n_max"], settings["window"])
    starts = escape.ensemble(int(sizes[-1]))
    return {"escape_time": escape.first_escape(forcings(coords, settings), *starts, sizes, *limits)}


def _on_plane(coords, settings):
    """Return the forcings of a tile, shape (kappa2, kappa1, 2)."""
    return np.stack(np.meshgrid(coords["kappa1"], coords["kappa2"]), axis=-1)


def _beyond(coords, settings):
    """Return the forcings of a tile, shape (angle, excess, 2)."""
    scales = np.array([settings["critical_scales"][str(a)] for a in coords["angle"].tolist()])
    profiles = scales[:, None] * ray(coords["angle"])
    return profiles[:, None, :] * (1 + coords["excess"][:, None])


def _predict_plane(coords, settings):
    """Predict from a few cells, 64 orbits, up to 2000 steps.

    A cell that the probe sees escape costs its escape time, any other one n_max; times all orbits.
    """
    probed = {dim: coords[dim][:: max(1, coords[dim].size // 3)] for dim in ("kappa2", "kappa1")}
    kappas, n_max = _on_plane(probed, settings), settings["n_max"]
    limits = min(n_max, _PROBE_STEPS), settings["window"]
    times = escape.first_escape(kappas, *escape.ensemble(64), [64], *limits)
    steps = np.where(np.isinf(times), n_max, times).mean()
    cells = coords["kappa2"].size * coords["kappa1"].size
    return SECONDS_PER_STEP * int(coords["ensemble"][-1]) * steps * cells


def _predict_beyond(coords, settings):
    """Predict by the law that the bias of direct iteration falls like N^(-1/3)."""
    steps = np.minimum(settings["n_max"], 100 * (0.3 / coords["excess"]) ** 3)
    return SECONDS_PER_STEP * int(coords["ensemble"][-1]) * steps.sum() * coords["angle"].size


def warm_up_escape():
    """Compile the kernels of first escape times."""
    escape.first_escape([[0.0, 0.0]], *escape.ensemble(1), [1], 1)
