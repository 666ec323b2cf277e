"""The Python examples in pipeline/README.md run as printed, and do what they claim."""

import re
import runpy
from contextlib import chdir, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr

import nasm
import pipeline

ROOT = Path(__file__).parents[1]
README = (ROOT / "pipeline/README.md").read_text(encoding="utf-8")


def page(heading):
    """Return the code below a heading."""
    (text,) = re.findall(rf"^##+ {heading}\n.*?```python\n(.*?)```", README, re.S | re.M)
    return text


@pytest.fixture
def run(here, tmp_path, monkeypatch):
    """Return a function that runs an example as a script and returns the printed output.

    The script runs in its own folder, on existing workers.
    """
    fill = pipeline.fill
    monkeypatch.setattr(pipeline, "fill", lambda job, out, workers: fill(job, out, here()))

    def run(text):
        (tmp_path / "page.py").write_text(text, encoding="utf-8")
        with chdir(tmp_path), redirect_stdout(StringIO()) as output:
            runpy.run_path(str(tmp_path / "page.py"), run_name="__main__")
        return output.getvalue()

    return run


def overlap_of(kappa1, kappa2):
    """Return Chirikov's overlap for two kicks, computed from its formula."""
    mean, half_difference = abs(kappa1 + kappa2) / 2, abs(kappa1 - kappa2) / 2
    return 2 * (mean**0.5 + half_difference**0.5) / np.pi


def test_the_example_of_a_user_function_fills_a_cube_with_its_values(run, tmp_path):
    text = page("A function of your own")
    assert len([line for line in text.splitlines() if line.strip()]) <= 15
    output = run(text)
    cube = xr.open_zarr(tmp_path / "out/overlap/overlap.zarr").load()
    expected = overlap_of(cube.kappa1, cube.kappa2)
    np.testing.assert_allclose(cube.overlap, expected.transpose(*cube.overlap.dims), rtol=1e-12)
    assert cube.overlap.long_name.startswith("Overlap of neighbouring resonances")
    assert f"overlap in {float((cube.overlap > 1).mean()):.0%} of" in output


def test_the_example_resumes_but_refuses_a_changed_function(run, tmp_path):
    text = page("A function of your own")
    message = run(text)
    records = (tmp_path / "out/overlap/overlap.zarr/tiles/commit/c/0").rglob("[0-9]*")
    times = {path: path.stat().st_mtime_ns for path in records if path.is_file()}
    lost = min(times)
    lost.unlink()
    assert run(text.replace("    widths", "    # of the resonances\n    widths")) == message
    assert [path for path in times if path.stat().st_mtime_ns != times[path]] == [lost]
    with pytest.raises(pipeline.Refused, match="function is overlap"):
        run(text.replace("/ np.pi", "/ 3.14"))


def test_the_example_of_a_labelled_array_agrees_with_critical_scale():
    names = {}
    with redirect_stdout(StringIO()):
        exec(page("A labelled array of your own"), names)
    scales = names["scales"]
    assert set(scales.data_vars) == {"value", "error", "lower", "upper", "status"}
    for ripple in scales.ripple.values:
        row, scale = scales.sel(ripple=ripple), nasm.critical_scale((1 + ripple, 1 - ripple), 1e-2)
        assert (row.value, row.lower, row.upper) == (scale.value, scale.lower, scale.upper)
        assert row.status == scale.status.name == "OK"


def test_the_first_example_fills_a_cube(run, tmp_path):
    run(page("From Python"))
    cube = xr.open_zarr(tmp_path / "out/rays/barrier.zarr")
    assert cube.critical_scale[0] == pytest.approx(0.485817703, rel=1e-6)


def test_the_example_that_reads_a_cube_selects_by_status(run, tmp_path, monkeypatch):
    run(page("From Python"))
    path = tmp_path / "out/rays/barrier.zarr"
    history = xr.open_zarr(path).attrs["history"]
    call = "pipeline.fill(pipeline.last_barrier([0, 15, 30, 45], tol=0.001), 'out/rays')"
    assert history == f"{xr.open_zarr(path).attrs['created']} {call}"
    monkeypatch.chdir(tmp_path)
    code = zarr.open_array(path / "status", mode="r+")
    code[1] = 11  # 11 means undecided; each chunk of this cube is one tile
    names = {}
    with redirect_stdout(StringIO()) as output:
        exec(page("Reading a cube"), names)
    assert names["barrier"].status.values.tolist() == [1, 11, 1, 1]
    assert names["answers"].angle.values.tolist() == [0, 30, 45]
    assert names["answers"].status.dtype == "int8"
    assert names["scales"].isnull().values.tolist() == [False, True, False, False]
    seconds = xr.open_zarr(path, group="tiles").commit[0].values
    assert names["seconds"].values.tolist() == seconds.tolist()
    assert (seconds > 0).all()
    assert output.getvalue()


@pytest.mark.slow
def test_the_object_store_example_opens_a_cube(bucket, here):
    job = pipeline.escape("two-kicks", "0:1:8", "0:1:8", n_max=100, n_orbits=(8,))
    filled = pipeline.fill(job, str(bucket), here())
    path = bucket.cube("escape").removeprefix("s3://cubes/")
    names = {}
    text = page("Object stores").replace('"BUCKET"', '"cubes"')
    exec(text.replace("PREFIX/escape.zarr", path), names)
    np.testing.assert_array_equal(names["cube"].escape_time, filled.escape_time)


def test_a_job_records_the_call_that_made_it():
    job = pipeline.escape("two-kicks", "0:1:8", second="0:1:6", n_max=100, n_orbits=(8, 16))
    assert job.call == (
        "pipeline.escape('two-kicks', '0:1:8', second='0:1:6', n_max=100, n_orbits=(8, 16))"
    )
    rays = pipeline.transport(np.arange(90.0), plane=nasm.planes.two_kicks())
    assert re.fullmatch(
        r"pipeline\.transport\(\[0\.0, 1\.0, .*… \(\d+ characters\), plane=<Plane>\)", rays.call
    )
    length = pipeline.over_plane(overlap_of, "two-kicks", "0:1:8", "0:1:6", {"n": "a number"})
    assert length.call.startswith("pipeline.over_plane(overlap_of, 'two-kicks', ")


def test_the_table_lists_all_functions_that_make_jobs():
    table = set(re.findall(r"^\| `pipeline\.(\w+)\(", README, re.M))
    names = {name: getattr(pipeline, name) for name in dir(pipeline)}
    assert table == {k for k, v in names.items() if getattr(v, "__module__", "") == "pipeline.jobs"}
