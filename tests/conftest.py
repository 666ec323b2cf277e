"""What tests of commands share."""

import pytest
import toy


@pytest.fixture(scope="session")
def workers():
    """Options by which all commands of a session compute on two threads of this process."""
    with toy.workers_here() as client:
        yield ["--scheduler", client().scheduler.address]
