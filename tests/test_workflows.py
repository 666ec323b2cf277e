"""The workflows as a user meets them: on the command line, from the table, from the store."""

import csv
import os
import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
import zarr
from click.testing import CliRunner
from distributed import LocalCluster
from pipeline.layout import COMMIT

from nasm import barriers, escape, periodic, symmetries, transversals
from nasm import flux as nasm_flux
from nasm.maps import rotating_forcing
from nasm.numbers import parse
from nasm.verdict import Answer, verdict
from pipeline import store
from workflows import (
    circle_boundaries,
    critical_boundary,
    direct_boundary,
    escape_plane,
    flux,
    last_barrier,
    period_one,
    rotating,
    three_kicks,
)
from workflows.figures.stretches import stretches, where_above

QUICK = ["--n-max", "4000", "--n-orbits", "16,64", "--tile", "4"]
PLANE = ["--kappa1", "-1.4:1.4:128", "--kappa2", "0:1.4:64"]
KAPPA_G = tomllib.loads(Path(__file__).with_name("literature.toml").read_text())["kappa_G"]["value"]


RAYS = ["--tips", "0", "--tol", "0.01"]
WORKERS = []


@pytest.fixture(scope="module", autouse=True)
def workers():
    """Workers for all workflows of this module, which compile the kernels once."""
    with LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        WORKERS[:] = ["--scheduler", cluster.scheduler_address]
        yield


def invoke(workflow, out, *options):
    return CliRunner().invoke(workflow.main, ["--out", str(out), *options])


