"""Does any forcing hold a barrier longer than constant kicks of the same rms strength?

Profiles are brought to the rms 1, so that a scale is their rms strength. Converse KAM of 100
periods eliminates all starts up to some percent above the last breakup: that shows, as far as its
search can tell, that a forcing does not hold at the scale of constant kicks.
"""

from functools import partial
from itertools import takewhile

import numpy as np
import xarray as xr

from nasm.barriers import eliminates
from pipeline.cubes.cube import PAPER, Cube, Job, blank
from pipeline.cubes.forcings import labels, profiles_of

_PERIODS = 100
_MORE = 1_000, 10_000  # asked for of what survives at the scale of constant kicks
_LEAST, _WIDTH = 0.02, 1.02  # of that scale: where the search begins, and where it ends
_TRIES = 200  # of a climb
_SECONDS = 0.02  # a kick and 100 periods: of P³, by and large


def upper_bounds(name, forcings, golden):
    """Return the Job of a cube of scales at which forcings hold no barrier. A tile is 10 forcings.

    forcings : list of (family, parameter, profile), as for `forcings.last_barriers`.
    golden : float, the critical strength of constant kicks, up to which is looked.
    """
    coords = labels(forcings, "rms of the deviations from constant kicks, over their mean")
    on = {"forcing": coords["forcing"]}
    words = "rms strength without a barrier, by converse KAM; inf if none was found up to golden"
    variables = {
        "survived": blank(on, "largest rms strength at which a start survives, 0 if none does"),
        "upper": blank(on, words),
    }
    return _job(name, coords, variables, 10, _bounds, golden, 8)


def climbs(name, forcings, golden):
    """Return the Job of a cube of climbs towards forcings that hold longer. A tile is one climb.

    forcings : as before; their parameters are whole numbers, which seed the climbs.
    """
    coords = labels(forcings, "seed of the climb")
    on, kicks = ({key: coords[key] for key in keys} for keys in (["forcing"], ["forcing", "kick"]))
    variables = {
        "reached": blank(on, "rms strength at which a start survives, at the end of the climb"),
        "survived": blank(on, "periods that a start survives at golden, of 100, 1000, 10⁴"),
        "summit": blank(kicks, "strengths at the end, of rms 1; NaN behind the last kick"),
    }
    return _job(name, coords, variables, 1, _climbed, golden, _TRIES)


def _job(name, coords, variables, tile, compute, golden, n_searches):
    attrs = {"title": "Forcings against constant kicks of the same rms strength", "source": PAPER}
    settings = {"golden": golden, "periods": _PERIODS}
    cube = Cube(name, xr.Dataset(variables, coords, attrs), {"forcing": tile}, settings)
    warm_up = partial(eliminates, np.array([0.9, 1.0, 1.2]), _PERIODS)
    return Job(cube, compute, partial(_predict, n_searches), warm_up)


def holds(profile, scale, n=_PERIODS):
    """Whether a start survives n periods of scale·profile."""
    return not eliminates(scale * profile, n)


def survival(profile, scale):
    """Return how many of 100, 1000 and 10⁴ periods a start survives at scale·profile, else 0."""
    lives = takewhile(partial(holds, profile, scale), (_PERIODS, *_MORE))
    return max(lives, default=0)


def _normed(profile):
    return profile / np.sqrt(np.mean(profile**2))


def _bounds(coords, settings):
    found = [bracket(_normed(row), settings["golden"]) for row in profiles_of(coords)]
    return dict(zip(("survived", "upper"), np.transpose(found), strict=True))


def bracket(profile, golden):
    """Return a scale at which a start survives, 0 if none does, and one at which none does."""
    if survival(profile, golden) == _MORE[-1]:
        return golden, np.inf
    low, high = _LEAST * golden, golden
    if not holds(profile, low):
        return 0.0, low
    while high > _WIDTH * low:
        middle = np.sqrt(low * high)
        low, high = (middle, high) if holds(profile, middle) else (low, middle)
    return low, high


def climb(profile, golden, random):
    """Climb from a profile to others that hold at higher scales, by random steps; return the last
    profile and scale. Steps grow by a half where they lead up, and else shrink by a seventh."""
    scale, step = bracket(profile, golden)[0] or _LEAST * golden, 0.3
    for _ in range(_TRIES):
        tried = _normed(profile + step * random.standard_normal(profile.size))
        higher = scale * (1 + min(max(step / 5, 1e-3), 0.05))
        if holds(tried, higher):
            profile, scale, step = tried, higher, min(1.5 * step, 0.5)
        else:
            step /= 7 / 6
    return profile, scale


def _climbed(coords, settings):
    golden, size = settings["golden"], coords["kick"].size
    reached, survived, summits = [], [], []
    for row, seed in zip(profiles_of(coords), coords["parameter"], strict=True):
        profile, scale = climb(_normed(row), golden, np.random.default_rng(int(seed)))
        reached.append(scale)
        survived.append(survival(profile, golden) if scale >= golden else 0)
        summits.append(np.pad(profile, (0, size - profile.size), constant_values=np.nan))
    return {
        "reached": np.array(reached),
        "survived": np.array(survived, dtype=float),
        "summit": np.array(summits),
    }


def _predict(n_searches, coords, settings):
    return 3e-4 * n_searches * np.sum(coords["period"] ** 3.0)
