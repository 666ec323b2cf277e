"""Plans of cubes, and tiles compared with results computed directly by `nasm`."""

import dataclasses
from fractions import Fraction
from functools import partial
from itertools import product
from types import SimpleNamespace

import cloudpickle
import numpy as np
import pytest
import xarray as xr
from oracles import KAPPA_G
from scipy.io import netcdf_file

from nasm import barriers, numbers, periodic, proofs
from nasm.maps import rotating_forcing
from nasm.numbers import moebius
from nasm.planes import Plane, rotating, three_kicks, two_kicks
from nasm.results import Status
from nasm.symmetries import ray
from pipeline import store
from pipeline.cubes import (
    barrier,
    beyond,
    breakdown,
    escape,
    forcings,
    proved,
    rotating_maps,
    warm_up,
)
from pipeline.cubes.cube import NOT_COMPUTED, status_code
from pipeline.sweep.grid import Axis, tile_coords

TWO, AXES = two_kicks(), (Axis(-1, 1, 6), Axis(0, 1.2, 5))
PLANE = {"name": "escape", "plane": TWO, "axes": AXES, "sizes": [8, 40], "n_max": 300, "tile": 4}
GAMMA, TWICE = map(numbers.parse, ("gamma", "2gamma"))
RAYS = [0.0, 30.0, 45.0]
JOBS = {
    "plane": escape.over_plane(**PLANE),
    "beyond": beyond.escape_times("rays", three_kicks(0.2), {20.0: 1.0}, [0.1, 0.5], [4, 8], 100),
    "continuation": breakdown.by_continuation(rotating("1/3", "1/48"), [GAMMA, TWICE], RAYS, 1e-2),
    "residue": breakdown.by_residue(three_kicks(0.2), [GAMMA], [45.0], 100),
    "barrier": barrier.last_barrier(rotating("1/2"), RAYS, 1e-1),
    "tori": rotating_maps.residues(["5/8,1/3"], [30.0]),
    "irrational tori": rotating_maps.breakups([(0.22, 0.618)], [30.0], 0.1),
    "frequencies": rotating_maps.last_barriers([Fraction(1, 2)], 2, [0.382], [45.0]),
    "ripples": rotating_maps.ripples([Fraction(1, 2)], [0.1], 0.1),
    "forcings": forcings.last_barriers(
        "patterns", [("signs", 3, (1, 1, -1)), ("", 0.5, (1, 1))], "P", 0.1
    ),
    "robustness": forcings.against_constant(
        "tolerance_random", [("climb", n, (1, n)) for n in range(20)], "seed", 0.97, tries=2
    ),
    "transport": breakdown.by_escape(rotating("1/3"), RAYS, 100, 8),
    "flux": beyond.flux(TWO, {20.0: 1.0}, {20.0: str(GAMMA)}, [0.5], 50),
}
LONG = ["irrational tori", "frequencies"]
QUICK = [name for name in JOBS if name not in LONG]


def plan(**changes):
    return escape.over_plane(**{**PLANE, **changes}).cube


@pytest.mark.parametrize(
    "name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)]
)
def test_a_tile_has_the_variables_of_its_cube_with_names_and_units(name):
    job = JOBS[name]
    cube = cloudpickle.loads(cloudpickle.dumps(job)).cube
    for variable in cube.template.variables.values():
        assert variable.attrs["long_name"]
        assert variable.dtype.kind == "U" or variable.attrs["units"] in ("1", "degree")
    assert {"title", "Conventions", "references", "map"} <= cube.template.attrs.keys()
    assert "source" not in cube.template.attrs  # the store adds it, with the name of the program
    job.warm_up()
    ((_, coords),) = tile_coords(cube, np.zeros((1, len(cube.tile)), dtype=int))
    arrays = job.compute(coords, cube.settings)
    assert arrays.keys() == {*cube.computed} == {*cube.template.variables} - {*coords}
    for key, array in arrays.items():
        dims = cube.template[key].dims
        assert array.shape == tuple(coords[dim].size for dim in dims)
        assert np.can_cast(array.dtype, cube.template[key].dtype, "same_kind") or key == "period"
    assert 0 < job.predict(coords, cube.settings) < 60


def test_last_barriers_of_rotating_maps_have_rotation_numbers_per_kick():
    # The forcings are (√2 s, 0) and (s, s)/√2.
    coords = {"forcing": ["1/2,0", "1/2,0.25"], "angle": np.array([45.0])}
    result = rotating_maps._last_barriers(coords, {"kicks": 400, "tol": 1e-3})
    scales = result["critical_scale"][:, 0]
    assert scales == pytest.approx([KAPPA_G / 8**0.5, KAPPA_G * 2**0.5], rel=1e-9)
    assert result["omega"][:, 0] == pytest.approx([(3 - 5**0.5) / 4, (3 - 5**0.5) / 2], abs=1e-12)


