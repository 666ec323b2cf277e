"""The store in an object store: a server of S3's protocol on this machine, in memory."""

import os
import pickle
import re
import socket
import subprocess
import sys
import threading
import time
import uuid
from contextlib import contextmanager, suppress
from urllib.request import Request, urlopen

import numpy as np
import pytest
import toy
import xarray as xr
from click.testing import CliRunner
from obstore.store import S3Store
from pipeline.admission import ClusterError, sharing
from pipeline.faults import StorageError
from pipeline.layout import layout_of
from pipeline.schema import FORMAT
from zarr.storage import ObjectStore

import workflows.status
import workflows.verify
from pipeline import lease, objects, store
from pipeline.store import StoreError
from workflows import escape_plane

SECRET = "not-to-be-found-anywhere"


@contextmanager
def serving():
    """The address of a server with the empty bucket `cubes`, and its process."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    address = f"http://127.0.0.1:{port}"
    try:
        for _ in range(300):
            try:
                request(address, "cubes", "PUT")
                break
            except OSError:
                time.sleep(0.1)
        yield address, server
    finally:
        server.kill()
        server.wait()


def request(address, path, method, data=None):
    headers = {"Content-Type": "text/plain"}
    urlopen(Request(f"{address}/{path}", data=data, method=method, headers=headers)).close()


@contextmanager
def environment(address):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", address)
        patch.setenv("AWS_ALLOW_HTTP", "true")
        patch.setenv("AWS_REGION", "us-east-1")
        patch.setenv("AWS_ACCESS_KEY_ID", "somebody")
        patch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
        objects._opened.cache_clear()
        yield
    objects._opened.cache_clear()


@pytest.fixture(scope="module")
def server():
    with serving() as (address, _), environment(address):
        yield address


@pytest.fixture
def url(server):
    return f"s3://cubes/{uuid.uuid4().hex}/run"


@pytest.fixture(scope="module")
def client():
    """Workers in this process, where a test can make the server fail."""
    with toy.workers_here() as client:
        yield client


def bare(url):
    """The store, without a line of ours."""
    bucket, _, prefix = url.removeprefix("s3://").partition("/")
    return S3Store(bucket, prefix=prefix)


def assert_complete(url, plan):
    cube = xr.open_zarr(ObjectStore(bare(f"{url}/cubes.zarr"), read_only=True), group=plan.name)
    for name, values in toy.serial(plan).items():
        assert np.array_equal(cube[name].values, values)
    assert np.isfinite(cube.cpu_seconds).all()


def test_a_sweep_reads_back_without_us_and_is_done(client, url):
    plan = toy.cube()
    assert toy.watched_sweep(client, url, plan).committed == 20
    assert_complete(url, plan)
    assert toy.watched_sweep(client, url, plan).committed == 0
    tree = xr.open_datatree(ObjectStore(bare(f"{url}/cubes.zarr"), read_only=True), engine="zarr")
    assert set(tree.children) == {"toy"}


def test_the_status_tells_tiles_rate_and_driver_and_writes_nothing(client, url, tmp_path):
    said = []

    def ask():
        command = ["--out", str(tmp_path / "none"), "--store", url]
        said.append(CliRunner().invoke(workflows.status.main, command))

    asking = threading.Thread(target=ask)
    toy.watched_sweep(client, url, toy.cube(seconds=0.02), {6: asking.start, 15: asking.join})
    assert said[0].exit_code == 0
    assert re.search(rf"a driver is at work \(process {os.getpid()} on \S+, heard", said[0].output)
    assert re.search(r"toy: \d+ of 20 tiles \(\d+\.0%\), \d+ missing; ", said[0].output)
    before = {entry["path"]: entry["e_tag"] for page in bare(url).list() for entry in page}
    assert ".probe" not in before
    ask()
    assert "no driver" in said[1].output
    assert "toy: 20 of 20 tiles; " in said[1].output
    assert "last tile" in said[1].output
    assert before == {entry["path"]: entry["e_tag"] for page in bare(url).list() for entry in page}
    assert not (tmp_path / "none").exists()


def test_workers_see_an_object_store_by_what_the_driver_put_there(client, url, monkeypatch):
    with store.driving(url):
        with sharing(client, url):
            assert bare(url).get(".probe").bytes()
        assert store.place_of(url).names() == {store.STORE}
        monkeypatch.setattr(objects.Objects, "read", lambda place, key: None)
        with (
            pytest.raises(ClusterError, match=f"does not see {url} as this machine does"),
            sharing(client, url),
        ):
            pass


def test_other_settings_other_files_and_other_versions_are_refused(client, url):
    toy.watched_sweep(client, url, toy.cube(depth=1))
    with pytest.raises(StoreError, match="depth is 1, not 2"):
        toy.watched_sweep(client, url, toy.cube(depth=2))
    with pytest.raises(StoreError, match="the values of row differ"):
        toy.watched_sweep(client, url, toy.cube(rows=11, depth=1))
    above = url.removesuffix("/run")
    with pytest.raises(StoreError, match="holds other files"):
        toy.watched_sweep(client, above, toy.cube())
    root = bare(f"{url}/cubes.zarr")
    text = bytes(root.get("zarr.json").bytes())
    root.put("zarr.json", text.replace(FORMAT.encode(), b"nasm-cubes/0"))
    with pytest.raises(StoreError, match="nasm-cubes/0"):
        toy.watched_sweep(client, url, toy.cube(depth=1))


def test_a_driver_that_dies_with_half_a_group_is_followed_by_another(client, url, monkeypatch):
    plan = toy.cube()
    put = S3Store.put

    def put_until_root(self, key, data, **kwargs):
        if key.endswith("toy/zarr.json"):
            raise KeyboardInterrupt
        return put(self, key, data, **kwargs)

    class Dying:
        """The obstore, of a driver that dies before it writes the group's own metadata."""

        def __getattr__(self, name):
            return getattr(bare(url), name)

        def put(self, key, data, **kwargs):
            return put_until_root(bare(url), key, data, **kwargs)

    with store.driving(url):
        with monkeypatch.context() as patch:
            patch.setattr(objects.Objects, "_store", Dying())
            with pytest.raises(KeyboardInterrupt):
                store.create(url, plan)
        assert any(objects.Objects(url).sizes("cubes.zarr/toy"))
    assert toy.watched_sweep(client, url, plan).committed == 20
    assert_complete(url, plan)


