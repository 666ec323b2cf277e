import numpy as np

from pipeline.sweep import refine


def disc(n):
    """Return a mask of the n² cells of [-1, 1]² whose centres are within a circle of radius 0.7."""
    centre = -1 + (np.arange(n) + 0.5) * 2 / n
    return centre[:, None] ** 2 + centre[None] ** 2 < 0.49


def refined_disc(coarse, levels, tile):
    """Return ((field, level), number of computed cells) of a disc; field is 1 inside, 2 outside."""
    computed = {}

    def compute(level, tiles):
        full = np.where(disc(coarse * 2**level), 1.0, 2.0)
        computed[level] = full.size if tiles is None else len(tiles) * tile**2
        if tiles is None:
            return full
        here = np.full(full.shape, np.nan)
        for row, column in tiles:
            cells = np.s_[row * tile : (row + 1) * tile, column * tile : (column + 1) * tile]
            here[cells] = full[cells]
        return here

    field = refine.refine(compute, lambda field: field[None] < 1.5, levels, tile)
    return field, sum(computed.values())


def test_a_fifth_of_the_finest_cells_suffices_for_a_smooth_boundary():
    (field, level), computed = refined_disc(coarse=32, levels=5, tile=8)
    n = 32 * 2**4
    assert np.array_equal(field < 1.5, disc(n))
    assert computed < 0.2 * n**2
    assert (level[refine.boundary_cells(field[None] < 1.5)] == 4).all()
    assert level.min() == 0


def test_the_level_of_a_cell_is_the_finest_computed_for_some_ensemble():
    coarse = np.array([[[1.0, 2.0]], [[3.0, 4.0]]])
    fine = np.full((2, 2, 4), np.nan)
    fine[0, 0, 1] = 5.0
    fine[:, 1, 3] = np.inf, 6.0
    field, level = refine.compose([coarse, fine])
    assert field[0].tolist() == [[1, 5, 2, 2], [1, 1, 2, np.inf]]
    assert field[1, 1].tolist() == [3, 3, 4, 6]
    assert level.tolist() == [[0, 1, 0, 0], [0, 0, 0, 1]]


def test_cells_that_differ_from_a_diagonal_neighbour_are_boundary_cells():
    answers = np.zeros((1, 3, 3), dtype=bool)
    assert not refine.boundary_cells(answers).any()
    answers[0, 0, 0] = True
    expected = np.zeros((3, 3), dtype=bool)
    expected[:2, :2] = True
    assert np.array_equal(refine.boundary_cells(answers), expected)