def succeed(workflow, out, *options):
    result = invoke(workflow, out, *options, *WORKERS)
    assert result.exit_code == 0, result.output + repr(result.exception)
    return result.output


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The main job, small: its directory."""
    out = tmp_path_factory.mktemp("main") / "out"
    output = succeed(
        critical_boundary, out, *QUICK, *PLANE, *RAYS, "--levels", "3", "--angles", "37"
    )
    for name in ("cubes.zarr", "critical_boundary.csv", "critical_boundary.png"):
        assert f"{out}/{name}" in output
        assert (out / name).exists()
    return out


@pytest.fixture(scope="module")
def dense(tmp_path_factory):
    """The same plane with every cell computed: its directory."""
    out = tmp_path_factory.mktemp("dense") / "out"
    succeed(escape_plane, out, *QUICK, *PLANE)
    assert (out / "escape_plane.png").exists()
    return out


def field(out):
    return xr.open_zarr(out / "cubes.zarr", group="escape").escape_time.isel(ensemble=-1).values


def test_refinement_finds_the_boundary_of_the_full_grid(finished, dense):
    refined = xr.open_zarr(finished / "cubes.zarr", group="escape")
    assert set(np.unique(refined.level)) == {0, 1, 2}
    differ = (field(finished) <= 4000) != (field(dense) <= 4000)
    assert differ.mean() < 0.002
    finest = refined.level.values == 2
    assert np.array_equal(field(finished)[finest], field(dense)[finest])
    assert 0.1 < finest.mean() < 0.9


def test_the_cube_explains_itself(dense):
    cube = xr.open_zarr(dense / "cubes.zarr", group="escape")
    assert cube.escape_time.dims == ("ensemble", "kappa2", "kappa1")
    assert cube.attrs["n_max"] == 4000
    assert cube.attrs["window"] == [-2.0, 2.3]
    for variable in cube.variables.values():
        assert {"long_name", "units"} <= set(variable.attrs)
    assert {"title", "config_hash", "package_version", "git_commit", "created"} <= set(cube.attrs)


def table(path, **where):
    with open(path) as file:
        rows = csv.DictReader(file)
        return [r for r in rows if all(r[key] == value for key, value in where.items())]


def test_the_direct_table_holds_the_boundary_along_rays(finished):
    rows = table(finished / "direct_boundary.csv")
    assert len(rows) == 37
    assert {r["n"] for r in rows} == {"4000"}
    assert {float(r["resolution"]) for r in rows if r["resolution"]} == {2.8 / 128}
    ends = {r["angle"]: (r["kappa1"], r["kappa2"]) for r in rows}
    scale = {r["angle"]: r["critical_scale"] for r in rows}
    assert ends["0"] == (scale["0"], "0")
    assert ends["90"] == ("0", scale["90"])
    assert ends["180"] == (f"-{scale['180']}", "0")
    assert ends["45"][0] == ends["45"][1]


def test_the_boundary_is_bracketed_on_every_ray_and_the_last_circle_named(finished):
    rows = table(finished / "critical_boundary.csv")
    assert [float(r["angle"]) for r in rows] == list(range(0, 181, 5))
    for r in rows:
        assert r["status"] == "ok"
        value, lower, upper = (float(r[key]) for key in ("critical_scale", "lower", "upper"))
        assert lower < value < upper
        assert upper - lower < 0.0101 * value
        assert float(parse(r["circle"])) == pytest.approx(float(r["omega"]), abs=1e-11)
    # On the axis the golden circle breaks at κ_G/2, on the diagonal that of 2γ at (κ_G, κ_G).
    scale = {int(float(r["angle"])): float(r["critical_scale"]) for r in rows}
    for angle, exact in ((0, KAPPA_G / 2), (45, KAPPA_G * 2**0.5), (90, KAPPA_G / 2)):
        assert scale[angle] == pytest.approx(exact, abs=1e-10)
    for angle in range(0, 45, 5):
        copies = [scale[a] for a in (angle, 90 - angle, 90 + angle, 180 - angle)]
        assert max(copies) == min(copies)
    circles = {int(float(r["angle"])): r["circle"] for r in rows}
    assert circles[45] == "[0;1,3,(4)]"
    assert circles[135] == "[0;(4)]"
    assert circles[30] == circles[60] == "[0;1,2,(1)]"
    assert circles[120] == circles[150] == "[0;3,(1)]"


def test_the_three_methods_are_in_order(finished):
    # Circles break before the last of them does, and orbits escape beyond that.
    last = {r["angle"]: r for r in table(finished / "critical_boundary.csv")}
    for r in table(finished / "circle_boundaries.csv"):
        assert float(r["critical_scale"]) - float(r["error"]) < float(last[r["angle"]]["upper"])
    for r in table(finished / "direct_boundary.csv"):
        assert float(last[r["angle"]]["critical_scale"]) < float(r["critical_scale"])


def test_the_direct_boundary_has_the_symmetry_of_the_square(finished):
    rows = table(finished / "direct_boundary.csv", n="4000")
    scale = {float(r["angle"]): float(r["critical_scale"] or "nan") for r in rows}
    for angle in range(0, 45, 5):
        copies = [scale[a] for a in (angle, 90 - angle, 90 + angle, 180 - angle)]
        # At finite N the window, not symmetric itself, and the draw of the escapers leave 10-20%.
        np.testing.assert_allclose(copies, np.mean(copies), rtol=0.15)


def test_a_second_run_computes_nothing_and_says_the_same(dense):
    before = commit_times(dense)
    succeed(escape_plane, dense, *QUICK, *PLANE)
    assert commit_times(dense) == before


def commit_times(out):
    records = (out / "cubes.zarr/escape" / COMMIT).rglob("*")
    return {path: path.stat().st_mtime_ns for path in records}


def test_other_settings_are_refused_and_nothing_is_touched(dense, finished):
    before = snapshot(dense)
    other = ["--n-max", "5000"]
    result = invoke(escape_plane, dense, *QUICK, *PLANE, *other)
    assert result.exit_code == 2
    assert "n_max is 4000, not 5000" in result.output
    result = invoke(critical_boundary, dense, *QUICK, *PLANE, "--levels", "3")
    assert result.exit_code == 2
    assert "levels is None, not 3" in result.output
    before_refined = snapshot(finished)
    same = [*QUICK, *PLANE, "--levels", "3", "--angles", "37"]
    result = invoke(critical_boundary, finished, *same, *RAYS, "--follow", "300")
    assert result.exit_code == 2
    assert "follow is [4000], not [300]" in result.output
    result = invoke(critical_boundary, finished, *same, "--tips", "0", "--tol", "0.02")
    assert result.exit_code == 2
    assert "tol is 0.01, not 0.02" in result.output
    assert snapshot(dense) == before
    assert snapshot(finished) == before_refined


def snapshot(out):
    files = [path for path in out.rglob("*") if path.is_file() and path.name != ".lock"]
    return {path: path.stat().st_mtime_ns for path in files}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--kapa1", "0:1:8"], "No such option"),
        (["--kappa1", "1:0:8"], "lower one first"),
        (["--kappa1", "nan:1:8"], "finite"),
        (["--kappa2", "0:1"], "LO:HI:N"),
        (["--kappa2", "0:1:0"], "from 1 to 1048576"),
        (["--n-max", "0"], "1<=x<=1000000000000"),
        (["--n-max", "-5"], "1<=x<=1000000000000"),
        (["--n-max", "10000000000000"], "1<=x<=1000000000000"),
        (["--n-max", "1e5"], "not a valid integer"),
        (["--n-orbits", "0"], "increasing whole numbers from 1"),
        (["--n-orbits", ""], "increasing whole numbers from 1"),
        (["--n-orbits", "100,10"], "increasing whole numbers from 1"),
        (["--tile", "0"], "1<=x<=4096"),
        (["--kappa1", "0:1:30", "--levels", "3"], "multiple of 4"),
        (["--kappa1", "0:1:4", "--levels", "3"], "use at least 8"),
        (["--kappa1", "0:1:1", "--levels", "1"], "use at least 2"),
        (["--follow", "2000000"], "must be at most n-max"),
        (["--workers", "0"], "1<=x<=4096"),
        (["--tls", "none", "none", "none"], "does not exist"),
        (["--tls", __file__, __file__, __file__], "give its tls:// address"),
        (["--scheduler", "tls://127.0.0.1:9"], "needs TLS files"),
        (["--scheduler", "tcp://127.0.0.1:9", "--workers", "1"], "leave --workers out"),
        (["--scheduler", "tcp://127.0.0.1:9"], "no dask scheduler answers"),
        (["--scheduler", "nonsense"], "must be tcp://HOST:PORT"),
    ],
)
@pytest.mark.parametrize("workflow", [escape_plane, critical_boundary])
def test_bad_input_is_one_clear_message_and_nothing_is_made(tmp_path, workflow, options, message):
    result = invoke(workflow, tmp_path / "out", *options)
    assert result.exit_code == 2
    assert message in result.output
    assert not (tmp_path / "out").exists()


def test_a_foreign_directory_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    result = invoke(escape_plane, tmp_path)
    assert result.exit_code == 2
    assert "holds other files" in result.output
    assert os.listdir(tmp_path) == ["notes.txt"]


def test_a_store_of_another_version_is_refused(tmp_path):
    zarr.create_group(tmp_path / store.STORE, attributes={"format": "nasm-cubes/99"})
    before = snapshot(tmp_path)
    result = invoke(escape_plane, tmp_path)
    assert result.exit_code == 2
    assert "nasm-cubes/99" in result.output
    assert snapshot(tmp_path) == before


def test_a_directory_that_another_run_writes_is_refused(tmp_path):
    with store.driving(tmp_path):
        result = invoke(escape_plane, tmp_path, *QUICK, *WORKERS)
    assert result.exit_code == 2
    assert "is being written by another run" in result.output


def test_a_directory_that_cannot_be_written_is_refused():
    result = invoke(escape_plane, "/proc/self/none", *QUICK, *WORKERS)
    assert result.exit_code == 2
    assert "cannot write" in result.output


@pytest.mark.parametrize(
    "plane",
    [
        ["--kappa1", "0:0.1:8", "--kappa2", "0:0.1:8"],  # nothing escapes
        ["--kappa1", "3:3.1:8", "--kappa2", "3:3.1:8"],  # everything does
        ["--kappa1", "-1.1:1.1:16", "--kappa2", "-1.1:0:8"],  # below the axis
        ["--kappa1", "0:1.1:8", "--kappa2", "0:1.1:8", "--n-max", "1"],
    ],
)
def test_unusual_planes_end_with_a_figure(tmp_path, plane):
    rays = [*RAYS, "--angles", "3"]
    output = succeed(critical_boundary, tmp_path / "out", *QUICK, "--levels", "2", *rays, *plane)
    assert (tmp_path / "out/critical_boundary.png").exists()
    assert ("no ray passes into transport" in output) == (plane[1] != "-1.1:1.1:16")


@pytest.mark.parametrize("workflow", ["escape_plane", "critical_boundary"])
def test_help_comes_at_once_and_names_every_option(workflow):
    command = [sys.executable, "-X", "importtime", "-m", f"workflows.{workflow}", "--help"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    for option in ("--kappa1", "--n-max", "--n-orbits", "--tile", "--out", "--scheduler"):
        assert option in run.stdout
    assert "numba" not in run.stderr
    assert "xarray" not in run.stderr


def test_circle_boundaries_are_those_of_each_ray(tmp_path):
    omegas = ["--omega", "gamma", "--omega", "2gamma", "--omega", "3/5"]
    succeed(circle_boundaries, tmp_path / "out", "--angles", "5", *RAYS, *omegas)
    cube = xr.open_zarr(tmp_path / "out/cubes.zarr", group="breakdown_residue")
    exact = cube.omega.attrs["exact"]
    assert exact == ["[0;1,1,2]", "[0;(1)]", "[1;(4)]"]
    assert cube.angle.values.tolist() == [0, 45, 90, 135, 180]
    scale = cube.critical_scale.sel(omega=float(parse("gamma")))
    assert scale.sel(angle=[0, 90, 180]).values == pytest.approx(KAPPA_G / 2, abs=1e-9)
    diagonal = cube.critical_scale.sel(omega=float(parse("2gamma")), angle=45)
    assert float(diagonal) == pytest.approx(KAPPA_G * 2**0.5, abs=1e-9)
    for i, text in enumerate(exact):
        for angle, profile in ((0, (1, 0)), (90, (0, 1))):
            expected = periodic.critical_scale(parse(text), profile)
            here = cube.isel(omega=i).sel(angle=angle)
            np.testing.assert_equal(float(here.critical_scale), expected.value)
            meanings = cube.status.attrs["flag_meanings"].split()
            assert meanings[int(here.status)] == expected.status.name.lower()
    circles = xr.open_zarr(tmp_path / "out/cubes.zarr", group="breakdown")
    known = circles.isel(omega=[1, 2])
    difference = abs(known.critical_scale - cube.isel(omega=[1, 2]).critical_scale)
    assert (difference < known.error).where(cube.status.isel(omega=[1, 2]) == 1).all()
    assert (known.lower < known.critical_scale).all()
    assert np.isnan(circles.critical_scale.isel(omega=0)).all()
    assert len(table(tmp_path / "out/circle_boundaries.csv")) == 3 * 5
    rows = table(tmp_path / "out/circle_boundaries_residue.csv")
    # In the order of the cube: 3/5, the golden mean, and 2γ on five rays each.
    assert [r["status"] for r in rows] == [meanings[int(i)] for i in cube.status.values.ravel()]
    assert {r["status"] for r in rows[:5]} == {"rational"}
    assert {r["status"] for r in rows[5:10]} == {"ok"}
    assert (tmp_path / "out/circle_boundaries.png").exists()
    assert (tmp_path / "out/tips.png").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--omega", "golden"], "is not a rotation number"),
        (["--omega", "gamma", "--omega", "[0;(1)]"], "two rotation numbers are equal"),
        (["--angles", "1"], "2<=x<=1000000"),
        (["--q-max", "3"], "10<=x<=1000000"),
    ],
)
def test_bad_rotation_numbers_are_refused(tmp_path, options, message):
    result = invoke(circle_boundaries, tmp_path / "out", *options)
    assert result.exit_code == 2
    assert message in result.output
    assert not (tmp_path / "out").exists()


def test_rotating_maps_are_kept_as_labelled_cubes(tmp_path):
    out = tmp_path / "out"
    effort = ["--angles", "3", "--tips", "0", "--n-max", "1000", "--n-orbits", "64"]
    vectors = ["--vector", "81/149,125/149", "--vector", "44/81,68/81"]
    succeed(rotating, out, *effort, *vectors)
    tori = xr.open_zarr(out / "cubes.zarr", group="rotating_tori")
    assert tori.critical_scale.dims == ("frequency", "angle")
    assert tori.frequency.attrs["exact"] == ["125/149", "68/81"]
    expected = periodic.torus_scale("81/149", "125/149", 0.0, 1.0)
    cell = tori.sel(angle=90).isel(frequency=0)
    assert float(cell.critical_scale) == float(cell.kappa_amplitude) == expected.value
    assert float(cell.kappa_mean) == 0.0
    transport = xr.open_zarr(out / "cubes.zarr", group="rotating_transport")
    # κ̄ alone is the standard map; Δκ alone with Ω = 1/2 is (κ, -κ).
    direct = escape.critical_scale((1.0, 1.0), 1000, 64).upper
    assert float(transport.upper.sel(frequency=0.5, angle=0)) == direct
    rows = table(out / "tori.csv")
    assert len(rows) == 2 * 5
    # At 45° the second kick is off, and CB_gt is where the standard map breaks at 2·κ1 = κ_G.
    (row,) = [r for r in rows if r["angle"] == "45" and float(r["frequency"]) > 0.8393]
    two = KAPPA_G / 2 / 2**0.5
    assert float(row["ratio"]) == pytest.approx(float(row["critical_scale"]) / two, rel=1e-6)
    assert float(row["ratio_direct"]) < float(row["ratio"])
    for name in ("diamond", "tori"):
        assert (out / f"{name}.png").exists()
        assert "Δκ" in (out / f"{name}.txt").read_text()


@pytest.mark.parametrize(
    ("workflow", "options", "told"),
    [
        (rotating, ["--vector", "1/3"], "must be two fractions"),
        (rotating, ["--vector", "1/0,1/3"], "must be two fractions"),
        (rotating, ["--vector", "1/3,2"], "must be two fractions"),
        (rotating, ["--vector", "1/3,2/5", "--vector", "1/5,4/10"], "frequencies are equal"),
        (three_kicks, ["--phase", "a third"], "must be a fraction from 0 to below 1"),
        (three_kicks, ["--phase", "1/0"], "must be a fraction from 0 to below 1"),
        (three_kicks, ["--phase", "1"], "must be a fraction from 0 to below 1"),
        (three_kicks, ["--phase", "1/2", "--phase", "2/4"], "two phases are equal"),
        (three_kicks, ["--n-max", "29"], "30<=x<=100000"),
    ],
)
def test_bad_rotation_vectors_and_phases_are_refused(tmp_path, workflow, options, told):
    result = invoke(workflow, tmp_path / "out", *options)
    assert result.exit_code == 2
    assert told in result.output
    assert not (tmp_path / "out").exists()


def test_three_kicks_are_kept_as_a_labelled_cube(tmp_path):
    out = tmp_path / "out"
    rays = ["--angles", "3", "--tips", "0", "--n-max", "30"]
    succeed(three_kicks, out, *rays, "--phase", "1/24", "--phase", "0")
    cube = xr.open_zarr(out / "cubes.zarr", group="three_kicks")
    assert cube.critical_scale.dims == ("phase", "angle")
    assert cube.phase.attrs["exact"] == ["0", "1/24"]
    assert cube.angle.values.tolist() == [0, 45, 90, 135, 180]
    profile = rotating_forcing(0.0, 1.0, "1/3", 1 / 24)
    expected = transversals.critical_scale(profile, 30)
    assert float(cube.upper.sel(angle=90)[1]) == expected.upper
    # κ̄ alone is the standard map, for any phase and number of kicks.
    still = cube.sel(angle=0)
    assert (abs(still.critical_scale - KAPPA_G) < still.error).all()
    rows = table(out / "three_kicks.csv")
    assert len(rows) == 2 * 5
    for r in rows:
        if r["angle"] == "180":
            assert abs(float(r["ratio"]) - 1) < float(r["error"]) / float(r["critical_scale"])
    assert "φ0 = 1/24: " in (out / "three_kicks.txt").read_text()
    assert (out / "three_kicks.pdf").exists()


def test_stretches_are_where_the_ratio_is_above_one():
    angle = np.array([0.0, 10, 20, 30, 40, 50])
    first, second = stretches(angle, np.array([1.5, 1.2, 0.8, 0.9, 1.1, np.nan]))
    assert (first.start, first.end, first.peak, first.peak_angle) == (0, pytest.approx(15), 1.5, 0)
    assert (second.start, second.end) == (pytest.approx(35), 40)
    assert str(second) == "35.0°-40.0° (by 10% at 40.0°)"
    assert stretches(angle, np.full(6, 0.99)) == []
    inside = np.array([0.9, 0.95, np.nan, 0.97, 0.9, 0.8])
    assert where_above(angle, inside) == "nowhere (nearest, 0.970 of it, at 30.0°)"


def test_the_last_barrier_is_kept_as_a_labelled_cube(tmp_path):
    out = tmp_path / "out"
    succeed(last_barrier, out, "--angles", "4", "--tips", "1", "--tol", "0.001")
    cube = xr.open_zarr(out / "cubes.zarr", group="barrier")
    # Rays at 0, 60, 120 and 180 degrees, on the cusps and two degrees from them, in the wedge.
    assert cube.angle.values.tolist() == [0, 30, 43, 45]
    assert cube.quotients.dims == ("quotient", "angle")
    expected = barriers.critical_scale((np.cos(np.pi / 6), np.sin(np.pi / 6)), 1e-3)
    here = cube.isel(angle=1)
    for name in ("value", "error", "lower", "upper"):
        there = "critical_scale" if name == "value" else name
        assert float(here[there]) == pytest.approx(getattr(expected, name), rel=1e-14)
    assert float(here.omega) == float(expected.omega)
    rows = table(out / "last_barrier.csv")
    assert [float(r["angle"]) for r in rows] == [0, 43, 45, 47, 60, 120, 133, 135, 137, 180]
    assert parse(rows[4]["circle"]) == expected.omega
    # Its mirror image: 1 - ω.
    assert rows[5]["circle"] == "[0;3,(1)]"


def test_period_one_orbits_are_kept_as_labelled_cubes(tmp_path):
    axes = ["--primary", "-4:4:20", "--secondary", "0:8:10"]
    for _ in range(2):  # a second run says the same
        assert invoke(period_one, tmp_path / "out", *axes).exit_code == 0
    primary = xr.open_zarr(tmp_path / "out/cubes.zarr", group="period_one_primary")
    assert primary.residue.dims == ("point", "kappa2", "kappa1")
    cell = primary.residue.sel(kappa1=0.6, kappa2=1.0, method="nearest").isel(point=1)
    kappa1, kappa2 = float(cell.kappa1), float(cell.kappa2)
    assert float(cell) == pytest.approx((kappa1 + kappa2) / 2 - kappa1 * kappa2 / 4)
    secondary = xr.open_zarr(tmp_path / "out/cubes.zarr", group="period_one_secondary")
    assert 0 < np.isfinite(secondary.z).mean() < 1
    assert invoke(period_one, tmp_path / "out", "--primary", "-3:3:20").exit_code == 2


RECIPES = Path(__file__).parents[1] / "workflows" / "recipes"


def follow_recipe(name, tmp_path, monkeypatch, capsys, *arguments):
    """Run a recipe as a script in an empty directory; returns what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    runpy.run_path(str(RECIPES / f"{name}.py"))
    assert not [path for path in tmp_path.iterdir() if path.is_file()]  # all goes to OUT
    return capsys.readouterr().out


