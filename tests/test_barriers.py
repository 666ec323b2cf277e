"""Last barriers compared with κ_G, other circles and other methods; symmetries; misled searches."""

import time
from dataclasses import replace
from itertools import product

import numpy as np
import oracles
import pytest
from cases import thirds
from oracles import KAPPA_G

from nasm import action, barriers, circles, escape, orbits, periodic, survivors, symmetries
from nasm.barriers import critical_scale
from nasm.circles import continuation, hull
from nasm.converse_kam import transversal
from nasm.farey import LONGEST_PERIOD, circle_exists
from nasm.maps import rotating_forcing
from nasm.numbers import moebius, parse
from nasm.planes import two_kicks
from nasm.results import CriticalScale, Status
from nasm.symmetries import ray

GAMMA = parse("gamma")


def mirror_images(omega, period):
    """Return the rotation numbers ±ω + P·n in [0, P]; their circles all break at the same scale."""
    images = [moebius(omega, sign, period * n) for sign in (1, -1) for n in range(-3, 4)]
    return {image for image in images if 0 <= float(image) <= period}


def is_shown(found):
    """Return True if the status is OK and the value is between lower and upper."""
    return found.status is Status.OK and found.lower < found.value < found.upper


def first_escapes(found, profile):
    """Return the steps until the first escape, at the lower scale and at 1.2 times the upper."""
    kappas = np.outer([np.fmin(found.lower, found.value), 1.2 * found.upper], profile)
    return escape.first_escape(kappas, *escape.ensemble(64), [64], 300_000)[0]


def test_on_the_axes_gamma_and_one_minus_gamma_are_degenerate():
    for profile in ((1, 0), (0, 1), (-1, 0)):
        assert symmetries.degenerate_partner(GAMMA, profile) == moebius(GAMMA, -1, 1)
    assert symmetries.degenerate_partner(parse("[0;1,3,(4)]"), (1, 1)) is None
    one, other = (periodic.critical_scale(omega, (1, 0)) for omega in (GAMMA, parse("[0;2,(1)]")))
    assert abs(one.value - other.value) < one.error + other.error


def nobles(bound):
    """Return the nobles (p + γr)/(q + γs) in (0, 1), where q ≤ `bound`.

    The fraction r/s is a Farey neighbour of p/q with s ≤ q.
    """
    fractions = [(p, q) for q in range(1, bound + 1) for p in range(q + 1)]
    pairs = [(*f, *g) for f in fractions for g in fractions if g[1] <= f[1]]
    result = {moebius(GAMMA, r, p, s, q) for p, q, r, s in pairs if abs(p * s - r * q) == 1}
    return [omega for omega in result if 0 < float(omega) < 1]


SAMPLES = [(13.7, 12, 400), pytest.param(40.6, 20, 400, marks=pytest.mark.slow)]
SAMPLES += [
    pytest.param(angle, 60, 800, marks=mark)  # a thousand nobles
    for angle, mark in zip(
        np.random.default_rng(16).uniform(0, 44, 3),
        [pytest.mark.slow, pytest.mark.release, pytest.mark.release],
        strict=True,
    )
]


@pytest.mark.parametrize(("angle", "bound", "q_max"), SAMPLES)
def test_the_last_barrier_breaks_last_among_all_simple_nobles(angle, bound, q_max):
    result, omegas = critical_scale(ray(angle), 1e-3), nobles(bound)
    assert is_shown(result)
    scales = [periodic.critical_scale(omega, ray(angle), q_max) for omega in omegas]
    known = [scale for scale in scales if scale.status is Status.OK]
    assert len(known) > 0.9 * len(omegas)
    best = max(known, key=lambda scale: scale.value)
    assert best.omega in mirror_images(result.omega, 2)
    assert best.value == pytest.approx(result.value, rel=1e-6)


