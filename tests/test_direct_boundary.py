"""The boundary by direct iteration and its asymmetry, of made-up escape times."""

import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

from nasm import escape
from nasm.symmetries import ray
from workflows import direct_boundary
from workflows.figures.direct_boundary import describe

EXCESS = np.geomspace(0.1, 0.8, 4)


def dataset(angles, beyond):
    """Of rays that break at scale 0.5, from the index `beyond` of EXCESS on within 50 steps."""
    times = np.where(np.arange(4) >= np.array(beyond)[:, None], 50.0, np.inf)
    times[:, 0] = np.nan
    found = xr.Dataset(
        {"escape_time": (("ensemble", "angle", "excess"), times[None])},
        {"ensemble": [10], "angle": np.array(angles, dtype=float), "excess": EXCESS},
    )
    barrier = found[["angle"]].assign(critical_scale=("angle", np.full(len(angles), 0.5)))
    return direct_boundary.boundary_dataset(found, barrier, [20, 100])


def test_a_symmetric_boundary_has_no_asymmetry():
    boundary = dataset([0, 30, 60, 90, 120, 150, 180], [3, 2, 2, 3, 2, 2, 3])
    late = boundary.sel(n=100)
    np.testing.assert_allclose(late.critical_scale, 0.5 * (1 + EXCESS[[3, 2, 2, 3, 2, 2, 3]]))
    np.testing.assert_allclose(np.hypot(late.kappa1, late.kappa2), late.critical_scale)
    np.testing.assert_allclose(late.resolution, 0.5 * (EXCESS / 2)[[3, 2, 2, 3, 2, 2, 3]])
    for name in ("swap", "mirror", "swap_times", "mirror_times"):
        assert not late[name].fillna(0).any()
    assert late.angle[late.mirror.notnull()].values.tolist() == [0, 30, 60, 120, 150, 180]
    assert boundary.sel(n=20).bias.isnull().all()


def test_each_asymmetry_is_found_in_its_own_pairs_of_rays():
    boundary = dataset([0, 30, 60, 90, 120, 150, 180], [2, 3, 2, 2, 2, 2, 2]).sel(n=100)
    more, less = 1 + EXCESS[3], 1 + EXCESS[2]
    apart = 2 * (more - less) / (more + less)
    np.testing.assert_allclose(boundary.swap, [0, apart, -apart, 0, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(boundary.mirror, [0, apart, 0, np.nan, 0, -apart, 0], atol=1e-15)


def test_rays_without_an_image_have_no_asymmetry_to_report():
    boundary = dataset([0, 60, 120, 180], [2, 2, 2, 2])
    assert boundary.swap.isnull().all()
    assert not boundary.sel(n=100).mirror.any()
    assert "κ1 → -κ1 the boundary of the largest N moves by 0%" in describe(boundary)
    assert "κ1 ↔ κ2" not in describe(boundary)


def test_escape_times_are_compared_with_those_of_the_image():
    angle, times = np.array([30.0, 60.0, 120.0, 150.0]), np.array([8, 2, np.inf, 4])[:, None]
    unlike = direct_boundary.asymmetry(angle, np.ones((1, 4)), times)
    halvings = {"swap_times": [2, -2, np.nan, np.nan], "mirror_times": [1, np.nan, np.nan, -1]}
    for name, expected in halvings.items():
        np.testing.assert_allclose(unlike[name][1][:, 0] / np.log(2), expected)


def test_help_comes_at_once():
    command = [sys.executable, "-X", "importtime", "-m", "workflows.direct_boundary", "--help"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    for option in ("--steps", "--n-orbits", "--angles", "--scheduler"):
        assert option in run.stdout
    assert "numba" not in run.stderr
    assert "xarray" not in run.stderr


@pytest.mark.slow
def test_the_asymmetry_of_escape_times_is_that_of_roundings():
    random = np.random.default_rng(0)
    kappas = random.uniform(0.85, 1.1, (200, 1)) * ray(random.uniform(2, 43, 200))
    perturbed = kappas * (1 + 4e-16)
    forcings = np.stack([kappas, perturbed, kappas * [-1, 1], kappas[:, ::-1]])
    times = escape.first_escape(forcings, *escape.ensemble(1000), [1000], 20_000)[0]
    times = times[:, np.isfinite(times).all(axis=0)]
    assert times.shape[1] > 100
    rounding, mirror, swap = np.median(np.abs(np.log(times[1:] / times[0])), axis=1)
    assert 0.1 < rounding < 0.4
    assert mirror == pytest.approx(rounding, rel=0.5)
    assert swap == pytest.approx(rounding, rel=0.5)