def test_every_recipe_is_tested():
    tested = set(re.findall(r'follow_recipe\(\s*"(\w+)"', Path(__file__).read_text()))
    assert tested == {path.stem for path in RECIPES.glob("*.py")}


@pytest.mark.parametrize("recipe", sorted(RECIPES.glob("*.py")), ids=lambda path: path.stem)
def test_a_recipe_without_a_store_tells_its_usage(recipe, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=None))
    mistakes = [[], [tmp_path], [tmp_path, tmp_path]] if recipe.stem != "job_queue" else [[]]
    for arguments in mistakes:
        monkeypatch.setattr(sys, "argv", [recipe.name, *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(recipe))
        assert ended.value.code == 2
        assert f"python workflows/recipes/{recipe.name} " in capsys.readouterr().err
    assert not os.listdir(tmp_path)


def test_comparing_one_store_with_none_tells_the_usage(finished, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["compare_stores.py", str(finished)])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(RECIPES / "compare_stores.py"))
    assert ended.value.code == 2
    assert "OUT OTHER" in capsys.readouterr().err


def test_recipe_select_steps(finished, tmp_path, monkeypatch, capsys):
    said = follow_recipe("select_steps", tmp_path, monkeypatch, capsys, finished, 1000)
    assert f"{100 * (field(finished) <= 1000).mean():.1f}% of the" in said
    assert (finished / "select_steps.png").exists()


