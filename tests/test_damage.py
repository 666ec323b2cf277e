"""Stores that were copied during a sweep, restored in part, or edited."""

import base64
import json
import os
import shutil
import time
from functools import partial

import numpy as np
import pytest
import toy
import xarray as xr
import zarr
from commands import invoke
from test_store import US, arrays, contents, fill, get, missing, put, squares

from pipeline import store
from pipeline.cubes.cube import Cube, blank
from pipeline.store.tiles import COMMIT

ROOT = "toy.zarr/zarr.json"
DIGESTS = "toy.zarr/digests.json"


def test_a_recorded_tile_with_lost_or_truncated_data_counts_as_missing(place):
    plan = toy.cube()
    fill(place, plan)
    store.record_failure(place, "toy", (0, 0), "before it was computed")
    cut = get(place, "toy.zarr/sign/c/3/4")[:-1]
    for key, data in {"wave/c/0/1/2": None, "sign/c/0/0": None, "sign/c/3/4": cut}.items():
        put(place, f"toy.zarr/{key}", data)
    incomplete = {(0, 0), (1, 2), (3, 4)}
    assert missing(place, plan) == incomplete
    assert {i for i in np.ndindex(4, 5) if not store.is_committed(place, "toy", i)} == incomplete
    (state,) = store.status(place)
    assert (state.tiles, state.done, state.lost, state.failed) == (20, 17, 3, 0)
    assert fill(place, plan) == 3
    toy.assert_complete(place, plan)


def test_listing_while_tiles_are_committed_finds_no_record_without_data(on_disk, monkeypatch):
    plan, listed, files = toy.cube(), [], store.Place.files
    store.create(on_disk, plan, US)

    def committing(self, prefix):
        yield from files(self, prefix)
        listed.append(prefix)
        index = len(listed), 0
        store.commit(on_disk, "toy", index, arrays(plan, index), 0.25)

    store.commit(on_disk, "toy", (0, 0), arrays(plan, (0, 0)), 0.25)
    with monkeypatch.context() as patch:
        patch.setattr(store.Place, "files", committing)
        done, written = store.tiles.commit_times(on_disk, store.tiles.arrays_of(on_disk, "toy"))
    # Each array is listed once, the records first; no chunk is read.
    assert listed == [f"toy.zarr/{key}/c" for key in (COMMIT, "wave", "sign")]
    assert np.argwhere(done).tolist() == np.argwhere(np.isfinite(written)).tolist() == [[0, 0]]
    (state,) = store.status(on_disk)
    assert (state.done, state.lost) == (4, 0)


def test_a_copy_made_during_a_sweep_is_completed_by_the_same_command(here, tmp_path):
    plan, out, copy = toy.cube(5, 5, tile=1), tmp_path / "out", tmp_path / "copy"

    def copied(*names):
        for name in names:
            shutil.copytree(out / "toy.zarr" / name, copy / "toy.zarr" / name)

    events = {5: partial(copied, "row", "column", "part", "cell", "sign")}
    events |= {10: partial(copied, "wave"), 20: partial(copied, "tiles")}
    toy.watched_sweep(here, out, plan, events)
    for name in ("zarr.json", "digests.json"):
        shutil.copy(out / "toy.zarr" / name, copy / "toy.zarr" / name)
    (state,) = store.status(store.place_of(copy))
    assert 0 < state.done <= 5
    assert state.lost >= 10
    assert toy.watched_sweep(here, copy, plan).committed == 25 - state.done == len(toy.COMPUTED)
    toy.assert_complete(copy, plan)


def test_an_impossible_number_of_wanted_tiles_is_ignored(on_disk):
    fill(on_disk, toy.cube(), [(0, 0), (1, 1), (2, 2)])
    for noted, n_tiles in ((b"3", 3), (b"12", 12), (b"2", 20), (b"21", 20), (b"9" * 5000, 20)):
        put(on_disk, store.wanted_key("toy"), noted)
        (state,) = store.status(on_disk)
        assert (state.done, state.tiles) == (3, n_tiles)


