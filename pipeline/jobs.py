"""Jobs for `pipeline.fill`: each consists of one cube and the functions that compute its tiles.

The functions in this module check their arguments. The cubes have the same names and settings as
those computed by the commands, so `fill` can complete a cube that `python -m workflows.NAME` has
started, and vice versa.

A plane is given as a Plane, or as a string that the --plane option accepts, like "rotating:1/3"
(see `nasm.planes.parse`). Angles are directions of rays in the plane, in degrees.
"""

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ParamSpec

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from nasm import planes
from nasm.checks import count, floats, real
from nasm.escape import MAX_SINGLE_STEPS
from nasm.maps import direction, forcing
from nasm.numbers import RotationNumber, parse
from nasm.planes import Plane, plane_of, two_kicks
from nasm.texts import short_repr
from nasm.types import FloatArray, OmegaLike
from pipeline.cubes import barrier as barriers
from pipeline.cubes import beyond, own_function, proved, rotating_maps
from pipeline.cubes import breakdown as breakdowns
from pipeline.cubes import escape as escapes
from pipeline.cubes import forcings as lists
from pipeline.cubes import frequency_map as frequency_maps
from pipeline.cubes.cube import Job
from pipeline.cubes.escape import SECONDS_PER_KICK
from pipeline.sweep.grid import Axis, join_tiles, parse_axis

P = ParamSpec("P")


def _recorded(maker: Callable[P, Job]) -> Callable[P, Job]:
    """Wrap a function that makes jobs; each job then stores the call, for its cube's `history`."""

    @functools.wraps(maker)
    def record(*args: P.args, **options: P.kwargs) -> Job:
        texts = [_text(value) for value in args]
        texts += [f"{name}={_text(value)}" for name, value in options.items()]
        return replace(
            maker(*args, **options), call=f"pipeline.{maker.__name__}({', '.join(texts)})"
        )

    return record


def _text(argument: object) -> str:
    """Return a short text for an argument: its value if it is plain data, else its name or type."""
    if isinstance(argument, np.ndarray | np.generic):
        argument = argument.tolist()
    if argument is None or isinstance(argument, str | float | int | list | tuple | range | dict):
        return short_repr(argument)
    return getattr(argument, "__qualname__", f"<{type(argument).__name__}>")


@_recorded
def escape(
    plane: Plane | str = "two-kicks",
    first: Axis | str = "-1.1:1.1:256",
    second: Axis | str = "0:1.1:128",
    n_max: int = 10_000,
    n_orbits: int | Sequence[int] = 64,
    precision: str = "double",
    tile: int = 16,
) -> Job:
    """Return the Job for the cube `escape`: first escape times over a plane of forcings.

    Parameters
    ----------
    plane : Plane or str
        The plane of forcings.
    first, second : Axis or str
        Cells along the two axes of the plane, "LO:HI:N".
    n_max : int
        Maximum number of steps (periods of the forcing), 1 to 10¹²; orbits that stay inside the
        window for all these steps count as not escaping.
    n_orbits : int or sequence of int
        Orbits per forcing, 1 to 10⁸; several increasing numbers define nested ensembles.
    precision : {"double", "single"}
        Floating-point precision; `single` is 2.5 times faster and allowed up to 10⁶ steps.
    tile : int
        Minimum number of cells along each side of a tile.

    Examples
    --------
    >>> import pipeline
    >>> job = pipeline.escape("two-kicks", "0:1:8", "0:1:6", n_max=100)
    >>> dict(job.cube.template.escape_time.sizes)
    {'ensemble': 1, 'kappa2': 6, 'kappa1': 8}
    """
    plane, axes = _plane(plane), [_axis(first), _axis(second)]
    for a in axes[0].lo, axes[0].hi:
        for b in axes[1].lo, axes[1].hi:
            forcing(plane.forcing(a, b))
    n_max = count("n_max", n_max, 1, 10**12)
    n_orbits = [n_orbits] if np.ndim(n_orbits) == 0 else n_orbits  # type: ignore[list-item]
    sizes = [count("n_orbits", n, 1, 10**8) for n in n_orbits]  # type: ignore[union-attr]
    if sizes != sorted({*sizes}) or not sizes:
        raise ValueError(f"n_orbits={sizes} must be increasing, like [64, 1024]")
    if precision not in SECONDS_PER_KICK:
        raise ValueError(f"precision={precision!r} must be 'double' or 'single'")
    if precision == "single" and n_max > MAX_SINGLE_STEPS:
        raise ValueError(
            f"n_max={n_max} needs precision='double'; single allows {MAX_SINGLE_STEPS}"
        )
    settings = n_max, count("tile", tile, 1, 4096), precision
    return join_tiles(escapes.over_plane("escape", plane, axes, sizes, *settings))