def test_recipe_contour_boundary(finished, tmp_path, monkeypatch, capsys):
    follow_recipe("contour_boundary", tmp_path, monkeypatch, capsys, finished)
    points = np.array(
        [[r["kappa1"], r["kappa2"]] for r in table(finished / "contour_boundary.csv")]
    )
    radius = np.hypot(*points.astype(float).T)
    # Outside the last barrier, all of it, and within the direct boundary of the table.
    assert radius.min() > KAPPA_G / 2
    direct = [float(r["critical_scale"] or 0) for r in table(finished / "direct_boundary.csv")]
    assert radius.max() < max(direct) + 0.1


def test_recipe_compare_stores(finished, dense, tmp_path, monkeypatch, capsys):
    said = follow_recipe("compare_stores", tmp_path, monkeypatch, capsys, finished, dense)
    differ = ((field(finished) <= 4000) != (field(dense) <= 4000)).sum()
    assert f"8192 cells in both; {differ} of them answer differently" in said
    assert "levels: 3 and None" in said


def test_recipe_join_levels(finished, tmp_path, monkeypatch, capsys):
    said = follow_recipe("join_levels", tmp_path, monkeypatch, capsys, finished)
    assert "equal to the cube escape: True" in said
    rows = table(finished / "join_levels.csv")
    assert {r["level"] for r in rows} == {"0", "1", "2"}


