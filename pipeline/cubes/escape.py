"""First escape times n* of nested ensembles, by direct iteration of T_{κ1κ2}.

Over the (κ1, κ2) plane, in full or composed of levels of refinement; or along rays, near and beyond
a breakup that is known. {n* ≤ N} is global transport within N steps, for every N ≤ n_max.
arXiv:1606.04824, Eq. (mapaut), Proposition 1 and Sec. V.B.
"""

import dataclasses

import numpy as np
import xarray as xr

from nasm import escape
from nasm.escape import PAPER_WINDOW
from nasm.symmetries import ray
from pipeline.cubes.cube import PAPER, Cube, Job, blank, coordinate
from pipeline.cubes.rays import KICKS, angles_of_rays

SECONDS_PER_STEP = 0.8e-9
"""CPU time of one orbit and one step of two kicks."""

_PROBE_STEPS = 2000
_WORDS = "first step at which an orbit of the ensemble is outside the window"
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
    cells = {"kappa2": kappa2, "kappa1": kappa1}
    axes = {
        dim: coordinate(dim, axis.centres, KICKS[dim], bounds=f"{dim}_bounds")
        for dim, axis in cells.items()
    }
    title = "First escape times of the nonautonomous standard map"
    tiles, settings = {"kappa2": tile, "kappa1": tile}, {"cells_per_tile": tile}
    cube = _cube(name, sizes, n_max, axes, tiles, settings, title)
    bounds = {
        f"{dim}_bounds": coordinate((dim, "bound"), axis.bounds, "ends of the cells")
        for dim, axis in cells.items()
    }
    cube = dataclasses.replace(cube, template=cube.template.assign_coords(bounds))
    return Job(cube, _compute_plane, _predict_plane, warm_up_escape)


def composed(cube, levels, follow, field=None, level=None):
    """Return the cube of a plane composed of levels of refinement, or its plan without values.

    cube : the plane in full at the finest level.
    levels : int, number of levels.
    follow : list of N, whose boundaries {n* ≤ N} the levels follow.
    field : array (ensemble, kappa2, kappa1), the values.
    level : int8 array (kappa2, kappa1), which level each value is from.
    """
    dims, values, attrs = blank(
        {dim: cube.template[dim] for dim in ("kappa2", "kappa1")},
        "level of refinement of the cell's value",
        np.int8(-1),
        comment="0 is the coarsest; each level halves the cells",
    )
    template = cube.template.assign(level=(dims, values if level is None else level, attrs))
    if field is not None:
        template["escape_time"] = template.escape_time.copy(data=field)
    settings = {"levels": levels, "follow": follow, **cube.settings}
    return dataclasses.replace(cube, template=template, settings=settings)


def beyond(name, scales, excesses, sizes, n_max):
    """Return the Job of escape times at κ = s_c·(1 + excess)·(cos, sin) on rays.

    scales : {angle in degrees: scale s_c of the breakup on the ray}.
    excesses : increasing floats.
    name, sizes, n_max : as for `plane`. A tile is one forcing.
    """
    axes, title = beyond_breakup(scales, excesses), "First escape times beyond the last barrier"
    tiles, settings = {"angle": 1, "excess": 1}, {"critical_scales": by_angle(scales)}
    cube = _cube(name, sizes, n_max, axes, tiles, settings, title)
    return Job(cube, _compute_beyond, _predict_beyond, warm_up_escape)


def beyond_breakup(scales, excesses):
    """Return the coordinates of forcings s_c·(1 + excess)·(cos, sin) on the rays of `scales`."""
    return {
        "angle": angles_of_rays(list(scales)),
        "excess": coordinate("excess", excesses, "scale in parts of the breakup's, less 1"),
    }


def by_angle(quantities):
    """Return {angle: …} with keys that JSON keeps."""
    return {str(float(angle)): quantity for angle, quantity in quantities.items()}


def _cube(name, sizes, n_max, axes, tiles, settings, title):
    ensemble = coordinate("ensemble", sizes, "number of orbits in the ensemble")
    coords = {"ensemble": ensemble, **axes}
    source = f"{PAPER}, Eq. (mapaut), Proposition 1 and Sec. V.B"
    times = blank(coords, _WORDS, comment=_COMMENT, source=source)
    template = xr.Dataset({"escape_time": times}, coords, {"title": title, "source": source})
    return Cube(name, template, tiles, {"n_max": n_max, "window": list(PAPER_WINDOW), **settings})


def _compute_plane(coords, settings):
    return _times(_strengths(coords), coords["ensemble"], settings)


def _predict_plane(coords, settings):
    """Predict from a few cells, 64 orbits, up to 2000 steps.

    A cell that the probe sees escape costs its escape time, any other one n_max; times all orbits.
    """
    probed = {dim: coords[dim][:: max(1, coords[dim].size // 3)] for dim in ("kappa2", "kappa1")}
    n_max, window = settings["n_max"], settings["window"]
    x, y = escape.ensemble(64)
    times = escape.first_escape(_strengths(probed), x, y, [64], min(n_max, _PROBE_STEPS), window)
    steps = np.where(np.isinf(times), n_max, times).mean()
    cells = coords["kappa2"].size * coords["kappa1"].size
    return SECONDS_PER_STEP * int(coords["ensemble"][-1]) * steps * cells


def _compute_beyond(coords, settings):
    scales = np.array([settings["critical_scales"][str(a)] for a in coords["angle"].tolist()])
    profiles = scales[:, None] * ray(coords["angle"])
    kappas = profiles[:, None, :] * (1 + coords["excess"][:, None])
    return _times(kappas, coords["ensemble"], settings)


def _predict_beyond(coords, settings):
    """Predict by the law that the bias of direct iteration falls like N^(-1/3)."""
    steps = np.minimum(settings["n_max"], 100 * (0.3 / coords["excess"]) ** 3)
    return SECONDS_PER_STEP * int(coords["ensemble"][-1]) * steps.sum() * coords["angle"].size


def warm_up_escape():
    """Compile the kernels of first escape times."""
    escape.first_escape([[0.0, 0.0]], *escape.ensemble(1), [1], 1)


def _times(kappas, sizes, settings):
    x, y = escape.ensemble(int(sizes[-1]))
    window = settings["window"]
    return {"escape_time": escape.first_escape(kappas, x, y, sizes, settings["n_max"], window)}


def _strengths(coords):
    """Return the forcings of a tile, shape (kappa2, kappa1, 2)."""
    return np.stack(np.meshgrid(coords["kappa1"], coords["kappa2"]), axis=-1)
