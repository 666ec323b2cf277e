"""The store: each cube is a zarr group of its own, PLACE/NAME.zarr, a chunk per tile.

The life of a tile: missing → data chunks written → commit record written last. The record is the
tile's chunk of `tiles/commit`, its CPU seconds and the checksum of its data; *a tile is done if its
record is there*. Nothing else lists what is done. If a tile fails, the reason is kept, and means
something while the tile is missing.

Each file appears whole or not at all, so that a killed process leaves nothing half-written. What
several workers or drivers write more than once is the same each time: they need no order. The
store knows neither mathematics nor dask, and of cubes what `pipeline.cubes.cube.Cube` tells.
"""

from pipeline.store.metadata import check, create, names, replace, sees, tile_counts
from pipeline.store.place import Place, Refused, StoreFailed, driving, explained, place_of
from pipeline.store.provenance import computed_by
from pipeline.store.status import State, status
from pipeline.store.tiles import (
    certificates_of,
    commit,
    is_committed,
    missing,
    read,
    record_failure,
    record_wanted,
    tiles_of,
)
from pipeline.store.verify import free, verify
