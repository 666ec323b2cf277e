"""Tori and last barriers of rotating maps, compared with circles, orbits and residues."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cases import thirds
from oracles import KAPPA_G

from nasm import circles, maps, orbits, periodic, tori
from nasm.converse_kam import aperiodic
from nasm.numbers import parse
from nasm.results import Status
from nasm.symmetries import ray
from nasm.tori import last_torus

GAMMA = parse("gamma")
TAU = 1.8392867552141612  # the tribonacci constant
TRIBONACCI = 1 / TAU, 1 / TAU + 1 / TAU**2
BELOW_BREAKUP = 0.18, 0.18  # κ̄ and Δκ, about 20% below the breakup of the tribonacci torus at 45°


@pytest.fixture(scope="module")
def torus():
    return tori.invariant_torus(*TRIBONACCI, *BELOW_BREAKUP)


def test_at_zero_amplitude_the_torus_is_the_circle_of_the_standard_map():
    torus = tori.invariant_torus(GAMMA, np.e, 0.9, 0.0)
    circle = circles.invariant_circle(GAMMA, (0.9,))
    assert torus.certified
    assert circle.certified
    rows = torus.u[:, :: torus.u.shape[1] // 64]
    assert np.abs(rows - circle.u[0, :: circle.u.shape[1] // 64]).max() < 1e-11


def test_circles_for_all_phases_form_the_torus_for_a_rational_frequency():
    # u(θ + jω, φ0 + j/3) is site j of the circle of T³ with phase φ0.
    mean, amplitude, n = 0.1, 0.1, 512
    u, omega, worst = np.empty((24, n)), float(GAMMA), 0.0
    for row in range(8):
        kappa = maps.rotating_forcing(mean, amplitude, "1/3", row / 24)
        circle = circles.invariant_circle(parse("3gamma"), kappa)
        assert circle.certified
        worst = max(worst, circle.error)
        sites = np.array([np.fft.rfft(site) for site in circle.u])[:, : n // 2 + 1]
        back = np.exp(-2j * np.pi * np.outer(np.arange(3) * omega, np.arange(n // 2 + 1)))
        sites = np.pad(sites, ((0, 0), (0, n // 2 + 1 - sites.shape[1])))
        u[row::8] = np.fft.irfft(sites * back * (n / circle.u.shape[1]), n)
    assert np.abs(tori.residual(omega, 1 / 3, mean, amplitude, u)).max() < 2 * worst < 1e-8


def test_at_zero_mean_frequencies_shifted_by_one_half_have_the_same_torus():
    omega, frequency = TRIBONACCI
    one = tori.invariant_torus(omega, frequency, 0.0, 0.3)
    two = tori.invariant_torus(omega + 0.5, frequency + 0.5, 0.0, 0.3)
    assert one.certified
    assert two.certified
    assert np.abs(one.u - two.u).max() < 1e-8


def test_tori_are_odd_and_negative_amplitudes_shift_the_phase_by_one_half(torus):
    mirrored = np.roll(torus.u[::-1, ::-1], (1, 1), axis=(0, 1))
    assert np.abs(torus.u + mirrored).max() < 1e-9
    other = tori.invariant_torus(*TRIBONACCI, BELOW_BREAKUP[0], -BELOW_BREAKUP[1]).u
    assert np.abs(np.roll(torus.u, len(torus.u) // 2, axis=0) - other).max() < 1e-9


def test_orbits_stay_on_the_torus_and_have_its_rotation_number(torus):
    n, phase = 5000, 3  # number of kicks, and the row of the start in the grid
    turns = phase / len(torus.u) + np.arange(n) * torus.frequency
    kappa = torus.mean + torus.amplitude * np.cos(2 * np.pi * turns)
    x, y = (values[phase, 0] for values in tori.graph(torus))
    result = orbits.orbit(kappa, x, y, n, 1)[0]
    for kicks in (1, 100, n):
        there = tori.newton.shifted(torus.u, kicks * torus.omega, kicks * torus.frequency)[phase, 0]
        assert result[kicks] == pytest.approx(kicks * torus.omega + there, abs=1e-6)
    at = np.arange(1, n) / n
    weights = np.exp(-1 / (at * (1 - at)))
    measured = np.diff(result)[1:] @ weights / weights.sum()
    assert measured == pytest.approx(torus.omega, abs=1e-8)


def test_each_newton_step_squares_the_error():
    one_step = tori.TorusSettings(newton=replace(tori.TorusSettings().newton, max_steps=1))
    u, errors = np.zeros((64, 256)), []
    for _ in range(6):
        u, _, error = tori.newton._newton(*TRIBONACCI, 0.1, 0.1, u, one_step)
        errors.append(error)
    assert all(after < 1e3 * before**2 for before, after in pairwise(errors[1:5]))
    assert errors[5] < 1e-15


@pytest.mark.parametrize("n_max", [2**14, 2**16])  # n = 256 and 1024
def test_at_zero_amplitude_no_torus_is_certified_past_kappa_g(n_max):
    # On 1024 points, Newton's method converges at 0.97251; only a finer grid reveals the breakup.
    vector, mean = (float(GAMMA), np.e), 0.97251
    torus = tori.invariant_torus(*vector, mean, 0.0, n_max)
    assert torus.status in (Status.TOO_FEW_MODES, Status.NO_CIRCLE, Status.NOT_CERTIFIED)
    assert tori.newton.certify(*vector, mean, 0.0, torus.u)[1] is Status.NOT_CERTIFIED


@pytest.mark.parametrize("n_max", [2**13, 2**15])
def test_past_the_breakup_no_torus_is_certified_on_any_grid(n_max):
    for scale in (0.33, 0.4):
        torus = tori.invariant_torus(*TRIBONACCI, *(scale * ray(45)), n_max)
        assert not torus.certified
        assert torus.status is not Status.OK


@pytest.mark.parametrize(
    ("omega", "frequency"),
    [(0.618, 0.5), (float(GAMMA), 1 / 3 + 1e-9), (0.4, 2**0.5), (2**0.5 - 1, 1 - 2**0.5 / 2)],
)
def test_no_torus_is_computed_for_a_resonant_rotation_vector(omega, frequency):
    torus = tori.invariant_torus(omega, frequency, 0.1, 0.1)
    assert torus.status is Status.NEARLY_RATIONAL
    result = tori.critical_scale(omega, frequency, 1.0, 1.0)
    assert result.status is Status.NEARLY_RATIONAL
    assert np.isnan([result.value, result.error, result.lower]).all()


def test_at_zero_amplitude_the_torus_breaks_where_the_circle_does():
    result = tori.critical_scale(GAMMA, np.e, 1.0, 0.0, 0.02)
    assert abs(result.value - KAPPA_G) < result.error < 0.02
    assert 0.9 < result.lower < KAPPA_G


def test_a_torus_1_per_cent_below_breakup_is_certified_by_continuation():
    n_max = tori.TorusSettings().max_points
    assert tori.invariant_torus(*TRIBONACCI, *(0.322 * ray(45)), n_max).certified


@pytest.mark.parametrize(
    ("angle", "tol", "known"),
    [
        (45, 1e-2, 0.3077),
        *(
            pytest.param(angle, 1e-3, known, marks=pytest.mark.slow)
            for angle, known in ((20, 0.3605), (45, 0.3235), (70, 0.366))
        ),
    ],
)
def test_tori_are_certified_close_to_the_breakup_predicted_by_residues(angle, tol, known):
    result = tori.critical_scale(*TRIBONACCI, *ray(angle), tol)
    residue = periodic.torus_scale("3136/5768", "4841/5768", *ray(angle))
    assert known < result.lower < result.value
    assert abs(result.value - residue.value) < result.error + residue.error


def test_graphs_persist_at_a_certified_torus_and_are_excluded_far_beyond():
    n = np.arange(-100, 101)
    kappa = ray(45)[0] + ray(45)[1] * np.cos(2 * np.pi * n * TRIBONACCI[1])
    lifetimes = [aperiodic.longest_lived(scale * kappa, 0.0, 100)[2] for scale in (0.3, 0.6)]
    assert lifetimes[0] == np.inf
    assert lifetimes[1] < 60


# One period of each forcing, the breakup of its last circle by residues or continuation, and the
# relative distance beyond it at which no graph remains. This distance is larger without a symmetry,
# because minimizing orbits then cross the lines on which survivors are sought.
KNOWN = ((1.0,), KAPPA_G, 0.01), ((0.3, 0.2, 0.25), 1.79656, 0.05)


@pytest.mark.parametrize("case", thirds(KNOWN))
def test_under_repeated_kicks_graphs_are_excluded_past_the_breakup(case):
    period, breakup, above = case
    kappa = np.tile(period, 601)
    upper = aperiodic.critical_scale(kappa).upper
    assert breakup < upper < (1 + above) * breakup
    assert aperiodic.last_survivor(0.99 * breakup * kappa).kicks == np.inf


def test_a_few_strong_random_kicks_eliminate_even_the_longest_lived_start():
    kappa = np.random.default_rng(20).uniform(0.8, 1.8, 300)
    last = aperiodic.last_survivor(kappa)
    site, reach = last.site, int(last.kicks)
    assert reach < 20
    for less, lifetime in ((0, reach), (1, np.inf)):  # these kicks alone suffice; fewer do not
        first, end = max(site - reach + less, 0), site + reach - less
        alone = aperiodic.elimination_time(kappa[first:end], 0.0, site - first, [last.x], [last.y])
        assert alone == lifetime


def test_searches_that_disagree_give_no_bound(monkeypatch):
    search = aperiodic.last_survivor
    result = aperiodic.critical_scale(np.ones(64), 0.1)
    assert result.status is Status.OK
    assert result.value + result.error == pytest.approx(result.upper)

    def careless(kappa, theta=0.0, effort=8, settings=None):
        return search(1.3 * kappa if effort == 1 else kappa, theta, effort, settings)

    monkeypatch.setattr(aperiodic, "last_survivor", careless)
    result = aperiodic.critical_scale(np.ones(64), 0.1)
    assert result.status is Status.UNDECIDED
    assert np.isnan(result.upper)


def test_at_zero_amplitude_the_last_torus_is_the_golden_circle():
    result, omega = last_torus.last_critical_scale(2**0.5 - 1, 1.0, 0.0, 4000)
    assert result.lower < KAPPA_G < result.upper < 1.05 * result.lower
    assert omega == pytest.approx((3 - 5**0.5) / 2, abs=0.05)
