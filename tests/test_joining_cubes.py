"""Plain xarray can join cubes with different rays; strings survive or become missing values."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pipeline import store
from pipeline.cubes import barrier
from pipeline.cubes.cube import Cube

RAYS = {"a": [0.0, 15.0, 45.0], "b": [0.0, 10.0, 30.0, 45.0]}
CIRCLES = {0.0: "[0;(1)]", 10.0: "[0;(1)]", 15.0: "", 30.0: "[0;1,2,(1)]", 45.0: "[0;1,3,(4)]"}
TIED = {0.0: "[0;2,(1)]"}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a store with two boundary cubes; the first has a ray without an answer."""
    place = store.place_of(tmp_path_factory.mktemp("cubes"))
    for name, angles in RAYS.items():
        result = barrier.boundary(angles, 0.1)
        circles = result.circle.copy(data=[CIRCLES[angle] for angle in angles])
        store.replace(place, Cube(name, result.assign_coords(circle=circles), {}, {}), "tests")
    return place


@pytest.fixture(scope="module")
def opened(place):
    """Open the cubes as any user of xarray would, without loading their data."""
    return [xr.open_zarr(place.cube(name), chunks=None) for name in RAYS]


def texts(variable, expected):
    """Return True if each angle has the expected text, or NaN where no text is expected."""
    pairs = zip(variable.values, variable.angle.values.tolist(), strict=True)
    return all(
        text == expected[angle] if expected.get(angle) else pd.isna(text) for text, angle in pairs
    )


def only(expected, angles):
    return {angle: expected.get(angle) for angle in angles}


def test_cubes_with_different_rays_merge_and_missing_circles_stay_missing(opened):
    one, other = opened
    merged = xr.merge(
        [one[["critical_scale"]], other[["upper"]]], join="outer", compat="no_conflicts"
    )
    assert merged.angle.values.tolist() == sorted(CIRCLES)
    assert texts(merged.circle, CIRCLES)
    assert texts(merged.tied, TIED)
    assert merged.upper.isnull().values.tolist() == [False, False, True, False, False]
    for cube, aligned in zip(opened, xr.align(*opened, join="outer"), strict=True):
        assert texts(aligned.circle, only(CIRCLES, cube.angle.values))
    assert texts(one.reindex(angle=[0.0, 1.0]).circle, {0.0: CIRCLES[0.0]})


def test_runs_joined_along_a_new_dimension_can_be_saved_as_netcdf_and_csv(opened, tmp_path):
    runs = xr.concat(opened, "run", join="outer", coords="different", compat="equals")
    for run, angles in enumerate(RAYS.values()):
        assert texts(runs.circle.isel(run=run), only(CIRCLES, angles))
    scales = runs[["critical_scale"]]
    scales.to_netcdf(tmp_path / "runs.nc", engine="scipy")
    with xr.open_dataset(tmp_path / "runs.nc", engine="scipy") as back:
        xr.testing.assert_equal(back, scales)
    scales.to_dataframe().to_csv(tmp_path / "runs.csv")
    table = pd.read_csv(tmp_path / "runs.csv").set_index(["run", "angle"])
    assert {*table.circle.dropna()} == {text for text in CIRCLES.values() if text}
    assert table.circle[1, 30.0] == CIRCLES[30.0]
    assert scales.isel(run=1).groupby("circle").count().critical_scale.sel(circle="[0;(1)]") == 2


def test_the_program_reads_strings_as_it_wrote_them(place):
    cube = store.read(place, "a")
    assert cube.circle.values.tolist() == [CIRCLES[angle] for angle in RAYS["a"]]
    assert cube.tied.values.tolist() == [TIED.get(angle, "") for angle in RAYS["a"]]
    assert {"circle", "tied"} <= {*cube.coords}


def test_comments_mark_variables_that_must_not_be_interpolated(opened):
    cube = opened[0]
    assert np.isfinite(cube.omega.interp(angle=5.0))  # allowed, but the comment warns against it
    for name in ("omega", "status"):
        assert "do not interpolate" in cube[name].attrs["comment"]


def test_every_cell_of_a_notebook_has_a_unique_id():
    for path in (Path(__file__).parents[1] / "workflows/examples").glob("*.ipynb"):
        ids = [cell["id"] for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]]
        assert len({*ids}) == len(ids) > 3, path
