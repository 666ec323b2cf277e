"""Circles near long periodic orbits, compared with circles continued from zero and breakups."""

from fractions import Fraction

import numpy as np
import pytest
from cases import thirds

from nasm import circles, periodic
from nasm.action import Chain
from nasm.circles import fourier, hull, newton
from nasm.numbers import parse
from nasm.symmetries import ray

GAMMA = parse("gamma")
KNOWN = [
    ("gamma", (1,)),
    ("gamma", ray(20)),
    ("2gamma", (1, 1)),
    ("[0;1,2,(1)]", ray(30)),
    ("(gamma+1)/(4gamma+5)", ray(130)),
    ("2gamma", ray(30)),
    ("[0;4,2,(1)]", (1, 0.4, 0.7)),
]


@pytest.mark.parametrize(("period", "p", "q", "first"), [(1, 3, 7, 0), (2, 5, 8, 1), (3, -4, 9, 2)])
def test_hull_functions_pass_through_all_sites_of_an_orbit(period, p, q, first):
    chain = Chain(period, Fraction(p, q))
    # Any q values are interpolated if they contain no mode q/2.
    sites = 0.03 * np.random.default_rng(3).standard_normal(chain.n_sites)
    sites -= sites.reshape(q, period).mean(axis=0)[np.arange(chain.n_sites) % period]
    if q % 2 == 0:
        numbers = np.arange(chain.n_sites) // period
        for j in range(period):
            alternating = (-1.0) ** numbers[j::period]
            sites[j::period] -= alternating * (alternating @ sites[j::period]) / q
    n = 64
    u = hull.hull_functions(chain, first, sites, n)
    assert u.shape == (period, n)
    assert abs(u[0].mean()) < 1e-15
    modes = np.fft.rfft(u) / n
    x = np.arange(chain.n_sites) * p / chain.n_sites + sites
    for site in range(chain.n_sites):
        kick = (site + first) % period
        rotated = (site + first - kick) / period * p / q
        # The angle θ at the start of this site's period is known up to the same constant for all.
        theta = rotated - first * p / chain.n_sites
        wave = np.exp(2j * np.pi * theta * np.arange(modes.shape[1]))
        value = (2 * modes[kick] @ wave - modes[kick, 0]).real
        assert theta + kick * p / chain.n_sites + value == pytest.approx(x[site], abs=1e-12)


@pytest.mark.parametrize(("name", "profile"), KNOWN)
def test_a_circle_near_an_orbit_is_the_one_continued_from_zero(name, profile):
    omega, profile = parse(name), np.array(profile, float)
    breakup = periodic.critical_scale(omega, profile).value
    fine = circles.NewtonSettings(max_tail=1e-7)
    for part in (-0.5, 0.5, 0.9, 0.98):
        kappa = part * breakup * profile
        continued = circles.invariant_circle(omega, kappa, 16_384, settings=fine)
        u = hull.circle_near_orbit(omega, kappa, 8000)
        if part > 0 or profile.size == 1:
            assert continued.certified
        if continued.certified:
            wanted = fourier.resample(continued.u, 4096)
            np.testing.assert_allclose(fourier.resample(u, 4096), wanted, rtol=0, atol=1e-9)
            assert np.abs(circles.residual(omega, kappa, u)).max() < 1e-12


@pytest.mark.parametrize(("name", "profile"), KNOWN)
def test_a_circle_is_certified_at_the_given_distance_and_none_past_breakup(name, profile):
    omega = parse(name)
    breakup = periodic.critical_scale(omega, profile).value
    for distance in (0.5, 0.1, 1e-2, 1e-3):
        scale, u = hull.certified_circle(omega, profile, breakup, distance)
        assert scale == breakup * (1 - distance)
        kappa = scale * np.array(profile)
        assert np.abs(circles.residual(omega, kappa, u)).max() < 1e-9
        if distance > 1e-3:
            assert circles.invariant_circle(omega, kappa, n_max=8192).certified
    for too_high, distance in ((0.3, 0.1), (1e-2, 5e-3), (1e-3, 5e-4)):
        wrong = breakup * (1 + too_high)
        scale = hull.certified_circle(omega, profile, wrong, distance)[0]
        assert scale < breakup  # not NaN, as circles at smaller scales are tried too


