"""Rotating standard maps, κ_n = s·(cos angle + sin angle · cos 2π(φ0 + nΩ)), with any frequency Ω.

The jobs compute the last circle or torus as a function of Ω, and the breakup of tori on rays;
`pictures` computes tori for pictures. See arXiv:1606.04824, Sec. VII, Eq. (53), and `nasm.tori`.
"""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product
from typing import TypeAlias

import numpy as np
import xarray as xr

from nasm import barriers, escape, periodic, tori
from nasm.converse_kam import aperiodic
from nasm.maps import MAX_PERIOD, rotating_forcing
from nasm.planes import ROTATING_AXES
from nasm.results import CriticalScale
from nasm.symmetries import ray
from nasm.tori import last_torus
from nasm.types import FloatArray
from pipeline.cubes.breakdown import blank_scales, job_on_rays, scale_arrays, scale_fields
from pipeline.cubes.cube import (
    STATUS_SETTING,
    Arrays,
    Coords,
    Cube,
    Job,
    Settings,
    angles_of_rays,
    blank,
    coordinate,
    text,
)
from pipeline.cubes.warm_up import load_orbits, load_searches

_MAX_KICKS = 32_000  # N, for the kicks from -N to N at irrational Ω
_LARGEST_SEARCH_TOL = 1e-2
"""Largest tolerance of the search of the Farey tree. Compared with the default tolerance, errors
covered the difference on 39 of 40 random rays with 7 to 16 kicks, and on 60 of 60 with 3 to 9. On
the other ray a band narrower than 2·10⁻³ lies 1.7% above the value. With 0.1 they covered it on 21
of 24."""
_PICTURE_SHAPE = 128, 256  # points along φ and θ

RotationVector: TypeAlias = tuple[float, float]
"""ω and Ω, turns of θ and φ per kick."""


def last_barriers(
    fractions: Sequence[Fraction],
    n_phases: int,
    irrational: Sequence[float],
    angles: Sequence[float],
    tol: float = 1e-3,
) -> Job:
    """Return the Job of the cube `frequencies`: brackets of the last circle or torus.

    Parameters
    ----------
    fractions : sequence of Fraction
        Rational frequencies Ω = p/q.
    n_phases : int
        Number of phases φ0 for each Ω, at least 2. They span [0, 1/(2q)]; by symmetry, phases
        outside this interval are equivalent to phases inside it.
    irrational : sequence of float
        Irrational frequencies.
    angles : sequence of float
        Directions of rays, in degrees.
    tol : float
        Relative width of the brackets, for rational Ω.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from pipeline.cubes.rotating_maps import last_barriers
    >>> job = last_barriers([Fraction(1, 2)], 2, [0.618], [45.0])
    >>> print(*job.cube.template.forcing.values, sep="; ")
    1/2,0; 1/2,1/4; 0.618
    """
    shares = [Fraction(k, n_phases - 1) for k in range(n_phases)]
    forcings: list[tuple[Fraction | float, Fraction | float, str]] = [
        (Ω, share, f"{Ω},{share / 2 / Ω.denominator}") for Ω, share in product(fractions, shares)
    ]
    forcings += [(Ω, np.nan, repr(Ω)) for Ω in irrational]
    frequencies, phases, names = zip(*forcings, strict=True)
    phase_label = "phase φ0 relative to 1/2q; NaN: Ω is irrational, and all phases are equivalent"
    rows = {
        "forcing": text("forcing", names, "exact Ω, and exact φ0 if Ω is rational"),
        "frequency": coordinate(
            "forcing", np.array(frequencies, float), "frequency Ω, turns of φ per kick"
        ),
        "phase": coordinate("forcing", np.array(phases, float), phase_label),
    }
    on_ray = {"forcing": rows["forcing"], "angle": angles_of_rays(angles)}
    job = job_on_rays(
        "frequencies",
        ROTATING_AXES,
        rows,
        angles,
        seconds=10,
        settings={"kicks": _MAX_KICKS, "tol": tol, "method": "last barriers, and certified tori"},
        compute=_last_barriers,
        warm_up=_load_last_barriers,
        title="Last barriers",
        more={"omega": blank(on_ray, "turns per kick of the circle or torus")},
    )
    return replace(job, predict=_predict)