def test_replacing_a_cube_leaves_nothing_of_the_old_one(url):
    with store.driving(url):
        for n in (5, 3):
            template = xr.Dataset({"square": ("x", np.arange(n) ** 2)}, {"x": np.arange(n)})
            objects.Objects(url).delete_group("cubes.zarr/squares")
            store.replace(url, toy.Cube("squares", template, {}, {}))
            assert store.read(url, "squares").equals(template)


def test_lost_credentials_stop_a_sweep_and_it_goes_on_with_them(client, server, url):
    plan = toy.cube(tile=2)

    def revoke():
        request(server, "moto-api/reset-auth", "POST", b"0")

    try:
        with pytest.raises(StorageError, match="cannot be used with the credentials") as raised:
            toy.watched_sweep(client, url, plan, {10: revoke})
    finally:
        request(server, "moto-api/reset-auth", "POST", b"inf")
    assert SECRET not in str(raised.value)
    assert len(toy.COMPUTED) < 20
    release(url)
    assert toy.watched_sweep(client, url, plan).remaining == 0
    assert 15 < len(toy.COMPUTED) < 35
    assert_complete(url, plan)


def release(url):
    """The lease of a driver that could not release it: as if it had expired."""
    bare(url).put(".lease", b"")


def test_wrong_credentials_and_a_missing_bucket_are_refused(client, server, url):
    request(server, "moto-api/reset-auth", "POST", b"0")
    try:
        with pytest.raises(StoreError, match="set AWS_ACCESS_KEY_ID"):
            toy.watched_sweep(client, url, toy.cube())
    finally:
        request(server, "moto-api/reset-auth", "POST", b"inf")
    with pytest.raises(StoreError, match="in a bucket that does not exist; create it"):
        toy.watched_sweep(client, "s3://no-such-bucket/run", toy.cube())