PROFILES = [(1, 0.2, 0.2), ray(20), (1.8, -0.1, -0.1), ray(37), (0.2, 0.1, 1, 0.1), ray(115)]
# For these two forcings, both symmetry lines of the centre meet minimizing orbits.
PROFILES += [rotating_forcing(*ray(93), "1/3", 0), rotating_forcing(*ray(160), "1/3", 0.02)]
GENERIC = (0.3, 0.2, 0.25)
CASES = [(1e-3, profile, None) for profile in PROFILES]
CASES += product([1e-4, 1e-3], map(ray, [0, 36.1, 43.9, 62.5, 104, 127.7]), [None])
CASES += [(2e-5, ray(24.3), None)]
# A forcing of three kicks, and antiperiodic forcings, each with the name of its last circle.
OWN = [(1e-3, GENERIC, "[1;4,(1)]"), (1e-3, (1, 1, 1, 1, -1, -1, -1, -1), "[2;(4)]")]
OWN += [(tol, (k, 1, -k, -1), "[0;(4)]") for tol, k in ((1e-3, 0.3), (1e-3, 1), (1e-4, 1))]


@pytest.mark.parametrize("case", thirds([*OWN, *CASES]))
def test_all_methods_agree_on_the_breakup_and_brackets_meet_the_tolerance(case):
    tol, profile, omega = case
    result = critical_scale(profile, tol)
    assert is_shown(result)
    assert result.upper - result.lower <= tol * result.value * (1 + 1e-9)
    assert result.error < 1e-6 * result.value
    assert 0 <= float(result.omega) <= len(profile) / 2
    if omega:
        assert str(result.omega) == omega
    upper, last = transversal.upper_scale(profile, 300)
    # Under antiperiodic forcing, a step in the lifetime law is half a period.
    half = len(profile) // 2
    antiperiodic = half and np.array_equal(profile[half:], np.negative(profile[:half]))
    step = half if antiperiodic else len(profile)
    least, most = upper * (1 - np.array(transversal.EXCESS_BOUNDS[::-1]) * step / last.kicks)
    assert least <= result.value <= most
    by_norms = continuation.critical_scale(result.omega, profile, 1e-4)
    assert abs(by_norms.value - result.value) <= by_norms.error + result.error < 2e-4
    assert np.isinf(first_escapes(result, profile)).tolist() == [True, False]


def test_the_eight_symmetric_images_of_a_ray_have_the_same_barrier():
    expected = critical_scale(ray(38.8), 1e-3)
    last = mirror_images(expected.omega, 2)
    for angle in two_kicks().unfold(38.8):
        result = critical_scale(ray(angle), 1e-3)
        assert is_shown(result)
        assert abs(result.value - expected.value) <= result.error + expected.error
        for side in ("lower", "upper"):
            assert getattr(result, side) == pytest.approx(getattr(expected, side), rel=1e-8)
        assert 0 <= float(result.omega) <= 1
        for turn in (-360, 0, 360):
            folded, omega_shift = two_kicks().fold(angle + turn)
            assert folded == pytest.approx(38.8, abs=2e-9)
            assert mirror_images(moebius(result.omega, 1, int(omega_shift)), 2) == last


def disguised(profile, rng):
    """Return a random symmetric image of a forcing; its barriers break at the same scale."""
    profile = rng.choice([-1, 1]) * np.roll(profile, rng.integers(profile.size))
    profile = profile[:: rng.choice([-1, 1])]
    alternates = profile.size % 2 == 0 and rng.random() < 0.5
    return profile * (-1.0) ** np.arange(profile.size) if alternates else profile


def assert_both_ways_agree(profile, rng, tol, monkeypatch):
    expected = critical_scale(profile, tol)
    with monkeypatch.context() as patch:
        patch.setattr(survivors, "has_dominant_line", lambda kappa: False)
        result = critical_scale(disguised(np.array(profile), rng), tol)
    for scale in (expected, result):
        assert scale.status is not Status.OK or is_shown(scale)
    assert np.nanmax([expected.lower, result.lower]) < min(expected.upper, result.upper)
    if expected.status is result.status is Status.OK:
        assert abs(result.value - expected.value) <= result.error + expected.error
    return expected.status is result.status is Status.OK


@pytest.mark.parametrize("profile", [(0.6, 0.8), (1.8, -0.1, -0.1)])
def test_hiding_a_symmetry_from_the_search_does_not_change_the_result(profile, monkeypatch):
    assert assert_both_ways_agree(profile, np.random.default_rng(18), 1e-2, monkeypatch)


