"""Growth of tangent vectors, compared with exact matrices, mpmath, and orbits on the lift."""

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose

from nasm.lyapunov import tangent_growth
from nasm.orbits import orbit


@pytest.mark.parametrize("P", [1, 2, 3])
def test_without_kicks_vectors_grow_by_the_shear_alone(P):
    y, n = np.array([0.1, 0.3]), 700
    exponent, indicator, advance = tangent_growth(np.zeros(P), 0.4, y, n)
    expected = np.log(np.hypot(P * n, 1))
    assert_allclose(n * exponent, expected, rtol=1e-13)
    assert_allclose(indicator, expected, rtol=1e-13)
    assert_allclose(advance, P * n * y, rtol=1e-12)


@pytest.mark.parametrize(("kappa", "n"), [((1.0,), 3000), ((2.5, 0.5), 3000), ((1e6,) * 64, 2)])
def test_at_a_hyperbolic_fixed_point_vectors_grow_as_powers_of_a_matrix(kappa, n):
    """|v_n| would overflow after a few hundred steps, or in a single step of 64 strong kicks."""
    with mpmath.workdps(40):
        step = mpmath.eye(2)
        for strength in map(mpmath.mpf, kappa):
            step = mpmath.matrix([[1 + strength, 1], [strength, 1]]) * step
        expected = float(mpmath.log(mpmath.norm(step**n * mpmath.matrix([0, 1]))))
    exponent, indicator, _ = tangent_growth(kappa, 0.0, 0.0, n)
    assert expected > 800
    assert_allclose(n * exponent, expected, rtol=1e-11)
    assert_allclose(indicator, expected, rtol=1e-11)


@pytest.mark.parametrize(("x", "y"), [(0.3, 0.62), (0.1, 0.25)])
def test_exponent_and_indicator_agree_with_a_40_digit_computation(x, y):
    kappa = 1.1, 0.7
    with mpmath.workdps(40):
        at, p, v, w = mpmath.mpf(x), mpmath.mpf(y), mpmath.mpf(0), mpmath.mpf(1)
        logs = [mpmath.mpf(0)]
        for _ in range(60):
            for strength in map(mpmath.mpf, kappa):
                w += strength * mpmath.cos(2 * mpmath.pi * at) * v
                v += w
                p += strength / (2 * mpmath.pi) * mpmath.sin(2 * mpmath.pi * at)
                at += p
            logs.append(mpmath.log(mpmath.sqrt(v**2 + w**2)))
    n = max(n for n in range(61) if logs[n] < max(logs[:n], default=0))
    exponent, indicator, _ = tangent_growth(kappa, x, y, n)
    # In double precision, rounding acts on a chaotic orbit like a change in the start's 16th digit.
    assert_allclose(n * exponent, float(logs[n]), atol=1e-4)
    assert_allclose(indicator, float(max(logs[: n + 1])), atol=1e-4)


def test_the_advance_equals_the_displacement_of_the_orbit_on_the_lift():
    kappa, y, n = (0.3, 0.2), np.linspace(0.3, 0.4, 5), 2000
    x, _ = orbit(kappa, 0.0, y, n)
    _, _, advance = tangent_growth(kappa, 0.0, y, n)
    assert_allclose(advance, x[-1], atol=1e-9)
