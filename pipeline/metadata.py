"""The metadata of cubes: written sealed, copied at the root of the store, read again.

A cube is a zarr group, which appears whole. Its metadata are there three times: of each array, of
the group, and, gathered at the root, as xarray reads them. So they outlive the loss of one of them.
"""

import json
import re
import warnings
from contextlib import contextmanager, suppress

import dask.array
import numpy as np
import zarr
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.storage import MemoryStore

from pipeline.faults import StoreError
from pipeline.grid import tile_counts
from pipeline.layout import COMMIT, FORMAT, STORE, stored_layout
from pipeline.seal import parsed, sealed

_ROOT = f"{STORE}/zarr.json"
_NAME = re.compile(r"\w+", re.ASCII)


def has_root(place):
    """Whether the root of the store is there, and no damage."""
    return parsed(place.read(_ROOT)) is not None


def put_root(place):
    """Make the root of the store, with the metadata of the cubes that are there."""
    place.put_files(STORE, {"zarr.json": _root(place)})


def format_of(place):
    """Version of the store: what the root says, or if that is damaged, any cube; or None."""
    written = [parsed(place.read(_ROOT))]
    if written == [None]:
        written = [{"attributes": attributes(place, name)} for name in names(place)]
    for found in written:
        with suppress(KeyError, TypeError):
            return found["attributes"]["format"]
    return None


def names(place):
    """Names of the cubes in the store, by their folders; of others' folders they are no names."""
    return sorted(name for name in place.names(STORE) if _NAME.fullmatch(name))


def stored(place, name):
    """The cube's group as zarr has it, and its Layout, None if it is no sweep's.

    StoreError if its metadata are damaged.
    """
    try:
        group = zarr.open_group(place.zarr_store(STORE), path=name, mode="r", zarr_format=3)
        return group, stored_layout(place, name, group)
    except (AttributeError, FileNotFoundError, KeyError, RecursionError, TypeError, ValueError):
        raise lost(place, name) from None


def attributes(place, name):
    """Those of the cube's group, or if its metadata are damaged, of their copy at the root.

    None if neither has any of ours.
    """
    for of_the_group in (_own, _copy):
        with suppress(KeyError, TypeError):
            found = of_the_group(place, name)["attributes"]
            if "config_hash" in found:
                return found
    return None


def _own(place, name):
    return parsed(place.read(f"{STORE}/{name}/zarr.json"))


def _copy(place, name):
    return _at_the_root(place)[name] if has_files(place, name) else None


def has_files(place, name):
    """Whether something is there under the cube's name.

    But where groups do not appear whole, a driver may have died while it made one without tiles.
    """
    whole = f"{STORE}/{name}" if place.groups_appear_whole else f"{STORE}/{name}/{COMMIT}/c"
    return any(place.sizes(whole))


def lost(place, name):
    """The StoreError for a cube whose metadata are damaged beyond what can be mended."""
    return StoreError(
        f"the metadata of {place}/{STORE}/{name} are damaged; delete it, or choose another --out "
        "or --store"
    )


def _with_commit_records(cube):
    counts = tile_counts(cube.sizes, cube.tile)
    records = dask.array.full(tuple(counts.values()), np.nan, dtype="float64", chunks=-1)
    attrs = {
        "long_name": "CPU time of the tile",
        "units": "s",
        "comment": "written last: the tile is complete if this is not NaN",
    }
    tiled = {f"tile_{dim}": length for dim, length in cube.tile.items()}
    attrs |= {"cells_per_tile": list(tiled.values())}
    return cube.template.assign({COMMIT: (tuple(tiled), records, attrs)})


def empty_files(layout, cube, computed):
    """The files of the cube's group before any tile is there."""
    dataset = _with_commit_records(cube)
    checked = {"compressors": (Crc32cCodec(),), "filters": None}
    encoding = dict.fromkeys(dataset.variables, checked)
    for variable in (*layout.variables, layout.record):
        encoding[variable.name] = {"chunks": variable.chunk_shape, **checked}
    return _files(cube, dataset, encoding, False, computed)


def whole_files(cube, computed):
    """The files of the group of a cube that is computed in full, compressed."""
    compressed = {"compressors": (ZstdCodec(), Crc32cCodec())}
    encoding = dict.fromkeys(cube.template.variables, compressed)
    return _files(cube, cube.template, encoding, True, computed)


def _files(cube, dataset, encoding, compute, computed):
    """{key in the group: bytes} of the dataset as the group of `cube`, and who computed it."""
    attrs = {"format": FORMAT, "config_hash": cube.config_hash, **cube.settings, **computed}
    files = {}
    with _consolidated_quietly():
        dataset.assign_attrs(attrs).to_zarr(
            MemoryStore(files),
            compute=compute,
            encoding=encoding,
            zarr_format=3,
            consolidated=True,
            write_empty_chunks=True,
        )
    return sealed(_bytes(files))


def put_group(place, cube, files):
    """Write the cube's group in place of what is there, and gather its metadata."""
    place.put_group(f"{STORE}/{cube.name}", files)
    consolidate(place)


def gather(place, name):
    """Consolidate, if need be: a driver may have died before it did."""
    own, copies = with_copies(place, name)
    if copies != own:
        consolidate(place)


def with_copies(place, name):
    """The metadata of an intact cube and of its arrays, by name, and what the root has of these.

    Xarray reads the copies at the root; of a cube that is being made there are none.
    """
    own = _own(place, name)
    own = {name: own["attributes"], **_arrays(name, own)}
    copies = {key: copy for key, copy in _at_the_root(place).items() if key in own}
    if name in copies:
        copies[name] = copies[name].get("attributes")
    return own, copies


def _at_the_root(place):
    """{name of a cube, or cube/array: its metadata}, the copy that xarray reads."""
    try:
        return parsed(place.read(_ROOT))["consolidated_metadata"]["metadata"]
    except (KeyError, TypeError):
        return {}


def consolidate(place):
    """Gather the metadata of all cubes at the root, as `zarr.consolidate_metadata` does.

    But of a cube whose own metadata are damaged the root keeps what it has: they can be mended.
    """
    place.put(_ROOT, _root(place))


def _root(place):
    before, gathered = _at_the_root(place), {}
    for name in names(place):
        try:
            own = _own(place, name)
            group = own | {"consolidated_metadata": _inline({})}
            gathered |= {name: group, **_arrays(name, own)}
        except (AttributeError, KeyError, TypeError):
            gathered |= {key: copy for key, copy in before.items() if key.split("/")[0] == name}
    root = {"attributes": {"format": FORMAT}, "zarr_format": 3, "node_type": "group"}
    return json.dumps(root | {"consolidated_metadata": _inline(gathered)}).encode()


def _arrays(name, group):
    """{cube/array: its metadata}, of the cube whose metadata are given."""
    arrays = group["consolidated_metadata"]["metadata"]
    return {f"{name}/{key}": array for key, array in arrays.items()}


def _inline(gathered):
    return {"kind": "inline", "must_understand": False, "metadata": gathered}


def _bytes(files):
    return {key: buffer.to_bytes() for key, buffer in files.items()}


@contextmanager
def _consolidated_quietly():
    """Zarr v3 has no standard for consolidated metadata yet; xarray reads it, and reading a store
    without it costs the user a warning."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        yield
