import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.sweep.grid import Axis, parse_axis, tile_slices

lengths = st.integers(1, 40)


@given(rows=lengths, columns=lengths, height=lengths, width=lengths)
def test_tiles_cover_every_cell_exactly_once(rows, columns, height, width):
    sizes, tile = {"row": rows, "column": columns}, {"row": height, "column": width}
    visits = np.zeros((rows, columns), dtype=int)
    for index in np.ndindex(-(-rows // height), -(-columns // width)):
        slices = tile_slices(index, sizes, tile)
        here = visits[slices["row"], slices["column"]]
        assert 1 <= here.shape[0] <= height
        assert 1 <= here.shape[1] <= width
        here += 1
    assert (visits == 1).all()


def test_centres_lie_inside_the_edges():
    assert Axis(-1, 1, 4).centres.tolist() == [-0.75, -0.25, 0.25, 0.75]


def test_a_coarser_axis_has_the_means_of_the_finer_ones_centres():
    axis = Axis(-0.3, 1.1, 12)
    np.testing.assert_allclose(
        axis.coarsened(4).centres, axis.centres.reshape(3, 4).mean(axis=1), atol=1e-15
    )


@given(st.floats(-9, 0), st.floats(1, 9), lengths)
def test_an_axis_reads_back(lo, hi, n):
    assert parse_axis(f"{lo!r}:{hi!r}:{n}") == Axis(lo, hi, n)
