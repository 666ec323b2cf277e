"""What methods return can be compared, whether or not it holds arrays and NaN."""

import copy
import pickle

import numpy as np
import pytest

from nasm import circles, critical, periodic, planes, self_consistent
from nasm.converse_kam.transversal import Transversal
from nasm.critical import CriticalScale, Status
from nasm.verdicts import verdict

MADE = {
    "verdict of a barrier": (lambda kappa: verdict((kappa,)), 0.3, 0.31),
    "verdict of transport": (lambda kappa: verdict((kappa,)), 2.0, 2.1),
    "circle": (lambda kappa: circles.invariant_circle("gamma", (kappa,)), 0.3, 0.31),
    "no circle": (lambda kappa: circles.invariant_circle("gamma", (kappa,)), 3.0, 3.1),
    "scale": (lambda kappa: periodic.critical_scale("gamma", (kappa,), 300), 0.3, 0.31),
    "no scale": (lambda nan: CriticalScale(*[nan] * 4, None, Status.NO_CIRCLE), np.nan, 1.0),
    "self-consistent kicks": (lambda x: self_consistent.evolve([x], [0.1], 0.1, 0.1, 3), 0.3, 0.4),
    "plane": (planes.three_kicks, 0.3, 0.31),
}


@pytest.mark.parametrize("name", MADE)
def test_results_are_equal_if_all_that_they_hold_is(name):
    make, number, another = MADE[name]
    one = make(number)
    for other in (make(number), copy.copy(one), pickle.loads(pickle.dumps(one))):
        assert one is not other
        assert one == other
    assert one != make(another)
    assert one != 1


def test_planes_and_critical_scales_are_keys():
    assert len({planes.two_kicks(), planes.two_kicks(), planes.three_kicks(0.1)}) == 2
    nothing = [critical.no_answer(None, Status.RATIONAL) for _ in range(2)]
    assert len({*nothing, CriticalScale(1, 0, 0, 2, None, Status.OK)}) == 2


def test_transversals_that_hold_arrays_are_compared_without_an_error():
    one, other = (Transversal(0, np.array([0.3, 0.2, 0.4]), [], float) for _ in range(2))
    assert one == one
    assert one != other
