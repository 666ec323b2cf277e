"""A worker's first call compiles all kernels that the tiles of a job take: none has to wait."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from every_command import SMALLEST
from first_calls import __file__ as program

NOT_SWEEPING = """ask claims convergence explore gallery period_one portraits ramp self_consistent
    stability status verify work_precision"""
SWEEPING = [name for name in SMALLEST if name not in NOT_SWEEPING.split()]


@pytest.mark.slow
@pytest.mark.parametrize("command", SWEEPING)
def test_tiles_load_no_kernel_after_the_first_call(command):
    number, n_jobs, missed = 0, 1, {}
    while number < n_jobs:
        line = [sys.executable, program, str(number), command, *SMALLEST[command].split()]
        told = subprocess.run(line, capture_output=True, text=True, cwd=Path(__file__).parents[1])
        assert told.returncode == 0, told.stderr
        n_jobs, name, missed[name] = json.loads(told.stdout.splitlines()[-1])
        number += 1
    assert not any(missed.values()), missed
