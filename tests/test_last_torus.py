"""Kicks that need not repeat, and the last barrier of rotating maps of any frequency."""

import numpy as np
import pytest
from cases import thirds
from oracles import KAPPA_G

from nasm.converse_kam import sequence
from nasm.critical import Status
from nasm.symmetries import ray
from nasm.tori import last_torus

# Periods, where their last circles break by residues or continuation, and how far above that no
# graph is left: without a symmetry minimizing orbits cross the lines.
KNOWN = ((1.0,), KAPPA_G, 0.01), ((0.3, 0.2, 0.25), 1.79656, 0.05)


@pytest.mark.parametrize("case", thirds(KNOWN))
def test_a_sequence_that_repeats_loses_its_graphs_past_the_breakup(case):
    period, breakup, above = case
    kappa = np.tile(period, 601)
    upper = sequence.critical_scale(kappa).upper
    assert breakup < upper < (1 + above) * breakup
    assert sequence.last_survivor(0.99 * breakup * kappa).kicks == np.inf


def test_strong_random_kicks_leave_no_graph_and_the_last_start_to_go_is_told():
    kappa = np.random.default_rng(20).uniform(0.8, 1.8, 300)
    last = sequence.last_survivor(kappa)
    site, reach = last.site, int(last.kicks)
    assert reach < 20
    for less, life in ((0, reach), (1, np.inf)):  # the kicks told do it alone, fewer do not
        first, end = max(site - reach + less, 0), site + reach - less
        alone = sequence.elimination_time(kappa[first:end], 0.0, site - first, [last.x], [last.y])
        assert alone == life


def test_searches_that_disagree_give_no_bound(monkeypatch):
    search = sequence.last_survivor
    found = sequence.critical_scale(np.ones(64), 0.1)
    assert found.status is Status.OK
    assert found.value + found.error == pytest.approx(found.upper)

    def careless(kappa, theta=0.0, effort=8):
        return search(1.3 * kappa if effort == 1 else kappa, theta, effort)

    monkeypatch.setattr(sequence, "last_survivor", careless)
    found = sequence.critical_scale(np.ones(64), 0.1)
    assert found.status is Status.UNDECIDED
    assert np.isnan(found.upper)


@pytest.mark.slow
def test_the_last_circle_of_a_fraction_is_in_its_bracket():
    found, omega = last_torus.of_fraction("2/5", 3 / 70, *ray(45), 4000)
    assert found.lower < 0.270686 < found.upper < 1.06 * found.lower  # `barriers`, ± 0.0005
    assert 0 < omega < 0.5


def test_without_an_amplitude_the_last_torus_is_the_golden_circle():
    found, omega = last_torus.of_irrational(2**0.5 - 1, 1.0, 0.0, 4000)
    assert found.lower < KAPPA_G < found.upper < 1.05 * found.lower
    assert omega == pytest.approx((3 - 5**0.5) / 2, abs=0.05)
