"""Errata: equations of the paper that fail as printed, with what they should read.

Each is measured: by how much the printed form fails, and the corrected one.
"""

import numpy as np

from nasm.maps import kick, step
from workflows.claims.circles import frames, golden_circle
from workflows.claims.map import generating_function, largest, path_integral
from workflows.claims.periodic import cubic_estimates
from workflows.claims.rules import CLAIMS, Erratum, rounding
from workflows.claims.symmetries import ROBUST, ome5_deviations, omega


def errata():
    return [_hat(), _kap(), _exact(), _reflected(), _ome5(), _z_aprox(), _twist()]


def _hat():
    def both(corrected):
        def difference(kappa, x, y):
            x_hat, y_hat = kick(kappa[1], *kick(kappa[0], x, y))
            return np.subtract(step(kappa, x, y), (x_hat, y_hat if corrected else x_hat))

        return largest(difference)

    return Erratum(
        "Sec. II, Eq. (hat_no_hat)",
        "(x_n, y_n) = (x̂_2n, x̂_2n)",
        "(x_n, y_n) = (x̂_2n, ŷ_2n)",
        both(False),
        both(True),
        rounding(2),
        "largest difference of the two sides, n = 1",
        "python -m pytest tests/test_maps.py",
    )


def _kap():
    def nonautonomous(even, odd):
        def difference(kappa, x, y):
            start = x, y
            for n in range(2):
                x, y = kick(kappa[odd if n % 2 else even], x, y)
            return np.subtract((x, y), step(kappa, *start))

        return largest(difference)

    return Erratum(
        "Sec. II, Eqs. (kap), (hat_no_hat)",
        "κ_n = κ1 if n is odd, κ2 if n is even",
        "κ_n = κ1 if n is even, κ2 if n is odd, as n starts from 0 and T_κ1κ2 kicks with κ1 first",
        nonautonomous(even=1, odd=0),
        nonautonomous(even=0, odd=1),
        rounding(2),
        "difference of (x̂_2, ŷ_2) to T_κ1κ2 from the same start",
        "python -m pytest tests/test_maps.py",
    )


def _exact():
    def pulled_back(second):
        def difference(kappa, x, y):
            strengths = kappa[[0, second]]
            return path_integral(strengths, x, y) - generating_function(kappa, x, y)

        return largest(difference, n_points=10)

    return Erratum(
        "Sec. II, Eq. (exact)",
        "(S_κ2 ∘ S_κ1)*α = S_κ1* S_κ1* α",
        "(S_κ2 ∘ S_κ1)*α = S_κ1* S_κ2* α",
        pulled_back(0),
        pulled_back(1),
        1e-12,
        "difference of ∫ (right-hand side - α) along paths to the change of P₁ + S_κ1*P₂",
        CLAIMS,
    )


def _reflected():
    kappa, x, y = ROBUST
    as_printed, corrected = (
        float(np.abs(omega(kappa, *image) - (2 - omega(kappa, x, y))).max())
        for image in ((x + 0.5, y), (1 - x, 1 - y))
    )
    return Erratum(
        "Sec. III.A, after Eq. (shift1)",
        "property P3 in Eq. (sym_3) implies the reflected image of a circle below y = 0.5",
        "P1 and P2, Eq. (int), imply it; P3 takes the circle to other strengths, unreflected",
        as_printed,
        corrected,
        1e-10,
        "difference of the image's ω to 2 - ω, under the same strengths; NaN if it has none",
        "python -m pytest tests/test_symmetries.py::test_rotation_numbers_follow_the_symmetries",
    )


def _ome5():
    return Erratum(
        "Sec. III.B, Eq. (ome5)",
        "ω(S_κ2(z₀); κ2, κ1) = ω(z₀; κ1, κ2)",
        "ω(S_κ2⁻¹(z₀); κ2, κ1) = ω(z₀; κ1, κ2), or with S_κ1(z₀)",
        *ome5_deviations(),
        1e-10,
        "difference of the two sides at κ = (0.3, 0.2)",
        "python -m pytest tests/test_symmetries.py::"
        "test_rotation_number_of_the_swapped_map_needs_the_inverse_kick_in_ome5",
    )


def _z_aprox():
    exact, as_printed, corrected = cubic_estimates(1e-3)
    return Erratum(
        "Sec. IV.A, Eq. (z_aprox)",
        "numerator 6κ1 + 6κ2 + 3κ1κ2",
        "numerator 6κ1 + 6κ2 - 3κ1κ2, which vanishes at the pitchfork",
        abs(as_printed - exact),
        abs(corrected - exact),
        exact**1.5,
        f"difference to the z² = {exact:.2g} of Eq. (second2), at κ1 = κ2 = 4.001",
        "python -m pytest tests/test_fixed_points.py::"
        "test_the_estimate_as_printed_does_not_vanish_at_the_pitchfork",
    )


def _twist():
    circle = golden_circle((0.4, 0.2))
    found = frames(circle.omega, circle.kappa, circle.u)
    measured = found["shear"][0, 1]
    return Erratum(
        "Sec. VI.A, below Eq. (reduction)",
        "S₀ = N₀(θ + ω) DK₀ᵀ(θ + ω) DT(K₀) DK₀(θ) N₀(θ)",
        "S₀ = N₀(θ + ω) DK₀ᵀ(θ + ω) DT(K₀) J⁻¹ DK₀(θ) N₀(θ)",
        float(np.abs(found["printed_s"] - measured).max()),
        float(np.abs(found["s"] - measured).max()),
        1e-10,
        "difference to the entry of M⁻¹(θ + ω) DT M(θ), on the golden circle at κ = (0.4, 0.2)",
        "python -m pytest tests/test_circles.py::test_the_frame_reduces_the_tangent_to_a_shear",
    )
