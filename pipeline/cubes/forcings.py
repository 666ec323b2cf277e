"""The last barriers of named forcings, of any period, which are no points of one plane.

κ = s·profile, one profile for each place along the dim `forcing`; see `nasm.barriers`.
"""

from functools import partial
from itertools import zip_longest

import numpy as np
import xarray as xr

from nasm import barriers
from pipeline.cubes.barrier import circle_arrays, exact_circles, with_last_circle
from pipeline.cubes.breakdown import blank_scales, scale_fields
from pipeline.cubes.cube import PAPER, STATUS_SETTING, Cube, Job, coordinate, text

_LONG = 16  # kicks, from which the time that a forcing takes does not grow


def last_barriers(name, forcings, parameter, tol):
    """Return the Job of a cube of last barriers. A tile is one forcing.

    forcings : list of (family, parameter, profile): text, float, and P floats, P of any size.
    parameter : what the parameter of a family is, in words.
    tol : float, the brackets' relative width.
    """
    coords = labels(forcings, parameter)
    on, period = {"forcing": coords["forcing"]}, coords["period"]
    attrs = {"title": "Last barriers of named forcings", "source": PAPER}
    template = with_last_circle(xr.Dataset(blank_scales(on), coords, attrs), on)
    cube = Cube(name, template, {"forcing": 1}, {"tol": tol} | STATUS_SETTING)
    short = {"profile": np.ones((1, 1)), "period": period.values[:1]}
    return Job(cube, _compute, _predict, partial(_compute, short, {"tol": 0.1}))


def labels(forcings, parameter):
    """Return the coordinates of a list of (family, parameter, profile), see `last_barriers`."""
    families, parameters, profiles = zip(*forcings, strict=True)
    padded = np.array(list(zip_longest(*profiles, fillvalue=np.nan)), dtype=float).T
    words = "strengths over the scale s, first kick first; NaN behind the last kick"
    sizes = list(map(len, profiles))
    exact = (", ".join(f"{strength:.17g}" for strength in profile) for profile in profiles)
    return {
        "forcing": text("forcing", exact, "strengths over s, exactly"),
        "kick": coordinate("kick", range(padded.shape[1]), "place of a kick in the period"),
        "profile": coordinate(("forcing", "kick"), padded, words),
        "period": coordinate("forcing", sizes, "kicks in the period"),
        "family": text("forcing", families, "kind of forcing"),
        "parameter": coordinate("forcing", parameters, parameter),
    }


def with_circles(cube):
    """Return the cube, read, with the coordinate `circle`, the exact text of the last circle's ω
    per period, "" where none is named, in place of its partial quotients, and `rms_scale`, the rms
    strength at the breakup."""
    circles = exact_circles(cube.load(), [0] * cube.sizes["forcing"])
    words = "exact rotation number of the last circle, per period"
    cube = cube.drop_vars(["quotients", "tail_length", "quotient"])
    rms = cube.critical_scale * (cube.profile**2).mean("kick") ** 0.5
    cube["rms_scale"] = rms.assign_attrs(long_name="rms strength at the breakup", units="1")
    return cube.assign_coords(circle=text("forcing", circles, words))


def profiles_of(coords):
    """List the profiles of a tile, or of a cube, without what they are padded with."""
    return [row[~np.isnan(row)] for row in np.asarray(coords["profile"])]


def _compute(coords, settings):
    found = [barriers.critical_scale(row, settings["tol"]) for row in profiles_of(coords)]
    return scale_fields(found) | circle_arrays(found)


def _predict(coords, settings):
    """Predict by the period: 0.2·P² s for P up to 16, at tol = 10⁻³ (medians)."""
    return 0.2 * np.sum(np.minimum(coords["period"], _LONG) ** 2.0)
