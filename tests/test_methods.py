"""Properties that every method must have.

- It reproduces the exact breakup of the golden circle under forcings that are equivalent to the
  standard map.
- It gives the same answer for all symmetric images of a forcing.
- Its errors are honest, even close to cusps and for ω close to fractions.
- For random nobles and forcings it returns a number, or a reason why there is no number.
- Rescaling the profile of a ray changes only the unit of the scale.

NumPy's warnings are errors in this suite, so that no overflow goes unnoticed.
"""

from functools import partial

import numpy as np
import pytest
from cases import thirds
from oracles import KAPPA_G

from nasm import Answer, Evidence, barriers, circles, escape, flux, periodic, verdict
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.numbers import NAMES, RotationNumber, moebius, parse
from nasm.results import Status
from nasm.symmetries import ray

GAMMA = parse("gamma")
OF_A_CIRCLE = periodic.critical_scale, continuation.critical_scale, flux.flux


def agree(one, other):
    """Return True if two answers agree within their errors; NaN agrees with nothing."""
    return abs(one.value - other.value) <= one.error + other.error


def is_honest(found):
    """Return True if value and error are both NaN exactly when the status is not OK."""
    return np.isnan([found.value, found.error]).all() == (found.status is not Status.OK)


# P equal kicks of strength κ are P steps of the standard map at κ. A single kick of strength κ in a
# period of P kicks is one step of the standard map at Pκ, where the breakup of a circle depends on
# ω only modulo 1. The rotation number of the last circle is one of `omegas`.
@pytest.mark.parametrize(
    ("profile", "exact", "omegas"),
    [
        ((1,), KAPPA_G, ["1-gamma", "gamma"]),
        ((1, 0), KAPPA_G / 2, ["1-gamma", "gamma"]),
        ((0, 1), KAPPA_G / 2, ["1-gamma", "gamma"]),
        ((-1, 0), KAPPA_G / 2, ["1-gamma", "gamma"]),
        ((1, 1), KAPPA_G, ["2-2gamma", "2gamma"]),
        ((1, -1), KAPPA_G, ["2gamma-1"]),
        ((-1, 1), KAPPA_G, ["2gamma-1"]),
        ((1, 1, 1), KAPPA_G, ["3-3gamma", "3gamma"]),
        ((0, 1, 0), KAPPA_G / 3, ["1-gamma", "gamma", "2-gamma"]),
        ((1, -1, 1, -1), KAPPA_G, ["4gamma-2"]),
        ((1, 0, -1, 0), KAPPA_G / 2, ["2gamma-1", "3-2gamma"]),
        ((0, 1, 0, -1), KAPPA_G / 2, ["2gamma-1", "3-2gamma"]),
        ((1, 0, 0, 0, -1, 0, 0, 0), KAPPA_G / 4, ["2gamma-1", "2gamma+1", "3-2gamma", "5-2gamma"]),
    ],
)
def test_the_golden_circle_of_the_standard_map_in_all_its_disguises(profile, exact, omegas):
    omegas = [parse(name) for name in omegas]
    last = barriers.critical_scale(profile, tol=1e-3)
    assert last.status is Status.OK
    assert abs(last.value - exact) <= last.error < 1e-10
    assert last.lower < exact < last.upper
    assert last.omega in omegas
    assert 0 <= float(last.omega) <= len(profile) / 2
    for q_max, bound in ((300, 1e-6), (1500, 1e-9), (8000, 1e-12)):
        result = periodic.critical_scale(omegas[-1], profile, q_max)
        assert result.status is Status.OK
        assert abs(result.value - exact) <= result.error
        assert abs(result.value - exact) < bound
    assert result.error < 1e-9
    for tol in (1e-4, 1e-5, 1e-6):
        result = continuation.critical_scale(omegas[-1], profile, tol)
        assert result.status is Status.OK
        assert abs(result.value - exact) <= result.error <= max(tol, 3.2e-6)
        assert exact - 0.03 < result.lower < exact
        assert np.isnan(result.upper)
    if len(profile) <= 2:
        result = symmetry_line.critical_scale(profile, 3000)
        assert result.status is Status.OK
        assert abs(result.value - exact) <= result.error < result.upper - exact < 1e-3


