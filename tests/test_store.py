"""Guarantees of the store, for both kinds of place: a directory and an S3-compatible object store.

Here tiles are committed one by one; `test_sweep` and `test_random_faults` test sweeps that fail or
are interrupted.
"""

import dataclasses
import errno
import json
import os
import pickle
import re
import resource
import time
import warnings
from asyncio.selector_events import BaseSelectorEventLoop
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib.metadata import version
from pathlib import Path
from threading import Barrier, Timer, _DummyThread, current_thread

import numpy as np
import pytest
import seaweed
import toy
import xarray as xr
import zarr
from cases import thirds
from obstore.store import S3Store
from zarr.storage import ObjectStore

from pipeline import store
from pipeline.cubes.cube import Cube
from pipeline.provenance import EVERYTHING
from pipeline.store import decoding
from pipeline.store import place as places
from pipeline.store.tiles import COMMIT
from pipeline.sweep.grid import tile_slices

ROOT = Path(__file__).parents[1]
US = "mathematics 1"
SLOW = pytest.mark.slow


def arrays(plan, index):
    """Return the arrays that a worker computes for a tile."""
    slices = tile_slices(index, plan.tile)
    coords = plan.template.coords.items()
    return toy.compute({dim: c.values[slices.get(dim, slice(None))] for dim, c in coords}, {})


def fill(place, plan, indices=None):
    """Commit tiles, by default all missing ones; return their number."""
    store.create(place, plan, US)
    chosen = store.missing(place, plan).tolist() if indices is None else indices
    for index in map(tuple, chosen):
        store.commit(place, plan.name, index, arrays(plan, index), 0.25)
    return len(chosen)


def missing(place, plan):
    return set(map(tuple, store.missing(place, plan).tolist()))


def get(place, key):
    return bytes(place.objects().get(key).bytes())


def put(place, key, data):
    """Write the file, or delete it if data is None."""
    if data is None:
        place.objects().delete(key)
    else:
        place.objects().put(key, data)


def contents(place):
    files = [file for page in place.objects().list() for file in page]
    return {file["path"]: (file["e_tag"], file["last_modified"]) for file in files}


def test_committed_tiles_are_read_by_plain_xarray_and_contain_no_secret(place):
    plan, path = toy.cube(depth=3), place.cube("toy")
    assert (fill(place, plan), fill(place, plan)) == (20, 0)
    toy.assert_complete(place, plan)
    for index, tile in store.tiles_of(place, "toy"):
        assert np.array_equal(tile.wave, arrays(plan, index)["wave"])
    store.record_failure(place, "toy", (0, 0), "for once")
    if not place.is_directory:
        path = ObjectStore(
            S3Store("cubes", prefix=path.removeprefix("s3://cubes/")), read_only=True
        )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cube, records = xr.open_zarr(path), xr.open_zarr(path, group="tiles")
        assert np.array_equal(cube.wave, toy.serial(plan)["wave"])
        assert len(cube.to_dataframe()) == cube.wave.size  # the data contain no commit records
        assert records.commit.shape == (2, 4, 5)
    assert cube.attrs | {"title": "toy", "depth": 3} == cube.attrs
    provenance = {"config_hash", "source", "history", "computed_by", "package_version", "created"}
    assert provenance <= cube.attrs.keys()
    assert cube.wave.attrs["units"] == "1"
    written = [get(place, key) for key in contents(place)]
    for text in (*written, pickle.dumps(place), repr(place).encode()):
        assert seaweed.SECRET.encode() not in text
        assert b"somebody" not in text


def test_results_are_delivered_only_by_threads_that_python_started(place, monkeypatch):
    # When Python exits, it ends any other thread wherever it is, which aborts the process.
    threads, wake = [], BaseSelectorEventLoop._write_to_self

    def recorded(loop):
        threads.append(current_thread())
        wake(loop)

    monkeypatch.setattr(BaseSelectorEventLoop, "_write_to_self", recorded)
    plan = toy.cube()
    fill(place, plan)
    assert np.array_equal(store.read(place, "toy").wave, toy.serial(plan)["wave"])
    assert list(store.verify(place, "toy")) == []
    assert threads
    assert not [thread for thread in threads if isinstance(thread, _DummyThread)]


