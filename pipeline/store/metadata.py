"""Metadata of cubes: a function of the cube and of who computes it, written before any tile.

Whoever puts the group's zarr.json first has made the cube; any other driver must agree with it. A
file beside it, NAME.zarr/digests.json, holds the same attributes, and a digest of each file that no
tile fills: these show whether metadata or coordinates were changed, and whose the cube is. If they
are lost too, the checksums in the records of tiles tell whose these are.
"""

import dataclasses
import hashlib
import json
import warnings
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import dask.array
import numpy as np
import xarray as xr
from zarr.codecs import Crc32cCodec, ZstdCodec
from zarr.storage import MemoryStore

from nasm import __version__
from pipeline.store import tiles
from pipeline.store.decoding import MAX_METADATA, arrays_in, usual_codecs
from pipeline.store.place import Refused, store_errors
from pipeline.store.tiles import COMMIT, DAMAGED, ENTRIES, ENTRY, FORMAT

DIGESTS = "digests.json"
_TOLD = 3  # files that are named where more have changed
_CHUNK = 1024  # along each dim, of cubes that are written whole
_PACKAGE = Path(__file__).parents[2]
_MATHEMATICS = sorted([*_PACKAGE.glob("nasm/**/*.py"), *_PACKAGE.glob("pipeline/cubes/**/*.py")])
_DECIDING = "llvmlite", "numba", "numpy", "rocket-fft", "scipy", "xarray", "zarr"
# Of the files as they are imported: a process that runs on while they are edited has the old ones.
# The version of the package alone would miss an edit.
_FILES = b"".join(
    path.relative_to(_PACKAGE).as_posix().encode() + path.read_bytes() for path in _MATHEMATICS
)
_VERSIONS = (f"{package} {version(package)}" for package in _DECIDING)
# What decides the numbers of a cube besides its plan, in one line: source and libraries.
COMPUTED_BY = ", ".join([f"mathematics {hashlib.sha256(_FILES).hexdigest()[:12]}", *_VERSIONS])


def names(place):
    """Names of the cubes in the place; Refused if it does not exist."""
    with store_errors(place):
        try:
            folders = place.objects().list_with_delimiter()["common_prefixes"]
        except FileNotFoundError:
            raise Refused(f"{place} does not exist; give the --out or --store of a run") from None
    return sorted(name.removesuffix(".zarr") for name in folders if name.endswith(".zarr"))


def check(place, cube, computed_by):
    """Refuse to continue a cube that has other settings, or that other code has begun.

    Writes nothing. Returns the attributes of the cube that is there, {} if there is none.
    """
    found = _check_settings(place, cube)
    if not found:
        _check_tiles(place, cube, computed_by)
    elif (theirs := found.get("computed_by")) != computed_by and not _is_complete(place, cube):
        words = f"was computed by {theirs}; this is {computed_by}. Resume it with those versions"
        raise Refused(f"{place.cube(cube.name)} {words}, or choose another --out or --store")
    return found


def create(place, cube, computed_by):
    """Make the cube, all tiles missing, or check that the one in the place is the same.

    Metadata and coordinates that are damaged or missing are written again. Refused as by `check`.
    """
    tiles.forget()
    found, root = check(place, cube, computed_by), _key(cube.name)
    if not found:
        ours = _provenance(computed_by)
        place.write(root, _files(cube, ours)[root], "create")
        found = check(place, cube, computed_by) or ours  # another driver may have been first
    for key, data in _differing(place, _files(cube, found)).items():
        place.write(key, data)


def replace(place, cube, computed_by):
    """Write a cube that is computed in full, compressed, in place of an earlier state of itself.

    Nothing is written if that state is the same, and by the same code. The group's zarr.json is
    deleted first and written last: until then, also after a crash, there is no such cube. Refused
    on other settings.
    """
    cube = dataclasses.replace(cube, template=cube.template.compute())
    found = _check_settings(place, cube)
    if found.get("computed_by") == computed_by and not _differing(place, _files(cube, found)):
        return
    place.delete(_key(cube.name))
    files = _files(cube, _provenance(computed_by))
    for key in sorted(files, key=_key(cube.name).__eq__):
        place.write(key, files[key])


