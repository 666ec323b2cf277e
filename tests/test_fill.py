"""Fill cubes from Python: `pipeline.fill` computes the missing tiles, on workers of any kind."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import toy
import xarray as xr
from distributed import Client

import pipeline
from pipeline import store
from pipeline.sweep import fill as fills

ROOT = Path(__file__).parents[1]


def assert_filled(cube, plan):
    for name, values in toy.serial(plan).items():
        np.testing.assert_array_equal(cube[name], values)


def test_a_cube_is_filled_and_then_read_without_workers(here, tmp_path, monkeypatch, capsys):
    job = toy.job()
    cube = pipeline.fill(job, tmp_path, here())
    assert_filled(cube, job.cube)
    assert "done: 100%" in capsys.readouterr().err
    xr.testing.assert_identical(cube.load(), store.read(store.place_of(tmp_path), "toy").load())

    def refuse(*_, **__):
        raise AssertionError("workers were started although nothing is missing")

    monkeypatch.setattr("distributed.LocalCluster", refuse)
    xr.testing.assert_identical(pipeline.fill(job, str(tmp_path), progress=False), cube)
    assert capsys.readouterr() == ("", "")


def test_a_client_is_checked_before_anything_is_written(here, tmp_path):
    with pytest.raises(pipeline.ClusterError, match="leave workers=2 out"):
        pipeline.fill(toy.job(), tmp_path, here(), workers=2)
    with Client(here().scheduler.address, set_as_default=False) as closed:
        pass
    with pytest.raises(pipeline.ClusterError, match="client is closed; connect a new one"):
        pipeline.fill(toy.job(), tmp_path, closed)
    assert list(tmp_path.iterdir()) == []


def test_failed_tiles_raise_an_exception_and_the_others_are_stored(here, tmp_path):
    job = toy.job(raises=[0.0, -1.0])
    with pytest.raises(
        pipeline.TilesFailed, match=r"1 tile of toy failed: \(0, 0\), Arithm"
    ) as one:
        pipeline.fill(job, tmp_path, here(), progress=False)
    assert list(one.value.failed) == [(0, 0)]
    assert len(store.missing(store.place_of(tmp_path), job.cube)) == 1


def test_filling_a_cube_with_different_settings_raises_an_exception(here, tmp_path):
    pipeline.fill(toy.job(), tmp_path, here(), progress=False)
    with pytest.raises(pipeline.Refused, match="depth is None, not 2"):
        pipeline.fill(toy.job(depth=2), tmp_path, here(), progress=False)


# Threads share warning filters: when one thread restores them, another may lose a filter it needs.
@pytest.mark.filterwarnings("ignore:Consolidated metadata")
def test_fill_runs_in_a_thread_and_under_a_running_event_loop(here, tmp_path):
    """Fill two directories at once: one under an event loop, as in a notebook, one in a thread."""
    cubes = {}

    def fill(out):
        cubes[out] = pipeline.fill(toy.job(), tmp_path / out, here(), progress=False)

    async def cell():
        thread = threading.Thread(target=fill, args=["thread"])
        thread.start()
        fill("loop")
        while thread.is_alive():
            await asyncio.sleep(0.01)

    asyncio.run(cell())
    for cube in cubes["thread"], cubes["loop"]:
        assert_filled(cube, toy.cube())


def test_ctrl_c_waits_for_the_tiles_in_flight(here, tmp_path, capsys):
    job = toy.job(seconds=0.05)

    def interrupt():
        toy.wait_until(lambda: toy.commit_times(tmp_path))
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt, match=r"stopped; .* and the same") as stop:
        pipeline.fill(job, tmp_path, here(), progress=False)
    assert isinstance(stop.value, pipeline.Interrupted)
    missing = len(store.missing(store.place_of(tmp_path), job.cube))
    assert 0 < stop.value.remaining == missing < 20
    assert "waiting for the tiles in flight" in capsys.readouterr().err
    assert_filled(pipeline.fill(job, tmp_path, here(), progress=False), job.cube)


SCRIPT = """
import sys
sys.path[:0] = {paths}
import pipeline, toy
if __name__ == "__main__":
    assert pipeline.fill(toy.job(), sys.argv[1], workers=1).wave.notnull().all()
