"""Adaptive refinement: halve the cells only where a boundary crosses them.

Level 0 is computed in full. A cell of level l is on the boundary if the answer to a yes-or-no
question differs between it and one of its eight neighbours; the tiles of level l + 1 that touch
such a cell are computed next. Levels are composed into one array at the finest resolution, in which
every cell holds the value of the finest level that was computed there.

Arrays are (…, rows, columns), with as many cells per tile side at every level.
"""

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

FACTOR = 2  # cells of the next level per cell and dimension


def refine(compute, ask, levels, tile):
    """Compute a field level by level, finer only along the boundaries; returns as `compose`.

    compute : (level, set of tiles or None for all) → field of that level, NaN where not computed;
        called again for a level with more tiles, it returns all of them.
    ask : field → bool array (questions, rows, columns).
    levels : int ≥ 1.
    tile : int, cells along each side of a tile.
    """
    fields = [compute(0, None)]
    for number in range(1, levels):
        wanted = tiles_at(halved(boundary_cells(ask(compose(fields)[0]))), tile)
        fields.append(compute(number, wanted))
        # Finer cells may show that the boundary runs on in a neighbouring tile: follow it there.
        while more := tiles_at(boundary_cells(ask(compose(fields)[0])), tile) - wanted:
            wanted |= more
            fields[-1] = compute(number, wanted)
    return compose(fields)


def compose(levels):
    """Return one field at the resolution of the last level, and the level of each cell as int8.

    levels : list of arrays (…, rows·2ˡ, columns·2ˡ), NaN where not computed. Level -1: nowhere.
    """
    field = np.full(levels[0].shape, np.nan)
    level = np.full(field.shape[-2:], -1, "int8")
    for number, finer in enumerate(levels):
        if number:
            field, level = halved(field), halved(level)
        computed = ~np.isnan(finer).all(axis=tuple(range(finer.ndim - 2)))
        field = np.where(computed, finer, field)
        level = np.where(computed, np.int8(number), level)
    return field, level


def boundary_cells(answers):
    """Mark the cells (rows, columns) with a neighbour, of eight, that answers differently."""
    around = {"size": (1, 3, 3), "mode": "nearest"}
    return np.any(maximum_filter(answers, **around) != minimum_filter(answers, **around), axis=0)


def tiles_at(cells, tile):
    """Return the indices (row, column) of the tiles, `tile` cells wide, that hold a marked cell."""
    return set(map(tuple, (np.argwhere(cells) // tile).tolist()))


def halved(array):
    """Return the array at the next level: every cell cut into FACTOR × FACTOR, with its value."""
    return array.repeat(FACTOR, axis=-2).repeat(FACTOR, axis=-1)
