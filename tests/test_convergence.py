"""The convergence study: fits to synthetic data, and a small run."""

import json

import numpy as np
import pytest
import xarray as xr
from commands import succeed

from nasm import barriers, escape, planes
from workflows.convergence import study as convergence
from workflows.shared import direct_iteration


def test_the_exponent_of_a_power_law_is_found_with_its_error():
    n = np.geomspace(100, 1e6, 30)
    assert direct_iteration.exponent(n, 3 * n ** (-1 / 3.012)) == pytest.approx(
        (3.012, 0), abs=1e-9
    )
    noise = np.exp(0.1 * np.random.default_rng(0).standard_normal(30))
    eta, deviation = direct_iteration.exponent(n, 3 * n ** (-1 / 3.012) * noise)
    assert 0.01 < deviation < 0.2
    assert abs(eta - 3.012) < 3 * deviation


def test_the_bias_is_the_excess_above_which_orbits_always_escape():
    times = [[np.inf, 900, np.inf, 300, 120, 50]]  # one stray escape inside the boundary
    cube = xr.Dataset(
        {"escape_time": (("ensemble", "excess"), times)},
        {"ensemble": [10], "excess": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]},
        {"n_max": 1000},
    )
    steps = [40, 100, 250, 1000]
    bias = direct_iteration.direct_bias(cube, steps).isel(ensemble=0)
    np.testing.assert_array_equal(bias, [np.nan, 0.6, 0.5, 0.4])
    outer = cube.assign(escape_time=cube.escape_time.where(cube.excess > 0.25))
    np.testing.assert_array_equal(direct_iteration.direct_bias(outer, steps)[0], bias)
    everything = cube.assign(escape_time=xr.zeros_like(cube.escape_time))
    assert np.isnan(direct_iteration.direct_bias(everything, steps)).all()


def test_on_the_diagonal_an_exponent_is_fitted_to_each_half_of_the_n_range():
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


PROFILE = (1.0, 0.6, 0.3)
AXES = {"kappa_a": "strength of PROFILE", "kappa_b": "strength of the second kick"}
PLANE = planes.Plane("of-a-profile", AXES, (0, 0, 0), PROFILE, (0, 1, 0))


def test_breakups_are_computed_on_rays_from_zero_in_any_plane():
    breakups = convergence.breakups(PLANE, [0.0])
    assert breakups == {0.0: barriers.critical_scale(PROFILE, 1e-3).value}
    with pytest.raises(ValueError, match="needs rays from zero"):
        convergence.breakups(planes.three_kicks(0.2), [0.0])


@pytest.mark.slow
def test_any_profile_can_be_studied_as_a_ray_in_a_plane(tmp_path, workers):
    (tmp_path / "plane.json").write_text(json.dumps(json.loads(PLANE.record["plane"])))
    effort = ["--angle", "0", "--n-max", "10000", "--n-orbits", "30"]
    succeed("convergence", tmp_path, "--plane", str(tmp_path / "plane.json"), *effort, *workers)
    cube = xr.open_zarr(tmp_path / "escape_rays.zarr").load()
    assert not (tmp_path / "convergence_diagonal.zarr").exists()
    breakup = barriers.critical_scale(PROFILE, 1e-3).value
    onset = escape.onset_scale(PROFILE, 10_000, 30) / breakup - 1
    times = cube.escape_time.squeeze()
    assert times.sel(excess=slice(1.5 * onset, None)).max() <= 10_000
    assert times.sel(excess=slice(None, onset / 1.5)).min() > 10_000
