"""Ordered orbits from the action, checked in high precision, by brute force and by continuation."""

import mpmath
import numpy as np
import oracles
import pytest
import short_orbits

from nasm import action, barriers, farey, flux, periodic
from nasm.circles import continuation
from nasm.maps import rotating_forcing
from nasm.numbers import distinct_convergents, parse
from nasm.results import Status
from nasm.symmetries import ray

ASYMMETRIC = np.array((1, 0.7, 0.3))


@pytest.mark.parametrize("family", ["minimizing", "minimax"])
def test_residues_without_a_symmetry_agree_with_a_fifty_digit_computation(family):
    kappa, p, q = 0.4 * ASYMMETRIC, 37, 29
    orbit = dict(zip(("minimizing", "minimax"), action.ordered_orbits(kappa, p, q), strict=True))
    orbit = orbit[family]
    strengths, x = np.roll(kappa, -orbit.site), orbit.sites()
    assert np.argsort((x[::3] - x[0]) % 1).tolist() == np.argsort(np.arange(q) * p % q).tolist()
    with mpmath.workdps(50):
        at = mpmath.matrix([mpmath.mpf(x[0]), mpmath.mpf(x[0] - (x[-1] - p))])
        for _ in range(3):  # Newton's method for T^q(x, y) = (x + p, y)
            here, y, matrix = at[0], at[1], mpmath.eye(2)
            for strength in np.tile(strengths, q):
                c = mpmath.mpf(strength) * mpmath.cospi(2 * here)
                matrix = mpmath.matrix([[1 + c, 1], [c, 1]]) * matrix
                here, y = oracles.exact_step([strength], here, y)
            at -= mpmath.lu_solve(matrix - mpmath.eye(2), mpmath.matrix([here - p, y]) - at)
        assert abs(at[0] - x[0]) < 1e-12
        expected = float((2 - matrix[0, 0] - matrix[1, 1]) / 4)
    assert (expected > 0) == (family == "minimax")
    assert orbit.residue == pytest.approx(expected, rel=(3 * q) ** 2 * 2**-52)
    assert orbit.refined_residue() == pytest.approx(expected, rel=1e-14)


def test_a_breakup_beyond_a_near_miss_is_found_by_residues_not_by_norms():
    # At scale 0.5195 the ray passes 4e-4 below another sheet of the boundary, and circles at
    # smaller scales seem about to break there. Beyond 0.5195, however, the residues of long orbits
    # still fall; they rise only beyond the breakup.
    omega, profile = parse("[0;1,2,1,3,1,2,(1)]"), rotating_forcing(*ray(160), "1/3", 0)
    by_norms = continuation.critical_scale(omega, profile, 1e-3)
    assert by_norms.status is Status.UNDECIDED
    assert by_norms.lower < 0.5195
    result = periodic.critical_scale(omega, profile)
    assert result.status is Status.OK
    assert result.error < 1e-6
    assert by_norms.lower < result.value
    for scale in (0.523, result.value - 0.002):
        assert oracles.residues_fall(omega, scale * profile, 800)
    assert oracles.residues_fall(omega, (result.value + 0.002) * profile, 800) is False


def test_far_beyond_the_breakup_orbits_are_lost_or_have_large_residues():
    # The scan of the gap finds no ordered orbit at its first position. This used to be mistaken
    # for a flat action.
    kappa = 0.5585 * np.array([0.0494274894847, 0.792760428306, -0.139033252069, 0.792760428306])
    for fraction in distinct_convergents(parse("[0;1,4,1,4,(1)]"), 200)[-3:]:
        residue = periodic.residue(kappa, fraction.numerator, fraction.denominator)
        assert np.isnan(residue) or residue > 10