@pytest.mark.parametrize("n_forcings", [
    pytest.param(12, marks=pytest.mark.slow),
    pytest.param(24, marks=pytest.mark.release),
])  # fmt: skip
def test_hiding_symmetries_of_random_forcings_does_not_change_results(n_forcings, monkeypatch):
    rng, decided = np.random.default_rng(18), 0
    for _ in range(n_forcings):
        half, period = rng.normal(size=4), int(rng.integers(2, 7))
        profile = np.array([half[min(n, period - n)] for n in range(period)])
        decided += assert_both_ways_agree(profile, rng, 1e-2, monkeypatch)
    assert decided >= 0.9 * n_forcings


# So close to a forcing with a shorter period, the boundary falls steeply, as at a cusp. For
# (1, 1, 1.0001), both on the line x = 1/2 and on a transversal, some start survives 64 000 steps
# at scale 0.967, but none does at 0.968.
@pytest.mark.parametrize(
    ("profile", "tol", "breakup", "about", "top"),
    [
        pytest.param((1, 1, 1.0001), 0.05, 0.9675, 5e-4, 0.9717, marks=pytest.mark.slow),
        pytest.param((1, 1, 1 - 1.1e-6), 1e-2, KAPPA_G, 0, 1.01 * KAPPA_G, marks=pytest.mark.slow),
        ((1, 1 - 1e-7), 1e-1, KAPPA_G, 0.01, 1.0001 * KAPPA_G),
    ],
)
def test_near_a_shorter_period_the_value_is_right_or_missing(profile, tol, breakup, about, top):
    result = critical_scale(profile, tol)
    assert not result.lower >= min(breakup + about, result.upper)
    assert breakup - about < result.upper < top
    assert np.isnan(result.value) or abs(result.value - breakup) < result.error + about
    if len(profile) == 2:  # residues do not resolve the cusp and give no value
        assert result.status is Status.NEAR_CUSP
        assert np.isnan([result.value, result.error]).all()


@pytest.mark.parametrize("profile", [(1, 1 + 2**-52), (1, -1 - 1e-12)])
def test_a_cusp_closer_than_orbits_resolve_is_bracketed_by_the_circle_of_the_cusp(profile):
    result = critical_scale(profile)
    assert result.status is Status.NEAR_CUSP
    assert np.isnan([result.value, result.error]).all()
    assert (1 - 5e-4) * KAPPA_G < result.lower < KAPPA_G < result.upper < (1 + 1e-4) * KAPPA_G


@pytest.mark.parametrize(
    ("away", "omega", "q", "tol"),
    [
        (1e-5, "[0;4,4,4,4,4,2,(1)]", 9000, 1e-3),
        pytest.param(1e-4, "[0;4,4,4,4,2,(1)]", 20_000, 1e-4, marks=pytest.mark.slow),
    ],
)
def test_near_antiperiodic_forcing_no_circle_breaks_above_upper(away, omega, q, tol):
    # An earlier search missed these two circles: its upper bounds were below their breakups.
    profile = np.array([1, 1, -1, -1 + away])
    judge = periodic.critical_scale(omega, profile, q, between=(0.354, 0.356))
    result = critical_scale(profile, tol)
    assert result.lower < judge.value - judge.error
    assert judge.value + judge.error < result.upper
    assert result.status is Status.NEAR_CUSP or result.value + result.error > judge.value


@pytest.mark.slow
@pytest.mark.parametrize(
    ("profile", "known"),
    [
        ((1, 0.55, 1), 0.6002),
        ((1, 0.75, 1), 0),
        ((1, 0.35, 1, 0.35, 1), 0),
        ((1, 1, 0.8, 1, 1), 0),
        ((1, 0.45, 1), 0.5505),
        ((1, 0.4, 1, 0.4, 1), 0.4961),  # a circle is certified at 0.49635
        ((1, 1, 0.55, 1, 1), 0.6287),  # this circle exists above other bands of circles
        (rotating_forcing(*ray(45), "5/13", 1 / 26), 0.2962),  # missed by the first search
        (1 + 1.78e-4 * np.array([1, -1, -1, 1]), 0.956),  # near a cusp
    ],
    ids=str,
)
def test_where_circles_break_and_reappear_the_bracket_is_still_narrow(profile, known):
    """Residues show that circles exist up to `known`; some searches for survivors miss them."""
    result = critical_scale(profile, 1e-3)
    assert max(known, result.lower) < result.value < result.upper < result.lower * (1 + 4e-3)
    assert (result.status is Status.WIDE) == (result.upper - result.lower > 2e-3 * result.value)
    assert result.value + result.error >= result.upper - 1e-3 * result.value
    assert np.isinf(first_escapes(result, profile)).tolist() == [True, False]
    beyond = 1.002 * result.upper * np.array(profile)
    assert not any(oracles.residues_fall(noble, beyond, 1000) for noble in nobles(3))


