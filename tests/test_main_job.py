"""The examples, and a small run of the main job, in which three methods bracket the boundary."""

import json
import os
import re
import runpy
import shutil
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
import toy
import xarray as xr
from cases import thirds
from click.testing import CliRunner
from commands import invoke, snapshot, succeed, table
from oracles import KAPPA_G

from nasm.numbers import parse
from pipeline.sweep.progress import plural
from workflows.shared.cli import main_of

QUICK = ["--n-max", "4000", "--n-orbits", "16,64", "--tile", "4"]
PLANE = ["--first", "-1.4:1.4:64", "--second", "0:1.4:32"]
RAYS = ["--n-cusp-rays", "0", "--tol", "0.01"]
FILES = "critical_boundary.csv", "critical_boundary.png"
MAIN = [*QUICK, *PLANE, *RAYS, "--levels", "3", "--n-rays", "13"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory, workers):
    """Return the directory of a small run of the main job."""
    out = tmp_path_factory.mktemp("main") / "out/critical_boundary"
    output = succeed("critical_boundary", out, *MAIN, *workers)
    assert re.search(r"sweep \d of 5, \w+", output)  # which sweeps are shown depends on the load
    for name in ("escape.zarr", "barrier.zarr", "boundary.zarr", *FILES):
        assert f"{out}/{name}" in output
        assert (out / name).exists()
    return out


@pytest.fixture(scope="module")
def dense(tmp_path_factory, workers):
    """Return the directory of a run on the same plane with every cell computed."""
    out = tmp_path_factory.mktemp("dense") / "out"
    succeed("escape_plane", out, *QUICK, *PLANE, "--precision", "single", *workers)
    assert (out / "escape_plane.png").exists()
    return out


def test_a_dry_run_predicts_the_run_and_writes_nothing(finished, tmp_path):
    output = succeed("critical_boundary", tmp_path / "out", *MAIN, "--dry-run")
    assert not (tmp_path / "out").exists()
    printed = {line.split()[0]: line.split()[1::2] for line in output.splitlines()}
    *sweeps, _ = printed
    assert sweeps == ["barrier", "breakdown", *(f"escape_level{i}" for i in range(3))]
    status = succeed("status", finished)
    assert "escape: complete\n" in status
    for name in sweeps:
        tiles = int((xr.open_zarr(finished / f"{name}.zarr", group="tiles").commit[0] > 0).sum())
        assert f"{name}: {tiles} of {plural(tiles, 'tile')}\n" in status
        if name.startswith("escape_level") and name[-1] != "0":  # tiles depend on earlier levels
            assert tiles / 2 < int(printed[name][0]) < 2 * tiles
        else:
            assert int(printed[name][0]) == tiles
    chunks = [
        *(finished / "breakdown.zarr").glob("*/c/*/*"),
        *(finished / "breakdown.zarr").glob("tiles/commit/c/*/*/*"),
    ]
    assert int(printed["breakdown"][1]) == len(chunks)
    again = succeed("critical_boundary", finished, *MAIN, "--dry-run")
    assert {float(line[24:33]) for line in again.splitlines()} == {0}
    out = shutil.copytree(finished, tmp_path / "copy")
    next((out / "escape_level0.zarr/tiles/commit/c").rglob("[0-9]*/[0-9]*/[0-9]*")).unlink()
    again = succeed("critical_boundary", out, *MAIN, "--dry-run")
    assert {line[24:33].strip() for line in again.splitlines() if "level0" in line} == {"1"}


def field(out):
    return xr.open_zarr(out / "escape.zarr", chunks=None).escape_time.isel(ensemble=-1).values


def test_refinement_finds_the_boundary_of_the_full_grid(finished, dense):
    refined = xr.open_zarr(finished / "escape.zarr")
    assert set(np.unique(refined.level)) == {0, 1, 2}
    differ = (field(finished) <= 4000) != (field(dense) <= 4000)
    assert differ.mean() < 0.002
    finest = refined.level.values == 2
    assert np.array_equal(field(finished)[finest], field(dense)[finest])
    assert 0.1 < finest.mean() < 0.9


