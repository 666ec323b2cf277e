"""Metadata of cubes: a function of the cube and of who computes it, written before any tile.

What decides a cube's numbers is written twice, as attributes of the group and with its records, so
that either zarr.json can be lost and written again. Whoever puts the group's zarr.json first has
made the cube; any other driver must agree with it.
"""

import json
import warnings
from contextlib import suppress
from math import prod

import dask.array
import numpy as np
import xarray as xr
from obstore.exceptions import AlreadyExistsError
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.storage import MemoryStore

from pipeline.store.place import Refused, explained
from pipeline.store.provenance import provenance
from pipeline.store.tiles import COMMIT, RECORDS, forget, missing

MAX_TILES = 2**24


def names(place):
    """Names of the cubes in the place; Refused if it does not exist, or holds another's zarr."""
    with explained(place):
        try:
            folders = place.objects().list_with_delimiter()["common_prefixes"]
        except FileNotFoundError:
            raise Refused(f"{place} does not exist; give the --out or --store of a run") from None
        found = sorted(
            folder.removesuffix(".zarr") for folder in folders if folder.endswith(".zarr")
        )
        for name in found:
            if _is_foreign(place, name):
                raise Refused(
                    f"{place.cube(name)} is not a cube of this program; move it elsewhere"
                )
    return found


def check(place, cube, computed_by):
    """Refuse to continue a cube that has other settings, or that other code has begun.

    Writes nothing. Returns the attributes of the cube that is there, None if there is none.
    """
    counts = tile_counts(cube)
    if prod(counts) > MAX_TILES:
        raise Refused(
            f"{cube.name} would have {' × '.join(map(str, counts))} tiles, more than {MAX_TILES}; "
            "choose larger tiles, or fewer cells"
        )
    found = _check_settings(place, cube)
    if found and found.get("computed_by") != computed_by and len(missing(place, cube)):
        raise Refused(
            f"{place.cube(cube.name)} was computed by {found.get('computed_by')}; this is "
            f"{computed_by}. Resume it with those versions, or choose another --out or --store"
        )
    return found


def create(place, cube, computed_by):
    """Make the cube, all tiles missing, or check that the one in the place is the same.

    Metadata and coordinates that are damaged or missing are written again. Refused as by `check`.
    """
    forget()
    found = check(place, cube, computed_by)
    with explained(place):
        if not found:
            key, root = "zarr.json", _empty_files(cube, provenance(computed_by))["zarr.json"]
            with suppress(AlreadyExistsError):
                _put(place, cube.name, key, root, mode="create")
            if not _attributes(place, cube.name, key):  # damaged
                _put(place, cube.name, key, root)
            found = check(place, cube, computed_by)  # another driver may have been first
        for key, data in _differing(place, cube.name, _empty_files(cube, found)).items():
            _put(place, cube.name, key, data)


def replace(place, cube, computed_by):
    """Write a cube that is computed in full, compressed, in place of an earlier state of itself.

    Nothing is written if that state is the same. The group's zarr.json is deleted first and written
    last: until then, also after a crash, there is no such cube. Refused on other settings.
    """
    found = _check_settings(place, cube)
    with explained(place):
        if found and not _differing(place, cube.name, _whole_files(cube, found)):
            return
        with suppress(FileNotFoundError):
            place.objects().delete(f"{cube.name}.zarr/zarr.json")
        files = _whole_files(cube, provenance(computed_by))
        for key in sorted(files, key="zarr.json".__eq__):
            _put(place, cube.name, key, files[key])


def sees(place, name, config_hash):
    """Whether this process finds that cube in the place. A worker asks it before each batch."""
    forget()  # the cube may have been deleted and made anew
    with explained(place):
        return (_attributes(place, name, "zarr.json") or {}).get("config_hash") == config_hash


def copies_agree(place, name):
    """Whether what the cube's group says of its arrays, and of itself, is what these say."""
    with (
        explained(place),
        suppress(AttributeError, KeyError, RecursionError, TypeError, ValueError),
    ):
        root = json.loads(_read(place, name, "zarr.json"))
        copies = root["consolidated_metadata"]["metadata"]
        copies.get(RECORDS, {}).pop("consolidated_metadata", None)
        own = {key: json.loads(_read(place, name, f"{key}/zarr.json")) for key in copies}
        identity = json.loads(own[COMMIT]["attributes"]["cube"]) if COMMIT in own else {}
        return own == copies and identity.items() <= root["attributes"].items()
    return False


