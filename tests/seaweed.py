"""A real S3 server on this machine: SeaweedFS."""

import json
import os
import shutil
import socket
import subprocess
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from unittest.mock import patch
from urllib.request import urlopen

from obstore.store import from_url

from pipeline.store import place as places

SECRET = "not-to-be-found-anywhere"
_WEED = shutil.which("weed") or shutil.which("weed", path=Path(os.sys.executable).parent)
_SERVERS = "master", "volume", "filer", "s3"  # each has two ports, one of them for gRPC


@contextmanager
def serving(folder):
    """Serve objects stored in a folder, with the environment set so that obstore uses the server.

    Yield two functions: one kills the server as a crash would, the other restarts it.
    """
    config = folder / "identities.json"
    credentials = [{"accessKey": "somebody", "secretKey": SECRET}]
    identity = {"name": "us", "credentials": credentials, "actions": ["Admin"]}
    config.write_text(json.dumps({"identities": [identity]}))
    ports = free_ports(2 * len(_SERVERS))
    options = [
        f"-{server}.port{kind}={ports.pop()}" for server in _SERVERS for kind in ("", ".grpc")
    ]
    address = options[6].replace("-s3.port=", "http://127.0.0.1:")
    others = "-ip=127.0.0.1 -ip.bind=127.0.0.1 -s3.port.iceberg=0 -s3.port.lance=0 "
    others += "-master.telemetry=false -master.volumeSizeLimitMB=64 -volume.max=20"
    command = [_WEED, "server", f"-dir={folder}", "-s3", f"-s3.config={config}"]
    command, servers = [*command, *options, *others.split()], []

    def start():
        with open(folder / "log", "ab") as log:
            servers.append(subprocess.Popen(command, stdout=log, stderr=log))
        until = time.monotonic() + 60
        while time.monotonic() < until:
            with suppress(OSError):
                urlopen(f"{address}/status", timeout=5).close()
                break
            assert servers[-1].poll() is None, (folder / "log").read_text()[-2000:]
            time.sleep(0.1)

    def kill():
        servers[-1].kill()
        servers[-1].wait()

    try:
        start()
        with environment(address):
            from_url("s3://cubes").put("begin", b"")  # this creates the bucket
            yield kill, start
    finally:
        kill()


def free_ports(n):
    with ExitStack() as sockets:
        held = [sockets.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(n)]
        return [one.getsockname()[1] for one in held]


@contextmanager
def environment(address):
    """Set the variables from which obstore reads the server's address and a user's credentials."""
    variables = {
        "AWS_ENDPOINT_URL": address,
        "AWS_ALLOW_HTTP": "true",
        "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "somebody",
        "AWS_SECRET_ACCESS_KEY": SECRET,
    }
    with patch.dict(os.environ, variables):
        places._opened.cache_clear()
        yield
    places._opened.cache_clear()