def test_data_lost_during_a_sweep_are_reported_at_its_end(here, tmp_path):
    plan = toy.cube(5, 5, tile=1)

    def lose_data():
        record = next(iter(toy.commit_times(tmp_path)))
        (tmp_path / "toy.zarr/sign/c" / record.parent.name / record.name).unlink()

    with pytest.raises(store.StoreFailed, match=r"toy\.zarr has lost 1 written tile$"):
        toy.watched_sweep(here, tmp_path, plan, {5: lose_data})
    assert toy.watched_sweep(here, tmp_path, plan).committed == 1
    toy.assert_complete(tmp_path, plan)


def test_reading_warns_of_lost_data_but_not_of_tiles_yet_to_be_computed(place):
    fill(place, toy.cube(), [(0, 0), (1, 2), (2, 2)])
    cube = store.read(place, "toy").load()  # any warning would be an error
    assert np.isnan(cube.wave).any()
    put(place, "toy.zarr/wave/c/0/1/2", None)
    cube = store.read(place, "toy")
    cube.sign.load()
    assert not np.isnan(cube.wave[:, :3, :3]).any()
    with pytest.warns(UserWarning, match=r"toy.zarr: chunks of wave are lost.* rerun the command"):
        cube.wave.load()
    put(place, "toy.zarr/cell/c/0/0", None)
    with pytest.warns(UserWarning, match="chunks of cell are lost"):
        store.read(place, "toy").cell.load()
    store.replace(place, squares(1), US)
    put(place, "squares.zarr/square/c/0", None)
    with pytest.warns(UserWarning, match="chunks of square are lost"):
        store.read(place, "squares").square.load()


def test_a_tile_must_have_all_variables(on_disk):
    store.create(on_disk, toy.cube(), US)
    wave = {"wave": arrays(toy.cube(), (0, 0))["wave"]}
    with pytest.raises(ValueError, match="the tile has no sign"):
        store.commit(on_disk, "toy", (0, 0), wave, 1.0)


def test_a_tile_whose_certificates_are_lost_or_changed_is_damaged(on_disk):
    plan, key = toy.cube(tile=10), store.certificates_key("toy", (0, 0))
    store.create(on_disk, plan, US)
    computed = arrays(plan, (0, 0)) | {"certificates": b"a proof"}
    store.commit(on_disk, "toy", (0, 0), computed, 1.0)
    assert list(store.verify(on_disk, "toy")) == []
    for data in (b"another", None):
        put(on_disk, key, data)
        assert [index for index, _ in store.verify(on_disk, "toy")] == [(0, 0)]
    # In earlier versions the checksum in the record did not cover the certificates.
    store.commit(on_disk, "toy", (0, 0), arrays(plan, (0, 0)), 1.0)
    put(on_disk, key, b"a proof")
    assert list(store.verify(on_disk, "toy")) == []


def of_root(change):
    """Return a function that applies a change to the parsed zarr.json of a cube in the store."""

    def edit(place):
        metadata = json.loads(get(place, ROOT))
        change(metadata["attributes"], metadata["consolidated_metadata"]["metadata"]["wave"])
        put(place, ROOT, json.dumps(metadata).encode())

    return edit


def big_endian(attributes, wave):
    (codec,) = (codec for codec in wave["codecs"] if codec["name"] == "bytes")
    codec["configuration"]["endian"] = "big"


def swap_dimensions(attributes, wave):
    wave["dimension_names"][1:] = reversed(wave["dimension_names"][1:])


def double_a_coordinate(place):
    row = zarr.open_group(place.cube("toy"), mode="r+", use_consolidated=False)["row"]
    row[:] = 2 * row[:]  # written with a valid checksum


