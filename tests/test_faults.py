"""Disks that fill up, files that vanish or change, names and stores that nobody expects."""

import dataclasses
import errno
import json
import os
import pickle
import resource
import shutil
from contextlib import suppress

import numcodecs
import numpy as np
import pytest
import toy
import xarray as xr
import zarr
from click import ClickException
from click.testing import CliRunner
from pipeline.faults import StorageError
from pipeline.layout import COMMIT
from workflows.cli import driver
from zarr.errors import UnknownCodecError

import workflows.verify
from pipeline import store, verify


@pytest.fixture(scope="module")
def client():
    """Workers in this process, where a test can make the disk fail."""
    with toy.workers_here() as client:
        yield client


def assert_complete(out, plan):
    cube = store.read(out, plan.name)
    for name, values in toy.serial(plan).items():
        assert np.array_equal(cube[name].values, values)
    assert np.isfinite(cube.cpu_seconds).all()


def n_computed(client, out, plan):
    """How many tiles a run computes, which completes the cube."""
    assert toy.watched_sweep(client, out, plan).remaining == 0
    assert_complete(out, plan)
    assert len(set(toy.COMPUTED)) == len(toy.COMPUTED)
    return len(toy.COMPUTED)


def test_a_full_disk_stops_the_sweep_and_the_next_run_completes_it(client, tmp_path):
    plan = toy.cube(tile=1, rows=12, columns=12)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # No file can be longer than ten bytes: the system writes a part of a chunk, and refuses the
    # rest.
    events = {50: lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))}
    try:
        with pytest.raises(StorageError, match=r"cannot write to .*; raise the limit"):
            toy.watched_sweep(client, tmp_path, plan, events)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert len(toy.COMPUTED) < 60  # it did not let 144 tiles fail in turn
    assert 84 < n_computed(client, tmp_path, plan) < 104


@pytest.mark.parametrize(
    ("number", "message"), [(errno.ENOSPC, "make room"), (errno.EACCES, "Permission denied")]
)
def test_a_disk_that_cannot_be_written_is_one_clear_message(
    client, tmp_path, monkeypatch, number, message
):
    def fail(source, target):
        raise OSError(number, os.strerror(number))

    plan = toy.cube()
    events = {5: lambda: monkeypatch.setattr("pipeline.directory.os.rename", fail)}
    with pytest.raises(StorageError, match=f"cannot write to {tmp_path}: .*{message}"):
        toy.watched_sweep(client, tmp_path, plan, events)
    monkeypatch.undo()
    assert not (tmp_path / ".partial").exists()
    assert 10 < n_computed(client, tmp_path, plan) < 20


@pytest.mark.parametrize("moved", [".", store.STORE, f"{store.STORE}/toy"])
def test_a_store_that_is_moved_under_way_is_missed_and_grows_nowhere_else(client, tmp_path, moved):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    plan = toy.cube(tile=1)
    events = {20: lambda: os.rename(os.path.normpath(out / moved), elsewhere)}
    with pytest.raises(StorageError, match="it was moved or deleted under way; put it back"):
        toy.watched_sweep(client, out, plan, events)
    assert not (out / moved).exists()
    os.rename(elsewhere, os.path.normpath(out / moved))
    assert 100 < n_computed(client, out, plan) < 130


def test_a_group_that_cannot_be_replaced_is_one_message_with_its_cause(tmp_path):
    (tmp_path / store.STORE).write_text("no directory")
    place = store.place_of(tmp_path)
    with place.held(), pytest.raises(StorageError, match=r"cannot write to .*: Not a directory; "):
        place.put_group(f"{store.STORE}/toy", {"zarr.json": b"{}"})


def test_a_failing_store_ends_a_workflow_with_exit_code_1(tmp_path):
    with (
        pytest.raises(ClickException, match=r"the disk\. .*run the same command") as raised,
        driver(str(tmp_path)),
    ):
        raise StorageError("make room on the disk")
    assert raised.value.exit_code == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is full")