@pytest.mark.parametrize(
    ("group", "name"),
    [("barrier", "upper"), ("breakdown", "critical_scale"), ("escape", "escape_time")],
)
def test_recipe_export(finished, tmp_path, monkeypatch, capsys, group, name):
    said = follow_recipe("export", tmp_path, monkeypatch, capsys, finished, group)
    assert "read back equal: True" in said
    rows = table(finished / f"{group}.csv")
    exported = [float(r[name] or "nan") for r in rows]
    kept = xr.open_zarr(finished / "cubes.zarr", group=group)[name]
    assert np.array_equal(np.sort(exported), np.sort(kept.values.ravel()), equal_nan=True)
    assert {r["status"] for r in rows if "status" in r} == (set() if group == "escape" else {"ok"})


def test_recipe_large_field(finished, tmp_path, monkeypatch, capsys):
    said = follow_recipe("large_field", tmp_path, monkeypatch, capsys, finished)
    assert f"{(field(finished) <= 4000).mean():.6f}" in said


@pytest.mark.slow
def test_recipe_job_queue(tmp_path, monkeypatch, capsys):
    asked = {}

    class Queue(LocalCluster):
        """Stands in for the queue: its jobs are processes here."""

        def __init__(self, **job):
            asked.update(job)
            here = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
            super().__init__(n_workers=0, threads_per_worker=1, **here)

        def adapt(self, minimum_jobs, maximum_jobs):
            assert minimum_jobs == maximum_jobs
            super().adapt(minimum=1, maximum=1)

    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=Queue))
    monkeypatch.setenv("PYTHONPATH", str(RECIPES.parents[1]))
    arguments = ["escape_plane", "--out", tmp_path / "out", *QUICK]
    plane = ["--kappa1", "0:1:8", "--kappa2", "0:1:8"]
    follow_recipe("job_queue", tmp_path, monkeypatch, capsys, *arguments, *plane)
    assert np.isfinite(xr.open_zarr(tmp_path / "out/cubes.zarr", group="escape").cpu_seconds).all()
    assert asked["cores"] == asked["processes"]
    options = dict(zip(*[iter(asked["worker_extra_args"])] * 2, strict=True))
    hours, rest, _ = map(int, asked["walltime"].split(":"))
    lifetimes = options["--lifetime"], options["--lifetime-stagger"]
    longest = sum(int(minutes.removesuffix("m")) for minutes in lifetimes)
    assert longest < 60 * hours + rest


