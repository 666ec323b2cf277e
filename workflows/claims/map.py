"""Claims on the definition of the map (Sec. II), on random forcings and points.

Equations are tried in the paper's own form, with |κ_i| ≤ 2 and |x|, |y| ≤ 1; nothing here is a
proof.
"""

import numpy as np

from nasm.maps import TWO_PI, kick, step, step_tangent, twist, unkick
from nasm.orbits import orbit
from workflows.claims.rules import graded, identity, rounding

_STEPS = 3


def largest(difference, n_forcings=50, n_points=100):
    """Find the largest |difference(kappa, x, y)| over random forcings and points."""
    random, worst = np.random.default_rng(1), 0.0
    for kappa in random.uniform(-2, 2, (n_forcings, 2)):
        x, y = random.uniform(-1, 1, (2, n_points))
        worst = np.maximum(worst, np.abs(difference(kappa, x, y)).max())
    return float(worst)


def closed_form(kappa, x, y):
    """Compute F_1 and F_2, Eqs. (5a) and (5b)."""
    first = kappa[0] / TWO_PI * np.sin(TWO_PI * x)
    second = first + kappa[1] / TWO_PI * np.sin(TWO_PI * (x + y + first))
    return np.stack([first + second, second])


def map_claims():
    """Judge Sec. II: {name of the claim: (value, verdict)}, as all `…_claims` do."""

    def composition(kappa, x, y):
        f1, f2 = closed_form(kappa, x, y)
        return np.subtract((x + 2 * y + f1, y + f2), kick(kappa[1], *kick(kappa[0], x, y)))

    def conjugation(kappa, x, y):
        after = [values[-1] for values in orbit(kappa, *kick(kappa[1], x, y), _STEPS)]
        swapped = [values[-1] for values in orbit(kappa[::-1], x, y, _STEPS)]
        return np.subtract(unkick(kappa[1], *after), swapped)

    def inverse(kappa, x, y):
        return np.subtract(unkick(kappa[0], *kick(kappa[0], x, y)), (x, y))

    def printed_twist(kappa, x, y):
        angle = TWO_PI * (x + y + kappa[0] / TWO_PI * np.sin(TWO_PI * x))
        return 2 + kappa[1] * np.cos(angle) - twist(kappa, x, y)

    def area(kappa, x, y):
        tangent = step_tangent(kappa, x, y)
        return tangent[0, 0] * tangent[1, 1] - tangent[0, 1] * tangent[1, 0] - 1

    def generated(kappa, x, y):
        return path_integral(kappa, x, y) - generating_function(kappa, x, y)

    even = orbit((0.35, 0.5), 0.0, 0.55, 10_000)  # of Fig. 1(d)
    odd, _ = kick(0.35, *even)
    away = [np.abs(x - np.rint(x)).max() for x in (even[0], odd - 0.5)]
    alternation = (
        f"10 000 even iterates stay within {away[0]:.2f} of x = 0, odd ones within {away[1]:.2f} "
        "of x = ½"
    )
    theta = np.arange(256) / 256
    cylinder = np.meshgrid(theta, theta)
    inside, outside = (
        min(twist((kappa1, kappa2), *cylinder).min() for kappa1 in (-1.9, 0.3, 1.0))
        for kappa2 in (1.99, 2.01)
    )
    return {
        "composition": identity(largest(composition), rounding(2)),
        "conjugation": identity(largest(conjugation), rounding(2 * _STEPS + 2)),
        "inverse": identity(largest(inverse), rounding(2)),
        "twist": identity(largest(printed_twist), rounding(3)),
        "twist_region": graded(
            f"least ∂x'/∂y {inside:.3g} at κ2 = 1.99, {outside:.3g} at 2.01", inside > 0 > outside
        ),
        "area": identity(largest(area), rounding(3)),
        "exact": identity(largest(generated, n_points=10), 1e-12),
        "alternation": graded(alternation, max(away) < 0.25),
    }


def path_integral(kappa, x, y):
    """Integrate y' dx' - y dx straight from the origin to (x, y), by Gauss's formula."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    t = (nodes[:, None] + 1) / 2
    tangent = step_tangent(kappa, t * x, t * y)
    _, y_after = step(kappa, t * x, t * y)
    dx_after = tangent[0, 0] * x + tangent[0, 1] * y
    return weights @ (y_after * dx_after - t * y * x) / 2


def generating_function(kappa, x, y):
    """Compute P₁ + P₂∘S_κ1 at (x, y), less that at the origin."""
    change = 0.0
    for strength in kappa:
        after = kick(strength, x, y)
        change = change + after[1] ** 2 / 2
        change = change - strength / TWO_PI**2 * (np.cos(TWO_PI * x) - 1)
        x, y = after
    return change
