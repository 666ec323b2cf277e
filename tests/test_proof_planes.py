"""Proofs in planes of forcings: cells with global transport, patches with a barrier."""

import json
from fractions import Fraction

import numpy as np
import pytest
import xarray as xr
from flint import ctx

from nasm import barriers, circles, proofs
from nasm.checks import with_sha256
from nasm.numbers import parse as number
from nasm.planes import Plane, pairs, parse, rotating, three_kicks, two_kicks
from nasm.proofs import certificate_checker as checker
from nasm.proofs import patches, transport_cells
from nasm.proofs.certificate_checker import Refuted, check
from nasm.proofs.certificates import matrix_in_hex
from nasm.proofs.transport import Outcome
from nasm.proofs.transport_cells import prove_cell_of_plane
from pipeline.cubes import proved

GAMMA = number("gamma")
AXES = {"kappa1": "first", "kappa2": "second"}
# Two kicks, applied twice in a period of four.
TWICE = Plane("twice", AXES, (0, 0, 0, 0), (1, 0, 1, 0), (0, 1, 0, 1))
# Scales at which the last circle breaks on a ray, to three decimals; a test checks them.
BREAKUPS = {("pairs:1/3", 20.0): 1.115, ("three-kicks:0.2", 20.0): 0.440}


def cell_beyond(name, angle, excess, size):
    """Return the centre and half-width of a cell on a ray, a fraction `excess` past the breakup."""
    turn = np.deg2rad(angle)
    place = BREAKUPS[name, angle] * (1 + excess) * np.array([np.cos(turn), np.sin(turn)])
    return np.floor(place / size) * size + size / 2, size / 2


def certified(proof):
    assert proof.proved
    certificate = json.loads(json.dumps(proof.certificate()))
    return certificate, check(certificate)


def refuted(certificate, changes, reason):
    changed = {**certificate, **changes}
    del changed["sha256"]
    changed["claim"] = checker.claim(changed)
    with pytest.raises(Refuted, match=reason):
        check(with_sha256(changed))


@pytest.fixture(scope="module")
def cell():
    """Return the certificate of a cell in a plane of three kicks, and its claim."""
    proof = prove_cell_of_plane(three_kicks(0.2), *cell_beyond("three-kicks:0.2", 20.0, 0.2, 2**-7))
    return certified(proof)


@pytest.fixture(scope="module")
def patch():
    """Return the certificate of a patch that begins at a plane's origin, and its claim."""
    below, (proof, *_) = proofs.proved_below(
        GAMMA, (0.125, 0.0625), 1.0, 0.2, (0.015625, -0.03125), 0.4, three_kicks(0.05)
    )
    assert below > 0
    return certified(proof)


@pytest.mark.slow
def test_the_breakups_used_in_these_tests_are_correct():
    for (name, angle), scale in BREAKUPS.items():
        start, profile = parse(name).ray(angle)
        result = barriers.critical_scale(profile, 1e-2, start if start.any() else None)
        assert result.value == pytest.approx(scale, abs=1e-3)


def test_claims_specify_the_plane_by_its_matrix(cell, patch):
    rows = "in the plane (0.0, 0.0, {}) + a (1.0, 0.0, 0.0) + b (0.0, 1.0, 0.0)"
    assert cell[1].startswith("transport is global under every forcing within (0.00390625, ")
    assert cell[1].endswith(rows.format(0.2))
    assert patch[1].startswith(
        "a rotational invariant circle of [0;(1)] exists under every forcing "
        "with coordinates from 0.0 to "
    )
    assert patch[1].endswith("-1 <= t <= 1 " + rows.format(0.05))


@pytest.mark.parametrize(
    ("plane", "centre"),
    [(two_kicks(), (0.75, 0.25)), (rotating("1/2"), (0.5, 0.25)), (TWICE, (0.75, 0.25))],
)
def test_two_kicks_written_as_another_plane_yield_the_same_outcome(plane, centre):
    half_width = 2.0**-6
    assert transport_cells.prove_cell((0.75, 0.25), half_width).proved
    certified(prove_cell_of_plane(plane, centre, half_width))
    inside = np.array(centre) / 2
    assert not prove_cell_of_plane(plane, inside, half_width, 0.05).proved


def test_images_of_a_cell_under_the_symmetries_of_the_plane_are_proved_too():
    plane, (centre, half_width) = pairs("1/3"), cell_beyond("pairs:1/3", 20.0, 0.3, 2.0**-6)
    for image in (centre, centre[::-1], -centre):
        assert prove_cell_of_plane(plane, image, half_width).proved


