"""Breakup on rays: the scale at which a circle, or the last barrier, breaks on each ray of a plane.

On a ray, κ = origin + s·(cos angle · first + sin angle · second); see `nasm.planes`. The dims of a
cube are (row, angle), where a row is a circle or a frequency; a cube without rows has the dim
(angle). Angles are in degrees. See arXiv:1606.04824, Sec. VI.

Close to cusps, and for rotation numbers with large quotients, continuation runs out of modes before
it reaches the tolerance. In these cases, residues of long orbits may still reach it. The variable
`method` names the method that produced the result.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from math import ceil, floor
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from nasm import escape, periodic
from nasm.circles import continuation
from nasm.numbers import RotationNumber, moebius, parse
from nasm.planes import Plane, plane_of
from nasm.results import CriticalScale, Status
from nasm.symmetries import ray
from nasm.types import FloatArray, IntArray, OmegaLike
from pipeline.cubes import cube
from pipeline.cubes.cube import (
    FLAGS,
    STATUS_SETTING,
    Arrays,
    Coords,
    Job,
    Labels,
    Settings,
    blank,
    coordinate,
)
from pipeline.cubes.escape import SECONDS_PER_KICK
from pipeline.cubes.warm_up import in_own_order, load_orbits

_SCALES = {  # variable: field of CriticalScale, long_name
    "critical_scale": ("value", "scale of the breakup, best estimate"),
    "error": ("error", "estimated absolute error of critical_scale"),
    "lower": ("lower", "scale at which the barrier was shown to exist"),
    "upper": ("upper", "scale at which the barrier was shown not to exist"),
}
_TILE_SECONDS = 3  # CPU time of a tile; shorter tiles would make too many files
_FLAG_OF = {  # CriticalScale.method: its flag in the variable `method`
    continuation.METHOD: "continuation",
    periodic.METHOD: "residue",
    escape.METHOD: "direct_iteration",
}


def continued_or_by_residue(
    omega: OmegaLike, profile: ArrayLike, tol: float, q_max: int
) -> CriticalScale:
    """Compute the scale at which the circle of ω breaks on the ray κ = s·profile.

    Continuation is used if it reaches an error of tol; otherwise Greene's residue is used, for
    periods up to q_max, unless it fails too or has a larger error. `lower` always comes from
    continuation: it is the scale of a certified circle.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per step (one period of the forcing).
    profile : array_like, shape (P,)
        Strengths of the kicks, divided by s.
    tol : float
        Target absolute error of the scale.
    q_max : int
        Longest period of the orbits.
    """
    continued = continuation.critical_scale(omega, profile, tol)
    if continued.error <= tol:
        return continued
    by_orbits = periodic.critical_scale(omega, profile, q_max)
    better = by_orbits.status is Status.OK and not continued.error <= by_orbits.error
    return replace(by_orbits, lower=continued.lower) if better else continued


_CONTINUED = f"{continuation.METHOD}, else {periodic.METHOD}"
# For each method: its function, and settings for the fastest possible run, used to compile it.
_METHODS: dict[str, tuple[Callable[..., CriticalScale], Settings]] = {
    _CONTINUED: (continued_or_by_residue, {"tol": 0.1, "q_max": 10}),
    periodic.METHOD: (periodic.critical_scale, {"q_max": 10}),
    escape.METHOD: (escape.critical_scale, {"n_max": 64, "n_orbits": 1}),
}


def by_continuation(
    plane: Plane,
    omegas: Sequence[RotationNumber],
    angles: Sequence[float],
    tol: float,
    q_max: int = 6000,
) -> Job:
    """Return the Job for the cube `breakdown`: circles continued to their breakup.

    Where continuation does not reach the error tol, residues for periods up to q_max are used if
    they are more accurate; see `continued_or_by_residue`.

    Raises
    ------
    ValueError
        If the origin of the plane is not zero.

    Examples
    --------
    >>> from nasm.numbers import parse
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.breakdown import by_continuation
    >>> job = by_continuation(two_kicks(), [parse("gamma")], [0.0, 10.0], tol=1e-3)
    >>> dict(job.cube.template.critical_scale.sizes)
    {'circle': 1, 'angle': 2}
    """
    plane.rays_start_at_zero(continuation.METHOD)
    settings = {"method": _CONTINUED, "tol": tol, "q_max": q_max}
    # A fifth of the main job's rays need residues; with a smaller tol nearly all do.
    seconds = 0.03 if tol >= 1e-4 else 0.1
    job = _job("breakdown", plane, _circles(omegas), angles, seconds, settings)
    return replace(job, predict=partial(_predict_continuation, job.predict))


def _predict_continuation(
    predict: Callable[[Coords, Settings], float], coords: Coords, settings: Settings
) -> float:
    """Predict CPU seconds of a tile from `predict`, the prediction for the mean of all circles.

    The mean is that of the paper's circles. Golden circles take two thirds as long. Circles with a
    tail of fours, whose breakup is resolved only with more modes, take 2.6 times as long as golden
    ones.
    """
    is_golden = [parse(circle).tail == (1,) for circle in coords["circle"]]
    return predict(coords, settings) * float(np.where(is_golden, 0.65, 1.7).sum())


def by_residue(
    plane: Plane, omegas: Sequence[RotationNumber], angles: Sequence[float], q_max: int
) -> Job:
    """Return the Job for the cube `breakdown_residue`: Greene's residue for periods up to q_max.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.numbers import parse
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.breakdown import by_residue
    >>> job = by_residue(two_kicks(), [parse("gamma")], [30.0], q_max=100)
    >>> tile = {"circle": np.array(["gamma"]), "angle": np.array([30.0])}
    >>> job.compute(tile, job.cube.settings)["critical_scale"].round(2)
    array([[0.69]])
    """
    settings = {"method": periodic.METHOD, "q_max": q_max}
    seconds = 0.045 if len(plane.origin) <= 2 else 0.16  # P > 2 needs two families of orbits
    return _job("breakdown_residue", plane, _circles(omegas), angles, seconds, settings)


def folded(
    plane: Plane, omegas: Sequence[RotationNumber], angles: ArrayLike
) -> tuple[list[RotationNumber], list[float]]:
    """Choose circles and rays whose breakups include those of all `omegas` on all `angles`.

    The rays are those of `Plane.fold`. A circle may be replaced by another one on the folded ray,
    like ω by ω + 1 for two kicks; these circles are added to `omegas`, unless they are equivalent
    to one of them.

    Examples
    --------
    >>> from nasm.numbers import parse
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.breakdown import folded
    >>> folded(two_kicks(), [parse("gamma")], [60, 120])
    ([parse("[0;(1)]"), parse("[1;(1)]")], [30.0])
    """
    rays, shifts = plane.fold(angles)
    circles: dict[RotationNumber, RotationNumber] = {}
    for shift, omega in product(sorted({*shifts.tolist()}), omegas):
        image = moebius(omega, 1, shift)
        circles.setdefault(_equivalent(plane, image), image)
    return list(circles.values()), sorted({*rays.tolist()})


def unfolded(
    breakups: xr.Dataset, omegas: Sequence[RotationNumber], angles: ArrayLike
) -> xr.Dataset:
    """Unfold a cube of the `folded` circles and rays onto all circles and rays.

    Parameters
    ----------
    breakups : xr.Dataset
        The cube.
    omegas, angles
        As for `folded`.

    Returns
    -------
    xr.Dataset, dims (circle, angle)
        The variables of the cube, for all `omegas` on all `angles`.
    """
    plane = plane_of(breakups.attrs)
    rays, shifts = plane.fold(angles)
    rows = [_equivalent(plane, parse(circle)) for circle in breakups.circle.values.tolist()]
    row_of = {  # of each of the few shifts, in the order of `omegas`
        shift: [rows.index(_equivalent(plane, moebius(omega, 1, shift))) for omega in omegas]
        for shift in {*shifts.tolist()}
    }
    row = np.transpose([row_of[shift] for shift in shifts.tolist()])
    at_rays = breakups.load().sel(angle=rays, method="nearest", tolerance=1e-8)
    values = at_rays.drop_vars(["circle", "omega", "angle"])
    images = values.isel(circle=(("circle", "angle"), row), angle=("angle", range(len(rays))))
    return on_rays(images.assign_coords(_circles(omegas)), plane, angles)


def on_rays(images: xr.Dataset, plane: Plane, angles: ArrayLike) -> xr.Dataset:
    """Return breakups of equivalent rays with the angles, and strengths, of the rays themselves."""
    table = images.assign_coords(angle=cube.angles_of_rays(angles))
    for name, direction in zip(plane.axes, ray(angles).T, strict=True):
        table[name] = table[name].copy(data=table.critical_scale.values * direction)
    return table


def _equivalent(plane: Plane, omega: RotationNumber) -> RotationNumber:
    """Return the smallest ±ω + nP ≥ 0: circles with these rotation numbers break together."""
    period = len(plane.origin)
    turns = ((sign, -period * floor(sign * float(omega) / period)) for sign in (1, -1))
    return min((moebius(omega, *turn) for turn in turns), key=float)


def by_escape(plane: Plane, angles: Sequence[float], n_max: int, n_orbits: int) -> Job:
    """Return the Job for the cube `transport`: the onset of transport within n_max steps.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.breakdown import by_escape
    >>> job = by_escape(two_kicks(), [0.0, 45.0], n_max=1000, n_orbits=100)
    >>> job.cube.template.critical_scale.dims
    ('angle',)
    """
    settings = {"method": escape.METHOD, "n_max": n_max, "n_orbits": n_orbits}
    plane.rays_start_at_zero(escape.METHOD)
    # The ensemble is iterated at about 20 scales.
    seconds = 20 * SECONDS_PER_KICK["double"] * len(plane.origin) * n_orbits * n_max
    return _job("transport", plane, {}, angles, seconds, settings)


def job_on_rays(
    name: str,
    axes: Mapping[str, str],
    rows: Labels,
    angles: Sequence[float],
    seconds: float,
    settings: Settings,
    compute: Callable[[Coords, Settings], Arrays],
    warm_up: Callable[[], object],
    title: str,
    more: Mapping[str, xr.Variable] | None = None,
    n_distinct: Callable[[FloatArray], int] = len,
) -> Job:
    """Return the Job for a cube of critical scales; a tile contains several rays of one row.

    Parameters
    ----------
    name : str
        Name of the cube.
    axes : mapping of str to str
        Long name of each coordinate of the plane; the cube contains the values of these coordinates
        at the breakup.
    rows : dict of str to xr.Variable
        Coordinates of the rows, the dimension coordinate first; {} for a cube with dim (angle).
    angles : sequence of float
        Directions of the rays, in degrees.
    seconds : float
        CPU seconds for each distinct ray.
    settings, compute, warm_up
        As for `cube.Cube` and `cube.Job`.
    title : str
        Title of the cube.
    more : mapping of str to xr.Variable, optional
        Additional variables of the cube.
    n_distinct : callable
        Maps the angles of a tile to the number of rays that `compute` evaluates.
    """
    known = {**rows, "angle": cube.angles_of_rays(angles)}
    variables = blank_scales(known) | dict(more or {})
    coords = known | {key: blank(known, f"{label} at the breakup") for key, label in axes.items()}
    tile = {str(dim): 1 for dim in variables["status"].dims}
    tile["angle"] = _tile_size(known["angle"].values, lambda part: seconds * n_distinct(part))
    labels = {"title": f"{title} of the nonautonomous standard map"}
    plan = cube.Cube(name, xr.Dataset(variables, coords, labels), tile, settings | STATUS_SETTING)
    return Job(plan, compute, lambda coords, _: seconds * n_distinct(coords["angle"]), warm_up)


def _tile_size(angles: FloatArray, seconds: Callable[[FloatArray], float]) -> int:
    """Return the number of rays of each tile but the last, which may be smaller.

    It is the largest number for which no tile takes longer than `_TILE_SECONDS`, or 1, reduced as
    far as the number of tiles stays the same.
    """
    limit, n_rays = _TILE_SECONDS * (1 + 1e-9), angles.size

    def takes_too_long(size: int) -> bool:
        return any(seconds(angles[i : i + size]) > limit for i in range(0, n_rays, size))

    size = ceil(n_rays / ceil(seconds(angles) / limit))
    while size > 1 and takes_too_long(size):
        size -= 1
    return ceil(n_rays / ceil(n_rays / size))


def blank_scales(known: Mapping[str, xr.Variable]) -> Labels:
    """Return variables for a CriticalScale, without values, over the dimensions in `known`."""
    variables = {key: blank(known, label) for key, (_, label) in _SCALES.items()}
    return variables | {"status": blank(known, "outcome", np.int8(0), **FLAGS)}


def scale_fields(answers: Sequence[Any]) -> Arrays:
    """Return arrays for the variables of `blank_scales`, from nested lists of CriticalScale."""
    return cube.field_arrays(answers, {key: field for key, (field, _) in _SCALES.items()})


def scale_arrays(answers: Sequence[Any], axes: Iterable[str], angles: ArrayLike) -> Arrays:
    """Return the arrays of critical scales, and the strengths at the breakup.

    Parameters
    ----------
    answers : nested lists of CriticalScale
        The last dimension runs over the rays.
    axes : iterable of str
        Names of the plane's coordinates.
    angles : array_like
        Directions of the rays, in degrees.
    """
    arrays = scale_fields(answers)
    for name, direction in zip(axes, ray(angles).T, strict=True):
        arrays[name] = arrays["critical_scale"] * direction
    return arrays


def _circles(omegas: Sequence[RotationNumber]) -> Labels:
    """Return the row coordinates of a cube whose rows are circles."""
    return {
        "circle": cube.text("circle", map(str, omegas), "exact rotation number per step"),
        "omega": coordinate("circle", list(map(float, omegas)), "rotation number per step"),
    }


def _job(
    name: str,
    plane: Plane,
    rows: Labels,
    angles: Sequence[float],
    seconds: float,
    settings: Settings,
) -> Job:
    """Return the Job for critical scales computed by the method named in the settings."""
    first_ray = {key: row.values[:1] for key, row in rows.items()} | {"angle": np.array(angles[:1])}
    settings = plane.record | settings
    warm_up = partial(_load, first_ray, settings | _METHODS[settings["method"]][1])
    on = {**rows, "angle": cube.angles_of_rays(angles)}
    label = "method that gave the value or, if there is none, the status"
    more = {"method": blank(on, label, np.int8(0), **cube.flags(_FLAG_OF.values()))}
    title = "Breakup of circles"
    method = settings["method"]
    return job_on_rays(
        name, plane.axes, rows, angles, seconds, settings, _compute, warm_up, title, more,
        lambda part: _distinct_rays(plane, method, part)[0].size,
    )  # fmt: skip


def _load(coords: Coords, settings: Settings) -> None:
    """Compile the kernels of a method by running it with minimal effort."""
    minimal = partial(_compute, coords, settings)
    if settings["method"] == escape.METHOD:
        minimal()
    else:
        in_own_order(load_orbits, minimal)


def _distinct_rays(plane: Plane, method: str, angles: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the angles at which a method is evaluated, and the index of each ray's angle.

    A circle breaks at the same scale on rays that are images of each other, but its orbits, which
    are started at the same points on each ray, may escape at different times.
    """
    folded = angles if method == escape.METHOD else plane.fold_keeping_circles(angles)
    return np.unique(folded, return_inverse=True)


def _compute(coords: Coords, settings: Settings) -> Arrays:
    """Compute a tile: several rays of one row, or of a cube without rows."""
    (method, effort), plane = _METHODS[settings["method"]], plane_of(settings)
    folded, where = _distinct_rays(plane, settings["method"], coords["angle"])
    start, profiles = plane.ray(folded)
    more = [settings[name] for name in effort] + ([start] if start.any() else [])
    rows = [[parse(circle)] for circle in coords["circle"]] if "circle" in coords else [[]]
    on_distinct: Any = [[method(*row, profile, *more) for profile in profiles] for row in rows]
    answers: Any = [[row[i] for i in where] for row in on_distinct]
    answers = answers if "circle" in coords else answers[0]
    methods = cube.codes(answers, lambda answer: 1 + [*_FLAG_OF].index(answer.method))
    return scale_arrays(answers, plane.axes, coords["angle"]) | {"method": methods}
