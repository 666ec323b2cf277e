"""The store: each cube is a zarr group of its own, PLACE/NAME.zarr, a chunk per tile.

The life of a tile: missing → data chunks written → commit record written last, its CPU seconds and
the checksum of its data. *A tile is done if its record and its data are there*; nothing else lists
what is done. A copy that was made meanwhile may hold records without data: these tiles are missing.
Each file appears whole or not at all. What several workers or drivers write more than once is the
same each time, but for proofs, which may take so much time: they need no order. The store knows
neither mathematics nor dask.
"""

from pipeline.store.metadata import (
    COMPUTED_BY,
    changes,
    check,
    create,
    has_digests,
    is_visible,
    names,
    replace,
)
from pipeline.store.place import (
    Place,
    Refused,
    StoreFailed,
    driver_lock,
    place_of,
    printable,
    store_errors,
    without_password,
)
from pipeline.store.tiles import (
    certificates_key,
    commit,
    is_committed,
    missing,
    read,
    record_failure,
    tiles_of,
    wanted_key,
)
from pipeline.store.verify import State, free, status, verify
