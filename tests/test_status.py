"""The status of a store, of sweeps that are complete, under way, killed or not begun."""

import dataclasses
import os
import threading
import time

import numpy as np
import pytest
import toy
import xarray as xr
from click.testing import CliRunner
from pipeline.grid import Axis
from pipeline.status import RECENT, state

import workflows.status
from pipeline import store, verify
from pipeline.cubes import barrier, escape


@pytest.fixture(scope="module")
def client():
    with toy.workers_here() as client:
        yield client


def told(out, *options, place=None):
    where = ["--out", str(out)] + (["--store", place] if place else [])
    result = CliRunner().invoke(workflows.status.main, [*where, *options])
    assert result.exit_code == 0, result.output + repr(result.exception)
    return result.output


def refused(out):
    result = CliRunner().invoke(workflows.status.main, ["--out", str(out)])
    assert result.exit_code == 2
    assert "Traceback" not in result.output
    return result.output


def files(out):
    return {path: path.stat().st_mtime_ns for path in out.rglob("*")}


def commit(out, cube, indices, arrays, seconds=0.5):
    """Commit some tiles by hand, of the arrays(index)."""
    layout = store.create(out, cube)
    for index in indices:
        store.commit(layout, index, arrays(index), seconds)
    return [out / layout.key(layout.record, index) for index in indices]


def test_a_complete_sweep(client, tmp_path):
    toy.watched_sweep(client, tmp_path, toy.cube())
    before = files(tmp_path)
    said = told(tmp_path)
    assert "no driver" in said
    assert "toy: 20 of 20 tiles; " in said
    assert "missing" not in said
    assert files(tmp_path) == before
    cube = store.read(tmp_path, "toy")
    found = state(tmp_path, "toy")
    assert found.cpu_seconds == pytest.approx(float(cube.cpu_seconds.sum()), rel=1e-12)
    arrays = [
        (tmp_path / "cubes.zarr/toy" / name).rglob("*/[0-9]*")
        for name in ("wave", "sign", "cpu_seconds")
    ]
    assert found.size == sum(p.stat().st_size for chunks in arrays for p in chunks if p.is_file())


def test_a_running_sweep_says_who_drives_it_and_is_not_disturbed(client, tmp_path):
    said = []
    reading = threading.Thread(target=lambda: said.append(told(tmp_path)))
    events = {60: reading.start, 100: reading.join}
    outcome = toy.watched_sweep(client, tmp_path, toy.cube(tile=1, seconds=0.01), events)
    assert outcome.remaining == 0
    assert f"a driver is at work (process {os.getpid()})" in said[0]
    assert " of 130 tiles (" in said[0]
    assert " missing; " in said[0]
    assert " left at that rate" in said[0]


def test_a_driver_may_start_while_the_status_is_read(tmp_path):
    stop = threading.Event()

    def ask():
        while not stop.wait(0.001):
            store.place_of(tmp_path).driver()

    with store.driving(tmp_path):
        pass
    asking = threading.Thread(target=ask)
    asking.start()
    try:
        for _ in range(30):
            with store.driving(tmp_path):
                pass
    finally:
        stop.set()
        asking.join()


def test_rate_and_time_left_are_those_of_the_last_minutes(tmp_path):
    with store.driving(tmp_path):
        indices = [(i, j) for i in range(4) for j in range(5)]
        records = commit(tmp_path, toy.cube(), indices[:12], toy.ones, 0.25)
    now = time.time()
    # Two long ago, then one every ten seconds.
    for i, record in enumerate(records):
        when = now - 10 * i - 3 if i < 10 else now - 2 * RECENT
        os.utime(record, (when, when))
    found = state(tmp_path, "toy")
    assert (found.tiles, found.done, found.missing) == (20, 12, 8)
    assert found.cpu_seconds == 3.0
    assert found.rate == pytest.approx(0.1, rel=1e-3)
    assert found.seconds_left == pytest.approx(80, rel=1e-3)
    said = told(tmp_path)
    assert "12 of 20 tiles (60.0%), 8 missing; 3 CPU s" in said
    assert "0.1 tiles/s" in said
    assert "left at" not in said  # nobody is at work
    with store.driving(tmp_path):
        assert "about 80 s left at that rate" in told(tmp_path)


def test_a_torn_record_is_a_missing_tile(tmp_path):
    with store.driving(tmp_path):
        first, second = commit(tmp_path, toy.cube(), [(0, 0), (1, 1)], toy.ones, 2.0)
    first.write_bytes(b"")
    second.write_bytes(second.read_bytes()[::-1])  # in full length, but damaged: counted, not read
    found = state(tmp_path, "toy")
    assert (found.done, found.cpu_seconds) == (1, 0.0)


def test_failed_tiles_are_told_with_the_reason_until_they_are_computed(client, tmp_path):
    plan = toy.cube(raises=[0.0, -1.0])
    assert toy.watched_sweep(client, tmp_path, plan).remaining == 1
    reason = "ArithmeticError: no answer here"
    found = state(tmp_path, "toy")
    assert (found.done, found.failed, found.reasons) == (19, 1, {(0, 0): reason})
    said = told(tmp_path)
    assert "19 of 20 tiles (95.0%), 1 missing, of which 1 failed when last tried; " in said
    assert f"\n  tile (0, 0) failed: {reason}\n" in said
    with store.driving(tmp_path):
        commit(tmp_path, plan, [(0, 0)], toy.ones)
    found = state(tmp_path, "toy")
    assert (found.done, found.failed, found.reasons) == (20, 0, {})
    assert " failed: " not in told(tmp_path)


