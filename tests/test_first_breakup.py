"""Segments that do not begin at zero, against residues along them."""

import numpy as np
import pytest

from nasm import barriers, first_breakup, periodic
from nasm.critical import Status


@pytest.mark.parametrize(
    ("start", "profile"), [((0.0, 0.0), (1.0, 0.5)), ((0.1, 0.5), (1.0, -0.3))]
)
def test_the_breakup_on_a_segment_is_that_of_its_last_circle(start, profile):
    found = first_breakup.critical_scale(start, profile, 1e-2)
    assert found.status is Status.OK
    assert found.lower < found.value < found.upper < found.lower * 1.02
    last = np.array(start) + found.value * np.array(profile)
    residue = periodic.critical_scale(found.omega, last)  # on the ray from zero through it
    assert abs(residue.value - 1) < found.error / found.value + residue.error


def test_a_segment_that_begins_without_a_barrier_is_refused():
    assert first_breakup.critical_scale((1.2, 1.0), (-1.0, 0.0)).status is Status.OUTSIDE


def test_from_zero_on_it_is_the_breakup_on_the_ray():
    found, ray = first_breakup.critical_scale((0,), (1,)), barriers.critical_scale((1,))
    assert abs(found.value - ray.value) < found.error
    assert found.omega == ray.omega


def test_values_that_contradict_the_verdicts_are_no_answer(monkeypatch):
    monkeypatch.setattr(first_breakup, "_excess", lambda kappa, tol: 1.0)
    assert first_breakup.critical_scale((0.4,), (1.0,)).status is Status.UNDECIDED
