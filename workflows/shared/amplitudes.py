"""Amplitudes of invariant circles, which Proposition 1 assumes to be below 1 (Sec. V.B)."""

import numpy as np

from nasm import barriers, circles
from nasm.circles import continuation, fourier
from nasm.numbers import parse
from nasm.symmetries import ray
from workflows.shared.tables import ANGLE, dataset


def amplitudes(quick):
    """Measure max y - min y of circles just inside CB_gt, before the first and the second kick.

    The last circle at 0.999 of its breakup, and nobles of ω between its translates where they
    exist. A circle and its translate by y = 1 confine an orbit to |Δy| ≤ 1 + amplitude.
    """
    angles = np.linspace(0, 45, 6 if quick else 19)
    others = ["gamma", "2gamma", "[0;2,(1)]", "[0;3,(1)]", "[0;4,(1)]", "[0;1,3,(1)]", "[0;8,(1)]"]
    fractions = np.array([0.3, 0.6, 0.8, 0.9, 0.97])
    last = np.full((2, angles.size), np.nan)
    largest = np.full((angles.size, fractions.size), np.nan)
    for i, angle in enumerate(angles):
        best = barriers.critical_scale(ray(angle), 1e-3)
        _, u = continuation.certified_circle(best.omega, ray(angle), best.value, 1e-3)
        if u is not None:
            last[:, i] = _heights(best.omega, u)
        for j, fraction in enumerate(fractions):
            kappa = fraction * best.value * ray(angle)
            for omega in map(parse, others):
                circle = circles.invariant_circle(omega, kappa, n_max=512)
                if circle.certified:
                    largest[i, j] = np.nanmax([largest[i, j], *_heights(omega, circle.u)])
    coords = {
        "kick": ([0, 1], "kick before which y is taken"),
        "angle": (angles, ANGLE),
        "part": (fractions, "scale over that of the last breakup"),
    }
    variables = {
        "last": (("kick", "angle"), last, "amplitude of the last circle at 0.999 s_c"),
        "largest": (("angle", "part"), largest, "largest amplitude of seven other circles"),
    }
    exits = {"justified_exit": 1 + float(max(np.nanmax(last), np.nanmax(largest)))}
    return dataset("Amplitudes of invariant circles", coords, variables, exits)


def _heights(omega, u):
    """Return max y - min y before each kick: y_j = x_j - x_{j-1}."""
    before = fourier.rotate(u[-1], fourier.turns(omega, u.shape[-1] // 2 + 1).conj())
    return np.ptp(np.diff(np.vstack([before, u]), axis=0), axis=1)
