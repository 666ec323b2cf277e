"""Test the self-consistent map against the literature, and aperiodic forcings with phases."""

from concurrent.futures import ThreadPoolExecutor
from math import cos, fsum, hypot, pi, sin

import numpy as np
import pytest
from dask.system import CPU_COUNT
from oracles import KAPPA_G

from nasm.circles import fourier
from nasm.converse_kam import aperiodic, transversal
from nasm.maps import TWO_PI, kick
from nasm.self_consistent import evolve
from workflows.ask import once
from workflows.figures.self_consistent import self_consistent_caption
from workflows.self_consistent import study

RNG = np.random.default_rng(21)
X, Y = RNG.uniform(-0.5, 0.5, (2, 700))


def test_escapes_are_counted_in_kicks():
    kappa, theta, x, orbit = 3 + RNG.normal(size=60), RNG.normal(size=60), X, [Y]
    for strength, phase in zip(kappa, theta, strict=True):
        x, y = kick(strength, x, orbit[-1], phase)
        orbit.append(y)
    outside = np.abs(orbit) > 1.2
    expected = np.where(outside.any(axis=0), outside.argmax(axis=0), np.inf)
    result = aperiodic.escape_time(kappa, theta, X, Y, (-1.2, 1.2))
    assert len(set(result)) > 20
    assert np.array_equal(result, expected)


def test_a_repeated_forcing_eliminates_starts_as_the_periodic_map_does():
    kappa, site, omega = (0.3, 0.2, 0.25), 301, 0.271
    expected, _ = transversal.elimination(np.roll(kappa, -(site % 3)), X, Y, 300)
    assert 10 < np.isinf(expected).sum() < 650
    repeated = np.tile(kappa, 201)[:602]
    assert np.array_equal(aperiodic.elimination_time(repeated, 0.0, site, X, Y), expected)
    theta = (np.arange(602) - site) * omega + 0.2
    moved = aperiodic.elimination_time(repeated, theta, site, X + 0.2, Y + omega)
    assert np.mean(moved == expected) > 0.99  # a few starts are marginal
    assert aperiodic.longest_lived(0.9 * np.ones(602), theta, site)[2] == np.inf
    x, y, time = aperiodic.longest_lived(1.1 * np.ones(602), theta, site)
    assert time == aperiodic.elimination_time(1.1 * np.ones(602), theta, site, x, y) < 100


def asymptotic_circle(kappa, omega=0.618, n=4096):
    """Return x, y and dx/dangle on the curve that tends to y = omega as the kicks fade."""
    angle = np.arange(n) / n
    x, y = aperiodic.asymptotic(kappa, 0.0, 0.0, angle, np.full(n, omega))
    return x, y, 1 + fourier.derivative(x - angle)


def ramp(rate, n_kicks):
    """Return the strengths κ_G + rate·n, with n counted from the middle."""
    return KAPPA_G + rate * np.arange(-n_kicks, n_kicks + 1)


def test_in_a_ramp_the_search_finds_nearly_the_longest_lifetime_in_a_scan():
    kappa, low, high, longest = ramp(1e-3, 600), 0.4, 0.41, 0.0
    while high - low > 1e-12:
        y = np.linspace(low, high, 20_001)
        times = aperiodic.elimination_time(kappa, 0.0, 600, np.full(y.size, 0.5), y)
        longest, best, near = max(longest, times.max()), y[times.argmax()], (high - low) / 100
        low, high = best - near, best + near
    assert 300 < longest < np.inf
    assert aperiodic.longest_lived(kappa, 0.0, 600, 8)[2] > 0.9 * longest


def test_a_lifetime_beyond_the_horizon_in_a_ramp_is_reported_as_undecided():
    short, long = (
        aperiodic.longest_lived(ramp(rate, 2000), 0.0, 2000, 8)[2] for rate in (1e-2, 1e-3)
    )
    assert short < aperiodic.HORIZON < long
    survivor = aperiodic.LongestLived(2000, 0.5, 0.4, long)
    assert next(once._sentences(ramp(1e-3, 2000), survivor, np.inf)).startswith("UNDECIDED")


def test_asymptotic_circles_converge_as_the_kicks_fade_and_preserve_area():
    kappa = 0.5 * np.exp(-np.arange(200) / 5)
    _, y, dx = asymptotic_circle(kappa)
    assert np.mean(y * dx) == pytest.approx(0.618, abs=1e-12)
    n = np.arange(10, 101, 10)  # iterating back amplifies the truncation error n-fold
    errors = [np.abs(asymptotic_circle(kappa[:k])[1] - y).max() for k in n]
    assert np.polyfit(n, np.log(errors / n), 1)[0] == pytest.approx(-1 / 5, rel=0.05)


def test_an_asymptotic_circle_is_excluded_until_it_has_unfolded():
    kappa = 2 * np.exp(-np.arange(400) / 5)
    x, y, dx = asymptotic_circle(kappa)
    assert np.mean(dx < -0.05) > 0.1
    assert np.isfinite(aperiodic.elimination_time(kappa, 0.0, 0, x, y))[dx < -0.05].all()
    assert aperiodic.longest_lived(kappa, 0.0, 3)[2] < 100
    x, y, dx = asymptotic_circle(kappa[5:])
    assert dx.min() > 0
    assert np.isinf(aperiodic.elimination_time(kappa[5:], 0.0, 0, x, y)).all()


