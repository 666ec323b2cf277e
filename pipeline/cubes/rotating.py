"""Rotating standard maps, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ): breakup of tori, and onset of transport.

(κ̄, Δκ) = s·(cos angle, sin angle), arXiv:1606.04824, Sec. VII, Eq. (rotmap).
"""

from fractions import Fraction

from nasm import escape, periodic, transversals
from nasm.maps import rotating_forcing
from pipeline.cubes.breakdown import warm_up_residue
from pipeline.cubes.cube import PAPER, Job
from pipeline.cubes.escape import SECONDS_PER_STEP, warm_up_escape
from pipeline.cubes.rays import ROTATING, cube_on_rays, rows_of, tile_on_rays


def tori(vectors, angles):
    """Return the Job of the cube `rotating_tori`: breakup of tori by the residue of a long orbit.

    vectors : list of "p/q,Ω", an orbit's turns per kick and the frequency. angles : degrees.
    """
    settings = {"method": "Greene's residue of one orbit", "vectors": list(vectors)}
    frequencies = [vector.split(",")[1] for vector in vectors]
    cube = _cube("rotating_tori", frequencies, angles, 20, settings)
    return Job(cube, _compute_tori, _predict_tori, warm_up_residue)


def transport(angles, n_max, n_orbits):
    """Return the Job of the cube `rotating_transport`: direct iteration for Ω = 1/2.

    angles : degrees. n_max : int, steps (periods of the forcing). n_orbits : int.
    """
    settings = {"method": "direct iteration", "phase": 0.0, "n_max": n_max, "n_orbits": n_orbits}
    cube = _cube("rotating_transport", ["1/2"], angles, 10, settings)
    return Job(cube, _compute_transport, _predict_transport, warm_up_escape)


def three_kicks(phases, angles, n_max):
    """Return the Job of the cube `three_kicks`: last barriers for Ω = 1/3, by converse KAM.

    phases : list of texts of φ0, in turns. angles : degrees. n_max : int, steps (of three kicks).
    """
    cube = cube_on_rays(
        "three_kicks",
        rows_of("phase", _floats(phases), "phase φ0 of the first kick, in turns"),
        angles,
        ROTATING,
        4,
        {"method": "converse KAM on transversals", "frequency": "1/3", "n_max": n_max},
        **_ATTRS,
    )
    return Job(cube, _compute_phases, _predict_phases, _warm_up_transversals)


_ATTRS = {
    "title": "Breakup of the last barriers of rotating standard maps",
    "source": f"{PAPER}, Sec. VII, Eq. (rotmap)",
}


def _cube(name, frequencies, angles, tile, settings):
    rows = rows_of("frequency", _floats(frequencies), "frequency Ω")
    settings = {"frequencies": list(frequencies), **settings}
    return cube_on_rays(name, rows, angles, ROTATING, tile, settings, **_ATTRS)


def _floats(texts):
    return {text: float(Fraction(text)) for text in texts}


def _compute_tori(coords, settings):
    vectors = [vector.split(",") for vector in settings["vectors"]]
    omegas = {float(Fraction(frequency)): (omega, frequency) for omega, frequency in vectors}

    def critical_scale(frequency, profile):
        return periodic.torus_scale(*omegas[frequency], *profile)

    return tile_on_rays(coords, "frequency", critical_scale, ROTATING)


def _predict_tori(coords, settings):
    return 0.5 * coords["frequency"].size * coords["angle"].size


def _compute_transport(coords, settings):
    exact = {float(Fraction(text)): text for text in settings["frequencies"]}

    def critical_scale(frequency, profile):
        kappa = rotating_forcing(*profile, exact[frequency], settings["phase"])
        return escape.critical_scale(kappa, settings["n_max"], settings["n_orbits"])

    return tile_on_rays(coords, "frequency", critical_scale, ROTATING)


def _predict_transport(coords, settings):
    """Predict ten runs of the whole ensemble a ray."""
    rays = coords["frequency"].size * coords["angle"].size
    return 10 * SECONDS_PER_STEP * settings["n_orbits"] * settings["n_max"] * rays


def _compute_phases(coords, settings):
    def critical_scale(phase, profile):
        kappa = rotating_forcing(*profile, settings["frequency"], phase)
        return transversals.critical_scale(kappa, settings["n_max"])

    return tile_on_rays(coords, "phase", critical_scale, ROTATING)


def _predict_phases(coords, settings):
    return 2e-3 * settings["n_max"] * coords["phase"].size * coords["angle"].size


def _warm_up_transversals():
    transversals.critical_scale((1.0,), 30)