def test_a_table_that_cannot_be_written_is_one_message(tmp_path):
    with (
        pytest.raises(ClickException, match="No space left on device") as raised,
        driver(str(tmp_path)),
        open("/dev/full", "wb", buffering=0) as table,
    ):
        table.write(b"table")
    assert raised.value.exit_code == 1


def test_what_is_committed_does_not_depend_on_clocks(client, tmp_path):
    plan = toy.cube()
    toy.watched_sweep(client, tmp_path, plan)
    for i, path in enumerate(tmp_path.rglob("*")):
        os.utime(path, (0, 0) if i % 2 else (4e9, 4e9))
    assert n_computed(client, tmp_path, plan) == 0


def chunk(out, variable, *index):
    return out.joinpath(store.STORE, "toy", variable, "c", *map(str, index))


def damage(out):
    """Damage four tiles, each in its way; returns their indices."""
    data = bytearray(chunk(out, "wave", 0, 1, 2).read_bytes())
    data[17] ^= 1
    chunk(out, "wave", 0, 1, 2).write_bytes(data)
    chunk(out, "wave", 0, 0, 0).write_bytes(data[:-9])
    chunk(out, "sign", 3, 4).unlink()
    record = bytearray(chunk(out, COMMIT, 2, 2).read_bytes())
    record[0] ^= 128
    chunk(out, COMMIT, 2, 2).write_bytes(record)
    return {(1, 2), (0, 0), (3, 4), (2, 2)}


def invoke(out, *options):
    return CliRunner().invoke(workflows.verify.main, ["--out", str(out), *options])


def test_damaged_tiles_are_found_and_repaired_by_computing_them_alone(client, tmp_path):
    plan = toy.cube()
    toy.watched_sweep(client, tmp_path, plan)
    assert invoke(tmp_path).exit_code == 0
    damaged = damage(tmp_path)
    found = dict(verify.verify(tmp_path, "toy", verify.committed(tmp_path, "toy")))
    assert {index for index, what in found.items() if what} == damaged
    assert len(found) == 21
    result = invoke(tmp_path)
    assert result.exit_code == 1
    assert "toy: 20 tiles, 4 damaged" in result.output
    assert "tile (3, 4): sign is gone" in result.output
    assert "tile (0, 0): wave has 139 bytes instead of 148" in result.output
    assert "tile (1, 2): wave does not match its checksum" in result.output
    assert invoke(tmp_path, "--repair").exit_code == 0
    assert np.isfinite(store.read(tmp_path, "toy").cpu_seconds).sum() == 16
    assert n_computed(client, tmp_path, plan) == 4
    assert invoke(tmp_path).exit_code == 0


@pytest.mark.parametrize("cut", [slice(None, -1), slice(0), slice(1, None)])
def test_a_plain_xarray_refuses_a_damaged_chunk(client, tmp_path, cut):
    toy.watched_sweep(client, tmp_path, toy.cube())
    whole = chunk(tmp_path, "wave", 0, 1, 2).read_bytes()
    cube = xr.open_zarr(tmp_path / store.STORE, group="toy")
    chunk(tmp_path, "wave", 0, 1, 2).write_bytes(whole[cut])
    with pytest.raises(ValueError, match="computed checksum do not match"):
        cube.wave.load()
    with (
        pytest.raises(StorageError, match=r"run `python -m workflows.verify --repair`"),
        store.explained(tmp_path),
    ):
        store.read(tmp_path, "toy").wave.load()


def edited(path, change):
    """Change a file of JSON."""
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def arrays(group):
    return group["consolidated_metadata"]["metadata"]


def noise_in_a_coordinate(out):
    chunk(out, "row", 0).write_bytes(b"noise")


def a_coordinate_lost(out):
    chunk(out, "column", 0).unlink()  # to zarr, a chunk of fill values


def another_dtype(out):
    edited(
        out / "cubes.zarr/toy/zarr.json",
        lambda group: arrays(group)["wave"].update(data_type="float32"),
    )