def test_a_server_that_goes_away_is_one_clear_message(client, monkeypatch):
    monkeypatch.setattr(objects, "PATIENCE", 0.3)
    url = "s3://cubes/gone/run"
    with serving() as (address, process), environment(address):
        start = time.monotonic()
        with pytest.raises(StorageError, match=r"does not answer within 0\.3 s"):
            toy.watched_sweep(client, url, toy.cube(tile=2), {10: process.kill})
        assert len(toy.COMPUTED) < 20
        assert time.monotonic() - start < 20
        with pytest.raises(StoreError, match=r"does not answer within 0\.3 s"):
            toy.watched_sweep(client, url, toy.cube())


def test_a_second_driver_is_refused_for_as_long_as_the_first_lives(url, monkeypatch):
    monkeypatch.setattr(lease, "LEASE", 1)
    with store.driving(url):
        time.sleep(2.1)  # without renewals the lease would have expired
        with (
            pytest.raises(StoreError, match=rf"another run \(process {os.getpid()} on "),
            store.driving(url),
        ):
            pass
    with store.driving(url):
        pass


def test_the_lease_of_a_driver_that_was_killed_is_taken_over_when_it_expires(url, monkeypatch):
    script = f"from pipeline import store\nwith store.driving({url!r}): input()"
    other = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    deadline = time.monotonic() + 60
    while not objects.Objects(url).size("cubes.zarr/zarr.json"):
        assert time.monotonic() < deadline
        time.sleep(0.05)
        assert other.poll() is None
    other.kill()
    other.communicate()
    with pytest.raises(StoreError, match=rf"process {other.pid} on .*try again in"):
        toy.watched_sweep(None, url, toy.cube())
    monkeypatch.setattr(lease, "LEASE", 1)
    time.sleep(2.1)
    with store.driving(url):
        pass


