import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nasm import fixed_points
from nasm.maps import step

strengths = st.floats(-4, 4)
BEYOND = [(4.5, 4.5), (5.0, 4.0), (4.2, 6.0), (7.0, 3.5), (3.0, 9.0)]


@given(strengths, strengths)
def test_primary_points_are_fixed_and_have_the_residues_of_the_tangent_map(kappa1, kappa2):
    residues = fixed_points.primary_residue(kappa1, kappa2)
    for (x, y), expected in zip(fixed_points.PRIMARY, residues, strict=True):
        x_end, y_end = step((kappa1, kappa2), x, y)
        assert (x_end - 2 * y, y_end) == pytest.approx((x, y), abs=1e-14)
        assert fixed_points.residue((kappa1, kappa2), x, y) == pytest.approx(expected, abs=1e-13)
        assert fixed_points.residue((kappa1, kappa2), x, -y) == pytest.approx(expected, abs=1e-13)


@settings(max_examples=50)
@given(strengths, strengths)
def test_symmetries_permute_the_residues(kappa1, kappa2):
    one, two, three, four = fixed_points.primary_residue(kappa1, kappa2)
    here = fixed_points.primary_residue(-kappa1, -kappa2)
    np.testing.assert_allclose(here, [two, one, four, three], atol=1e-14)
    here = fixed_points.primary_residue(kappa1, -kappa2)
    np.testing.assert_allclose(here, [three, four, one, two], atol=1e-14)


@pytest.mark.parametrize("kappa", BEYOND)
def test_secondary_points_are_fixed(kappa):
    _, x, y = fixed_points.secondary(*kappa)
    for point in ((x, y), (1 - x, -y)):
        x_end, y_end = step(kappa, *point)
        np.testing.assert_allclose([x_end, y_end], point, atol=1e-12)


def test_secondary_points_exist_beyond_the_pitchfork_only():
    kappa1, kappa2 = np.meshgrid(np.linspace(0.05, 8, 40), np.linspace(0.05, 8, 40))
    z, _, _ = fixed_points.secondary(kappa1, kappa2)
    residue = fixed_points.primary_residue(kappa1, kappa2)[1]
    assert np.array_equal(np.isfinite(z), residue < 0)


def test_on_the_diagonal_they_are_the_period_two_orbit_of_the_standard_map():
    # κ1 = κ2 = κ: z - (κ/2) sin z = -z, so 4z = κ sin z, which begins at κ = 4.
    kappa = np.array([3.9, 4.1, 5.0, 6.0])
    z, _, _ = fixed_points.secondary(kappa, kappa)
    assert np.isnan(z[0])
    np.testing.assert_allclose(4 * z[1:], (kappa * np.sin(z))[1:], atol=1e-13)


def test_the_cubic_estimate_vanishes_at_the_pitchfork_but_not_as_printed_and_errs_like_its_cube():
    assert fixed_points.primary_residue(4.0, 4.0)[1] == fixed_points.cubic_estimate(4.0, 4.0) == 0
    assert 6 * 4.0 + 6 * 4.0 + 3 * 4.0 * 4.0 > 90  # Eq. (39), numerator
    # z² = a·ε + O(ε²) at a distance ε from κ1 + κ2 = κ1κ2/2: the estimate errs by O(z³).
    epsilon = np.array([1e-2, 1e-3, 1e-4])
    z, _, _ = fixed_points.secondary(4 + epsilon, 4 + epsilon)
    error = np.abs(z - fixed_points.cubic_estimate(4 + epsilon, 4 + epsilon))
    slopes = np.diff(np.log(error)) / np.diff(np.log(z))
    np.testing.assert_allclose(slopes, 3, atol=0.1)
