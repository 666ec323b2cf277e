"""Segments that do not begin at zero, against rays from zero and each other."""

import numpy as np
import pytest
from cases import thirds

from nasm import barriers, first_breakup, periodic
from nasm.critical import Status
from nasm.numbers import parse
from nasm.planes import three_kicks
from pipeline.cubes import breakdown


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


CIRCLES = [
    ("2gamma", (-0.2, 0.3), (0.7, 0.6)),
    ("gamma", (0.1, 0.5), (1.0, -0.3)),
    ("[1;4,(1)]", (0.0, 0.0, 0.2), (1.0, 1.0, 0.0)),
]


@pytest.mark.parametrize("circle", thirds(CIRCLES))
def test_a_circle_breaks_on_a_segment_where_residues_say(circle):
    omega, start, profile = circle
    found = first_breakup.circle_scale(parse(omega), start, profile, 1e-3)
    residue = periodic.critical_scale(parse(omega), profile, 1500, start)
    assert abs(found.value - residue.value) < found.error + residue.error < 2e-3
    assert 0.9 * residue.value < found.lower < residue.value


def test_circles_are_continued_on_the_rays_of_a_plane_with_an_origin():
    plane, omega = three_kicks(0.2), parse("[1;4,(1)]")
    job = breakdown.by_continuation(plane, [omega], [20.0], 1e-2)
    found = job.compute({"circle": [str(omega)], "angle": np.array([20.0])}, job.cube.settings)
    start, profile = plane.ray(20.0)
    assert found["critical_scale"] == first_breakup.circle_scale(omega, start, profile, 1e-2).value


def test_a_circle_that_is_broken_at_the_start_is_refused():
    found = first_breakup.circle_scale(parse("gamma"), (0.7, 0.5), (1.0, 0.0))
    assert found.status is Status.OUTSIDE
    assert np.isnan([found.value, found.lower]).all()