@pytest.mark.slow
def test_at_a_large_tol_errors_cover_a_circle_that_breaks_slightly_later():
    # The first breakup found at a tolerance of 10⁻² was 2.6·10⁻⁴ below that of another circle.
    profile = rotating_forcing(*ray(45.0), "5/12", 1 / 48)
    coarse, _ = rotating_maps._last_circle(profile, 1e-2)
    fine = barriers.critical_scale(profile, 1e-3)
    assert abs(coarse.value - fine.value) < coarse.error
    assert coarse.error >= 0.002 * coarse.value
    assert fine.error < 1e-6


def test_status_codes_are_explained_by_the_flag_meanings():
    words = JOBS["barrier"].cube.template.status.attrs
    assert words == words | JOBS["flux"].cube.template.status.attrs
    meaning = dict(zip(words["flag_values"], words["flag_meanings"].split(), strict=True))
    assert meaning[NOT_COMPUTED] == "not_computed"
    assert all(meaning[status_code(status)] == status.name.lower() for status in Status)


def test_flags_have_the_type_of_their_variable_in_a_cube_and_in_netcdf(tmp_path):
    place = store.place_of(tmp_path)
    cells = proved.proved_map(two_kicks(), [(0.0, 1.0), (45.0, 1.2)], cells=64, seconds=1.0)
    for plan in (JOBS["flux"].cube, JOBS["continuation"].cube, cells.cube):
        store.create(place, plan, "tests")
        cube = store.read(place, plan.name)
        cube.to_netcdf(tmp_path / "cube.nc")
        with netcdf_file(tmp_path / "cube.nc", mmap=False) as file:
            flagged = {k: v for k, v in file.variables.items() if hasattr(v, "flag_values")}
            assert flagged.keys() == {k for k, v in cube.items() if "flag_meanings" in v.attrs}
            for key, variable in flagged.items():
                assert variable.flag_values.dtype == variable.data.dtype == cube[key].dtype
                assert cube[key].flag_values.dtype == cube[key].dtype
                assert variable.flag_values.tolist() == cube[key].flag_values.tolist()
                assert len(variable.flag_values) == len(cube[key].flag_meanings.split())
        assert flagged


@pytest.mark.parametrize(
    ("name", "main", "names"),
    [
        ("barrier", "critical_scale", "error lower upper status"),
        ("continuation", "critical_scale", "error lower upper status method"),
        ("flux", "flux", "error period status"),
        ("forcings", "critical_scale", "error lower upper status"),
    ],
)
def test_the_main_variable_refers_to_its_error_and_its_status(name, main, names):
    template = JOBS[name].cube.template
    links = {key: variable.attrs.get("ancillary_variables") for key, variable in template.items()}
    linked = {key: link for key, link in links.items() if link}
    assert linked == {main: names}
    assert {*names.split()} <= {*template.data_vars}
    # A cube derived from this one refers only to variables that it contains.
    less = dataclasses.replace(JOBS[name].cube, template=template.drop_vars(["error", "status"]))
    remaining = " ".join(key for key in names.split() if key not in ("error", "status"))
    assert less.template[main].attrs.get("ancillary_variables", "") == remaining


def test_levels_are_linked_to_the_escape_times_that_they_describe():
    levels = escape.composed(plan(), 2, [100]).template
    assert levels.escape_time.ancillary_variables == "level"
    assert "ancillary_variables" not in plan().template.escape_time.attrs


def test_the_hash_depends_only_on_settings_that_affect_the_results():
    changes = {"plane": Plane("other", TWO.axes, (0, 0.1), TWO.first, TWO.second)}
    changes |= {"axes": (Axis(-1, 1.1, 6), AXES[1]), "sizes": [8, 41], "n_max": 301, "tile": 5}
    hashes = {plan(**{name: value}).config_hash for name, value in changes.items()}
    assert len({plan().config_hash, *hashes}) == 6
    assert plan(name="other").config_hash == plan().config_hash
    # The values of a template, here more than 2⁴⁰, are not held in memory.
    values = plan(axes=[Axis(-1, 1, 2**20)] * 2).template.escape_time
    assert values.chunks is not None
    retitled = plan().template.assign_attrs(title="another")
    assert dataclasses.replace(plan(), template=retitled).config_hash == plan().config_hash


