"""The secondary points of the diagonal. The rest of `fixed_points` is judged by the claims."""

import numpy as np

from nasm import fixed_points


def test_on_the_diagonal_they_are_the_period_two_orbit_of_the_standard_map():
    # κ1 = κ2 = κ: z - (κ/2) sin z = -z, so 4z = κ sin z, which begins at κ = 4.
    kappa = np.array([3.9, 4.1, 5.0, 6.0])
    z, _, _ = fixed_points.secondary(kappa, kappa)
    assert np.isnan(z[0])
    np.testing.assert_allclose(4 * z[1:], (kappa * np.sin(z))[1:], atol=1e-13)
