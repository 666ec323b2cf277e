"""The scaling study: the limits of its model on made-up constants, and a small run of it."""

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from pipeline import throughput
from pipeline.sweep import _pack
from workflows import scaling

NOTHING = throughput.Constants(0, 0, 0, 0, 0, 0, 0)
SOME = throughput.Constants(0.1, 1e-4, 4e-3, 2e-4, 4e-3, 1e-3, 1e-3)


@pytest.mark.parametrize("cost", [0, 1 / 1024, 1 / 64, 1 / 8, 0.3, 0.5, 2])
@pytest.mark.parametrize("n", [1, 100, 1000])
def test_tiles_are_parcel_as_the_sweep_packs_them(n, cost):
    size, batches = throughput.packing(n, cost)
    packed = list(_pack(np.full(n, cost)))
    assert (len(packed), len(packed[0])) == (batches, size)


def test_without_overhead_one_worker_takes_the_tiles_own_time():
    assert throughput.sweep_seconds(1000, 0.01, 1, NOTHING) == pytest.approx(10)
    assert throughput.efficiency(1000, 0.01, 1, 10.0) == pytest.approx(1)


def test_one_worker_waits_for_all_that_is_done_to_a_tile():
    n, cost = 10_000, 1.0
    k = SOME
    each = cost + k.listing + k.worker_batch + k.worker_tile
    assert throughput.sweep_seconds(n, cost, 1, k) == pytest.approx(n * each, rel=1e-3)


def test_infinitely_many_workers_wait_for_the_driver_and_one_batch():
    seconds = throughput.sweep_seconds(1000, 1.0, 10**9, SOME)
    assert seconds == pytest.approx(0.1 + 0.1 + 1000 * 4.2e-3 + 1.005)


def test_more_workers_than_the_driver_feeds_are_of_no_use():
    few, many = (throughput.sweep_seconds(10**5, 1.0, workers, SOME) for workers in (256, 1024))
    assert many == pytest.approx(few, rel=0.1)
    assert many == pytest.approx(1e5 * 4.3e-3, rel=0.01)


def test_a_slow_store_bounds_cheap_tiles():
    slow = throughput.Constants(0, 0, 0, 0, 0, 0, 0.02)
    assert throughput.sweep_seconds(1000, 0.001, 64, slow) == pytest.approx(20)


def test_the_longest_tile_bounds_few_tiles():
    assert throughput.sweep_seconds(64, 10.0, 64, NOTHING) == pytest.approx(10)
    assert throughput.sweep_seconds(65, 10.0, 64, NOTHING) == pytest.approx(20)
    assert throughput.sweep_seconds(6400, 0.5, 64, NOTHING, longest=30.0) == pytest.approx(80)


def test_workers_in_one_process_are_served_by_it():
    seconds = throughput.sweep_seconds(1000, 1.0, 1000, SOME, crowded=True)
    assert seconds == pytest.approx(0.2 + 1000 * 5e-3 + 1.0)


def test_a_good_tile_is_long_for_the_driver_and_short_for_the_sweep():
    _, _, model = scaling.plans([1], [16], quick=False)
    scaling.predict(model, SOME)
    least, largest = zip(*(scaling.good_costs(model, w) for w in (16, 256, 1024)), strict=True)
    assert least[0] < least[1] < least[2]
    assert least[2] == pytest.approx(1024 * 4.2e-3, rel=0.15)  # as long as the driver's round
    assert all(45 < cost < 67 for cost in largest)  # a tenth of ten minutes
    assert np.isnan(scaling.good_costs(model * 0, 16)).all()


def test_constants_are_recovered_from_sweeps_that_obey_them():
    measured, simulated, _ = scaling.plans([1, 2], [16, 64], quick=False)
    simulated["tiles"][:] = 1000
    for dataset in (measured, simulated):
        n = dataset.tiles * xr.ones_like(dataset.wall).fillna(1)
        _, batches = throughput.packing(n, dataset.cost)
        dims = dataset.wall.dims
        dataset["wall"][:] = 1.0
        dataset["slowness"][:] = 2.0
        values = {
            "first": 2 * (SOME.start + n * SOME.listing),
            "driver_cpu": 0.05 + batches * SOME.batch + n * SOME.tile,
            "workers_cpu": 0.01 + batches * SOME.worker_batch + n * SOME.worker_tile,
        }
        for name, value in values.items():
            dataset[name][:] = value.transpose(*dims)
    found = throughput.fit(measured, simulated, SOME.store)
    assert list(vars(found).values()) == pytest.approx(list(vars(SOME).values()), rel=1e-6)


def test_a_small_run_keeps_its_cubes_and_no_scratch(tmp_path, monkeypatch):
    monkeypatch.setattr(scaling, "COSTS", (0.01, 0.1))
    monkeypatch.setattr(scaling, "TILES", (5, 10, 100))
    monkeypatch.setattr(scaling, "SIMULATED_COSTS", (0.1,))
    out = tmp_path / "out"
    options = ["--out", str(out), "--quick", "--workers", "1", "--crowd", "4"]
    result = CliRunner().invoke(scaling.main, options)
    assert result.exit_code == 0, result.output + repr(result.exception)
    assert "1024 workers, 10 minutes: 90% efficiency with tiles of" in result.output
    files = {".lock", "cubes.zarr", "scaling.png", "scaling.pdf"}
    tables = {"scaling_measured.csv", "scaling_simulated.csv"}
    assert {path.name for path in out.iterdir()} == files | tables
    cubes = {
        name: xr.open_zarr(out / "cubes.zarr", group=f"scaling_{name}").load()
        for name in ("measured", "simulated", "model")
    }
    assert cubes["measured"].wall.dims == ("workers", "cost", "tiles")
    assert cubes["simulated"].wall.dims == ("workers", "cost")
    assert np.isfinite(cubes["measured"].wall).sum() == 4
    for cube in cubes.values():
        known = cube.efficiency.values[np.isfinite(cube.efficiency)]
        assert ((known > 0) & (known < 1.05)).all()
        assert cube.attrs["seconds_store"] > 0
        assert all(variable.attrs["units"] for variable in cube.variables.values())
