"""Claims on the symmetries of orbits and rotation numbers (Sec. III), on random points.

For the period-two map written out by hand, as the paper has it; `nasm.symmetries` has them for any
period.
"""

import numpy as np

from nasm.maps import kick, unkick
from nasm.orbits import rotation_number
from workflows.claims.map import STEPS, apart, closed_form, iterated
from workflows.claims.rules import identity, rounding
from workflows.shared.rules import graded

_CIRCLE = 1e-10  # of a rotation number after 10 000 steps

# Image (κ', x', y'), and its orbit after n steps.
_SYMMETRIES = {
    "refl": (lambda kappa, x, y: (kappa, -x, -y), lambda n, x, y: (-x, -y)),
    "trans": (lambda kappa, x, y: (kappa, x + 2, y - 1), lambda n, x, y: (x + 2 - 2 * n, y - 1)),
    "int": (lambda kappa, x, y: (kappa, 1 - x, 1 - y), lambda n, x, y: (1 - x + 2 * n, 1 - y)),
    "shift3": (lambda kappa, x, y: (-kappa, x + 0.5, y), lambda n, x, y: (x + 0.5, y)),
    "shift2": (lambda kappa, x, y: (kappa * (1, -1), x, y + 0.5), lambda n, x, y: (x + n, y + 0.5)),
    "shift1": (
        lambda kappa, x, y: (kappa * (-1, 1), x + 0.5, y + 0.5),
        lambda n, x, y: (x + 0.5 + n, y + 0.5),
    ),
}
# Which of these, and the ω of the image.
_ROTATIONS = {
    "ome1": ("shift3", lambda omega: omega),
    "ome2": ("shift2", lambda omega: omega + 1),
    "ome3": ("shift1", lambda omega: omega + 1),
    "ome4": ("int", lambda omega: 2 - omega),
}
# The sign of F_i at the image.
_F_SYMMETRIES = {
    "sym_1": (-1, _SYMMETRIES["refl"][0]),
    "sym_2": (1, lambda kappa, x, y: (kappa, x + 2, y - 3)),
    "sym_3": (1, _SYMMETRIES["shift3"][0]),
    "sym_4": (1, _SYMMETRIES["shift2"][0]),
    "sym_5": (1, _SYMMETRIES["shift1"][0]),
}
ROBUST = np.array([0.3, 0.2]), 0.1, np.array([0.31, 0.19])
"""A forcing and two starts on circles, whose rotation numbers 10 000 steps determine."""


def omega(kappa, x, y):
    return rotation_number(kappa, x, y, 10_000)[0]


def symmetry_claims():
    """Judge Sec. III."""
    found = {}
    for name, (sign, image) in _F_SYMMETRIES.items():
        found[name] = identity(_deviation(closed_form, image, lambda f, s=sign: s * f), rounding(2))
    for name, (image, expected) in _SYMMETRIES.items():
        off = _deviation(iterated, image, lambda z, after=expected: after(STEPS, *z))
        found[name] = identity(off, rounding(2 * STEPS + 1))
    before = omega(*ROBUST)
    for name, (symmetry, expected) in _ROTATIONS.items():
        off = omega(*_SYMMETRIES[symmetry][0](*ROBUST)) - expected(before)
        found[name] = identity(np.abs(off).max(), _CIRCLE)
    standard = np.array([0.5]), 0.1, np.array([0.62, 0.37])
    off = omega(standard[0], 1 - 0.1, 1 - standard[2]) - (1 - omega(*standard))
    found["footnote"] = identity(np.abs(off).max(), _CIRCLE)
    as_printed, corrected = ome5_deviations()
    off = {"printed": as_printed, "corrected": corrected}
    return found | {"ome5": graded(off, as_printed < _CIRCLE, corrected < _CIRCLE)}


def _deviation(function, image, expected):
    """Return by how much a function of the image is off what is expected of that of the point."""
    return apart(lambda *z: function(*image(*z)), lambda *z: expected(function(*z)))


def ome5_deviations():
    """Measure how ω changes from z₀ to S_κ2(z₀), and to S_κ2⁻¹(z₀), under the swapped kicks."""
    kappa, x, y = ROBUST
    moved = [omega(kappa[::-1], *image(kappa[1], x, y)) for image in (kick, unkick)]
    return [float(np.abs(after - omega(*ROBUST)).max()) for after in moved]
