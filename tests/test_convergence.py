"""The convergence study: its fits on made-up data, and a small run of it."""

import numpy as np
import pytest
import xarray as xr

from workflows.convergence import study as convergence
from workflows.shared import direct


def test_the_exponent_of_a_power_law_is_found_with_its_error():
    n = np.geomspace(100, 1e6, 30)
    assert direct.exponent(n, 3 * n ** (-1 / 3.012)) == pytest.approx((3.012, 0), abs=1e-9)
    noise = np.exp(0.1 * np.random.default_rng(0).standard_normal(30))
    eta, deviation = direct.exponent(n, 3 * n ** (-1 / 3.012) * noise)
    assert 0.01 < deviation < 0.2
    assert abs(eta - 3.012) < 3 * deviation


def test_the_bias_is_where_transport_begins_for_good():
    times = [[np.inf, 900, np.inf, 300, 120, 50]]  # one stray escaper inside the boundary
    cube = xr.Dataset(
        {"escape_time": (("ensemble", "excess"), times)},
        {"ensemble": [10], "excess": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]},
        {"n_max": 1000},
    )
    steps = [40, 100, 250, 1000]
    bias = direct.direct_bias(cube, steps).isel(ensemble=0)
    np.testing.assert_array_equal(bias, [np.nan, 0.6, 0.5, 0.4])
    outer = cube.assign(escape_time=cube.escape_time.where(cube.excess > 0.25))
    np.testing.assert_array_equal(direct.direct_bias(outer, steps)[0], bias)
    everything = cube.assign(escape_time=xr.zeros_like(cube.escape_time))
    assert np.isnan(direct.direct_bias(everything, steps)).all()


def test_the_diagonal_has_an_exponent_for_each_half_of_n():
    n = np.geomspace(100, 1e6, 40)
    excess = np.where(n <= 1e4, n ** (-1 / 2.7), 1.5 * n ** (-1 / 3.3))
    coords = {"n": n, "ensemble": [10, 1000], "angle": [20.0, 45.0]}
    bias = xr.DataArray(np.ones((40, 2, 2)), coords, ("n", "ensemble", "angle"))
    bias[:, 1, 1] = excess
    bias[0, 1, 1] = np.nan
    diagonal = convergence.on_the_diagonal(bias, np.sqrt(2) * 0.9)
    np.testing.assert_allclose(diagonal.distance[1:], 0.9 * excess[1:])
    np.testing.assert_allclose(diagonal.eta, [2.7, 3.3])
    np.testing.assert_allclose(diagonal.fit, 0.9 * excess)