@_recorded
def over_plane(
    function: Callable[[FloatArray], Any],
    plane: Plane | str = "two-kicks",
    first: Axis | str = "-1.1:1.1:64",
    second: Axis | str = "0:1.1:32",
    variables: Mapping[str, str] | None = None,
    seconds: float = 1e-3,
    tile: int = 8,
) -> Job:
    """Return the Job that evaluates your own function over a plane of forcings.

    The cube is named after the function.

    Parameters
    ----------
    function : callable
        Maps κ, an array of the P strengths of a forcing, to a number, or to a sequence with one
        number for each variable. The function is sent to the workers together with your own code
        that it refers to; the packages that it imports must be installed there. The cube stores a
        digest of the function's source, and of your own functions, modules and constants that it
        refers to; if any of these has changed, the existing cube is refused.
    plane : Plane or str
        The plane of forcings.
    first, second : Axis or str
        Cells along the two axes of the plane, "LO:HI:N".
    variables : mapping of str to str, optional
        Name and description of each variable; by default there is only one, with the name of
        the function and the first line of its docstring.
    seconds : float
        Expected CPU seconds per forcing; if the time is short, many forcings share a tile.
    tile : int
        Minimum number of cells along each side of a tile. If a worker dies, the work on one tile
        is lost.

    Examples
    --------
    >>> import numpy as np
    >>> import pipeline
    >>> length = {"length": "length of κ"}
    >>> job = pipeline.over_plane(np.linalg.norm, "two-kicks", "0:1:8", "0:1:6", length)
    >>> dict(job.cube.template.length.sizes), job.cube.name
    ({'kappa2': 6, 'kappa1': 8}, 'norm')
    """
    plane, axes = _plane(plane), [_axis(first), _axis(second)]
    if not callable(function):
        raise ValueError(f"function={function!r} must be a function of the strengths of a forcing")
    name = getattr(function, "__name__", type(function).__name__)
    if variables is None:
        variables = {name: (inspect.getdoc(function) or name).splitlines()[0]}
    coords = escapes.axes_of_plane(plane, axes)
    for key in (name, *variables):
        if not key.isidentifier() or key in coords:
            taken = f"{', '.join(coords)} are coordinates"
            raise ValueError(f"the name {key!r} must be a Python name; {taken}")
    if not variables:
        raise ValueError("variables is empty; give at least one name and its description")
    seconds, tile = real("seconds", seconds, 0, 1e6), count("tile", tile, 1, 4096)
    return join_tiles(
        own_function.over_plane(name, function, variables, plane, coords, tile, seconds)
    )


@_recorded
def frequency_map(
    kappa: ArrayLike,
    x: Axis | str = "0:1:256",
    y: Axis | str = "-0.25:0.75:256",
    n_max: int = 3000,
    tile: int = 16,
) -> Job:
    """Return the Job for the cube `frequency_map`: the rotation number over phase space.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    x, y : Axis or str
        Cells, "LO:HI:N"; orbits start at their centres. x is in turns, y in turns per kick.
    n_max : int
        Steps (periods of the forcing) to average over, 4 to 10⁹.
    tile : int
        Minimum number of cells along each side of a tile.

    Examples
    --------
    >>> import pipeline
    >>> job = pipeline.frequency_map((0.3, 0.2), "0:1:8", "0:0.5:4")
    >>> dict(job.cube.template.digits.sizes)
    {'y': 4, 'x': 8}
    """
    strengths, axes = forcing(kappa), [_axis(x), _axis(y)]
    n_max = count("n_max", n_max, 4, 10**9)
    tile = count("tile", tile, 1, 4096)
    return join_tiles(frequency_maps.frequency_map(strengths.tolist(), axes, n_max, tile))