def dimensions_swapped(out):
    names = ["part", "column", "row"]
    edited(out / "cubes.zarr/toy/wave/zarr.json", lambda array: array.update(dimension_names=names))


def another_setting(out):
    edited(out / "cubes.zarr/toy/zarr.json", lambda group: group["attributes"].update(depth=9000))


def no_word_of_tiles(out):
    edited(out / "cubes.zarr/toy/zarr.json", lambda group: arrays(group).pop(COMMIT))


def no_metadata_of_an_array(out):
    (out / "cubes.zarr/toy/wave/zarr.json").write_bytes(b"")


@pytest.mark.parametrize(
    "damage",
    [
        noise_in_a_coordinate,
        a_coordinate_lost,
        another_dtype,
        dimensions_swapped,
        another_setting,
        no_word_of_tiles,
        no_metadata_of_an_array,
    ],
)
def test_damaged_metadata_are_found_cost_no_tile_and_are_written_anew(client, tmp_path, damage):
    plan = toy.cube(depth=3)
    toy.watched_sweep(client, tmp_path, plan)
    before = commits(tmp_path)
    damage(tmp_path)
    repair = invoke(tmp_path, "--repair")
    assert "damaged: its metadata or " in repair.output
    assert commits(tmp_path) == before
    assert n_computed(client, tmp_path, plan) == 0
    assert commits(tmp_path) == before
    assert invoke(tmp_path).exit_code == 0
    cube = xr.open_zarr(tmp_path / store.STORE, group="toy")
    assert cube.attrs["depth"] == 3
    assert cube.drop_vars(COMMIT).equals(reference(plan))


def commits(out):
    records = (out / "cubes.zarr/toy" / COMMIT / "c").rglob("*")
    return {path: path.read_bytes() for path in records if path.is_file()}


def reference(plan):
    serial = toy.serial(plan)
    return plan.template.assign(
        {name: (variable.dims, serial[name]) for name, variable in plan.template.data_vars.items()}
    )


@pytest.mark.parametrize("file", ["zarr.json", "wave/zarr.json", "row/zarr.json"])
@pytest.mark.parametrize("lost", [b"", b"{", b"[]", b'{"zarr_format": 3}'])
def test_a_cube_with_damaged_metadata_is_in_no_others_way(tmp_path, file, lost):
    other = dataclasses.replace(toy.cube(), name="zoo")
    with store.driving(tmp_path):
        store.create(tmp_path, toy.cube())
        (tmp_path / "cubes.zarr/toy" / file).write_bytes(lost)
        layout = store.create(tmp_path, other)
        store.commit(layout, (0, 0), toy.ones((0, 0)), 0.5)
    assert float(store.read(tmp_path, "zoo").wave[0, 0, 0]) == 1.0
    result = invoke(tmp_path)
    assert result.exit_code == 1
    assert "zoo: 1 tiles, 0 damaged" in result.output


def test_a_copy_of_the_metadata_that_differs_is_gathered_anew(client, tmp_path):
    plan = toy.cube(depth=3)
    toy.watched_sweep(client, tmp_path, plan)
    root = tmp_path / "cubes.zarr/zarr.json"
    whole = root.read_bytes()
    edited(root, lambda group: arrays(group)["toy"]["attributes"].update(depth=9000))
    assert store.read(tmp_path, "toy").attrs["depth"] == 9000
    result = invoke(tmp_path)
    assert result.exit_code == 1
    assert "damaged: the copy of its metadata at the root" in result.output
    assert n_computed(client, tmp_path, plan) == 0
    assert root.read_bytes() == whole
    edited(root, lambda group: arrays(group)["toy/wave"].update(shape=[2, 13, 10]))
    assert n_computed(client, tmp_path, plan) == 0
    assert root.read_bytes() == whole


