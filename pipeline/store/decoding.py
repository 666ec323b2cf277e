"""What is decoded of a store, which may be a stranger's: metadata are checked before any chunk is.

Metadata name the code that decodes chunks, some of which executes what it finds in them, and say
how much memory that takes. Only arrays like those of cubes are opened: of zarr 3, of numbers and
texts, with the codecs in `_CODECS`, and within the limits below. What a chunk claims to unpack to
is compared with its array before it is unpacked.
"""

from math import prod

from zarr import codecs, config
from zarr.registry import register_codec
from zarr.storage import ObjectStore

from pipeline.store.place import MAX_FILE, Refused

MAX_METADATA = 2**24  # bytes of a cube's zarr.json
MAX_TILE = 2**26  # bytes of a tile in memory: of one chunk of each array together
MAX_CHUNKS = 10**7  # chunks of an array; tiles of a cube; labels along all dimensions together
MAX_TEXTS = 10**5  # texts of all arrays together
MAX_TEXT = 2**17  # bytes: a rotation number of 1000 quotients of 100 digits fits

_MAX_ARRAYS = 1000
_MAX_FILL = 100  # characters of a fill value
_CODECS = {  # from values to files
    (values, *packed, *checked)
    for values in ("bytes", "vlen-utf8")
    for packed in ([], ["zstd"])
    for checked in ([], ["crc32c"])
}
_INTEGERS = {f"{u}int{bits}": bits // 8 for u in ("", "u") for bits in (8, 16, 32, 64)}
_BYTES = {"bool": 1, **_INTEGERS, "float32": 4, "float64": 8, "string": 64}  # in memory


def arrays_in(root, path):
    """Return {name: metadata} of the arrays that a group has by its zarr.json `root`, parsed.

    Refused if one of them is unlike those of cubes; the message names the group's path. Metadata
    that are cut or changed may raise whatever is in `tiles.DAMAGED`.
    """
    nodes = root["consolidated_metadata"]["metadata"]
    arrays = {name: node for name, node in nodes.items() if node["node_type"] == "array"}
    sizes = {name: prod(array["shape"]) for name, array in arrays.items()}

    def refuse(what):
        raise Refused(f"{path} is refused: {what}")

    if len(nodes) > _MAX_ARRAYS:
        refuse(f"it has more than {_MAX_ARRAYS} arrays")
    if root["zarr_format"] != 3:
        refuse("it is in another format than zarr 3")
    for name, node in nodes.items():
        if what := _oddity(name, node):
            refuse(f"{_shown(name)} has {what}")
    if sum(map(_chunk_bytes, arrays.values())) > MAX_TILE:
        words = f"take more than {MAX_TILE >> 20} MB; make tiles smaller"
        refuse(f"its tiles, one chunk of each array, {words}")
    if sum(n for name, n in sizes.items() if _dims(arrays[name]) == [name]) > MAX_CHUNKS:
        refuse(f"it has more than {MAX_CHUNKS} labels")
    if sum(n for name, n in sizes.items() if arrays[name]["data_type"] == "string") > MAX_TEXTS:
        refuse(f"it has more than {MAX_TEXTS} texts")
    return arrays


def _chunk_bytes(array):
    """Return the bytes of a chunk, unpacked, of the array with this metadata."""
    return _BYTES[array["data_type"]] * prod(_chunk_shape(array))


def _chunk_shape(array):
    return array["chunk_grid"]["configuration"]["chunk_shape"]


def _dims(array):
    return array.get("dimension_names")


def _oddity(name, node):
    """Return what no node of a cube has; "" if there is nothing."""
    if node["zarr_format"] != 3:
        return "another format than zarr 3"
    if {"", ".", ".."} & {*name.split("/")}:
        return "a name that is no path"
    if node["node_type"] == "group":
        below = node.get("consolidated_metadata")  # of no use, as the cube has all of them
        return "metadata of its own" if below and below["metadata"] else ""
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


def _shown(text):
    return f"{text!a:.80}"


class Files(ObjectStore):
    """The files of a store, as zarr reads them: none larger than any of a cube."""

    async def get(self, key, prototype, byte_range=None):
        if byte_range is not None:
            return await super().get(key, prototype, byte_range)
        try:
            file = await self.store.get_async(key)
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
            return None
        if file.meta["size"] > MAX_FILE:
            raise ValueError(f"{key} has more than {MAX_FILE} bytes")
        return prototype.buffer.from_bytes(await file.bytes_async())


class ZstdCodec(codecs.ZstdCodec):
    """The codec of zarr, for frames that unpack to what fits into memory.

    See RFC 8878, Sec. 3.1.1.1: a frame has a magic number, a descriptor, and the size of its
    content, in that order.
    """

    async def _decode_single(self, chunk_bytes, chunk_spec):
        size = _content_size(chunk_bytes.to_bytes())
        if size > MAX_TILE:
            raise ValueError(f"a chunk of {len(chunk_bytes)} bytes claims to unpack to {size}")
        return await super()._decode_single(chunk_bytes, chunk_spec)


def _content_size(frame):
    descriptor = frame[4]
    is_single = descriptor >> 5 & 1  # it has no byte for the size of a window
    n_bytes = (is_single, 2, 4, 8)[descriptor >> 6]
    start = 6 - is_single + (0, 1, 2, 4)[descriptor & 3]  # after the number of a dictionary
    if not n_bytes:
        raise ValueError("a chunk does not say to how many bytes it unpacks")
    return int.from_bytes(frame[start : start + n_bytes], "little") + 256 * (n_bytes == 2)


class VLenUTF8Codec(codecs.VLenUTF8Codec):  # by this name zarr knows the codec of texts
    """The codec of zarr, for chunks with as many texts as their array has there."""

    async def _decode_single(self, chunk_bytes, chunk_spec):
        data, n_texts = chunk_bytes.to_bytes(), prod(chunk_spec.shape)
        if int.from_bytes(data[:4], "little") != n_texts or len(data) > 4 + n_texts * MAX_TEXT:
            raise ValueError(f"a chunk of {len(data)} bytes does not hold {n_texts} texts")
        return await super()._decode_single(chunk_bytes, chunk_spec)


_BOUNDED = {"zstd": ZstdCodec, "vlen-utf8": VLenUTF8Codec}
for _name, _codec in _BOUNDED.items():
    register_codec(_name, _codec)


def usual_codecs():
    """Within this context arrays are opened with zarr's own codecs, bounded, whatever codecs and
    pipeline of codecs the user's files or environment name; others do not know all stores."""
    usual = config.defaults[0]
    bounded = {name: f"{codec.__module__}.{codec.__name__}" for name, codec in _BOUNDED.items()}
    named = usual["codecs"] | bounded
    return config.set({"codec_pipeline": usual["codec_pipeline"], "codecs": named})
