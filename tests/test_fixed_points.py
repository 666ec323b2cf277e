"""Secondary fixed points compared with the map, and with Eq. (38b) expanded about their birth."""

import numpy as np
import pytest

from nasm import fixed_points, maps


@pytest.mark.parametrize("distance", [1e-2, 1e-5, 1e-9, 1e-13])
def test_secondary_points_are_found_however_close_to_their_birth(distance):
    # At κ1 = κ2 = 4, secondary points branch off the primary one: z² = 6·(κ/4 - 1) to first order.
    kappa = 4 + 4 * distance
    z, _, _ = fixed_points.secondary(kappa, kappa)
    assert z[0] == pytest.approx((6 * distance) ** 0.5, rel=0.003 + distance)


def test_no_secondary_point_is_found_before_its_birth():
    kappa = 4 - np.array([0.0, 1e-12, 1e-6, 1.0])
    assert np.isnan(fixed_points.secondary(kappa, kappa)[0]).all()


def test_secondary_points_return_after_two_kicks():
    generator = np.random.default_rng(7)
    kappa = generator.uniform(4, 8, (2, 50))
    _, x, y = fixed_points.secondary(*kappa)
    exists = np.isfinite(x)
    assert exists.sum() > 25
    for k1, k2, x0, y0 in zip(*kappa[:, exists], x[exists], y[exists], strict=True):
        x2, y2 = maps.step((k1, k2), x0, y0)
        assert (x2 - x0 + 0.5) % 1 == pytest.approx(0.5, abs=1e-12)
        assert y2 == pytest.approx(y0, abs=1e-12)
