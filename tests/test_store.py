import dataclasses
import json
import os
import warnings

import numpy as np
import pytest
import toy
import xarray as xr
import zarr
from pipeline.grid import tile_indices, tile_slices

from pipeline import metadata, store


def commit_all(out, plan, indices=None):
    layout = store.create(out, plan)
    everything = {name: coordinate.values for name, coordinate in plan.template.coords.items()}
    for index in indices or tile_indices(plan.sizes, plan.tile):
        slices = tile_slices(index, plan.sizes, plan.tile)
        coords = {dim: values[slices.get(dim, slice(None))] for dim, values in everything.items()}
        store.commit(layout, index, toy.compute(coords, {}), 0.25)
    return layout


def contents(out):
    return {path: path.stat().st_mtime_ns for path in out.rglob("*")}


def test_what_is_committed_tile_by_tile_reads_back_whole(tmp_path):
    plan = toy.cube()
    with store.driving(tmp_path):
        layout = commit_all(tmp_path, plan)
        assert len(store.missing(layout)) == 0
    cube = store.read(tmp_path, "toy")
    for name, values in toy.serial(plan).items():
        assert np.array_equal(cube[name].values, values)
        assert cube[name].dtype == values.dtype
    assert (cube.cpu_seconds == 0.25).all()


def test_a_plain_xarray_opens_the_store_without_a_warning(tmp_path):
    with store.driving(tmp_path):
        commit_all(tmp_path, toy.cube(depth=3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cube = xr.open_zarr(tmp_path / store.STORE, group="toy")
        tree = xr.open_datatree(tmp_path / store.STORE, engine="zarr")
    assert cube.attrs["depth"] == 3
    assert {"config_hash", "package_version", "git_commit", "created"} <= set(cube.attrs)
    assert tree["toy"].wave.attrs["units"] == "1"


def test_metadata_are_gathered_as_zarr_does(tmp_path):
    with store.driving(tmp_path):
        commit_all(tmp_path, toy.cube(depth=3))
        store.replace(tmp_path, dataclasses.replace(toy.cube(), name="other"))
    root = tmp_path / store.STORE / "zarr.json"
    ours = json.loads(root.read_bytes())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(tmp_path / store.STORE)
    assert json.loads(root.read_bytes()) == ours


@pytest.mark.parametrize("write", [store.create, store.replace])
def test_metadata_that_a_killed_driver_did_not_gather_are_gathered_by_the_next(
    tmp_path, monkeypatch, write
):
    def die(place):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(metadata, "consolidate", die)
        with pytest.raises(KeyboardInterrupt), store.driving(tmp_path):
            write(tmp_path, toy.cube())
    with store.driving(tmp_path):
        write(tmp_path, toy.cube())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert xr.open_zarr(tmp_path / store.STORE, group="toy").attrs["title"] == "toy"
    assert set(xr.open_datatree(tmp_path / store.STORE, engine="zarr").children) == {"toy"}


def test_a_tile_is_missing_until_its_commit_record_is_written(tmp_path):
    plan = toy.cube()
    with store.driving(tmp_path):
        layout = commit_all(tmp_path, plan, [(0, 0), (3, 4)])
        assert not store.is_committed(layout, (1, 1))
        missing = set(map(tuple, store.missing(layout).tolist()))
        assert missing == set(tile_indices(plan.sizes, plan.tile)) - {(0, 0), (3, 4)}
    seconds = store.read(tmp_path, "toy").cpu_seconds
    assert np.isfinite(seconds).sum() == 2


def test_a_tile_that_lost_data_in_a_power_cut_is_missing_again(tmp_path):
    plan = toy.cube()
    with store.driving(tmp_path):
        layout = commit_all(tmp_path, plan)
        chunks = tmp_path / store.STORE / "toy" / "sign" / "c"
        (chunks / "1" / "2").write_bytes(b"")
        (chunks / "3" / "0").unlink()
        (chunks / ".DS_Store").write_bytes(bytes(13))  # of a file browser, as long as a chunk
        (chunks / "1" / "x").write_bytes(bytes(13))
        assert store.missing(layout).tolist() == [[1, 2], [3, 0]]


def test_a_chunk_of_fill_values_is_stored_like_any_other(tmp_path):
    plan = toy.cube(tile=13)
    with store.driving(tmp_path):
        layout = store.create(tmp_path, plan)
        empty = {"wave": np.full((2, 10, 13), np.nan), "sign": np.zeros((10, 13))}
        store.commit(layout, (0, 0), empty, 1.0)
        assert len(store.missing(layout)) == 0
    assert np.isnan(store.read(tmp_path, "toy").wave).all()


def test_the_same_cube_is_resumed_and_another_is_refused(tmp_path):
    with store.driving(tmp_path):
        store.create(tmp_path, toy.cube(depth=1))
        store.create(tmp_path, toy.cube(depth=1))
        before = contents(tmp_path)
        with pytest.raises(store.StoreError, match="depth is 1, not 2"):
            store.create(tmp_path, toy.cube(depth=2))
        with pytest.raises(store.StoreError, match="the values of row differ"):
            store.create(tmp_path, toy.cube(rows=11, depth=1))
        with pytest.raises(store.StoreError, match="tiles or variables differ"):
            store.create(tmp_path, toy.cube(tile=4, depth=1))
        assert contents(tmp_path) == before


def test_a_second_driver_is_refused(tmp_path):
    with (
        store.driving(tmp_path),
        pytest.raises(store.StoreError, match=f"another run \\(process {os.getpid()}\\)"),
        store.driving(tmp_path),
    ):
        pass
    with store.driving(tmp_path):
        pass


def test_a_foreign_directory_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("draft")
    before = contents(tmp_path)
    with pytest.raises(store.StoreError, match="holds other files"), store.driving(tmp_path):
        pass
    assert contents(tmp_path) == before


def test_a_file_is_no_directory(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(store.StoreError, match="is a file"), store.driving(file):
        pass


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs a directory root cannot write")
def test_an_unwritable_directory_is_refused():
    with pytest.raises(store.StoreError, match="cannot write"), store.driving("/proc/self/none"):
        pass


def test_a_store_of_another_version_is_refused_and_left_alone(tmp_path):
    zarr.create_group(tmp_path / store.STORE, attributes={"format": "nasm-cubes/0"})
    before = contents(tmp_path)
    with pytest.raises(store.StoreError, match="nasm-cubes/0"), store.driving(tmp_path):
        pass
    assert contents(tmp_path) == before


def test_leftovers_of_a_killed_writer_are_cleared(tmp_path):
    with store.driving(tmp_path):
        pass
    aside = tmp_path / ".partial"
    aside.mkdir()
    (aside / "half-written").write_bytes(b"12")
    with store.driving(tmp_path):
        assert list(aside.iterdir()) == []
    assert not aside.exists()


def test_replacing_a_cube_keeps_the_others(tmp_path):
    plan = toy.cube()
    with store.driving(tmp_path):
        commit_all(tmp_path, plan)
        for factor in (1, 2):
            template = plan.template.assign(wave=plan.template.wave + factor)
            store.replace(tmp_path, dataclasses.replace(plan, name="other", template=template))
            assert (store.read(tmp_path, "other").wave == factor).all()
        with pytest.raises(store.StoreError, match="other settings"):
            store.replace(tmp_path, dataclasses.replace(plan, name="other", settings={"depth": 1}))
        assert (store.read(tmp_path, "other").wave == 2).all()
    tree = xr.open_datatree(tmp_path / store.STORE, engine="zarr")
    assert set(tree.children) == {"toy", "other"}
    assert np.array_equal(tree["toy"].wave.values, toy.serial(plan)["wave"])
