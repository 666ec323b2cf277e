"""The boundary enclosed by two proofs: brackets on rays, and maps of cells and triangles."""

import json
import lzma
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from cases import thirds
from commands import invoke, succeed

from nasm import barriers, proofs
from nasm.numbers import parse
from nasm.planes import two_kicks
from nasm.results import Status
from nasm.symmetries import ray
from pipeline import store
from pipeline.cubes.cube import NOT_COMPUTED
from pipeline.cubes.proved import proved_barrier, proved_map, proved_triangles, unpack_certificates


@pytest.fixture(scope="module", autouse=True)
def _compiled():  # otherwise, compilation would count towards the CPU time of a proof
    proofs.critical_scale((1, 0), 0.1)


@pytest.mark.parametrize("angle", thirds([30.0, 0.0]))
def test_the_last_barrier_breaks_between_two_proved_bounds(angle):
    bracket = proofs.critical_scale(ray(angle), 0.3)
    residues = barriers.critical_scale(ray(angle))
    assert 0.9 * residues.value < bracket.lower < residues.value < bracket.upper
    assert bracket.upper < 1.02 * residues.value
    assert bracket.barrier.proved
    assert bracket.transport.proved


@pytest.mark.slow
def test_where_no_barrier_is_found_nothing_is_proved():
    near_cusp = (1, 1 - 1e-8)
    bracket = proofs.critical_scale(near_cusp, 0.1)
    assert bracket.estimate.status is not Status.OK
    assert np.isnan([bracket.lower, bracket.upper]).all()
    assert bracket.barrier is bracket.transport is None


def test_the_proved_boundary_is_stored_as_a_cube_with_both_proofs(tmp_path, workers):
    rays = ["--n-rays", "3", "--cpu-seconds", "0.2"]
    output = succeed("proved_boundary", tmp_path / "out", *rays, *workers)
    assert "On 3 of 3 rays around the plane a barrier is proved to exist" in output
    cube = xr.open_zarr(tmp_path / "out/proved_barrier.zarr").load()
    assert (cube.proved_lower < cube.critical_scale).all()
    assert (cube.critical_scale < cube.proved_upper).all()
    assert len(list((tmp_path / "out/certificates/proved_barrier").iterdir())) == cube.angle.size


BREAKUPS = [(angle, 0.4858 / np.cos(np.deg2rad(angle))) for angle in (0.0, 44.0)] + [(45.0, 1.3)]


def map_of_two_tiles():
    """Return the job for a map, and the indices and coordinates of two of its tiles."""
    job = proved_map(two_kicks(), BREAKUPS, 32, 0.1)
    axes = {name: job.cube.template[name].values for name in ("kappa2", "kappa1")}
    tiles = {}
    for index in ((4, 24), (8, 24)):  # κ1 = 0.77, κ2 = 0.14 and 0.27
        places = zip(axes, index, strict=True)
        tiles[index] = {name: axes[name][i : i + 1] for name, i in places}
    return job, tiles


def one_triangle():
    """Return a job for triangles, and the index and coordinates of its first triangle."""
    job = proved_triangles(two_kicks(), [(10.0, 0.5), (20.0, 0.55)], ["[0;(1)]"] * 2, 0.4)
    return job, {(0,): {"triangle": np.array([0])}}


def rays_of_one_tile():
    """Return a job for proved rays, and the index and coordinates of one ray."""
    job = proved_barrier(two_kicks(), [20.0], 0.1)
    return job, {(0,): {"angle": np.array([20.0])}}


def easy_bracket(profile, seconds):
    """Return a bracket with proofs far from the breakup, which are quick to check."""
    circle, result = parse("gamma"), barriers.critical_scale(profile, 1e-2)
    lower, upper = 0.3 * result.value, 1.2 * result.value
    proved = proofs.barrier.prove(circle, lower * profile), proofs.transport.prove(upper * profile)
    result = replace(result, omega=circle)
    below = proofs.proved_below(circle, profile, result.value, 1e-3)
    return proofs.ProvedBracket(result, lower, upper, *proved, *below)


