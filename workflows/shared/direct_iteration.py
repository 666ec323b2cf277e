"""Direct iteration on rays: beyond which excess x in s = s_c·(1 + x) do orbits escape?

Let n* be the first escape time. The bias s_N/s_c - 1 of the boundary s_N of {n* ≤ N} falls like
N^(-1/η).
"""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from nasm import orbits
from nasm.arithmetic.reproducible import geometric
from nasm.planes import Plane, plane_of
from nasm.symmetries import ray
from nasm.types import FloatArray, IntArray
from nasm.verdicts import verdict
from pipeline.cubes.beyond import escape_times, steps_beyond
from pipeline.cubes.cube import Job, angles_of_rays
from workflows.shared import power_law
from workflows.shared.run import Run
from workflows.shared.tables import dataset, described, strengths

INSETS = ((0.526, 0.69), (0.526, 0.73), (-0.69, 0.525), (-0.73, 0.525))
INSET_START = (0.5, 0.44)
INSET_STEPS = 3_000_000
_PIXELS = 400


def steps_up_to(n_max: int) -> IntArray:
    """Return up to 33 step numbers from 100 to n_max, evenly spaced on a logarithmic scale."""
    return np.unique(np.rint(np.geomspace(100, n_max, 33)).astype(int))


def bias_job(plane: Plane, scales: Mapping[float, float], sizes: Sequence[int], n_max: int) -> Job:
    """Return the job for the cube `escape_rays`: excesses from 1% to 100%, sixty per decade.

    scales : {angle: critical scale}. sizes : sizes of the nested ensembles.
    """
    excesses = geometric(0.01, 1, 121)
    return escape_times("escape_rays", plane, scales, excesses, sizes, n_max)  # type: ignore[arg-type]


def boundary_job(plane: Plane, scales: Mapping[float, float], n_max: int, n_orbits: int) -> Job:
    """Return the job for `direct_boundary`: one ensemble, thirty excesses per decade from 1%."""
    excesses = geometric(0.01, 1, 61)
    return escape_times("direct_boundary", plane, scales, excesses, [n_orbits], n_max)  # type: ignore[arg-type]


def sweep_inwards(run: Run, job: Job) -> xr.Dataset:
    """Sweep the job's cube from the largest excess inwards.

    On each ray the sweep stops at the first excess at which no orbit escapes.
    """
    rays = range(job.cube.template.sizes["angle"])
    for excess in reversed(range(job.cube.template.sizes["excess"])):
        cube = run.sweep(job, {(ray, excess) for ray in rays})
        times = cube.escape_time[-1, :, excess].values
        rays = [ray for ray in rays if times[ray] <= job.cube.settings["n_max"]]
        if not rays:
            break
    return cube.load()


def estimate_tiles(
    plane: Plane, angles: Sequence[float], n_max: int, n_orbits: int
) -> tuple[Job, set[tuple[int, int]]]:
    """Return a job like the one from `boundary_job`, and the tiles that `sweep_inwards` will need.

    The estimate assumes that the bias of direct iteration falls like N^(-1/3).
    """
    job = boundary_job(plane, dict.fromkeys(angles, 1.0), n_max, n_orbits)
    steps = steps_beyond(job.cube.template.excess.values)
    first = np.flatnonzero(steps >= n_max)[-1:].sum()  # largest excess without escape
    return job, set(product(range(len(angles)), range(int(first), steps.size)))


def direct_bias(cube: xr.Dataset, steps: ArrayLike) -> xr.DataArray:
    """Find the bias κ_N/κ_c - 1: the excess above which orbits always escape within N steps.

    Parameters
    ----------
    cube : xarray.Dataset
        `escape_time`, dims (ensemble, angle, excess). A missing value counts as no escape.
    steps : int array
        The step numbers N.

    Returns
    -------
    xarray.DataArray
        Dims (ensemble, angle, n); NaN where the bias is not between two excesses of the cube.
    """
    n = xr.DataArray(steps, {"n": ("n", steps, described("steps"))}, "n")
    escaped = (cube.escape_time <= n).isel(excess=slice(None, None, -1))
    beyond = escaped.cumprod("excess").astype(bool)
    bias = cube.excess.where(beyond).min("excess")
    # The boundary is off the grid if orbits escape at every excess, or not even at the largest.
    known = beyond.any("excess") & ~beyond.all("excess")
    label = "boundary of n* <= N, relative to the breakup, minus 1"
    return bias.where(known).rename("bias").assign_attrs(described(label))


