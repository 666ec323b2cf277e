"""Rotating standard maps, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ): breakup of tori, and onset of transport.

(κ̄, Δκ) = s·(cos angle, sin angle), arXiv:1606.04824, Sec. VII, Eq. (rotmap).
"""

from fractions import Fraction
from functools import partial

from nasm import escape, periodic, transversals
from nasm.maps import rotating_forcing
from pipeline.cubes.breakdown import job_on_rays, warm_up_residues
from pipeline.cubes.cube import PAPER, coordinate
from pipeline.cubes.escape import SECONDS_PER_STEP, warm_up_escape

_MEANS = {"kappa_mean": "mean strength κ̄", "kappa_amplitude": "amplitude Δκ of the strengths"}


def tori(vectors, angles):
    """Return the Job of the cube `rotating_tori`: breakup of tori by the residue of a long orbit.

    vectors : list of "p/q,Ω", an orbit's turns per kick and the frequency. angles : degrees.
    """
    settings = {"frequencies": [vector.split(",")[1] for vector in vectors]}
    settings |= {"vectors": list(vectors), "method": "Greene's residue of one orbit"}
    rows = _rows("frequency", settings["frequencies"], "frequency Ω")
    return _job(_torus, warm_up_residues, "rotating_tori", rows, angles, 0.04, settings)


def transport(angles, n_max, n_orbits):
    """Return the Job of the cube `rotating_transport`: direct iteration for Ω = 1/2.

    angles : degrees. n_max : int, steps (periods of the forcing). n_orbits : int.
    """
    settings = {"frequencies": ["1/2"], "phase": 0.0, "n_max": n_max, "n_orbits": n_orbits}
    settings["method"] = "direct iteration"
    seconds = 10 * SECONDS_PER_STEP * n_orbits * n_max  # ten runs of the whole ensemble
    rows = _rows("frequency", ["1/2"], "frequency Ω")
    return _job(_transport, warm_up_escape, "rotating_transport", rows, angles, seconds, settings)


def three_kicks(phases, angles, n_max):
    """Return the Job of the cube `three_kicks`: last barriers for Ω = 1/3, by converse KAM.

    phases : list of texts of φ0, in turns. angles : degrees. n_max : int, steps (of three kicks).
    """
    settings = {"method": "converse KAM on transversals", "frequency": "1/3", "n_max": n_max}
    rows = _rows("phase", phases, "phase φ0 of the first kick, in turns")
    warm_up = partial(transversals.critical_scale, (1.0,), 30)
    return _job(_phase, warm_up, "three_kicks", rows, angles, 0.4 + 2.5e-3 * n_max, settings)


def _rows(dim, texts, long_name):
    exact = list(dict.fromkeys(texts))
    return coordinate(dim, list(map(float, map(Fraction, exact))), long_name, exact=exact)


def _job(critical_scale, warm_up, name, rows, angles, seconds, settings):
    title = "Breakup of the last barriers of rotating standard maps"
    labels = {"title": title, "source": f"{PAPER}, Sec. VII, Eq. (rotmap)"}
    plan = name, {rows.dims[0]: rows}, angles, _MEANS, seconds, settings
    return job_on_rays(critical_scale, warm_up, *plan, **labels)


def _torus(frequency, profile, settings):
    vectors = (vector.split(",") for vector in settings["vectors"])
    exact = {float(Fraction(text)): (omega, text) for omega, text in vectors}
    return periodic.torus_scale(*exact[frequency], *profile)


def _transport(frequency, profile, settings):
    kappa = rotating_forcing(*profile, settings["frequencies"][0], settings["phase"])
    return escape.critical_scale(kappa, settings["n_max"], settings["n_orbits"])


def _phase(phase, profile, settings):
    kappa = rotating_forcing(*profile, settings["frequency"], phase)
    return transversals.critical_scale(kappa, settings["n_max"])
