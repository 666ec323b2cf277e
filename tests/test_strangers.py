"""Stores from untrusted sources can neither execute code nor exhaust memory."""

import json
import lzma
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import seaweed
import toy
import xarray as xr
from numcodecs import Zstd
from test_store import fill
from zarr.codecs import VLenUTF8Codec, ZstdCodec

from pipeline import store
from pipeline.cubes import proved
from pipeline.cubes.cube import Cube
from pipeline.sweep.cluster import ClusterError, connect

ZSTD = [{"name": "bytes", "configuration": {"endian": "little"}}]
ZSTD += [{"name": "zstd", "configuration": {"level": 0, "checksum": False}}]
TEXTS = {"data_type": "string", "fill_value": "", "codecs": [{"name": "vlen-utf8"}]}


@pytest.fixture
def place(tmp_path):
    place = store.place_of(tmp_path / "out")
    with store.driver_lock(place):
        fill(place, toy.cube())
    return place


def change(place, edit):
    """Edit the metadata of the toy cube's arrays; delete the digests that would reveal the edit."""
    path = Path(place.cube("toy"), "zarr.json")
    path.with_name("digests.json").unlink()
    root = json.loads(path.read_bytes())
    edit(root["consolidated_metadata"]["metadata"])
    path.write_text(json.dumps(root))


def messages_about(place):
    """Return one sentence, or "", from each of `status`, `verify` and `read` on the toy cube."""
    (state,) = store.status(place)
    (damage,) = list(store.verify(place, "toy")) or [((), "")]
    try:
        store.read(place, "toy").load()
        read = ""
    except (store.Refused, store.StoreFailed, ValueError) as error:
        read = str(error)
    sentences = state.damage, damage[1], read
    assert all(len(words) < 400 and "\n" not in words for words in sentences)
    return sentences