def ripples(fractions: Sequence[Fraction], depths: Sequence[float], tol: float) -> Job:
    """Return the Job of the cube `ripple_spectrum`: last barriers under κ_n = κ(1 + d cos 2πnΩ).

    The scale is κ. For periods of more than 64 kicks only `upper` is computed. Each tile contains
    a single pair (Ω, d).

    Parameters
    ----------
    fractions : sequence of Fraction
        Frequencies Ω = p/q, in increasing order.
    depths : sequence of float
        Depths d of the modulation.
    tol : float
        Relative width of the brackets, which are computed for periods of at most 64 kicks.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from pipeline.cubes.rotating_maps import ripples
    >>> job = ripples([Fraction(1, 200), Fraction(1, 3)], [0.1], tol=1e-2)
    >>> dict(job.cube.template.critical_scale.sizes)
    {'frequency': 2, 'depth': 1}
    """
    known = {
        "frequency": coordinate("frequency", list(map(float, fractions)), "frequency Ω"),
        "depth": coordinate("depth", depths, "depth d of the modulation"),
    }
    turns = {"omega": blank(known, "turns per kick of the last circle")}
    names = {"fraction": text("frequency", map(str, fractions), "exact Ω")}
    attrs = {"title": "Last barriers under a ripple of frequency Ω and depth d"}
    template = xr.Dataset(blank_scales(known) | turns, known | names, attrs)
    settings = {"tol": tol} | STATUS_SETTING
    cube = Cube("ripple_spectrum", template, {"frequency": 1, "depth": 1}, settings)
    is_long = any(Ω.denominator > MAX_PERIOD for Ω in fractions)
    return Job(cube, _ripples, _predict_ripples, partial(_load_ripples, is_long))


def breakups(vectors: Sequence[RotationVector], angles: Sequence[float], tol: float) -> Job:
    """Return the Job of the cube `tori`: tori continued to their breakup.

    At the scale `upper` no torus with frequency Ω exists, for any ω.

    Parameters
    ----------
    vectors : sequence of (ω, Ω)
        Turns of θ and φ per kick.
    angles : sequence of float
        Directions of rays, in degrees.
    tol : float
        Target error of the scale.

    Examples
    --------
    >>> from pipeline.cubes.rotating_maps import breakups
    >>> job = breakups([(0.618, 0.414)], [0.0, 45.0], tol=1e-2)
    >>> dict(job.cube.template.critical_scale.sizes)
    {'vector': 1, 'angle': 2}
    """
    omegas, frequencies = zip(*vectors, strict=True)
    rows = {
        "vector": text("vector", map(_name_of, vectors), "turns of θ and φ per kick"),
        "omega": coordinate("vector", omegas, "turns of θ per kick"),
        "frequency": coordinate("vector", frequencies, "turns of φ per kick, Ω"),
    }
    return job_on_rays(
        "tori",
        ROTATING_AXES,
        rows,
        angles,
        seconds=12 if tol < 5e-3 else 5,
        settings={"method": "continuation of tori", "tol": tol},
        compute=_breakups,
        warm_up=partial(_load_tori, vectors[0]),
        title="Breakup of tori",
    )


def residues(vectors: Sequence[str], angles: Sequence[float]) -> Job:
    """Return the Job of the cube `rotating_tori`: the breakup of tori, by residues of long orbits.

    Parameters
    ----------
    vectors : sequence of str
        Strings "p/q,Ω": the turns per kick of an orbit, and the frequency.
    angles : sequence of float
        Directions of rays, in degrees.

    Examples
    --------
    >>> from pipeline.cubes.rotating_maps import residues
    >>> residues(["5/8,1/2"], [0.0, 45.0]).cube.template.frequency.values
    array([0.5])
    """
    numbers = [float(Fraction(vector.split(",")[1])) for vector in vectors]
    rows = {
        "frequency": coordinate("frequency", numbers, "frequency Ω"),
        "vector": text("frequency", vectors, "exact turns per kick of the orbit, and exact Ω"),
    }
    return job_on_rays(
        "rotating_tori",
        ROTATING_AXES,
        rows,
        angles,
        seconds=0.06,
        settings={"method": "Greene's residue of one orbit"},
        compute=_residues,
        warm_up=load_orbits,
        title="Breakup of circles",
    )


