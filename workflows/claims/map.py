"""Claims about the map (Sec. II) and its symmetries (Sec. III).

The equations are tested as the paper states them, for period two, on random forcings and points
with |κ_i| ≤ 2 and |x|, |y| ≤ 1. Such tests are not a proof.
"""

import numpy as np

from nasm.maps import TWO_PI, kick, step, step_tangent, twist, unkick
from nasm.orbits import orbit, rotation_number
from workflows.claims.rules import identity, rounding
from workflows.shared.judgement import grade

_STEPS = 3  # number of steps after which orbits are compared
_CIRCLE = 1e-10  # error allowed for a rotation number after 10 000 steps


def largest(difference, n_points=100):
    """Find the largest |difference(kappa, x, y)| over 50 random forcings and n_points points."""
    random, worst = np.random.default_rng(1), 0.0
    for kappa in random.uniform(-2, 2, (50, 2)):
        x, y = random.uniform(-1, 1, (2, n_points))
        worst = np.maximum(worst, np.abs(difference(kappa, x, y)).max())
    return float(worst)


def apart(left, right, n_points=100):
    """Find the largest difference between two functions, at the same points as in `largest`."""
    return largest(lambda *z: np.subtract(left(*z), right(*z)), n_points)


def closed_form(kappa, x, y):
    """Compute F_1 and F_2, Eqs. (5a) and (5b)."""
    first = kappa[0] / TWO_PI * np.sin(TWO_PI * x)
    second = first + kappa[1] / TWO_PI * np.sin(TWO_PI * (x + y + first))
    return np.stack([first + second, second])


def both_kicks(kappa, x, y):
    """Compute S_κ2∘S_κ1."""
    return np.stack(kick(kappa[1], *kick(kappa[0], x, y)))


def iterated(kappa, x, y):
    """Return x and y after _STEPS steps."""
    return np.stack([values[-1] for values in orbit(kappa, x, y, _STEPS)])


def map_claims():
    """Judge the claims of Sec. II; return {name: (value, verdict)}, like every `…_claims`."""
    composition = apart(
        lambda kappa, x, y: np.array([x + 2 * y, y]) + closed_form(kappa, x, y), both_kicks
    )
    swapped = apart(
        lambda kappa, *z: unkick(kappa[1], *iterated(kappa, *kick(kappa[1], *z))),
        lambda kappa, *z: iterated(kappa[::-1], *z),
    )
    inverse = apart(lambda kappa, *z: unkick(kappa[0], *kick(kappa[0], *z)), lambda kappa, *z: z)
    area = largest(lambda *z: np.linalg.det(step_tangent(*z).T) - 1)

    def printed_twist(kappa, x, y):
        angle = TWO_PI * (x + y + kappa[0] / TWO_PI * np.sin(TWO_PI * x))
        return 2 + kappa[1] * np.cos(angle)

    even = orbit((0.35, 0.5), 0.0, 0.55, 10_000)  # the orbit of Fig. 1(d)
    odd, _ = kick(0.35, *even)
    away = [np.abs(x - np.rint(x)).max() for x in (even[0], odd - 0.5)]
    alternation = dict(zip(("even", "odd"), away, strict=True))
    cylinder = np.meshgrid(np.arange(256) / 256, np.arange(256) / 256)
    inside, outside = (
        min(twist((kappa1, kappa2), *cylinder).min() for kappa1 in (-1.9, 0.3, 1.0))
        for kappa2 in (1.99, 2.01)
    )
    return {
        "composition": identity(composition, rounding(2)),
        "conjugation": identity(swapped, rounding(2 * _STEPS + 2)),
        "inverse": identity(inverse, rounding(2)),
        "twist": identity(apart(printed_twist, twist), rounding(3)),
        "twist_region": grade({"inside": inside, "outside": outside}, inside > 0 > outside),
        "area": identity(area, rounding(3)),
        "exact": identity(apart(path_integral, generating_function, 10), 1e-12),
        "alternation": grade(alternation, max(away) < 0.25),
    }


