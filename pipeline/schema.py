"""Cubes: what a labelled store of results holds, before anything is computed.

A cube is a lazy xarray template (variables, dims, coordinates, units), the length of a tile along
each tiled dimension, and the settings that decide its values. Two cubes with one `config_hash` hold
the same numbers, whoever computes them, in whatever order.
"""

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property

import dask.array
import numpy as np
import xarray as xr

FORMAT = "nasm-cubes/3"
"""Version of the store's layout; a store of another version is refused."""


N_QUOTIENTS = 32
"""Places for the partial quotients of a rotation number that is a result."""


@dataclass(frozen=True)
class Cube:
    """The plan of one cube.

    name : its group in the store.
    template : Dataset of the right dims, dtypes, coordinates and attributes, values not computed.
    tile : {dim: cells}; a tile is the unit of work and of storage. Every variable has all of these
        dims, in this order.
    settings : JSON-able, everything besides the coordinates that decides the values.
    """

    name: str
    template: xr.Dataset
    tile: dict[str, int]
    settings: dict

    @property
    def sizes(self):
        return dict(self.template.sizes)

    @cached_property
    def config_hash(self):
        """SHA-256 of coordinates, variables, tiling and settings."""
        digest = hashlib.sha256()
        for name, coordinate in sorted(self.template.coords.items()):
            digest.update(name.encode() + np.ascontiguousarray(coordinate.values).tobytes())
        variables = {
            k: [list(v.dims), str(v.dtype)] for k, v in sorted(self.template.data_vars.items())
        }
        plan = {"variables": variables, "tile": self.tile, "settings": self.settings}
        digest.update(json.dumps(plan, sort_keys=True).encode())
        return digest.hexdigest()


def escape_cube(name, kappa1, kappa2, sizes, n_max, window, tile):
    """The cube of first escape times over the (κ1, κ2) plane.

    Parameters
    ----------
    name : str, the cube's group.
    kappa1, kappa2 : grid.Axis.
    sizes : increasing ints, the nested ensembles.
    n_max : int, steps (periods of the forcing) after which an orbit counts as not escaping.
    window : (lo, hi) in y.
    tile : int, cells along each side of a tile.
    """
    coords = {
        "ensemble": _coordinate("ensemble", sizes, "number of orbits in the ensemble", "1"),
        "kappa2": _coordinate("kappa2", kappa2.centres, "strength of the second kick", "1"),
        "kappa1": _coordinate("kappa1", kappa1.centres, "strength of the first kick", "1"),
    }
    attrs = {
        **_ESCAPE_TIME,
        "source": "arXiv:1606.04824, Eq. (mapaut), Proposition 1 and Sec. V.B",
    }
    dims = tuple(coords)
    shape = tuple(c.size for c in coords.values())
    escape_time = dask.array.full(shape, np.nan, dtype="float64", chunks=-1)
    template = xr.Dataset(
        {"escape_time": (dims, escape_time, attrs)},
        coords,
        {"title": "First escape times of the nonautonomous standard map"},
    )
    settings = {"n_max": int(n_max), "window": [float(w) for w in window], "cells_per_tile": tile}
    return Cube(name, template, {"kappa2": tile, "kappa1": tile}, settings)


def breakdown_cube(name, omegas, angles, statuses, tile, settings):
    """The cube of critical scales of circles on rays: CB_ω for several ω, by one method.

    Parameters
    ----------
    name : str, the cube's group.
    omegas : {exact text: float} of rotation numbers.
    angles : array, degrees; the ray κ = s·(cos, sin).
    statuses : list of words; what the status 1, 2, … means (0: not computed).
    tile : int, angles per tile; a tile has one ω.
    settings : JSON-able, what else decides the values.
    """
    omega = _coordinate("omega", list(omegas.values()), "rotation number per step", "1")
    omega.attrs["exact"] = list(omegas)
    attrs = {
        "title": "Breakup of invariant circles of the nonautonomous standard map",
        "source": "arXiv:1606.04824, Sec. VI",
    }
    settings = {"omegas": list(omegas), **settings}
    return _ray_cube(name, {"omega": omega}, angles, _KICKS, statuses, tile, settings, attrs)