def test_the_table_from_direct_iteration_contains_the_boundary_along_rays(finished):
    rows = table(finished / "critical_boundary_direct.csv")
    assert len(rows) == 13
    assert {r["n"] for r in rows} == {"4000"}
    assert {float(r["resolution"]) for r in rows if r["resolution"]} == {2.8 / 64}
    ends = {r["angle"]: (r["kappa1"], r["kappa2"]) for r in rows}
    scale = {r["angle"]: r["critical_scale"] for r in rows}
    assert ends["0"] == (scale["0"], "0")
    assert ends["90"] == ("0", scale["90"])
    assert ends["180"] == (f"-{scale['180']}", "0")
    assert ends["45"][0] == ends["45"][1]


def test_every_row_brackets_the_boundary_and_names_the_last_circle(finished):
    rows = table(finished / "critical_boundary.csv")
    assert [float(r["angle"]) for r in rows] == list(range(0, 181, 15))
    for r in rows:
        assert r["status"] == "ok"
        value, lower, upper = (float(r[key]) for key in ("critical_scale", "lower", "upper"))
        assert lower < value < upper
        assert upper - lower < 0.0101 * value
        assert float(parse(r["circle"])) == pytest.approx(float(r["omega"]), abs=1e-11)
    # On the axes the golden circle breaks at κ_G/2; on the diagonal the circle of 2γ breaks at
    # (κ_G, κ_G).
    scale = {int(float(r["angle"])): float(r["critical_scale"]) for r in rows}
    for angle, exact in ((0, KAPPA_G / 2), (45, KAPPA_G * 2**0.5), (90, KAPPA_G / 2)):
        assert scale[angle] == pytest.approx(exact, abs=1e-10)
    for angle in range(0, 45, 15):
        assert len({scale[a] for a in (angle, 90 - angle, 90 + angle, 180 - angle)}) == 1
    circles = {int(float(r["angle"])): r["circle"] for r in rows}
    assert (circles[45], circles[135]) == ("[0;1,3,(4)]", "[0;(4)]")
    assert circles[30] == circles[60] == "[0;1,2,(1)]"
    assert circles[120] == circles[150] == "[0;3,(1)]"
    boundary = xr.open_zarr(finished / "boundary.zarr").load()
    assert boundary.circle.values.tolist() == [r["circle"] for r in rows]


def test_the_scales_of_the_three_methods_are_in_the_expected_order(finished):
    # Other circles break before the last one, and orbits escape only beyond its breakup.
    last = {r["angle"]: r for r in table(finished / "critical_boundary.csv")}
    for r in table(finished / "critical_boundary_circles.csv"):
        assert float(r["critical_scale"]) - float(r["error"]) < float(last[r["angle"]]["upper"])
    for r in table(finished / "critical_boundary_direct.csv"):
        assert float(last[r["angle"]]["critical_scale"]) < float(r["critical_scale"])


@pytest.mark.parametrize(
    ("other", "difference"),
    [
        (["--n-max", "5000"], "n_max is 4000, not 5000"),
        (["--follow", "300"], "follow is [4000], not [300]"),
        (["--plane", "rotating:1/2"], "plane is two-kicks, not rotating:1/2; plane_hash is"),
    ],
)
def test_different_settings_are_refused_and_no_file_is_changed(finished, other, difference):
    before = snapshot(finished)
    result = invoke("critical_boundary", finished, *MAIN, *other)
    assert result.exit_code == 2
    assert difference in result.output
    assert snapshot(finished) == before