FILL = base64.b64encode(np.float64(1).tobytes()).decode()
EDITS = {
    "settings": of_root(lambda attributes, _: attributes.update(n_max=10**6, precision="single")),
    "plane": of_root(lambda attributes, _: attributes.update(plane='{"name": "another"}')),
    "scale factor": of_root(lambda _, wave: wave["attributes"].update(scale_factor=2.0)),
    "fill value": of_root(lambda _, wave: wave["attributes"].update(_FillValue=FILL)),
    "dimensions": of_root(swap_dimensions),
    "hash": of_root(lambda attributes, _: attributes.update(config_hash="0" * 64)),
    "dtype": of_root(lambda _, wave: wave.update(data_type="int64", fill_value=0)),
    "shorter numbers": of_root(lambda _, wave: wave.update(data_type="float32")),
    "byte order": of_root(big_endian),
    "coordinate": double_a_coordinate,
    "who computed it": of_root(lambda attributes, _: attributes.update(computed_by="nobody")),
    "tiles": of_root(
        lambda _, wave: wave["chunk_grid"]["configuration"].update(chunk_shape=[2, 5, 5])
    ),
    "label": of_root(lambda attributes, _: attributes.update(title="another")),
}


@pytest.mark.parametrize("edit", EDITS)
def test_a_rerun_restores_edited_metadata_without_recomputing_tiles(on_disk, edit):
    plan = toy.cube(10, 15, 5, plane='{"name": "a plane"}', n_max=10, precision="double")
    fill(on_disk, plan)
    before = {key: get(on_disk, key) for key in contents(on_disk)}
    for by in (US, "mathematics 2"):  # if a cube is complete, a later version may also restore it
        EDITS[edit](on_disk)
        ((index, what),) = store.verify(on_disk, "toy", repair=True)
        assert index == ()
        assert "rerun the command that computed it" in what
        assert ("row/c/0" if edit == "coordinate" else "zarr.json") in what
        (state,) = store.status(on_disk)
        assert state.damage == what
        store.create(on_disk, plan, by)
        assert {key: get(on_disk, key) for key in contents(on_disk)} == before
        assert missing(on_disk, plan) == set()
    toy.assert_complete(on_disk, plan)


def test_different_settings_are_refused_even_if_metadata_were_edited(on_disk):
    fill(on_disk, toy.cube(depth=3))
    put(on_disk, ROOT, get(on_disk, ROOT).replace(b'"depth": 3', b'"depth": 5'))
    for depth in (5, 7):
        with pytest.raises(store.Refused, match=f"depth is 3, not {depth}"):
            store.create(on_disk, toy.cube(depth=depth), US)


def test_a_cube_without_tiles_is_rewritten_if_its_metadata_were_edited(on_disk):
    store.replace(on_disk, squares(1, depth=3), US)
    key = "squares.zarr/zarr.json"
    for old, new in ((b'"depth": 3', b'"depth": 4'), (b'"units": "1"', b'"units": "m"')):
        whole = get(on_disk, key)
        assert old in whole
        put(on_disk, key, whole.replace(old, new))
        ((index, what),) = store.verify(on_disk, "squares")
        assert (index, "zarr.json" in what) == ((), True)
        store.replace(on_disk, squares(1, depth=3), US)
        assert store.read(on_disk, "squares").attrs["depth"] == 3
        assert store.read(on_disk, "squares").square.attrs["units"] == "1"
        assert list(store.verify(on_disk, "squares")) == []


def test_a_store_without_digests_is_read_but_not_repaired(on_disk):
    plan, chunk = toy.cube(tile=5), "toy.zarr/wave/c/0/1/1"
    fill(on_disk, plan)
    put(on_disk, DIGESTS, None)
    toy.assert_complete(on_disk, plan)
    result = invoke("verify", on_disk)
    assert result.exit_code == 0
    assert result.output.startswith("toy: sound\n  its metadata cannot be checked")
    put(on_disk, chunk, get(on_disk, chunk)[::-1])
    result = invoke("verify", on_disk, "--repair")
    assert (result.exit_code, "toy: 1 tile damaged\n" in result.output) == (1, True)
    assert "not everything is repaired: now rerun the commands" in result.output
    assert missing(on_disk, plan) == set()
    store.create(on_disk, plan, US)
    result = invoke("verify", on_disk, "--repair")
    assert (result.exit_code, "cannot be checked" in result.output) == (0, False)
    assert "repaired: now rerun the commands" in result.output
    assert fill(on_disk, plan) == 1
    toy.assert_complete(on_disk, plan)


