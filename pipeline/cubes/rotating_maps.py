"""Rotating standard maps, κ_n = s·(cos angle + sin angle · cos 2π(φ0 + nΩ)), of any frequency Ω.

The last circle or torus against Ω, breakup of tori on rays, and pictures of tori.
arXiv:1606.04824, Sec. VII, Eq. (53); `nasm.tori`.
"""

from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product

import numpy as np
import xarray as xr

from nasm import barriers, periodic, tori
from nasm.maps import rotating_forcing
from nasm.planes import ROTATING_AXES
from nasm.symmetries import ray
from nasm.tori import last_torus
from pipeline.cubes.breakdown import job_on_rays, scales
from pipeline.cubes.cube import PAPER, angles_of_rays, blank, coordinate, text
from pipeline.cubes.kernels import load_orbits, load_searches

_KICKS, _TOL = 32_000, 1e-3  # on either side, for irrational Ω; width of brackets, for others
_PICTURE = 128, 256  # points along φ and θ


def last_barriers(fractions, n_phases, irrational, angles):
    """Return the Job of the cube `frequencies`: brackets of the last circle, or torus.

    fractions : list of Fraction, Ω = p/q. n_phases : int, at least 2, of φ0 from 0 to 1/2q; all
    others are images of these. irrational : list of floats. angles : degrees.
    """
    shares = [Fraction(k, n_phases - 1) for k in range(n_phases)]
    rotating = [(Ω, s, f"{Ω},{s / 2 / Ω.denominator}") for Ω, s in product(fractions, shares)]
    rotating += [(Ω, np.nan, repr(Ω)) for Ω in irrational]
    frequencies, shares, names = zip(*rotating, strict=True)
    words = "phase φ0, in parts of 1/2q; NaN: Ω is irrational, and all phases are alike"
    rows = {
        "forcing": text("forcing", names, "Ω, and φ0 if Ω is a fraction, exactly"),
        "frequency": coordinate(
            "forcing", np.array(frequencies, float), "frequency Ω, turns of φ per kick"
        ),
        "phase": coordinate("forcing", np.array(shares, float), words),
    }
    settings = {"kicks": _KICKS, "tol": _TOL, "method": "last barriers, and certified tori"}
    on_ray = {"forcing": rows["forcing"], "angle": angles_of_rays(angles)}
    more = {"omega": blank(on_ray, "turns per kick of the circle, or torus")}
    how = settings, _last_barriers, _load_last_barriers, "Last barriers", more
    job = job_on_rays("frequencies", ROTATING_AXES, rows, angles, 10, *how)
    return replace(job, predict=_predict)


def breakups(vectors, angles, tol):
    """Return the Job of the cube `tori`: tori continued to their breakup.

    `upper` is where no torus of that Ω is left, whatever its ω.

    vectors : list of pairs of floats, ω and Ω. angles : degrees. tol : float, the error to aim at.
    """
    omegas, frequencies = zip(*vectors, strict=True)
    rows = {
        "vector": text("vector", map(_name_of, vectors), "turns of θ and φ per kick"),
        "omega": coordinate("vector", omegas, "turns of θ per kick"),
        "frequency": coordinate("vector", frequencies, "turns of φ per kick, Ω"),
    }
    settings, seconds = {"method": "continuation of tori", "tol": tol}, 12 if tol < 5e-3 else 5
    warm_up = partial(_load_tori, vectors[0])
    how = seconds, settings, _breakups, warm_up, "Breakup of tori"
    return job_on_rays("tori", ROTATING_AXES, rows, angles, *how)


def residues(vectors, angles):
    """Return the Job of the cube `rotating_tori`: breakup of tori by the residue of a long orbit.

    vectors : list of "p/q,Ω", an orbit's turns per kick and the frequency. angles : degrees.
    """
    numbers = [float(Fraction(vector.split(",")[1])) for vector in vectors]
    rows = {
        "frequency": coordinate("frequency", numbers, "frequency Ω"),
        "vector": text("frequency", vectors, "turns per kick of the orbit, and Ω, exactly"),
    }
    settings = {"method": "Greene's residue of one orbit"}
    how = 0.06, settings, _residues, load_orbits
    return job_on_rays("rotating_tori", ROTATING_AXES, rows, angles, *how, "Breakup of circles")


