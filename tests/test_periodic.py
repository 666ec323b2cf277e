"""Periodic orbits, compared with the map, published residues, symmetries, and each other."""

from dataclasses import replace

import numpy as np
import pytest
from cases import thirds
from oracles import KAPPA_G, LITERATURE

from nasm import periodic, survivors
from nasm.action import ordered_orbits
from nasm.circles import continuation
from nasm.maps import step, step_tangent
from nasm.numbers import NAMES, parse
from nasm.results import Status
from nasm.symmetries import ray

GAMMA = parse("gamma")
FORCINGS = [(0.6,), (-0.4, 0.3), (0.3, 0.1, 0.1), (0.2, -0.3, 0.1), (0.15, 0.1, 0.1, 0.15)]
FIBONACCI = [(5, 8), (8, 13), (13, 21), (21, 34), (34, 55), (55, 89), (89, 144)]


@pytest.mark.parametrize("kappa", FORCINGS)
@pytest.mark.parametrize(("p", "q"), [(0, 1), (1, 2), (2, 5), (3, 4), (5, 13)])
def test_both_orbits_are_closed_and_ordered_with_the_residue_of_DT(kappa, p, q):
    result = ordered_orbits(kappa, p, q)
    for orbit, sign in zip(result, (-1, 1), strict=True):
        x, y = orbit.points()
        following = np.append(x[1:], x[0] + p), np.append(y[1:], y[0])
        np.testing.assert_allclose(step(kappa, x, y), following, rtol=0, atol=1e-12)
        assert np.array_equal(np.argsort((x - x[0] + 1e-9) % 1), np.argsort(np.arange(q) * p % q))
        monodromy = np.eye(2)
        for point in zip(x, y, strict=True):
            monodromy = step_tangent(kappa, *point) @ monodromy
        expected = (2 - np.trace(monodromy)) / 4
        assert sign * expected > 0
        assert orbit.refined_residue() == pytest.approx(expected, abs=1e-10, rel=1e-10)
    assert periodic.residue(kappa, p, q) == result[1].refined_residue()


def test_golden_residues_at_the_breakup_are_those_of_greene_1979():
    # At κ_G the residues of the golden convergents tend to 0.2500888 (minimax) from both sides, and
    # to -0.25543 (minimizing).
    residues = [periodic.residue((KAPPA_G,), p, q) for p, q in [*FIBONACCI, (1597, 2584)]]
    published = LITERATURE["golden_residue"]
    errors = np.array(residues) - published["minimax"]
    assert (errors[:-2] * errors[1:-1] < 0).all()
    assert abs(errors[-1]) < 3e-5
    for p, q in ((987, 1597), (1597, 2584)):
        minimizing, _ = ordered_orbits((KAPPA_G,), p, q)
        assert minimizing.refined_residue() == pytest.approx(published["minimizing"], abs=5e-5)


# In this order: rays on which two extrapolated values agree by chance; circles whose continued
# fraction repeats several quotients; rays close to a cusp; residues lost in rounding errors at all
# scales up to the breakup; and easy rays.
HARD = [
    ("(gamma+1)/(4gamma+5)", ray(25.948730289534073), 1e-9),
    ("(gamma+1)/(4gamma+5)", ray(49.32870995046929), 1e-9),
    ("(5gamma+6)/(4gamma+5)", ray(106.72938325877112), 1e-9),
    ("(5gamma+6)/(4gamma+5)", ray(161.04885519531123), 1e-9),
    ("[1;(1,2)]", (0.9222037618645054, -0.3867043077119192), np.inf),
    ("[1;(1,1,2)]", (-0.9309387579, 0.3651753276), np.inf),
    ("[0;4,(1,2)]", (0.8299350314, 0.5578600634), np.inf),
    ("[0;4,4,4,2,(1)]", (-0.7066172265, 0.7075959885), np.inf),
    ("[0;1,3,4,4,4,2,(1)]", ray(44.99647638965198), np.inf),
    ("[0;1,3,4,4,2,(1)]", (0.7075547711, 0.7066585087), np.inf),
    ("[1;(1)]", ray(315.025), 1e-3),
    ("gamma", ray(45.0005), 1e-3),
    ("[0;2,25,(1)]", ray(18.95274), 1e-4),
    ("[0;1,1,22,(1)]", ray(24.94434), 1e-4),
    *((name, ray(angle), 1e-6) for angle in (30, 115) for name in NAMES),
]