def test_status_and_verify_confirm_sound_cubes_and_locate_damage(tmp_path, workers):
    out = tmp_path / "out"
    plane = ["escape_plane", out, *QUICK, "--first", "0:1:8", "--second", "0:1:8", *workers]
    succeed(*plane)
    assert "escape: 4 of 4 tiles\n" in succeed("status", out)
    assert "escape: sound" in succeed("verify", out)
    whole, chunk = field(out), out / "escape.zarr/escape_time/c/0/0/1"
    chunk.write_bytes(bytes([chunk.read_bytes()[0] ^ 1]) + chunk.read_bytes()[1:])
    result = invoke("verify", out)
    assert result.exit_code == 1
    assert "tile (0, 1): escape_time does not match its checksum" in result.output
    assert invoke("verify", out, "--repair").exit_code == 0
    assert "escape: 3 of 4 tiles" in succeed("status", out)
    succeed(*plane)
    assert np.array_equal(field(out), whole)
    for name in ("status", "verify"):
        assert invoke(name, tmp_path / "nowhere").exit_code == 2
        empty = invoke(name, out / "escape.zarr/escape_time")
        assert (empty.exit_code, "holds no cubes" in empty.output) == (2, True)


def test_status_and_verify_cover_every_run_in_a_folder(tmp_path, dense, monkeypatch):
    for path in ("out/one", "out/several/two"):
        shutil.copytree(dense, tmp_path / path)
    monkeypatch.chdir(tmp_path)
    for name, words in {"status": "128 of 128 tiles", "verify": "sound"}.items():
        result = CliRunner().invoke(main_of(name), ["--repair"] * (name == "verify"))
        assert result.output == f"one/escape: {words}\nseveral/two/escape: {words}\n"
    (tmp_path / "out/one/escape.zarr/escape_time/c/0/0/1").unlink()
    result = CliRunner().invoke(main_of("verify"))
    assert (result.exit_code, "one/escape: 1 tile damaged\n" in result.output) == (1, True)


UNUSUAL = {
    "nothing escapes": "--first 0:0.1:8 --second 0:0.1:8",
    "below the axis": "--first -1.1:1.1:16 --second -1.1:0:8",
    "everything escapes": "--first 3:3.1:8 --second 3:3.1:8",
    "one step": "--first 0:1.1:8 --second 0:1.1:8 --n-max 1",
}


@pytest.mark.parametrize("plane", thirds(UNUSUAL))
def test_runs_on_unusual_planes_still_produce_a_figure(tmp_path, finished, workers, plane):
    for name in ("barrier.zarr", "breakdown.zarr"):  # reused, because the rays are the same
        shutil.copytree(finished / name, tmp_path / "out" / name)
    options = [*MAIN, *plane.split(), "--levels", "2"]
    output = succeed("critical_boundary", tmp_path / "out", *options, *workers)
    assert (tmp_path / "out/critical_boundary.png").exists()
    assert ("no orbit escapes within" in output) == ("-1.1:0:8" not in plane)


EXAMPLES = Path(__file__).parents[1] / "workflows" / "examples"


def test_the_job_queue_example_without_a_command_prints_its_usage(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["job_queue"])
    with pytest.raises(SystemExit, match=r"python workflows/examples/job_queue.py "):
        runpy.run_path(str(EXAMPLES / "job_queue.py"))


@pytest.fixture
def notebook(finished, monkeypatch, capsys):
    """Return a function that runs a notebook next to `out` and returns its output and variables."""

    def run(name):
        written = json.loads((EXAMPLES / f"{name}.ipynb").read_text(encoding="utf-8"))
        assert (written["nbformat"], written["nbformat_minor"]) == (4, 5)
        assert len({cell["id"] for cell in written["cells"]}) == len(written["cells"])
        cells = [cell for cell in written["cells"] if cell["cell_type"] == "code"]
        outputs = [output for cell in cells for output in cell["outputs"]]
        assert any("image/png" in output.get("data", {}) for output in outputs)
        monkeypatch.chdir(finished.parents[1])  # notebooks read out/critical_boundary
        names = {}
        for cell in cells:
            exec("".join(cell["source"]), names)
        return capsys.readouterr().out, names

    return run


