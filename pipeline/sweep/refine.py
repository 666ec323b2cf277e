"""Adaptive refinement: subdivide only the cells that a boundary crosses.

Level 0 is computed in full. A cell at level l lies on the boundary if the answer to a yes-or-no
question differs between it and one of its eight neighbours; the tiles of level l + 1 that touch
such a cell are computed next. Levels are composed into one array at the finest resolution, in which
every cell has the value of the finest level computed for it.

Arrays have the shape (…, rows, columns). Each side of a tile has the same number of cells at every
level.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from nasm.types import BoolArray, FloatArray

FACTOR = 2
"""Number of cells at the next level per cell, along each dimension."""

Tiles: TypeAlias = set[tuple[int, int]]
"""Indices (row, column) of tiles."""

_Scalar = TypeVar("_Scalar", bound=np.generic)


def refine(
    compute: Callable[[int, Tiles | None], FloatArray],
    ask: Callable[[FloatArray], BoolArray],
    levels: int,
    tile: int,
) -> tuple[FloatArray, NDArray[np.int8]]:
    """Compute a field level by level, with finer levels only along the boundaries.

    Parameters
    ----------
    compute : callable
        (level, set of tiles or None for all) → field at that level, NaN where not computed. If
        called again for a level with more tiles, it returns the field on all of them.
    ask : callable
        field → answers to the yes-or-no questions, bool array, shape (questions, rows, columns).
    levels : int
        Number of levels, at least 1.
    tile : int
        Cells along each side of a tile.

    Returns
    -------
    field, level : ndarray
        As returned by `compose`.
    """
    fields = [compute(0, None)]
    for number in range(1, levels):
        tiles = tiles_at(subdivided(boundary_cells(ask(compose(fields)[0]))), tile)
        fields.append(compute(number, tiles))
        # Finer cells may show that the boundary continues in a neighbouring tile: follow it there.
        while more := tiles_at(boundary_cells(ask(compose(fields)[0])), tile) - tiles:
            tiles |= more
            fields[-1] = compute(number, tiles)
    return compose(fields)


def compose(levels: Sequence[FloatArray]) -> tuple[FloatArray, NDArray[np.int8]]:
    """Compose levels into one field at the resolution of the last one.

    Parameters
    ----------
    levels : sequence of ndarray, shape (…, rows·2ˡ, columns·2ˡ)
        The field at each level l, NaN where not computed.

    Returns
    -------
    field : ndarray
        For each cell, the value of the finest level computed for it; NaN if there is none.
    level : ndarray of int8, shape (rows, columns)
        For each cell, the finest level computed for it; -1 if there is none.

    Examples
    --------
    >>> import numpy as np
    >>> from pipeline.sweep.refine import compose
    >>> field, level = compose([np.array([[5.0]]), np.array([[1.0, np.nan], [np.nan, np.nan]])])
    >>> print(field.tolist(), level.tolist())
    [[1.0, 5.0], [5.0, 5.0]] [[1, 0], [0, 0]]
    """
    field = np.full(levels[0].shape, np.nan)
    level = np.full(field.shape[-2:], -1, np.int8)
    for number, finer in enumerate(levels):
        if number:
            field, level = subdivided(field), subdivided(level)
        computed = ~np.isnan(finer).all(axis=tuple(range(finer.ndim - 2)))
        field = np.where(computed, finer, field)
        level = np.where(computed, np.int8(number), level)
    return field, level


def boundary_cells(answers: BoolArray) -> BoolArray:
    """Mark the cells (rows, columns) that differ in some answer from one of their eight neighbours.

    Parameters
    ----------
    answers : ndarray of bool, shape (questions, rows, columns)
        The answer to each question in each cell.
    """
    some = every = np.pad(answers, ((0, 0), (1, 1), (1, 1)), mode="edge")
    some = some[:, :-2] | some[:, 1:-1] | some[:, 2:]  # in a column of three cells
    every = every[:, :-2] & every[:, 1:-1] & every[:, 2:]
    some = some[..., :-2] | some[..., 1:-1] | some[..., 2:]  # in a square of nine
    every = every[..., :-2] & every[..., 1:-1] & every[..., 2:]
    return np.any(some & ~every, axis=0)


def tiles_at(cells: BoolArray, tile: int) -> Tiles:
    """Return the indices (row, column) of tiles, `tile` cells wide, that contain a marked cell."""
    return {(row, column) for row, column in (np.argwhere(cells) // tile).tolist()}


def subdivided(array: NDArray[_Scalar]) -> NDArray[_Scalar]:
    """Return the array at the next level: each cell is replaced by FACTOR × FACTOR equal cells."""
    return array.repeat(FACTOR, axis=-2).repeat(FACTOR, axis=-1)