@pytest.mark.parametrize("place", BREAKUPS)
def test_transport_is_not_proved_in_cells_that_reach_below_the_breakup(place):
    for excess in (-0.1, -0.01):
        centre, half_width = cell_beyond(*place, excess, 2.0**-8)
        curve = 0, np.array([[0.5, 0.0], [0.5, 0.75], [0.5, 1.5]])
        for of in (None, curve):
            plane = parse(place[0])
            assert not prove_cell_of_plane(plane, centre, half_width, 0.1, of).proved


def test_boxes_that_a_circle_crosses_are_not_eliminated():
    """Each box contains a point of a circle that exists under one forcing in the box's cell.

    The point is not at the centre of the box, and the forcing is not at the centre of the cell.
    Most of these boxes are eliminated under much stronger kicks, so the test is not vacuous.
    """
    rng, n_beyond = np.random.default_rng(7), 0
    omega, plane = number("[1;2,(1)]"), three_kicks(0.2)  # the last circle at 20° breaks at 0.440
    forcings = np.ascontiguousarray(np.transpose([plane.origin, plane.first, plane.second]))
    turn = np.deg2rad(20)
    place = 0.43 * np.array([np.cos(turn), np.sin(turn)])
    kappa = plane.forcing(*place)
    circle = circles.invariant_circle(omega, kappa, 2048)
    assert circle.certified
    for at in rng.integers(circle.u.shape[-1], size=4):
        x, after = circle.u[:2, at] + at / circle.u.shape[-1] + [0, float(omega) / 3]
        y = after - x - kappa[0] / (2 * np.pi) * np.sin(2 * np.pi * x)
        for _ in range(20):
            way, delta, widths = rng.normal(size=2), rng.uniform(-9, -2), rng.uniform(-9, -3, 2)
            delta, widths, sides = 10**delta, 10**widths, rng.uniform(-0.9, 0.9, 3)
            points = np.array([(x, y) - 0.25 * way, (x, y) + 0.25 * way])
            centre = place - sides[1:] * widths
            done, beyond = (
                followed(forcings, points, 0.25 + sides[0] * delta, delta, k * centre, widths)
                for k in (1.0, 1.5)
            )
            assert not done
            n_beyond += beyond
    assert n_beyond > 50


def followed(forcings, points, s, delta, centre, widths):
    """Follow a box and its parts for a limited time; return True if all are eliminated."""
    module = transport_cells
    waiting, ways = np.zeros((module._MAX_WAITING, module._COLUMNS)), np.zeros(16, np.int64)
    waiting[0, :6] = s, delta, centre[0], widths[0], centre[1], widths[1]
    lanes, kicks = np.zeros((module._ROWS, 16)), np.zeros((9, module._OF_KICK, 16))
    boxes, rows = np.zeros((module._COLUMNS, 16)), np.empty((1000, module._COLUMNS))
    ages, lifetimes = np.zeros((2, 16), np.int64), np.empty((1000, 2), np.int64)
    done, *_ = module._cover(
        forcings, points, False, waiting, 1, lanes, kicks, boxes, ways, ages, rows, lifetimes,
        20_000,
    )  # fmt: skip
    return done == module._DONE


@pytest.mark.parametrize(
    ("plane", "centre"),
    [(rotating("1/4"), (1.0, 0.0)), (three_kicks(0.2), (4.0, 0.5)), (pairs("1/5"), (30.0, 0.0))],
)
def test_cells_outside_the_scope_of_the_theorem_are_not_proved(plane, centre):
    assert prove_cell_of_plane(plane, centre, 2.0**-7).outcome is Outcome.SCOPE


def in_hex(*numbers):
    return [float(x).hex() for x in numbers]


def test_changed_certificates_of_cells_are_refuted(cell):
    certificate, _ = cell
    plane, points = certificate["plane"], certificate["points"]
    below = {**plane, "first": in_hex(0.5, 0, 0), "second": in_hex(0, 0.5, 0)}
    # |κ_j| ≤ 0.75 in the middle of this cell, but 1.25 elsewhere; the limit is 1.
    steep = {"origin": in_hex(0, 0, 0), "first": in_hex(4, 4, 4), "second": in_hex(4, 4, 4)}
    steep = {"plane": steep, "centre": in_hex(0.1875, 0), "half_width": in_hex(0.125, 2**-20)}
    changes = [
        ({"plane": below}, "half of Q may be"),
        ({"plane": {**plane, "second": in_hex(0, 1)}}, "equal length"),
        ({"plane": {**plane, "third": in_hex(0, 1, 0)}}, "three rows"),
        ({"plane": {**plane, "origin": in_hex(0, 1.9, 1.9)}}, "does not apply"),
        (steep, "does not apply"),
        ({"half_width": in_hex(2**-7, 2**-8)}, "do not tile"),
        ({"half_width": in_hex(0, 2**-8)}, "not positive"),
        ({"centre": in_hex(0.5, 0.5)}, "do not tile|half of Q"),
        ({"points": points[:-1]}, "continue|on no segment"),
        ({"points": [[*row, row[0]] for row in points]}, "not pairs"),
        ({"boxes": [column[16:] for column in certificate["boxes"]]}, "16 digits"),
        (
            {
                "boxes": [column[16:] for column in certificate["boxes"]],
                "lives": certificate["lives"][1:],
            },
            "do not tile",
        ),
    ]
    for change, reason in changes:
        refuted(certificate, change, reason)


