"""Invariant circles: two Newton methods, iteration, symmetries, fake circles; choice of grids."""

from dataclasses import replace
from itertools import islice

import mpmath
import numpy as np
import oracles
import pytest
from cases import irrationals
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import KAPPA_G

from nasm import circles, orbits
from nasm.circles import fourier, parameterization
from nasm.numbers import NAMES, RotationNumber, convergents, moebius, parse
from nasm.results import Status

GAMMA = parse("gamma")
LIOUVILLE = (0, 1, 10, 100, 1000, 10**4, 10**5)

strengths = st.floats(-0.35, 0.35)


def newton_errors(newton_step, omega, kappa, u, steps):
    errors = []
    for _ in range(steps):
        u, error = newton_step(omega, kappa, u)
        errors.append(error)
    return u, np.array(errors)


@pytest.mark.parametrize("kappa", [(0.5,), (0.3, 0.2), (-0.2, 0.25), (0.05, -0.1, 0.1, 0.05)])
@pytest.mark.parametrize("name", ["gamma", "(5gamma+6)/(4gamma+5)", "[0;(2)]"])
def test_the_two_newton_methods_find_the_same_circle(name, kappa):
    omega, n = parse(name), 256
    near = circles.invariant_circle(omega, 0.97 * np.array(kappa))
    assert near.certified
    start = fourier.resample(near.u, n)
    results = []
    for newton_step in (circles.newton_step, parameterization.newton_step):
        u, errors = newton_errors(newton_step, omega, kappa, start, 7)
        assert errors[-1] < 3e-14
        results.append(u)
    np.testing.assert_allclose(*results, atol=2e-12)


@pytest.mark.parametrize("newton_step", [circles.newton_step, parameterization.newton_step])
def test_each_newton_step_squares_the_error(newton_step):
    exact, _ = newton_errors(newton_step, GAMMA, (0.4, 0.2), np.zeros((2, 512)), 10)
    pairs = []
    for distance in (0.1, 0.03, 0.01, 0.003):
        u, before = newton_step(GAMMA, (0.4, 0.2), (1 - distance) * exact)
        _, after = newton_step(GAMMA, (0.4, 0.2), u)
        pairs.append((before, after))
    slope = np.polyfit(*np.log(pairs).T, 1)[0]
    assert slope == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kappa", [(0.2, 0.1), (0.05, -0.3), (0.1, 0.05, 0.1)])
def test_a_certified_circle_is_invariant_and_rotates_by_its_omega(name, kappa):
    circle = circles.invariant_circle(parse(name), kappa)
    assert circle.certified
    residual = circles.residual(circle.omega, circle.kappa, fourier.resample(circle.u, 512))
    assert circle.error == pytest.approx(np.abs(residual).max(), rel=0.5, abs=1e-15)
    assert oracles.invariance_error(circle) < 10 * circle.error + 1e-14
    x, y = circles.graph(circle)
    measured = orbits.rotation_number(kappa, x[0], y[0], 10_000)[0]
    assert measured == pytest.approx(float(circle.omega), abs=100 * circle.error + 1e-12)


def test_a_circle_agrees_with_first_order_perturbation_theory():
    # Perturbation theory of the standard map: u = κ/(4π (cos 2πω - 1)) sin 2πθ + O(κ²).
    kappa = 1e-4
    circle = circles.invariant_circle(GAMMA, (kappa,))
    theta = np.arange(circle.u.shape[-1]) / circle.u.shape[-1]
    first = kappa / (4 * np.pi * (np.cos(2 * np.pi * float(GAMMA)) - 1)) * np.sin(2 * np.pi * theta)
    assert np.abs(circle.u[0] - first).max() < 10 * kappa**2
    amplitude = 4 * np.abs(first).max() * np.sin(np.pi * float(GAMMA))
    assert np.ptp(circles.graph(circle)[1]) == pytest.approx(amplitude, rel=1e-3)


def test_phases_of_high_modes_are_exact():
    omega, k = parse("(5gamma+6)/(4gamma+5)"), 30_000
    with mpmath.workdps(50):
        exact = mpmath.expjpi(2 * k * oracles.continued_fraction(omega.prefix, omega.tail))
        assert abs(complex(exact) - fourier.turns(omega, k + 1)[k]) < 1e-15
    # With ω as a float, the phase would be wrong by 1e-12.
    assert abs(np.exp(2j * np.pi * k * float(omega)) - complex(exact)) > 1e-13