@_recorded
def last_barrier(angles: ArrayLike, tol: float = 2e-5, plane: Plane | str = "two-kicks") -> Job:
    """Return the Job for the cube `barrier`: the last barrier on rays, bracketed from both sides.

    The cube contains, instead of each ray, its image with the smallest angle under the symmetries
    of the plane, and each image only once. `pipeline.cubes.barrier.unfolded(cube, angles)` returns
    all rays, with the last circles as strings.

    Parameters
    ----------
    angles : array_like
        Directions of rays, in degrees.
    tol : float
        Width of the bracket relative to the scale, 10⁻⁵ to 0.1.
    plane : Plane or str
        The plane of forcings.

    Examples
    --------
    >>> import pipeline
    >>> pipeline.last_barrier([10, 30, 60, 80]).cube.template.angle.values
    array([10., 30.])
    """
    return barriers.last_barrier(_plane(plane), _angles(angles), real("tol", tol, 1e-5, 0.1))


@_recorded
def last_barriers(profiles: Iterable[ArrayLike], tol: float = 1e-3) -> Job:
    """Return the Job for the cube `forcings`: last barriers for a list of forcings of any period.

    Parameters
    ----------
    profiles : iterable of array_like
        Strengths of the kicks of each forcing, first kick first; κ = s·profile.
    tol : float
        Width of the bracket relative to the scale, 10⁻⁵ to 0.1.

    Examples
    --------
    >>> import pipeline
    >>> job = pipeline.last_barriers([(1.0, 0.5), (1.0, 0.6, 0.2)])
    >>> job.cube.template.forcing.values.tolist()
    ['1, 0.5', '1, 0.59999999999999998, 0.20000000000000001']
    """
    rows = [("forcing", float(i), direction(row)) for i, row in enumerate(profiles)]
    if not rows:
        raise ValueError("profiles is empty; give at least one forcing, like [(1.0, 0.5)]")
    tol = real("tol", tol, 1e-5, 0.1)
    return lists.last_barriers("forcings", rows, "place in the list", tol)  # type: ignore[arg-type]


@_recorded
def breakdown(
    omegas: OmegaLike | Iterable[OmegaLike],
    angles: ArrayLike,
    tol: float | None = 1e-4,
    q_max: int = 6000,
    plane: Plane | str = "two-kicks",
) -> Job:
    """Return the Job that computes the scales at which circles break on rays.

    Parameters
    ----------
    omegas : RotationNumber or str, or several
        Irrational rotation numbers per step, like "gamma" or "[1;4,(1)]".
    angles : array_like
        Directions of rays, in degrees.
    tol : float or None
        Target error of the scale, 10⁻⁷ to 0.1. Circles are continued; where continuation does not
        reach the target, residues are used if they are more accurate; the cube is `breakdown`. If
        None, only residues are used; the cube is `breakdown_residue`.
    q_max : int
        Longest period of the orbits whose residues are used, 10 to 10⁶.
    plane : Plane or str
        The plane of forcings; continuation needs a plane whose origin is zero.

    Examples
    --------
    >>> import pipeline
    >>> job = pipeline.breakdown(["gamma", "2gamma"], [0, 10, 20])
    >>> dict(job.cube.template.critical_scale.sizes)
    {'circle': 2, 'angle': 3}
    """
    several = [omegas] if isinstance(omegas, str | RotationNumber) else omegas
    circles = sorted({_irrational(omega) for omega in several}, key=float)
    plane, rays, q_max = _plane(plane), _angles(angles).tolist(), count("q_max", q_max, 10, 10**6)
    if tol is None:
        return breakdowns.by_residue(plane, circles, rays, q_max)
    return breakdowns.by_continuation(plane, circles, rays, real("tol", tol, 1e-7, 0.1), q_max)


