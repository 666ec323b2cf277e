"""The boundary between two proofs: brackets on rays, and the map of cells."""

import numpy as np
import pytest
import xarray as xr
from commands import invoke, succeed

from nasm import barriers, proof_barrier, proofs
from nasm.critical import Status
from nasm.symmetries import ray
from pipeline.cubes.proved_map import transport_proved


@pytest.fixture(scope="module", autouse=True)
def _compiled():  # time for a proof is CPU time, and compiling counts
    proofs.critical_scale((1, 0), 0.1)


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_the_last_barrier_breaks_between_two_proofs(angle):
    bracket = proofs.critical_scale(ray(angle), 0.3)
    residues = barriers.critical_scale(ray(angle))
    assert 0.9 * residues.value < bracket.lower < residues.value < bracket.upper
    assert bracket.upper < 1.02 * residues.value
    assert bracket.barrier.proved
    assert bracket.transport.proved


def test_where_no_barrier_is_found_nothing_is_proved():
    near_cusp = (1, 1 - 1e-6)
    bracket = proofs.critical_scale(near_cusp, 0.1)
    assert bracket.found.status is not Status.OK
    assert np.isnan([bracket.lower, bracket.upper]).all()
    assert bracket.barrier is bracket.transport is None


def test_the_proved_boundary_is_a_cube_with_both_proofs(tmp_path, workers):
    rays = ["--angles", "3", "--seconds", "0.2"]
    output = succeed("proved_boundary", tmp_path / "out", *rays, *workers)
    assert "On 3 of 3 rays around the plane a barrier is proved to exist" in output
    cube = xr.open_zarr(tmp_path / "out/proved_barrier.zarr").load()
    assert (cube.proved_lower < cube.critical_scale).all()
    assert (cube.critical_scale < cube.proved_upper).all()


def test_without_python_flint_the_command_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(proof_barrier, "arb", None)
    result = invoke("proved_boundary", tmp_path / "out")
    assert result.exit_code == 1
    assert "pip install 'nasm-transport[proof]'" in result.output
    assert not (tmp_path / "out").exists()


def test_proved_cells_lie_beyond_the_boundary_and_open_ones_near_it():
    angles = np.linspace(0, 45, 7)
    scales = {angle: barriers.critical_scale(ray(angle), 1e-2).value for angle in angles}
    job = transport_proved(scales, 128, 0.2)
    for block2, block1 in ((2, 8), (4, 9), (12, 13)):  # through which CB_gt runs
        coords = {
            name: job.cube.template[name].values[8 * block : 8 * block + 8]
            for name, block in (("kappa2", block2), ("kappa1", block1))
        }
        proved = job.compute(coords, job.cube.settings)["proved"]
        assert set(proved.ravel().tolist()) == {1, 2}
        cells = np.argwhere(proved == 2)
        i, j = min(cells, key=lambda cell: coords["kappa1"][cell[1]] + coords["kappa2"][cell[0]])
        corner = coords["kappa1"][j] - 1 / 256, coords["kappa2"][i] - 1 / 256
        assert barriers.critical_scale(corner, 1e-2).value < 1
