"""What the cubes plan, and that their tiles hold what the methods answer."""

import dataclasses
import pickle

import numpy as np
import pytest

from nasm import barriers, numbers
from nasm import escape as method
from nasm.critical import Status
from nasm.numbers import moebius
from nasm.symmetries import fold, ray
from pipeline.cubes import barrier, breakdown, escape, flux, rotating, tori
from pipeline.cubes.cube import status_code
from pipeline.store import tile_counts
from pipeline.sweep.grid import Axis
from pipeline.sweep.sweep import _parcel

PLANE = {
    "name": "escape",
    "kappa1": Axis(-1, 1, 6),
    "kappa2": Axis(0, 1.2, 5),
    "sizes": [8, 40],
    "n_max": 300,
    "tile": 4,
}
GAMMA = numbers.parse("gamma")
RAYS = [0.0, 30.0, 45.0]
JOBS = {
    "plane": escape.plane(**PLANE),
    "beyond": escape.beyond("rays", {20.0: 1.0}, [0.1, 0.5], [4, 8], 100),
    "continuation": breakdown.by_continuation([GAMMA], RAYS, 1e-2),
    "residue": breakdown.by_residue([GAMMA], RAYS, 100),
    "barrier": barrier.last_barrier(RAYS, 1e-1),
    "tori": rotating.tori(["5/8,1/3"], [30.0]),
    "irrational tori": tori.breakups([(0.22, 0.618)], [30.0], 0.1),
    "transport": rotating.transport(RAYS, 100, 8),
    "three kicks": rotating.three_kicks(["0", "1/24"], [30.0], 30),
    "flux": flux.through_last_circle({20.0: 1.0}, {20.0: str(GAMMA)}, [0.5], 50),
}


def plan(**changes):
    return escape.plane(**{**PLANE, **changes}).cube


@pytest.mark.parametrize("name", JOBS)
def test_a_tile_has_the_variables_of_its_cube_and_each_has_a_name_and_a_unit(name):
    job = JOBS[name]
    cube = pickle.loads(pickle.dumps(job)).cube
    for variable in cube.template.variables.values():
        assert variable.attrs["long_name"]
        assert variable.dtype.kind == "U" or variable.attrs["units"] in ("1", "degree")
    assert {"title", "source", "Conventions", "references", "map"} <= cube.template.attrs.keys()
    job.warm_up()
    ((_, coords),) = pickle.loads(_parcel(cube, np.zeros((1, len(cube.tile)), dtype=int)))
    arrays = job.compute(coords, cube.settings)
    assert arrays.keys() == set(cube.template.data_vars)
    for key, array in arrays.items():
        dims = cube.template[key].dims
        assert array.shape == tuple(coords[dim].size for dim in dims)
        assert np.can_cast(array.dtype, cube.template[key].dtype, "same_kind") or key == "period"
    assert 0 < job.predict(coords, cube.settings) < 60


def test_a_code_of_status_is_read_by_the_words_beside_it():
    words = JOBS["barrier"].cube.template.status.attrs
    assert words == words | JOBS["flux"].cube.template.status.attrs
    meaning = dict(zip(words["flag_values"], words["flag_meanings"].split(), strict=True))
    assert meaning[0] == "not_computed"
    assert all(meaning[status_code(status)] == status.name.lower() for status in Status)


def test_the_hash_is_that_of_what_decides_the_numbers():
    hashes = {plan().config_hash}
    for change in (
        {"kappa1": Axis(-1, 1.1, 6)},
        {"kappa2": Axis(0, 1.2, 6)},
        {"sizes": [8, 41]},
        {"n_max": 301},
        {"tile": 5},
    ):
        hashes.add(plan(**change).config_hash)
    assert len(hashes) == 6
    assert plan(name="other").config_hash == plan().config_hash
    # 2⁴⁰ cells and more, of which none is in memory.
    values = plan(kappa1=Axis(-1, 1, 2**20), kappa2=Axis(-1, 1, 2**20)).template.escape_time
    assert values.chunks is not None
    retitled = plan().template.assign_attrs(title="another")
    assert dataclasses.replace(plan(), template=retitled).config_hash == plan().config_hash