ROWS = {"first": in_hex(1, 0, 0), "second": in_hex(0, 1, 0)}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"plane": ROWS | {"origin": in_hex(0, 0, 0.06)}}, "inequality"),
        ({"centre": in_hex(0.125, 0.125, 0)}, "two coordinates"),
        ({"tilt": in_hex(0.015625, 0.03125)}, "inequality"),
        *(
            pytest.param(*rest, marks=pytest.mark.slow)
            for rest in (
                (
                    {"plane": ROWS | {"origin": in_hex(0, 0, 0.05), "first": in_hex(1.1, 0, 0)}},
                    "inequality",
                ),
                ({"centre": in_hex(0.125, 0.125)}, "inequality"),
                ({"scales": in_hex(0, 0.9)}, "inequality"),
                ({"omega": "[0;(2)]"}, "inequality"),
            )
        ),
    ],
)
def test_changed_certificates_of_patches_are_refuted(patch, change, reason):
    refuted(patch[0], change, reason)


def along_a_ray(shift, program):
    """Return the constants of a patch, κ = (shift + s)(0.4, -0.2, 0.1), 0.25 ≤ shift + s ≤ 0.75."""
    rng, profile = np.random.default_rng(3), np.array([0.4, -0.2, 0.1])
    moves = [
        [[[0, *rng.integers(-(2**20), 2**20, 3).tolist()] for _ in "ri"] for _ in range(3)]
        for _ in range(4)
    ]
    origin, low, high = (shift * profile).tolist(), 0.25 - shift, 0.75 - shift
    if program is patches:
        with ctx.workprec(128):
            patch = patches._Patch(GAMMA, profile, np.zeros(3), low, high, 128, 4, 1, origin)
            return patch.verified(moves, -26)["constants"]
    second = [1.0, 0.0, 0.0]
    plane = {"origin": origin, "first": profile.tolist(), "second": second}
    data = {"centre": in_hex(1, 0), "tilt": in_hex(0, 0), "scales": in_hex(low, high)}
    data |= {"plane": {name: in_hex(*row) for name, row in plane.items()}, "rho": (0.01).hex()}
    data |= {"moves": {"unit": -26, "numbers": [[row] for row in moves]}, "omega": str(GAMMA)}
    with ctx.workprec(checker.BITS):
        return checker.theorem(data)[1]


@pytest.mark.parametrize("program", [patches, checker])
def test_the_constants_of_a_patch_on_a_ray_do_not_depend_on_its_origin(program):
    """The constants contain interpolation errors, estimated from bounds on |κ_j| over ellipses."""
    one, other = (along_a_ray(shift, program) for shift in (0.0, 0.25))
    assert one == pytest.approx(other, rel=1e-9)
    assert one["error"] > 0