def polished(circle):
    """Return u of a circle, refined by Newton's method on a grid that resolves u up to rounding."""
    start = fourier.resample(circle.u, 512)
    return circles.invariant_circle(circle.omega, circle.kappa, start=start).u


def assert_same_circle(image, kappa, omega):
    """Assert that the image of a circle is the circle found directly for kappa and omega.

    The image must also be certified, and invariant under the map with the strengths kappa.
    """
    assert tuple(image.kappa) == kappa
    assert image.omega == omega
    assert image.certified
    assert oracles.invariance_error(image) < 10 * image.error + 1e-14
    direct = circles.invariant_circle(omega, kappa)
    np.testing.assert_allclose(polished(image), polished(direct), atol=1e-10)


@settings(max_examples=15)
@given(strengths, strengths, st.sampled_from(["gamma", "gamma+1", "[0;(2)]"]))
def test_symmetries_of_two_kicks_map_circles_to_circles(kappa1, kappa2, name):
    circle, omega = circles.invariant_circle(parse(name), (kappa1, kappa2)), parse(name)
    assert circle.certified
    assert_same_circle(circles.symmetries.shift(circle), (kappa2, kappa1), omega)
    assert_same_circle(circles.symmetries.negate(circle), (-kappa1, -kappa2), omega)
    alternate = circles.symmetries.alternate(circle)
    assert_same_circle(alternate, (kappa1, -kappa2), moebius(omega, 1, 1))


def test_three_shifts_return_a_circle_of_three_kicks_to_itself():
    circle = shifted = circles.invariant_circle(GAMMA, (0.1, 0.2, -0.25))
    for kappa in ((0.2, -0.25, 0.1), (-0.25, 0.1, 0.2), (0.1, 0.2, -0.25)):
        shifted = circles.symmetries.shift(shifted)
        assert_same_circle(shifted, kappa, GAMMA)
        assert abs(shifted.u[0].mean()) < 1e-15
    np.testing.assert_allclose(shifted.u, circle.u, atol=1e-8)


def naive_circle(n, kappa_end, step):
    """Return κ and u of the last circle of the standard map that seems to exist.

    A circle is accepted as soon as the updates of Newton's method on n grid points are small.
    """
    u, kappa = np.zeros((1, n)), 0.0
    while kappa < kappa_end:
        trial, change, steps = u, 1.0, 0
        while change > 1e-10:
            before, (trial, error) = trial, circles.newton_step(GAMMA, (kappa + step,), trial)
            change, steps = np.abs(trial - before).max(), steps + 1
            if not error < 1 or steps > 40:
                return kappa, u
        u, kappa = trial, kappa + step
    return kappa, u


@pytest.mark.parametrize(("n", "past"), [(16, 0.27), (32, 0.1), (64, 0.05), (128, 0.009)])
def test_fake_circles_from_too_few_modes_or_small_updates_are_rejected(n, past):
    kappa, fake = naive_circle(n, KAPPA_G + past, 0.01)
    assert kappa > KAPPA_G + past - 0.01
    assert kappa > KAPPA_G
    error, status = circles.newton.certify(GAMMA, np.array([kappa]), fake)
    assert status is Status.NOT_CERTIFIED
    assert error > 1e-6
    n_max = max(n, circles.newton.MIN_POINTS)
    circle = circles.invariant_circle(GAMMA, (kappa,), n_max=n_max, start=fake)
    assert not circle.certified
    assert not circles.newton.certify_by_step(GAMMA, np.array([kappa]), fake)


def test_nan_is_rejected():
    kappa, nothing = np.array([0.3, 0.2]), np.full((2, 512), np.nan)
    assert circles.newton.solve(GAMMA, kappa, nothing, 512)[1] is Status.NO_CIRCLE
    assert circles.newton.certify(GAMMA, kappa, nothing)[1] is Status.NOT_CERTIFIED


@pytest.mark.parametrize("past", [2e-4, 1e-3, 1e-2, 0.27, 1.0])
def test_beyond_the_breakup_no_circle_is_ever_certified(past):
    for n_max in (64, 128, 256, 512, 1024, 2048, 4096):
        circle = circles.invariant_circle(GAMMA, (KAPPA_G + past,), n_max=n_max)
        assert circle.status in (Status.TOO_FEW_MODES, Status.NO_CIRCLE, Status.NOT_CERTIFIED)
    assert not circles.invariant_circle(GAMMA, (KAPPA_G / 2 + past, 0)).certified


