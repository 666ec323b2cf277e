"""The Farey tree of residues finds circles that other searches miss, but none beyond breakup.

Just beyond breakup, the last circle is still among the candidates that the search returns.
"""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import oracles
import pytest
from cases import thirds

from nasm import barriers, farey
from nasm.circles import hull
from nasm.symmetries import ray

RIPPLE = np.array([1, -1, -1, 1])


@pytest.mark.parametrize("profile", thirds([ray(30), (0.3, 0.2, 0.25), (1, 0.2, 1), (1,)]))
def test_the_tree_finds_a_circle_below_breakup_and_candidates_above(profile):
    last = barriers.critical_scale(profile, 1e-3)
    inside, outside, *far = (last.value * s * np.array(profile) for s in (0.999, 1.0002, 1.01, 99))
    omega, _, _ = farey.find_existing_circle(inside)
    assert [farey.circle_exists(omega, kappa) for kappa in (inside, outside)] == [True, False]
    nothing, nobles, period = farey.find_existing_circle(outside)
    assert last.omega in nobles
    nowhere, ([_], [_]), shorter = zip(*map(farey.find_existing_circle, far), strict=True)
    assert {nothing, *nowhere} == {None}
    assert max(shorter) < period


@pytest.mark.parametrize("kicks", [3, 4, 6])
def test_orbits_under_a_nearby_forcing_do_not_change_the_answer(kicks):
    kappa, nearby = np.random.default_rng(kicks).uniform(-1, 1, kicks), {}
    for scale in (1.5, 1.49, 1.4, 1.0, 0.7, 0.5, 0.3):
        found, *_ = farey.find_existing_circle(scale * kappa, nearby=nearby)
        assert found == farey.find_existing_circle(scale * kappa)[0]
    assert len(nearby) > 5


def test_huge_residues_of_short_orbits_exclude_circles_without_a_warning():
    nodes = [
        farey._node(Fraction(p, 5), SimpleNamespace(residue=np.float64(1e200))) for p in (1, 2)
    ]
    assert not farey._may_enclose_circle(*nodes, farey.DEFAULT_SETTINGS)


MISSED = [((1, 0.45, 1), 0.551), (1 + 1.7084e-5 * RIPPLE, 0.9648), (1 + 1.78e-4 * RIPPLE, 0.957)]


@pytest.mark.parametrize("case", thirds(MISSED))
def test_the_tree_finds_circles_that_other_searches_miss(case):
    kappa = np.multiply(*case)
    omega, nobles, _ = farey.find_existing_circle(kappa)
    assert oracles.residues_fall(omega, kappa, 3000)
    # At least one of the circles is certified; others may be too close to their own breakup.
    named = [omega] + [one for one in nobles[:6] if farey.circle_exists(one, kappa)]
    assert any(hull.circle_near_orbit(one, kappa, 20_000) is not None for one in named)


@pytest.mark.parametrize(
    ("profile", "omega", "scale", "exists"),
    [
        ((1, 0.55, 1), "[0;1,2,1,3,3,2,1,2,(1)]", 0.600375, False),
        ((1, 0.55, 1), "[0;1,2,1,3,3,1,1,3,(1)]", 0.6002, True),
        ((1, 0.8, 1), "[1;4,1,3,2,2,3,(1)]", 0.7563, False),
    ],
)
def test_residues_that_pass_through_0_are_not_mistaken_for_a_circle(profile, omega, scale, exists):
    # In each case the residues of two or three convergents fall; a decision needs the residues of
    # ten convergents.
    kappa = scale * np.array(profile)
    assert farey.circle_exists(omega, kappa) == exists
    assert oracles.residues_fall(omega, kappa, 3000) is exists