@pytest.mark.parametrize(
    "job",
    [
        breakdown.by_continuation(TWO, [GAMMA], np.arange(361), 1e-4),
        breakdown.by_residue(TWO, [GAMMA], np.arange(361), 6000),
        barrier.last_barrier(TWO, np.arange(361) / 8, 1e-4),
    ],
)
def test_a_tile_of_rays_takes_seconds_so_that_there_are_few_files(job):
    axes = {dim: job.cube.template[dim].values[:n] for dim, n in job.cube.tile.items()}
    assert 1 < job.predict(axes, job.cube.settings) <= 3


def test_workers_begin_to_compile_with_different_functions(monkeypatch):
    orders = []
    for name in (0, 1, 2, "tcp://10.0.0.1:4000"):
        monkeypatch.setattr("distributed.get_worker", lambda name=name: SimpleNamespace(name=name))
        calls = []
        warm_up.in_own_order(*(partial(calls.append, n) for n in range(3)))
        orders.append(calls)
    assert orders[:3] == [[0, 1, 2], [1, 2, 0], [2, 0, 1]]
    assert orders[3] in orders[:3]


def test_circles_are_computed_once_on_rays_that_are_images_of_each_other(monkeypatch):
    angles = np.array([10.0, 80.0, 100.0, 170.0, 190.0, 260.0])
    computed = []

    def critical_scale(omega, profile, q_max):
        computed.append(np.rad2deg(np.arctan2(*profile[::-1])).round(9))
        return periodic.critical_scale(omega, profile, q_max)

    monkeypatch.setitem(breakdown._METHODS, periodic.METHOD, (critical_scale, {"q_max": 10}))
    job = breakdown.by_residue(TWO, [GAMMA], angles, 400)
    coords = {"circle": np.array([str(GAMMA)]), "angle": angles}
    scales = job.compute(coords, job.cube.settings)["critical_scale"][0]
    # The swap κ1 ↔ κ2 and κ → -κ preserve ω; the reflection κ1 → -κ1 maps it to 1 - ω.
    assert computed == [10.0, 100.0]
    assert job.predict(coords, job.cube.settings) == pytest.approx(2 * 0.045)
    for angle, scale in zip(angles, scales, strict=True):
        alone = periodic.critical_scale(GAMMA, ray(angle), 400)
        assert abs(scale - alone.value) <= 2 * alone.error < 1e-6
    # Orbits that start at the same points on all rays may escape at different times.
    escapes = breakdown.by_escape(TWO, angles, n_max=100, n_orbits=4)
    assert escapes.cube.template.angle.size == angles.size
    assert escapes.predict({"angle": angles}, escapes.cube.settings) == pytest.approx(
        3 * escapes.predict({"angle": angles[:2]}, escapes.cube.settings)
    )


@pytest.mark.parametrize("plane", [TWO, rotating("1/4"), rotating("1/3", "1/48")])
def test_unfolded_breakups_equal_those_computed_for_each_circle_and_ray(plane):
    # The first two planes have symmetries that map ω to ω + P/2; -γ breaks at the same scales as γ.
    omegas = [GAMMA, moebius(GAMMA, -1, 0), TWICE, moebius(GAMMA, 1, 1)]
    angles = [170.0, 0.0, 10.0, 45.0, 80.0, 100.0, 135.0, 200.0]
    job = breakdown.by_continuation(plane, *breakdown.folded(plane, omegas, angles), 1e-4)
    coords = {name: job.cube.template[name].values for name in ("circle", "angle")}
    cube = job.cube.filled(job.compute(coords, job.cube.settings))
    whole = breakdown.unfolded(cube.assign_attrs(job.cube.attributes), omegas, angles)
    assert whole.circle.values.tolist() == [str(omega) for omega in omegas]
    assert whole.angle.values.tolist() == angles
    n_alone = len(omegas) * np.unique(plane.fold_keeping_circles(np.array(angles))).size
    assert coords["circle"].size * coords["angle"].size < n_alone
    n_compared = 0
    for omega, angle in product(omegas, angles):
        here, profile = whole.sel(circle=str(omega), angle=angle), plane.ray(angle)[1]
        alone = breakdown.continued_or_by_residue(omega, profile, 1e-4, 6000)
        assert np.isnan(here.critical_scale) == np.isnan(alone.value)
        if np.isnan(alone.value):
            continue
        n_compared += 1
        assert abs(here.critical_scale - alone.value) <= here.error + alone.error < 1e-2
        for name, direction in zip(plane.axes, ray(angle), strict=True):
            assert float(here[name]) == pytest.approx(float(here.critical_scale) * direction)
    assert n_compared > 25