class Cut(Exception):
    """Raised where the process would be killed."""


@contextmanager
def killed_at_put(monkeypatch, n):
    """Interrupt the block, as a kill would, just before write number n, counted from 0."""
    puts = iter(range(1000))

    def cut(put):
        def counted(self, *args, **kwargs):
            if next(puts) == n:
                raise Cut
            return put(self, *args, **kwargs)

        return counted

    with monkeypatch.context() as patch:
        patch.setattr(decoding.Files, "set", cut(decoding.Files.set))
        patch.setattr(store.Place, "write", cut(store.Place.write))
        with pytest.raises(Cut):
            yield


@pytest.mark.parametrize("n", thirds([0, 1, 2, 5, 8, *range(13, 20)]))
def test_a_run_killed_before_any_of_its_writes_is_completed_by_the_next(on_disk, monkeypatch, n):
    plan, other = (toy.cube(tile=10, depth=depth) for depth in (1, 2))  # cubes with two tiles
    with killed_at_put(monkeypatch, n):
        fill(on_disk, plan)
    if n:  # part of the cube exists; different settings are refused
        with pytest.raises(store.Refused, match="depth is 1, not 2"):
            store.create(on_disk, other, US)
    records = [key for key in contents(on_disk) if f"/{COMMIT}/c/" in key]
    assert fill(on_disk, plan) == 2 - len(records)  # a tile's record is written last
    toy.assert_complete(on_disk, plan)


def test_tiles_that_do_not_fit_are_refused_but_fill_values_are_stored(on_disk):
    store.create(on_disk, toy.cube(tile=13), US)
    empty = {"wave": np.full((2, 10, 13), np.nan), "sign": np.zeros((10, 13))}
    wrong = np.zeros((10, 12)), 1, np.full((10, 13), np.nan), np.full((10, 13), 128)
    for values in (*wrong, np.zeros((10, 13), complex)):
        with pytest.raises(ValueError, match="sign "):
            store.commit(on_disk, "toy", (0, 0), empty | {"sign": values}, 1.0)
        assert not store.is_committed(on_disk, "toy", (0, 0))
    store.commit(on_disk, "toy", (0, 0), empty, 0.0)
    assert not missing(on_disk, toy.cube(tile=13))
    assert np.isnan(store.read(on_disk, "toy").wave).all()


def test_foreign_files_and_timestamps_do_not_affect_which_tiles_count(on_disk):
    fill(on_disk, toy.cube())
    for name in (".DS_Store", "0/7", "0/1/x", "x/y/z", "0/9/9", "1/2/3", "0/1/-4", "0/-3/1"):
        put(on_disk, f"toy.zarr/{COMMIT}/c/{name}", bytes(20))
    put(on_disk, f"toy.zarr/{COMMIT}/c/0/1/1", None)
    for i, key in enumerate(contents(on_disk)):  # timestamps do not matter either
        os.utime(f"{on_disk}/{key}", (0, 0) if i % 2 else (4e9, 4e9))
    assert missing(on_disk, toy.cube()) == {(1, 1)}


def test_a_cube_records_the_program_and_the_call_that_made_it(place):
    plan = toy.cube(depth=1)
    store.create(place, plan, US, "pipeline.fill(job, 's3://me:secret@host/rays')\n")
    attributes = store.read(place, "toy").attrs
    assert re.fullmatch(r"nasm-transport \d+\.\d+\.\d+\S*", attributes["source"])
    assert "1606.04824" in attributes["references"]
    call = "pipeline.fill(job, 's3://host/rays')"
    assert attributes["history"] == f"{attributes['created']} {call} "
    before = contents(place)
    fill(place, plan, [])  # without the text of a call
    store.create(place, plan, US, "another call")
    assert contents(place) == before
    assert plan.config_hash == toy.cube(depth=1).config_hash == attributes["config_hash"]
    store.replace(place, squares(1), US, "nasm-transport squares")
    before = contents(place)
    store.replace(place, squares(1), US, "another call")
    assert contents(place) == before
    assert store.read(place, "squares").attrs["history"].endswith("+00:00 nasm-transport squares")