def exponent(n: FloatArray, bias: FloatArray) -> tuple[float, float]:
    """Fit bias ~ n^(-1/η) by a straight line through the logarithms.

    Return η and its standard error; both are NaN if fewer than four biases are known, or if the
    biases do not decrease.
    """
    slope, error = power_law.exponent(n, bias)
    return (-1 / slope, error / slope**2) if slope < 0 else (np.nan, np.nan)


def boundary_dataset(escapes: xr.Dataset, barrier: xr.Dataset, steps: Sequence[int]) -> xr.Dataset:
    """Find the boundary {n* ≤ N} on rays.

    Parameters
    ----------
    escapes : xarray.Dataset
        The cube computed by the job from `boundary_job`.
    barrier : xarray.Dataset
        `critical_scale`, the breakup s_c on the same rays.
    steps : sequence of int
        The step numbers N.

    Returns
    -------
    xarray.Dataset
        Dims (n, angle). `critical_scale` is s_N, `bias` is s_N/s_c - 1; `resolution` is the
        spacing of the cube's grid: s_N might be smaller by up to this spacing.
    """
    plane = plane_of(escapes.attrs)
    breakup, angle = barrier.critical_scale.values, escapes.angle.values
    bias = direct_bias(escapes, steps).isel(ensemble=0).transpose("n", "angle").values
    scale = breakup * (1 + bias)
    a, b = np.moveaxis(scale[..., None] * ray(angle), -1, 0)
    spacing = 1 - float(escapes.excess[0] / escapes.excess[1])
    dims = "n", "angle"
    variables = {
        "critical_scale": (dims, scale, "smallest scale above which orbits always escape"),
        "bias": (dims, bias, "critical_scale relative to the breakup, minus 1"),
        "resolution": (dims, spacing * bias * breakup, "spacing of the scales"),
        **strengths(dims, a, b, plane.axes),
    }
    coords = {"n": (steps, "steps N"), "angle": angles_of_rays(angle)}
    attrs = plane.record | {"n_orbits": int(escapes.ensemble[0]), "spacing": spacing}
    attrs["references"] = "arXiv:1606.04824, Sec. V.B, Figs. 5 and 6"
    return dataset("Boundary of global transport by direct iteration", coords, variables, attrs)


def insets_dataset() -> xr.Dataset:
    """Count the visits of one orbit to each pixel of the unit cell; dims (forcing, y, x)."""
    paths = [orbits.orbit(kappa, *INSET_START, INSET_STEPS) for kappa in INSETS]
    square = [[0, 1], [0, 1]]
    visits = [np.histogram2d(y % 1.0, x % 1.0, _PIXELS, square)[0] for x, y in paths]
    centres = (np.arange(_PIXELS) + 0.5) / _PIXELS
    cells = {"y": (centres, "y mod 1"), "x": (centres, "x mod 1")}
    variables = {
        "visits": (("forcing", "y", "x"), np.array(visits, "uint32"), "points of the orbit"),
        **strengths("forcing", *np.transpose(INSETS)),
        "verdict": ("forcing", [verdict(kappa).answer.name.lower() for kappa in INSETS], "verdict"),
        "lowest": (
            "forcing",
            [y.min() for _, y in paths],
            "smallest y of the orbit, not reduced mod 1",
        ),
        "highest": (
            "forcing",
            [y.max() for _, y in paths],
            "largest y of the orbit, not reduced mod 1",
        ),
    }
    coords = {"forcing": (range(len(INSETS)), "forcing"), **cells}
    settings = {
        "start": list(INSET_START),
        "steps": INSET_STEPS,
        "references": "arXiv:1606.04824, Fig. 6",
    }
    return dataset("Visits of one orbit to the pixels of the cell", coords, variables, settings)