def test_the_boundary_at_any_angle_is_computed_on_the_folded_ray():
    angles = [200.0, 45.0, 10.0, 95.0]
    result = barrier.boundary(angles, 1e-2)
    assert result.angle.values.tolist() == angles
    for angle, wedge, mirrored in zip(angles, *TWO.fold(angles), strict=True):
        here, expected = result.sel(angle=angle), barriers.critical_scale(ray(wedge), 1e-2)
        omega = moebius(expected.omega, -1, 1) if mirrored else expected.omega
        assert here.circle == str(omega)
        assert float(here.omega) == pytest.approx(float(omega), abs=1e-15)
        for name, value in (("critical_scale", "value"), ("lower", "lower"), ("upper", "upper")):
            assert float(here[name]) == getattr(expected, value)
        at = np.deg2rad(angle)
        assert float(here.kappa1) == pytest.approx(expected.value * np.cos(at))
        assert float(here.kappa2) == pytest.approx(expected.value * np.sin(at))
    assert result.attrs["tol"] == 1e-2


def test_the_cost_of_a_tile_is_predicted_to_within_an_order_of_magnitude():
    # Nothing escapes near the origin: every orbit in every cell takes n_max steps.
    costs = []
    for lo, hi in ((-0.1, 0.1), (2, 2.2)):
        axis = Axis(lo, hi, 8)
        job = escape.over_plane("escape", TWO, [axis] * 2, [64], 20_000, 8)
        coords = {key: value.values for key, value in job.cube.template.coords.items()}
        costs.append(job.predict(coords, job.cube.settings))
    assert costs[0] == pytest.approx(8 * 8 * 64 * 20_000 * 0.8e-9)
    assert costs[1] < costs[0] / 100


CELLS = {"cells": 32} | TWO.record


@pytest.mark.parametrize("halves", [(1 / 64, 1 / 64), (1 / 65, 1 / 64), (1 / 64, 1 / 65)])
def test_a_cell_is_certified_only_by_a_certificate_that_covers_all_of_it(halves):
    cell = ("kappa2", "kappa1"), [[proofs.cells.TRANSPORT]]
    tile = xr.Dataset({"proved": cell}, {"kappa1": [1.0], "kappa2": [0.5]}, CELLS)
    certificate = {"kappa": [(1.0).hex(), (0.5).hex()], "half_width": [h.hex() for h in halves]}
    message = proved.uncertified_cells(tile, [certificate])
    assert message == ("proved cells that no certificate covers: 1" if min(halves) < 1 / 64 else "")
    assert bool(message) == (min(halves) < 1 / 64)


@pytest.mark.parametrize("painted", [(0, 1), (1, 0), (0, 0)])
def test_a_certificate_covers_a_cell_its_mirror_image_and_no_other_cell(painted):
    states = np.full((2, 2), proofs.cells.OPEN)
    states[painted] = proofs.cells.TRANSPORT
    centres = (np.arange(2) + 24.5) / 32
    cells = ("kappa2", "kappa1"), states
    tile = xr.Dataset({"proved": cells}, {"kappa1": centres, "kappa2": centres}, CELLS)
    certificate = {"kappa": [x.hex() for x in centres[::-1]], "half_width": [(1 / 64).hex()] * 2}
    message = proved.uncertified_cells(tile, [certificate])
    assert message == ("proved cells that no certificate covers: 1" if painted == (0, 0) else "")
    assert bool(message) == (painted == (0, 0))
    assert proved.uncertified_cells(tile, [])


@pytest.mark.parametrize("end", [0.75, 0.5])
@pytest.mark.parametrize("tilt", [(0.0, 0.25), (0.0, 0.125)])
def test_a_triangle_is_certified_only_by_patches_that_fill_it(end, tilt):
    corners = {"kappa1_low": 0.5, "kappa2_low": 0.0, "kappa1_high": 0.5, "kappa2_high": 0.5}
    tile = {key: ("triangle", [x]) for key, x in corners.items()} | {"triangle": [3]}
    tile = xr.Dataset({"proved_below": ("triangle", [0.75])}, tile, TWO.record)
    certificates = [
        {key: [x.hex() for x in row] for key, row in fields.items()}
        for fields in (
            {"kappa": (0.5, 0.25), "tilt": tilt, "scales": (0.0, 0.5)},
            {"kappa": (0.5, 0.25), "tilt": (0.0, 0.25), "scales": (0.5, end)},
        )
    ]
    message = proved.uncertified_triangle(tile, certificates)
    assert bool(message) == (end < 0.75 or tilt[1] < 0.25)
    assert "triangle 3" in message or not message