def test_a_cube_from_an_earlier_version_keeps_the_record_of_its_origin(on_disk, monkeypatch):
    """Earlier cubes name the paper as their source and have no history."""
    earlier = {"source": "arXiv:1606.04824", "computed_by": US, "created": "2026-01-01"}
    plan = toy.cube()
    with monkeypatch.context() as patch:
        patch.setattr("pipeline.store.metadata._provenance", lambda *_: earlier)
        old = dataclasses.replace(plan, template=plan.template.assign_attrs(title="an old title"))
        fill(on_disk, old, [(0, 0)])
    with pytest.raises(store.Refused, match=r"this is mathematics 2\. Resume it with"):
        store.create(on_disk, plan, "mathematics 2")
    fill(on_disk, plan)
    store.create(on_disk, plan, "mathematics 2")
    attributes, before = store.read(on_disk, "toy").attrs, contents(on_disk)
    assert attributes == attributes | earlier | {"title": "toy"}
    assert "history" not in attributes
    store.create(on_disk, plan, "mathematics 2", "another call")
    assert contents(on_disk) == before
    assert list(store.verify(on_disk, "toy")) == []
    toy.assert_complete(on_disk, plan)


def test_different_settings_or_code_are_refused_for_an_incomplete_cube(place):
    plan, unlike = toy.cube(depth=1), "coordinates, tiles, variables or format differ"
    fill(place, plan, [(0, 0)])
    before = contents(place)
    store.create(place, plan, US)
    for other, by, message in (
        (toy.cube(depth=2), US, "depth is 1, not 2"),
        (toy.cube(rows=11, depth=1), US, unlike),
        (toy.cube(tile=4, depth=1), US, unlike),
        (plan, "mathematics 2", "by mathematics 1; this is mathematics 2"),
    ):
        for refuse in (store.check, store.create):
            with pytest.raises(store.Refused, match=message):
                refuse(place, other, by)
    assert contents(place) == before
    fill(place, plan)
    store.create(place, plan, "mathematics 2")
    assert store.read(place, "toy").attrs["computed_by"] == US


def test_a_second_driver_or_one_that_cannot_write_is_refused(on_disk, tmp_path):
    with store.driver_lock(on_disk):
        second = store.driver_lock(store.place_of(on_disk.root))
        with pytest.raises(store.Refused, match="another run"), second:
            pass
    with store.driver_lock(on_disk):
        pass
    (tmp_path / "file").write_text("")
    held = store.driver_lock(store.place_of(tmp_path / "file"))
    with pytest.raises(store.Refused, match="cannot write"), held:
        pass


@pytest.mark.parametrize(
    "error",
    [NotImplementedError("use SoftFileLock")]
    + [OSError(number, "no locks") for number in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)],
)
def test_a_file_system_without_locks_is_used_without_a_lock(tmp_path, monkeypatch, error):
    def acquire(*_, **__):
        raise error

    monkeypatch.setattr("pipeline.store.place.FileLock.acquire", acquire)
    with store.driver_lock(place := store.place_of(tmp_path)):
        fill(place, toy.cube())
    toy.assert_complete(tmp_path, toy.cube())


def test_global_zarr_settings_do_not_change_a_cube(tmp_path):
    """A user may select a different codec pipeline, which may support only local files."""
    theirs = {"codec_pipeline.path": "nowhere.Pipeline", "default_zarr_format": 2}
    with zarr.config.set(theirs | {"array.order": "F", "array.write_empty_chunks": False}):
        fill(place := store.place_of(tmp_path), toy.cube())
        read = store.read(place, "toy").load()
        assert zarr.config.get("codec_pipeline.path") == "nowhere.Pipeline"
    assert np.array_equal(read.wave, toy.serial(toy.cube())["wave"])
    toy.assert_complete(tmp_path, toy.cube())


@pytest.mark.filterwarnings("ignore:Consolidated metadata")  # threads share warning filters
def test_if_several_threads_create_a_cube_at_once_exactly_one_succeeds(place):
    n, together = 4, Barrier(4)

    def make(depth):
        together.wait()
        try:
            store.create(place, toy.cube(depth=depth), US)
        except store.Refused:
            return None
        return depth

    with ThreadPoolExecutor(n) as pool:
        won = [depth for depth in pool.map(make, range(n)) if depth is not None]
    assert len(won) == 1
    assert store.read(place, "toy").attrs["depth"] == won[0]
    assert fill(place, toy.cube(depth=won[0])) == 20