def pictures(vector, angle, sizes):
    """Return h - θ of certified tori on a ray, a Dataset with dims (scale, phi, theta)."""
    m, n = _PICTURE
    coords = {
        "scale": coordinate("scale", sizes, "scale s of the ray"),
        "phi": coordinate("phi", np.arange(m) / m, "phase φ of the forcing, in turns"),
        "theta": coordinate("theta", np.arange(n) / n, "angle θ of the rotation, in turns"),
    }
    deviations, slopes = np.full((len(sizes), m, n), np.nan), np.full(len(sizes), np.nan)
    for i, scale in enumerate(sizes):
        torus = tori.invariant_torus(*vector, *(scale * ray(angle)), tori.newton.N_MAX)
        if torus.certified:
            rows, columns = map(max, torus.u.shape, _PICTURE)
            u = tori.newton.resample(torus.u, rows, columns)
            deviations[i] = u[:: rows // m, :: columns // n]
            slopes[i] = tori.newton.least_slope(torus.u)
    h = blank(coords, "h - θ: where the orbit is, less the rotation")
    slope = blank({"scale": coords["scale"]}, "least slope of h along θ")
    variables = {"deviation": h.copy(data=deviations), "least_slope": slope.copy(data=slopes)}
    labels = {"vector": _name_of(vector), "angle": angle}
    return xr.Dataset(variables, coords, {"title": "Invariant tori", "source": PAPER} | labels)


def _name_of(vector):
    """Return the text of a rotation vector, which keeps all digits."""
    return ",".join(map(repr, vector))


def _load_tori(vector):
    """Compile the kernels of tori."""
    tori.invariant_torus(*vector, 0.05, 0.05)
    last_torus.upper_scale(vector[1], 1.0, 0.0)


def _load_last_barriers():
    """Compile the kernels of last barriers, for Ω of both kinds."""
    load_searches()
    last_torus.of_irrational(2**0.5 - 1, 1.0, 0.0, 400)
    tori.invariant_torus(0.618, 2**0.5 - 1, 0.05, 0.05)


def _last_barriers(coords, settings):
    def last(name, profile):
        frequency, _, phase = name.partition(",")
        if not phase:
            return last_torus.of_irrational(float(frequency), *profile, settings["kicks"])
        forcing = rotating_forcing(*profile, frequency, float(Fraction(phase)))
        found = barriers.critical_scale(forcing, settings["tol"])
        turns = np.nan if found.omega is None else float(found.omega) / forcing.size
        return found, abs(turns - np.rint(turns))

    found = [[last(name, on) for on in ray(coords["angle"])] for name in coords["forcing"]]
    arrays = scales([[scale for scale, _ in row] for row in found], ROTATING_AXES, coords["angle"])
    return arrays | {"omega": np.array([[omega for _, omega in row] for row in found])}


def _predict(coords, settings):
    """Predict seconds by the period q: measured 0.1 of q = 2, 0.6 of 3, 19 of 10; 60 if Ω is
    irrational."""
    frequency, _, phase = coords["forcing"][0].partition(",")
    q = Fraction(frequency).denominator
    return (min(0.02 * q**3, 1.7 * q) if phase else 60) * coords["angle"].size


def _breakups(coords, settings):
    def bracket(omega, frequency, profile):
        found = tori.critical_scale(omega, frequency, *profile, settings["tol"])
        return replace(found, upper=last_torus.upper_scale(frequency, *profile))

    vectors = zip(coords["omega"].tolist(), coords["frequency"].tolist(), strict=True)
    found = [[bracket(*vector, on) for on in ray(coords["angle"])] for vector in vectors]
    return scales(found, ROTATING_AXES, coords["angle"])


def _residues(coords, settings):
    vectors, rays = [vector.split(",") for vector in coords["vector"]], ray(coords["angle"])
    found = [[periodic.torus_scale(*vector, *profile) for profile in rays] for vector in vectors]
    return scales(found, ROTATING_AXES, coords["angle"])