"""


def test_a_script_starts_its_own_workers(tmp_path):
    script, paths = tmp_path / "script.py", [str(ROOT), str(ROOT / "tests")]
    script.write_text(SCRIPT.format(paths=paths))
    command = [sys.executable, script, tmp_path / "out"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert (ended.returncode, ended.stdout) == (0, ""), ended.stderr
    assert_filled(xr.open_zarr(tmp_path / "out/toy.zarr"), toy.cube())


def test_an_estimate_counts_only_missing_tiles(here, tmp_path):
    job = toy.job()
    before = pipeline.estimate(job, tmp_path / "out")
    assert (before.tiles, before.files) == (20, 60)
    assert 20 * 0.01 < before.cpu_seconds < 20 * 0.31
    pipeline.fill(job, tmp_path / "out", here(), progress=False)
    assert pipeline.estimate(job, tmp_path / "out").tiles == 0


def test_a_message_names_only_the_first_failed_tiles():
    failed = {(i, 0): "no answer" for i in range(9)}
    assert str(pipeline.TilesFailed("toy", failed)).endswith("(2, 0), no answer; and 6 more")
    assert fills.Interrupted("toy", 1, {}).remaining == 1


JOBS = {
    "escape": {"n_max": 0, "n_orbits": [64, 2], "tile": 0, "precision": "half", "first": "0:1"},
    "last_barrier": {"angles": [np.nan], "tol": 1.0, "plane": "two"},
    "last_barriers": {"profiles": [], "tol": 0},
    "breakdown": {"omegas": "1/2", "angles": [], "tol": 1.0, "q_max": 1},
    "transport": {"angles": "x", "n_max": 1, "n_orbits": 0},
    "flux": {"barrier": xr.Dataset(), "q_max": 1},
    "diffusion": {"barrier": xr.Dataset(), "n_orbits": 1, "n_max": 1},
    "tori": {"vectors": [], "angles": [], "tol": 0.0},
    "proved_barrier": {"angles": [], "seconds": 0.0},
}
SOUND = {
    "last_barrier": {"angles": 30},
    "last_barriers": {"profiles": [(1, 0.5)]},
    "breakdown": {"omegas": "gamma", "angles": 0},
    "transport": {"angles": 0},
    "tori": {"vectors": [(0.6, 0.4)], "angles": 0},
    "proved_barrier": {"angles": 0},
}


@pytest.mark.parametrize(
    ("maker", "name", "value"), [(m, n, v) for m, bad in JOBS.items() for n, v in bad.items()]
)
def test_an_error_names_the_bad_argument_of_a_job(maker, name, value):
    barrier = xr.Dataset({"critical_scale": ("angle", [1.0])}, {"angle": [30.0]})
    barrier = barrier.assign_coords(circle=("angle", ["gamma"]))
    if maker in ("flux", "diffusion"):
        from nasm.planes import two_kicks

        barrier.attrs = two_kicks().record
        SOUND[maker] = {"barrier": barrier, "excesses": [0.1]}
    make, arguments = getattr(pipeline, maker), SOUND.get(maker, {})
    make(**arguments)
    words = {"plane": "is not a plane", "first": "is not an axis", "omegas": "omega=1/2"}
    with pytest.raises(ValueError, match=words.get(name, name)):
        make(**arguments | {name: value})


def test_a_job_made_in_python_has_the_same_cube_as_the_command():
    from nasm.planes import two_kicks
    from pipeline.cubes.barrier import last_barrier

    ours = pipeline.last_barrier([60, 30], tol=1e-3).cube
    assert ours.config_hash == last_barrier(two_kicks(), [30.0, 60.0], 1e-3).cube.config_hash