@pytest.mark.parametrize("case", thirds(HARD))
def test_the_error_covers_the_change_at_longer_periods_in_hard_cases(case):
    name, profile, bound = case
    better = periodic.critical_scale(parse(name), profile, 40_000)
    assert better.error < 1e-7
    for q_max in (1500, 6000):
        result = periodic.critical_scale(parse(name), profile, q_max)
        if result.status is Status.OK:
            assert abs(result.value - better.value) <= result.error + better.error
    assert result.status is Status.OK
    assert result.error + better.error < bound


def next_to_a_shorter_one(distance):
    """Return triples (forcing, shorter forcing equivalent to it at distance 0, rotation number).

    The golden circle of the shorter forcing has this rotation number under the longer one.
    """
    near = 1 - distance
    return [
        ((1, near), (1,), parse("2gamma")),
        ((1, -near), (1,), parse("2gamma-1")),
        ((1, near, near), (1,), parse("3gamma")),
        ((1, 0, near, 0), (1, 0), parse("2gamma")),
        ((1, 0, -near, 0), (1, 0), parse("2gamma-1")),
        ((near, distance, -1, distance), (1, 0), parse("2gamma-1")),
    ]


@pytest.mark.parametrize("distance", thirds([1e-6, 1e-2, 1e-7]))
def test_starts_survive_where_a_circle_is_claimed_near_a_shorter_forcing(distance):
    answered = 0
    for profile, _, omega in next_to_a_shorter_one(distance):
        by_residues = periodic.critical_scale(omega, profile)
        by_norms = continuation.critical_scale(omega, profile, 1e-4)
        assert np.isfinite(by_residues.value) == (by_residues.status is Status.OK)
        for result in (by_residues, by_norms):
            if result.status is Status.OK:
                answered += 1
                below = (result.value - result.error) * np.array(profile)
                assert not survivors.eliminates(below, 500)  # 1000 steps would miss survivors
    assert answered >= 6


@pytest.mark.parametrize("which", thirds(range(6)))
def test_residues_give_a_value_at_a_shorter_forcing_but_not_close_to_it(which):
    profile, _, omega = next_to_a_shorter_one(1e-7)[which]
    assert periodic.critical_scale(omega, profile).status is Status.NEAR_CUSP
    profile, short, omega = next_to_a_shorter_one(0.0)[which]
    exact = periodic.critical_scale(GAMMA, short)
    assert periodic.critical_scale(omega, profile) == replace(exact, omega=omega)


@pytest.mark.parametrize("angle", [20, 45, 70, 92.76, 117.43])
def test_tori_break_where_longer_convergents_predict(angle):
    # These vectors converge to a single rotation vector, given by the tribonacci constant.
    results = [
        periodic.torus_scale(f"{p}/{q}", f"{r}/{q}", *ray(angle))
        for p, r, q in [(504, 778, 927), (1705, 2632, 3136), (3136, 4841, 5768)]
    ]
    *shorter, longest = results
    assert all(torus.status is Status.OK for torus in results)
    for torus in shorter:
        assert abs(torus.value - longest.value) < torus.error < 0.1 * torus.value


@pytest.mark.parametrize(
    ("vector", "mean", "amplitude", "kicks", "p", "q"),
    [
        (("89/144", "5/12"), 1.0, 0.0, (1.0,), 89, 144),  # Δκ = 0: the standard map, for any Ω
        (("21/68", "1/2"), 0.9, 0.3, (1.2, 0.6), 21, 34),
    ],
)
def test_tori_of_one_and_two_kicks_are_circles_of_the_map(vector, mean, amplitude, kicks, p, q):
    kappa = periodic.torus_scale(*vector, mean, amplitude).value * np.array(kicks)
    residues = [orbit.refined_residue() for orbit in ordered_orbits(kappa, p, q)]
    assert min(abs(abs(residue) - 0.25) for residue in residues) < 1e-8


def test_the_search_terminates_even_if_orbits_are_lost():
    kappa = (0.9093983570983439, 0.5378622878701697, 0.039093429353188165, 1.0)
    assert periodic.critical_scale("[0;1,1,83,(1)]", kappa, 1500).status is not Status.OK
