"""Runs of commands: existing results are not recomputed, and long runs require --yes."""

import re
import shlex
from contextlib import contextmanager

import click
import numpy as np
import pytest
import toy
import xarray as xr
from click.testing import CliRunner
from commands import invoke, snapshot, succeed
from every_command import PLANE

from pipeline.cubes.cube import untiled
from workflows.shared import cli, run
from workflows.shared.cli import commands, main_of
from workflows.shared.places import place_of

WRITING = [
    name for name in commands() if "--dry-run" in [each.opts[0] for each in main_of(name).params]
]


def started(out, **how):
    return run.Run(out, place_of(out), {}, False, **how)


@contextmanager
def driven(out):
    with started(out).driving() as one:
        yield one


class Study:
    """A study that returns square numbers, and counts how often it is computed."""

    def __init__(self):
        self.count = 0

    def __call__(self):
        self.count += 1
        words, ends = np.array(["first", "last"]), {"long_name": "end"}
        squares = xr.Variable("n", np.arange(9) ** 2, {"long_name": "square"})
        return xr.Dataset({"square": squares, "end": ("end", words, ends)}, attrs={"title": "toy"})


@pytest.fixture
def study():
    return Study()


def test_a_study_is_computed_once_and_then_read(tmp_path, study):
    for _ in range(2):
        with driven(tmp_path) as one:
            result = one.kept(untiled("toy", n=9, names=["a", "b"]), study)
        assert result.square.values.tolist() == [n**2 for n in range(9)]
        assert result.end.values.tolist() == ["first", "last"]
        assert (result.attrs["n"], result.attrs["title"]) == (9, "toy")
        assert one.written["cubes"] == {f"{tmp_path}/toy.zarr": None}
    assert study.count == 1
    xr.testing.assert_identical(xr.open_zarr(tmp_path / "toy.zarr").load(), result)


def test_a_study_with_different_settings_is_refused_before_it_is_computed(tmp_path, study):
    with driven(tmp_path) as one:
        one.kept(untiled("toy", n=9), study)
    before = snapshot(tmp_path)
    with pytest.raises(click.UsageError, match="n is 9, not 10"), driven(tmp_path) as one:
        one.kept(untiled("toy", n=10), study)
    assert (study.count, snapshot(tmp_path)) == (1, before)


@pytest.mark.parametrize("by", ["computed_by", "studied_by"])
def test_a_study_is_recomputed_if_its_code_has_changed(tmp_path, study, monkeypatch, by):
    with driven(tmp_path) as one:
        one.kept(untiled("toy"), study)
    monkeypatch.setitem(run._CODE, by, "other code")
    monkeypatch.setattr(run.store, "COMPUTED_BY", run._CODE["computed_by"])
    for _ in range(2):
        with driven(tmp_path) as one:
            assert one.kept(untiled("toy"), study).attrs[by] == "other code"
    assert study.count == 2


def test_a_study_of_a_swept_cube_records_its_own_code_and_time(tmp_path, study):
    swept = {"computed_by": "the code of a job", "created": "earlier"}
    with driven(tmp_path) as one:
        result = one.kept(untiled("toy"), lambda: study().assign_attrs(swept))
        assert one.holds(untiled("toy"))
    assert result.attrs["computed_by"] == run._CODE["computed_by"]
    assert result.attrs["created"] != "earlier"


def test_a_study_records_the_command_that_first_computed_it(tmp_path):
    options = ["--primary", "-4:4:10", "--secondary", "0:8:10"]
    for more in ([], ["--quiet"]):
        succeed("period_one", tmp_path, *options, *more)
    cube = xr.open_zarr(tmp_path / "period_one_primary.zarr")
    line = ["python", "-m", "workflows.period_one", "--out", str(tmp_path), *options]
    assert cube.history == f"{cube.created} {shlex.join(line)}"
    assert cube.source.startswith("nasm-transport ")
    assert cube.references == "arXiv:1606.04824, Sec. IV.A and Fig. 3"


def test_a_study_is_recomputed_if_it_is_damaged(tmp_path, study):
    chunk = tmp_path / "toy.zarr/square/c/0"
    for damage in (lambda: chunk.write_bytes(b"\0" + chunk.read_bytes()[1:]), chunk.unlink):
        with driven(tmp_path) as one:
            one.kept(untiled("toy"), study)
        count, whole = study.count, chunk.read_bytes()
        damage()
        with driven(tmp_path) as one:
            one.kept(untiled("toy"), study)
        assert (study.count, chunk.read_bytes()) == (count + 1, whole)