@pytest.mark.slow
def test_the_results_for_20_random_forcings_are_correct():
    rng, decided, escaped = np.random.default_rng(300), 0, 0
    for _ in range(20):
        profile = rng.normal(size=int(rng.integers(3, 7)))
        result = critical_scale(profile, 1e-3)
        if result.status is not Status.OK:
            continue
        decided += is_shown(result)
        # No circle with another ω is certified above the bracket, and orbits escape only above it.
        for omega in (
            moebius(noble, 1, n) for noble in nobles(3) for n in range(profile.size // 2)
        ):
            other = continuation.critical_scale(omega, profile, 1e-2)
            assert not other.lower >= result.upper
            assert not other.value - 2 * other.error > result.upper
        inside, outside = first_escapes(result, profile)
        assert inside == np.inf
        escaped += outside < np.inf
    assert decided >= 0.9 * 20
    assert escaped >= 0.8 * 20  # under the other forcings, escape takes longer


WRONG = [*product([ray(30)], [0.99, 1.01], [1e-2]), *product([GENERIC], [0.98, 1.02], [1e-2])]
WRONG += product([ray(30)], [0.998, 1.002], [1e-3])


@pytest.mark.parametrize("case", thirds(WRONG))
def test_a_wrong_breakup_by_residues_does_not_mislead_the_search(case, monkeypatch):
    (profile, factor, tol), real = case, periodic.critical_scale
    exact = critical_scale(profile, tol).value

    def wrong(omega, profile, *arguments, **named):
        result = real(omega, profile, *arguments, **named)
        return replace(result, value=factor * result.value)

    monkeypatch.setattr(periodic, "critical_scale", wrong)
    result = critical_scale(profile, tol)
    assert not result.lower > exact
    assert exact < result.upper < exact * 1.03
    assert result.status is not Status.OK or abs(result.value - exact) <= result.error


def misled(monkeypatch, candidates):
    """Make the first rounds of the search use the given candidates, one list per round.

    Return a list to which every round appends its forcing.
    """
    rounds, real = [], barriers.candidates

    def other(kappa, start, *steps):
        rounds.append(kappa)
        if len(rounds) <= len(candidates):
            return [parse(name) for name in candidates[len(rounds) - 1]]
        return real(kappa, start, *steps)

    monkeypatch.setattr(barriers, "candidates", other)
    return rounds


def assert_same_barrier(found, expected):
    assert abs(found.value - expected.value) <= found.error + expected.error
    assert found.omega == expected.omega
    assert found.lower < expected.value < found.upper < (1 + 1e-3) * expected.value


@pytest.mark.parametrize("angle", [30, 36.1])
@pytest.mark.parametrize(
    "wrong", thirds([["gamma"], ["[0;2,3,(1)]", "gamma+1"], ["[0;1,5,(1)]"], []])
)
def test_a_wrong_candidate_is_rejected_and_the_right_one_is_found(angle, wrong, monkeypatch):
    expected = critical_scale(ray(angle), 1e-3)
    assert not {parse(name) for name in wrong} & mirror_images(expected.omega, 2)
    misled(monkeypatch, [wrong])
    assert_same_barrier(critical_scale(ray(angle), 1e-3), expected)


@pytest.mark.parametrize("wrong", [["2gamma", "[0;5,(1)]"], ["[0;2,3,(1)]"], []])
def test_if_all_candidates_are_wrong_the_farey_tree_finds_the_circle(wrong, monkeypatch):
    expected = critical_scale(ray(30), 1e-3)
    rounds = misled(monkeypatch, [wrong] * 100)
    assert_same_barrier(critical_scale(ray(30), 1e-3), expected)
    assert rounds


@pytest.mark.parametrize(("angle", "needs_long_orbits"), [(30, False), (44.999, True)])
def test_long_orbits_are_used_only_close_to_a_cusp(angle, needs_long_orbits, monkeypatch):
    periods, join = [], action.joined

    def joined(last, one, chain, kind):
        periods.append(chain.q)
        return join(last, one, chain, kind)

    monkeypatch.setattr(action, "joined", joined)
    assert is_shown(critical_scale(ray(angle), 1e-4))
    assert (max(periods) > 4 * LONGEST_PERIOD) == needs_long_orbits


@pytest.mark.parametrize(("profile", "questions"), [(GENERIC, 1), ((1, 0.8, 1), 8)])
def test_a_search_limited_to_too_few_scales_has_a_bound_but_no_value(profile, questions):
    exact = critical_scale(profile, 1e-3)
    result = critical_scale(profile, 1e-3, effort=barriers.Effort(max_questions=questions))
    assert result.status is Status.NOT_CONVERGED
    assert np.isnan([result.value, result.error]).all()
    assert result.omega is None
    assert not result.lower > exact.upper
    assert exact.lower < result.upper


def test_the_scale_is_raised_until_the_farey_tree_shows_no_circle():
    segment = barriers._Segment(np.zeros(3), np.array(GENERIC))
    tree = barriers._Tree(segment, np.inf, barriers.Effort())
    exact, scale = critical_scale(GENERIC, 1e-2).value, tree.lowest_excluded(1.75)
    assert exact < scale < 1.02 * exact
    assert tree.lowest_excluded(1.75) == scale
    assert tree.ask(scale)[0] is None


def test_a_circle_that_breaks_just_after_the_last_excluded_one_is_found():
    """[0;4,3,(1)], which the tree excludes last, breaks 9e-5 earlier than [0;4,3,2,(1)]."""
    profile = (-0.663821954890323, 0.9944856278202228, -0.4426921491035081)
    earlier, later = (
        periodic.critical_scale(omega, profile, 3000, between=(0.698, 0.7))
        for omega in ("[0;4,3,(1)]", "[0;4,3,2,(1)]")
    )
    assert earlier.value + earlier.error < later.value - later.error
    result = critical_scale(profile, 1e-3)
    assert abs(result.value - later.value) <= result.error + later.error


@pytest.fixture(scope="module")
def compiled():
    """Compile the kernels of a search, so that only the search itself is timed."""
    critical_scale(np.random.default_rng(64).normal(size=9), 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [2, 6])
@pytest.mark.parametrize("period", [9, 24, 64])
def test_a_search_ends_within_the_time_allowed(period, seconds, compiled):
    """When time runs out, a search of the Farey tree in progress at one scale may still finish."""
    profile = np.random.default_rng(64).normal(size=period)
    begun = time.thread_time()
    result = critical_scale(profile, 1e-4, seconds=seconds)
    assert time.thread_time() - begun < 1.5 * seconds + 1
    assert not result.lower > result.upper


def test_a_search_from_a_nonzero_start_has_not_converged_if_time_runs_out():
    result = critical_scale((1, 0.7, 0.5), 1e-3, start=(0.1, 0.1, 0.1), seconds=1e-3)
    assert result.status is Status.NOT_CONVERGED


def test_upper_is_missing_if_the_search_ends_below_an_existing_circle(monkeypatch):
    monkeypatch.setattr(barriers, "_eliminated_above", lambda _, tol, at: (at.outside, GAMMA))
    result = critical_scale(ray(30), 1e-3, effort=barriers.Effort(max_questions=0))
    assert result.status is Status.NOT_CONVERGED
    assert np.isnan([result.value, result.error, result.upper]).all()


def test_without_a_circle_certified_near_the_breakup_the_status_is_wide(monkeypatch):
    monkeypatch.setattr(hull, "circle_near_orbit", lambda *_: None)
    monkeypatch.setattr(hull, "certified_circle", lambda _, *more: (0.997 * more[1], 0))
    result = critical_scale(ray(30), 1e-3)
    assert result.status is Status.WIDE
    assert result.lower == 0.997 * result.value < result.value < result.upper


@pytest.mark.parametrize("offset", thirds([0.01, 3.52361034802e-3, 1e-3, 0.1]))
def test_near_the_cusp_results_are_consistent_or_have_no_value(offset):
    cusp = KAPPA_G * 2**0.5
    results = [critical_scale(ray(45 - offset), tol) for tol in (1e-3, 1e-4)]
    # The results for the two tolerances do not contradict each other.
    lower = max((scale.lower for scale in results if not np.isnan(scale.lower)), default=0)
    upper = min(scale.upper for scale in results)
    assert lower < upper < cusp * (1 + 1e-4)
    for scale in results:
        if scale.status in (Status.UNDECIDED, Status.NEAR_CUSP):
            assert np.isnan([scale.value, scale.error]).all()
        else:
            assert is_shown(scale)
            assert lower < scale.value + scale.error
            assert scale.value - scale.error < upper
    if offset > 3e-3:
        assert {scale.status for scale in results} == {Status.OK}


@pytest.mark.parametrize(
    "profile",
    thirds(
        [(1, 1), *map(ray, np.random.default_rng(16).uniform(0, 45, 5)), (1, -1), (1, 0, -1, 0)]
    ),
)
def test_the_last_circle_is_an_invariant_graph_at_the_lower_scale(profile):
    result = critical_scale(profile, 1e-3)
    circle = barriers.last_circle(result, profile)
    assert circle.certified
    assert circle.kappa == pytest.approx(result.lower * np.array(profile), rel=1e-12)
    assert circles.invariant_circle(result.omega, circle.kappa).status is Status.TOO_FEW_MODES
    x, y = circles.graph(circle)
    assert (np.diff(x) > 0).all()
    assert oracles.invariance_error(circle) < min(10 * circle.error, 1e-8)
    measured = orbits.rotation_number(circle.kappa, x[0], y[0], 10_000)[0]
    assert measured == pytest.approx(float(result.omega), abs=1e-9)


def test_without_a_certified_circle_there_is_no_last_circle():
    nothing = CriticalScale(1.0, 0.1, np.nan, 2.0, GAMMA, Status.OK)
    with pytest.raises(ValueError, match=r"lower=nan.*tol=1e-3"):
        barriers.last_circle(nothing, (1, 0))
    wrong = CriticalScale(2.0, 0.1, 1.98, 2.0, GAMMA, Status.OK)  # the circle breaks at 0.486
    assert barriers.last_circle(wrong, (1, 0)).status is Status.NOT_CERTIFIED


@pytest.mark.parametrize("kappa", thirds([(0.9, 0.3), (1.2,), (0.3, 0.9), (0.2, 0.2, 0.9)]))
def test_the_longest_lived_start_rotates_like_the_last_circle_for_a_while(kappa):
    """The start is moved to the beginning of the period, whichever site the search used."""
    scale = barriers.critical_scale(kappa, 1e-3)
    beyond = scale.value * 1.0005 * np.array(kappa)
    x, y, steps = survivors.longest_lived_start(beyond, 10_000)
    assert 600 < steps < 6000
    omega, _ = orbits.rotation_number(beyond, x, y, 1000)
    images = [abs(omega - sign * float(scale.omega)) % len(kappa) for sign in (1, -1)]
    assert min(min(image, len(kappa) - image) for image in images) < 1e-3


@pytest.mark.slow
def test_no_circle_exists_just_above_upper_where_circles_form_bands():
    profile = np.array((1, 0.37, 1, 0.37, 1))
    upper = critical_scale(profile, 1e-3).upper
    above = upper * (1 + np.array([1e-6, 1e-5, 1e-4])) * profile[:, None]
    for kappa in above.T:
        assert not circle_exists("[1;3,1,2,4,1,2,1,3,(1)]", kappa, 10_000)


@pytest.mark.slow
def test_a_coarse_search_also_finds_the_breakup_where_circles_form_bands():
    scale = critical_scale((1, 0.63, 1), 1e-2)
    # An independent search showed that a circle exists at 0.62595.
    assert scale.status in (Status.OK, Status.WIDE)
    assert scale.value + scale.error > 0.62595
    assert scale.upper > 0.62595