def test_repair_of_edited_metadata_exits_with_code_1_and_changes_nothing(on_disk):
    fill(on_disk, toy.cube())
    EDITS["byte order"](on_disk)
    before = contents(on_disk)
    result = invoke("verify", on_disk, "--repair")
    assert (result.exit_code, result.output.startswith("toy: damaged\n  zarr.json of ")) == (
        1,
        True,
    )
    assert "--repair" not in invoke("verify", on_disk).output
    put(on_disk, ".lock", None)
    assert contents(on_disk) == before
    status = invoke("status", on_disk)
    assert (status.exit_code, "zarr.json of" in status.output) == (1, True)


def test_control_characters_in_a_store_are_not_printed(on_disk, tmp_path):
    words = "\x1b]0;title\x07\nother: sound\u202e"
    fill(on_disk, toy.cube(), [(1, 1)])
    put(on_disk, "toy.zarr/.failed/0.0", words.encode())
    shutil.copytree(on_disk.cube("toy"), on_disk.cube("named"))  # to rename a variable to `words`
    os.rename(f"{on_disk}/named.zarr/sign", f"{on_disk}/named.zarr/lost")
    metadata = get(on_disk, ROOT).replace(b'"sign"', json.dumps(words).encode())
    put(on_disk, "named.zarr/zarr.json", metadata)
    put(on_disk, "named.zarr/digests.json", None)
    os.makedirs(tmp_path / f"folder/{words}.zarr")
    for command, out, printed in (
        ("status", on_disk, "tile (0, 0) failed:  ]0;title  other: sound"),
        ("verify", on_disk, " ]0;title  other: sound  cannot be read"),
        ("status", tmp_path / "folder", "invalid path"),
    ):
        output = invoke(command, out).output
        assert printed in output
        assert all(line.isprintable() for line in output.splitlines())
        assert not any(line.startswith("other") for line in output.splitlines())


@pytest.mark.benchmark
def test_a_survey_costs_little_more_than_listing_the_same_files(on_disk, capsys):
    n = 1000
    coords = {dim: xr.Variable(dim, np.arange(n)) for dim in ("row", "column")}
    template = xr.Dataset({"level": blank(coords, "level")}, coords)
    store.create(on_disk, Cube("field", template, dict.fromkeys(coords, 1), {}), US)
    known = store.tiles.arrays_of(on_disk, "field")
    paths = {"field.zarr/level/c": 12, f"field.zarr/{COMMIT}/c/0": 20}
    for path, size in paths.items():
        for row in range(n):
            os.makedirs(folder := f"{on_disk}/{path}/{row}")
            for column in range(n):
                with open(f"{folder}/{column}", "wb") as file:
                    file.truncate(size)  # takes up no disk space
    seconds = {"listed": [], "surveyed": []}
    for _ in range(2):
        start = time.process_time()
        n_files = sum(1 for path in paths for _ in on_disk.files(path))
        listed = time.process_time()
        done, _ = store.tiles.commit_times(on_disk, known)
        seconds["surveyed"].append(time.process_time() - listed)
        seconds["listed"].append(listed - start)
        assert (n_files, done.sum()) == (2 * n**2, n**2)
    ratio = min(seconds["surveyed"]) / min(seconds["listed"])
    with capsys.disabled():
        print(f"\n{n**2} tiles, {n_files} files: {seconds}, ratio {ratio:.2f}")
    shutil.rmtree(on_disk.root)  # pytest would keep these files for a while
    assert ratio < 1.2
