"""What tests of commands share."""

import signal

import pytest
import toy
from browser import chromium, page, served, store  # noqa: F401

# Ctrl-C works in the tests, and in the programs that they start, however pytest was started.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def workers():
    """Options by which all commands of a session compute on two threads of this process."""
    with toy.workers_here() as client:
        yield ["--scheduler", client().scheduler.address]