def escape_rays_cube(name, sizes, scales, excesses, n_max, window, tile):
    """The cube of first escape times along rays, near and beyond a breakup that is known.

    Parameters
    ----------
    scales : {angle in degrees: scale of the breakup s_c on the ray}.
    excesses : increasing floats x; the forcing is s_c·(1 + x)·(cos, sin).
    name, sizes, n_max, window : as for `escape_cube`. tile : int, excesses per tile.
    """
    coords = {
        "ensemble": _coordinate("ensemble", sizes, "number of orbits in the ensemble", "1"),
        **_beyond_breakup(scales, excesses),
    }
    attrs = {**_ESCAPE_TIME, "source": "arXiv:1606.04824, Sec. V.B and Fig. 7"}
    escape_time = dask.array.full(tuple(c.size for c in coords.values()), np.nan, chunks=-1)
    template = xr.Dataset(
        {"escape_time": (tuple(coords), escape_time, attrs)},
        coords,
        {"title": "First escape times beyond the last barrier"},
    )
    settings = {
        "n_max": int(n_max),
        "window": [float(w) for w in window],
        "critical_scales": _by_angle(scales),
    }
    return Cube(name, template, {"angle": 1, "excess": tile}, settings)


def flux_cube(name, scales, circles, excesses, statuses, settings):
    """The cube of the flux through circles beyond their breakup.

    Parameters
    ----------
    scales, excesses : as for `escape_rays_cube`. circles : {angle: exact text of ω}.
    name, statuses, settings : as for `breakdown_cube`. A tile is one forcing.
    """
    coords = _beyond_breakup(scales, excesses)
    shape, dims = tuple(c.size for c in coords.values()), tuple(coords)
    variables = {
        "flux": (np.nan, "area through the broken circle, per step: turns times y"),
        "error": (np.nan, "estimated absolute error of flux"),
        "period": (np.int32(0), "longest period of the orbits used"),
        "status": (np.int8(0), "outcome"),
    }
    template = xr.Dataset(
        {
            key: (
                dims,
                dask.array.full(shape, blank, chunks=-1),
                {"long_name": words, "units": "1"},
            )
            for key, (blank, words) in variables.items()
        },
        coords,
        {"title": "Flux through the remains of the last circle", "source": "arXiv:1606.04824"},
    )
    template.status.attrs |= _flags(statuses)
    settings = {
        "critical_scales": _by_angle(scales),
        "circles": _by_angle(circles),
        "statuses": list(statuses),
        **settings,
    }
    return Cube(name, template, {"angle": 1, "excess": 1}, settings)


def barrier_cube(name, angles, statuses, tile, settings):
    """The cube of the last barrier on rays: CB_gt from both sides, and which circle is the last.

    As `breakdown_cube`, with ω a result: `omega`, and exactly its partial quotients, of which the
    last `tail_length` repeat for ever.
    """
    attrs = {
        "title": "The last barrier to transport of the nonautonomous standard map",
        "source": "arXiv:1606.04824, Sec. V and VI",
    }
    cube = _ray_cube(name, {}, angles, _KICKS, statuses, tile, settings, attrs)
    quotient = _coordinate("quotient", range(N_QUOTIENTS), "place of a partial quotient", "1")
    template = cube.template.assign_coords(quotient=quotient)
    n_angles = len(angles)
    for key, shape, fill, long_name in (
        ("omega", (n_angles,), np.nan, "rotation number of the last circle, per step, in [0, 1]"),
        ("quotients", (N_QUOTIENTS, n_angles), np.int32(0), "partial quotients of omega"),
        ("tail_length", (n_angles,), np.int8(0), "partial quotients at the end that repeat"),
    ):
        dims = ("quotient", "angle")[-len(shape) :]
        blank = dask.array.full(shape, fill, chunks=-1)
        template[key] = (dims, blank, {"long_name": long_name, "units": "1"})
    template.quotients.attrs["comment"] = "0 behind the last one"
    return Cube(name, template, cube.tile, cube.settings)


def rotating_cube(name, frequencies, angles, statuses, tile, settings):
    """The cube of critical scales of rotating standard maps, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ).

    As `breakdown_cube`, with the frequencies {exact text: float} of Ω in place of ω, and the ray
    (κ̄, Δκ) = s·(cos, sin).
    """
    frequency = _coordinate("frequency", list(frequencies.values()), "frequency Ω", "1")
    frequency.attrs["exact"] = list(frequencies)
    settings = {"frequencies": list(frequencies), **settings}
    rows = {"frequency": frequency}
    return _ray_cube(name, rows, angles, _ROTATING, statuses, tile, settings, _ROTATING_MAPS)