def is_visible(place, name, config_hash):
    """Whether this process finds that cube in the place. A worker asks it before each batch."""
    tiles.forget()  # the cube may have been deleted and made anew
    return _attributes(place, name).get("config_hash") == config_hash


def _provenance(computed_by):
    """Attributes of a new cube: who computes it, which version of the package, and when."""
    return {
        "computed_by": computed_by,
        "package_version": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _check_settings(place, cube):
    """The attributes of the cube that is there, {} if there is none; Refused if it differs."""
    found = _noted(place, cube.name)[0] or _attributes(place, cube.name)
    if {"config_hash": cube.config_hash, "store_format": FORMAT}.items() <= found.items():
        return found
    if not found:
        for file in ("zarr.json", ".zgroup", ".zarray"):  # by another program, in zarr 3 or 2
            with suppress(ValueError, RecursionError):
                if json.loads(place.read(f"{cube.name}.zarr/{file}", MAX_METADATA)):
                    raise _not_ours(place, cube.name)
        return {}
    differences = [
        f"{key} is {_brief(found.get(key))}, not {_brief(value)}"
        for key, value in cube.attributes.items()
        if found.get(key) != value
    ]
    raise Refused(
        f"{place.cube(cube.name)} was computed with other settings: "
        f"{'; '.join(differences) or 'its coordinates, tiles, variables or format differ'}. "
        "Repeat the old settings to resume it, or choose another --out or --store"
    )


def _brief(setting):
    with suppress(KeyError, RecursionError, TypeError, ValueError):
        return json.loads(setting)["name"]  # of a plane
    return setting


def _attributes(place, name):
    """The attributes of the cube, {} if it is not there, is damaged, or is another program's."""
    with suppress(*DAMAGED):
        return _parsed(place.read(_key(name), MAX_METADATA))
    return {}


def _parsed(data):
    """The cube's attributes in a zarr.json, or in what is noted beside it; one of DAMAGED."""
    found = json.loads(data)["attributes"]
    found.pop("coordinates", None)  # xarray's own word
    if not isinstance(found["config_hash"], str):
        raise TypeError
    return found


def _noted(place, name):
    """What is noted beside the metadata: the cube's attributes, and {file: its digest}. Empty if
    nothing is, as by earlier versions, or if it is damaged."""
    with suppress(*DAMAGED):
        data = place.read(f"{name}.zarr/{DIGESTS}", MAX_METADATA)
        return _parsed(data), dict(json.loads(data)["sha256"])
    return {}, {}


def has_digests(place, name):
    """Whether digests of the cube's metadata were noted, which earlier versions did not do."""
    return place.size(f"{name}.zarr/{DIGESTS}") > 0


def changes(place, name):
    """Say which files of the cube's metadata and coordinates are not as they were written, or of a
    cube that was written whole which of all; "" if none is known to differ."""
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
    more = f" and {len(paths) - _TOLD} more" if len(paths) > _TOLD else ""
    told = f"{', '.join(path[:100] for path in paths[:_TOLD])}{more} of {place.cube(name)}"
    return f"{told}: changed or lost; run again the command that computed it, which restores them"


def _digest(data):
    return hashlib.sha256(data).hexdigest()


def _check_tiles(place, cube, computed_by):
    """Look at tiles without metadata, which workers write after the cube was deleted under way.

    Refused unless all whose data are there are of this cube and computed by the same code, by the
    checksums in their records.
    """
    if any(place.files(f"{cube.name}.zarr/{COMMIT}")):
        arrays = _planned(place, cube, {"computed_by": computed_by})
        for index in np.argwhere(tiles.commit_times(place, arrays)[0]).tolist():
            if tiles.damage(place, arrays, index):
                raise _not_ours(place, cube.name)


def _is_complete(place, cube):
    """Whether no tile is missing."""
    return not cube.computed or tiles.commit_times(place, _planned(place, cube, {}))[0].all()


def _planned(place, cube, by):
    """{name: zarr array} of the cube by its plan, whatever its metadata in the store say."""
    return tiles.opened(place, cube.name, json.loads(_files(cube, by)[_key(cube.name)]))


def _not_ours(place, name):
    words = "is not a cube of this program, or its metadata are lost; delete it, or choose"
    return Refused(f"{place.cube(name)} {words} another --out or --store")


def _key(name):
    return f"{name}.zarr/zarr.json"


def _differing(place, files):
    return {key: data for key, data in files.items() if place.read(key) != data}


def _files(cube, by):
    """{key: bytes} of the cube before any tile is there, or with all values, compressed, if its
    template has them; `by` tells who computed it."""
    ours = {"config_hash": cube.config_hash, "store_format": FORMAT}
    labels = cube.template.attrs  # first, so that the order is the same when they are read again
    identity = {**labels, **by, **labels, **cube.attributes, **ours}
    # NumPy's type of text has no standard in zarr 3.
    variables = cube.template.variables
    texts = {k: v.astype(object) for k, v in variables.items() if v.dtype.kind == "U"}
    groups, encoding = {"/": cube.template.assign(texts).assign_attrs(identity)}, {"/": {}}
    computed = cube.computed
    for key, array in variables.items():
        if computed:
            tile = {} if array.dims == (key,) else cube.tile  # indices are read whole
            chunks, codecs = [tile.get(dim, n) for dim, n in array.sizes.items()], ()
        else:  # one length for each dim, in all of them
            chunks, codecs = [min(n, _CHUNK) for n in array.shape], (ZstdCodec(),)
        encoding["/"][key] = _encoding(array.dtype, chunks, *codecs)
    if computed:
        (group, name), counts = COMMIT.split("/"), cube.tile_counts
        words = {"long_name": "CPU seconds of the tile, and the CRC-32 of its data", "units": "1"}
        words |= {"entries": list(ENTRIES), "of_tiles": [*computed, COMMIT], "cube": identity}
        words["comment"] = "written last: the tile is complete if this is not NaN"
        dims, shape = (ENTRY, *(f"tile_{dim}" for dim in cube.tile)), (len(ENTRIES), *counts)
        blank = xr.Variable(dims, dask.array.full(shape, np.nan, chunks=-1), words)
        groups[group] = xr.Dataset({name: blank})
        encoding[f"/{group}"] = {name: _encoding(blank.dtype, [len(ENTRIES), *(1 for _ in counts)])}
    how = {"zarr_format": 3, "consolidated": True, "write_empty_chunks": True}
    files, tree = {}, xr.DataTree.from_dict(groups)
    with warnings.catch_warnings(), usual_codecs():
        # Zarr 3 has no standard for consolidated metadata yet; without them readers are warned.
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        tree.to_zarr(MemoryStore(files), encoding=encoding, compute=not computed, **how)
    files = {key: buffer.to_bytes() for key, buffer in files.items()}
    arrays_in(json.loads(files["zarr.json"]), f"the cube {cube.name}")
    digests = {key: _digest(data) for key, data in files.items()}
    noted = {"attributes": _parsed(files["zarr.json"]), "sha256": digests}
    files[DIGESTS] = json.dumps(noted).encode()
    return {f"{cube.name}.zarr/{key}": data for key, data in files.items()}


def _encoding(dtype, chunks, *codecs):
    """How zarr keeps an array. A lost chunk of it reads as no number that is ever computed."""
    how = {"chunks": tuple(chunks), "compressors": (*codecs, Crc32cCodec()), "filters": None}
    if dtype.kind in "iu":
        limits = np.iinfo(dtype)
        how["fill_value"] = int(limits.min or limits.max)
    elif dtype.kind == "f":
        how["fill_value"] = np.nan
    return how
