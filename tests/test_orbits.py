import mpmath
import numpy as np
import oracles
import pytest
from cases import thirds
from numpy.testing import assert_allclose

from nasm.maps import kick
from nasm.orbits import (
    REGULAR_DIGITS,
    orbit,
    passages,
    portrait,
    rotation_number,
    rotation_number_of,
)

# Starts on robust circles of the paper's map, far below breakup: ω is about 0.62 and 0.76.
KAPPA = (0.3, 0.2)
X, Y = np.array([0.1, 0.0]), np.array([0.31, 0.38])


@pytest.mark.parametrize("kappa", [(0.9,), (0.5, 0.7), (0.5, -0.3, 0.2)])
def test_the_points_between_kicks_are_orbits_of_the_shifted_forcings(kappa):
    P, x, y = len(kappa), X, Y
    xs, ys = orbit(kappa, X, Y, 50 * P, 1)
    for first in range(P):
        shifted = np.roll(kappa, -first)
        expected = orbit(shifted, x, y, 49)
        np.testing.assert_array_equal((xs[first::P][:50], ys[first::P][:50]), expected)
        x, y = kick(kappa[first], x, y)


def test_starts_broadcast():
    xs, ys = orbit(KAPPA, X[:, None], np.linspace(0, 1, 5), 7)
    assert xs.shape == ys.shape == (8, 2, 5)
    alone_x, alone_y = orbit(KAPPA, X[1], 0.75, 7)
    assert alone_x.shape == (8,)
    np.testing.assert_array_equal((xs[:, 1, 3], ys[:, 1, 3]), (alone_x, alone_y))
    omega, digits = rotation_number(KAPPA, X[:, None], np.linspace(0, 1, 5), 100)
    assert omega.shape == digits.shape == (2, 5)


@pytest.mark.parametrize("P", [1, 2, 3])
def test_a_rigid_rotation_is_returned_on_the_lift_with_omega_equal_to_Py(P):
    xs, ys = orbit([0.0] * P, 0.25, 0.5, 100)
    np.testing.assert_array_equal(xs, 0.25 + P * 0.5 * np.arange(101))
    np.testing.assert_array_equal(ys, 0.5)
    y = np.array([0.2, 2**-0.5, -0.3, 5.1])
    omega, digits = rotation_number(np.zeros(P), 0.4, y, 1000)
    assert_allclose(omega, P * y, rtol=0, atol=1e-13)
    assert (digits > 13).all()


def test_a_series_has_the_same_rotation_number_as_its_orbit():
    xs, _ = orbit(KAPPA, X[:, None], np.linspace(0.28, 0.4, 9), 3000)
    omega, digits = rotation_number_of(xs)
    expected, sure = rotation_number(KAPPA, X[:, None], np.linspace(0.28, 0.4, 9), 3000)
    assert omega.shape == digits.shape == (2, 9)
    regular = sure > 11
    assert regular.sum() > 9
    errors = 10.0**-digits + 10.0**-sure  # far out on the lift, x loses digits
    assert (np.abs(omega - expected) < errors)[regular].all()
    assert (digits > 9)[regular].all()


@pytest.mark.parametrize("noise", [0.0, 1e-9, 1e-5])
@pytest.mark.parametrize("offset", [0.0, 1e8])
def test_digits_are_reliable_for_a_known_series_with_noise(noise, offset):
    random, n = np.random.default_rng(5), 2000
    rotations = random.uniform(-3, 3, 600)
    phase = np.outer(np.arange(n + 1), rotations)
    exact = phase + 0.1 * np.sin(2 * np.pi * phase) + 0.02 * np.cos(6 * np.pi * phase)
    omega, digits = rotation_number_of(offset + exact + noise * random.normal(size=exact.shape))
    known = np.isfinite(omega)  # NaN if ω is close to a fraction
    assert known.mean() > 0.97
    assert np.mean((np.abs(omega - rotations) > 10.0**-digits)[known]) < 0.02
    # Errors in the positions change an average by less than 5.3/n times the largest error.
    largest = max(1e-13, 2.7e-3 * max(5 * noise, offset * np.finfo(float).eps))
    assert np.median(digits) > -np.log10(2 * largest)


def test_a_series_that_is_short_or_has_gaps_is_refused():
    for series in (0.5, np.arange(4.0), [0.1, 0.2, np.nan, 0.4, 0.5], np.zeros((3, 9))):
        with pytest.raises(ValueError, match="at least five finite positions"):
            rotation_number_of(series)


