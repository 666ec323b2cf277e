"""Cubes over lists of forcings of any period: last barriers, and a comparison with constant kicks.

Forcings are κ = s·profile, with one profile for each entry of the dim `forcing`; see
`nasm.barriers`. The comparison asks whether a barrier exists under any of these forcings at a
larger rms strength than under constant kicks.

For the comparison, profiles are normalised to rms 1, so that the scale s is the rms strength. There
is no barrier if one of 64 orbits escapes; orbits begin to escape a few percent above the last
breakup. If no orbit escapes at 1.001 times the critical scale of constant kicks, converse KAM is
applied at this scale: if no barrier exists, the method eliminates all starts, to within the
resolution of its search. Within 100 periods it excluded a barrier for 225 of 229 such forcings. As
a check, converse KAM was applied to ripples of 2 to 8 kicks, 0.1% below the scale at which a circle
is certified: of 45 circles it wrongly excluded none within 100 periods, one within 300, and three
within 1000.
"""

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from nasm import barriers, escape, survivors
from nasm.types import FloatArray
from pipeline.cubes.barrier import circle_arrays, last_circles
from pipeline.cubes.breakdown import blank_scales, scale_fields
from pipeline.cubes.cube import (
    STATUS_SETTING,
    Arrays,
    Coords,
    Cube,
    Job,
    Labels,
    Settings,
    blank,
    coordinate,
    text,
)
from pipeline.cubes.warm_up import load_searches

_MAX_KICKS = 4000  # number of kicks within which an orbit must escape
_MAX_PERIODS = 100, 300, 1_000, 10_000  # limits for converse KAM, tried in turn
_MIN_SCALE = 0.02  # relative to the critical scale of constant kicks; the search begins here


def last_barriers(
    name: str,
    forcings: Iterable[tuple[str, float, Sequence[float]]],
    parameter: str,
    tol: float,
) -> Job:
    """Return the Job of a cube of last barriers. A tile is one forcing.

    Parameters
    ----------
    name : str
        Name of the cube.
    forcings : iterable of (family, parameter, profile)
        A string, a float, and P floats, for any P.
    parameter : str
        Description of the second entry, the parameter.
    tol : float
        Relative width of the brackets.

    Examples
    --------
    >>> from pipeline.cubes.forcings import last_barriers
    >>> forcings = [("pair", 0.5, (1.0, 0.5)), ("triple", 0.2, (1.0, 0.6, 0.2))]
    >>> job = last_barriers("forcings", forcings, "the smallest strength", tol=1e-3)
    >>> print(job.cube.template.forcing.values[0])
    1, 0.5
    """
    coords = labels(forcings, parameter)
    on = {"forcing": coords["forcing"]}
    attrs = {"title": "Last barriers of named forcings"}
    template = xr.Dataset(blank_scales(on) | last_circles(on), coords, attrs)
    cube = Cube(name, template, {"forcing": 1}, {"tol": tol} | STATUS_SETTING)
    return Job(cube, _last_barriers, _predict_barriers, load_searches)


def labels(forcings: Iterable[tuple[str, float, Sequence[float]]], parameter: str) -> Labels:
    """Return the coordinates for a list of (family, parameter, profile); see `last_barriers`."""
    families, parameters, profiles = zip(*forcings, strict=True)
    exact = (", ".join(f"{strength:.17g}" for strength in profile) for profile in profiles)
    rms = [np.mean(np.square(profile)) ** 0.5 for profile in profiles]
    return {
        "forcing": text("forcing", exact, "exact strengths divided by s, first kick first"),
        "period": coordinate("forcing", list(map(len, profiles)), "kicks in the period"),
        "rms": coordinate("forcing", rms, "rms of the strengths over s"),
        "family": text("forcing", families, "kind of forcing"),
        "parameter": coordinate("forcing", parameters, parameter),
    }


def profiles_of(coords: Coords) -> list[FloatArray]:
    """List the profiles of a tile, each of shape (P,)."""
    return [np.array(exact.split(","), dtype=float) for exact in coords["forcing"]]


def _last_barriers(coords: Coords, settings: Settings) -> Arrays:
    """Compute the last barriers for the forcings in a tile."""
    brackets = [barriers.critical_scale(row, settings["tol"]) for row in profiles_of(coords)]
    return scale_fields(brackets) | circle_arrays(brackets)