@pytest.mark.parametrize("lost", ["tiles/commit/c/0/1/2", "sign/c/1/2"])
def test_a_study_is_recomputed_while_its_sweep_lacks_tiles(here, tmp_path, study, lost):
    toy.run(here, tmp_path, toy.cube())
    for is_complete in (True, False):
        if not is_complete:
            (tmp_path / "toy.zarr" / lost).unlink()
        with driven(tmp_path) as one:
            one.kept(untiled("squares"), study, "toy")
            assert one.holds(untiled("squares"), "toy") is is_complete
    assert study.count == 2


def test_a_stored_study_adds_nothing_to_the_predicted_time(tmp_path, study):
    with driven(tmp_path) as one:
        one.kept(untiled("toy"), study)
    with started(tmp_path, shorter="").driving((untiled("toy"), 2 * run.LONGEST)):
        pass
    late = started(tmp_path, shorter="reduce n").driving((untiled("other"), 2 * run.LONGEST))
    with pytest.raises(click.UsageError, match=r"20 min on .*reduce n"), late:
        pass


def test_a_command_without_sweeps_computes_nothing_when_rerun(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("existing results are recomputed")

    from workflows.portraits import study

    options = "portraits", tmp_path, "--n-orbits", "2", "--n-max", "10", "--quiet"
    message = succeed(*options)
    figures = {path: path.read_bytes() for path in tmp_path.glob("*.png")}
    for name in ("nonautonomous_dataset", "symmetric_dataset"):
        monkeypatch.setattr(study, name, refuse)
    assert succeed(*options) == message
    assert {path: path.read_bytes() for path in tmp_path.glob("*.png")} == figures
    refused = invoke("portraits", tmp_path, "--n-orbits", "3", "--n-max", "10")
    assert (refused.exit_code, "n_orbits is 2, not 3" in refused.output) == (2, True)


def test_a_run_that_takes_too_long_exits_with_code_2_unless_allowed(tmp_path, workers, monkeypatch):
    out, options = tmp_path / "out", PLANE.split()
    seconds = float(re.search(r"in all .* (\S+) CPU hours", dry(out, options))[1]) * 3600
    monkeypatch.setattr(run, "LONGEST", 0.4 * seconds)
    result = invoke("escape_plane", out, *options, "--workers", "2")
    assert (result.exit_code, out.exists()) == (2, False)
    assert " on 2 cores (" in result.output
    assert "reduce --first or --second or --n-max" in result.output
    monkeypatch.setattr(run, "LONGEST", 0.6 * seconds)  # enough for two cores, not for one
    assert invoke("escape_plane", out, *options, "--workers", "1").exit_code == 2
    monkeypatch.setattr(run, "LONGEST", 0.0)
    assert dry(out, options)
    assert not out.exists()
    succeed("escape_plane", out, *options, *workers)
    succeed("escape_plane", out, *options)  # allowed, as nothing is left to compute


def dry(out, options):
    return succeed("escape_plane", out, *options, "--dry-run")


def test_the_option_yes_lets_a_run_take_as_long_as_it_needs(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "LONGEST", -1.0)
    small = ["--primary", "-4:4:20", "--secondary", "0:8:10"]
    assert invoke("period_one", tmp_path / "out", *small).exit_code == 2
    succeed("period_one", tmp_path / "out", *small, "--yes")


def test_each_command_names_options_that_shorten_a_run():
    names = set()
    for name in WRITING:
        context = main_of(name).make_context(name, [])
        assert cli.shortening(context)
        names |= {option.opts[0] for option in context.command.params}
    assert names.issuperset([*cli._SMALLER, *cli._LARGER])
    full = main_of("proved_map").make_context("proved_map", ["--full"])
    assert cli.shortening(full).startswith("leave --full out; reduce ")


def test_the_full_gallery_takes_hours_and_therefore_requires_yes(tmp_path):
    result = CliRunner().invoke(main_of("gallery"), ["--full", "--out", str(tmp_path / "out")])
    assert (result.exit_code, (tmp_path / "out").exists()) == (2, False)
    assert "add --yes" in result.output
