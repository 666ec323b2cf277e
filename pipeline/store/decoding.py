"""Decode stores that may be untrusted: metadata are checked before any chunk is read.

The metadata name the codecs that decode chunks, and some codecs execute the bytes of a chunk. The
metadata also determine how much memory decoding takes. Only arrays like those in cubes are opened:
zarr 3 arrays of numbers or strings, with the codecs in `_CODECS`, and within the limits below. The
unpacked size that a chunk declares is checked before it is unpacked.
"""

import asyncio
from contextlib import AbstractContextManager
from math import prod
from typing import TYPE_CHECKING, Any, NoReturn

from zarr import codecs, config
from zarr.abc.store import OffsetByteRequest, RangeByteRequest, SuffixByteRequest
from zarr.registry import register_codec
from zarr.storage import ObjectStore

from pipeline.store.place import MAX_FILE, Refused

if TYPE_CHECKING:
    from zarr.abc.store import ByteRequest
    from zarr.core.array_spec import ArraySpec
    from zarr.core.buffer import Buffer, BufferPrototype, NDBuffer

MAX_METADATA = 2**24
"""Maximum size of a cube's zarr.json, in bytes."""

MAX_TILE = 2**26
"""Maximum size in memory, in bytes, of a tile: one chunk of each array."""

MAX_CHUNKS = 10**7
"""Maximum number of chunks per array, of tiles per cube, and of labels along all dims together."""

MAX_TEXTS = 10**5
"""Maximum number of strings in all arrays together."""

MAX_TEXT = 2**17
"""Maximum size of a string, in bytes: enough for 1000 partial quotients of 100 digits each."""

