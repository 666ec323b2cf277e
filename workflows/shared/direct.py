"""Direct iteration on rays: beyond which excess x, s = s_c·(1 + x), do orbits escape?

The bias s_N/s_c - 1 of the boundary {n* ≤ N} falls like N^(-1/η).
"""

from itertools import product

import numpy as np
import xarray as xr

from nasm import orbits
from nasm.arithmetic.reproducible import geometric
from nasm.planes import plane_of
from nasm.symmetries import ray
from nasm.verdicts import verdict
from pipeline.cubes.beyond import escape_times, steps_beyond
from pipeline.cubes.cube import angles_of_rays
from workflows.shared import power_law
from workflows.shared.tables import dataset, described, strengths

INSETS = ((0.526, 0.69), (0.526, 0.73), (-0.69, 0.525), (-0.73, 0.525))
INSET_START = (0.5, 0.44)
INSET_STEPS = 3_000_000
_PIXELS = 400


def steps_up_to(n_max):
    """Return 33 numbers of steps from 100 to n_max, equally spaced in the logarithm."""
    return np.unique(np.rint(np.geomspace(100, n_max, 33)).astype(int))


def bias_job(plane, scales, sizes, n_max):
    """Return the job of the cube `escape_rays`: excesses from 1% to 100%, sixty a decade."""
    excesses = geometric(0.01, 1, 121)
    return escape_times("escape_rays", plane, scales, excesses, sizes, n_max)


def boundary_job(plane, scales, n_max, n_orbits):
    """Return the job of `direct_boundary`: one ensemble, thirty excesses a decade from 1%."""
    excesses = geometric(0.01, 1, 61)
    return escape_times("direct_boundary", plane, scales, excesses, [n_orbits], n_max)


def inwards(run, job):
    """Sweep the job's cube from the largest excess inwards, on each ray to the first no-escape."""
    rays = range(job.cube.template.sizes["angle"])
    for excess in reversed(range(job.cube.template.sizes["excess"])):
        found = run.sweep(job, {(ray, excess) for ray in rays})
        times = found.escape_time[-1, :, excess].values
        rays = [ray for ray in rays if times[ray] <= job.cube.settings["n_max"]]
        if not rays:
            break
    return found.load()


def foreseen(plane, angles, n_max, n_orbits):
    """Return a job like that of `boundary_job`, and the tiles that `inwards` will want of it.

    By the law that the bias of direct iteration falls like N^(-1/3).
    """
    job = boundary_job(plane, dict.fromkeys(angles, 1.0), n_max, n_orbits)
    steps = steps_beyond(job.cube.template.excess.values)
    first = np.flatnonzero(steps >= n_max)[-1:].sum()  # of the excesses at which none escapes
    return job, set(product(range(len(angles)), range(int(first), steps.size)))


def direct_bias(cube, steps):
    """Find κ_N/κ_c - 1 for each N of `steps`: the least excess from which on all escape within N.

    NaN where it is not between two excesses of the cube. What is not computed counts as no escape.
    """
    n = xr.DataArray(steps, {"n": ("n", steps, described("steps"))}, "n")
    escaped = (cube.escape_time <= n).isel(excess=slice(None, None, -1))
    beyond = escaped.cumprod("excess").astype(bool)
    bias = cube.excess.where(beyond).min("excess")
    # Where even the least excess escapes, or the largest does not, the boundary is not on the grid.
    known = beyond.any("excess") & ~beyond.all("excess")
    words = "boundary of n* <= N, relative to the breakup, less 1"
    return bias.where(known).rename("bias").assign_attrs(described(words))


def exponent(n, bias):
    """Fit bias ~ n^(-1/η) by a straight line through the logarithms: η and its standard error.

    NaN, twice, where fewer than four biases are known, or they do not fall.
    """
    slope, error = power_law.exponent(n, bias)
    return (-1 / slope, error / slope**2) if slope < 0 else (np.nan, np.nan)


def boundary_dataset(found, barrier, steps):
    """Find the boundary {n* ≤ N} on rays, dims (n, angle).

    critical_scale is s_N, bias s_N/s_c - 1; resolution is how much less s_N might be on the cube's
    grid.
    """
    plane = plane_of(found.attrs)
    breakup, angle = barrier.critical_scale.values, found.angle.values
    bias = direct_bias(found, steps).isel(ensemble=0).transpose("n", "angle").values
    scale = breakup * (1 + bias)
    spacing = 1 - float(found.excess[0] / found.excess[1])
    dims = "n", "angle"
    variables = {
        "critical_scale": (dims, scale, "scale from which on some orbit escapes"),
        "bias": (dims, bias, "critical_scale relative to the breakup, less 1"),
        "resolution": (dims, spacing * bias * breakup, "spacing of the scales"),
        **strengths(dims, *np.moveaxis(scale[..., None] * ray(angle), -1, 0), plane.axes),
    }
    coords = {"n": (steps, "steps N"), "angle": angles_of_rays(angle)}
    attrs = plane.record | {"n_orbits": int(found.ensemble[0]), "spacing": spacing}
    attrs["source"] = "arXiv:1606.04824, Sec. V.B, Figs. 5 and 6"
    return dataset("Boundary of global transport by direct iteration", coords, variables, attrs)


def insets_dataset():
    """Count the visits of one orbit to the parts of the cell; dims (forcing, y, x)."""
    found = [orbits.orbit(kappa, *INSET_START, INSET_STEPS) for kappa in INSETS]
    square = [[0, 1], [0, 1]]
    visits = [np.histogram2d(y % 1.0, x % 1.0, _PIXELS, square)[0] for x, y in found]
    centres = (np.arange(_PIXELS) + 0.5) / _PIXELS
    cells = {"y": (centres, "y mod 1"), "x": (centres, "x mod 1")}
    variables = {
        "visits": (("forcing", "y", "x"), np.array(visits, "uint32"), "points of the orbit"),
        **strengths("forcing", *np.transpose(INSETS)),
        "verdict": ("forcing", [verdict(kappa).answer.name.lower() for kappa in INSETS], "verdict"),
        "lowest": ("forcing", [y.min() for _, y in found], "least y of the orbit, not reduced"),
        "highest": ("forcing", [y.max() for _, y in found], "largest y of the orbit, not reduced"),
    }
    coords = {"forcing": (range(len(INSETS)), "forcing"), **cells}
    how = {"start": list(INSET_START), "steps": INSET_STEPS, "source": "arXiv:1606.04824, Fig. 6"}
    return dataset("Visits of one orbit to the parts of the cell", coords, variables, how)
