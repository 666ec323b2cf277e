"""Commands replace files atomically: a killed command leaves earlier files intact."""

import ast
import os
import resource
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from workflows.figures import files, style
from workflows.gallery.__main__ import recipe
from workflows.shared import tables

ROOT = Path(__file__).parents[1]
TABLE = xr.Dataset({"square": ("x", np.arange(3.0) ** 2)}, {"x": np.arange(3)})


WRITERS = {
    "figure": lambda folder: style.save(Figure(), folder, "figure", "a caption"),
    "table": lambda folder: tables.write(TABLE, folder / "table.csv"),
    "recipe": lambda folder: recipe("flux", folder),
    "text": lambda folder: files.write(folder / "text.txt", "κ"),
    "bytes": lambda folder: files.write(folder / "bytes", b"bytes"),
}


class Killed(BaseException):
    """Raised by tests instead of killing the process."""


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_command_killed_while_writing_preserves_the_old_file(tmp_path, monkeypatch, writer):
    WRITERS[writer](tmp_path)
    for path in contents(tmp_path):
        path.write_bytes(b"of an earlier run")
    earlier = contents(tmp_path)
    assert earlier

    def kill(*_):
        raise Killed

    monkeypatch.setattr(os, "replace", kill)
    with pytest.raises(Killed):
        WRITERS[writer](tmp_path)
    assert contents(tmp_path) == earlier


def test_on_a_full_disk_only_the_earlier_file_remains(tmp_path):
    files.write(tmp_path / "table.csv", "an earlier run")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10**5, limits[1]))
    try:
        with pytest.raises(OSError, match=r"too large: .*table\.csv"):
            files.write(tmp_path / "table.csv", bytes(10**6))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert contents(tmp_path) == {tmp_path / "table.csv": b"an earlier run"}


# Other modules that call writing functions. Two write certificates or pictures to memory, and two
# write the keys of a cluster to a new folder that only this user can read.
OTHERS = {"pipeline/cubes/proved.py", "workflows/figures/style.py"}
OTHERS |= {"pipeline/sweep/cluster.py", "workflows/examples/job_queue.py"}
WRITE = {"write_text", "write_bytes", "to_csv", "savefig", "to_netcdf", "open", "touch"}


def writes(call):
    """Return True if a call writes to a file that it opens or names."""
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    if name == "open":
        modes = [node.value for node in call.args[1:2] if isinstance(node, ast.Constant)]
        return any(set(mode) & set("wax+") for mode in modes)
    return name in WRITE and bool(call.args)


def test_commands_write_all_their_files_with_one_function():
    result = set()
    for folder in ("workflows", "pipeline"):
        for path in (ROOT / folder).rglob("*.py"):
            calls = (n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call))
            if any(map(writes, calls)):
                result.add(path.relative_to(ROOT).as_posix())
    assert result == OTHERS | {"workflows/figures/files.py"}
