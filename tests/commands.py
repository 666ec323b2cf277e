"""Run commands as a user would, and inspect the files that they write."""

import csv
import runpy
from contextlib import chdir, redirect_stdout
from io import StringIO

import matplotlib.pyplot as plt
import pytest
from click.testing import CliRunner

from workflows.shared.cli import main_of


def invoke(name, out, *options):
    """Run `python -m workflows.NAME --out OUT OPTIONS` in this process."""
    return CliRunner().invoke(main_of(name), ["--out", str(out), *options])


def succeed(name, out, *options):
    """Run a command that must succeed; return what it prints."""
    result = invoke(name, out, *options)
    assert result.exit_code == 0, result.output + repr(result.exception)
    return result.output


def table(path, **where):
    """Return the rows of a CSV table whose columns have the given values."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        return [row for row in rows if all(row[key] == text for key, text in where.items())]


def snapshot(out):
    """Return the modification times of all files in a directory except its lock."""
    files = [path for path in out.rglob("*") if path.is_file() and path.name != ".lock"]
    return {path: path.stat().st_mtime_ns for path in files}


def follow(recipe, out):
    """Run a gallery recipe in a directory; check that no axes are empty; return what it prints."""
    figures, output = [], StringIO()
    with pytest.MonkeyPatch.context() as patch, chdir(out), redirect_stdout(output):
        patch.setattr(plt, "show", lambda: figures.extend(map(plt.figure, plt.get_fignums())))
        runpy.run_path(str(recipe))
    drawn = [axes.has_data() for figure in figures for axes in figure.axes]
    plt.close("all")
    assert drawn
    assert all(drawn), recipe
    return output.getvalue()
