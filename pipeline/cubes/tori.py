"""Invariant tori of rotating standard maps with irrational Ω: their breakup on rays, and pictures.

(κ̄, Δκ) = s·(cos angle, sin angle), arXiv:1606.04824, Sec. VII, Eq. (53); `nasm.tori`.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr

from nasm import tori
from nasm.planes import ROTATING_AXES
from nasm.symmetries import ray
from nasm.tori import last_torus
from pipeline.cubes import cube
from pipeline.cubes.breakdown import cube_on_rays, per_ray, scales
from pipeline.cubes.cube import PAPER, Job, coordinate

_PICTURE = 128, 256  # points along φ and θ


def breakups(vectors, angles, tol):
    """Return the Job of the cube `tori`: tori continued to their breakup.

    `upper` is where no torus of that Ω is left, whatever its ω.

    vectors : list of pairs of floats, ω and Ω. angles : degrees. tol : float, the error to aim at.
    """
    omegas, frequencies = zip(*vectors, strict=True)
    rows = {
        "vector": cube.text("vector", map(name_of, vectors), "turns of θ and φ per kick"),
        "omega": coordinate("vector", omegas, "turns of θ per kick"),
        "frequency": coordinate("vector", frequencies, "turns of φ per kick, Ω"),
    }
    settings = {"method": "continuation of tori", "tol": tol}
    seconds = 12 if tol < 5e-3 else 3
    warm_up = partial(tori.invariant_torus, *vectors[0], 0.05, 0.05)
    plan = cube_on_rays("tori", ROTATING_AXES, rows, angles, seconds, settings, "Breakup of tori")
    return Job(plan, _compute, partial(per_ray, seconds), warm_up)


def name_of(vector):
    """Return the text of a rotation vector, which keeps all digits."""
    return ",".join(map(repr, vector))


def _compute(coords, settings):
    vectors = zip(coords["omega"].tolist(), coords["frequency"].tolist(), strict=True)
    profiles, tol = ray(coords["angle"]), settings["tol"]
    found = [[_bracket(vector, on, tol) for on in profiles] for vector in vectors]
    return scales(found, ROTATING_AXES, coords["angle"])


def _bracket(vector, profile, tol):
    found = tori.critical_scale(*vector, *profile, tol)
    return replace(found, upper=last_torus.upper_scale(vector[1], *profile))


def pictures(vector, angle, sizes):
    """Return h - θ of certified tori on a ray, a Dataset with dims (scale, phi, theta)."""
    found = [tori.invariant_torus(*vector, *(s * ray(angle)), tori.newton.N_MAX) for s in sizes]
    m, n = _PICTURE
    deviations = [
        _on_grid(torus.u) if torus.certified else np.full((m, n), np.nan) for torus in found
    ]
    slopes = [tori.newton.least_slope(torus.u) if torus.certified else np.nan for torus in found]
    label = {"long_name": "h - θ: where the orbit is, less the rotation", "units": "1"}
    slope = {"long_name": "least slope of h along θ", "units": "1"}
    return xr.Dataset(
        {
            "deviation": (("scale", "phi", "theta"), deviations, label),
            "least_slope": ("scale", slopes, slope),
        },
        {
            "scale": coordinate("scale", sizes, "scale s of the ray"),
            "phi": coordinate("phi", np.arange(m) / m, "phase φ of the forcing, in turns"),
            "theta": coordinate("theta", np.arange(n) / n, "angle θ of the rotation, in turns"),
        },
        {"title": "Invariant tori", "source": PAPER, "vector": name_of(vector), "angle": angle},
    )


def _on_grid(u):
    """Return every so many-th point of u: `_PICTURE`."""
    m, n = (max(size, least) for size, least in zip(u.shape, _PICTURE, strict=True))
    u = tori.newton.resample(u, m, n)
    return u[:: m // _PICTURE[0], :: n // _PICTURE[1]]
