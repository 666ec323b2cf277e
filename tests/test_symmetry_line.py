"""Compare converse KAM on symmetry lines with residues; test_transversal tests the criterion."""

from itertools import product

import numpy as np
import pytest
from cases import thirds
from numba import njit
from numpy.testing import assert_array_equal

from nasm import periodic
from nasm.converse_kam import symmetry_line
from nasm.converse_kam.symmetry_line import critical_scale, elimination_time, longest_lived
from nasm.results import Status
from nasm.symmetries import ray

# Each forcing is several per cent beyond the breakup of its last circle; tests rescale it.
FORCINGS = [(1.03,), (0.71, 0.46), (-0.43, 0.72), (0.15, -0.57)]
Y = (np.arange(300) + 0.5) / 600


@njit
def _one_by_one(c, x0, w0, y0, n_max):
    times = np.full(y0.size, np.inf)
    for i in range(y0.size):
        x, y, v, w = x0, y0[i], 1.0, w0
        for n in range(n_max):
            x, y, v, w = symmetry_line.tangent_kick(c, n % len(c), x, y, v, w)
            if v <= 0:
                times[i] = n + 1
                break
    return times


@pytest.mark.parametrize("kappa", FORCINGS)
@pytest.mark.parametrize("n_starts", [1, 63, 300])
def test_lifetimes_do_not_depend_on_how_starts_and_kicks_are_grouped(kappa, n_starts):
    # Compare with the same kicks applied to individual floats, one start at a time. The last block
    # may be incomplete.
    line = symmetry_line._line_coefficients(
        0.9 * critical_scale(kappa, 100).value * np.array(kappa)
    )
    for n in (1, 2, 15, 16, 17, 31, 100, 700, 20_001):
        times = symmetry_line._lifetimes(line, Y[:n_starts], n)
        assert_array_equal(times, _one_by_one(*line, Y[:n_starts], n))
    if n_starts == 300:
        assert 2 < np.isinf(times).sum() < 100
        assert (times[np.isfinite(times)] > 100).any()


@pytest.mark.parametrize("kappa", [(2.1,), (-5, 1), (0.3, 1e6), (2.001, 0, 2.001, 0)])
def test_beyond_strength_two_the_first_kick_eliminates_all_starts(kappa):
    assert_array_equal(elimination_time(kappa, Y, 5), 1 / len(kappa))


# {angle of the ray: ω of its most robust circle}, found by trying noble numbers.
LAST = {0: "gamma", 20: "gamma", 30: "[0;1,2,(1)]", 36: "[0;1,3,(1)]"}
LAST |= {43: "[0;1,3,2,(1)]", 45: "2gamma"}
CASES = [(0, 10_000), *product(LAST, (100, 500, 3000)), (45, 10_000)]


@pytest.mark.parametrize("case", thirds(CASES))
def test_the_last_circle_breaks_where_its_residue_predicts(case):
    degrees, n_max = case
    profile = ray(degrees)
    exact = periodic.critical_scale(LAST[degrees], profile).value
    result = critical_scale(profile, n_max)
    assert result.status is Status.OK
    assert abs(result.value - exact) <= result.error
    assert result.value + result.error <= result.upper
    assert exact < result.upper < exact * (1 + 1.1 / n_max)
    if n_max >= 10_000:
        assert result.error < 5e-5 * exact
    assert np.isnan(result.lower)
    assert result.omega is None


@pytest.mark.parametrize("degrees", [45 - 1e-1, 45 - 1e-2, 45 - 1e-3, 45 - 1e-5])
def test_error_estimates_close_to_the_cusp_cover_the_true_errors(degrees):
    better = critical_scale(ray(degrees), 20_000)
    for n_max in (100, 400, 1600):
        result = critical_scale(ray(degrees), n_max)
        assert abs(result.value - better.value) <= result.error + better.error
        assert better.value < result.upper


def test_all_starts_are_eliminated_above_upper_but_not_slightly_below_it():
    result = critical_scale(ray(30), 500)
    for scale in (1, 1.001, 1.01, 1.3, 3):
        assert longest_lived(scale * result.upper * ray(30), 500)[1] < np.inf
    assert longest_lived((result.value - result.error) * ray(30), 500)[1] == np.inf
    assert longest_lived(result.upper * ray(30), 300)[1] == np.inf


@pytest.mark.parametrize("degrees", thirds([14, 30, 44.4, 44.99]))
def test_a_dense_scan_does_not_find_a_longer_lifetime(degrees):
    # If T is the lifetime, the cells of the search shrink to a width of 0.01/T² ≈ 5e-8; the
    # cells of the scan are 2.4e-7 wide.
    kappa = 1.003 * critical_scale(ray(degrees), 5000).value * ray(degrees)
    _, time = longest_lived(kappa, 10**6)
    dense = elimination_time(kappa, (np.arange(2**21) + 0.3) / 2**22, 10**6).max()
    assert 0.98 * time <= dense <= 1.005 * time
