"""Compare the stored portraits with the map (Fig. 1) and with its symmetries (Fig. 2)."""

import numpy as np
import pytest
import xarray as xr
from commands import succeed

from nasm.maps import kick, step
from workflows.portraits import study as portraits


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("portraits") / "out"
    succeed("portraits", out, "--n-orbits", "8", "--n-max", "60")
    assert (out / "portraits.pdf").exists()
    return out


def distance(a, b):
    """Return the largest distance modulo 1 between coordinates a and b."""
    return np.abs((np.asarray(a) - np.asarray(b) + 0.5) % 1 - 0.5).max()


def test_the_stored_points_form_orbits_whose_first_kick_is_kappa_1(finished):
    cube = xr.open_zarr(finished / "portraits.zarr")
    assert (cube.kappa1.values.tolist(), cube.kappa2.values.tolist()) == ([0.35, 0.5], [0.5, 0.35])
    for i in (0, 1):
        here = cube.isel(forcing=i)
        kappa = float(here.kappa1), float(here.kappa2)
        x, y = step(kappa, here.x[:-1].values, here.y[:-1].values)
        assert max(distance(x, here.x[1:]), distance(y, here.y[1:])) < 1e-13
    # The points after odd numbers of kicks form orbits of the map with the two kicks swapped.
    x, y = cube.kick_x.values, cube.kick_y.values
    first, second = portraits.FORCING
    assert distance((x[1], y[1]), kick(first, x[0], y[0])) < 1e-13
    for parity, kappa in ((0, (first, second)), (1, (second, first))):
        ends = step(kappa, x[parity:-2:2], y[parity:-2:2])
        assert distance(ends, (x[parity + 2 :: 2], y[parity + 2 :: 2])) < 1e-13


def test_the_four_portraits_are_images_of_one_another(finished):
    cube = xr.open_zarr(finished / "portraits_symmetry.zarr")
    forcings = [(0.5, 0.7), (-0.5, -0.7), (-0.5, 0.7), (0.5, -0.7)]
    assert list(zip(cube.kappa1.values, cube.kappa2.values, strict=True)) == forcings
    assert float(cube.difference.max()) < 1e-12
    caption = (finished / "portraits_symmetry.txt").read_text()
    assert f"to {float(cube.difference.max()):.0e}" in caption