def from_another_program(place, zarr_format=3):
    precious = xr.Dataset({"precious": ("x", [1.0])})
    precious.to_zarr(place.cube("toy"), consolidated=False, zarr_format=zarr_format)


def in_an_earlier_format(place):
    fill(place, toy.cube())
    key = "toy.zarr/zarr.json"
    put(place, key, get(place, key).replace(b"store_format", b"other_format"))
    put(place, "toy.zarr/digests.json", None)
    assert np.array_equal(store.read(place, "toy").wave, toy.serial(toy.cube())["wave"])


def with_pickles(place):
    """Write a store in zarr format 2, whose arrays may name a codec that unpickles their data."""
    from_another_program(place, 2)
    with pytest.raises(store.StoreFailed):
        store.read(place, "toy")


@pytest.mark.filterwarnings("ignore:Failed to open Zarr store with consolidated metadata")
@pytest.mark.parametrize("make", [from_another_program, with_pickles, in_an_earlier_format])
def test_a_group_from_another_program_or_version_is_refused_and_unchanged(on_disk, make):
    make(on_disk)
    before = contents(on_disk)
    message = "or format differ" if make is in_an_earlier_format else "not a cube from this program"
    for refuse in (store.check, store.create, store.replace):
        with pytest.raises(store.Refused, match=message):
            refuse(on_disk, toy.cube(), US)
    (state,), (damaged,) = store.status(on_disk), store.verify(on_disk, "toy", repair=True)
    assert damaged == ((), state.damage)
    assert "from another program, or in an earlier format" in state.damage
    assert contents(on_disk) == before


def flipped(data, i):
    return data[:i] + bytes([data[i] ^ 1]) + data[i + 1 :]


def test_repair_removes_damaged_and_misplaced_tiles_but_no_others(place, tmp_path):
    plan, other = toy.cube(), store.place_of(tmp_path)
    fill(place, plan)
    fill(other, toy.cube(depth=2), [(3, 0)])
    chunk = get(place, "toy.zarr/wave/c/0/1/2")
    record = get(place, f"toy.zarr/{COMMIT}/c/0/2/4")
    put(place, "toy.zarr/wave/c/0/1/2", flipped(chunk, 17))
    put(place, "toy.zarr/wave/c/0/0/0", chunk[:-9])
    put(place, "toy.zarr/sign/c/3/4", None)
    put(place, f"toy.zarr/{COMMIT}/c/0/2/4", flipped(record, 0))
    put(place, f"toy.zarr/{COMMIT}/c/0/1/1", b"")
    damaged = {(1, 2), (0, 0), (3, 4), (2, 4), (1, 1)}
    moved = {"wave/c/0/0/1": "wave/c/0/1/0", "wave/c/0/1/0": "wave/c/0/0/1"}  # in one variable only
    for key in ("wave/c/0/2/", "sign/c/2/", f"{COMMIT}/c/0/2/"):  # a tile with its record
        moved[f"{key}1"] = f"{key}2"
    chunks = {to: get(place, f"toy.zarr/{key}") for key, to in moved.items()}
    chunks[f"{COMMIT}/c/0/3/0"] = get(other, f"toy.zarr/{COMMIT}/c/0/3/0")  # from another cube
    for key, sound in chunks.items():
        put(place, f"toy.zarr/{key}", sound)
    exchanged = {(0, 1), (1, 0), (2, 2), (3, 0)}
    result = dict(store.verify(place, "toy"))
    assert result.keys() == damaged | exchanged
    assert result[1, 2] == "wave does not match its checksum"
    words = {result[index] for index in exchanged}
    assert words == {"its data differ from what was committed"}
    assert missing(place, plan) == {(0, 0), (3, 4), (1, 1)}  # a file is missing or truncated
    assert dict(store.verify(place, "toy", repair=True)) == result
    assert missing(place, plan) == result.keys()
    assert np.isfinite(toy.records(place)).sum() == 11
    assert fill(place, plan) == 9
    toy.assert_complete(place, plan)