def test_the_flux_beyond_the_breakup_is_kept_with_its_law(tmp_path):
    out = tmp_path / "out"
    succeed(flux, out, "--angle", "0", "--nearest", "1e-3")
    cube = xr.open_zarr(out / "cubes.zarr", group="flux")
    assert cube.flux.dims == ("angle", "excess")
    assert (cube.status == 1).all()
    first = cube.isel(angle=0, excess=0)
    kappa = (KAPPA_G / 2 * (1 + float(first.excess)), 0.0)
    assert float(first.flux) == pytest.approx(nasm_flux.flux(parse("gamma"), kappa).value, rel=1e-6)
    (law,) = table(out / "flux_law.csv")
    assert float(law["exponent"]) == pytest.approx(3.0117, abs=1e-3)
    assert "3.0117" in (out / "flux.txt").read_text()
    assert (out / "flux.png").exists()


@pytest.mark.parametrize(
    "options", [["--angle", "200"], ["--angle", "x"], ["--nearest", "0"], ["--q-max", "3"]]
)
def test_bad_options_of_the_flux_are_refused(tmp_path, options):
    result = invoke(flux, tmp_path / "out", *options)
    assert result.exit_code == 2
    assert not (tmp_path / "out").exists()


DIRECT = ["--angles", "5", "--tips", "0", "--n-orbits", "64", "--steps", "400,4000"]


