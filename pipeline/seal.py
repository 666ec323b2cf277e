"""The seal of a cube: one digest of all that says what its numbers mean, kept among its attributes.

It covers the metadata and coordinates of a sweep's cube, whose tiles have checksums of their own,
and of a cube that was written whole every file. So a file that is gone is seen too, which to zarr
is a chunk of fill values.
"""

import hashlib
import json

_SEAL = "seal"


def sealed(files):
    """The files {key in the group: bytes} with their seal among the group's attributes."""
    root = json.loads(files["zarr.json"])
    root["attributes"][_SEAL] = _digest(root, sorted(files.items()))
    return {**files, "zarr.json": json.dumps(root).encode()}


def is_intact(place, group, tiled):
    """Whether the group, a key of the place, is as it was sealed.

    tiled : names of the arrays whose chunks are tiles.
    """
    root = parsed(place.read(f"{group}/zarr.json"))
    try:
        arrays = sorted(root["consolidated_metadata"]["metadata"])
        seal = root["attributes"].pop(_SEAL)
    except (KeyError, TypeError):
        return False
    start = len(group) + 1
    keys = [f"{group}/{name}/zarr.json" for name in arrays]
    for name in arrays:
        if name not in tiled:
            chunks = (key for key, _ in place.sizes(f"{group}/{name}/c"))
            # Not those of file browsers.
            keys += (key for key in chunks if not key.rpartition("/")[2].startswith("."))
    return seal == _digest(root, ((key[start:], place.read(key)) for key in sorted(keys)))


def parsed(data):
    """The JSON object in the bytes, or None if there is none, or in no bytes."""
    try:
        found = json.loads(data)
    except (TypeError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _digest(root, files):
    """Of the group's own metadata, without a seal, and of the other files, in the order of keys."""
    digest = hashlib.sha256(json.dumps(root, sort_keys=True).encode())
    for key, data in files:
        if key != "zarr.json":
            digest.update(f"\n{key} {len(data or b'')}\n".encode() + (data or b""))
    return digest.hexdigest()[:16]