def test_a_tile_that_is_freed_has_not_failed(tmp_path):
    with store.driving(tmp_path):
        commit(tmp_path, toy.cube(), [(0, 0)], toy.ones)
        store.record_failure(store.create(tmp_path, toy.cube()), (0, 0), "before that")
        verify.free(tmp_path, "toy", (0, 0))
    found = state(tmp_path, "toy")
    assert (found.done, found.failed) == (0, 0)


def test_of_many_failures_the_first_are_told_and_a_reason_is_only_text(tmp_path):
    with store.driving(tmp_path):
        layout = store.create(tmp_path, toy.cube())
        for i, j in [(i, j) for i in range(3) for j in range(5)]:
            store.record_failure(layout, (i, j), f"\x1b[2J{i}\n{j}\ud800" + "x" * 480)
        store.record_failure(layout, (0, 1), "x" * 3000)
    strange = tmp_path / layout.failure_key((3, 3))
    strange.parent.mkdir()
    strange.with_name("mine.failed").write_text("no tile")
    strange.write_bytes(b"\xff" * 12)  # as long as a commit record
    found = state(tmp_path, "toy")
    assert (found.done, found.failed, found.missing) == (0, 16, 20)
    said = told(tmp_path)
    assert said.count(" failed: ") == 10
    assert "tile (0, 1) failed: for a reason too long" in said
    assert "tile (1, 4) failed:  [2J1 4?xx" in said
    assert "  ... and 6 more\n" in said
    assert max(map(len, said.splitlines())) < 600


def test_an_empty_store_and_one_that_is_none(tmp_path):
    assert "holds no cubes.zarr" in refused(tmp_path / "nowhere")
    with store.driving(tmp_path / "out"):
        pass
    assert "no cubes yet" in told(tmp_path / "out")
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign/notes.txt").write_text("mine")
    assert "holds other files and no cubes.zarr" in refused(tmp_path / "foreign")


DAMAGE = [b"", b"{", b"[]", b"\xff", b"[" * 100_000]


@pytest.mark.parametrize("damage", DAMAGE, ids=range(len(DAMAGE)))
def test_damaged_metadata_of_a_cube_are_one_clear_message_and_hide_no_other(tmp_path, damage):
    with store.driving(tmp_path):
        store.create(tmp_path, toy.cube())
        store.create(tmp_path, dataclasses.replace(toy.cube(), name="zoo"))
    (tmp_path / "cubes.zarr/toy/zarr.json").write_bytes(damage)
    for _ in range(2):
        result = CliRunner().invoke(workflows.status.main, ["--out", str(tmp_path)])
        assert result.exit_code == 1
        assert "cubes.zarr/toy are damaged" in result.output
        assert "zoo: 0 of 20 tiles" in result.output
        (tmp_path / "cubes.zarr/zarr.json").write_bytes(damage)
    (tmp_path / "cubes.zarr/zoo/zarr.json").write_bytes(damage)
    assert "is a store of version None" in refused(tmp_path)


def test_a_plane_so_far_is_drawn(tmp_path, monkeypatch):
    axis = Axis(0.0, 1.0, 8)
    cube = escape.plane("escape", axis, axis, [64], 1000, 4).cube
    field = np.full((1, 4, 4), np.inf)
    field[0, 2:] = 10.0
    with store.driving(tmp_path):
        commit(tmp_path, cube, [(0, 0), (1, 1)], lambda index: {"escape_time": field})
    said = told(tmp_path, "--draw")
    assert f"{tmp_path}/status_escape.png" in said
    assert "2 of 4 tiles are computed" in (tmp_path / "status_escape.txt").read_text()
    from workflows.figures import status as figures

    monkeypatch.setattr(figures, "_SHOWN", 4)
    drawn = figures.draw_so_far(store.read(tmp_path, "escape"))
    times, unknown = (image.get_array().filled(np.nan) for image in drawn.axes[0].images)
    assert times.shape == (4, 4)
    assert np.nansum(times) == 10.0 * 4
    assert np.nansum(unknown) == 8


def test_rays_so_far_are_drawn_and_other_cubes_are_not(tmp_path):
    cube = barrier.last_barrier([0.0, 30.0, 45.0], 1e-3).cube
    arrays = {
        name: np.full([1 if d == "angle" else cube.sizes[d] for d in variable.dims], 0.7).astype(
            variable.dtype
        )
        for name, variable in cube.template.data_vars.items()
    }
    other = xr.Dataset({"z": ("x", [1.0])})
    with store.driving(tmp_path):
        commit(tmp_path, cube, [(1,)], lambda index: arrays)
        commit(tmp_path, toy.cube(), [], None)
        store.replace(tmp_path, toy.Cube("table", other, {}, {}))
    said = told(tmp_path, "--draw")
    assert "table: written whole" in said
    assert "toy: 0 of 20 tiles (0.0%), 20 missing; 0 CPU s" in said
    assert said.count("not drawn") == 2
    assert "1 of 3 tiles are computed" in (tmp_path / "status_barrier.txt").read_text()
    from workflows.figures.status import draw_so_far

    (line,) = draw_so_far(store.read(tmp_path, "barrier")).axes[0].lines
    assert np.array_equal(line.get_ydata(), [np.nan, 0.7, np.nan], equal_nan=True)


def test_a_sample_of_many_records_is_enough(tmp_path, monkeypatch):
    monkeypatch.setattr("pipeline.status._READ", 6)
    with store.driving(tmp_path):
        indices = [(i, j) for i in range(4) for j in range(5)]
        commit(tmp_path, toy.cube(), indices, toy.ones, 0.25)
    found = state(tmp_path, "toy")
    assert found.sampled
    assert found.cpu_seconds == pytest.approx(20 * 0.25)
