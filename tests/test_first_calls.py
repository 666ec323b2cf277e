"""A worker's first call compiles all kernels of a job; later tiles do not load any kernels."""

import json
import subprocess
import sys
from pathlib import Path

import cloudpickle
import pytest
from every_command import SMALLEST
from first_calls import __file__ as program

from workflows.shared.cli import main_of
from workflows.shared.run import Run

WITHOUT_SWEEPS = """ask explore period_one portraits ramp reference self_consistent snapshot_tori
    stability status verify work_precision"""
# The gallery only runs other commands.
SWEEPING = [name for name in SMALLEST if name not in (*WITHOUT_SWEEPS.split(), "gallery")]


class Planned(Exception):
    pass


def jobs_of(command, out):
    """List the jobs that a command plans with its smallest settings."""

    def plan(self, *jobs, later=(), **_):
        raise Planned(*jobs, *(job for job, _ in later))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Run, "sweeping", plan)
        with pytest.raises(Planned) as planned:
            main_of(command).main([*SMALLEST[command].split(), "--out", out], standalone_mode=False)
    return planned.value.args


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """Return {command: [(cube, kernels that tiles load late)]}; one process examines all jobs."""
    folder, jobs = tmp_path_factory.mktemp("jobs"), []
    for command in SWEEPING:
        jobs += [(command, job) for job in jobs_of(command, str(folder / command))]
    (folder / "jobs").write_bytes(cloudpickle.dumps([job for _, job in jobs]))
    line = [sys.executable, program, str(folder / "jobs")]
    result = subprocess.run(line, capture_output=True, text=True, cwd=Path(__file__).parents[1])
    assert result.returncode == 0, result.stderr
    found = {command: [] for command in SWEEPING}
    for (command, job), kernels in zip(jobs, json.loads(result.stdout), strict=True):
        found[command].append((job.cube.name, kernels))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("command", SWEEPING)
def test_tiles_do_not_load_kernels_after_the_first_call(command, late):
    assert late[command]
    assert [(cube, kernels) for cube, kernels in late[command] if kernels] == []
