"""Shared fixtures of the tests."""

import signal
import uuid

import pytest
import seaweed
import toy
from browser import chromium, served, store  # noqa: F401
from hypothesis import settings
from sketches import sketches

from pipeline.store import place_of

# Make Ctrl-C work in the tests and in the programs that they start, however pytest was started.
signal.signal(signal.SIGINT, signal.default_int_handler)

# No deadline: the first example compiles kernels, and any example may be slow on a busy machine.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")


LONGEST = ["test_every_command.py", "test_documents.py", "test_first_calls.py"]


def pytest_collection_modifyitems(items):
    """Run the longest files first; with -n, a long file started last would finish alone."""
    items.sort(key=lambda item: item.path.name not in LONGEST)


@pytest.fixture(scope="session", autouse=True)
def drawn_as_sketches():
    """Draw figures as sketches, unless `test_every_command` or `test_figures` needs full ones."""
    with sketches():
        yield


@pytest.fixture(scope="session")
def here():
    """Yield a function that returns a Client with one two-threaded worker in this process."""
    with toy.workers_here() as client:
        yield client


@pytest.fixture(scope="session")
def workers(here):
    """Return the options that make all commands in a session compute on the worker of `here`."""
    return ["--scheduler", here().scheduler.address]


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with seaweed.serving(tmp_path_factory.mktemp("weed")):
        yield


@pytest.fixture
def bucket(server):
    return place_of(f"s3://cubes/{uuid.uuid4().hex}/run")


@pytest.fixture
def on_disk(tmp_path):
    (tmp_path / "out").mkdir()
    return place_of(tmp_path / "out")


@pytest.fixture(params=["on_disk", pytest.param("bucket", marks=pytest.mark.slow)])
def place(request):
    return request.getfixturevalue(request.param)
