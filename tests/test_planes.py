"""Planes of forcings: breakups have the symmetries of a plane, and invalid planes are refused."""

import json
import re
from fractions import Fraction

import numpy as np
import pytest
from cases import thirds
from numpy.testing import assert_allclose

from nasm import maps, planes
from nasm.barriers import critical_scale
from nasm.circles import continuation
from nasm.maps import rotating_forcing
from nasm.numbers import moebius, parse
from nasm.planes import Plane

AXES = {"kappa_a": "one", "kappa_b": "another"}
FIRST, SECOND = (0.6, -0.2, 0.3, 0.9), (0.1, 0.7, -0.5, 0.4)
GENERIC = Plane("generic", AXES, (0, 0, 0, 0), FIRST, SECOND)
TWO = planes.two_kicks()


def breakup(plane, angle, omega):
    start, profile = plane.ray(angle)
    assert not start.any()
    return continuation.critical_scale(omega, profile, 3e-3).value


IMAGES = [(planes.rotating("1/3", phase), n) for phase, n in (("1/12", 4), ("1/48", 2), ("0", 2))]


@pytest.mark.parametrize(
    "case", thirds([(TWO, 8), (planes.rotating("1/2"), 8), (GENERIC, 2), *IMAGES])
)
def test_circles_break_at_the_same_scale_on_rays_related_by_symmetry(case):
    plane, n_images = case
    assert len(plane.symmetries) == n_images
    angle, omega = 25.0, parse("[0;2,3,(1)]")
    scale, images = breakup(plane, angle, omega), plane.unfold(angle)
    assert len({*images.tolist()}) == n_images
    for image, (*_, shift) in zip(images, plane.symmetries, strict=True):
        assert breakup(plane, image, moebius(omega, 1, shift)) == pytest.approx(scale, rel=5e-3)
    assert (plane.fold(images)[0] == plane.fold(angle)[0]).all()
    for other in {*TWO.unfold(angle).tolist()} - {*images.tolist()}:
        on_ray = [breakup(plane, other, moebius(omega, 1, n)) for n in {0, len(plane.origin) // 2}]
        assert not np.isclose(on_ray, scale, rtol=1e-2).any()


def test_a_plane_with_nonzero_origin_has_only_symmetries_that_fix_it():
    assert Plane("off", AXES, (0.1, 0.2, 0, 0), FIRST, SECOND).symmetries == ((False, 0, 0),)
    # (κ1, κ2, 0.2) reversed is (0.2, κ2, κ1), a shift of (κ2, κ1, 0.2).
    assert planes.three_kicks(0.2).unfold(30).tolist() == [30, 60]


def test_a_rotating_plane_has_the_forcings_of_the_rotating_map():
    plane = planes.parse("rotating:2/5,1/48")
    kappas = plane.forcing([0.3, -0.1], 0.7)
    assert_allclose(kappas[1], rotating_forcing(-0.1, 0.7, "2/5", 1 / 48), rtol=0, atol=1e-15)
    assert planes.rotating("1/8", "1/8").second[1::2] == (0, -1, 0, 1)
    assert planes.plane_of(json.loads(json.dumps(plane.record))) == plane
    hashes = {planes.parse(text).record["plane_hash"] for text in ("two-kicks", plane.name)}
    assert len(hashes) == 2


@pytest.mark.parametrize("delay", ["1/2", "1/3", "3/8"])
def test_pairs_are_kicks_at_integer_times_and_after_a_delay(delay):
    a, q = (tau := Fraction(delay)).as_integer_ratio()
    K, K_later, x, p = 0.7, -0.4, 0.3, 0.2
    seen = maps.step(planes.pairs(delay).forcing(K, K_later), x, p / q)
    for strength, time in ((K, tau), (K_later, 1 - tau)):
        p += strength / (2 * np.pi) * np.sin(2 * np.pi * x)
        x += float(time) * p
    assert_allclose([seen[0] % 1, q * seen[1]], [x % 1, p], rtol=0, atol=1e-14)
    assert planes.pairs(delay).second[a] == 1 / q


def test_pairs_half_a_period_apart_have_the_boundary_of_two_kicks():
    _, halves = planes.pairs("1/2").ray(30)
    assert (2 * halves == TWO.ray(30)[1]).all()
    (_, alone), (_, two_times) = planes.pairs("1/2").ray(0), planes.pairs("1/5").ray(0)
    for profile in (alone, two_times):  # each is the standard map, as the second series is absent
        assert critical_scale(profile).value == pytest.approx(0.971635406, rel=1e-8)


@pytest.mark.parametrize("delay", ["0", "1", "7/5", "1/65"])
def test_a_delay_must_be_a_fraction_of_the_period(delay):
    with pytest.raises(ValueError, match=rf"delay={delay} must be between 0 and 1, with a denom"):
        planes.pairs(delay)


@pytest.mark.parametrize(
    "plane",
    [planes.two_kicks(), planes.rotating("2/5"), planes.three_kicks(0.2), planes.pairs("2/7")],
)
def test_a_plane_can_be_parsed_from_its_name(plane):
    assert planes.parse(plane.name) == plane


GOOD = {"name": "mine", "axes": AXES, "origin": (0, 0), "first": (1, 0), "second": (1, 1)}


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"second": (2, 0)}, "first=(1.0, 0.0) and second=(2.0, 0.0) are dependent"),
        ({"second": (0, 0)}, "second: profile is zero; a ray needs a direction"),
        ({"origin": (0, 0, 0)}, "have [3, 2, 2] strengths; they must have the same"),
        (dict.fromkeys(("origin", "first", "second"), (1,) * 65), "have [65, 65, 65] strengths"),
        (dict.fromkeys(("origin", "first", "second"), (1,)), "have [1, 1, 1] strengths"),
        ({"first": (1, np.nan)}, "first: profile=(1, nan) is not finite"),
        ({"origin": "00"}, "origin: kappa='00' must consist of real numbers"),
        ({"name": ""}, "name='' must be a string"),
        ({"axes": {"kappa1": "one"}}, "must be two names that begin with kappa"),
        ({"axes": {"angle": "one", "kappa2": "two"}}, "must be two names that begin with kappa"),
        ({"axes": ["kappa1", "kappa2"]}, "axes=['kappa1', 'kappa2'] must be"),
        ("two kicks", "'two kicks' is not a plane; write two-kicks, rotating:FREQUENCY"),
        ("three-kicks:", "'three-kicks:' is not a plane"),
        ("three-kicks:a", "third='a' is not a fraction"),
        ("three-kicks:1e400", "third='1e400' is not a fraction"),
        ("rotating:1/3,1/4,1", "is not a plane"),
        ("rotating:1/0", "frequency='1/0' is not a fraction"),
        ("rotating:1/65", "a denominator from 2 to 64"),
        ("rotating:2", "a denominator from 2 to 64"),
        ("rotating:1/2,1/4", "second: profile is zero"),
    ],
)
def test_invalid_planes_are_refused_and_the_error_names_the_cause(bad, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        planes.parse(bad) if isinstance(bad, str) else Plane(**GOOD | bad)