@pytest.mark.parametrize("name", ["two-kicks", "pairs:1/3", "three-kicks:0.2", "rotating:1/3"])
def test_a_map_is_computed_in_a_wedge_and_completed_by_symmetry(name):
    plane = parse(name)
    rays = [(angle, 1.0) for angle in np.linspace(*plane.wedge, 4)]
    cube = proved.proved_map(plane, rays, 64, 1.0).cube
    at = cube.template[next(iter(plane.axes))].values
    inside = [[proofs.cells.in_wedge(plane, a, b) for a in at] for b in at]
    states = np.where(inside, proofs.cells.TRANSPORT, proofs.cells.OPEN)
    barrier = xr.Dataset({"critical_scale": ("angle", np.ones(4))}, {"angle": np.array(rays)[:, 0]})

    def whole():
        filled = cube.filled({"proved": states}).assign_attrs(cube.attributes)
        return proved.everywhere(filled, barrier)

    assert whole().proved.all()
    # A single cell has at most one image for each symmetry; no other cell is filled.
    b, a = np.argwhere(inside)[len(np.argwhere(inside)) // 2 + 3]
    states[:] = proofs.cells.OPEN
    states[b, a] = proofs.cells.TRANSPORT
    found, at = whole().proved.values, whole()[next(iter(plane.axes))].values
    places = np.argwhere(found)
    angles = np.rad2deg(np.arctan2(*at[places].T))
    assert 1 <= found.sum() <= len(plane.symmetries)
    assert np.ptp(np.hypot(*at[places].T)) < 1e-9
    first = np.sort(plane.unfold(angles[0]))
    assert all(np.sort(plane.unfold(angle)) == pytest.approx(first) for angle in angles)


def test_a_tile_is_certified_only_by_certificates_of_its_own_plane(cell):
    plane = three_kicks(0.2)
    (a, b), half = (tuple(map(float.fromhex, cell[0][key])) for key in ("centre", "half_width"))
    attributes = {"cells": round(0.5 / half[0])} | plane.record
    place = {"kappa1": [a], "kappa2": [b]}
    state = ("kappa2", "kappa1"), [[proofs.cells.TRANSPORT]]
    tile = xr.Dataset({"proved": state}, place, attributes)
    assert proved.uncertified_cells(tile, [cell[0]]) == ""
    other = cell[0] | {"plane": matrix_in_hex(three_kicks(0.3))}
    assert proved.uncertified_cells(tile, [other]) == proved.uncertified_cells(tile, [])
    image = tile.assign_coords(kappa1=[b], kappa2=[a])  # exchanging these kicks is a symmetry
    assert proved.uncertified_cells(image, [cell[0]]) == ""
    aside = tile.assign_coords(kappa1=[a + half[0]])
    assert "1" in proved.uncertified_cells(aside, [cell[0]])


def started(way, rng):
    """Return a random plane, segment and box, the state before the first kick, and the kicks."""
    plane, points = rng.uniform(-1, 1, (3, 3)), np.rint(rng.uniform(-2, 2, (2, 2)) * 2**26) / 2**26
    box = np.zeros(transport_cells._COLUMNS)
    box[:6] = rng.uniform(0, 0.5), 2.0**-20, *rng.uniform(-1, 1, 4)
    box[9] = rng.integers(-(2**20), 2**20) / 2**20
    lanes, kicks = np.zeros((transport_cells._ROWS, 1)), np.zeros((9, transport_cells._OF_KICK, 1))
    transport_cells._start(lanes, kicks, 0, plane, points, False, box, way)
    return plane, points, box, lanes[:, 0], kicks[:, :, 0]


@pytest.mark.parametrize("way", [0, 1])
def test_the_rounding_of_initial_states_is_bounded(way):
    """A and B bound the rounding errors of a state even if every term is rounded six times."""
    rng, ulp = np.random.default_rng(9), Fraction(1, 2**53)
    for _ in range(300):
        _, points, box, state, _ = started(way, rng)
        s, delta = Fraction(box[0]), Fraction(box[1])
        (x, y), (dx, dy) = (
            list(map(Fraction, row)) for row in (points[0], np.diff(points, axis=0)[0])
        )
        sizes = [abs(z) + (2 * s + 2 * delta) * abs(d) + 1 for z, d in ((x, dx), (y, dy))]
        middle, change = [x + 2 * s * dx, y + 2 * s * dy], [2 * delta * dx, 2 * delta * dy]
        v, w, t, z = map(Fraction, state[[2, 3, 6, 7]])
        if way:
            middle[0], change[0] = middle[1] - middle[0], change[1] - change[0]
            sizes[0] += sizes[1]
        found = Fraction(state[0]) + Fraction(1, 4), Fraction(state[1])
        sign = 1 if t * change[0] + z * change[1] > 0 else -1
        determinant = v * z - w * t
        assert determinant > 0
        errors = []
        for sigma in (-1, 1):
            off = [m + sigma * c for m, c in zip(middle, change, strict=True)]
            off = [a - b - sigma * sign * c for a, b, c in zip(off, found, (t, z), strict=True)]
            errors.append([off[0], off[1] - round(off[1])])
        errors.append([6 * ulp * size for size in sizes])
        for e_x, e_y in errors:
            assert abs(e_x * z - e_y * t) / determinant <= Fraction(state[24])
            assert abs(e_x * w - e_y * v) / determinant <= Fraction(state[25])
        assert Fraction(state[24]) >= (errors[2][0] * abs(z) + errors[2][1] * abs(t)) / determinant
        assert Fraction(state[25]) >= (errors[2][0] * abs(w) + errors[2][1] * abs(v)) / determinant


def test_the_rounding_of_strengths_is_bounded():
    rng, ulp = np.random.default_rng(10), Fraction(1, 2**53)
    for _ in range(100):
        plane, _, box, _, kicks = started(0, rng)
        a, h_a, b, h_b = map(Fraction, box[2:6])
        for n, (k, f, g, blur) in enumerate(kicks):
            o, F, G = map(Fraction, plane[n % 3])
            parts = o, a * F, b * G, h_a * F, h_b * G
            missed = abs(sum(parts[:3]) - Fraction(k))
            missed += abs(parts[3] - Fraction(f)) + abs(parts[4] - Fraction(g))
            assert missed <= Fraction(blur)
            assert Fraction(blur) > Fraction(21, 10) * ulp * sum(map(abs, parts))