@pytest.mark.parametrize(("kappa", "p", "q"), [
    ((0.94,), 1, 6), ((0.95,), 1, 6), ((1.0,), 1, 6), ((1.02,), 1, 6), ((0.9,), 1, 8),
    ((2.5,), 1, 2), ((0.0694, -0.6614), 1, 4), ((-0.7466, 1.0338), 1, 4), ((1.0, 1.0), 1, 3),
    ((0.9056, 0.4656), 9, 10),
])  # fmt: skip
def test_short_orbits_are_found_where_a_symmetric_guess_is_on_a_saddle(kappa, p, q):
    judged = short_orbits.on_symmetry_lines(kappa, p, q)
    assert periodic.residue(kappa, p, q) == pytest.approx(max(judged), rel=1e-11)
    assert flux.action_difference(kappa, p, q) > 0


def test_the_residue_of_period_two_is_kappa_squared_over_4_on_every_call():
    for _ in range(2):
        assert periodic.residue((2.5,), 1, 2) == pytest.approx(2.5**2 / 4, rel=1e-14)


def test_a_minimax_orbit_that_is_not_a_maximum_along_any_site_is_found():
    # These are the 2/5 orbits of the standard map, traversed twice in five periods of two equal
    # kicks. As R > 1/2 for five kicks of the minimax orbit, its action has a direction of negative
    # curvature whichever site is held fixed.
    kappa, p, q = (1.1723, 1.1723), 4, 5
    for kind, orbit in enumerate(action.ordered_orbits(kappa, p, q)):
        assert not short_orbits.misses(orbit, kappa, p, q, kind)
    assert 0 < orbit.refined_residue() < 1


@pytest.mark.parametrize(("p", "q"), [(10, 1), (61, 6), (81, 8), (192, 19)])
def test_orbits_are_found_where_the_boundary_between_basins_is_narrow(p, q):
    # Along the boundary of two basins, orbits descend slowly and leave it before they come to the
    # pass of 10/1; the orbits of 81/8 and 192/19 are equal to within rounding at most sites.
    kappa = 0.27328 * rotating_forcing(*ray(45), "10/31", 1 / 124)
    minimizing, minimax = action.ordered_orbits(kappa, p, q)
    for orbit, n_negative in (minimizing, 0), (minimax, 1):
        x = orbit.sites()
        strengths = np.resize(np.roll(kappa, -orbit.site), x.size)
        ahead, behind = np.append(x[1:], x[0] + p), np.append(x[-1] - p, x[:-1])
        forces = ahead - 2 * x + behind - strengths / (2 * np.pi) * np.sin(2 * np.pi * x)
        assert np.abs(forces).max() < 1e-12
        hessian = np.diag(2 + strengths * np.cos(2 * np.pi * x))
        for n in range(x.size):
            hessian[n, n - 1] -= 1
            hessian[n - 1, n] -= 1
        assert (np.linalg.eigvalsh(hessian) < 0).sum() == n_negative
        sign, logarithm = np.linalg.slogdet(hessian)  # the determinant is -4R
        assert -sign * np.exp(logarithm) / 4 == pytest.approx(orbit.residue, rel=1e-6)
    _, not_excluded, _ = farey.find_existing_circle(
        kappa, settings=farey.TreeSettings(max_mediants=400)
    )
    assert len(not_excluded) == 1  # all were excluded; this one required the longest orbit