def test_five_particles_move_as_in_the_literature():
    gamma, kappa, theta = np.array([0.3, 0.1, -0.2, 0.0, 0.4]), 0.4, (0.2 - 0.5) * TWO_PI
    result = evolve(X[:5], 0.1 * Y[:5], gamma, kappa, 15, 0.2, 0.03)
    x, y = X[:5] * TWO_PI, 0.1 * Y[:5] * TWO_PI  # in radians; the kicks pull towards θ
    for n in range(15):
        eta = fsum(g * sin(a - theta) for g, a in zip(gamma, x, strict=True))
        slope = -fsum(g * cos(a - theta) for g, a in zip(gamma, x, strict=True))
        kappa = hypot(kappa, eta) + eta
        assert result.kappa[n] == pytest.approx(kappa, rel=1e-10)
        assert (result.theta[n] - theta / TWO_PI) % 1 == pytest.approx(0.5, abs=1e-10)
        y = y - kappa * np.sin(x - theta)
        x, theta = x + y, theta - 0.03 * TWO_PI + slope / kappa
    np.testing.assert_allclose(result.y * TWO_PI, y, atol=1e-10)
    np.testing.assert_allclose(np.exp(2j * pi * result.x), np.exp(1j * x), atol=1e-10)


def test_the_map_is_symplectic():
    gamma = np.array([0.3, -0.2])
    start = np.array([0.1, -0.3, 0.04, 0.02, 0.07, 0.1])  # x, γy, θ and J = κ²/4π

    def kicked(z):
        end = evolve(z[:2], z[2:4] / gamma, gamma, (4 * pi * z[5]) ** 0.5, 1, z[4])
        return np.hstack([end.x, gamma * end.y, end.phase, end.kappa[-1] ** 2 / (4 * pi)])

    tangent = np.array([kicked(start + d) - kicked(start - d) for d in 1e-5 * np.eye(6)]).T / 2e-5
    form = np.zeros((6, 6))
    form[[0, 1, 4], [2, 3, 5]], form[[2, 3, 5], [0, 1, 4]] = 1, -1
    np.testing.assert_allclose(tangent.T @ form @ tangent, form, atol=1e-8)


def test_a_small_amplitude_after_a_negative_field_is_not_lost_to_rounding():
    amplitude = evolve([0.25], [0.0], 1.0, 1e-9, 1).kappa[0]  # η = -1
    assert amplitude == pytest.approx(5e-19, rel=1e-12)
    with pytest.raises(ArithmeticError, match="became 0 at kick 1"):
        evolve([0.25], [0.0], 1e6, 1e-100, 5)


def test_without_weights_particles_follow_standard_maps_to_the_last_bit():
    after, x, y = evolve(X, Y, 0.0, 0.9, 200, 0.1, 0.01), X, Y
    assert (after.kappa == 0.9).all()
    for phase in after.theta:
        x, y = kick(0.9, x, y, phase)
        x = x - np.rint(x)
    assert np.array_equal([after.x, after.y], [x, y])


def test_results_are_bit_identical_on_any_number_of_threads():
    gamma = RNG.normal(size=700) / 700
    whole, half = (evolve(X, Y, gamma, 0.3, n, 0.1) for n in (200, 100))
    with ThreadPoolExecutor(3) as threads:
        others = list(threads.map(lambda _: evolve(X, Y, gamma, 0.3, 200, 0.1), range(6)))
    others.append(evolve(half.x, half.y, gamma, half.kappa[-1], 100, half.phase))
    assert all(np.array_equal([other.x, other.y], [whole.x, whole.y]) for other in others)


def test_momentum_is_conserved_and_graphs_persist_only_in_weak_fields():
    size = {"n_particles": 512, "n_max": 4096}
    fields = study.fields([0.1, 1.3], **size).assign_attrs(size)
    verdicts, settling = study.verdicts(fields), study.settling()
    assert fields.momentum_change.max() < 1e-12
    assert (fields.escape[0], fields.escape[1] < 4096) == (np.inf, True)
    for kicks in (verdicts.kicks, verdicts.kicks_fitted):
        assert (kicks[0], kicks[1] < 20) == (np.inf, True)
    np.testing.assert_allclose(settling.area, settling.area[2], rtol=1e-12)
    assert 0.05 < settling.excluded.mean() < 0.2
    caption = self_consistent_caption(fields, verdicts, settling)
    assert "excludes every family of graphs in the recorded field from Γ = 1.3 on" in caption


def test_a_study_runs_one_thread_for_each_core_that_the_job_may_use(monkeypatch):
    """A container or a batch job may be allowed fewer cores than the machine has."""
    threads = []

    def executor(n):
        threads.append(n)
        raise KeyboardInterrupt

    monkeypatch.setattr("os.cpu_count", lambda: 64)
    monkeypatch.setattr(study, "ThreadPoolExecutor", executor)
    with pytest.raises(KeyboardInterrupt):
        study.fields([0.5], 256, 4096)
    assert threads == [CPU_COUNT]