@_recorded
def transport(
    angles: ArrayLike, n_max: int = 10_000, n_orbits: int = 100, plane: Plane | str = "two-kicks"
) -> Job:
    """Return the Job for the cube `transport`: the onset of transport on rays, by direct iteration.

    Parameters
    ----------
    angles : array_like
        Directions of rays, in degrees.
    n_max : int
        Steps (periods of the forcing) for which each orbit is iterated, 64 to 10¹².
    n_orbits : int
        Orbits per forcing, 1 to 10⁸.
    plane : Plane or str
        The plane of forcings; its origin must be zero.

    Examples
    --------
    >>> import pipeline
    >>> pipeline.transport([0, 45]).cube.template.critical_scale.dims
    ('angle',)
    """
    n_max, n_orbits = count("n_max", n_max, 64, 10**12), count("n_orbits", n_orbits, 1, 10**8)
    return breakdowns.by_escape(_plane(plane), _angles(angles).tolist(), n_max, n_orbits)


@_recorded
def flux(barrier: xr.Dataset, excesses: ArrayLike, q_max: int = 30_000) -> Job:
    """Return the Job for the cube `flux`: the flux through the last circle beyond its breakup.

    Parameters
    ----------
    barrier : xr.Dataset
        The Dataset that `fill` returns for `last_barrier`, or that `unfolded` makes from it; rays
        without a critical scale are omitted.
    excesses : array_like
        Relative distances s/s_c - 1 > 0 beyond the breakup at s_c.
    q_max : int
        Longest period of the orbits, 100 to 10⁶; 10 divided by the smallest excess is enough.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.cubes.barrier import boundary
    >>> barrier = boundary([30], tol=1e-2)  # or what fill returns for last_barrier
    >>> dict(pipeline.flux(barrier, [0.1, 0.2]).cube.template.flux.sizes)
    {'angle': 1, 'excess': 2}
    """
    plane, scales, circles = _breakups(barrier)
    q_max = count("q_max", q_max, 100, 10**6)
    return beyond.flux(plane, scales, circles, _excesses(excesses), q_max)


@_recorded
def diffusion(
    barrier: xr.Dataset, excesses: ArrayLike, n_orbits: int = 256, n_max: int = 2**24
) -> Job:
    """Return the Job for the cube `diffusion`: diffusion of momentum beyond the last barrier.

    Parameters
    ----------
    barrier : xr.Dataset
        As for `flux`; its plane must be `two-kicks`.
    excesses : array_like
        Relative distances s/s_c - 1 > 0 beyond the breakup at s_c.
    n_orbits : int
        Orbits per forcing, 64 to 10⁶.
    n_max : int
        Longest time, in steps (periods of the forcing), 2¹³ to 10¹².

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.cubes.barrier import boundary
    >>> barrier = boundary([30], tol=1e-2)  # or what fill returns for last_barrier
    >>> dict(pipeline.diffusion(barrier, [0.1, 0.2]).cube.template.diffusion.sizes)
    {'angle': 1, 'excess': 2}
    """
    plane, scales, _ = _breakups(barrier)
    if plane != two_kicks():
        raise ValueError(f"barrier is in the plane {plane.name}; diffusion needs two-kicks")
    n_orbits, n_max = count("n_orbits", n_orbits, 64, 10**6), count("n_max", n_max, 2**13, 10**12)
    return beyond.diffusion(scales, _excesses(excesses), n_orbits, n_max)


@_recorded
def tori(vectors: Iterable[tuple[float, float]], angles: ArrayLike, tol: float = 1e-3) -> Job:
    """Return the Job for the cube `tori`: breakup of tori in rotating maps with irrational Ω.

    Parameters
    ----------
    vectors : iterable of (ω, Ω)
        Rotation number of the torus and frequency of the forcing, in turns per kick.
    angles : array_like
        Directions of rays in the (κ̄, Δκ) plane, in degrees.
    tol : float
        Target error of the scale, 10⁻⁴ to 0.1.

    Examples
    --------
    >>> import pipeline
    >>> job = pipeline.tori([(0.618, 0.414)], [0, 45])
    >>> dict(job.cube.template.critical_scale.sizes)
    {'vector': 1, 'angle': 2}
    """
    pairs = [(real("omega", omega), real("frequency", rate)) for omega, rate in vectors]
    if not pairs:
        raise ValueError("vectors is empty; give at least one, like [(0.618, 0.414)]")
    tol = real("tol", tol, 1e-4, 0.1)
    return rotating_maps.breakups(pairs, _angles(angles).tolist(), tol)