@pytest.mark.parametrize("cut", [slice(None, -1), slice(0), slice(1, None), slice(0, 3)])
def test_plain_xarray_refuses_a_damaged_chunk(on_disk, cut):
    fill(on_disk, toy.cube(tile=13))
    key = "toy.zarr/wave/c/0/0/0"
    put(on_disk, key, get(on_disk, key)[cut])
    with pytest.raises(ValueError, match="checksum"):
        xr.open_zarr(on_disk.cube("toy")).wave.load()
    with pytest.raises(store.StoreFailed, match="--repair"), store.store_errors(on_disk):
        store.read(on_disk, "toy").wave.load()


LOST = [("zarr.json", lost) for lost in (None, b"", b"{", b"[]")]
LOST += [("row/c/0", None), ("row/c/0", b"1234567890123456"), ("digests.json", b"{")]
LOST += [(key, lost) for key in ("wave/zarr.json", f"{COMMIT}/zarr.json") for lost in (None, b"{")]


@pytest.mark.parametrize("case", thirds(LOST))
def test_lost_metadata_are_restored_only_by_a_run_with_the_same_settings(on_disk, case):
    plan, (key, lost) = toy.cube(tile=5, depth=3), case
    fill(on_disk, plan)
    put(on_disk, f"toy.zarr/{key}", lost)
    assert [index for index, _ in store.verify(on_disk, "toy")] == [()]
    with pytest.raises(store.Refused, match=r"depth is 3, not 5|its metadata are lost"):
        store.create(on_disk, toy.cube(tile=5, depth=5), US)
    assert fill(on_disk, plan) == 0
    assert get(on_disk, f"toy.zarr/{key}") not in (lost, b"")
    toy.assert_complete(on_disk, plan)


def test_tiles_without_metadata_are_reused_only_with_the_same_settings(place):
    plan = toy.cube()
    fill(place, plan)
    for key in contents(place):
        if key.endswith((".json", "/row/c/0")):
            put(place, key, None)
    before = contents(place)
    for other, by in ((toy.cube(depth=2), US), (plan, "mathematics 2")):
        for refuse in (store.check, store.create):
            with pytest.raises(store.Refused, match="metadata are lost"):
                refuse(place, other, by)
    assert contents(place) == before
    put(place, "toy.zarr/wave/c/0/1/2", None)  # as if deleted just before its record was written
    assert fill(place, plan) == 1
    toy.assert_complete(place, plan)


def test_a_worker_does_not_recreate_a_cube_that_has_disappeared(on_disk, tmp_path):
    plan = toy.cube()
    fill(on_disk, plan, [(0, 0)])
    os.rename(on_disk.cube("toy"), tmp_path / "away")
    with pytest.raises(store.StoreFailed, match="its disk was removed"):
        store.commit(on_disk, "toy", (1, 1), arrays(plan, (1, 1)), 0.25)
    with pytest.raises(store.StoreFailed, match="its disk was removed"):
        store.record_failure(on_disk, "toy", (1, 1), "no answer")
    assert os.listdir(on_disk.root) == []


def test_a_missing_chunk_reads_as_fill_values_with_any_version_of_xarray(on_disk):
    plan = toy.cube()
    fill(on_disk, plan)
    for key in ("wave/c/0/1/2", "sign/c/1/2"):
        put(on_disk, f"toy.zarr/{key}", None)
    cube, cells = xr.open_zarr(on_disk.cube("toy")), tile_slices((1, 2), plan.tile)
    assert np.isnan(cube.wave.isel(cells)).all()
    assert cube.sign.dtype == np.int8
    assert (cube.sign.isel(cells) == -128).all()
    written = [json.loads(get(on_disk, key)) for key in contents(on_disk) if "zarr.json" in key]
    fills = {array["data_type"]: array["fill_value"] for array in written if "shape" in array}
    assert fills == {"float64": "NaN", "int8": -128, "int64": -(2**63)}


def squares(factor, **settings):
    square = ("x", factor * np.arange(5.0) ** 2, {"units": "1"})
    template = xr.Dataset({"square": square}, {"x": np.arange(5)})
    return Cube("squares", template, {}, settings)


