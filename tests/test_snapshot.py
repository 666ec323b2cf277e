"""Test snapshot tori: mean distances, exponents and folds in known cases; the study's findings."""

import math

import mpmath
import numpy as np
import pytest
import xarray as xr
from oracles import KAPPA_G

from nasm import snapshot
from nasm.circles import graph, invariant_circle
from nasm.converse_kam import aperiodic
from workflows.snapshot_tori import study

GOLDEN_Y = 0.3951  # y of the golden circle under κ = 0.5 at x = 1/2, approximately


def dumb_separations(kappa, x, y, u, v):
    """Compute ln |(ξ_n, η_n)|, ξ_n and ln σ_n of one orbit from their definitions."""
    tangent, rows = np.eye(2), []
    for strength in kappa:
        xi, eta = tangent @ (u, v)
        rows.append((math.log(math.hypot(xi, eta)), xi, np.linalg.norm(tangent, 2)))
        slope = strength * math.cos(2 * math.pi * x)
        tangent = np.array([[1 + slope, 1], [slope, 1]]) @ tangent
        y += strength / (2 * math.pi) * math.sin(2 * math.pi * x)
        x += y
    logarithms, xi, sigma = np.transpose(rows)
    return logarithms, xi, np.log(sigma)


def after_last_true(is_small):
    """Return the index after the last True; inf if the last entry is True."""
    known = np.flatnonzero(is_small)
    number = known[-1] + 1 if known.size else 0
    return np.inf if number == is_small.size else number


def test_distances_and_exponents_agree_with_a_pure_shear_without_kicks():
    n = np.arange(100)
    along, across = (
        snapshot.separations(np.zeros(100), [0.0, 0.3], 0.25, *vector)
        for vector in ((1.0, 0.0), (0.0, 1.0))
    )
    assert (along.distance == 0).all()
    assert across.distance == pytest.approx(np.log(np.hypot(1, n)), abs=1e-14)
    assert np.isinf([along.folded, along.separated, along.stretched]).all()
    sigma = (n + np.sqrt(n**2 + 4)) / 2
    expected = np.log(sigma[1:]) / n[1:]
    assert along.exponents[1:] == pytest.approx(np.c_[expected, expected], rel=1e-13)
    assert np.isnan(along.exponents[0]).all()


def test_exponents_at_a_hyperbolic_point_tend_to_the_log_of_its_multiplier():
    strength, n = 0.8, 600  # σ_n reaches 10²²², so vectors and matrices are rescaled
    followed = snapshot.separations(np.full(n + 1, strength), 0.0, 0.0, 1.0, strength, every=n)
    with mpmath.workdps(30):
        power = mpmath.matrix([[1 + strength, 1], [strength, 1]]) ** n
        frobenius = sum(entry**2 for entry in power) / 2
        sigma = mpmath.sqrt(frobenius + mpmath.sqrt(frobenius**2 - 1))
        image = power * mpmath.matrix([1, strength])
        length = mpmath.log(mpmath.norm(image))
    assert followed.exponents[1] == pytest.approx(float(mpmath.log(sigma)) / n, rel=1e-12)
    assert followed.distance[-1] == pytest.approx(float(length), rel=1e-12)
    assert followed.exponents[1] == pytest.approx(math.acosh(1 + strength / 2), abs=1 / n)


def test_circles_have_constant_distances_and_exponents_like_log_n_over_n():
    circle = snapshot.torus(0.5, GOLDEN_Y, 500)
    followed = snapshot.separations(np.full(3001, 0.5), *circle, every=1000)
    assert followed.distance == pytest.approx(followed.distance[0], abs=2e-3)
    n = np.array([1000, 2000, 3000])
    shear = (n[:, None] * followed.exponents[1:]).mean(axis=1) - np.log(n)
    assert shear == pytest.approx(shear[0], abs=3e-3)
    assert followed.exponents[1:].max() < 1.2 * math.log(1000) / 1000
    assert np.isinf([followed.folded, followed.separated, followed.stretched]).all()