@pytest.mark.parametrize("distance", [1e-3, pytest.param(1e-4, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("name", "profile"), KNOWN)
def test_just_above_a_breakup_nothing_is_certified(name, profile, distance):
    omega, profile = parse(name), np.array(profile, float)
    breakup = periodic.critical_scale(omega, profile).value
    period = int(hull.DEFAULT_SETTINGS.period_ratio / distance)
    for above in (0.03, 0.1, 0.3, 1.0, 10.0):
        kappa = breakup * (1 + above * distance) * profile
        assert hull.circle_near_orbit(omega, kappa, period) is None
    assert hull.circle_near_orbit(omega, breakup * (1 - distance) * profile, period) is not None


@pytest.mark.parametrize("case", thirds([("gamma", (1,)), ("[0;1,2,(1)]", ray(30))]))
def test_spurious_circles_just_beyond_the_breakup_are_rejected(case):
    # This close to the breakup, Newton's method converges even beyond it: a scale above the breakup
    # would belong to a spurious circle.
    name, profile = case
    breakup = periodic.critical_scale(parse(name), profile).value
    scale = hull.certified_circle(parse(name), profile, breakup * (1 + 1e-4), 2e-5)[0]
    assert breakup * (1 - 1e-3) < scale < breakup


def test_without_a_breakup_or_a_suitable_orbit_nothing_is_certified():
    assert np.isnan(hull.certified_circle(GAMMA, (1, 0), np.nan, 1e-2)[0])
    assert np.isnan(hull.certified_circle(GAMMA, (1, 0), 3.0, 1e-2)[0])
    # The convergents of this number have denominators 1, 2 and 2·10⁹ + 1.
    assert hull.circle_near_orbit(f"[0;2,{10**9},(1)]", (0.1, 0.0), 1) is None
    with pytest.raises(ValueError, match="omega=\\[0;2,1,2\\] is rational"):
        hull.circle_near_orbit("3/8", (0.1, 0.0), 1)


@pytest.mark.parametrize("quotient", [6, 40, pytest.param(200, marks=pytest.mark.slow), 1000])
def test_a_circle_inside_a_resonance_is_refused_although_the_resonant_mode_is_the_next(quotient):
    """ω is close to p/q = 2584/4181; the resonance of p/q has the half-width 2√R/(πq²)."""
    omega = f"[0;{'1,' * 18}{quotient},(1)]"
    away = 4181 * abs(4181 * float(parse(omega)) - 2584)
    certified = []
    for kappa in (0.95, 0.968, 0.97, 0.971, 0.9713):
        width = 2 / np.pi * periodic.residue((kappa,), 2584, 4181) ** 0.5
        certified.append(hull.circle_near_orbit(omega, kappa, 1) is not None)
        assert not certified[-1] or width < 0.5 * away
    # The circle of 1000 needs more points than allowed at every forcing.
    assert certified[:2] == [quotient < 1000] * 2
    assert certified[-2:] == [False, False]


@pytest.mark.slow
@pytest.mark.parametrize("angle", [23.4375, 12.5, 30.0])
def test_a_circle_is_certified_exactly_at_the_given_distance_if_possible(angle):
    profile, distance = ray(angle), 1.6e-5
    breakup = periodic.critical_scale("gamma", profile).value
    scale, u = hull.certified_circle("gamma", profile, breakup, distance)
    assert scale == breakup * (1 - distance)
    assert np.abs(circles.residual("gamma", scale * profile, u)).max() < 1e-11


@pytest.mark.parametrize("n", [256, 2048])
def test_a_step_certifies_what_is_close_to_a_circle_and_nothing_else(n):
    kappa = np.array([0.3, 0.2])
    exact = fourier.resample(circles.invariant_circle(GAMMA, kappa).u, n)
    exact, _ = circles.newton_step(GAMMA, kappa, exact)
    wave = np.sin(2 * np.pi * np.arange(n) / n)
    near, far = exact + 1e-8 * wave, exact + 1e-3 * wave
    assert newton.certify_by_step(GAMMA, kappa, near)
    np.testing.assert_allclose(near, exact, rtol=0, atol=1e-12)
    assert not newton.certify_by_step(GAMMA, kappa, far)
    nothing = np.full((2, n), np.nan)  # kernels ignore NaN in max and min, but not in the twist
    assert not newton.certify_by_step(GAMMA, kappa, nothing)