def _random_cases(n_profiles, kicks, n_fractions, seed):
    """Yield (kappa, p, q) with kappa up to twice the last breakup; some forcings repeat kicks."""
    random = np.random.default_rng(seed)
    for n in range(n_profiles):
        period = kicks[n % len(kicks)]
        profile = random.uniform(-1 if n % 2 else 0, 1, period)
        if n % 5 == 4:
            profile = np.resize(profile[: -(-period // 2)], period)
        scale = barriers.critical_scale(profile, 1e-2)
        assert scale.status is Status.OK
        for _ in range(n_fractions):
            q = int(random.integers(1, 13))
            p = int(random.choice([p for p in range(period * q + 1) if np.gcd(p, q) == 1]))
            yield random.uniform(0.2, 2.0) * scale.value * profile, p, q


@pytest.mark.parametrize(("judge", "kicks", "n_profiles", "n_fractions"), [
    pytest.param(short_orbits.on_symmetry_lines, (1, 2, 2), 21, 12, marks=pytest.mark.slow),
    pytest.param(short_orbits.by_scan, (3, 4, 5, 6), 10, 10, marks=pytest.mark.slow),
    pytest.param(short_orbits.by_scan, (3, 4, 5, 6), 24, 11, marks=pytest.mark.release),
])  # fmt: skip
def test_every_short_orbit_is_found_up_to_twice_the_breakup(judge, kicks, n_profiles, n_fractions):
    cases = list(_random_cases(n_profiles, kicks, n_fractions, 11))
    assert len(cases) == n_profiles * n_fractions
    judged = agreed = 0
    for kappa, p, q in cases:
        pair = action.ordered_orbits(kappa, p, q)  # raises no LostError
        if pair[1].residue == 0:
            continue
        for kind, orbit in enumerate(pair):
            assert not short_orbits.misses(orbit, kappa, p, q, kind), (kappa, p, q)
        residue = pair[1].refined_residue()
        others = [r for r in judge(kappa, p, q) if r > 1e-3]
        if residue > 1e-3 and others:
            judged += 1
            agreed += np.isclose(residue, others, rtol=1e-6).any()
    assert judged > 0.7 * len(cases)
    # Beyond R = 1 there may be several minimax orbits; under repeated kicks some of them
    # are not on any symmetry line.
    assert agreed > 0.9 * judged


@pytest.mark.parametrize("kappa", [(0.3, 0.2, 0.25), (0.6, -0.4, 0.1, 0.5)])
def test_an_orbit_found_from_a_nearby_forcing_is_the_one_that_a_search_finds(kappa):
    kappa = np.array(kappa)
    for p, q in [(0, 1), (1, 2), (2, 7), (7, 19)]:
        _, minimax = action.ordered_orbits(0.995 * kappa, p, q)
        _, searched = action.ordered_orbits(kappa, p, q)
        orbit = minimax.minimax_under(kappa)
        assert orbit.residue == pytest.approx(searched.residue, rel=1e-6)
        for x, wanted in zip(orbit.points(), searched.points(), strict=True):
            np.testing.assert_allclose(np.sort(x % 1), np.sort(wanted % 1), atol=1e-9)
    assert minimax.minimax_under(3 * kappa) is None


def test_no_orbit_is_joined_twice_at_the_same_scale(monkeypatch):
    # Orbits with residue 0 are not followed from scale to scale; they used to be recomputed, by
    # joining shorter orbits, for each longer orbit.
    joined, calls = action.joined, []

    def counted(last, one, chain, kind):
        calls.append(chain.q)
        return joined(last, one, chain, kind)

    monkeypatch.setattr(action, "joined", counted)
    fractions = distinct_convergents(parse("gamma"), 3000)
    orbits = action.ConvergentOrbits(np.zeros(2), np.array((0.2, 0.1)), fractions)
    assert orbits.at(len(fractions) - 1, 1.0, -1).residue < 1e-9
    assert len(calls) == len(set(calls)) > 3


def test_only_the_loss_of_long_orbits_is_evidence_of_broken_circles(monkeypatch):
    kappa, omega = (0.3, 0.2, 0.25), parse("[1;4,(1)]")
    assert farey.circle_exists(omega, kappa)
    scanned = action.ConvergentOrbits.scan

    def losing(self, n, scale):
        if self.chains[n].q < 100:
            raise self.chains[n].lost("a test")
        return scanned(self, n, scale)

    monkeypatch.setattr(action.ConvergentOrbits, "scan", losing)
    with pytest.raises(action.LostError, match=r"orbits of 1/6 were not found: a test") as lost:
        action.ordered_orbits((0.5,), 1, 6)
    assert not lost.value.is_far_beyond
    assert np.isnan(periodic.residue((0.5,), 1, 6))
    assert farey.circle_exists(omega, kappa)
    assert farey.find_existing_circle(kappa)[0] is not None
    result = periodic.critical_scale("gamma", (1.0, 0.0))
    assert result.status is not Status.OK or result.value == pytest.approx(0.48581770302, abs=1e-9)