@pytest.fixture(scope="module")
def direct(tmp_path_factory):
    """The boundary by direct iteration on five rays: its directory."""
    out = tmp_path_factory.mktemp("direct") / "out"
    output = succeed(direct_boundary, out, *DIRECT)
    for name in ("direct_boundary.png", "direct_quadrant.pdf", "direct_boundary_rays.csv"):
        assert (out / name).exists()
    assert f"{out}/direct_boundary.png" in output
    return out


def test_direct_iteration_closes_in_on_the_boundary_from_outside(direct):
    rows = table(direct / "direct_boundary_rays.csv")
    assert [(int(r["n"]), float(r["angle"])) for r in rows] == [
        (n, angle) for n in (400, 4000) for angle in (0, 45, 90, 135, 180)
    ]
    barrier = xr.open_zarr(direct / "cubes.zarr", group="barrier").load()
    scale = {(r["n"], float(r["angle"])): float(r["critical_scale"]) for r in rows}
    for angle in (0, 45, 90, 135, 180):
        upper = float(barrier.upper.sel(angle=0 if angle % 90 == 0 else 45))
        assert upper < scale["4000", angle] < scale["400", angle] < 2.01 * upper
    cube = xr.open_zarr(direct / "cubes.zarr", group="direct_boundary").load()
    for r in rows:
        n, angle = int(r["n"]), float(r["angle"])
        breakup = cube.attrs["critical_scales"][str(angle)] * symmetries.ray(angle)
        i = np.abs(cube.excess.values - float(r["bias"])).argmin()
        kappas = breakup * (1 + cube.excess.values[i - 1 : i + 1, None])
        assert (float(r["kappa1"]), float(r["kappa2"])) == pytest.approx(kappas[1], rel=1e-5)
        inside, outside = escape.first_escape(kappas, *escape.ensemble(64), [64], 4000)[0]
        assert outside <= n < inside


