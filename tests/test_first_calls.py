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


def jobs_of(command, out, monkeypatch):
    """List the jobs that a command plans with its smallest settings."""

    def plan(self, *jobs, later=(), **_):
        raise Planned(*jobs, *(job for job, _ in later))

    monkeypatch.setattr(Run, "sweeping", plan)
    with pytest.raises(Planned) as planned:
        main_of(command).main([*SMALLEST[command].split(), "--out", out], standalone_mode=False)
    return planned.value.args


@pytest.mark.slow
@pytest.mark.parametrize("command", SWEEPING)
def test_tiles_do_not_load_kernels_after_the_first_call(command, tmp_path, monkeypatch):
    file, jobs = tmp_path / "jobs", jobs_of(command, str(tmp_path), monkeypatch)
    file.write_bytes(cloudpickle.dumps(jobs))
    line = [sys.executable, program, str(file)]
    result = subprocess.run(line, capture_output=True, text=True, cwd=Path(__file__).parents[1])
    assert result.returncode == 0, result.stderr
    late = json.loads(result.stdout)
    assert jobs
    missed = {job.cube.name: kernels for job, kernels in zip(jobs, late, strict=True) if kernels}
    assert not missed