def test_digits_seldom_overstate_the_accuracy():
    random = np.random.default_rng(8)
    ratios = []
    for n in (300, 500, 1000, 3000):
        for kappa in ((0.5,), KAPPA, (0.2, 0.1, 0.15)):
            starts = random.random((2, 40))
            exact, sure = rotation_number(kappa, *starts, 50_000)
            omega, digits = rotation_number(kappa, *starts, n)
            assert (np.isfinite(omega) == (digits >= REGULAR_DIGITS)).all()
            regular = (digits >= REGULAR_DIGITS) & (sure > 12)
            allowed = 10.0 ** -digits[regular] + 1e-13
            ratios.extend(np.abs(omega - exact)[regular] / allowed)
    assert len(ratios) > 300
    # Averages may agree by chance, here on 1% of circles; they would agree on 3% if only the
    # averages over the two halves were compared.
    assert np.mean(np.array(ratios) > 1) < 0.02


@pytest.mark.parametrize(
    "case", thirds([((0.3, 0.2), 0.3), ((0.5,), 0.38), ((0.2, 0.1, 0.15), 0.2)])
)
def test_digits_are_limited_by_rounding(case):
    kappa, y = case
    with mpmath.workprec(80):
        exact = weighted_average(kappa, mpmath.mpf(0.1), mpmath.mpf(y), 4000)
        assert abs(exact - weighted_average(kappa, mpmath.mpf(0.1), mpmath.mpf(y), 3000)) < 1e-14
    for n in (10**4, 10**5, 10**6):
        starts = np.full(1, 0.1), np.full(1, y)
        omega, digits = rotation_number(kappa, *starts, n)
        assert digits > 12.5
        assert digits <= 14
        assert abs(omega - float(exact)) < 10.0**-digits + 1e-14


def weighted_average(kappa, x, y, n):
    """Compute ω from n exact steps, by the definition of the weighted average."""
    total = weights = mpmath.mpf(0)
    for t in range(n):
        x_next, y = oracles.exact_step(kappa, x, y)
        if t > 0:
            s = mpmath.mpf(t) / n
            weight = mpmath.exp(-1 / (s * (1 - s)))
            total, weights = total + weight * (x_next - x), weights + weight
        x = x_next
    return total / weights


def test_omega_is_the_same_throughout_an_island_and_nan_in_chaos():
    # (1/2, 0) is an elliptic fixed point for small positive strengths: ω = 0 all around it.
    assert rotation_number(KAPPA, 0.55, 0.0, 10_000)[0] == pytest.approx(0, abs=1e-12)
    omega, digits = rotation_number((1.5, 1.5), [0.01, 0.02, 0.03], 0.0, 10_000)
    assert np.isnan(omega).all()
    assert (digits < REGULAR_DIGITS).all()


def test_portrait_shows_one_cell():
    x, y = portrait((0.9, 0.7), n_orbits=10, n=50)
    assert x.shape == y.shape == (51, 10)
    for values in (x, y):
        assert ((values >= 0) & (values < 1)).all()
    assert set(x[0]) == {0.0, 0.5}
    assert_allclose(np.sort(y[0]), np.arange(10) / 10)


@pytest.mark.parametrize("every", [None, 1])
def test_passages_are_the_orbit_points_inside_the_box(every):
    y = np.arange(30) / 31
    left, bottom, width, height = box = (0.8, -0.3, 0.45, 0.4)  # crosses edges of the cell
    which, xs, ys, (x_next, y_next) = passages(KAPPA, np.full(30, 0.1), y, 40, box, every)
    x, y = orbit(KAPPA, 0.1, y, 40, every)
    u, v = (x - left) % 1, (y - bottom) % 1
    inside = (u[:-1] <= width) & (v[:-1] <= height)
    assert 100 < inside.sum() < inside.size / 2
    np.testing.assert_array_equal(which, np.nonzero(inside)[1])
    assert_allclose(xs, left + u[:-1][inside], rtol=0, atol=1e-9)
    assert_allclose(ys, bottom + v[:-1][inside], rtol=0, atol=1e-9)
    assert_allclose((x_next, y_next), (x[-1] % 1, y[-1] % 1), rtol=0, atol=1e-9)
