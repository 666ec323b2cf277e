"""Metadata of cubes: a function of the cube and of who computes it, written before any tile.

What decides a cube's numbers is written twice, into the attributes of the group and of
`cpu_seconds`, so that either zarr.json can be lost and written again. Whoever puts the group's
first has made the cube; any other driver must agree with it.
"""

import json
import re
import warnings
from contextlib import suppress
from math import prod

import dask.array
import numpy as np
from obstore.exceptions import AlreadyExistsError
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.storage import MemoryStore

from pipeline.store.place import Refused, explained
from pipeline.store.provenance import PROVENANCE, provenance
from pipeline.store.tiles import COMMIT, forget, missing

MAX_TILES = 2**24
_WITNESS = f"{COMMIT}/zarr.json"


def names(place):
    """Names of the cubes in the place; Refused if it does not exist."""
    with explained(place):
        try:
            folders = place.objects().list_with_delimiter()["common_prefixes"]
        except FileNotFoundError:
            raise Refused(f"{place} does not exist; give the --out or --store of a run") from None
    return sorted(m[1] for f in folders if (m := re.fullmatch(r"(\w+)\.zarr", f, re.ASCII)))


def check(place, cube, computed_by):
    """Refuse to continue a cube that has other settings, or that other code has begun.

    Writes nothing. Returns the attributes of the cube that is there, None if there is none.
    """
    counts = _tile_counts(cube)
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
    found = check(place, cube, computed_by)
    with explained(place):
        if not found:
            _delete(place, cube.name, "zarr.json")  # damaged: it says nothing
            files = _empty_files(cube, provenance(computed_by))
            with suppress(AlreadyExistsError):
                place.objects().put(
                    f"{cube.name}.zarr/zarr.json", files["zarr.json"], mode="create"
                )
            found = check(place, cube, computed_by)  # another driver may have been first
        _put_what_differs(place, cube.name, _empty_files(cube, found))
    forget()


def replace(place, cube, computed_by):
    """Write a cube that is computed in full, compressed, in place of an earlier state of itself.

    Nothing is written if that state is the same. The group's zarr.json is deleted first and written
    last: until then, also after a crash, there is no such cube. Refused on other settings.
    """
    found = _check_settings(place, cube)
    with explained(place):
        if found and not _differing(place, cube.name, _whole_files(cube, found)):
            return
        _delete(place, cube.name, "zarr.json")
        files = _whole_files(cube, provenance(computed_by))
        files["zarr.json"] = files.pop("zarr.json")
        _put_what_differs(place, cube.name, files)


def sees(place, name, config_hash):
    """Whether this process finds that cube in the place. A worker asks it before each batch."""
    forget()  # the cube may have been deleted and made anew
    with explained(place):
        return (_attributes(place, name, "zarr.json") or {}).get("config_hash") == config_hash


def copies_agree(place, name):
    """Whether what the cube's group says of its arrays, and of itself, is what these say."""
    with explained(place), suppress(ValueError, KeyError, TypeError, AttributeError):
        root = json.loads(_read(place, name, "zarr.json"))
        copies = root["consolidated_metadata"]["metadata"]
        own = {key: json.loads(_read(place, name, f"{key}/zarr.json")) for key in copies}
        witness = root["attributes"] | (own[COMMIT]["attributes"] if COMMIT in own else {})
        return own == copies and all(witness[k] == v for k, v in root["attributes"].items())
    return False


def _check_settings(place, cube):
    """The attributes of the cube that is there, None if there is none; Refused if it differs."""
    with explained(place):
        found = [_attributes(place, cube.name, key) for key in ("zarr.json", _WITNESS)]
        found = [attributes for attributes in found if attributes]
        same = [a for a in found if a["config_hash"] == cube.config_hash]
        if not found and _has_records(place, cube.name):
            raise Refused(
                f"the metadata of {place.cube(cube.name)} are lost; delete it, or choose another "
                "--out or --store"
            )
    if found and not same:
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
    return same[0] if same else None


def _attributes(place, name, key):
    """Attributes in a zarr.json of the cube; None if it is missing, damaged or not of a cube."""
    with suppress(ValueError, KeyError, TypeError, RecursionError):
        found = json.loads(_read(place, name, key))["attributes"]
        return found if "config_hash" in found else None
    return None


def _has_records(place, name):
    with suppress(FileNotFoundError):
        return any(place.objects().list(f"{name}.zarr/{COMMIT}/c"))
    return False


def _read(place, name, key):
    """The file's bytes; empty if it is missing."""
    with suppress(FileNotFoundError):
        return bytes(place.objects().get(f"{name}.zarr/{key}").bytes())
    return b""


def _delete(place, name, key):
    with suppress(FileNotFoundError):
        place.objects().delete(f"{name}.zarr/{key}")


def _differing(place, name, files):
    return {key: data for key, data in files.items() if _read(place, name, key) != data}


def _put_what_differs(place, name, files):
    for key, data in _differing(place, name, files).items():
        place.objects().put(f"{name}.zarr/{key}", data)


def _tile_counts(cube):
    return tuple(-(-cube.sizes[dim] // length) for dim, length in cube.tile.items())


def _empty_files(cube, computed):
    """{key: bytes} of the cube before any tile is there."""
    counts = _tile_counts(cube)
    words = {
        "long_name": "CPU time of the tile",
        "units": "s",
        "comment": "written last: the tile is complete if this is not NaN",
    }
    records = dask.array.full(counts, np.nan, chunks=-1)
    dims = tuple(f"tile_{dim}" for dim in cube.tile)
    attributes = _identity(cube, computed)
    dataset = cube.template.assign({COMMIT: (dims, records, words | attributes)})
    checked = {"compressors": (Crc32cCodec(),), "filters": None}
    encoding = {key: {"chunks": array.shape, **checked} for key, array in dataset.coords.items()}
    for key, array in cube.template.data_vars.items():
        chunks = tuple(cube.tile.get(dim, cube.sizes[dim]) for dim in array.dims)
        encoding[key] = {"chunks": chunks, **checked}
    encoding[COMMIT] = {"chunks": (1,) * len(counts), **checked}
    return _files(dataset.assign_attrs(attributes), encoding, compute=False)


def _whole_files(cube, computed):
    """{key: bytes} of a cube that is computed in full."""
    compressed = {"compressors": (ZstdCodec(), Crc32cCodec())}
    encoding = dict.fromkeys(cube.template.variables, compressed)
    dataset = cube.template.assign_attrs(_identity(cube, computed))
    return _files(dataset, encoding, compute=True)


def _identity(cube, computed):
    """Attributes: the plan of the cube, and of `computed` what tells who computes it."""
    kept = {key: computed[key] for key in PROVENANCE if key in computed}
    return {**kept, **cube.settings, "config_hash": cube.config_hash}


def _files(dataset, encoding, compute):
    files = {}
    with warnings.catch_warnings():
        # Zarr 3 has no standard for consolidated metadata yet; without them readers are warned.
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        dataset.to_zarr(
            MemoryStore(files),
            compute=compute,
            encoding=encoding,
            zarr_format=3,
            consolidated=True,
            write_empty_chunks=True,
        )
    return {key: buffer.to_bytes() for key, buffer in files.items()}
