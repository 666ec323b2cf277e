"""Metadata of cubes, determined by the cube and its code, and written before any tile.

The first driver to write the group's zarr.json creates the cube; the settings of any other driver
must agree with it. A second file, NAME.zarr/digests.json, contains the same attributes, and a
digest of each file that does not belong to a tile. It shows whether metadata or coordinates were
changed, and which settings the cube has. If both files are lost, the checksums in the commit
records show which settings the tiles were computed with.
"""

import dataclasses
import hashlib
import json
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from zarr import Array
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.storage import MemoryStore

from nasm import __version__
from pipeline.provenance import EVERYTHING, PROGRAM
from pipeline.store import tiles
from pipeline.store.decoding import MAX_METADATA, arrays_in, usual_codecs
from pipeline.store.place import Place, Refused, printable, store_errors, without_password
from pipeline.store.tiles import COMMIT, DAMAGED, ENTRIES, ENTRY, FORMAT

if TYPE_CHECKING:
    from pipeline.cubes.cube import Cube

DIGESTS = "digests.json"
"""Name of the file that contains the digests of a cube."""

_MAX_NAMED = 3  # maximum number of changed files that a message names
_MAX_CHUNK = 1024  # maximum number of cells along each dim of a chunk, in cubes without tiles

COMPUTED_BY = EVERYTHING.computed_by
"""The code, on one line, for cubes not computed by a job; jobs have `job.code.computed_by`."""


def names(place: Place) -> list[str]:
    """Return the names of the cubes in a place; raise Refused if the place does not exist."""
    with store_errors(place):
        try:
            folders = place.objects().list_with_delimiter()["common_prefixes"]
        except FileNotFoundError:
            raise Refused(f"{place} does not exist; give the --out or --store of a run") from None
    return sorted(name.removesuffix(".zarr") for name in folders if name.endswith(".zarr"))


def check(place: Place, cube: "Cube", computed_by: str) -> dict[str, Any]:
    """Check that a cube may be resumed; write nothing.

    Parameters
    ----------
    place : Place
        Where the cube is stored.
    cube : Cube
        The plan of the cube.
    computed_by : str
        The code that computes the cube, `job.code.computed_by`.

    Returns
    -------
    dict
        The attributes of the cube in the store, or {} if the cube does not exist yet.

    Raises
    ------
    Refused
        If the stored cube has different settings, or is incomplete and was started by different
        code.
    """
    attributes = _check_settings(place, cube)
    if not attributes:
        _check_tiles(place, cube, computed_by)
    elif (theirs := attributes.get("computed_by")) != computed_by and not _is_complete(place, cube):
        reason = f"was computed by {theirs}; this is {computed_by}. Resume it with the former"
        raise Refused(f"{place.cube(cube.name)} {reason}, or choose another --out or --store")
    return attributes


def create(place: Place, cube: "Cube", computed_by: str, call: str = "") -> None:
    """Create the cube with all tiles missing, or check that an existing cube may be resumed.

    Damaged or missing metadata and coordinates are rewritten. The other parameters and the errors
    are the same as for `check`.

    Parameters
    ----------
    call : str
        The command or call that creates the cube. An existing cube keeps its `history`.
    """
    tiles.forget()
    attributes, root = check(place, cube, computed_by), _key(cube.name)
    if not attributes:
        ours = _provenance(computed_by, call)
        place.write(root, _files(cube, ours)[root], "create")
        attributes = check(place, cube, computed_by) or ours  # another driver may have been first
    for key, data in _differing(place, _files(cube, attributes)).items():
        place.write(key, data)


def replace(place: Place, cube: "Cube", computed_by: str, call: str = "") -> None:
    """Write a complete cube, compressed, in place of any earlier version of it.

    Nothing is written if that version is identical and was computed by the same code. The group's
    zarr.json is deleted first and written last: in between, and after a crash, the cube does not
    exist. The parameters, and the error if the settings differ, are the same as for `create`.
    """
    template, by = cube.template.compute(), _provenance(computed_by, call)
    # If the template was made from another cube, drop the provenance of that cube.
    template.attrs = {key: value for key, value in template.attrs.items() if key not in by}
    cube = dataclasses.replace(cube, template=template)
    attributes = _check_settings(place, cube)
    is_same_code = attributes.get("computed_by") == computed_by
    if is_same_code and not _differing(place, _files(cube, attributes)):
        return
    place.delete(_key(cube.name))
    files = _files(cube, by)
    for key in sorted(files, key=_key(cube.name).__eq__):
        place.write(key, files[key])


def is_visible(place: Place, name: str, config_hash: str) -> bool:
    """Return True if this process can read the cube; workers call this before each batch."""
    tiles.forget()  # the cube may have been deleted and recreated
    return _attributes(place, name).get("config_hash") == config_hash


