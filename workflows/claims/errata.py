"""Errata: equations of the paper that fail as printed, with their corrected forms.

For each, the errors of the printed and of the corrected form are measured.
"""

import numpy as np

from nasm.maps import step
from workflows.claims import map as paper
from workflows.claims.circles import frames, golden_circle
from workflows.claims.map import apart, both_kicks, generating_function, path_integral
from workflows.claims.periodic import cubic_estimates
from workflows.claims.rules import Erratum, printed_texts, rounding


def errata():
    """Return the errata, with the errors of both forms and a bound on rounding errors."""
    circle, (kappa, x, y) = golden_circle((0.4, 0.2)), paper.ROBUST
    frame, before = frames(circle.omega, circle.kappa, circle.u), paper.omega(kappa, x, y)
    images = [paper.omega(kappa, x + 0.5, y), paper.omega(kappa, 1 - x, 1 - y)]
    z2, *estimates = cubic_estimates(1e-3)
    integral = apart(path_integral, generating_function, 10)
    both = apart(step, both_kicks), rounding(2)
    twice = apart(lambda kappa, *z: path_integral(kappa[[0, 0]], *z), generating_function, 10)

    measured = {
        "hat": (apart(step, lambda *z: both_kicks(*z)[[0, 0]]), *both),
        "kap": (apart(step, lambda kappa, *z: both_kicks(kappa[::-1], *z)), *both),
        "exact": (twice, integral, 1e-12),
        "reflected": (*(_largest(image - (2 - before)) for image in images), 1e-10),
        "ome5": (*paper.ome5_deviations(), 1e-10),
        "z_aprox": (*(abs(estimate - z2) for estimate in estimates), z2**1.5),
        "twist": (*(_largest(frame[s] - frame["shear"][0, 1]) for s in ("printed_s", "s")), 1e-10),
    }
    names = "printed_off", "corrected_off", "bound"
    return [
        Erratum(**texts, **dict(zip(names, measured[name], strict=True)))
        for name, texts in printed_texts("errata").items()
    ]


def _largest(off):
    return float(np.abs(off).max())
