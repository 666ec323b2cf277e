"""The size of a ray's profile is only the unit of the scale, whatever the method."""

import numpy as np
import pytest

from nasm import barriers, escape, maps, periodic
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.critical import Status
from nasm.numbers import parse

GAMMA, PROFILE = parse("gamma"), np.array([1.0, 0.4])
METHODS = {
    "barriers": lambda profile, size: barriers.critical_scale(profile, 1e-1),
    "cones": lambda profile, size: symmetry_line.critical_scale(profile, 300),
    "continuation": lambda profile, size: continuation.critical_scale(GAMMA, profile, 1e-4 / size),
    "escape": lambda profile, size: escape.critical_scale(profile, 1000, 100),
    "periodic": lambda profile, size: periodic.critical_scale(GAMMA, profile, 300),
}


@pytest.mark.parametrize("name", METHODS)
def test_a_ray_s_size_is_a_unit_down_to_the_smallest(name):
    expected = METHODS[name](PROFILE, 1.0)
    assert expected.status is Status.OK
    for size in (2.0**-996, 2.0**13):  # without rounding, which would change escapes
        found = METHODS[name](size * PROFILE, size)
        assert (found.status, found.omega) == (expected.status, expected.omega)
        assert found.error * size == pytest.approx(expected.error, rel=0.3)
        assert abs(found.value * size - expected.value) <= 0.1 * expected.error


@pytest.mark.parametrize("profile", [(1e-308, 0.0), (5e-324, 0.0), (0.0, -9e-301)])
def test_a_ray_whose_scales_would_be_no_floats_is_refused(profile):
    for method in METHODS.values():
        with pytest.raises(ValueError, match=r"profile=.* has no strength of 1e-300 or more"):
            method(profile, 1.0)
        with pytest.raises(ValueError, match="profile is zero; a ray needs a direction"):
            method((0.0, 0.0), 1.0)
    with pytest.raises(ValueError, match="has no strength of 1e-300 or more"):
        periodic.torus_scale("5/8", "1/3", 1e-310, 0.0)
    np.testing.assert_array_equal(maps.direction((0.0, -1e-300)), (0.0, -1e-300))
