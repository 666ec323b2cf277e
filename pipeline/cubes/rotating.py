"""Rotating standard maps, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ): breakup of tori, and onset of transport.

(κ̄, Δκ) = s·(cos angle, sin angle), arXiv:1606.04824, Sec. VII, Eq. (rotmap).
"""

from fractions import Fraction
from functools import partial

from nasm import escape, periodic, transversals
from nasm.maps import rotating_forcing
from pipeline.cubes.breakdown import warm_up_residues
from pipeline.cubes.cube import PAPER, Job
from pipeline.cubes.escape import SECONDS_PER_STEP, warm_up_escape
from pipeline.cubes.rays import ROTATING, cube_on_rays, per_ray, rows_of, tile_on_rays


def tori(vectors, angles):
    """Return the Job of the cube `rotating_tori`: breakup of tori by the residue of a long orbit.

    vectors : list of "p/q,Ω", an orbit's turns per kick and the frequency. angles : degrees.
    """
    frequencies = [vector.split(",")[1] for vector in vectors]
    settings = {"frequencies": frequencies, "vectors": list(vectors)}
    settings["method"] = "Greene's residue of one orbit"
    cube = _cube("rotating_tori", _FREQUENCY, frequencies, angles, 0.04, settings)
    return Job(cube, _tori, partial(per_ray, 0.04), warm_up_residues)


def transport(angles, n_max, n_orbits):
    """Return the Job of the cube `rotating_transport`: direct iteration for Ω = 1/2.

    angles : degrees. n_max : int, steps (periods of the forcing). n_orbits : int.
    """
    settings = {"frequencies": ["1/2"], "phase": 0.0, "n_max": n_max, "n_orbits": n_orbits}
    settings["method"] = "direct iteration"
    seconds = 10 * SECONDS_PER_STEP * n_orbits * n_max  # ten runs of the whole ensemble
    cube = _cube("rotating_transport", _FREQUENCY, ["1/2"], angles, seconds, settings)
    return Job(cube, _transport, partial(per_ray, seconds), warm_up_escape)


def three_kicks(phases, angles, n_max):
    """Return the Job of the cube `three_kicks`: last barriers for Ω = 1/3, by converse KAM.

    phases : list of texts of φ0, in turns. angles : degrees. n_max : int, steps (of three kicks).
    """
    settings = {"method": "converse KAM on transversals", "frequency": "1/3", "n_max": n_max}
    seconds, warm_up = 0.4 + 2.5e-3 * n_max, partial(transversals.critical_scale, (1.0,), 30)
    cube = _cube("three_kicks", _PHASE, phases, angles, seconds, settings)
    return Job(cube, _phases, partial(per_ray, seconds), warm_up)


_FREQUENCY = "frequency", "frequency Ω"
_PHASE = "phase", "phase φ0 of the first kick, in turns"


def _cube(name, row, texts, angles, seconds, settings):
    dim, words = row
    return cube_on_rays(
        name,
        rows_of(dim, {text: float(Fraction(text)) for text in texts}, words),
        angles,
        ROTATING,
        seconds,
        settings,
        title="Breakup of the last barriers of rotating standard maps",
        source=f"{PAPER}, Sec. VII, Eq. (rotmap)",
    )


def _tori(coords, settings):
    vectors = [vector.split(",") for vector in settings["vectors"]]
    omegas = {float(Fraction(frequency)): (omega, frequency) for omega, frequency in vectors}
    return tile_on_rays(
        coords,
        "frequency",
        ROTATING,
        lambda frequency, profile: periodic.torus_scale(*omegas[frequency], *profile),
    )


def _transport(coords, settings):
    exact = {float(Fraction(text)): text for text in settings["frequencies"]}

    def critical_scale(frequency, profile):
        kappa = rotating_forcing(*profile, exact[frequency], settings["phase"])
        return escape.critical_scale(kappa, settings["n_max"], settings["n_orbits"])

    return tile_on_rays(coords, "frequency", ROTATING, critical_scale)


def _phases(coords, settings):
    def critical_scale(phase, profile):
        kappa = rotating_forcing(*profile, settings["frequency"], phase)
        return transversals.critical_scale(kappa, settings["n_max"])

    return tile_on_rays(coords, "phase", ROTATING, critical_scale)
