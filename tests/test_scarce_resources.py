"""Runs with a full disk, too little memory, or a second driver of the same cube."""

import io
import resource
import threading
from contextlib import contextmanager

import click
import numpy as np
import pytest
import toy
from test_run import Study, driven

from pipeline import store
from pipeline.cubes.cube import untiled
from pipeline.sweep.progress import Progress
from pipeline.sweep.sweep import sweep
from workflows.shared import run


@contextmanager
def files_of_at_most(n_bytes):
    """Limit the size of files that this process writes, as on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("n_bytes", [20, 100, 1000])
@pytest.mark.parametrize("exists", [False, True])
def test_a_study_on_a_full_disk_fails_with_a_message_and_can_be_completed(
    tmp_path, monkeypatch, exists, n_bytes
):
    if exists:  # a store written by different code
        with monkeypatch.context() as patch:
            patch.setitem(run._CODE, "studied_by", "other code")
            with driven(tmp_path) as one:
                one.kept(untiled("toy"), Study())
    message = r"File too large.*Finished tiles are kept; run the same command again"
    with (
        files_of_at_most(n_bytes),
        pytest.raises(click.ClickException, match=message) as failure,
        driven(tmp_path) as one,
    ):
        one.kept(untiled("toy"), Study())
    assert failure.value.exit_code == 1
    assert "\n" not in failure.value.message
    assert not (tmp_path / "toy.zarr/zarr.json").exists()  # no reader opens a partial cube
    study = Study()
    with driven(tmp_path) as one:
        assert one.kept(untiled("toy"), study).square.values.tolist() == [n**2 for n in range(9)]
    assert study.count == 1
    assert list(store.verify(store.place_of(tmp_path), "toy")) == []
    assert [path for path in tmp_path.rglob("*") if "#" in path.name] == []


def exceed_memory(coords, settings):
    if (coords["row"][0], coords["column"][0]) == (0.0, -1.0):
        np.ones(2**50)
    return toy.compute(coords, settings)


def test_a_tile_that_runs_out_of_memory_fails_alone(here, tmp_path):
    outcome = toy.run(here, tmp_path, toy.cube(), compute=exceed_memory)
    assert (outcome.committed, list(outcome.failed)) == (19, [(0, 0)])
    assert "MemoryError: Unable to allocate" in outcome.failed[0, 0]
    assert toy.run(here, tmp_path, toy.cube()).committed == 1
    toy.assert_complete(tmp_path, toy.cube())


# Drivers are normally separate processes. Here they are threads, which share warning filters: when
# one driver restores the filters, it may remove a filter that the other driver still needs.
@pytest.mark.filterwarnings("ignore:Consolidated metadata")
def test_two_drivers_of_one_cube_lose_nothing(here, place):
    """As on an object store, no lock stops the second driver. The cube is verified meanwhile."""
    plan, job, outcomes, faults = toy.cube(5, 5, 1), toy.job(5, 5, 1), [], []

    def drive():
        outcomes.append(sweep(here, place, job, Progress("toy", io.StringIO())))

    store.create(place, plan, store.COMPUTED_BY)
    drivers = [threading.Thread(target=drive) for _ in range(2)]
    for driver in drivers:
        driver.start()
    while any(driver.is_alive() for driver in drivers):
        faults += store.verify(place, "toy")
        faults += [state for state in store.status(place) if state.damage or state.lost]
        values = store.read(place, "toy").wave.values
        computed = np.isfinite(values)
        assert np.array_equal(values[computed], toy.serial(plan)["wave"][computed])
    assert faults == []
    assert [(one.failed, one.remaining) for one in outcomes] == [({}, 0), ({}, 0)]
    toy.assert_complete(place, plan)