def phases_cube(name, phases, angles, statuses, tile, settings):
    """As `rotating_cube`, for one frequency and the phases {exact text: float} of φ0."""
    phase = _coordinate("phase", list(phases.values()), "phase φ0 of the first kick, in turns", "1")
    phase.attrs["exact"] = list(phases)
    rows = {"phase": phase}
    return _ray_cube(name, rows, angles, _ROTATING, statuses, tile, settings, _ROTATING_MAPS)


_ESCAPE_TIME = {
    "long_name": "first step at which an orbit of the ensemble is outside the window",
    "units": "1",
    "comment": "steps of two kicks; NaN: not computed; inf: no escape up to n_max. "
    "escape_time <= N is global transport within N steps, for every N <= n_max.",
}
_KICKS = {"kappa1": "strength of the first kick", "kappa2": "strength of the second kick"}
_ROTATING = {"kappa_mean": "mean strength κ̄", "kappa_amplitude": "amplitude Δκ of the strengths"}
_ROTATING_MAPS = {
    "title": "Breakup of the last barriers of rotating standard maps",
    "source": "arXiv:1606.04824, Sec. VII, Eq. (rotmap)",
}


def _ray_cube(name, rows, angles, plane, statuses, tile, settings, attrs):
    """A cube of critical scales with dims (*rows, angle); `plane` are the point's coordinates."""
    coords = {
        **rows,
        "angle": _coordinate("angle", angles, "direction of the ray in the plane", "degree"),
    }
    quantities = {
        "critical_scale": "scale of the breakup, best estimate",
        "error": "estimated absolute error of critical_scale",
        "lower": "scale at which a circle was shown to exist",
        "upper": "scale at which no circle was shown to be left",
        **{key: f"{long_name} at the breakup" for key, long_name in plane.items()},
    }
    shape = tuple(c.size for c in coords.values())
    blank = dask.array.full(shape, np.nan, dtype="float64", chunks=-1)
    variables = {
        key: (tuple(coords), blank, {"long_name": long_name, "units": "1"})
        for key, long_name in quantities.items()
    }
    variables["status"] = (
        tuple(coords),
        dask.array.zeros(shape, dtype="int8", chunks=-1),
        {"long_name": "outcome", "units": "1", **_flags(statuses)},
    )
    template = xr.Dataset(variables, coords, attrs)
    # What a status code means is part of what decides the numbers.
    settings = {**settings, "statuses": list(statuses)}
    return Cube(name, template, {**dict.fromkeys(rows, 1), "angle": tile}, settings)


def _flags(statuses):
    """CF attributes of a status variable; 0 is what no tile has written."""
    flags = ["not_computed", *statuses]
    return {"flag_values": list(range(len(flags))), "flag_meanings": " ".join(flags)}


def _beyond_breakup(scales, excesses):
    """Coordinates of forcings s_c·(1 + excess)·(cos, sin) on the rays of `scales`."""
    return {
        "angle": _coordinate("angle", list(scales), "direction of the ray in the plane", "degree"),
        "excess": _coordinate("excess", excesses, "scale in parts of the breakup's, less 1", "1"),
    }


def _by_angle(quantities):
    """{angle: …} with keys that JSON keeps."""
    return {str(float(angle)): quantity for angle, quantity in quantities.items()}


def composed(cube, levels, follow, field=None, level=None):
    """`cube` of escape times, composed of several levels of refinement.

    levels : their number. follow : list of N, the boundaries that they follow.

    field : array (ensemble, kappa2, kappa1), its values. level : int8 array (kappa2, kappa1), which
    level each cell's value is from. Without them: the plan of that cube.
    """
    shape = tuple(cube.sizes[dim] for dim in ("kappa2", "kappa1"))
    if level is None:
        level = dask.array.full(shape, -1, dtype="int8", chunks=-1)
    attrs = {
        "long_name": "level of refinement of the cell's value",
        "units": "1",
        "comment": "0 is the coarsest; each level halves the cells",
    }
    template = cube.template.assign(level=(("kappa2", "kappa1"), level, attrs))
    if field is not None:
        template["escape_time"] = template.escape_time.copy(data=field)
    settings = {"levels": levels, "follow": follow, **cube.settings}
    return Cube(cube.name, template, cube.tile, settings)


def _coordinate(dim, values, long_name, units):
    return xr.Variable(dim, np.asarray(values), {"long_name": long_name, "units": units})