def test_replacing_a_cube_stores_the_new_one_and_leaves_others_unchanged(place):
    fill(place, toy.cube())
    before = contents(place)
    for factor in (1, 2, 2):
        store.replace(place, squares(factor), US)
        assert np.array_equal(store.read(place, "squares").square, factor * np.arange(5.0) ** 2)
        assert list(store.verify(place, "squares")) == []
    after = contents(place)
    store.replace(place, squares(2), US)  # the same numbers
    assert contents(place) == after
    store.replace(place, squares(2), "mathematics 2")  # the same numbers, from different code
    assert store.read(place, "squares").attrs["computed_by"] == "mathematics 2"
    assert before.items() <= contents(place).items()
    with pytest.raises(store.Refused, match="depth is None, not 1"):
        store.replace(place, squares(2, depth=1), US)
    store.check(place, squares(2), "mathematics 3")
    assert store.names(place) == ["squares", "toy"]


WHOLE = ("zarr.json", b""), ("square/c/0", b"1234567890123456"), ("x/c/0", None)


@pytest.mark.parametrize("case", thirds([*WHOLE, *range(5)]))
def test_an_untiled_cube_is_rewritten_if_damaged_or_incomplete(on_disk, monkeypatch, case):
    store.replace(on_disk, squares(1), US)
    if isinstance(case, int):
        with killed_at_put(monkeypatch, case):
            store.replace(on_disk, squares(2), US)
        with pytest.raises(store.StoreFailed):
            store.read(on_disk, "squares")
    else:
        put(on_disk, f"squares.zarr/{case[0]}", case[1])
    assert {index for index, _ in store.verify(on_disk, "squares")} == {()}
    store.replace(on_disk, squares(1), US)
    assert np.array_equal(store.read(on_disk, "squares").square, np.arange(5.0) ** 2)
    assert list(store.verify(on_disk, "squares")) == []


def test_a_full_disk_ends_a_sweep_at_once_and_the_next_run_completes_it(here, on_disk):
    plan, limits = toy.cube(8, 8, tile=1), resource.getrlimit(resource.RLIMIT_FSIZE)
    fills = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (10, limits[1]))  # bytes per file
    with ExitStack() as after:
        after.callback(resource.setrlimit, resource.RLIMIT_FSIZE, limits)
        with pytest.raises(store.StoreFailed, match=f"^{on_disk}[^\n]*File too large[^\n]*$"):
            toy.watched_sweep(here, on_disk, plan, {20: fills})
    assert len(toy.COMPUTED) < 30  # it stopped before all 64 tiles failed in turn
    assert toy.watched_sweep(here, on_disk, plan).remaining == 0
    assert 34 < len(toy.COMPUTED) < 54
    toy.assert_complete(on_disk, plan)


def test_an_error_raised_elsewhere_is_not_attributed_to_the_store(on_disk, tmp_path):
    with pytest.raises(ConnectionError, match="gone"), store.store_errors(on_disk):
        raise ConnectionError("the scheduler is gone")
    with pytest.raises(FileNotFoundError, match="table"), store.store_errors(on_disk):
        (tmp_path / "table").read_text()


@SLOW
def test_a_lost_server_is_awaited_and_finally_reported_in_one_message(tmp_path, monkeypatch):
    plan = toy.cube(tile=10)
    with seaweed.serving(tmp_path) as (kill, start):
        place = store.place_of("s3://cubes/run")
        fill(place, plan, [(0, 0)])
        kill()
        # The server is restarted after 5 s and needs another 5 to 20 s to become ready; with
        # its default of ten retries, obstore would give up after 2 to 8 s.
        back = Timer(5, start)
        back.start()
        assert fill(place, plan) == 1
        back.join()
        toy.assert_complete(place, plan)
        monkeypatch.setattr(places, "PATIENCE", 1)
        places._opened.cache_clear()
        place = store.place_of("s3://cubes/other")
        fill(place, plan, [(0, 0)])
        with monkeypatch.context() as patch:
            patch.setenv("AWS_SECRET_ACCESS_KEY", "another-secret")
            places._opened.cache_clear()
            with pytest.raises(store.StoreFailed, match=r"^s3://cubes/other: ") as refused:
                store.missing(place, plan)
        places._opened.cache_clear()
        kill()
        with pytest.raises(store.StoreFailed, match=r"^s3://cubes/other: ") as gone:
            store.commit(place, "toy", (0, 1), arrays(plan, (0, 1)), 1.0)
    for failed in (refused, gone):
        assert len(str(failed.value)) < 300
        assert "secret" not in str(failed.value).lower()
        assert "Signature=" not in str(failed.value)