@pytest.mark.parametrize("lost", [b"", b"{", b"[]", None])
@pytest.mark.parametrize("group", ["", "toy"])
def test_metadata_lost_in_a_power_cut_cost_no_tile(client, tmp_path, group, lost):
    plan = toy.cube(depth=3)
    toy.watched_sweep(client, tmp_path, plan)
    before = commits(tmp_path)
    computed_by = store.read(tmp_path, "toy").attrs["computed_by"]
    file = tmp_path / "cubes.zarr" / group / "zarr.json"
    if lost is None:
        file.unlink()
    else:
        file.write_bytes(lost)
    with pytest.raises(store.StoreError, match="depth is 3, not 4"):
        toy.watched_sweep(client, tmp_path, toy.cube(depth=4))
    assert n_computed(client, tmp_path, plan) == 0
    assert commits(tmp_path) == before
    assert store.read(tmp_path, "toy").attrs["computed_by"] == computed_by
    assert invoke(tmp_path).exit_code == 0


def test_a_damaged_cube_that_is_no_sweeps_is_written_anew(tmp_path):
    template = xr.Dataset({"square": ("x", np.arange(5.0) ** 2)}, {"x": np.arange(5)})
    plan = toy.Cube("squares", template, {}, {})
    with store.driving(tmp_path):
        store.replace(tmp_path, plan)
    file = tmp_path / store.STORE / "squares" / "square" / "c" / "0"
    data = file.read_bytes()
    file.write_bytes(data[:-2] + b"??")
    assert invoke(tmp_path).exit_code == 1
    assert invoke(tmp_path, "--repair").exit_code == 0
    with store.driving(tmp_path):
        store.replace(tmp_path, plan)
    assert store.read(tmp_path, "squares").equals(template)
    assert file.read_bytes() == data


def test_a_cube_that_is_no_sweeps_and_lost_a_chunk_is_damaged(tmp_path):
    template = xr.Dataset({"square": ("x", np.arange(5.0) ** 2)}, {"x": np.zeros(5)})
    with store.driving(tmp_path):
        store.replace(tmp_path, toy.Cube("squares", template, {}, {}))
    assert invoke(tmp_path).exit_code == 0
    (tmp_path / "cubes.zarr/squares/square/c/0").unlink()
    result = invoke(tmp_path)
    assert result.exit_code == 1
    assert "damaged: its metadata or numbers" in result.output


def test_tiles_without_metadata_are_an_error_and_are_kept(client, tmp_path):
    plan = toy.cube()
    toy.watched_sweep(client, tmp_path, plan)
    (tmp_path / store.STORE / "toy" / "zarr.json").unlink()
    edited(tmp_path / store.STORE / "zarr.json", lambda root: arrays(root).clear())
    with pytest.raises(store.StoreError, match=r"metadata of .* are damaged"):
        toy.watched_sweep(client, tmp_path, plan)
    assert chunk(tmp_path, "wave", 0, 1, 2).exists()
    shutil.rmtree(tmp_path / store.STORE / "toy" / COMMIT)
    with pytest.raises(store.StoreError, match=r"metadata of .* are damaged"):
        toy.watched_sweep(client, tmp_path, plan)
    assert chunk(tmp_path, "wave", 0, 1, 2).exists()


def test_a_cube_that_was_deleted_is_computed_anew_with_any_settings(client, tmp_path):
    toy.watched_sweep(client, tmp_path, toy.cube(depth=3))
    shutil.rmtree(tmp_path / store.STORE / "toy")
    assert n_computed(client, tmp_path, toy.cube(depth=4)) == 20


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: os.truncate(path, 10**13)])
def test_a_chunk_that_is_none_is_damaged_and_is_not_read(client, tmp_path, make):
    toy.watched_sweep(client, tmp_path, toy.cube())
    strange = chunk(tmp_path, "wave", 0, 1, 2)
    if make is os.mkfifo:
        strange.unlink()
    make(strange)
    assert "tile (1, 2): wave has " in invoke(tmp_path).output


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_lock_that_is_none_of_ours_is_left_alone(tmp_path, kind):
    precious, lock = tmp_path / "precious", tmp_path / "out" / ".lock"
    precious.write_text("data")
    with store.driving(lock.parent):
        pass
    lock.unlink()
    if kind == "link":
        lock.symlink_to(precious)
    else:
        os.mkfifo(lock)
    with pytest.raises(store.StoreError, match="cannot write to "), store.driving(lock.parent):
        pass
    assert precious.read_text() == "data"
    with pytest.raises(store.StoreError, match="cannot read "):
        store.place_of(lock.parent).driver()