def _predict_barriers(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds from the period P: 0.1 for P ≤ 2, else 0.2·min(P, 16)² (medians)."""
    period = np.minimum(coords["period"], 16)
    return np.where(period <= 2, 0.1, 0.2 * period**2.0).sum()


def against_constant(
    name: str,
    forcings: Iterable[tuple[str, float, Sequence[float]]],
    parameter: str,
    golden: float,
    tries: int,
) -> Job:
    """Return the Job of a cube of scales at which forcings have no barrier.

    Parameters
    ----------
    name, forcings, parameter
        As for `last_barriers`. A forcing of the family "climb" is the start of a random climb (see
        `random_climb`), whose result replaces it; the parameter of the forcing is the seed.
    golden : float
        The critical strength of constant kicks; scales up to 1.001 times this are searched.
    tries : int
        Number of random steps in each climb.
    """
    coords = labels(forcings, parameter)
    label = "rms strength at which no barrier exists; inf if none was found up to 1.001 golden"
    upper = {"upper": blank({"forcing": coords["forcing"]}, label)}
    attrs = {"title": "Forcings compared with constant kicks of the same rms strength"}
    settings = {"golden": golden, "kicks": _MAX_KICKS, "tries": tries}
    cube = Cube(name, xr.Dataset(upper, coords, attrs), {"forcing": 20}, settings)
    return Job(cube, _against_constant, _predict_against, _load)


def _load() -> None:
    """Compile the kernels of `scale_without_barrier`."""
    load_searches()
    scale_without_barrier(np.array([1.0, 0.9, 1.2]), 0.4)


def any_orbit_escapes(profile: FloatArray, scale: float) -> bool:
    """Return True if one of 64 orbits escapes within 4000 kicks of scale·profile."""
    (x, y), periods = escape.ensemble(64), _MAX_KICKS // profile.size
    return escape.first_escape(scale * profile, x, y, [64], periods)[0] < np.inf


def scale_without_barrier(profile: FloatArray, golden: float) -> float:
    """Find a scale without a barrier, up to 1.001 golden; return inf if none is found.

    Parameters
    ----------
    profile : ndarray, shape (P,)
        Strengths of the kicks over s.
    golden : float
        The critical strength of constant kicks.
    """
    low, high = _MIN_SCALE * golden, 1.001 * golden  # above the breakup for constant kicks
    if not any_orbit_escapes(profile, high):
        is_excluded = any(survivors.eliminates(high * profile, n) for n in _MAX_PERIODS)
        return high if is_excluded else np.inf
    while high > 1.02 * low:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if any_orbit_escapes(profile, middle) else (middle, high)
    return high


def random_climb(profile: FloatArray, golden: float, tries: int, seed: int) -> FloatArray:
    """Search, by random steps, for a profile under which orbits escape only at a higher scale.

    A random step is accepted if no orbit escapes at a scale slightly above the current one. The
    step length grows by a half after an accepted step, and shrinks by a seventh otherwise.

    Parameters
    ----------
    profile : ndarray, shape (P,)
        The initial profile.
    golden : float
        The critical strength of constant kicks; the search begins at 0.02 times this.
    tries : int
        Number of random steps.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    ndarray, shape (P,)
        The last accepted profile, with rms 1; the initial profile if none was accepted.
    """
    random, scale, step = np.random.default_rng(seed), _MIN_SCALE * golden, 0.3
    for _ in range(tries):
        candidate = _normalised(profile + step * random.standard_normal(profile.size))
        higher = scale * (1 + np.clip(step / 5, 1e-3, 0.05))
        if any_orbit_escapes(candidate, higher):
            step = max(6 / 7 * step, 0.01)
        else:
            profile, scale, step = candidate, higher, min(1.5 * step, 0.5)
    return profile


def _normalised(profile: FloatArray) -> FloatArray:
    """Return the profile scaled to rms 1."""
    return profile / np.sqrt(np.mean(profile**2))


def _against_constant(coords: Coords, settings: Settings) -> Arrays:
    """Compute scales without a barrier for the forcings in a tile."""
    golden, upper, rows = settings["golden"], [], map(_normalised, profiles_of(coords))
    for row, family, seed in zip(rows, coords["family"], coords["parameter"], strict=True):
        tries = settings["tries"] if family == "climb" else 0
        profile = random_climb(row, golden, tries, int(seed))
        upper.append(scale_without_barrier(profile, golden))
    return {"upper": np.array(upper)}


def _predict_against(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds from the random steps and the periods of the forcings."""
    tries = settings["tries"] * np.sum(coords["family"] == "climb")
    return 4e-4 * tries + np.sum(4e-3 + 3e-4 * coords["period"] ** 2.0)
