import os
import platform
import subprocess
import sys

import mpmath
import numpy as np
import oracles
import pytest
from cases import thirds
from numba import njit
from numpy.testing import assert_array_equal
from oracles import KAPPA_G
from scipy.stats import ks_2samp

from nasm import escape
from nasm.barriers import critical_scale
from nasm.escape import boundary, ensemble, escape_time, first_escape
from nasm.results import Status
from nasm.symmetries import ray

# Each entry is a forcing under which all orbits are chaotic, and a number of steps too small for
# rounding to matter: all escape times stay the same if the 1000 starts of the ensemble are moved by
# 1e-12.
SHORT = [((8.0,), 10), ((6.0, 5.0), 8), ((4.0, -5.0, 6.0), 5)]

FORCINGS = [(2.5,), (1.5, 1.4), (1.2, -1.3, 1.6)]


@njit
def _scalar_times(c, x, y, n_max, lo, hi):
    times = np.full(x.size, np.inf)
    for i in range(x.size):
        xi, yi = x[i], y[i]
        for n in range(n_max + 1):
            if yi < lo or yi > hi:
                times[i] = n
                break
            for p in range(c.shape[0]):
                xi, yi = escape.kick_on_lanes(c, p, xi, yi)
    return times


@njit
def _kick_each(c, x, y):
    kicked_x, kicked_y = np.empty_like(x), np.empty_like(y)
    for i in range(x.size):
        kicked_x[i], kicked_y[i] = escape.kick_on_lanes(c, 0, x[i], y[i])
    return kicked_x, kicked_y


def scalar_times(kappa, x, y, n_max, window, precision="double"):
    """Compute escape times one orbit at a time: the kernel's kick without its lanes and blocks."""
    kind, series = escape._PRECISIONS[precision]
    arrays = escape.kick_series(np.array(kappa), series), x - 0.25, y
    return _scalar_times(*(array.astype(kind) for array in arrays), n_max, *window)


@pytest.mark.parametrize("strength", [0.3, -2.0])
def test_a_kick_in_the_kernel_is_accurate_to_within_rounding(strength):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-0.5, 0.5, 2000), rng.uniform(-0.5, 0.5, 2000)
    c = escape.kick_series(np.array([strength]))
    kicked_x, kicked_y = _kick_each(c, x - 0.25, y)
    with mpmath.workdps(30):
        for i in range(x.size):
            shifted = mpmath.mpf(x[i] - 0.25)
            exact_x, exact_y = oracles.exact_step([strength], shifted + 0.25, y[i])
            # The sine is accurate to 2.5e-16; add half an ulp of the sum.
            bound = 2.5e-16 * abs(strength) / (2 * np.pi) + np.spacing(abs(kicked_y[i])) / 2
            assert abs(kicked_y[i] - exact_y) <= bound
            # X is defined only up to whole turns.
            turns = kicked_x[i] + 0.25 - exact_x
            assert abs(turns - mpmath.nint(turns)) <= bound + 1.2e-16


@pytest.mark.parametrize(("kappa", "n_max"), SHORT)
def test_escape_times_agree_with_the_definition(kappa, n_max):
    x, y = ensemble(1000)
    times = escape_time(kappa, x, y, n_max)
    assert_array_equal(times, oracles.escape_time(kappa, x, y, n_max))
    assert {2, 3, 4, 5} <= set(times)


@pytest.mark.parametrize("kappa", thirds([(1.5, 1.5), (0.9, 0.0), (0.7, -0.7, 0.5)]))
def test_long_escape_times_are_distributed_as_in_a_direct_iteration(kappa):
    x, y = ensemble(4000)
    ours = escape_time(kappa, x, y, 5000)
    single = scalar_times(kappa, x, y, 5000, escape.PAPER_WINDOW, "single")
    for others in (oracles.escape_time(kappa, x, y, 5000), single):
        assert (ours != others).any()  # the orbits are chaotic: rounding changes their times
        assert 200 < np.isfinite(ours).sum() < 3999
        # At (1.5, 1.5), kicks 3% stronger would give a p-value of 1e-5.
        assert ks_2samp(np.minimum(ours, 5001), np.minimum(others, 5001)).pvalue > 1e-3