@_recorded
def proved_barrier(
    angles: ArrayLike, seconds: float = 8.0, plane: Plane | str = "two-kicks"
) -> Job:
    """Return the Job for the cube `proved_barrier`: proved bounds on the onset of transport.

    Computing it needs the extra `proof`. The theorems are in nasm/proofs/README.md.

    Parameters
    ----------
    angles : array_like
        Directions of rays, in degrees.
    seconds : float
        CPU time for each proof on each ray, 0.1 to 10⁴. The bounds depend on the speed of the
        machine, but each of them is valid.
    plane : Plane or str
        The plane of forcings; its origin must be zero.

    Examples
    --------
    >>> import pipeline
    >>> job = pipeline.proved_barrier([10, 80])
    >>> [name for name in job.cube.computed if name.startswith("proved")]
    ['proved_below', 'proved_lower', 'proved_upper']
    """
    seconds = real("seconds", seconds, 0.1, 1e4)
    return proved.proved_barrier(_plane(plane), _angles(angles), seconds)


def _plane(plane: Plane | str) -> Plane:
    """Return the Plane that a string describes; return a Plane unchanged."""
    if not isinstance(plane, Plane | str):
        raise ValueError(f"plane={plane!r} must be a Plane or a string like 'two-kicks'")
    return planes.parse(plane) if isinstance(plane, str) else plane


def _axis(axis: Axis | str) -> Axis:
    """Return the Axis that a string describes; return an Axis unchanged."""
    return axis if isinstance(axis, Axis) else parse_axis(axis)


def _angles(angles: ArrayLike) -> FloatArray:
    """Return the distinct angles in increasing order."""
    values = np.unique(np.atleast_1d(floats("angles", angles)))
    if not (values.size and np.isfinite(values).all()):
        reason = "must be one or more finite directions in degrees"
        raise ValueError(f"angles={values.tolist()} {reason}")
    return values


def _irrational(omega: OmegaLike) -> RotationNumber:
    """Return omega as a RotationNumber; raise ValueError if it is rational."""
    number = parse(omega) if isinstance(omega, str) else omega
    if number.is_rational:
        raise ValueError(
            f"omega={omega} is rational, so no invariant circle has this rotation number; use an "
            "irrational number with a periodic continued fraction, like [0;2,(1)]"
        )
    return number


def _excesses(excesses: ArrayLike) -> list[float]:
    """Return the distinct positive excesses in increasing order."""
    values = np.unique(np.atleast_1d(floats("excesses", excesses)))
    if not (values.size and values[0] > 0 and np.isfinite(values).all()):
        reason = "must be finite and positive: scales relative to the breakup, minus 1"
        raise ValueError(f"excesses={values.tolist()} {reason}")
    return values.tolist()


def _breakups(barrier: xr.Dataset) -> tuple[Plane, Mapping[float, float], Mapping[float, str]]:
    """Return the plane of a cube of last barriers, and the scale and circle at each angle."""
    try:
        plane = plane_of(barrier.attrs)
        named = barriers.with_circles(barrier) if "quotients" in barrier else barrier.load()
        table = named.dropna("angle", subset=["critical_scale"])
        scales, circles = (table[key].to_series().to_dict() for key in ("critical_scale", "circle"))
    except (AttributeError, KeyError, ValueError):
        cure = "pass the Dataset that fill returns for last_barrier"
        raise ValueError(f"barrier is not a cube of last barriers; {cure}") from None
    if not scales:
        raise ValueError("barrier has no ray with a critical scale; compute it on other rays")
    return plane, scales, circles