def test_a_store_that_is_not_there_cannot_be_verified(tmp_path):
    result = invoke(tmp_path / "none")
    assert result.exit_code == 2
    assert f"holds no {store.STORE}" in result.output
    assert not (tmp_path / "none").exists()


NAMES = ["a b", "ünïcödé λ", "#1", "100%25", "new\nline", "~", "-x", "[a]*?", "quote'\"", "a:b::c"]


@pytest.mark.parametrize("name", NAMES)
def test_a_directory_may_have_any_name(client, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    plan = toy.cube(tile=10)
    assert n_computed(client, name, plan) == 2
    assert_complete(tmp_path / name, plan)
    assert os.listdir(tmp_path) == [name]
    with xr.open_zarr(zarr.storage.LocalStore(tmp_path / name / store.STORE), group="toy") as cube:
        assert np.array_equal(cube.wave, toy.serial(plan)["wave"])
    assert "toy: 2 tiles, 0 damaged" in invoke(f"./{name}").output


class Trap:
    """Creates the file `sprung` when it is unpickled."""

    def __init__(self, sprung):
        self.sprung = str(sprung)

    def __reduce__(self):
        return os.mkdir, (self.sprung,)


def strangers_group(out, sprung):
    """A group of zarr version 2, whose array says that its chunks are pickles."""
    (out / "toy" / "wave").mkdir(parents=True)
    pickled = {"id": "pickle", "protocol": 5}
    array = {
        "zarr_format": 2,
        "shape": [1],
        "chunks": [1],
        "dtype": "|O",
        "compressor": None,
        "fill_value": None,
        "order": "C",
        "filters": [pickled],
    }
    (out / "toy" / ".zgroup").write_text('{"zarr_format": 2}')
    (out / "toy" / "wave" / ".zattrs").write_text('{"_ARRAY_DIMENSIONS": ["x"]}')
    (out / "toy" / "wave" / ".zarray").write_text(json.dumps(array))
    data = numcodecs.get_codec(pickled).encode(np.array([Trap(sprung)], dtype=object))
    (out / "toy" / "wave" / "0").write_bytes(data)


def strangers_array(out, sprung):
    """A group of version 3, an array of which names a codec for pickles."""
    group = zarr.create_group(out / "toy", zarr_format=3)
    group.create_array("wave", shape=(1,), chunks=(1,), dtype="f8", dimension_names=["x"])
    file = out / "toy" / "wave" / "zarr.json"
    metadata = json.loads(file.read_text())
    codec = {"name": "numcodecs.pickle", "configuration": {"id": "pickle"}}
    file.write_text(json.dumps(metadata | {"codecs": [codec]}))
    (out / "toy" / "wave" / "c").mkdir()
    (out / "toy" / "wave" / "c" / "0").write_bytes(pickle.dumps(Trap(sprung)))


@pytest.mark.filterwarnings("ignore:Failed to open Zarr store with consolidated metadata")
@pytest.mark.parametrize("strangers", [strangers_group, strangers_array])
def test_a_strangers_pickles_are_not_executed(tmp_path, strangers):
    out, sprung = tmp_path / "out", tmp_path / "sprung"
    with store.driving(out):
        pass
    strangers(out / store.STORE, sprung)
    for attempt in (
        lambda: store.read(out, "toy").load(),
        lambda: list(verify.verify(out, "toy", verify.committed(out, "toy"))),
    ):
        with suppress(store.StoreError, KeyError, UnknownCodecError):
            assert attempt() == [((), "its metadata or numbers")]
    assert not sprung.exists()
    pickle.loads(pickle.dumps(Trap(sprung)))
    assert sprung.exists()  # it would have