def _provenance(computed_by: str, call: str) -> dict[str, str]:
    """Return attributes of a new cube: the program that computes it, the time, and the call."""
    created = datetime.now(UTC).isoformat(timespec="seconds")
    return {
        "source": PROGRAM,
        "history": f"{created} {printable(without_password(call)) or PROGRAM}",
        "computed_by": computed_by,
        "package_version": __version__,
        "created": created,
    }


def _check_settings(place: Place, cube: "Cube") -> dict[str, Any]:
    """Return the attributes of the stored cube, or {}; raise Refused if its settings differ."""
    attributes = _noted(place, cube.name)[0] or _attributes(place, cube.name)
    if {"config_hash": cube.config_hash, "store_format": FORMAT}.items() <= attributes.items():
        return attributes
    if not attributes:
        for file in ("zarr.json", ".zgroup", ".zarray"):  # another program's files, in zarr 3 or 2
            with suppress(ValueError, RecursionError):
                if json.loads(place.read(f"{cube.name}.zarr/{file}", MAX_METADATA)):
                    raise _not_ours(place, cube.name)
        return {}
    differences = [
        f"{key} is {_brief(attributes.get(key))}, not {_brief(value)}"
        for key, value in cube.attributes.items()
        if attributes.get(key) != value
    ]
    raise Refused(
        f"{place.cube(cube.name)} was computed with different settings: "
        f"{'; '.join(differences) or 'its coordinates, tiles, variables or format differ'}. "
        "Use the same settings to resume it, or choose another --out or --store"
    )


def _brief(setting: Any) -> Any:
    """Shorten a setting for messages: a plane becomes its name, other settings do not change."""
    with suppress(KeyError, RecursionError, TypeError, ValueError):
        return json.loads(setting)["name"]  # the setting is a plane
    return setting


def _attributes(place: Place, name: str) -> dict[str, Any]:
    """Return the cube's attributes, or {} if it is missing, damaged or from another program."""
    with suppress(*DAMAGED):
        return _parsed(place.read(_key(name), MAX_METADATA))
    return {}


def _parsed(data: bytes) -> dict[str, Any]:
    """Parse the cube's attributes in zarr.json or digests.json; raise only errors in DAMAGED."""
    attributes = json.loads(data)["attributes"]
    attributes.pop("coordinates", None)  # xarray adds this attribute
    if not isinstance(attributes["config_hash"], str):
        raise TypeError
    return attributes


def _noted(place: Place, name: str) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the contents of digests.json: the cube's attributes, and {file: its digest}.

    Both are empty if the file is damaged, or missing, as in cubes written by earlier versions.
    """
    with suppress(*DAMAGED):
        data = place.read(f"{name}.zarr/{DIGESTS}", MAX_METADATA)
        return _parsed(data), dict(json.loads(data)["sha256"])
    return {}, {}


def has_digests(place: Place, name: str) -> bool:
    """Return True if the cube has digests of its metadata; cubes of earlier versions have none."""
    return place.size(f"{name}.zarr/{DIGESTS}") > 0


def changes(place: Place, name: str) -> str:
    """Return a message that names the changed or lost files of a cube and the remedy.

    Metadata and coordinate files are compared with their digests; in a cube without tiles, all
    files are.

    Returns
    -------
    str
        The message, or "" if no file differs or the cube has no digests.
    """
    if not has_digests(place, name):
        return ""
    digests = _noted(place, name)[1] or {DIGESTS: ""}
    paths = [
        path
        for path, digest in digests.items()
        if _digest(place.read(f"{name}.zarr/{path}")) != digest
    ]
    if not paths:
        return ""
    more = f" and {len(paths) - _MAX_NAMED} more" if len(paths) > _MAX_NAMED else ""
    files = f"{', '.join(path[:100] for path in paths[:_MAX_NAMED])}{more} of {place.cube(name)}"
    return f"{files}: changed or lost; to restore it, rerun the command that computed it"


def _digest(data: bytes) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(data).hexdigest()


def _check_tiles(place: Place, cube: "Cube", computed_by: str) -> None:
    """Check tiles without metadata: workers leave them behind if a cube is deleted during a sweep.

    Raise Refused unless the checksums in their records show that all tiles with data belong to this
    cube and were computed by the same code.
    """
    if any(place.files(f"{cube.name}.zarr/{COMMIT}")):
        arrays = _planned(place, cube, {"computed_by": computed_by})
        for index in np.argwhere(tiles.commit_times(place, arrays)[0]).tolist():
            if tiles.damage(place, arrays, index):
                raise _not_ours(place, cube.name)


def _is_complete(place: Place, cube: "Cube") -> bool:
    """Return True if no tile is missing."""
    return not cube.computed or bool(tiles.commit_times(place, _planned(place, cube, {}))[0].all())


def _planned(place: Place, cube: "Cube", by: Mapping[str, Any]) -> dict[str, Array]:
    """Return the cube's zarr arrays as planned, regardless of its metadata in the store."""
    return tiles.opened(place, cube.name, json.loads(_files(cube, by)[_key(cube.name)]))