def path_integral(kappa, x, y):
    """Integrate y' dx' - y dx along the segment from 0 to (x, y) by Gaussian quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    t = (nodes[:, None] + 1) / 2
    tangent = step_tangent(kappa, t * x, t * y)
    _, y_after = step(kappa, t * x, t * y)
    dx_after = tangent[0, 0] * x + tangent[0, 1] * y
    return weights @ (y_after * dx_after - t * y * x) / 2


def generating_function(kappa, x, y):
    """Compute P₁ + P₂∘S_κ1 at (x, y), minus its value at the origin."""
    change = 0.0
    for strength in kappa:
        after = kick(strength, x, y)
        change = change + after[1] ** 2 / 2
        change = change - strength / TWO_PI**2 * (np.cos(TWO_PI * x) - 1)
        x, y = after
    return change


# For each symmetry: the image of (κ, x, y), and the point that the image reaches after n steps, as
# a function of n and of the point (x, y) that the original orbit reaches after n steps.
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
# For each claim: the name of its symmetry, and ω of the image as a function of ω.
_ROTATIONS = {
    "ome1": ("shift3", lambda omega: omega),
    "ome2": ("shift2", lambda omega: omega + 1),
    "ome3": ("shift1", lambda omega: omega + 1),
    "ome4": ("int", lambda omega: 2 - omega),
}
# For each claim: the factor, 1 or -1, between F_i at the image and F_i at (κ, x, y); and the image.
_F_SYMMETRIES = {
    "sym_1": (-1, _SYMMETRIES["refl"][0]),
    "sym_2": (1, lambda kappa, x, y: (kappa, x + 2, y - 3)),
    "sym_3": (1, _SYMMETRIES["shift3"][0]),
    "sym_4": (1, _SYMMETRIES["shift2"][0]),
    "sym_5": (1, _SYMMETRIES["shift1"][0]),
}
ROBUST = np.array([0.3, 0.2]), 0.1, np.array([0.31, 0.19])
"""A forcing and two starts on circles; 10 000 steps suffice to determine their rotation numbers."""


def omega(kappa, x, y):
    return rotation_number(kappa, x, y, 10_000)[0]


def symmetry_claims():
    """Judge the claims of Sec. III."""
    claims = {}
    for name, (sign, image) in _F_SYMMETRIES.items():
        claims[name] = identity(
            _deviation(closed_form, image, lambda f, s=sign: s * f), rounding(2)
        )
    for name, (image, expected) in _SYMMETRIES.items():
        off = _deviation(iterated, image, lambda z, after=expected: after(_STEPS, *z))
        claims[name] = identity(off, rounding(2 * _STEPS + 1))
    before = omega(*ROBUST)
    for name, (symmetry, expected) in _ROTATIONS.items():
        off = omega(*_SYMMETRIES[symmetry][0](*ROBUST)) - expected(before)
        claims[name] = identity(np.abs(off).max(), _CIRCLE)
    standard = np.array([0.5]), 0.1, np.array([0.62, 0.37])
    off = omega(standard[0], 1 - 0.1, 1 - standard[2]) - (1 - omega(*standard))
    claims["footnote"] = identity(np.abs(off).max(), _CIRCLE)
    as_printed, corrected = ome5_deviations()
    off = {"printed": as_printed, "corrected": corrected}
    return claims | {"ome5": grade(off, as_printed < _CIRCLE, corrected < _CIRCLE)}


def _deviation(function, image, expected):
    """Return the largest deviation of function(image) from expected(function)."""
    return apart(lambda *z: function(*image(*z)), lambda *z: expected(function(*z)))


def ome5_deviations():
    """Return by how much ω at S_κ2(z₀) and S_κ2⁻¹(z₀) under swapped kicks differs from ω at z₀."""
    kappa, x, y = ROBUST
    moved = [omega(kappa[::-1], *image(kappa[1], x, y)) for image in (kick, unkick)]
    return [float(np.abs(after - omega(*ROBUST)).max()) for after in moved]
