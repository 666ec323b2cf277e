"""Breakups on segments that do not begin at zero, compared with breakups on rays from zero."""

import numpy as np
import pytest
from cases import thirds
from hypothesis import example, given, settings
from hypothesis import strategies as st

from nasm import barriers, periodic
from nasm.results import Status
from nasm.symmetries import ray

ASYMMETRIC = np.array((1, 0.7, 0.3))
AXIS = periodic.critical_scale("gamma", (1, 0)).value

SEGMENTS = [((0.1, 0.5), (1.0, -0.3)), ((0.2, -0.1), (0.0, 1.0))]


@pytest.mark.parametrize("segment", thirds([*SEGMENTS, ((0.0, 0.0, 0.2), (0.9, 0.4, 0.0))]))
def test_a_segment_and_the_ray_through_its_breakup_point_agree(segment):
    start, profile = segment
    result = barriers.critical_scale(profile, 1e-3, start)
    assert result.status is Status.OK
    assert result.lower < result.value < result.upper < result.lower * 1.002
    there = np.array(start) + result.value * np.array(profile)
    ray = barriers.critical_scale(there, 1e-3)
    assert abs(ray.value - 1) < 1e-8
    assert ray.omega == result.omega


@settings(max_examples=12)
@given(st.floats(5, 40), st.floats(-0.25, 0.3), st.floats(-0.2, 0.25))
@example(None, 0.1, -0.1)  # a segment with three kicks
def test_on_a_segment_to_a_breakup_point_the_circle_breaks_at_its_end(angle, kappa1, kappa2):
    # Some segments begin above the diagonal κ1 = κ2; where they cross it, the centre of the minimax
    # orbit changes.
    omega, profile = ("gamma", ray(angle)) if angle else ("[1;3,(1)]", ASYMMETRIC)
    along_ray = periodic.critical_scale(omega, profile, 1000 if angle else 300)
    end, start = along_ray.value * profile, np.array([kappa1, kappa2, 0.2][: profile.size])
    along = periodic.critical_scale(omega, end - start, 1000 if angle else 300, start=start)
    assert abs(along.value - 1) <= along.error + 5 * along_ray.error
    assert along.error + along_ray.error < (1e-7 if angle else 1e-5)


@pytest.mark.parametrize(
    ("omega", "start", "profile"),
    [
        ("gamma", (0.7, 0.5), (1, 0)),
        ("gamma", (1.5, 1.5), (1, 1)),
        ("gamma", (0.5, 0), (0, 1)),
        ("gamma", (AXIS * (1 + 1e-4), 0), (1, 0)),
        ("[1;(4)]", (0.558, -0.118), (-0.28, 0.96)),  # so far outside that residues overflow
        ("[1;3,(1)]", 1.9 * ASYMMETRIC, (0, 0, 1)),
        (None, (1.2, 1.0), (-1.0, 0.0)),
    ],
)
def test_a_segment_that_starts_outside_is_reported_as_such(omega, start, profile):
    method, *of = (periodic.critical_scale, omega) if omega else (barriers.critical_scale,)
    result = method(*of, profile, start=start)
    assert result.status is Status.OUTSIDE
    assert np.isnan([result.value, result.lower, result.upper]).all()
    just = periodic.critical_scale("gamma", (1, 0), start=(AXIS * (1 - 1e-4), 0))
    assert just.value == pytest.approx(1e-4 * AXIS, abs=1e-11)
