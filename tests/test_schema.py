import dataclasses
import pickle

import numpy as np
import pytest

from nasm import escape
from pipeline import schema, tasks
from pipeline.grid import Axis, tile_indices
from pipeline.sweep import _parcel

PLANE = {
    "name": "escape",
    "kappa1": Axis(-1, 1, 6),
    "kappa2": Axis(0, 1.2, 5),
    "sizes": [8, 40],
    "n_max": 300,
    "window": (-2.0, 2.3),
    "tile": 4,
}


def plan(**changes):
    return schema.escape_cube(**{**PLANE, **changes})


def test_the_hash_is_that_of_what_decides_the_numbers():
    hashes = {plan().config_hash}
    for change in (
        {"kappa1": Axis(-1, 1.1, 6)},
        {"kappa2": Axis(0, 1.2, 6)},
        {"sizes": [8, 41]},
        {"n_max": 301},
        {"window": (-2.0, 2.4)},
        {"tile": 5},
    ):
        hashes.add(plan(**change).config_hash)
    assert len(hashes) == 7
    assert plan(name="other").config_hash == plan().config_hash
    retitled = plan().template.assign_attrs(title="another")
    assert dataclasses.replace(plan(), template=retitled).config_hash == plan().config_hash


def test_nothing_is_computed_in_a_plan():
    values = plan(kappa1=Axis(-1, 1, 2**20), kappa2=Axis(-1, 1, 2**20))
    assert values.template.escape_time.chunks is not None  # 2⁴⁰ cells and more, none in memory
    assert plan().template.escape_time.isnull().all()


def test_the_tiles_of_a_plane_hold_the_escape_times_of_its_cells():
    cube = plan()
    x, y = escape.ensemble(40)
    strengths = np.stack(np.meshgrid(PLANE["kappa1"].centres, PLANE["kappa2"].centres), axis=-1)
    whole = escape.first_escape(strengths, x, y, PLANE["sizes"], PLANE["n_max"])
    parcel = _parcel(cube, np.array(tile_indices(cube.sizes, cube.tile)))
    for (row, column), coords in pickle.loads(parcel):
        tile = tasks.escape_tile(coords, cube.settings)
        cells = np.s_[:, 4 * row : 4 * row + 4, 4 * column : 4 * column + 4]
        assert np.array_equal(tile["escape_time"], whole[cells])


def test_the_cost_of_a_tile_is_predicted_within_its_order_of_magnitude():
    # Nothing escapes around the origin: n_max steps of every orbit in every cell.
    inside = {"kappa1": np.linspace(-0.1, 0.1, 8), "kappa2": np.linspace(0, 0.1, 8)}
    outside = {"kappa1": np.linspace(2, 2.2, 8), "kappa2": np.linspace(2, 2.2, 8)}
    settings = {"n_max": 20_000, "window": (-2.0, 2.3)}
    orbits = {"ensemble": np.array([64])}
    costs = [tasks.escape_cost(part | orbits, settings) for part in (inside, outside)]
    assert costs[0] == pytest.approx(8 * 8 * 64 * 20_000 * 0.8e-9)
    assert costs[1] < costs[0] / 100