@pytest.mark.parametrize("kappa", FORCINGS)
@pytest.mark.parametrize("n_orbits", [1, 63, 130])
def test_lockstep_blocks_and_packing_do_not_change_escape_times(kappa, n_orbits):
    # 20 001 steps reach the longest chunk, and end in a block that is not full. The smaller numbers
    # of steps end at various places in a block, one of them at an escape.
    x, y = ensemble(n_orbits)
    full, single = (
        scalar_times(kappa, x, y, 20_001, escape.PAPER_WINDOW, precision)
        for precision in ("double", "single")
    )
    assert first_escape(kappa, x, y, [n_orbits], 20_001, precision="single") == single.min()
    first = int(min(full.min(), 1000))
    for n_max in (first - 1, first, 127, 128, 129, 640, 20_001):
        times = np.where(full <= n_max, full, np.inf)
        assert_array_equal(escape_time(kappa, x, y, n_max), times)
        assert first_escape([kappa], x, y, [n_orbits], n_max) == times.min()


@pytest.mark.parametrize("angle", [0.0, 20.0, 120.0])
def test_no_orbit_leaks_through_a_certified_circle_in_single_precision(angle):
    lower = critical_scale(ray(angle), 1e-2).lower
    inside = first_escape(lower * ray(angle), *ensemble(64), [64], 10**6, precision="single")
    assert inside == np.inf
    with pytest.raises(ValueError, match="n_max=1000001 is too large for precision='single'"):
        first_escape(ray(angle), *ensemble(64), [64], 10**6 + 1, precision="single")


@pytest.mark.parametrize("window", [(-2.0, 2.3), (0.05, 0.28), (-0.4, 0.25), (-0.5, 0.5)])
def test_escape_times_are_correct_for_any_kind_of_window(window):
    lo, hi = window
    x, y = ensemble(130)
    y = lo + (hi - lo) * y / 0.3  # inside, so that the smallest time is not 0
    times = escape_time((0.3, 0.2), x, y, 1000, window)
    assert_array_equal(times, scalar_times((0.3, 0.2), x, y, 1000, window))
    smallest = first_escape([(0.3, 0.2)], x, y, [130], 1000, window)
    assert smallest == times.min() > 0


def test_a_start_outside_the_window_escapes_at_time_0_in_every_ensemble():
    starts = [-2.1, 2.31, 40.0, -1e300, -2.0, 0.1, 2.3]
    times = escape_time((0.1, 0.1), 0.0, starts, 10)
    assert (times == 0).tolist() == [True] * 4 + [False] * 3
    x, y = np.array([0.25, 0.25, 0.25]), np.array([0.1, 2.29, 2.31])  # sin 2πx = 1: kicked upwards
    firsts = first_escape([(0.1, 0.1), (0.0, 0.0)], x, y, [1, 2, 3], 1)
    assert_array_equal(firsts, [[np.inf, np.inf], [1, np.inf], [0, 0]])


@pytest.mark.parametrize("kappa", FORCINGS)
def test_first_escape_is_the_smallest_time_of_each_nested_ensemble(kappa):
    x, y = ensemble(700)
    sizes = [1, 2, 63, 64, 65, 128, 300, 700]
    kappas = np.multiply.outer([[0.0, 0.7, 0.8], [0.9, 1.0, 1.3]], kappa)
    firsts = first_escape(kappas, x, y, sizes, 3000)
    assert firsts.shape == (8, 2, 3)
    for cell in np.ndindex(2, 3):
        times = escape_time(kappas[cell], x, y, 3000)
        assert_array_equal(firsts[:, *cell], [times[:size].min() for size in sizes])
    assert np.isinf(firsts[:, 0, 0]).all()
    assert len(np.unique(firsts[:, 1, 2])) > 1


@pytest.mark.parametrize("shift", [-3, 1, 20])
def test_escape_times_do_not_change_if_window_and_starts_shift_by_turns(shift):
    # The starts are rounded so that y + shift and x + 1000 are exact.
    x, y = np.round(np.array(ensemble(200)) * 2**30) / 2**30
    window = np.array([-2.0, 2.25])
    times = escape_time((1.9, 1.9), x, y, 500, window)
    moved = escape_time((1.9, 1.9), x + 1000, y + shift, 500, window + shift)
    assert_array_equal(moved, times)
    firsts = first_escape([(1.9, 1.9)], x, y, [10, 200], 500, window)
    shifted = first_escape([(1.9, 1.9)], x, y + shift, [10, 200], 500, window + shift)
    assert_array_equal(shifted, firsts)