def test_tangents_of_a_torus_are_derivatives_of_its_circle():
    circle = invariant_circle("[0;2,(1)]", 0.5)
    x, y = graph(circle)
    x, u, v = (np.array(each) for each in (x, *snapshot.torus(0.5, y[y.size // 2], 50)[2:]))
    modes = np.fft.rfft([x - np.arange(x.size) / x.size, y]) / x.size
    k, theta = np.arange(modes.shape[1]), 0.5 + float(circle.omega) * np.arange(50)
    waves = np.exp(2j * np.pi * np.outer(k, theta)) * 4j * np.pi * k[:, None]
    slopes = (modes @ waves).real
    expected = np.array([1 + slopes[0], slopes[1]])
    assert np.array([u, v]) == pytest.approx(expected / expected[0].mean(), abs=1e-6)


def test_distances_agree_with_pairs_of_points_in_high_precision():
    kappa, start = 0.5 + 0.02 * np.arange(50), snapshot.torus(0.5, GOLDEN_Y, 4)
    mean = np.zeros(kappa.size)
    with mpmath.workdps(60):
        gap = mpmath.mpf(10) ** -40
        for x, y, u, v in np.transpose(start):
            pair = [(mpmath.mpf(x), mpmath.mpf(y)), (x + gap * u, y + gap * v)]
            for n, strength in enumerate(kappa):
                (x0, y0), (x1, y1) = pair
                mean[n] += mpmath.log(mpmath.hypot(x1 - x0, y1 - y0) / gap) / 4
                sines = [mpmath.sinpi(2 * x) * strength / (2 * mpmath.pi) for x, _ in pair]
                pair = [(x + y + s, y + s) for (x, y), s in zip(pair, sines, strict=True)]
    assert mean[-1] > 1
    assert snapshot.separations(kappa, *start).distance == pytest.approx(mean, abs=1e-8)


def test_folds_and_times_agree_with_plain_loops():
    kappa, start = 0.5 + 0.01 * np.arange(101), snapshot.torus(0.5, 0.3, 12)
    followed = snapshot.separations(kappa, *start)
    bound = 0.5 * np.log(1 + (1 + kappa) ** 2)
    shear = 2 * np.log(np.maximum(np.arange(kappa.size), 1))
    rows = [dumb_separations(kappa, *each) for each in np.transpose(start)]
    mean, largest = np.mean([row[0] for row in rows], axis=0), max(row[2].max() for row in rows)
    # Each of the 100 kicks adds a rounding error of 10⁻¹⁶, which grows by a factor of up to σ_n.
    assert followed.distance == pytest.approx(mean, abs=1e-14 * math.exp(largest))
    for i, (logarithm, xi, stretch) in enumerate(rows):
        assert followed.folded[i] == (np.argmax(xi <= 0) if (xi <= 0).any() else np.inf)
        assert followed.separated[i] == after_last_true(logarithm <= bound)
        assert followed.stretched[i] == after_last_true(stretch <= shear)
    assert np.isfinite([followed.folded, followed.separated]).any(axis=1).all()
    assert np.isfinite(followed.stretched).any()


@pytest.mark.parametrize("y", [0.24, 0.3, 0.33, GOLDEN_Y, 0.45])
def test_a_torus_folds_before_it_is_excluded_or_exceeds_the_graph_bound(y):
    kappa = 0.5 + 2e-3 * np.arange(501)
    circle = snapshot.torus(0.5, y, 256)
    followed = snapshot.separations(kappa, *circle)
    beyond = followed.distance > snapshot.graph_bound(kappa)
    past = np.full(kappa.size, 0.5)
    times = aperiodic.elimination_time(np.r_[past, kappa], 0.0, past.size, *circle[:2])
    assert 0 < followed.folded.min() <= times.min() < np.inf
    assert followed.folded.min() - 1 <= beyond.argmax()
    assert beyond.any()


def test_distances_change_little_on_a_torus_in_an_island_despite_its_folds():
    kappa = 0.5 + 1e-3 * np.arange(1001)
    followed = snapshot.separations(kappa, *snapshot.torus(0.5, 0.03, 256))
    assert followed.folded.min() == 0
    assert np.abs(followed.distance - followed.distance[0]).max() < 0.2
    assert np.isinf(followed.stretched).all()


@pytest.mark.parametrize(
    ("name", "value"), [("u", 0.0), ("u", np.nan), ("x", []), ("every", 0), ("every", 3)]
)
def test_zero_vectors_empty_ensembles_and_bad_intervals_are_refused(name, value):
    good = {"kappa": [0.5, 0.5], "x": 0.1, "y": 0.2, "u": 1.0, "v": 0.0}
    with pytest.raises(ValueError, match=name):
        snapshot.separations(**good | {name: value})


def test_the_study_of_the_golden_torus_agrees_with_plain_loops():
    settings = study.Settings(n_starts=2, n_points=32)
    cube = study.snapshots(np.array([1e-2]), 1e-2, settings).isel(start=0, rate=0)
    assert float(cube.omega) == pytest.approx((3 - 5**0.5) / 2, abs=1e-9)
    kappa = 0.5 + 0.01 * np.arange(101)
    zero = int(np.argmax(kappa >= KAPPA_G))
    start = snapshot.torus(0.5, float(cube.y), 32)
    rows = [dumb_separations(kappa, *each) for each in np.transpose(start)]
    mean = np.mean([row[0] for row in rows], axis=0)
    bound = 0.5 * np.log(1 + (1 + kappa) ** 2)
    onset = after_last_true(mean <= bound + np.log(10))
    assert cube.exceeds == np.argmax(mean > bound) - zero
    assert cube.onset == onset - zero
    separated = np.array([after_last_true(row[0] <= bound) for row in rows])
    assert cube.share == (separated <= onset).mean()
    assert cube.slope == pytest.approx((mean[-1] - mean[onset]) / (100 - onset), rel=1e-6)
    assert cube.folded <= cube.excluded <= cube.lost
    assert int(cube.kick[0]) == -zero


def made_up(lag, onset, island_onset, share):
    """Return a cube with two winding tori and one in an island, under two ramps."""
    dims = "start", "rate"
    excluded = np.array([[-20.0, -30.0], [5.0, 10.0], [-90.0, -200.0]])
    kicks = {"excluded": excluded, "folded": excluded - 3, "exceeds": excluded + lag}
    kicks |= {"onset": np.array([onset, onset[::-1], [island_onset] * 2]), "share": share}
    variables = {name: (dims, np.broadcast_to(row, (3, 2))) for name, row in kicks.items()}
    variables |= {"lost": ("rate", [20.0, 40.0]), "winds": ("start", [1, 1, 0])}
    coords = {"start": range(3), "rate": [1e-2, 1e-3]}
    return xr.Dataset(variables, coords, {"last": 1.5})


@pytest.mark.parametrize(
    ("cube", "expected"),
    [
        (made_up(5.0, [10.0, 50.0], np.inf, 0.8), ["Supported: "] * 3),
        (made_up(-5.0, [50.0, 50.0], 9.0, 0.3), ["Not supported"] * 3),
        (made_up([[5.0], [5.0], [-9.0]], [10.0, 30.0], np.inf, [0.4, 0.6]), None),
    ],
)
def test_the_numbers_can_refute_the_claims(cube, expected):
    *lines, _ = study.findings(cube).splitlines()
    if expected:
        assert [words in line for words, line in zip(expected, lines, strict=True)] == [True] * 3
    else:  # the delay in the island does not count, and half of the pairs is not a majority
        assert "Supported: it does so later in 4 of 4" in lines[0]
        assert "Not supported" in lines[2]