_MAX_ARRAYS = 1000
_MAX_FILL = 100  # characters of a fill value
_CODECS = {  # each sequence in order of encoding
    (values, *packed, *checked)
    for values in ("bytes", "vlen-utf8")
    for packed in ([], ["zstd"])
    for checked in ([], ["crc32c"])
}
_INTEGERS = {f"{u}int{bits}": bits // 8 for u in ("", "u") for bits in (8, 16, 32, 64)}
_BYTES = {"bool": 1, **_INTEGERS, "float32": 4, "float64": 8, "string": 64}  # in memory


def arrays_in(root: dict[str, Any], path: str) -> dict[str, Any]:
    """Return the metadata of each array in a group, and check that they are like those in cubes.

    Parameters
    ----------
    root : dict
        The group's zarr.json, parsed.
    path : str
        Path of the group, for messages.

    Raises
    ------
    Refused
        If an array is unlike those in cubes.
    tiles.DAMAGED
        Metadata that are truncated or changed may raise any error in this tuple.
    """
    nodes = root["consolidated_metadata"]["metadata"]
    arrays = {name: node for name, node in nodes.items() if node["node_type"] == "array"}
    sizes = {name: prod(array["shape"]) for name, array in arrays.items()}

    def refuse(reason: str) -> NoReturn:
        raise Refused(f"{path} is refused: {reason}")

    if len(nodes) > _MAX_ARRAYS:
        refuse(f"it has more than {_MAX_ARRAYS} arrays")
    if root["zarr_format"] != 3:
        refuse("its format is not zarr 3")
    for name, node in nodes.items():
        if oddity := _oddity(name, node):
            refuse(f"{_shown(name)} has {oddity}")
    if sum(map(_chunk_bytes, arrays.values())) > MAX_TILE:
        limit = f"{MAX_TILE >> 20} MB"
        refuse(f"its tiles, one chunk of each array, take more than {limit}; make tiles smaller")
    if sum(n for name, n in sizes.items() if _dims(arrays[name]) == [name]) > MAX_CHUNKS:
        refuse(f"it has more than {MAX_CHUNKS} labels")
    if sum(n for name, n in sizes.items() if arrays[name]["data_type"] == "string") > MAX_TEXTS:
        refuse(f"it has more than {MAX_TEXTS} strings")
    return arrays


def _chunk_bytes(array: dict[str, Any]) -> int:
    """Return the unpacked size, in bytes, of a chunk of the array with this metadata."""
    return _BYTES[array["data_type"]] * prod(_chunk_shape(array))


def _chunk_shape(array: dict[str, Any]) -> list[int]:
    """Return the shape of a chunk of the array with this metadata."""
    return array["chunk_grid"]["configuration"]["chunk_shape"]


def _dims(array: dict[str, Any]) -> list[str] | None:
    """Return the names of the dimensions of the array with this metadata."""
    return array.get("dimension_names")


def _oddity(name: str, node: dict[str, Any]) -> str:
    """Return a property in which the node differs from nodes in cubes, or "" if there is none."""
    if node["zarr_format"] != 3:
        return "a format other than zarr 3"
    if {"", ".", ".."} & {*name.split("/")}:
        return "a name that is not a path"
    if node["node_type"] == "group":
        within = node.get("consolidated_metadata")  # must be empty; the root has all metadata
        return "metadata of its own" if within and within["metadata"] else ""
    names = tuple(codec["name"] for codec in node["codecs"])
    kind, fill = node["data_type"], node["fill_value"]
    if names not in _CODECS:
        return f"the codecs {_shown(', '.join(names))}"
    if kind not in _BYTES:
        return f"values of the type {_shown(kind)}"
    if len(str(fill)) > _MAX_FILL or (kind == "string" and fill):
        return "a fill value that is too long"
    chunks = (-(-n // size) for n, size in zip(node["shape"], _chunk_shape(node), strict=True))
    return f"more than {MAX_CHUNKS} chunks" * (prod(chunks) > MAX_CHUNKS)


def _shown(text: object) -> str:
    """Return the text in ASCII, truncated to 80 characters."""
    return f"{text!a:.80}"


class Files(ObjectStore):
    """A zarr store that refuses to read a file of more than MAX_FILE bytes.

    Files are read and written in Python threads, which end before the interpreter. With obstore's
    coroutines, one of its own threads could still be returning a result when the interpreter ends,
    which would abort the process.
    """

    async def get(
        self, key: str, prototype: "BufferPrototype", byte_range: "ByteRequest | None" = None
    ) -> "Buffer | None":
        try:
            data = await asyncio.to_thread(self._read, key)
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
            return None
        return prototype.buffer.from_bytes(data[_bytes_in(byte_range)])

    def _read(self, key: str) -> bytes:
        """Return the content of a file."""
        file = self.store.get(key)
        if file.meta["size"] > MAX_FILE:
            raise ValueError(f"{key} has more than {MAX_FILE} bytes")
        return bytes(file.bytes())

    async def exists(self, key: str) -> bool:
        try:
            await asyncio.to_thread(self.store.head, key)
        except FileNotFoundError:
            return False
        return True

    async def set(self, key: str, value: "Buffer") -> None:
        self._check_writable()
        await asyncio.to_thread(self.store.put, key, value.as_buffer_like())


def _bytes_in(byte_range: "ByteRequest | None") -> slice:
    """Return the slice of a file that is requested."""
    match byte_range:
        case RangeByteRequest(start, end):
            return slice(start, end)
        case OffsetByteRequest(offset):
            return slice(offset, None)
        case SuffixByteRequest(suffix):
            return slice(-suffix, None)
    return slice(None)


class ZstdCodec(codecs.ZstdCodec):
    """Zarr's zstd codec, restricted to frames that unpack to at most MAX_TILE bytes.

    See RFC 8878, Sec. 3.1.1.1: a frame has a magic number, a descriptor, and the size of its
    content, in that order.
    """

    async def _decode_single(self, chunk_bytes: "Buffer", chunk_spec: "ArraySpec") -> "Buffer":
        size = _content_size(chunk_bytes.to_bytes())
        if size > MAX_TILE:
            raise ValueError(f"a chunk of {len(chunk_bytes)} bytes claims to unpack to {size}")
        return await super()._decode_single(chunk_bytes, chunk_spec)


def _content_size(frame: bytes) -> int:
    """Return the unpacked size that a frame declares, in bytes."""
    descriptor = frame[4]
    is_single = descriptor >> 5 & 1  # a single segment has no window descriptor
    n_bytes = (is_single, 2, 4, 8)[descriptor >> 6]
    start = 6 - is_single + (0, 1, 2, 4)[descriptor & 3]  # after the dictionary ID
    if not n_bytes:
        raise ValueError("a chunk does not declare its unpacked size")
    return int.from_bytes(frame[start : start + n_bytes], "little") + 256 * (n_bytes == 2)


class VLenUTF8Codec(codecs.VLenUTF8Codec):  # zarr finds the codec by this class name
    """Zarr's string codec, restricted to chunks with as many strings as their shape requires."""

    async def _decode_single(self, chunk_bytes: "Buffer", chunk_spec: "ArraySpec") -> "NDBuffer":
        data, n_texts = chunk_bytes.to_bytes(), prod(chunk_spec.shape)
        if int.from_bytes(data[:4], "little") != n_texts or len(data) > 4 + n_texts * MAX_TEXT:
            raise ValueError(f"a chunk of {len(data)} bytes does not hold {n_texts} strings")
        return await super()._decode_single(chunk_bytes, chunk_spec)


_BOUNDED = {"zstd": ZstdCodec, "vlen-utf8": VLenUTF8Codec}
for _name, _codec in _BOUNDED.items():
    register_codec(_name, _codec)


def usual_codecs() -> AbstractContextManager[object]:
    """Return a context in which arrays are opened with zarr's own codecs, within the limits above.

    Codecs and codec pipelines set in the user's configuration files or environment variables are
    ignored, because they may not support every store.
    """
    usual = config.defaults[0]
    bounded = {name: f"{codec.__module__}.{codec.__name__}" for name, codec in _BOUNDED.items()}
    named = usual["codecs"] | bounded
    return config.set({"codec_pipeline": usual["codec_pipeline"], "codecs": named})