def _check_settings(place, cube):
    """The attributes of the cube that is there, None if there is none; Refused if it differs."""
    with explained(place):
        both = [_attributes(place, cube.name, key) for key in (f"{COMMIT}/zarr.json", "zarr.json")]
        found = [attributes for attributes in both if attributes]
        for attributes in found:  # one of them may be damaged
            if attributes["config_hash"] == cube.config_hash:
                return attributes
        if not found and not _is_taken(place, cube.name):
            return None
    if not found:
        raise Refused(
            f"{place.cube(cube.name)} is not a cube of this program, or its metadata are lost; "
            "delete it, or choose another --out or --store"
        )
    differences = [
        f"{key} is {found[0].get(key)}, not {value}"
        for key, value in cube.settings.items()
        if found[0].get(key) != value
    ]
    raise Refused(
        f"{place.cube(cube.name)} was computed with other settings: "
        f"{'; '.join(differences) or 'its coordinates, tiles or variables differ'}. "
        "Repeat the old settings to resume it, or choose another --out or --store"
    )


def _attributes(place, name, key):
    """What decides the cube's numbers, as a zarr.json of it tells; None if that is damaged."""
    with suppress(AttributeError, KeyError, RecursionError, TypeError, ValueError):
        found = json.loads(_read(place, name, key))["attributes"]
        found = json.loads(found["cube"]) if key.startswith(COMMIT) else found
        found.pop("coordinates", None)  # xarray's own word
        return found if isinstance(found["config_hash"], str) else None
    return None


def _is_taken(place, name):
    """Whether there are tiles, or a zarr group of somebody else."""
    with suppress(FileNotFoundError):
        if any(place.objects().list(f"{name}.zarr/{COMMIT}/c")):
            return True
    return _is_foreign(place, name)


def _is_foreign(place, name):
    """Whether there is a zarr array or group that another program has made, of version 2 or 3."""
    if any(_attributes(place, name, key) for key in (f"{COMMIT}/zarr.json", "zarr.json")):
        return False
    with suppress(ValueError, RecursionError):
        if json.loads(_read(place, name, "zarr.json")):
            return True
    return any(_read(place, name, key) for key in (".zgroup", ".zarray"))


def _read(place, name, key):
    """The file's bytes; empty if it is missing."""
    with suppress(FileNotFoundError):
        return bytes(place.objects().get(f"{name}.zarr/{key}").bytes())
    return b""


def _put(place, name, key, data, **mode):
    place.objects().put(f"{name}.zarr/{key}", data, **mode)


def _differing(place, name, files):
    return {key: data for key, data in files.items() if _read(place, name, key) != data}


def tile_counts(cube):
    """The number of tiles along each tiled dimension."""
    return tuple(-(-cube.sizes[dim] // length) for dim, length in cube.tile.items())


def _empty_files(cube, computed):
    """{key: bytes} of the cube before any tile is there; `computed` tells by whom."""
    counts, identity = tile_counts(cube), _identity(cube, computed)
    attributes = {
        "long_name": "CPU time of the tile",
        "units": "s",
        "comment": "written last: the tile is complete if this is not NaN",
        "cube": json.dumps(identity),
    }
    records = dask.array.full(counts, np.nan, chunks=-1)
    dims = tuple(f"tile_{dim}" for dim in cube.tile)
    _, commit = COMMIT.split("/")
    checked, encoding = {"compressors": (Crc32cCodec(),), "filters": None}, {}
    for key, array in cube.template.variables.items():
        whole = key in cube.template.coords
        chunks = tuple(n if whole else cube.tile.get(dim, n) for dim, n in array.sizes.items())
        encoding[key] = {"chunks": chunks, **checked}
    tree = {"/": cube.template.assign_attrs(identity)}
    tree["/" + RECORDS] = xr.Dataset({commit: (dims, records, attributes)})
    of_records = {commit: {"chunks": (1,) * len(counts), **checked}}
    return _files(tree, {"/": encoding, "/" + RECORDS: of_records}, compute=False)


def _whole_files(cube, computed):
    """{key: bytes} of a cube that is computed in full."""
    compressed = {"compressors": (ZstdCodec(), Crc32cCodec())}
    encoding = dict.fromkeys(cube.template.variables, compressed)
    tree = {"/": cube.template.assign_attrs(_identity(cube, computed))}
    return _files(tree, {"/": encoding}, compute=True)


def _identity(cube, computed):
    return {**computed, **cube.settings, "config_hash": cube.config_hash}


def _files(tree, encoding, compute):
    """{key: bytes} of the zarr groups {path: Dataset}."""
    files = {}
    for path, dataset in tree.items():  # NumPy's type of text has no standard in zarr 3
        texts = {key: a for key, a in dataset.variables.items() if a.dtype.kind == "U"}
        tree[path] = dataset.assign({key: text.astype(object) for key, text in texts.items()})
    with warnings.catch_warnings():
        # Zarr 3 has no standard for consolidated metadata yet; without them readers are warned.
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        xr.DataTree.from_dict(tree).to_zarr(
            MemoryStore(files),
            compute=compute,
            encoding=encoding,
            zarr_format=3,
            consolidated=True,
            write_empty_chunks=True,
        )
    return {key: buffer.to_bytes() for key, buffer in files.items()}
