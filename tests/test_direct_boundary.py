"""A small run of the command that finds the boundary by direct iteration."""

import numpy as np
import pytest
import xarray as xr
from commands import succeed, table

from nasm import escape
from nasm.planes import two_kicks
from nasm.symmetries import ray
from workflows.shared.direct_iteration import estimate_tiles

DIRECT = ["--n-rays", "5", "--n-cusp-rays", "0", "--n-orbits", "64", "--n-max", "400,4000"]


@pytest.fixture(scope="module")
def direct(tmp_path_factory, workers):
    """Return the directory of a run of direct iteration on five rays."""
    out = tmp_path_factory.mktemp("direct") / "out"
    succeed("direct_boundary", out, *DIRECT, *workers)
    for name in ("direct_boundary.png", "direct_boundary_quadrant.pdf", "direct_boundary_rays.csv"):
        assert (out / name).exists()
    return out


@pytest.mark.slow
def test_direct_iteration_closes_in_on_the_boundary_from_outside(direct):
    rows = table(direct / "direct_boundary_rays.csv")
    assert [(int(r["n"]), float(r["angle"])) for r in rows] == [
        (n, angle) for n in (400, 4000) for angle in (0, 45, 90, 135, 180)
    ]
    barrier = xr.open_zarr(direct / "barrier.zarr").load()
    scale = {(r["n"], float(r["angle"])): float(r["critical_scale"]) for r in rows}
    for angle in (0, 45, 90, 135, 180):
        upper = float(barrier.upper.sel(angle=0 if angle % 90 == 0 else 45))
        assert upper < scale["4000", angle] < scale["400", angle] < 2.01 * upper
    cube = xr.open_zarr(direct / "direct_boundary.zarr").load()
    for r in rows:
        n, angle = int(r["n"]), float(r["angle"])
        i = np.abs(cube.excess.values - float(r["bias"])).argmin()
        here = cube.sel(angle=angle).isel(excess=slice(i - 1, i + 1))
        kappas = np.stack([here.kappa1, here.kappa2], axis=-1)
        on_ray = float(here.breakup) * np.outer(1 + here.excess, ray(angle))
        np.testing.assert_allclose(kappas, on_ray, atol=1e-12)
        assert (float(r["kappa1"]), float(r["kappa2"])) == pytest.approx(kappas[1], rel=1e-5)
        inside, outside = escape.first_escape(kappas, *escape.ensemble(64), [64], 4000)[0]
        assert outside <= n < inside
        resolution = float(here.breakup) * np.diff(here.excess)[0]
        assert float(r["resolution"]) == pytest.approx(resolution, rel=1e-5)


@pytest.mark.slow
def test_direct_iteration_computes_about_as_many_tiles_as_it_predicts(direct):
    cube = xr.open_zarr(direct / "direct_boundary.zarr")
    n = int(cube.escape_time.notnull().sum())
    assert f"direct_boundary: {n} of {n} tiles\n" in succeed("status", direct)
    job, wanted = estimate_tiles(two_kicks(), [0.0, 45.0, 90.0, 135.0, 180.0], 4000, 64)
    assert job.cube.template.sizes["angle"] == 5
    assert 0.8 * n < len(wanted) < 1.2 * n
    times = cube.escape_time.isel(ensemble=0)
    assert (np.isinf(times).sum("excess") == 1).all()
    assert (times.isel(excess=slice(0, 5)).isnull()).all()
