"""Every command runs to completion or, if an extra is missing, says what to install."""

import json
import re
import subprocess
import sys
from pathlib import Path

import dask
import pytest
import xarray as xr
from commands import follow, succeed, table
from every_command import PROVING, SMALLEST

from nasm.planes import plane_of
from workflows.claims.rules import printed_texts
from workflows.gallery.__main__ import EXHIBITS, recipe
from workflows.shared.cli import commands, main_of
from workflows.shared.run import LONGEST

HERE = Path(__file__).parent
pytestmark = pytest.mark.slow


def test_all_commands_are_run():
    assert sorted(SMALLEST) == commands()


def run(out, names, runs, *hidden):
    script = [str(HERE / "every_command.py"), str(out), ",".join(names), str(runs), *hidden]
    script = [sys.executable, *script]
    ended = subprocess.run(script, stdout=subprocess.PIPE, text=True, check=True)
    result = json.loads(ended.stdout)
    assert list(result) == list(names)
    for name, (_, output, _, faults) in result.items():
        assert faults == [], name
        assert not re.search(r"\bnan\b|Traceback", output), f"{name}: {output}"
    return result


def test_no_command_takes_more_than_ten_minutes_on_two_cores_by_default(tmp_path):
    for name in commands():
        options = [option.opts[0] for option in main_of(name).params]
        if "--dry-run" in options:
            forcing = ["0.3", "0.2"] if name == "frequency_map" else []
            output = succeed(name, tmp_path / name, *forcing, "--dry-run")
            hours = float(re.search(r"in all .* (\S+) CPU hours", output)[1])
            assert hours * 3600 / (2 if "--workers" in options else 1) < LONGEST, output


def test_if_python_flint_is_missing_proving_commands_state_what_to_install(tmp_path):
    for name, (code, output, *_) in run(tmp_path / "out", PROVING, 1, "flint", "bokeh").items():
        assert code == (name != "work_precision"), f"{name}: {output}"
        assert code == 0 or "pip install 'nasm-transport[proof]'" in output
        assert code == 0 or not list((tmp_path / "out" / name).glob("*"))


def test_every_command_ends_as_expected_and_its_cubes_convert_to_netcdf(tmp_path):
    """Each command runs twice, and computes nothing the second time.

    Bokeh, which the explorer needs, is hidden. Commands that prove nothing do not look for FLINT.
    """
    for name, (code, output, asked, _) in run(tmp_path / "out", SMALLEST, 2, "bokeh").items():
        assert code == (name == "explore"), f"{name}: {output}"
        assert code == 0 or "pip install '.[explore]'" in output
        assert asked == (name in PROVING), name
    files = [path for path in tmp_path.glob("out/*/*") if path.is_file() and path.name != ".lock"]
    for path in files:  # commands that share a folder must not overwrite each other
        page = path.name == "index.html"  # the gallery's page
        assert page or path.name.startswith(path.parent.name), path
    cubes = [path for path in tmp_path.glob("out/*/*.zarr") if path.is_dir()]
    assert len(cubes) > 30
    for path in cubes:
        cube = xr.open_zarr(path)
        assert cube.chunks is not None  # raises ValueError if chunks along a dimension differ
        for name, variable in cube.variables.items():
            words = variable.attrs
            assert words["long_name"], (path, name)
            assert words.get("units", "1") in ("1", "degree", "s", "turn"), (path, name)
        with dask.config.set(scheduler="synchronous"):  # SciPy cannot write netCDF on a cluster
            cube.to_netcdf(path.with_suffix(".nc"))
        with xr.open_dataset(path.with_suffix(".nc"), engine="scipy") as back:
            xr.testing.assert_equal(back, cube)
            axes = {*plane_of(back.attrs).axes} if "plane" in back.attrs else set()
            corners = {variable.removesuffix("_low") for variable in back.data_vars}  # of triangles
            assert axes <= {*back.coords} or axes <= corners, path
    assert len(table(tmp_path / "out/claims/claims.csv")) == len(printed_texts("claims")) > 75
    for exhibit in EXHIBITS:
        recipe(exhibit.name, tmp_path / "out")
        follow(tmp_path / f"out/recipes/{exhibit.name}.py", tmp_path / "out")
