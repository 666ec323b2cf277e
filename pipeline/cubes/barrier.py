"""The last barrier on rays: CB_gt, bracketed from both sides, and the circle that breaks last.

The rays lie in a plane of forcings; see arXiv:1606.04824, Sec. V and VI. CB_gt has the symmetries
of its plane (Sec. III and `nasm.planes`), so each computed ray also represents its images.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from nasm import barriers, symmetries
from nasm.numbers import RotationNumber, moebius, parse
from nasm.planes import Plane, plane_of, two_kicks
from nasm.results import CriticalScale
from nasm.types import FloatArray
from pipeline.cubes.breakdown import job_on_rays, on_rays, scale_arrays
from pipeline.cubes.cube import (
    NO_MEAN,
    Arrays,
    Coords,
    Job,
    Labels,
    Settings,
    angles_of_rays,
    blank,
    coordinate,
    text,
)
from pipeline.cubes.warm_up import load_search, load_searches

_MAX_QUOTIENTS = 32  # maximum number of partial quotients of a rotation number


def last_barrier(plane: Plane, angles: ArrayLike, tol: float, name: str = "barrier") -> Job:
    """Return the Job for the cube `barrier`, which also contains the exact ω as partial quotients.

    Parameters
    ----------
    plane : Plane
        The plane of forcings.
    angles : array_like
        Directions of rays, in degrees; the cube contains the rays onto which the plane's
        symmetries fold them.
    tol : float
        Relative width of the bracket.
    name : str
        Name of the cube; in a store, cubes of different planes need different names (`cube_name`).

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from pipeline.cubes.barrier import last_barrier
    >>> job = last_barrier(two_kicks(), [10, 30, 60, 80], tol=1e-3)
    >>> job.cube.template.angle.values
    array([10., 30.])
    """
    is_short = len(plane.origin) <= 2  # longer forcings have period 1 or 2 on some rays
    warm_up = partial(load_search, sum(plane.ray(30.0))) if is_short else load_searches
    seconds = 0.08 + 1e-5 / tol if is_short else 0.4 + 3.5e-5 / tol  # the latter is for P = 3
    seconds *= (min(max(len(plane.origin), 3), 16) / 3) ** 1.5
    return job_of_barriers(name, plane, angles, seconds, {"tol": tol}, _compute, warm_up)


def job_of_barriers(
    name: str,
    plane: Plane,
    angles: ArrayLike,
    seconds: float,
    settings: Settings,
    compute: Callable[[Coords, Settings], Arrays],
    warm_up: Callable[[], object],
    more: Mapping[str, str] | None = None,
) -> Job:
    """Return the Job for a cube of last barriers.

    Parameters
    ----------
    angles : array_like
        As for `last_barrier`.
    more : mapping of str to str, optional
        Names and long names of additional variables.
    name, plane, seconds, settings, compute, warm_up
        As for `breakdown.job_on_rays`.
    """
    folded = sorted(set(plane.fold(angles)[0].tolist()))
    on_ray = {"angle": angles_of_rays(folded)}
    further = {key: blank(on_ray, long_name) for key, long_name in (more or {}).items()}
    return job_on_rays(
        name,
        plane.axes,
        rows={},
        angles=folded,
        seconds=seconds,
        settings=plane.record | settings,
        compute=compute,
        warm_up=warm_up,
        title="The last barrier to transport",
        more=last_circles(on_ray) | further,
    )


def last_circles(on: Labels) -> Labels:
    """Return the variables that describe last circles, without values, over coordinates `on`."""
    quotients = range(_MAX_QUOTIENTS)
    place = {"quotient": coordinate("quotient", quotients, "index of a partial quotient")}
    step, omega = f"jumps from circle to circle; {NO_MEAN}", "rotation number of the last circle"
    ends, tail = f"0 after the last one; {NO_MEAN}", "number of partial quotients that repeat"
    return place | {
        "omega": blank(on, f"{omega}, per step", comment=step),
        "quotients": blank(place | on, "partial quotients of omega", np.int32(0), comment=ends),
        "tail_length": blank(on, tail, np.int8(0), comment=NO_MEAN),
    }


def cube_name(plane: Plane) -> str:
    """Return the name of the cube of last barriers in a store that covers several planes.

    Examples
    --------
    >>> from nasm.planes import rotating
    >>> from pipeline.cubes.barrier import cube_name
    >>> cube_name(rotating("1/3", "1/60"))
    'barrier_rotating_1_3_1_60'
    """
    return re.sub(r"\W+", "_", f"barrier_{plane.name}", flags=re.ASCII)


def boundary(angles: ArrayLike, tol: float = 1e-4, plane: Plane | None = None) -> xr.Dataset:
    """Compute CB_gt on rays at any angles, without workers or a store.

    Parameters
    ----------
    angles : array_like
        Directions of the rays, in degrees.
    tol : float
        Relative width of the bracket, 1e-5 to 0.1.
    plane : Plane, optional
        The plane of forcings; `nasm.planes.two_kicks()` by default.

    Returns
    -------
    xr.Dataset, dim (angle)
        As returned by `unfolded`.

    Notes
    -----
    A ray that is not the image of another ray takes 0.2 s of CPU time at tol 1e-4, and 0.6 s at
    2e-5.

    Examples
    --------
    >>> from pipeline.cubes.barrier import boundary
    >>> cb = boundary([30.0, 60.0], tol=1e-2)
    >>> print(*cb.circle.values)
    [0;1,2,(1)] [0;1,2,(1)]
    """
    cube = last_barrier(plane or two_kicks(), angles, tol).cube
    filled = cube.filled(_compute({"angle": cube.template.angle.values}, cube.settings))
    return unfolded(filled.assign_attrs(cube.attributes), angles)


def unfolded(barrier: xr.Dataset, angles: ArrayLike) -> xr.Dataset:
    """Unfold the cube `barrier` onto rays whose images under the symmetries are in the cube.

    Parameters
    ----------
    barrier : xr.Dataset
        The cube.
    angles : array_like
        Directions of rays, in degrees.

    Returns
    -------
    xr.Dataset, dim (angle)
        The coordinate `circle` is the exact ω of the last circle, in [0, P/2], as a string; ""
        where it is unknown (or NaN, if the cube was read from a store). The circle with rotation
        number P - ω is its mirror image. `tied` is the ω of a circle that breaks at the same scale
        by symmetry, as on the axes of the plane of two kicks; "" elsewhere.
    """
    angles, plane = np.asarray(angles, dtype=float), plane_of(barrier.attrs)
    folded, shifts = plane.fold(angles)
    images = barrier.sel(angle=folded, method="nearest", tolerance=1e-8)
    images = with_circles(images, shifts.tolist(), "step")
    circles, scales = images.circle.values, images.critical_scale.values
    partners = _degenerate_circles(plane, circles, angles, scales)
    tied = text("angle", partners, "rotation number of a circle that breaks at the same scale")
    table = on_rays(images.assign_coords(tied=tied), plane, angles)
    table["omega"] = table.omega.copy(data=np.where(shifts, shifts - table.omega, table.omega))
    return table


def with_circles(
    cube: xr.Dataset, shifts: Iterable[int] | None = None, per: str = "period"
) -> xr.Dataset:
    """Load the cube, and return it with the coordinate `circle` in place of the partial quotients.

    Parameters
    ----------
    cube : xr.Dataset
        A cube with the variables of `last_circles`, over one dimension.
    shifts : iterable of int, optional
        Where the shift is not 0, `circle` is shift - ω.
    per : str
        Unit of time in which ω is expressed, for the label.

    Returns
    -------
    xr.Dataset
        `circle` is the exact ω of the last circle, as a string; "" where it is unknown.
    """
    circles, (dim,) = [], cube.load().tail_length.dims
    shifts = [0] * cube.sizes[dim] if shifts is None else shifts
    entries = cube.quotients.values.T.tolist(), cube.tail_length.values.tolist(), shifts
    for quotients, length, shift in zip(*entries, strict=True):
        quotients = tuple(np.trim_zeros(quotients, "b"))
        omega = quotients and RotationNumber(quotients[:-length], quotients[-length:])
        circles.append(str(moebius(omega, -1, shift) if omega and shift else omega or ""))
    circle = text(str(dim), circles, f"exact rotation number of the last circle, per {per}")
    return cube.drop_vars(["quotients", "tail_length", "quotient"]).assign_coords(circle=circle)


def degenerate_circle(plane: Plane, circle: str, angle: float, scale: float) -> str:
    """Return the ω of the circle that is degenerate with `circle` by symmetry, as a string.

    Return "" if there is no such circle.

    Parameters
    ----------
    plane : Plane
        The plane of forcings.
    circle : str
        Rotation number as a string; "" if it is unknown.
    angle : float
        Direction of the ray, in degrees.
    scale : float
        Scale at which the circle breaks.
    """
    start, profile = plane.ray(angle)
    return (
        str(symmetries.degenerate_partner(parse(circle), start + scale * profile) or "")
        if circle
        else ""
    )


def _degenerate_circles(
    plane: Plane, circles: Sequence[str], angles: FloatArray, scales: FloatArray
) -> list[str]:
    """Return `degenerate_circle` for many rays; it is called only for the few that can have one."""
    start, profiles = plane.ray(angles)
    kappas = start + scales[:, None] * profiles
    turned = [kappa for turn, kappa in symmetries.equivalent_forcings(kappas) if turn]
    is_itself = np.any([(kappa == kappas).all(axis=1) for kappa in turned], axis=0)
    rays = zip(np.broadcast_to(is_itself, scales.shape), circles, angles, scales, strict=True)
    return [degenerate_circle(plane, *ray) if itself else "" for itself, *ray in rays]


def _compute(coords: Coords, settings: Settings) -> Arrays:
    """Compute the last barriers on the rays of a tile."""
    plane, tol = plane_of(settings), settings["tol"]
    start, profiles = plane.ray(coords["angle"])
    brackets = [barriers.critical_scale(profile, tol, start) for profile in profiles]
    return scale_arrays(brackets, plane.axes, coords["angle"]) | circle_arrays(brackets)


def circle_arrays(brackets: Sequence[CriticalScale]) -> Arrays:
    """Return the values of the variables of `last_circles` for the given last barriers."""
    omegas = [bracket.omega for bracket in brackets]
    parts = [(omega.prefix, omega.tail) if omega else ((), ()) for omega in omegas]
    rows = [[*prefix, *tail] for prefix, tail in parts]
    padded = [row + [0] * (_MAX_QUOTIENTS - len(row)) for row in rows]
    return {
        "omega": np.array([omega and float(omega) for omega in omegas], dtype=float),
        "quotients": np.array(padded, np.int32).T,
        "tail_length": np.array([len(tail) for _, tail in parts], np.int8),
    }