def test_escape_times_broadcast_over_the_starts():
    x, y = np.linspace(0, 1, 3), np.linspace(0, 0.3, 4)
    times = escape_time((6.0, 5.0), x[:, None], y, 8)
    assert times.shape == (3, 4)
    assert times[2, 1] == escape_time((6.0, 5.0), x[2], y[1], 8)
    assert escape_time((6.0, 5.0), 0.1, 0.1, 8).shape == ()
    assert first_escape((6.0, 5.0), *ensemble(10), [1, 10], 100).shape == (2,)


@pytest.mark.parametrize("n_orbits", [1000, 10_000])
def test_ensembles_are_nested_and_fill_the_paper_s_rectangle_evenly(n_orbits):
    x, y = ensemble(n_orbits)
    assert_array_equal(ensemble(100), (x[:100], y[:100]))
    assert ((x >= 0) & (x < 1) & (y >= 0) & (y < 0.3)).all()
    # With 1000 random starts, the fullest of 5 × 5 boxes would contain about 15 more than the mean.
    counts, _, _ = np.histogram2d(x, y, bins=5, range=[(0, 1), (0, 0.3)])
    assert np.abs(counts - n_orbits / 25).max() <= 6


@pytest.mark.slow
def test_a_processor_without_fma_computes_the_same_times(tmp_path):
    if platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("the target without fma is an x86-64 processor")
    path = tmp_path / "times.npy"
    script = f"""
import numpy as np
from nasm import escape
x, y = escape.ensemble(130)
np.save({str(path)!r}, escape.escape_time((1.5, 1.4), x, y, 2000))
(code,) = escape._escape_times.inspect_asm().values()
assert "vfmadd" not in code
"""
    target = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": ""}
    subprocess.run([sys.executable, "-c", script], env=os.environ | target, check=True)
    times = escape_time((1.5, 1.4), *ensemble(130), 2000)
    assert np.isfinite(times).any()
    assert_array_equal(np.load(path), times)


def test_boundary_is_where_a_ray_first_meets_transport():
    kappa1, kappa2 = np.linspace(-0.975, 0.975, 40), np.linspace(0.025, 0.975, 20)
    radius = np.hypot(kappa1, kappa2[:, None])
    times = np.where(radius > 0.6, 100.0, np.inf)
    angles = np.array([[20.0, 45.0], [90.5, 160.0]])
    # Half the diagonal of a cell, plus half a sample spacing.
    half_diagonal = 0.05 / np.sqrt(2) + 0.05 / 16
    result = boundary(times, kappa1, kappa2, angles, 100)
    assert result.shape == angles.shape
    assert np.abs(result - 0.6).max() <= half_diagonal
    assert np.isnan(boundary(times, kappa1, kappa2, angles, 99)).all()
    assert np.isnan(boundary(times, kappa1, kappa2, [-45.0], 100)).all()
    later = np.where(radius > 0.8, 100.0, np.where(radius > 0.6, 1000.0, np.inf))
    assert np.abs(boundary(later, kappa1, kappa2, angles, 100) - 0.8).max() <= half_diagonal


def test_boundary_includes_rays_along_every_edge_of_the_plane():
    kappa = np.arange(0.05, 1, 0.1)
    for first, second, angle in ((kappa, -kappa[::-1], 0), (-kappa[::-1], kappa, 90)):
        times = np.where(np.hypot(first, second[:, None]) > 0.6, 5.0, np.inf)
        assert boundary(times, first, second, [angle], 5)[0] == pytest.approx(0.6, abs=0.06)


def test_the_boundary_is_unknown_if_a_ray_starts_in_transport_or_meets_nan():
    kappa1, kappa2 = np.arange(0.35, 1, 0.1), np.arange(0.05, 1, 0.1)
    times = np.full((10, 7), np.inf)
    times[:, 0] = times[:, 5] = 5.0
    assert np.isnan(boundary(times, kappa1, kappa2, [10.0], 5)).all()
    with pytest.raises(ValueError, match="at least two cells"):
        boundary(times[:1], kappa1, kappa2[:1], [10.0], 5)
    radius = np.hypot(kappa2, kappa2[:, None])
    times = np.where(np.abs(radius - 0.6) < 0.2, np.nan, np.where(radius > 0.6, 100.0, np.inf))
    assert np.isnan(boundary(times, kappa2, kappa2, [10.0, 30.0, 80.0], 100)).all()