def test_one_of_many_takes_over_an_expired_lease(url, monkeypatch):
    monkeypatch.setattr(lease, "LEASE", -1)
    shop = bare(url)
    lease._take(shop, url, {"run": "dead", "process": 1, "host": "h"})
    found, _ = lease._read(shop)
    monkeypatch.setattr(lease, "_read", lambda store: (found, {"run": "dead"}))
    taken = []

    def take(name):
        with suppress(StoreError):
            taken.append(lease._take(shop, url, {"run": name, "process": 1, "host": "h"}))

    threads = [threading.Thread(target=take, args=[str(i)]) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(taken) == 1


def test_a_driver_whose_lease_was_taken_says_so(url, monkeypatch):
    monkeypatch.setattr(lease, "LEASE", 1)
    with (
        pytest.raises(StorageError, match="was taken over by another run"),
        store.driving(url),
    ):
        bare(url).put(".lease", b'{"run": "other", "process": 1, "host": "h"}')


@pytest.mark.parametrize("body", [b"garbage", b'{"a": 1}', b"[1]", b"5"])
def test_a_lease_that_is_none_keeps_others_out_until_it_expires(url, monkeypatch, body):
    bare(url).put(".lease", body)
    assert "process ?" in objects.Objects(url).driver()
    with pytest.raises(StoreError, match=r"another run \(process \? on \?"), store.driving(url):
        pass
    monkeypatch.setattr(lease, "LEASE", -1)
    with store.driving(url):
        pass


@pytest.mark.parametrize(
    ("variable", "value", "message"),
    [
        ("AWS_CONDITIONAL_PUT", "disabled", "set to do without conditions on writes"),
        ("AWS_ENDPOINT_URL", "not a url", "cannot be opened with what the environment says"),
        ("AWS_ACCESS_KEY_ID", f"a\n{SECRET}", "cannot be opened with what the environment says"),
    ],
)
def test_an_environment_that_cannot_be_is_one_message(
    url, monkeypatch, tmp_path, variable, value, message
):
    with store.driving(url):
        pass
    with monkeypatch.context() as patch:
        patch.setenv(variable, value)
        objects._opened.cache_clear()
        result = CliRunner().invoke(
            workflows.verify.main, ["--out", str(tmp_path), "--store", url, "--repair"]
        )
    objects._opened.cache_clear()
    assert result.exit_code in (1, 2)
    assert message in result.output
    assert SECRET not in result.output


def test_a_store_that_ignores_conditions_is_refused(url, monkeypatch):
    class Careless:
        def __getattr__(self, name):
            return getattr(bare(url), name)

        def put(self, key, data, mode=None):
            return bare(url).put(key, data)

    with (
        pytest.raises(StoreError, match="ignores conditions on writes"),
        lease.leased(Careless(), url),
    ):
        pass


def test_damaged_objects_are_found_and_computed_again(client, url):
    plan = toy.cube()
    toy.watched_sweep(client, url, plan)
    chunk = "cubes.zarr/toy/sign/c/2/1"
    data = bytearray(bytes(bare(url).get(chunk).bytes()))
    data[3] ^= 4
    bare(url).put(chunk, bytes(data))
    invoke = CliRunner().invoke
    result = invoke(workflows.verify.main, ["--store", url])
    assert result.exit_code == 1
    assert "tile (2, 1): sign does not match its checksum" in result.output
    assert invoke(workflows.verify.main, ["--store", url, "--repair"]).exit_code == 0
    assert toy.watched_sweep(client, url, plan).committed == 1
    assert_complete(url, plan)


@pytest.mark.parametrize(
    "url",
    [
        f"s3://somebody:{SECRET}@cubes/run",
        f"s3://cubes/run?X-Amz-Signature={SECRET}",
        f"somebody:{SECRET}@cubes/run",
        f"s3://cubes/{SECRET}#",
        f"ftp://cubes/{SECRET}",
        f"s3://{SECRET}",
        f"s3:///{SECRET}",
        f"s3://cubes/../{SECRET}",
        f"s3://cubes/{SECRET}/.",
    ],
)
@pytest.mark.parametrize("option", ["--store", "--out"])
def test_a_url_with_a_secret_is_refused_and_not_repeated(tmp_path, monkeypatch, url, option):
    if option == "--out" and "://" not in url:
        return
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(escape_plane.main, [option, url])
    assert result.exit_code == 2
    assert SECRET not in result.output + repr(result.exception)
    assert os.listdir(tmp_path) == []


def test_tables_are_not_put_beside_other_cubes_or_into_a_file(tmp_path, url):
    with store.driving(tmp_path / "out"):
        pass
    (tmp_path / "file").write_text("")
    for out, message in (("out", "holds cubes of its own"), ("file", "is a file")):
        places = ["--out", str(tmp_path / out), "--store", url]
        result = CliRunner().invoke(escape_plane.main, places)
        assert result.exit_code == 2
        assert message in result.output
    assert not objects.Objects(url).names()


def test_a_workflow_keeps_cubes_there_figures_here_and_secrets_nowhere(client, url, tmp_path):
    plane = ["--kappa1", "0:1:8", "--kappa2", "0:1:8", "--tile", "4", "--n-max", "100"]
    places = ["--out", str(tmp_path / "out"), "--store", url]
    workers = ["--scheduler", client.scheduler.address]
    result = CliRunner().invoke(
        escape_plane.main, [*plane, "--n-orbits", "8", *places, *workers], catch_exceptions=False
    )
    assert result.exit_code == 0, result.output
    assert f"{url}/cubes.zarr, group escape" in result.output
    cube = xr.open_zarr(ObjectStore(bare(f"{url}/cubes.zarr"), read_only=True), group="escape")
    assert not cube.escape_time.isnull().any()
    made = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"escape_plane.png", "escape_plane.pdf"} <= made
    assert store.STORE not in made
    written = [(tmp_path / "out" / name).read_bytes() for name in made]
    for page in bare(url).list():
        written += [bytes(bare(url).get(entry["path"]).bytes()) for entry in page]
    assert len(written) > 10
    everything = b"".join(written) + result.output.encode()
    everything += pickle.dumps(layout_of(store.place_of(url), toy.cube()))  # what workers get
    assert SECRET.encode() not in everything
    assert b"somebody" not in everything
