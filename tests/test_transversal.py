"""Test converse KAM on transversals against second variations of the action and symmetry lines."""

import numpy as np
import oracles
import pytest
from numpy.testing import assert_array_equal

from nasm import circles
from nasm.converse_kam import symmetry_line, transversal
from nasm.converse_kam.transversal import longest_lived
from nasm.maps import direction, rotating_forcing
from nasm.numbers import parse

FORCINGS = [(1.03,), (0.71, 0.46), (0.2, 0.5, 0.36), (0.1, 0.7, -0.3, 0.2)]


def elimination_time(kappa, site, x, y, n_kicks):
    """Return the number of kicks followed in each direction until each start is eliminated.

    The orbits start just before kick `site`.
    """
    x, y = np.array(np.broadcast_arrays(x, np.atleast_1d(y)), float)
    return transversal.elimination(np.roll(kappa, -site), x, y, n_kicks)[0]


@pytest.mark.parametrize("kappa", FORCINGS)
def test_a_start_is_eliminated_once_its_orbit_is_not_minimizing(kappa):
    # Check the definition with the second variation on the part |k| < n of the orbit, not with
    # tangent vectors.
    period, rng = len(kappa), np.random.default_rng(len(kappa))
    n_max, eliminated = 25, 0
    for x, y in rng.uniform(0, 1, (40, 2)):
        site = int(rng.integers(period))
        (kicks,) = elimination_time(kappa, site, x, y, n_max)
        n = int(min(kicks, n_max))
        if kicks <= n_max:
            eliminated += 1
            assert oracles.second_variation(kappa, site, x, y, n) <= 0
        if n > 1:
            assert oracles.second_variation(kappa, site, x, y, n - 1) > 0
    assert eliminated > 5


@pytest.mark.parametrize(
    ("kappa", "site", "a"),
    [
        ((1.03,), 0, 0.5),
        ((-1.03,), 0, 0),
        ((0.71, 0.46), 0, 0.5),
        ((-0.46, -0.71), 1, 0),
        ((-0.43, 0.72), 1, 0.5),
        ((0.72, -0.43), 0, 0.5),
        ((0.1, -0.4), 1, 0),
    ],
)
def test_on_a_symmetry_line_both_criteria_give_the_same_times(kappa, site, a):
    y = (np.arange(-300, 600) + 0.5) / 300
    kicks = elimination_time(kappa, site, a, y, 30 * len(kappa))
    assert_array_equal(kicks, np.rint(symmetry_line.elimination_time(kappa, y, 30) * len(kappa)))
    assert len(np.unique(kicks)) > 5


def test_a_certified_circle_survives_on_every_transversal():
    # With more kicks per period, there are long-lived starts at more values of ω; the search must
    # find the start on the circle among them.
    kappa = 0.255 * direction(rotating_forcing(1, 1, "2/7", 0.02))
    assert circles.invariant_circle(parse("[3;9,4,(1)]"), kappa).certified
    assert np.isinf(longest_lived(kappa, 1000).kicks)
