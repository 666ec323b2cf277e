"""Results are the same on processors for which NumPy and BLAS choose different loops."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
from test_cubes import JOBS, LONG, QUICK

from nasm import orbits
from nasm.arithmetic.reproducible import geometric, powers
from nasm.planes import two_kicks
from pipeline.cubes import breakdown
from pipeline.sweep.grid import tile_coords
from workflows.shared import direct_iteration
from workflows.shared.rays import PAPER_CIRCLES

JOBS = JOBS | {
    "paper's circles": breakdown.by_continuation(
        two_kicks(), PAPER_CIRCLES, np.linspace(0, 180, 9), 1e-3
    )
}
SOME = ["beyond", "continuation", "residue", "tori", "flux"]
ALL = [name for name in [*QUICK, *LONG, "paper's circles"] if name != "frequencies"]
ELSEWHERE = {
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": " ".join(
        name
        for name in __cpu_dispatch__
        if __cpu_features__[name] and (name.startswith("AVX512") or name == "X86_V4")
    ),
}


def digest(*arrays):
    return hashlib.sha256(b"".join(map(bytes, map(np.ascontiguousarray, arrays)))).hexdigest()


def values(name):
    job = JOBS[name]
    tiles = tile_coords(job.cube, np.argwhere(np.ones(job.cube.tile_counts)))
    return [array for _, at in tiles for array in job.compute(at, job.cube.settings).values()]


def tell(*names):
    """Print, as JSON, digests of the jobs' results, and of results from NumPy itself."""
    x = np.linspace(0.1, 3, 1001)
    rays = direct_iteration.bias_job(two_kicks(), {45.0: 1.0}, [64], 100)
    output = {"numpy": digest(np.exp(x), np.dot(x, x))}
    output["coordinates"] = [job.cube.config_hash for job in (*JOBS.values(), rays)]
    output["rotation numbers"] = digest(*orbits.rotation_number((0.5, 0.4), 0.1, x, 1000))
    output |= {name: digest(*values(name)) for name in names}
    print(json.dumps(output))


@pytest.mark.parametrize("names", [SOME, pytest.param(ALL, marks=pytest.mark.slow)])
def test_cubes_are_bit_identical_if_numpy_and_blas_use_different_loops(names):
    here = Path(__file__).parent
    program = [sys.executable, "-c", f"import test_reproducible as this; this.tell(*{names})"]
    output = []
    for more in ({}, ELSEWHERE):
        paths = {"PYTHONPATH": f"{here}{os.pathsep}{here.parent}"}
        run = subprocess.run(program, env=os.environ | paths | more, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        output.append(json.loads(run.stdout))
    if output[0].pop("numpy") == output[1].pop("numpy"):
        pytest.skip("NumPy and its BLAS have no alternative loops on this processor")
    assert output[0] == output[1]


def test_geometric_sequences_and_powers_agree_with_numpy_up_to_rounding():
    for first, last, n in ((0.01, 1, 121), (0.5, 1e-6, 20), (2.0, 0.02, 2), (3.0, 4.0, 1)):
        result = geometric(first, last, n)
        assert result == pytest.approx(np.geomspace(first, last, n), rel=1e-14)
        assert (result[0], result[-1]) == (first, last if n > 1 else first)
    assert powers([0.0, 2.0, 1e-300], 0.6) == pytest.approx([0, 2**0.6, 1e-180], rel=1e-14)
    assert powers([], 0.6).shape == (0,)