@pytest.mark.parametrize(("profile", "barrier"), [((1, 0), KAPPA_G / 2), ((1, 1), KAPPA_G)])
def test_the_direct_scale_has_an_upper_bound_at_which_an_orbit_escapes(profile, barrier):
    for n_max in (3000, 30_000):  # test_work_precision tests how the bias decreases
        result = escape.critical_scale(profile, n_max, 256)
        assert result.status is Status.OK
        x, y = ensemble(256)
        at = np.multiply(result.upper, profile)
        assert first_escape(at, x, y, [256], n_max) <= n_max
        assert result.upper > barrier
        assert abs(result.value - barrier) <= result.error
        assert abs(result.value - barrier) < result.upper - barrier


@pytest.mark.parametrize(
    ("profile", "n_max", "n_orbits"), [(ray(46.285), 3000, 100), ((1, 0.2), 10_000, 10)]
)
def test_the_error_of_the_direct_scale_covers_an_atypical_ensemble(profile, n_max, n_orbits):
    result, barrier = escape.critical_scale(profile, n_max, n_orbits), critical_scale(profile, 1e-3)
    assert result.upper - result.value < abs(result.value - barrier.value) <= result.error


@pytest.mark.parametrize(
    ("profile", "n_max", "n_orbits"),
    [((1, 0.6, 0.3), 300, 10), ((1, 0), 64, 64), ((0.2, -1, 0.5), 500, 30), ((1,), 200, 10)],
)
def test_before_the_power_law_holds_there_is_an_upper_bound_but_no_value(profile, n_max, n_orbits):
    result = escape.critical_scale(profile, n_max, n_orbits)
    assert result.status is Status.NOT_CONVERGED
    assert np.isnan([result.value, result.error, result.lower]).all()
    assert result.upper == escape.onset_scale(profile, n_max, n_orbits)
    assert result.upper > critical_scale(profile, 1e-2).value


@pytest.mark.parametrize("n_max", [100, 1000, 10_000])
def test_a_value_is_between_zero_and_the_onset_and_larger_than_its_error(n_max):
    rng = np.random.default_rng(n_max)
    results = [
        escape.critical_scale(rng.uniform(-1, 1, n_kicks), n_max, 30) for n_kicks in (1, 2, 3, 5)
    ]
    for answer in results:
        if answer.status is Status.OK:
            assert 0 < answer.error < answer.value <= answer.upper
        else:
            assert np.isnan(answer.value)
    assert (n_max == 10_000) == all(answer.status is Status.OK for answer in results)


@pytest.mark.parametrize("n", [50, 400])
def test_at_the_onset_an_orbit_escapes_in_n_steps_and_just_below_none_does(n):
    onset = escape.onset_scale((1, 0.3), n, 20)
    bisections = np.ceil(np.log2(2 / (1e-4 * onset)))
    kappas = np.multiply.outer([onset - 2 / 2**bisections, onset], (1, 0.3))
    times = [escape_time(kappa, *ensemble(20), n).min() for kappa in kappas]
    assert times[0] == np.inf
    assert times[1] <= n
    assert np.isnan(escape.onset_scale((1, 0.3), 2, 20))  # too few steps to leave the window
    assert np.isnan(escape.onset_scale((1, 0.3), n, 20, max_scale=0.8 * onset))


def test_a_critical_scale_needs_a_window_that_orbits_can_leave():
    assert escape.critical_scale((1, 1), 640, 64, window=(-0.7, 1.0)).status is Status.OK
    result = escape.critical_scale((1, 0), 64, 64, window=(-1e6, 1e6))
    assert result.status is Status.NO_BREAKUP
    assert np.isnan([result.value, result.error, result.upper]).all()
    assert np.isnan(escape.onset_scale((1, 0), 64, 64, window=(-1e6, 1e6)))


def test_masked_cells_of_a_field_are_unknown_and_its_axes_must_match():
    times, centres = np.full((4, 4), np.inf), (np.arange(4) + 0.5) / 4
    times[2:, 2:] = 5
    mask = np.zeros((4, 4), bool)
    mask[1, 1:3] = mask[2, 1] = True
    masked = np.ma.array(times, mask=mask)
    assert np.isnan(boundary(masked, centres, centres, [40], 10))
    assert 0.6 < boundary(times, centres, centres, [40], 10) < 0.8
    for wrong in (centres[::-1], centres**2, centres[:3], [0.1]):
        with pytest.raises(ValueError, match=r"kappa2=|escape_time has shape \(4, 4\)"):
            boundary(times, centres, wrong, [40], 10)