def pictures(vector: RotationVector, angle: float, sizes: Sequence[float]) -> xr.Dataset:
    """Compute h(θ, φ) - θ of certified tori on a ray; the Dataset has dims (scale, phi, theta).

    Parameters
    ----------
    vector : (ω, Ω)
        Turns of θ and φ per kick.
    angle : float
        Direction of the ray, in degrees.
    sizes : sequence of float
        Scales s on the ray.

    Returns
    -------
    xr.Dataset
        `deviation`, h - θ in turns, where h is the position x on the torus, and `least_slope`, the
        smallest ∂h/∂θ. Both are NaN where no torus is certified.
    """
    m, n = _PICTURE_SHAPE
    coords = {
        "scale": coordinate("scale", sizes, "scale s on the ray"),
        "phi": coordinate("phi", np.arange(m) / m, "phase φ of the forcing, in turns"),
        "theta": coordinate("theta", np.arange(n) / n, "angle θ of the rotation, in turns"),
    }
    deviations, slopes = np.full((len(sizes), m, n), np.nan), np.full(len(sizes), np.nan)
    for i, scale in enumerate(sizes):
        mean, amplitude = scale * ray(angle)
        n_max = tori.TorusSettings().max_points
        torus = tori.invariant_torus(*vector, mean, amplitude, n_max)
        if torus.certified:
            rows, columns = map(max, torus.u.shape, _PICTURE_SHAPE)
            u = tori.newton.resample(torus.u, rows, columns)
            deviations[i] = u[:: rows // m, :: columns // n]
            slopes[i] = tori.newton.least_slope(torus.u)
    h = blank(coords, "h - θ: position of the orbit minus position of the rotation")
    slope = blank({"scale": coords["scale"]}, "minimum slope of h along θ")
    variables = {"deviation": h.copy(data=deviations), "least_slope": slope.copy(data=slopes)}
    labels = {"vector": _name_of(vector), "angle": angle}
    return xr.Dataset(variables, coords, {"title": "Invariant tori"} | labels)


def _name_of(vector: RotationVector) -> str:
    """Return a rotation vector as a string, with all digits."""
    return ",".join(map(repr, vector))


def _load_tori(vector: RotationVector) -> None:
    """Compile the kernels of `_breakups`."""
    tori.invariant_torus(*vector, 0.05, 0.05)
    last_torus.upper_scale(vector[1], 1.0, 0.0)


def _load_last_barriers() -> None:
    """Compile the kernels of `_last_barriers`, for rational and irrational Ω."""
    load_searches()
    last_torus.last_critical_scale(2**0.5 - 1, 1.0, 0.0, 400)
    tori.invariant_torus(0.618, 2**0.5 - 1, 0.05, 0.05)


def _last_barriers(coords: Coords, settings: Settings) -> Arrays:
    """Compute the last barriers in a tile, and their rotation numbers per kick."""

    def last(name: str, profile: FloatArray) -> tuple[CriticalScale, float]:
        (frequency, _, phase), (mean, amplitude) = name.partition(","), profile
        if not phase:
            return last_torus.last_critical_scale(
                float(frequency), mean, amplitude, settings["kicks"]
            )
        forcing = rotating_forcing(mean, amplitude, frequency, float(Fraction(phase)))
        return _last_circle(forcing, settings["tol"])

    profiles = ray(coords["angle"])
    rows = [[last(name, profile) for profile in profiles] for name in coords["forcing"]]
    brackets, omega = _brackets_and_turns(rows)
    return scale_arrays(brackets, ROTATING_AXES, coords["angle"]) | {"omega": omega}


def _last_circle(profile: FloatArray, tol: float) -> tuple[CriticalScale, float]:
    """Bracket the breakup of the last circle, and return its turns per kick, up to symmetry.

    The Farey tree is searched with tol, even where this is more than the default tolerance of that
    search: with 30 kicks, one search takes about a second.
    """
    default = barriers.DEFAULT_EFFORT
    resolution = max(min(tol, _LARGEST_SEARCH_TOL), default.resolution)
    effort = replace(default, resolution=resolution)
    bracket = barriers.critical_scale(profile, tol, effort=effort)
    turns = np.nan if bracket.omega is None else float(bracket.omega) / profile.size
    return bracket, abs(turns - np.rint(turns))


def _brackets_and_turns(
    rows: Sequence[Sequence[tuple[CriticalScale, float]]],
) -> tuple[list[list[CriticalScale]], FloatArray]:
    """Separate nested lists of pairs into the brackets and the turns per kick."""
    brackets = [[bracket for bracket, _ in row] for row in rows]
    return brackets, np.array([[turns for _, turns in row] for row in rows])


def _ripples(coords: Coords, settings: Settings) -> Arrays:
    """Compute the last barriers in a tile of ripples."""

    def last(fraction: str, depth: float) -> tuple[CriticalScale, float]:
        return _last_circle(rotating_forcing(1.0, depth, fraction), settings["tol"])

    rows = [[last(Ω, depth) for depth in coords["depth"]] for Ω in coords["fraction"]]
    brackets, omega = _brackets_and_turns(rows)
    return scale_fields(brackets) | {"omega": omega}


def _predict_ripples(coords: Coords, settings: Settings) -> float:
    """Predict the CPU seconds of a tile: 8 for more than 64 kicks, else as for rotating maps."""
    q = Fraction(coords["fraction"][0]).denominator
    return _predict_circle(q, settings["tol"]) if q <= MAX_PERIOD else 8


def _predict_circle(q: int, tol: float) -> float:
    """Predict the CPU seconds of `_last_circle` for a forcing of q kicks.

    At a tol of 10⁻² it took 0.3 s for q = 3, 3 s for q = 10, and 10 s for q = 34; at 10⁻³ it took
    2.4 times as long, on 40 random rays with q from 7 to 16.
    """
    return 0.3 * q * max(_LARGEST_SEARCH_TOL / tol, 1) ** 0.4


def _load_ripples(is_long: bool) -> None:
    """Compile the kernels for last barriers; if `is_long`, also those for more than 64 kicks."""
    load_searches()
    if is_long:
        profile = np.ones(MAX_PERIOD)
        aperiodic.critical_scale(profile, 0.1)
        escape.onset_scale(profile, 1, n_orbits=1)


def _predict(coords: Coords, settings: Settings) -> float:
    """Predict the CPU seconds of a tile: 50 per ray for irrational Ω, less for Ω = p/q."""
    frequency, _, phase = coords["forcing"][0].partition(",")
    q = Fraction(frequency).denominator
    seconds = _predict_circle(q, settings["tol"]) if phase else 50
    return seconds * coords["angle"].size


def _breakups(coords: Coords, settings: Settings) -> Arrays:
    """Compute the breakup of each torus in a tile."""

    def bracket(omega: float, frequency: float, profile: FloatArray) -> CriticalScale:
        mean, amplitude = profile
        continued = tori.critical_scale(omega, frequency, mean, amplitude, settings["tol"])
        return replace(continued, upper=last_torus.upper_scale(frequency, mean, amplitude))

    vectors = zip(coords["omega"].tolist(), coords["frequency"].tolist(), strict=True)
    profiles = ray(coords["angle"])
    brackets = [[bracket(*vector, profile) for profile in profiles] for vector in vectors]
    return scale_arrays(brackets, ROTATING_AXES, coords["angle"])


def _residues(coords: Coords, settings: Settings) -> Arrays:
    """Compute the breakups in a tile by residues."""
    vectors, profiles = [vector.split(",") for vector in coords["vector"]], ray(coords["angle"])
    scales = [
        [periodic.torus_scale(*vector, *profile) for profile in profiles] for vector in vectors
    ]
    return scale_arrays(scales, ROTATING_AXES, coords["angle"])