def _not_ours(place: Place, name: str) -> Refused:
    """Return the error for a group that is not a cube."""
    reason = "is not a cube from this program, or its metadata are lost"
    cure = "delete it, or choose another --out or --store"
    return Refused(f"{place.cube(name)} {reason}; {cure}")


def _key(name: str) -> str:
    """Return the key of the cube's zarr.json."""
    return f"{name}.zarr/zarr.json"


def _differing(place: Place, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files whose contents differ from those in the store."""
    return {key: data for key, data in files.items() if place.read(key) != data}


def _files(cube: "Cube", by: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the files {key: bytes} that make up the cube before any tile is written.

    If the cube's template contains all values, the files also contain them, compressed.

    by : attributes that state which code computes the cube.
    """
    ours = {"config_hash": cube.config_hash, "store_format": FORMAT}
    labels = cube.template.attrs  # first, so that reading them back yields the same order
    identity = {**labels, **by, **labels, **cube.attributes, **ours}
    # Zarr 3 has no standard for NumPy's string type.
    variables = cube.template.variables
    texts = {k: v.astype(object) for k, v in variables.items() if v.dtype.kind == "U"}
    groups = {"/": cube.template.assign(texts).assign_attrs(identity)}
    encoding: dict[str, dict[Any, dict[str, Any]]] = {"/": {}}
    computed = cube.computed
    for key, array in variables.items():
        if computed:
            # A coordinate is stored in one chunk, because readers need all of it.
            tile = {} if array.dims == (key,) else cube.tile
            chunks = [tile.get(str(dim), n) for dim, n in array.sizes.items()]
            encoding["/"][key] = _encoding(array.dtype, chunks)
        else:  # along each dim, chunks have the same length in all variables
            chunks = [min(n, _MAX_CHUNK) for n in array.shape]
            encoding["/"][key] = _encoding(array.dtype, chunks, ZstdCodec())
    if computed:
        import dask.array  # takes 0.3 s, and workers do not need it

        (group, name), counts = COMMIT.split("/"), cube.tile_counts
        labels_of_records = {
            "long_name": "CPU seconds of the tile, and the CRC-32 of its data",
            "units": "1",
            "entries": list(ENTRIES),
            "of_tiles": [*computed, COMMIT],
            "cube": identity,
            "comment": "written last: the tile is complete if this is not NaN",
        }
        dims, shape = (ENTRY, *(f"tile_{dim}" for dim in cube.tile)), (len(ENTRIES), *counts)
        blank = xr.Variable(dims, dask.array.full(shape, np.nan, chunks=-1), labels_of_records)
        groups[group] = xr.Dataset({name: blank})
        encoding[f"/{group}"] = {name: _encoding(blank.dtype, [len(ENTRIES), *(1 for _ in counts)])}
    options: dict[str, Any] = {
        "encoding": encoding,
        "compute": not computed,
        "zarr_format": 3,
        "consolidated": True,
        "write_empty_chunks": True,
    }
    buffers: dict[str, Any] = {}
    with warnings.catch_warnings(), usual_codecs():
        # Zarr 3 has no standard for consolidated metadata yet, but without them xarray warns.
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        xr.DataTree.from_dict(groups).to_zarr(MemoryStore(buffers), **options)
    files = {key: buffer.to_bytes() for key, buffer in buffers.items()}
    arrays_in(json.loads(files["zarr.json"]), f"the cube {cube.name}")
    digests = {key: _digest(data) for key, data in files.items()}
    noted = {"attributes": _parsed(files["zarr.json"]), "sha256": digests}
    files[DIGESTS] = json.dumps(noted).encode()
    return {f"{cube.name}.zarr/{key}": data for key, data in files.items()}


def _encoding(dtype: np.dtype, chunks: Sequence[int], *codecs: ZstdCodec) -> dict[str, Any]:
    """Return zarr's settings for an array; its fill value represents missing chunks.

    For integers, the fill value is an extreme value of the dtype, which is never computed. For
    floats, it is NaN, which can also be a computed value.
    """
    encoding: dict[str, Any] = {
        "chunks": tuple(chunks),
        "compressors": (*codecs, Crc32cCodec()),
        "filters": None,
    }
    if dtype.kind in "iu":
        limits = np.iinfo(dtype)
        encoding["fill_value"] = int(limits.min or limits.max)
    elif dtype.kind == "f":
        encoding["fill_value"] = np.nan
    return encoding