def images(profile, omega):
    """Yield each image of a forcing under symmetries, and the ω of the circle's image."""
    profile, period = np.array(profile), len(profile)
    yield np.roll(profile, 1), omega
    yield profile[::-1], omega
    yield -profile, omega
    for turns in (1, 10**6, 10**20):  # y → y + 1 takes ω to ω + P
        yield profile, moebius(omega, 1, period * turns)
    yield -profile[::-1], moebius(omega, -1, period)
    if period % 2 == 0:
        yield profile * (-1.0) ** np.arange(period), moebius(omega, 1, period // 2)


# The flux is computed 20% beyond the breakup, but for two circles only 7% to 12% beyond it.
# Even at these strengths, the gaps in their cantori cover the whole circle to within rounding:
# sites of the minimizing orbit are 1e-17 apart.
@pytest.mark.parametrize(
    ("name", "profile", "size"),
    [
        ("gamma", ray(25), None),
        ("[1;3,(1)]", np.array((1, 0.7, 0.3)), None),
        ("[1;1,1,(4)]", ray(39.99), 0.8753627),
        ("[1;(4)]", ray(40.414), 1.01),
        *(pytest.param(name, ray(25), None, marks=pytest.mark.slow) for name in NAMES[1:]),
    ],
)
def test_symmetric_images_of_a_forcing_have_the_same_answer(name, profile, size):
    omega = parse(name)
    expected = periodic.critical_scale(omega, profile, 3000)
    methods = {
        partial(periodic.critical_scale, q_max=3000): (1.0, 1e-5, 1e-12),
        partial(continuation.critical_scale, tol=1e-3): (1.0, 1e-2, 1e-2),
        flux.flux: (size or 1.2 * expected.value, 1e-2, 1e-2),
    }
    for method, (size, precision, apart) in methods.items():
        here = method(omega, size * profile)
        assert here.status is Status.OK
        for image, carried in images(size * profile, omega):
            there = method(carried, image)
            assert (there.status, there.omega) == (Status.OK, carried)
            assert agree(here, there)
            assert there.value == pytest.approx(here.value, rel=apart)
            assert there.error < precision * there.value
    unlike = profile * [*[1] * (profile.size - 1), -1]
    unlike = periodic.critical_scale(omega, unlike, 3000)
    assert not agree(unlike, expected)


@pytest.mark.parametrize("offset", thirds([0.05, 5e-3, 1e-4, 1e-6, 0.5, 5e-4, 1]))
def test_close_to_a_cusp_errors_are_honest_or_there_is_no_answer(offset):
    for name, cusp, side in (("2gamma", 45, -1), ("2gamma+1", 135, 1), ("gamma", 45, 1)):
        omega, profile = parse(name), ray(cusp + side * offset)
        judge = periodic.critical_scale(omega, profile, 10_000)
        assert is_honest(judge)
        results = [continuation.critical_scale(omega, profile, tol) for tol in (1e-4, 1e-6)]
        if offset >= 5e-4:
            assert [one.status for one in results] == [Status.OK] * 2
        by_residues = periodic.critical_scale(omega, profile)
        # Within 1e-4 degrees of the cusp, orbits long enough to resolve it are lost.
        assert (by_residues.status is Status.NEAR_CUSP) == (offset <= 1e-4)
        for one in (*results, by_residues):
            assert is_honest(one)
            if one.status is judge.status is Status.OK:
                assert agree(one, judge)


@pytest.mark.parametrize(("name", "angle"), [("2gamma", 135), ("2gamma+1", 45)])
def test_two_circles_from_the_paper_have_values_at_each_others_cusps(name, angle):
    # At these cusps both circles are circles of the standard map, with the tail (8, 2); the default
    # q_max covers two periods of the tail. The reference value comes from half orbits on symmetry
    # lines, with periods up to 200 000; its error is 1.5e-11.
    for method, bound in ((periodic.critical_scale, 1e-6), (continuation.critical_scale, 0.04)):
        result = method(parse(name), ray(angle))
        assert result.status is Status.OK
        assert abs(result.value - 0.7661877257363493) <= result.error < bound


@pytest.mark.parametrize("method", OF_A_CIRCLE)
def test_a_rational_omega_has_no_circle(method):
    result = method(parse("3/5"), (0.6, 0.1))
    assert result.status is Status.RATIONAL
    assert np.isnan([result.value, result.error]).all()
    circle = circles.invariant_circle(parse("3/5"), (0.2, 0.1))
    assert (circle.status, circle.certified) == (Status.RATIONAL, False)


LARGE = [RotationNumber((0, *[1] * n, large), (1,)) for n in (6, 9, 12) for large in (100, 10**6)]


@pytest.mark.parametrize("omega", [*LARGE, RotationNumber((0, 2, 10**9), (1,))], ids=str)
def test_convergents_before_a_large_quotient_do_not_decide_the_breakup(omega):
    # Up to q_max, the convergents are the same as for 1/2 or for the golden mean, whose circle
    # breaks last, at scale 2.08.
    for result in (
        periodic.critical_scale(omega, (0.3, 0.2), 1500),
        flux.flux(omega, (0.55, 0.1), 1000),
    ):
        assert result.status is not Status.OK
        assert is_honest(result)
    assert np.size(periodic.crossings(omega, (0.3, 0.2), 1500)) == 0
    result = continuation.critical_scale(omega, (0.3, 0.2))
    assert is_honest(result)
    if result.status is Status.OK:  # `lower` is from a certified circle
        assert result.value - result.error <= result.lower < 2.0806


PROFILE = np.array([1.0, 0.4])
METHODS = {
    "barriers": lambda profile, size: barriers.critical_scale(profile, 1e-1),
    "converse KAM": lambda profile, size: symmetry_line.critical_scale(profile, 300),
    "continuation": lambda profile, size: continuation.critical_scale(GAMMA, profile, 1e-4 / size),
    "escape": lambda profile, size: escape.critical_scale(profile, 3000, 100),
    "periodic": lambda profile, size: periodic.critical_scale(GAMMA, profile, 300),
}


@pytest.mark.parametrize("name", METHODS)
def test_rescaling_a_profile_changes_only_the_unit_even_for_tiny_profiles(name):
    expected = METHODS[name](PROFILE, 1.0)
    assert expected.status is Status.OK
    for size in (2.0**-996, 2.0**13):  # powers of 2, so that rounding does not change escape times
        result = METHODS[name](size * PROFILE, size)
        assert (result.status, result.omega) == (expected.status, expected.omega)
        assert result.error * size == pytest.approx(expected.error, rel=0.3)
        assert abs(result.value * size - expected.value) <= 0.1 * expected.error


def test_periods_that_are_too_short_are_reported():
    for result in (periodic.critical_scale(GAMMA, (1, 0), 13), flux.flux(GAMMA, (0.6, 0.1), 5)):
        assert result.status is Status.NOT_CONVERGED
        assert np.isnan(result.value)


@pytest.mark.parametrize("n_kicks", thirds([2, 4, 3, 1, 5, 6]))
def test_methods_for_a_given_circle_return_a_number_or_a_reason(n_kicks):
    rng = np.random.default_rng(n_kicks)
    for _ in range(4):
        quotients = (10 ** rng.uniform(0, 1.7, rng.integers(0, 4))).astype(int)
        omega = RotationNumber((int(rng.integers(-2, 3)), *quotients.tolist()), (1,))
        half = rng.normal(size=n_kicks)
        profile = (half + np.roll(half[::-1], 1)) * 10 ** rng.uniform(-3, 1)  # even about site 0
        for method, effort in zip(OF_A_CIRCLE, (1500, 1e-4, 3000), strict=True):
            assert is_honest(method(omega, profile, effort))
        circle = circles.invariant_circle(omega, rng.uniform(0, 1) * profile)
        if circle.status is not Status.NOT_CERTIFIED:  # otherwise `error` is a residual
            assert np.isnan(circle.error) == (circle.status is not Status.OK)


@pytest.mark.parametrize("n_kicks", thirds([2, 4, 3, 1, 6]))
def test_methods_for_the_last_circle_return_a_number_or_a_reason(n_kicks):
    rng = np.random.default_rng(n_kicks)
    profile = rng.uniform(0, 0.4) ** np.arange(n_kicks)  # dominant line at the first kick
    profile = np.maximum(profile, np.roll(profile[::-1], 1)) * 10 ** rng.uniform(-3, 1)
    methods = [barriers.critical_scale(profile, 1e-2)]
    if n_kicks <= 2:
        methods.append(symmetry_line.critical_scale(profile, 100))
    for result in methods:
        assert np.isnan(result.value) == (result.status not in (Status.OK, Status.WIDE))
    judged = verdict(profile)
    undecided = judged.answer is Answer.UNDECIDED
    assert undecided == (judged.evidence is Evidence.NONE)
