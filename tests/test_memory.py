"""Memory that is freed: what becomes of it is the program's to say, and workers keep it."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

glibc = pytest.mark.skipif(
    not Path("/proc/self/statm").exists() or "CS_GNU_LIBC_VERSION" not in os.confstr_names,
    reason="other C libraries keep memory in their own ways",
)
PROGRAM = """
from test_memory import kept
import nasm.barriers, nasm.tori
print(kept())
"""


def kept():
    """Megabytes that the process keeps of 128 that it needed for a while."""

    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    before = resident()
    np.ones(2**24).sum()
    return (resident() - before) / 2**20


@glibc
def test_freed_memory_is_not_kept_by_an_import():
    here = Path(__file__).parent
    environment = os.environ | {"PYTHONPATH": f"{here}{os.pathsep}{here.parent}"}
    run = [sys.executable, "-c", PROGRAM]
    said = subprocess.run(run, env=environment, capture_output=True, check=True).stdout
    assert float(said) < 8