def test_no_more_is_iterated_than_the_boundary_needs(direct):
    cube = xr.open_zarr(direct / "cubes.zarr", group="direct_boundary")
    times = cube.escape_time.isel(ensemble=0)
    assert (np.isinf(times).sum("excess") == 1).all()
    assert (times.isel(excess=slice(0, 5)).isnull()).all()
    before = {p: p.stat().st_mtime_ns for p in (direct / "cubes.zarr").rglob("c/*/*/*")}
    succeed(direct_boundary, direct, *DIRECT)
    assert before == {p: p.stat().st_mtime_ns for p in (direct / "cubes.zarr").rglob("c/*/*/*")}
    result = invoke(direct_boundary, direct, *DIRECT, "--n-orbits", "65", *WORKERS)
    assert result.exit_code == 2
    assert "the values of ensemble differ" in result.output


def test_the_orbit_of_an_inset_stays_where_a_circle_is_left(direct):
    insets = xr.open_zarr(direct / "cubes.zarr", group="direct_insets").load()
    assert (insets.visits.sum(("x", "y")) == 3_000_001).all()
    span = (insets.highest - insets.lowest).values
    inside, outside = (verdict(kappa).answer for kappa in direct_boundary.INSETS[:2])
    assert (inside, outside) == (Answer.BARRIER, Answer.TRANSPORT)
    # Between a circle and its copy one cell further, of amplitudes below 0.2; or not.
    assert span[0] < 1.2 < span[1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--steps", "100,10"], "increasing whole numbers from 1"),
        (["--steps", "0"], "increasing whole numbers from 1"),
        (["--n-orbits", "0"], "1<=x<=100000000"),
        (["--angles", "1"], "2<=x<=1000000"),
    ],
)
def test_bad_efforts_are_refused(tmp_path, options, message):
    result = invoke(direct_boundary, tmp_path / "out", *options)
    assert result.exit_code == 2
    assert message in result.output
    assert not (tmp_path / "out").exists()
