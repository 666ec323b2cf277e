"""The last barriers of named forcings, of any period, which are no points of one plane.

κ = s·profile, one profile for each place along the dim `forcing`; see `nasm.barriers`.
"""

from functools import partial

import numpy as np
import xarray as xr

from nasm import barriers
from pipeline.cubes.barrier import circle_arrays, exact_circles, last_circles
from pipeline.cubes.breakdown import blank_scales, scale_fields
from pipeline.cubes.cube import PAPER, STATUS_SETTING, Cube, Job, coordinate, text


def last_barriers(name, forcings, parameter, tol):
    """Return the Job of a cube of last barriers. A tile is one forcing.

    forcings : list of (family, parameter, profile): text, float, and P floats, P of any size.
    parameter : what the parameter of a family is, in words.
    tol : float, the brackets' relative width.
    """
    coords = labels(forcings, parameter)
    on = {"forcing": coords["forcing"]}
    attrs = {"title": "Last barriers of named forcings", "source": PAPER}
    template = xr.Dataset(blank_scales(on) | last_circles(on), coords, attrs)
    cube = Cube(name, template, {"forcing": 1}, {"tol": tol} | STATUS_SETTING)
    return Job(cube, _compute, _predict, partial(barriers.critical_scale, (1.0,), 0.1))


def labels(forcings, parameter):
    """Return the coordinates of a list of (family, parameter, profile), see `last_barriers`."""
    families, parameters, profiles = zip(*forcings, strict=True)
    exact = (", ".join(f"{strength:.17g}" for strength in profile) for profile in profiles)
    rms = [np.mean(np.square(profile)) ** 0.5 for profile in profiles]
    return {
        "forcing": text("forcing", exact, "strengths over s, first kick first, exactly"),
        "period": coordinate("forcing", list(map(len, profiles)), "kicks in the period"),
        "rms": coordinate("forcing", rms, "rms of the strengths over s"),
        "family": text("forcing", families, "kind of forcing"),
        "parameter": coordinate("forcing", parameters, parameter),
    }


def profiles_of(coords):
    """List the profiles of a tile."""
    return [np.array(exact.split(","), dtype=float) for exact in coords["forcing"]]


def with_circles(cube):
    """Return the cube, read, with the coordinate `circle`, the exact text of the last circle's ω
    per period, "" where none is named, in place of its partial quotients."""
    circles = exact_circles(cube.load(), [0] * cube.sizes["forcing"])
    words = "exact rotation number of the last circle, per period"
    cube = cube.drop_vars(["quotients", "tail_length", "quotient"])
    return cube.assign_coords(circle=text("forcing", circles, words))


def _compute(coords, settings):
    found = [barriers.critical_scale(row, settings["tol"]) for row in profiles_of(coords)]
    return scale_fields(found) | circle_arrays(found)


def _predict(coords, settings):
    """Predict by the period P: 0.2·P² s, no more from 16 on, at tol = 10⁻³ (medians)."""
    return 0.2 * np.sum(np.minimum(coords["period"], 16) ** 2.0)