class Command:
    """An object that creates a directory when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def pickled(path):
    """Return the metadata of a zarr 2 array whose chunk is a pickle."""
    codecs = {"compressor": None, "filters": [{"id": "vlen-utf8"}, {"id": "pickle"}]}
    kind = {"dtype": "|O", "fill_value": "", "order": "C", "dimension_separator": "."}
    size = {"shape": [1], "chunks": [1], "attributes": {"_ARRAY_DIMENSIONS": ["evil"]}}
    return {"node_type": "array", "zarr_format": 2, **codecs, **kind, **size}


@pytest.mark.parametrize("where", ["evil", "tiles/evil", "in a group"])
def test_no_pickle_in_a_store_is_executed(place, tmp_path, monkeypatch, where):
    """No pickle is executed even by versions of numcodecs that unpickle any data."""
    monkeypatch.setattr("numcodecs.pickles.ALLOW_UNSAFE_PICKLE_DECODE", True, raising=False)
    evil = Path(place.cube("toy"), where)
    evil.mkdir()
    (evil / "0").write_bytes(pickle.dumps([Command(tmp_path / "executed")]))

    def edit(arrays):
        if where == "in a group":
            metadata = {"evil": pickled(evil)}
            arrays["tiles"]["consolidated_metadata"]["metadata"] = metadata
        else:
            arrays[where] = pickled(evil)

    change(place, edit)
    sentences = messages_about(place)
    assert not (tmp_path / "executed").exists()
    assert all("is refused: " in s for s in sentences)


def resize(array, n, chunk):
    array["shape"], array["chunk_grid"]["configuration"]["chunk_shape"] = [n], [chunk]


def many_arrays(arrays):
    arrays |= {f"copy{i}": arrays["row"] for i in range(1001)}


def extend(array, **metadata):
    return lambda arrays: arrays[array].update(metadata)


REFUSED = [
    ("more than 10000000 chunks", lambda arrays: resize(arrays["row"], 10**12, 1)),
    ("more than 10000000 chunks", extend("tiles/commit", shape=[2, 10**6, 10**6])),
    ("more than 10000000 chunks", extend("tiles/commit", shape=[2, int("9" * 4000), 1])),
    ("more than 64 MB", lambda arrays: resize(arrays["row"], 10**11, 10**11)),
    ("more than 10000000 labels", lambda arrays: resize(arrays["row"], 10**8, 10**4)),
    ("more than 100000 strings", extend("cell", **TEXTS, shape=[10**3, 10**3])),
    ("more than 1000 arrays", many_arrays),
    ("the codecs 'bytes, zstd, zstd'", extend("row", codecs=[*ZSTD, ZSTD[1]])),
    ("the codecs 'numcodecs.pickle'", extend("row", codecs=[{"name": "numcodecs.pickle"}])),
    ("values of the type 'r8000000000'", extend("row", data_type="r8000000000")),
    ("a fill value that is too long", extend("row", fill_value="9" * 1000)),
    ("a name that is not a path", lambda arrays: arrays.update({"../row": arrays["row"]})),
    ("are damaged", lambda arrays: resize(arrays["row"], 10, 0)),
    ("are damaged", extend("row", shape=["10"])),
]


@pytest.mark.parametrize(("words", "edit"), REFUSED)
def test_metadata_that_no_cube_can_have_are_refused_in_one_sentence(place, words, edit):
    change(place, edit)
    assert all(words in sentence for sentence in messages_about(place))


@pytest.mark.parametrize(
    "edit",
    [
        lambda arrays: arrays["tiles/commit"]["attributes"].update(of_tiles=["../../x", "wave"]),
        lambda arrays: arrays["tiles/commit"]["attributes"].update(cube=[]),
        extend("tiles/commit", shape=[1, 4, 5]),
        extend("tiles/commit", shape=[2, 5000, 500]),
        extend("sign", shape=[9, 13]),
    ],
)
def test_records_that_do_not_match_the_tiles_are_refused_in_one_sentence(place, edit):
    change(place, edit)
    state, damage, _ = messages_about(place)  # a cube is read without its records
    assert state == damage
    assert "are damaged, from another program" in state


def endless():
    """Return a zstd frame that declares no size: 64 blocks of 4 bytes, each encoding 2^17 zeros."""
    block, last = ((2**17 << 3 | 2 | end).to_bytes(3, "little") + b"\0" for end in (0, 1))
    return b"\x28\xb5\x2f\xfd\x00\x58" + 63 * block + last


def claim(n):
    """Return the beginning of a zstd frame that claims to unpack to n bytes."""
    return b"\x28\xb5\x2f\xfd\xe0" + n.to_bytes(8, "little")


BOMBS = {
    "claims 8 GB": (ZSTD, claim(2**33)),
    "declares no size": (ZSTD, endless()),
    "is truncated": (ZSTD, claim(80)[:4]),
    "contains 10^8 texts": (TEXTS["codecs"], (10**8).to_bytes(4, "little")),
    "contains one long text": (TEXTS["codecs"], b"\x0a\0\0\0" + bytes(2**21)),
}


@pytest.mark.parametrize("case", BOMBS)
def test_a_chunk_that_claims_to_be_large_is_not_unpacked(place, monkeypatch, case):
    codecs, chunk = BOMBS[case]
    for codec in (ZstdCodec, VLenUTF8Codec):
        monkeypatch.setattr(codec, "_decode_single", lambda *_: pytest.fail("it was unpacked"))
    texts = TEXTS if codecs == TEXTS["codecs"] else {}
    change(place, extend("row", **{**texts, "codecs": codecs}))
    Path(place.cube("toy"), "row/c/0").write_bytes(chunk)
    state, damage, read = messages_about(place)
    assert (state, damage) == ("", "row cannot be read")
    assert "are damaged" in read


@pytest.mark.parametrize("chunk", [Zstd(1).encode(bytes(2**20)), claim(80) + b"no block"])
def test_a_chunk_that_does_not_unpack_to_its_array_counts_as_damaged(place, chunk):
    change(place, extend("row", codecs=ZSTD))
    Path(place.cube("toy"), "row/c/0").write_bytes(chunk)
    state, damage, read = messages_about(place)
    assert (state, damage) == ("", "row cannot be read")
    assert "are damaged" in read


@pytest.mark.parametrize("name", ["row/c/0", "zarr.json", "digests.json"])
def test_a_file_larger_than_any_in_a_cube_is_not_read(place, name):
    os.truncate(f"{place.cube('toy')}/{name}", 10**11)  # sparse: takes no space on disk
    assert f"toy.zarr/{name} has 100000000000 bytes" in messages_about(place)[1]
    Path(place.cube("toy"), "digests.json").unlink()
    words = {"row/c/0": "row cannot be read", "zarr.json": "has 100000000000 bytes"}
    assert words.get(name, "") in messages_about(place)[1]


def test_foreign_files_next_to_the_tiles_do_not_change_the_status(place):
    folder = Path(place.cube("toy"))
    (folder / ".wanted").write_text("9" * 5000)
    (folder / ".failed").mkdir()
    (folder / ".failed" / f"{'1' * 100}.0").write_text("x")
    (state,) = store.status(place)
    assert (state.tiles, state.done, state.failed) == (20, 20, 0)


def test_messages_omit_user_and_password_in_the_url_of_an_endpoint(monkeypatch):
    monkeypatch.setattr("pipeline.store.place.PATIENCE", 0.1)
    for user in ("user:passw0rd", ":passw0rd", "passw0rd"):
        failed = pytest.raises(store.StoreFailed, match=r"GET http://127\.0\.0\.1:9/cubes")
        with seaweed.environment(f"http://{user}@127.0.0.1:9"), failed as error:
            store.names(store.place_of("s3://cubes/run"))
        assert "passw0rd" not in str(error.value)


@pytest.mark.parametrize("user", ["user:passw0rd@", "user:pass/w0rd@", "passw0rd@"])
def test_messages_omit_user_and_password_in_the_address_of_a_scheduler(user):
    for n_workers, message in ((None, "must be tcp://HOST:PORT"), (2, "has its own workers")):
        refused = pytest.raises(ClusterError, match=message)
        with refused as error, connect(f"tcp://{user}localhost:8786", n_workers):
            pass
        assert "w0rd" not in str(error.value)
        assert "localhost:8786" in str(error.value)


def test_a_cube_that_could_not_be_read_back_is_not_written(tmp_path):
    plan = toy.cube(3000, 3000, tile=3000)
    place = store.place_of(tmp_path)
    with pytest.raises(store.Refused, match=r"^the cube toy .* tiles smaller"):
        store.create(place, plan, "mathematics 1")
    assert not any(tmp_path.iterdir())


def test_the_longest_strings_that_a_cube_may_contain_can_be_read(place):
    """Such a string is a rotation number with 1000 partial quotients of 100 digits."""
    text = f"[{','.join(['9' * 100] * 1000)}]"
    cube = Cube("texts", xr.Dataset({"omega": ("x", np.array([text, ""], dtype=object))}), {}, {})
    store.replace(place, cube, "mathematics 1")
    assert store.read(place, "texts").omega.values.tolist() == [text, ""]


def test_the_cost_of_checking_a_certificate_grows_with_all_its_lifetimes():
    assert proved.seconds_to_check({"lives": [10**6, 1]}) == pytest.approx(50, rel=1e-3)
    assert proved.seconds_to_check({"lives": [[10**6, 1], [1, 1]]}) == pytest.approx(50, rel=1e-3)


@pytest.mark.parametrize(
    "lives", [[10**9, -(10**9)], [0], [1, True], [1.5], ["9"], [[1, 0]], [[[1]]], [10**400]]
)
def test_certificates_whose_boxes_have_invalid_lifetimes_are_not_checked(lives):
    with pytest.raises((ValueError, OverflowError)):
        proved.seconds_to_check({"lives": lives})


def test_the_longest_function_in_a_certificate_determines_its_cost():
    short, long = [[0], [0]], [[0], [0] * 1000]
    cost = {
        name: proved.seconds_to_check({"kappa": ["0x1p0"], "moves": {"numbers": numbers}})
        for name, numbers in {
            "first": [[[long], [short]], [[short], [short]]],
            "last": [[[short], [short]], [[short], [long]]],
            "none": [[[short], [short]], [[short], [short]]],
        }.items()
    }
    assert cost["first"] == cost["last"] > 100 * cost["none"]


def test_certificates_that_are_damaged_or_too_large_are_refused(monkeypatch):
    many = b"[" + b",".join([b'{"kappa": ["0x1.8p+1"]}'] * 100) + b"]"
    assert len(proved.unpack_certificates(lzma.compress(many))) == 100
    for bomb in (lzma.compress(bytes(10**8)), lzma.compress(many)[:-9], b"no file of xz"):
        with pytest.raises(ValueError, match=r"100 times their size|format|cut"):
            proved.unpack_certificates(bomb)

    def exhausted(text):
        raise MemoryError

    monkeypatch.setattr("json.loads", exhausted)
    with pytest.raises(ValueError, match="not enough memory"):
        proved.unpack_certificates(lzma.compress(many))
