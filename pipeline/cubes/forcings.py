"""Named forcings, of any period, which are no points of one plane: their last barriers, and whether
any holds a barrier longer than constant kicks of the same rms strength.

κ = s·profile, one profile for each place along the dim `forcing`; see `nasm.barriers`.

Against constant kicks profiles are brought to the rms 1, so that a scale is their rms strength.
Where one of 64 orbits escapes there is no barrier; escapes begin some percent above the last
breakup. Of forcings under which none escapes at 1.001 times the scale of constant kicks, converse
KAM is asked there: it eliminates all starts where there is no barrier, as far as its search can
tell. In 100 periods, by which 225 of 229 of them were denied, it denied none of 45 certified
circles under ripples of 2 to 8 kicks, 0.1% below the certificate's scale; in 300 it denied one, in
1000 three.
"""

import numpy as np
import xarray as xr

from nasm import barriers, escape
from pipeline.cubes.barrier import circle_arrays, last_circles
from pipeline.cubes.breakdown import blank_scales, scale_fields
from pipeline.cubes.cube import PAPER, STATUS_SETTING, Cube, Job, blank, coordinate, text
from pipeline.cubes.kernels import load_searches

_KICKS = 4000  # in which an orbit may escape
_PERIODS = 100, 300, 1_000, 10_000  # for which converse KAM is asked for a survivor
_LEAST = 0.02  # of the scale of constant kicks, where the search begins


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
    return Job(cube, _last_barriers, _predict_barriers, load_searches)


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


def _last_barriers(coords, settings):
    found = [barriers.critical_scale(row, settings["tol"]) for row in profiles_of(coords)]
    return scale_fields(found) | circle_arrays(found)


def _predict_barriers(coords, settings):
    """Predict by the period P: 0.2·P² s, no more from 16 on, at tol = 10⁻³ (medians)."""
    return 0.2 * np.sum(np.minimum(coords["period"], 16) ** 2.0)


def against_constant(name, forcings, parameter, golden, tries):
    """Return the Job of a cube of scales at which forcings hold no barrier.

    forcings, parameter : as for `last_barriers`. From those of the family "climb" climbs begin to
    forcings that hold at higher scales, in `tries` random steps, seeded by the parameter.
    golden : float, the critical strength of constant kicks, up to which is looked.
    """
    coords = labels(forcings, parameter)
    words = "rms strength without a barrier; inf if there is none up to 1.001 golden"
    upper = {"upper": blank({"forcing": coords["forcing"]}, words)}
    attrs = {"title": "Forcings against constant kicks of the same rms strength", "source": PAPER}
    settings = {"golden": golden, "kicks": _KICKS, "tries": tries}
    cube = Cube(name, xr.Dataset(upper, coords, attrs), {"forcing": 20}, settings)
    return Job(cube, _against_constant, _predict_against, _load)


def _load():
    """Compile the kernels of `answer`."""
    load_searches()
    answer(np.array([1.0, 0.9, 1.2]), 0.4)


def escapes(profile, scale):
    """Whether one of 64 orbits escapes within 4000 kicks of scale·profile: bool."""
    starts, periods = escape.ensemble(64), _KICKS // profile.size
    return escape.first_escape(scale * profile, *starts, [64], periods)[0] < np.inf


def answer(profile, golden):
    """Return a scale without a barrier; inf if there is none."""
    low, high = _LEAST * golden, 1.001 * golden  # where a barrier would be a better one
    if not escapes(profile, high):
        return high if any(barriers.eliminates(high * profile, n) for n in _PERIODS) else np.inf
    while high > 1.02 * low:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if escapes(profile, middle) else (middle, high)
    return high


def climb(profile, golden, tries, seed):
    """Climb from a profile to others from which orbits escape at higher scales only, by random
    steps; return the last. Steps grow by a half where they lead up, and else shrink by a seventh.
    """
    random, scale, step = np.random.default_rng(seed), _LEAST * golden, 0.3
    for _ in range(tries):
        tried = _normed(profile + step * random.standard_normal(profile.size))
        higher = scale * (1 + np.clip(step / 5, 1e-3, 0.05))
        if escapes(tried, higher):
            step = max(6 / 7 * step, 0.01)
        else:
            profile, scale, step = tried, higher, min(1.5 * step, 0.5)
    return profile


def _normed(profile):
    return profile / np.sqrt(np.mean(profile**2))


def _against_constant(coords, settings):
    golden, upper, rows = settings["golden"], [], map(_normed, profiles_of(coords))
    for row, family, seed in zip(rows, coords["family"], coords["parameter"], strict=True):
        tries = settings["tries"] if family == "climb" else 0
        upper.append(answer(climb(row, golden, tries, int(seed)), golden))
    return {"upper": np.array(upper)}


def _predict_against(coords, settings):
    tries = settings["tries"] * np.sum(coords["family"] == "climb")
    return 2e-4 * tries + np.sum(4e-3 + 3e-4 * coords["period"] ** 2.0)