@pytest.mark.parametrize(
    ("job", "n"), [(map_of_two_tiles, 2), (one_triangle, 2), (rays_of_one_tile, 3)]
)
def test_stored_certificates_are_compared_with_tiles_and_checked(job, n, tmp_path, monkeypatch):
    monkeypatch.setattr(proofs, "critical_scale", easy_bracket)
    (job, tiles), place = job(), store.place_of(tmp_path)
    with store.driver_lock(place):
        store.create(place, job.cube, store.COMPUTED_BY)
        for index, coords in tiles.items():
            store.commit(place, job.cube.name, index, job.compute(coords, job.cube.settings), 1.0)
    output = succeed("verify", tmp_path, "--proofs")
    assert f"{n} of {n} certificates; wrong: 0 tiles" in output
    output = succeed("verify", tmp_path, "--proofs", "--max-cpu-seconds", "0")
    assert f"0 of {n} certificates; the others take" in output
    path = max((tmp_path / "certificates" / job.cube.name).iterdir())
    certificates = unpack_certificates(genuine := path.read_bytes())
    changed = json.loads(json.dumps(certificates))
    changed[0]["a" if "a" in changed[0] else "rho"] = 0
    wrong = {
        lzma.compress(json.dumps(changed).encode()): "the seal is broken",
        lzma.compress(json.dumps(certificates[1:]).encode()): "certificate",
        lzma.compress(json.dumps(certificates[:-1]).encode()): "certificate",
        lzma.compress(b'[{"kappa": 1}]'): "damaged",
        genuine[:-9]: "damaged",
        b"": "certificate",
    }
    for data, reason in wrong.items():
        path.write_bytes(data)
        longest = "60" if "seal" in reason else "0"  # other faults are found without this check
        result = invoke("verify", tmp_path, "--proofs", "--max-cpu-seconds", longest)
        assert result.exit_code == 1, reason
        assert reason in result.output.split("wrong: 1 tile\n")[1]
        assert "1 tile damaged" in result.output  # the tile's checksum also reveals the change
    for file, data in (("zarr.json", b"{}"), ("digests.json", b"")):  # both are needed for a repair
        file = tmp_path / f"{job.cube.name}.zarr/{file}"
        whole = file.read_bytes()
        file.write_bytes(data)
        result = invoke("verify", tmp_path, "--proofs", "--max-cpu-seconds", "0", "--repair")
        assert (result.exit_code, path.exists()) == (1, True)
        file.write_bytes(whole)
    result = invoke("verify", tmp_path, "--proofs", "--max-cpu-seconds", "0", "--repair")
    assert "repaired" in result.output
    assert not path.exists()
    done = np.prod(job.cube.tile_counts) - len(store.missing(place, job.cube))
    assert done == len(tiles) - 1


def test_transport_is_proved_only_beyond_the_boundary():
    angles, low, size = np.linspace(0, 45, 7), (0.5, 0.125), 1 / 8  # CB_gt crosses this square
    scales = np.array([barriers.critical_scale(ray(angle), 1e-2).value for angle in angles])
    proved, result = proofs.proved_cells(
        two_kicks(), low, size, 3, [*zip(angles, scales, strict=True)], 0.05
    )
    assert len(result) <= (proved == 2).sum()
    assert set(proved.ravel().tolist()) == {1, 2}
    # Even the inner corner of the cell nearest to the boundary lies beyond the boundary.
    kappa = np.argwhere(proved == 2)[:, ::-1] * size / 8 + low
    assert barriers.critical_scale(kappa[kappa.sum(axis=1).argmin()], 1e-2).value < 1


@pytest.mark.parametrize("sagitta", [1e-6, 0.01, 0.1])
def test_triangles_fill_the_region_and_end_near_the_boundary(sagitta):
    angles = np.linspace(0, 45, 46)
    scales = 0.5 + 0.3 * (angles / 45) ** 4  # only partly convex; the circle changes at 30°
    circles = ["a" if angle < 30 else "b" for angle in angles]
    result = proofs.triangles(angles, scales, circles, sagitta)
    assert result[0][0][1] == 0
    assert result[-1][1][0] == result[-1][1][1]
    assert all(one[1] == other[0] for one, other in pairwise(result))
    assert {"a", "b"} == {circle for *_, both in result for circle in both}
    for low, high, _ in result:
        middle = np.add(low, high) / 2  # compare with the boundary on the same ray
        along = np.interp(np.rad2deg(np.arctan2(*middle[::-1])), angles, scales)
        assert along / np.hypot(*middle) > 1 - max(sagitta, 1e-3)
    assert (len(result) < 10) == (sagitta > 1e-3)


def test_the_proved_map_is_symmetric_about_the_diagonal():
    job = proved_map(two_kicks(), BREAKUPS, 32, 1e-3)
    coords = {name: job.cube.template[name].values[30:32] for name in ("kappa2", "kappa1")}
    proved = job.compute(coords, job.cube.settings)["proved"]
    assert (proved == proved.T).all()
    assert (proved > 0).all()
    coords["kappa1"] = coords["kappa1"] - 0.5
    assert (job.compute(coords, job.cube.settings)["proved"] == NOT_COMPUTED).all()
