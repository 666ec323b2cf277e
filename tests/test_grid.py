from dataclasses import replace

import numpy as np
import pytest
import toy
from hypothesis import given
from hypothesis import strategies as st

from pipeline.sweep.grid import Axis, join_tiles, parse_axis, tile_slices

lengths = st.integers(1, 40)


@given(rows=lengths, columns=lengths, height=lengths, width=lengths)
def test_tiles_cover_every_cell_exactly_once(rows, columns, height, width):
    tile = {"row": height, "column": width}
    visits = np.zeros((rows, columns), dtype=int)
    for index in np.ndindex(-(-rows // height), -(-columns // width)):
        slices = tile_slices(index, tile)
        here = visits[slices["row"], slices["column"]]
        assert 1 <= here.shape[0] <= height
        assert 1 <= here.shape[1] <= width
        here += 1
    assert (visits == 1).all()


def test_each_centre_is_the_middle_of_its_cell():
    assert Axis(-1, 1, 4).centres.tolist() == [-0.75, -0.25, 0.25, 0.75]
    assert Axis(-1, 1, 4).bounds.tolist() == [[-1, -0.5], [-0.5, 0], [0, 0.5], [0.5, 1]]


def test_centres_of_a_coarser_axis_are_means_of_the_finer_centres():
    axis = Axis(-0.3, 1.1, 12)
    np.testing.assert_allclose(
        axis.coarsened(4).centres, axis.centres.reshape(3, 4).mean(axis=1), atol=1e-15
    )


@given(st.floats(-9, 0), st.floats(1, 9), lengths)
def test_an_axis_can_be_parsed_from_its_text(lo, hi, n):
    assert parse_axis(f"{lo!r}:{hi!r}:{n}") == Axis(lo, hi, n)


def a_millisecond_a_cell(coords, settings):
    return 1e-3 * coords["row"].size * coords["column"].size


def a_second_a_cell(coords, settings):
    return 1e3 * a_millisecond_a_cell(coords, settings)


@pytest.mark.parametrize(
    ("cells", "predict", "tile"),
    [
        (50, a_millisecond_a_cell, 1),  # 2500 tiles are already too few to join
        (130, a_millisecond_a_cell, 2),  # 65² tiles; a quarter of them would be too few
        (2000, a_millisecond_a_cell, 16),  # there would be only 3969 tiles of 32² cells, 1 s each
        (8000, a_millisecond_a_cell, 32),  # tiles of 64² would take 4 s
        (8000, a_second_a_cell, 1),
    ],
)
def test_cheap_tiles_are_joined_as_long_as_thousands_remain(cells, predict, tile):
    job = join_tiles(toy.job(cells, cells, 1, predict=predict))
    assert job.cube.tile == {"row": tile, "column": tile}
    again = join_tiles(toy.job(cells, cells, 1, predict=predict)).cube
    assert again.config_hash == job.cube.config_hash


def test_a_million_tiles_that_cost_nothing_become_a_few_thousand():
    cube = join_tiles(toy.line(10**6)).cube
    assert 4096 <= cube.tile_counts[0] <= 8192
    assert join_tiles(replace(toy.line(10**6), cube=cube)).cube == cube
