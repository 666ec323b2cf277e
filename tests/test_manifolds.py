"""Manifolds of periodic orbits: they are invariant, and the action yields the turnstile's area."""

import numpy as np
import pytest

from nasm import manifolds, maps
from nasm.action import LostError, ordered_orbits


def step_back(kappa, x, y):
    for strength in kappa[::-1]:
        x, y = maps.unkick(strength, x, y)
    return x, y


CASES = [((0.9,), 0, 1), ((0.5, 0.4), 1, 2), ((0.3, 0.2, 0.25), 2, 5), ((1.2, 0.3), 1, 3)]


@pytest.mark.parametrize(("kappa", "p", "q"), CASES)
@pytest.mark.parametrize(("branch", "advance", "turns"), [
    (manifolds.unstable, maps.step, -1), (manifolds.stable, step_back, 1)
])  # fmt: skip
def test_a_manifold_is_mapped_into_itself(kappa, p, q, branch, advance, turns):
    x, y = (one[0] for one in ordered_orbits(kappa, p, q)[0].points())
    for toward in (1, -1):
        long = np.array(branch(kappa, p, q, x, y, 3 / q, 1e-4, toward))
        image_x, image_y = long[:, long[0].size // 300 : long[0].size // 60 : 10]
        assert image_x.size > 10
        for _ in range(q):
            image_x, image_y = advance(kappa, image_x, image_y)
        apart = long[:, :, None] - np.array([image_x + turns * p, image_y])[:, None]
        assert np.hypot(*apart).min(axis=0).max() < 1e-4  # the spacing of the manifold's points
        assert toward * (long[0, 9] - x) > 0


@pytest.mark.parametrize(("kappa", "p", "q"), CASES)
@pytest.mark.parametrize("above", [True, False])
def test_both_lobes_of_a_turnstile_have_the_area_given_by_the_action(kappa, p, q, above):
    result = manifolds.turnstile(kappa, p, q, above, spacing=2e-4)
    up, down = (np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2 for x, y in result.lobes)
    assert up * down < 0
    assert [abs(up), abs(down)] == pytest.approx([result.area] * 2, rel=1e-3)


@pytest.mark.parametrize("branch", [manifolds.unstable, manifolds.stable])
@pytest.mark.parametrize(("changed", "message"), [
    ({"toward": 0}, "toward=0 must be 1"), ({"toward": 2}, "toward=2 must be 1"),
    ({"spacing": 0}, "spacing=0.0 must be pos"), ({"spacing": -1}, "spacing=-1.0 must be pos"),
    ({"spacing": np.nan}, "spacing=nan must be"), ({"spacing": np.inf}, "spacing=inf must be"),
    ({"length": -1}, "length=-1.0 must be"), ({"length": np.inf}, "length=inf must be"),
    ({"x": 0.123}, r"\(0.123, 0.0\) is not on an orbit of p/q = 0/1: .* it is off by 0.1"),
    ({"p": 1, "q": 2}, "is not on an orbit of p/q = 1/2: after q periods it is off by 1"),
    ({"x": np.nan}, "x is not finite"), ({"q": 0}, "q=0 must be a whole number"),
    ({"x": 0.5}, "0.5, 0.0\\) is not hyperbolic"),
])  # fmt: skip
def test_arguments_that_define_no_manifold_are_refused(branch, changed, message):
    good = {"kappa": (1.0,), "p": 0, "q": 1, "x": 0.0, "y": 0.0, "length": 1.0, "toward": 1}
    assert branch(**good)[0].size > 100
    with pytest.raises(ValueError, match=message):
        branch(**good | changed)


def test_a_manifold_is_finite_for_any_requested_length():
    x, y = manifolds.unstable((0.3,), 0, 1, 0.0, 0.0, 1e9)
    assert 1000 < x.size < 10**6
    assert np.isfinite([x, y]).all()


@pytest.mark.parametrize("spacing", [0, -1e-3, np.nan, np.inf, 1.0])
def test_spacings_that_cannot_resolve_a_lobe_are_refused(spacing):
    with pytest.raises(ValueError, match=r"spacing=.* must be from 1e-05 to 0.1"):
        manifolds.turnstile((1.0,), 1, 6, True, spacing=spacing)


def test_the_turnstile_is_correct_even_if_a_symmetric_guess_fails():
    result = manifolds.turnstile((1.0,), 1, 6, True)
    up, down = (np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2 for x, y in result.lobes)
    assert [abs(up), abs(down)] == pytest.approx([result.area] * 2, rel=0.02)


def test_without_kicks_there_is_no_turnstile():
    with pytest.raises(LostError, match="of 1/2 is not hyperbolic"):
        manifolds.turnstile((0.0, 0.0), 1, 2, True)
    with pytest.raises(ValueError, match="not hyperbolic"):
        manifolds.unstable((0.0, 0.0), 1, 2, 0.0, 0.25, 1.0)
