"""Errata: equations of the paper that fail as printed, with what they should read.

Each is measured: by how much the printed form fails, and the corrected one.
"""

import numpy as np

from nasm.maps import kick, step
from workflows.claims.circles import frames, golden_circle
from workflows.claims.map import generating_function, largest, path_integral
from workflows.claims.periodic import cubic_estimates
from workflows.claims.rules import Erratum, printed_texts, rounding
from workflows.claims.symmetries import ROBUST, ome5_deviations, omega


def errata():
    """Measure each erratum by how far its two forms are off, and what rounding explains."""
    z2, *estimates = cubic_estimates(1e-3)
    measured = {
        "hat": (_hat(False), _hat(True), rounding(2)),
        "kap": (_kap(even=1, odd=0), _kap(even=0, odd=1), rounding(2)),
        "exact": (_exact(0), _exact(1), 1e-12),
        "reflected": (*_reflected(), 1e-10),
        "ome5": (*ome5_deviations(), 1e-10),
        "z_aprox": (*(abs(estimate - z2) for estimate in estimates), z2**1.5),
        "twist": (*_twist(), 1e-10),
    }
    names = "printed_off", "corrected_off", "bound"
    return [
        Erratum(**texts, **dict(zip(names, measured[name], strict=True)))
        for name, texts in printed_texts("errata").items()
    ]


def _hat(corrected):
    def difference(kappa, x, y):
        x_hat, y_hat = kick(kappa[1], *kick(kappa[0], x, y))
        return np.subtract(step(kappa, x, y), (x_hat, y_hat if corrected else x_hat))

    return largest(difference)


def _kap(even, odd):
    def difference(kappa, x, y):
        return np.subtract(kick(kappa[odd], *kick(kappa[even], x, y)), step(kappa, x, y))

    return largest(difference)


def _exact(second):
    def difference(kappa, x, y):
        strengths = kappa[[0, second]]
        return path_integral(strengths, x, y) - generating_function(kappa, x, y)

    return largest(difference, n_points=10)


def _reflected():
    kappa, x, y = ROBUST
    return (
        float(np.abs(omega(kappa, *image) - (2 - omega(kappa, x, y))).max())
        for image in ((x + 0.5, y), (1 - x, 1 - y))
    )


def _twist():
    circle = golden_circle((0.4, 0.2))
    found = frames(circle.omega, circle.kappa, circle.u)
    return (float(np.abs(found[s] - found["shear"][0, 1]).max()) for s in ("printed_s", "s"))