def test_the_boundary_notebook_leads_from_one_orbit_to_the_boundary(notebook):
    output, names = notebook("boundary")
    assert "Answer.BARRIER" in output
    assert "Answer.TRANSPORT" in output
    below, above = (
        list(map(float, re.search(rf"s = {scale}: (0.*)", output)[1].split(", ")))
        for scale in (1.0, 1.5)
    )
    assert below == sorted(below, reverse=True)
    assert above == sorted(above)
    scales = names["table"].critical_scale
    assert float(scales.sel(angle=0)) == pytest.approx(KAPPA_G / 2, abs=1e-9)
    assert names["x"].size == 100_001


def test_the_cubes_notebook_reports_the_numbers_in_the_cubes(finished, notebook):
    output, names = notebook("cubes")
    (row,) = table(finished / "critical_boundary.csv", angle="90")
    assert f"at 90°: {float(row['critical_scale']):.12f} ±" in output
    golden = table(finished / "critical_boundary.csv", circle="[0;(1)]")
    assert f"the last one on {len(golden)} rays" in output
    share = 100 * (field(finished) <= 4000).mean()
    assert f"transport within 4000 steps in {share:.1f}% of the cells" in output
    assert f"{(field(finished) <= 4000).mean():.6f}" in output  # computed block by block
    radius = np.hypot(*names["curves"].to_numpy().T)
    # The curves lie outside the last barrier, and inside the boundary found by direct iteration.
    assert radius.min() > KAPPA_G / 2
    direct = [
        float(r["critical_scale"] or 0) for r in table(finished / "critical_boundary_direct.csv")
    ]
    assert radius.max() < max(direct) + 0.1
    wide = field(finished).reshape(16, 2, 32, 2).min(axis=(1, 3)).repeat(2, 0).repeat(2, 1)
    differ = ((field(finished) <= 4000) != (wide <= 4000))[8:16, 32:48]
    assert f"{differ.size} cells in both; {differ.sum()} of them answer differently" in output
    for name in ("boundary", "escape"):
        kept = xr.open_zarr(finished / f"{name}.zarr", chunks=None)
        with xr.open_dataset(finished / f"{name}.nc", engine="scipy") as exported:
            assert all(exported[key].equals(kept[key]) for key in kept.data_vars)
        cells = kept.drop_dims("bound", errors="ignore").to_dataframe()
        assert len(table(finished / f"{name}.csv")) == len(cells)


QUEUE = {
    "sbatch": "cat > job; setsid bash job > log 2>&1 & echo $! > pid; echo 7",
    "scancel": "[ $1 = 7 ] && kill -- -$(cat pid)",
}


@pytest.mark.slow
def test_the_job_queue_example_ends_its_jobs_and_leaves_no_key_behind(tmp_path, monkeypatch):
    here = tmp_path / "queue"
    here.mkdir()
    for name, program in QUEUE.items():
        (here / name).write_text(f"#!/bin/bash\ncd {here}\n{program}\n")
        (here / name).chmod(0o700)
    monkeypatch.setenv("PATH", f"{here}:{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLES.parents[1]))
    edited = (EXAMPLES / "job_queue.py").read_text()
    for ours, theirs in {
        "nworkers 16": "nworkers 1",
        "ib0": "lo",
        "Path.home()": f"Path({str(here)!r})",
        "export NUMBA_CACHE_DIR": "unused",  # use the cache: compiling is slower than the sweep
    }.items():
        assert ours in edited
        edited = edited.replace(ours, theirs)
    (here / "job_queue.py").write_text(edited)
    plane = ["--first", "0:0.9:18", "--second", "0:0.9:18", "--tile", "2", "--n-max", "1000"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["job_queue", "escape_plane", "--out", "out", *plane])
    runpy.run_path(str(here / "job_queue.py"))
    assert {path.name for path in tmp_path.iterdir()} == {"out", "queue"}
    assert np.isfinite(xr.open_zarr(tmp_path / "out/escape.zarr", group="tiles").commit).all()
    assert not list(here.glob(".queue*"))
    toy.wait_until(lambda: not psutil.pid_exists(int((here / "pid").read_text())))
