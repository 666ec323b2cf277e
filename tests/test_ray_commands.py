"""Commands on rays and over planes store labelled cubes with the numbers that `nasm` computes."""

import shlex
from itertools import product

import numpy as np
import pytest
import xarray as xr
from commands import succeed, table
from oracles import KAPPA_G

from nasm import barriers, escape, periodic
from nasm.numbers import parse
from nasm.planes import Plane, plane_of, rotating
from nasm.symmetries import ray
from workflows.figures.rotating import where_above
from workflows.rotating import VECTORS


def test_circle_boundaries_agree_with_computations_on_individual_rays(tmp_path, workers):
    rays = ["--n-rays", "5", "--n-cusp-rays", "1", "--tol", "0.1"]
    options = [*rays, "--omega", "gamma", "--omega", "2gamma"]
    succeed("circle_boundaries", tmp_path / "out", *options, *workers)
    cube = xr.open_zarr(tmp_path / "out/breakdown_residue.zarr")
    line = ["python", "-m", "workflows.circle_boundaries", "--out", str(tmp_path / "out")]
    assert cube.history == f"{cube.created} {shlex.join([*line, *options, *workers])}"
    assert cube.angle.values.tolist() == [0, 43, 45]  # all other rays are mirror images of these
    rows = table(tmp_path / "out/circle_boundaries_residue.csv")
    # The extra rays are two degrees from the cusps.
    angles = [0, 43, 45, 47, 90, 133, 135, 137, 180]
    assert [(row["circle"], float(row["angle"])) for row in rows] == [
        *product(("[0;(1)]", "[1;(4)]"), angles)
    ]
    for row in rows:
        expected = periodic.critical_scale(parse(row["circle"]), ray(float(row["angle"])))
        np.testing.assert_allclose(float(row["critical_scale"]), expected.value, rtol=1e-11)
        assert row["status"] == expected.status.name.lower()
    assert len(table(tmp_path / "out/circle_boundaries.csv")) == 2 * 9
    assert {row["status"] for row in rows[:9]} == {"ok"}
    assert (tmp_path / "out/circle_boundaries.png").exists()
    assert (tmp_path / "out/circle_boundaries_tips.png").exists()


@pytest.mark.slow
def test_rotating_maps_are_compared_with_the_standard_map(tmp_path, workers):
    out = tmp_path / "out"
    effort = ["--n-rays", "3", "--n-cusp-rays", "0", "--n-max", "1000", "--n-orbits", "64"]
    succeed("rotating", out, *effort, *workers)
    cell = xr.open_zarr(out / "rotating_tori.zarr").sel(angle=90).isel(frequency=2)
    expected = periodic.torus_scale(*VECTORS[2].split(","), 0.0, 1.0)
    assert float(cell.critical_scale) == float(cell.kappa_amplitude) == expected.value
    # With κ̄ alone, the map is the standard map; with Δκ alone and Ω = 1/2, the forcing is (κ, -κ).
    direct = escape.critical_scale((1.0, 1.0), 1000, 64).upper
    assert float(xr.open_zarr(out / "transport.zarr").upper.sel(angle=0)) == direct
    # At 45° the second kick is 0. Two kicks are then one step of the standard map of strength 2·κ1,
    # so CB_gt is at 2·κ1 = κ_G.
    (row,) = table(out / "rotating_tori.csv", angle="45", vector=VECTORS[2])
    two = KAPPA_G / 2 / 2**0.5
    assert float(row["ratio"]) == pytest.approx(float(row["critical_scale"]) / two, rel=1e-6)
    assert float(row["ratio_direct"]) < float(row["ratio"])


@pytest.mark.slow
def test_three_kicks_are_compared_with_the_standard_map(tmp_path, workers):
    out = tmp_path / "out"
    rays = ["--n-rays", "3", "--n-cusp-rays", "0", "--tol", "1e-2"]
    succeed("three_kicks", out, *rays, "--phase", "1/24", "--phase", "0", *workers)
    expected = barriers.critical_scale(rotating("1/3", "1/24").second, 1e-2)
    there = xr.open_zarr(out / "barrier_rotating_1_3_1_24.zarr").sel(angle=90)
    assert (float(there.lower), float(there.upper)) == (expected.lower, expected.upper)
    # With κ̄ alone, the map is the standard map for any phase and number of kicks.
    for r in table(out / "three_kicks.csv", angle="180"):
        assert abs(float(r["ratio"]) - 1) < float(r["error"]) / float(r["critical_scale"])


def test_a_sweep_over_any_plane_uses_the_names_of_its_axes(tmp_path, workers):
    plane = Plane("mine", {"kappa_b": "b", "kappa_a": "a"}, (0, 0.1, 0), (1, 0, 0), (0, 1, 2))
    (tmp_path / "mine.json").write_text(plane.record["plane"])
    axes = ["--first", "0:2:8", "--second", "-1:1:7", "--tile", "3", "--n-max", "100"]
    options = ["--plane", str(tmp_path / "mine.json"), *axes, *workers]
    for precision in ("single", "double"):
        out = tmp_path / precision
        output = succeed("escape_plane", out, *options, "--precision", precision)
        assert "the plane kappa_b = 0 to 2, kappa_a = -1 to 1 in which" in output.replace("\n", " ")
        cube = xr.open_zarr(out / "escape.zarr").load()
        assert plane_of(cube.attrs) == plane
        times = cube.escape_time.stack(cell=["kappa_b", "kappa_a"])
        sizes, kappas = cube.ensemble.values, plane.forcing(times.kappa_b, times.kappa_a)
        starts = escape.ensemble(sizes[-1])
        expected = escape.first_escape(kappas, *starts, sizes, 100, precision=precision)
        assert 6 < np.isfinite(expected[0]).sum() < 50
        assert np.array_equal(times, expected)
    rotating = ["--plane", "rotating:1/2", "--n-rays", "3", "--tol", "0.1", *workers]
    output = succeed("last_barrier", tmp_path / "half", *rotating)
    rows = table(tmp_path / "half/last_barrier.csv")
    assert [float(r["kappa_amplitude"]) for r in rows] == pytest.approx([0, KAPPA_G, 0], abs=1e-9)
    assert [r["circle"] for r in rows] == ["[0;1,3,(4)]", "[0;(4)]", "[0;1,3,(4)]"]


def test_the_intervals_where_the_ratio_is_above_one_are_listed():
    angle, ratio = np.array([0.0, 10, 20, 30, 40, 50]), np.array([1.5, 1.2, 0.8, 0.9, 1.1, np.nan])
    assert where_above(angle, ratio) == "0°-10° (by 50% at 0°), 40°-40° (by 10% at 40°)"
    inside = np.array([0.9, 0.95, np.nan, 0.97, 0.9, 0.8])
    assert where_above(angle, inside) == "nowhere (largest ratio 0.970, at 30°)"
    assert where_above(angle, np.nan * inside) == "unknown"