def test_a_circle_that_is_off_by_a_millionth_is_not_invariant():
    circle = circles.invariant_circle(GAMMA, (0.2, 0.1))
    off = replace(circle, u=circle.u * (1 + 1e-6))
    assert oracles.invariance_error(off) > 1e4 * oracles.invariance_error(circle)


@pytest.mark.parametrize("kappa", [(2.0, 0.1), (0, 2.0), (2.5, -2.5), (1e6, 1e6)])
def test_no_circle_is_certified_at_strengths_of_two_or_more(kappa):
    assert not circles.invariant_circle(GAMMA, kappa).certified


@pytest.mark.parametrize(
    ("prefix", "kappa", "status"),
    [
        *(((0, 2, 10**n), (0.2, 0.1), Status.NEARLY_RATIONAL) for n in (9, 15)),
        ((0, 1, 1, 1, 10**8), (0.2, 0.1), Status.NEARLY_RATIONAL),
        (LIOUVILLE, (0.05, 0.02), Status.OK),  # kicks too weak for resonances to matter
        (LIOUVILLE, (0.3, 0.2), Status.NEARLY_RATIONAL),
    ],
)
def test_a_circle_with_nearly_rational_omega_has_the_right_status(prefix, kappa, status):
    circle = circles.invariant_circle(RotationNumber(prefix, (1,)), kappa)
    assert circle.status is status


def test_just_below_the_breakup_enough_modes_certify_the_circle():
    for name, kappa in (("gamma", (KAPPA_G - 0.01,)), ("2gamma", (KAPPA_G - 0.02,) * 2)):
        few = circles.invariant_circle(parse(name), kappa, n_max=512)
        assert few.status is Status.TOO_FEW_MODES
        assert np.isnan(few.error)
        enough = circles.invariant_circle(parse(name), kappa, n_max=8192)
        assert enough.certified
        assert enough.error < 1e-8


def test_on_far_too_fine_a_grid_rounding_hides_a_circle():
    # If the start is the rigid rotation, rounding errors in the high modes dominate.
    start = np.zeros((2, 16384))
    assert not circles.invariant_circle(GAMMA, (0.45, 0), n_max=16384, start=start).certified
    adapted = circles.invariant_circle(GAMMA, (0.45, 0), n_max=16384)
    assert adapted.certified
    assert adapted.u.shape[-1] <= 512


def test_from_a_distant_start_newton_finds_the_right_circle_or_none():
    rng = np.random.default_rng(0)
    theta = np.arange(64) / 64
    wanted = circles.invariant_circle(GAMMA, (0.3, 0.3)).u
    starts = [size * rng.normal(size=(2, 64)) for size in (1e-3, 0.01, 0.1, 1)]
    starts += [size * np.tile(np.sin(2 * np.pi * theta), (2, 1)) for size in (0.05, 0.2)]
    statuses = set()
    for start in starts:
        circle = circles.invariant_circle(GAMMA, (0.3, 0.3), start=start)
        statuses.add(circle.status)
        if circle.certified:
            n = circle.u.shape[-1]
            np.testing.assert_allclose(circle.u, fourier.resample(wanted, n), atol=1e-8)
    assert Status.NO_CIRCLE in statuses


@settings(max_examples=300)
@given(irrationals, st.integers(1, 30_000))
def test_a_grid_keeps_the_requested_modes_and_ends_below_a_resonance(omega, n_modes):
    n = fourier.grid(omega, n_modes)
    kept = fourier.cut(omega, n)
    assert kept >= n_modes
    assert kept in {f.denominator for f in islice(convergents(omega), 60)}
    assert kept < 0.361 * n  # this leaves room for products


@pytest.mark.parametrize("name", NAMES)
def test_a_grid_is_no_larger_than_the_next_resonance_requires(name):
    omega = parse(name)
    for n_modes in (100, 1000, 20_000):
        q = next(f.denominator for f in convergents(omega) if f.denominator >= n_modes)
        assert fourier.cut(omega, fourier.grid(omega, n_modes)) == q
        assert q / 0.36 < fourier.grid(omega, n_modes) < 1.2 * q / 0.36


def test_a_cut_between_two_close_resonances_is_below_both():
    omega = RotationNumber((0, 4, 30), (1,))  # resonances of periods 121 and 125
    assert fourier.cut(omega, 350) == 121
    assert fourier.cut(omega, fourier.grid(omega, 121)) == 121
    assert fourier.cut(omega, fourier.grid(omega, 122)) >= 122
