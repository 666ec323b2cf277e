"""Segments that do not begin at zero, against rays from zero and each other."""

import numpy as np
import pytest
from cases import thirds

from nasm import barriers
from nasm.critical import Status


@pytest.mark.parametrize(
    "segment",
    thirds(
        [((0.1, 0.5), (1.0, -0.3)), ((0.0, 0.0, 0.2), (0.9, 0.4, 0.0)), ((0.2, -0.1), (0.0, 1.0))]
    ),
)
def test_the_breakup_on_a_segment_is_that_on_the_ray_through_it(segment):
    start, profile = segment
    found = barriers.critical_scale(profile, 1e-3, start)
    assert found.status is Status.OK
    assert found.lower < found.value < found.upper < found.lower * 1.002
    there = np.array(start) + found.value * np.array(profile)
    ray = barriers.critical_scale(there, 1e-3)
    assert abs(ray.value - 1) < 1e-8
    assert ray.omega == found.omega


def test_a_segment_that_begins_without_a_barrier_is_refused():
    found = barriers.critical_scale((-1.0, 0.0), start=(1.2, 1.0))
    assert found.status is Status.OUTSIDE
    assert np.isnan([found.value, found.lower, found.upper]).all()
