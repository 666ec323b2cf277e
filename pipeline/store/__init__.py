"""The store: each cube is a zarr group, PLACE/NAME.zarr, with one chunk per tile.

A tile passes through these states: missing → data chunks written → commit record written. The
record contains the tile's CPU seconds and the checksum of its data. *A tile is done if its record
and its data exist*; there is no separate list of done tiles. A copy made during a sweep may contain
records without data: their tiles count as missing. Each file appears whole or not at all.
Workers and drivers may write in any order: data written twice are identical, except for proofs,
whose bounds depend on the speed of the machine. The store depends neither on the mathematics nor on
clusters.
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