def test_the_tiles_of_a_plane_hold_the_escape_times_of_its_cells():
    job = JOBS["plane"]
    cube = job.cube
    x, y = method.ensemble(40)
    strengths = np.stack(np.meshgrid(PLANE["kappa1"].centres, PLANE["kappa2"].centres), axis=-1)
    whole = method.first_escape(strengths, x, y, PLANE["sizes"], PLANE["n_max"])
    indices = list(np.ndindex(*tile_counts(cube)))
    parcel = _parcel(cube, np.array(indices))
    for (row, column), coords in pickle.loads(parcel):
        tile = job.compute(coords, cube.settings)
        cells = np.s_[:, 4 * row : 4 * row + 4, 4 * column : 4 * column + 4]
        assert np.array_equal(tile["escape_time"], whole[cells])


def test_the_bounds_of_cells_are_halfway_between_their_centres():
    template = plan().template
    for name, axis in (("kappa1", PLANE["kappa1"]), ("kappa2", PLANE["kappa2"])):
        centres, bounds = template[name], template[template[name].attrs["bounds"]]
        assert bounds.dims == (name, "bound")
        assert bounds.values[[0, -1], [0, 1]].tolist() == [axis.lo, axis.hi]
        assert bounds.values[1:, 0] == pytest.approx((centres.values[1:] + centres.values[:-1]) / 2)
        assert (bounds.values[1:, 0] == bounds.values[:-1, 1]).all()


@pytest.mark.parametrize(
    "job",
    [
        breakdown.by_continuation([GAMMA], np.arange(361), 1e-4),
        breakdown.by_residue([GAMMA], np.arange(361), 6000),
        barrier.last_barrier(np.arange(361) / 8, 1e-4),
    ],
)
def test_tiles_of_rays_are_seconds_of_work_in_few_files(job):
    axes = {dim: job.cube.template[dim].values[:n] for dim, n in job.cube.tile.items()}
    assert 1 < job.predict(axes, job.cube.settings) <= 3


def test_the_boundary_at_any_angles_is_what_the_method_answers_on_their_images():
    angles = [200.0, 45.0, 10.0, 95.0]
    found = barrier.boundary(angles, 1e-2)
    assert found.angle.values.tolist() == angles
    for angle, wedge, mirrored in zip(angles, *fold(angles), strict=True):
        here, expected = found.sel(angle=angle), barriers.critical_scale(ray(wedge), 1e-2)
        omega = moebius(expected.omega, -1, 1) if mirrored else expected.omega
        assert here.circle == str(omega)
        assert float(here.omega) == pytest.approx(float(omega), abs=1e-15)
        for name, value in (("critical_scale", "value"), ("lower", "lower"), ("upper", "upper")):
            assert float(here[name]) == getattr(expected, value)
        at = np.deg2rad(angle)
        assert float(here.kappa1) == pytest.approx(expected.value * np.cos(at))
        assert float(here.kappa2) == pytest.approx(expected.value * np.sin(at))
    assert found.attrs["tol"] == 1e-2


def test_the_cost_of_a_tile_is_predicted_within_its_order_of_magnitude():
    # Nothing escapes around the origin: n_max steps of every orbit in every cell.
    costs = []
    for lo, hi in ((-0.1, 0.1), (2, 2.2)):
        axis = Axis(lo, hi, 8)
        job = escape.plane("escape", axis, axis, [64], 20_000, 8)
        coords = {key: value.values for key, value in job.cube.template.coords.items()}
        costs.append(job.predict(coords, job.cube.settings))
    assert costs[0] == pytest.approx(8 * 8 * 64 * 20_000 * 0.8e-9)
    assert costs[1] < costs[0] / 100