URLS = "s3://user:password@bucket/run", "s3://bucket/run?key=password", "s3://bucket"


@pytest.mark.parametrize("url", [*URLS, "http://host/password", "s3://Bucket name/password"])
def test_a_malformed_url_is_refused_without_repeating_its_password(url):
    with pytest.raises(store.Refused, match="must be s3://BUCKET/PREFIX") as refused:
        store.place_of(url)
    assert "password" not in str(refused.value).replace("user, password", "")


def test_an_endpoint_that_is_not_a_url_is_reported_in_one_message():
    failed = pytest.raises(store.StoreFailed, match=r"^s3://cubes/run: ")
    with seaweed.environment("no url"), failed:
        store.names(store.place_of("s3://cubes/run"))


ODD = "ünï λ #1", "100%25", "new\nline", "./~", "-x[a]*?", "quote'\"a:b::c"


@pytest.mark.parametrize("name", thirds(ODD))
def test_a_directory_may_have_any_name(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    place, plan = store.place_of(name), toy.cube(tile=10)
    with store.driver_lock(place):
        assert fill(place, plan) == 2
    toy.assert_complete(place, plan)


def test_status_counts_tiles_and_failures_and_reports_reasons(place):
    assert list(store.status(place)) == []
    plan = toy.cube()
    store.create(place, plan, US)
    for index in [(0, 0), (1, 1), (2, 2)]:
        store.record_failure(place, "toy", index, "no words")
    fill(place, plan, [(1, 1), (0, 1)])
    store.replace(place, squares(1), US)
    before = contents(place)
    whole, state = store.status(place)
    assert (state.tiles, state.done, state.failed) == (20, 2, 2)
    assert state.reasons == {(0, 0): "no words", (2, 2): "no words"}
    assert (whole.name, whole.tiles, whole.damage) == ("squares", 0, "")
    assert contents(place) == before


def test_status_gives_the_rate_of_recent_tiles_despite_a_damaged_cube(on_disk):
    tiles = list(np.ndindex(4, 3))
    fill(on_disk, toy.cube(), tiles)
    for i, (row, column) in enumerate(tiles):
        written = (0 if i < 6 else 5000) + 10 * i
        os.utime(f"{on_disk}/toy.zarr/{COMMIT}/c/0/{row}/{column}", (written, written))
    fill(on_disk, dataclasses.replace(toy.cube(), name="other"))
    put(on_disk, "other.zarr/zarr.json", b"{")
    other, state = store.status(on_disk)
    assert "rerun the command that computed it" in other.damage
    assert (state.done, state.damage) == (12, "")
    assert state.rate == pytest.approx(0.1)


@pytest.mark.benchmark
def test_committing_a_tile_takes_at_most_1_5_times_as_long_as_zarr(on_disk, capsys):
    store.create(on_disk, toy.line(600).cube, US)
    one, seconds = np.ones((1, 256)), []
    array = store.tiles.arrays_of(on_disk, "line")["level"]
    for i in range(600):
        start = time.process_time()
        store.commit(on_disk, "line", (i,), {"level": one}, 0.0)
        ours = time.process_time()
        array[i : i + 1] = one
        seconds.append((ours - start, time.process_time() - ours))
    each, zarrs = np.median(seconds, axis=0)
    with capsys.disabled():
        print(f"\n{1e3 * each:.2f} ms of CPU time per tile, of which zarr takes {2e3 * zarrs:.2f}")
    assert each < 1.5 * 2 * zarrs  # two arrays: the data and the record


def test_the_recorded_code_covers_all_modules_of_nasm_and_of_the_cubes():
    assert f"numba {version('numba')}, " in store.COMPUTED_BY
    modules = {*EVERYTHING.modules}
    assert {"nasm.maps", "nasm.circles.newton", "pipeline.cubes.escape"} <= modules
    assert not any(name.startswith(("pipeline.s", "workflows")) for name in modules)
