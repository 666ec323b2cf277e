"""Indicators of transport for a list of two-kick forcings, after various numbers of steps.

Escape indicates transport directly. The other indicators describe individual orbits; they indicate
a barrier if *some start on a line looks regular and rotational*.
Every rotational circle, or its image under (x, y) → (-x, -y) or y → y + 1, crosses the line x = 0,
0 ≤ y ≤ 1/2, on which the starts are evenly spaced. The first is at the golden fraction of the
spacing, so that without kicks no start is resonant.

- `escape`: the first step at which an orbit of an ensemble has left the window of `nasm.escape`;
  inf if no orbit leaves it within n steps.
- `digits`: the largest number of reliable digits of ω, from weighted Birkhoff averages, on a
  rotational orbit from the line. An orbit counts as rotational if its ω differs from every
  fraction with a small denominator by more than 10 times the error of ω.
- `exponent` and `fli`: the smallest finite-time Lyapunov exponent, and the smallest fast Lyapunov
  indicator, on a rotational orbit from the line. A chain of q islands has points 1/q apart, so an
  orbit in it obeys |q(x_n - x_0) - np| < 1; an orbit that obeys this for some q ≤ √n/2 does not
  count as rotational. For these q an orbit on a circle with |ω - p/q| ≥ 0.38/q² violates it.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from math import isqrt

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from nasm import escape, lyapunov, orbits
from nasm.numbers import parse
from nasm.planes import TWO_KICKS_AXES
from nasm.types import BoolArray, FloatArray
from pipeline.cubes.cube import Arrays, Coords, Cube, Job, Settings, blank, coordinate, text

P = 2
"""Kicks per step."""


@dataclass(frozen=True)
class IndicatorSettings:
    """Sizes of ensembles, and the rule for rotational orbits.

    Attributes
    ----------
    n_orbits : int
        Number of orbits in the ensemble of `escape`.
    n_starts : int
        Starts on the line.
    max_denominator : int
        For `digits`, fractions with denominators up to this count as rotation numbers of islands.
        This wrongly excludes 0.3% of all ω if the average has eight digits.
    tile : int
        Forcings in a tile.

    Examples
    --------
    >>> from pipeline.cubes.indicators import IndicatorSettings, indicators
    >>> job = indicators("few", [0.4], [0.0], [100], IndicatorSettings(n_starts=16))
    >>> job.cube.settings["n_starts"]
    16
    """

    n_orbits: int = 1024
    n_starts: int = 64
    max_denominator: int = 200
    tile: int = 8


DEFAULT_SETTINGS = IndicatorSettings()


def indicators(
    name: str,
    kappa1: ArrayLike,
    kappa2: ArrayLike,
    steps: Sequence[int],
    settings: IndicatorSettings = DEFAULT_SETTINGS,
) -> Job:
    """Return the Job of a cube of indicators; dims (indicator, forcing, n).

    Each tile contains one indicator, so the record of a tile states the CPU time of that indicator.

    Parameters
    ----------
    name : str
        Name of the cube.
    kappa1, kappa2 : array_like, shape (m,)
        Strengths of the two kicks of each forcing.
    steps : sequence of int
        Increasing numbers of steps, each at least 4.
    settings : IndicatorSettings
        Sizes of ensembles.

    Examples
    --------
    >>> from pipeline.cubes.indicators import indicators
    >>> job = indicators("few", [0.4, 0.6], [0.0, 0.1], [100, 1000])
    >>> dict(job.cube.template.sizes), job.cube.tile_counts
    ({'indicator': 4, 'forcing': 2, 'n': 2}, (4, 1))
    """
    kappa1, kappa2 = np.asarray(kappa1, float), np.asarray(kappa2, float)
    dims = {
        "indicator": text("indicator", INDICATORS, "indicator"),
        "forcing": coordinate("forcing", np.arange(kappa1.size), "number of the forcing"),
        "n": coordinate("n", steps, "steps, periods of the forcing"),
    }
    coords = dims | {
        key: coordinate("forcing", values, TWO_KICKS_AXES[key])
        for key, values in (("kappa1", kappa1), ("kappa2", kappa2))
    }
    value = blank(dims, "value of the indicator; inf or 0 if no orbit is rotational")
    template = xr.Dataset({"value": value}, coords, {"title": "Indicators of transport"})
    tiles = {"indicator": 1, "forcing": settings.tile}
    cube = Cube(name, template, tiles, asdict(settings))
    return Job(cube, _compute, _predict, _load)


def line(n_starts: int) -> tuple[FloatArray, FloatArray]:
    """Return evenly spaced starts on x = 0, 0 ≤ y ≤ 1/2.

    Examples
    --------
    >>> from pipeline.cubes.indicators import line
    >>> print(line(2)[1])
    [0.1545085 0.4045085]
    """
    return np.zeros(n_starts), (np.arange(n_starts) + float(parse("gamma"))) / (2 * n_starts)


def kicks_of(indicator: str, value: ArrayLike, n: ArrayLike, settings: Settings) -> FloatArray:
    """Count the kicks that an indicator needs; orbits for `escape` stop at the first escape.

    Examples
    --------
    >>> from pipeline.cubes.indicators import kicks_of
    >>> print(kicks_of("escape", 50.0, 100, {"n_orbits": 64}))
    6400.0
    """
    if indicator == "escape":
        return P * settings["n_orbits"] * np.minimum(value, n)
    return P * settings["n_starts"] * np.broadcast_arrays(np.asarray(n, float), value)[0]


def is_locked(advance: FloatArray, n: int) -> BoolArray:
    """Return True where |q·advance - np| < 1 for some p and q ≤ √n/2, as in a chain of islands.

    Parameters
    ----------
    advance : ndarray
        x_n - x_0 on the lift, in turns.
    n : int
        Number of steps.

    Examples
    --------
    >>> import numpy as np
    >>> from pipeline.cubes.indicators import is_locked
    >>> print(is_locked(np.array([500.3, 618.0339887]), 1000))
    [ True False]
    """
    q = np.arange(1, max(1, isqrt(n) // 2) + 1).reshape(-1, *(1,) * np.ndim(advance))
    return (abs(q * advance - n * np.rint(q * advance / n)) < 1).any(axis=0)


def _escape(kappa: FloatArray, n: int, settings: Settings) -> float:
    starts = escape.ensemble(settings["n_orbits"])
    return float(escape.first_escape(kappa, *starts, [settings["n_orbits"]], n)[0])


def _digits(kappa: FloatArray, n: int, settings: Settings) -> float:
    """Return the largest number of digits on a rotational orbit; 0 if no orbit is rotational."""
    omegas, digits = orbits.rotation_number(kappa, *line(settings["n_starts"]), n)
    most = 0.0
    for omega, known in zip(omegas.tolist(), digits.tolist(), strict=True):
        if known > most and omega == omega:
            nearest = Fraction(omega).limit_denominator(settings["max_denominator"])
            if abs(omega - nearest) > 10 * 10**-known:
                most = known
    return most


def _exponent(kappa: FloatArray, n: int, settings: Settings) -> float:
    exponent, _, advance = lyapunov.tangent_growth(kappa, *line(settings["n_starts"]), n)
    return float(exponent[~is_locked(advance, n)].min(initial=np.inf))


def _fli(kappa: FloatArray, n: int, settings: Settings) -> float:
    _, largest, advance = lyapunov.tangent_growth(kappa, *line(settings["n_starts"]), n)
    return float(largest[~is_locked(advance, n)].min(initial=np.inf))


_OF: dict[str, Callable[[FloatArray, int, Settings], float]] = {
    "escape": _escape,
    "digits": _digits,
    "exponent": _exponent,
    "fli": _fli,
}
INDICATORS = tuple(_OF)

_SECONDS_PER_KICK = {"escape": 2e-9, "digits": 2.6e-8, "exponent": 2.6e-8, "fli": 2.6e-8}


def _compute(coords: Coords, settings: Settings) -> Arrays:
    """Compute one indicator for the forcings of a tile."""
    (indicator,), steps = coords["indicator"], coords["n"].tolist()
    kappas = np.stack([coords["kappa1"], coords["kappa2"]], -1)
    values = [[_OF[str(indicator)](kappa, n, settings) for n in steps] for kappa in kappas]
    return {"value": np.array([values])}


def _predict(coords: Coords, settings: Settings) -> float:
    """Predict CPU seconds from the number of kicks."""
    indicator, size = str(coords["indicator"][0]), coords["kappa1"].size
    n_orbits = settings["n_orbits" if indicator == "escape" else "n_starts"]
    kicks = P * n_orbits * size * int(np.sum(coords["n"]))
    return 1e-3 * size * coords["n"].size + _SECONDS_PER_KICK[indicator] * kicks


def _load() -> None:
    """Compile the kernels of all indicators."""
    settings = asdict(IndicatorSettings(n_orbits=1, n_starts=1))
    for function in _OF.values():
        function(np.array([0.3, 0.2]), 4, settings)
