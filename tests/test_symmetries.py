import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from nasm import symmetries
from nasm.maps import kick, unkick
from nasm.numbers import convergents, parse, rational
from nasm.orbits import orbit

strengths = st.floats(-2, 2)
coordinates = st.floats(-1, 1)


@st.composite
def cases(draw, periods):
    """Draw a forcing, a start, and the largest number of steps that fit into six kicks."""
    P = draw(st.sampled_from(periods))
    kappa = draw(st.lists(strengths, min_size=P, max_size=P))
    return kappa, draw(coordinates), draw(coordinates), 6 // P


# The rounding error of one kick is below 4e-15 while |x| and |y| are below 10. Each of up to seven
# kicks multiplies this error by at most ‖DS‖ ≤ 4.
SHORT = 4e-15 * 4**7

# For each symmetry: the image of the forcing, and the image of the orbit of (x, y).
IMAGES = {
    symmetries.negate: lambda kappa, xs, ys, t: (-kappa, (xs + 0.5, ys)),
    symmetries.alternate: lambda kappa, xs, ys, t: (
        kappa * (-1.0) ** np.arange(kappa.size), (xs + kappa.size // 2 * t, ys + 0.5)
    ),
    symmetries.shift: lambda kappa, xs, ys, t: (np.roll(kappa, -1), kick(kappa[0], xs, ys)),
}  # fmt: skip


@pytest.mark.parametrize("carry", IMAGES)
@given(data=st.data())
def test_symmetries_map_orbits_to_orbits_under_the_image_of_the_forcing(carry, data):
    periods = (2, 4) if carry is symmetries.alternate else (1, 2, 3, 4, 5)
    kappa, x, y, n = data.draw(cases(periods))
    image, *start = carry(np.array(kappa), x, y)
    expected = IMAGES[carry](np.array(kappa), *orbit(kappa, x, y, n), np.arange(n + 1))
    np.testing.assert_array_equal(image, expected[0])
    assert_allclose(orbit(image, *start, n), expected[1], rtol=0, atol=SHORT)


@pytest.mark.parametrize(
    ("kappa", "length"),
    [
        ((0.3, 0.2), 2),
        ((0.3, 0.3), 1),
        ((0.3, -0.3), 1),
        ((0.3, 0.0), 2),
        ((0.3, 0.2, -0.3, -0.2), 4),
        ((0.3, 0.2, 0.3, 0.2), 2),
        ((0.3, -0.2, 0.3, -0.2), 2),
        ((0.3, 0.2, -0.3, 0.2), 4),
        ((0.3, 0.0, -0.3, 0.0), 2),
        ((0.0, 0.3, 0.0, -0.3), 2),
        ((0.0, 0.0, 0.3, 0.0, 0.0, -0.3), 3),
        ((0.3, 0.0, -0.2, 0.0, -0.3, 0.0, 0.2, 0.0), 8),
        ((0.3, 0.0, -0.2, 0.0, 0.3, 0.0, -0.2, 0.0), 4),
        ((0.3, 0.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0), 4),
        ((0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0, -0.3), 4),
    ],
)
def test_the_shorter_forcing_has_the_same_orbits_and_the_matching_omega(kappa, length):
    (short,), zero = symmetries.shorten([kappa], rational(0))
    assert short.size == length
    assert (min(symmetries.distances_to_shorter(kappa), default=1) == 0) == (length < len(kappa))
    x, y = np.array([0.13, 0.4]), np.array([0.31, 0.77])
    long_x, long_y = symmetries.lengthen(kappa, x, y)
    ratio = len(kappa) // length
    xs, ys = orbit(short, x, y, 3 * ratio)
    # ω under the short forcing is ω under the long one, divided by `ratio`, plus `zero`.
    (*_, turns) = convergents(zero)
    gained = np.arange(4) * ratio * float(turns)
    moved_x, moved_y = xs[::ratio] + (long_x - x), ys[::ratio] + (long_y - y)
    found_x, found_y = orbit(kappa, long_x, long_y, 3)
    assert_allclose(found_y, moved_y, rtol=0, atol=1e-12)
    assert_allclose(found_x, moved_x - gained[:, None], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("kappa", "distance"),
    [
        ((2.0, -1.9), 0.05),
        ((1.9, 2.0), 0.05),
        ((1.0, 0.0), 1.0),
        ((1.0, 0.9, 0.95), 0.1),
        ((1.0, 0.0, -0.9, 0.0), 0.1),
        ((1.0, 0.1, -0.95, -0.02), 0.08),  # distance from an antiperiodic forcing
        ((0.5, 1.0, 0.4, 0.9), 0.1),
        ((0.5, -1.0, -0.4, 0.9), 0.1),
    ],
)
def test_distances_to_a_shorter_forcing_are_relative_to_the_largest_kick(kappa, distance):
    for copy in (kappa, np.roll(kappa, 1), np.negative(kappa), np.array(kappa) * 1e-200):
        assert min(symmetries.distances_to_shorter(copy)) == pytest.approx(distance)
    assert symmetries.distances_to_shorter([kappa[0]]).size == 0


def test_forcings_without_a_common_shorter_period_are_unchanged():
    pair = [(0.3, 0.3), (0.3, -0.3)]
    result, omega = symmetries.shorten(pair, parse("gamma"))
    np.testing.assert_array_equal(result, pair)
    assert omega == parse("gamma")
    (start, profile), omega = symmetries.shorten([(0, 0.1, 0, -0.1), (0, 1, 0, -1)], parse("gamma"))
    np.testing.assert_array_equal((start, profile), [(0, 0.1), (0, 1)])
    assert omega == parse("(gamma+1)/2")


@pytest.mark.parametrize("kappa", [(0.3, 0.2), (0.3, -0.3), (0.1, 0.2, 0.3)])
def test_shortening_yields_the_omega_of_the_circle_between_y_0_and_1(kappa):
    near, far = (symmetries.shorten([kappa], parse(f"[{n};3,(1)]")) for n in (1, 1 + 6 * 10**20))
    np.testing.assert_array_equal(near[0], far[0])
    assert near[1] == far[1]
    assert 0 <= float(far[1]) <= len(far[0][0])


def test_rays_are_exact_on_axes_and_diagonals():
    assert symmetries.ray(90.0).tolist() == [0.0, 1.0]
    assert symmetries.ray(180.0).tolist() == [-1.0, 0.0]
    for angle in (45, 135, 225):
        kappa1, kappa2 = symmetries.ray(angle)
        assert abs(kappa1) == abs(kappa2)
    angles = np.array([[-30.0, 20.0, 100.0], [45.0, 90.0, 300.0]])
    assert_allclose(symmetries.ray(angles)[..., 0], np.cos(np.deg2rad(angles)), atol=1e-15)
    assert_allclose(symmetries.ray(angles)[..., 1], np.sin(np.deg2rad(angles)), atol=1e-15)


@pytest.mark.parametrize("kappa", [(0.6,), (0.4, 0.3), (0.3, 0.1, 0.1), (0.1, 0.2, 0.2, 0.1)])
def test_orbits_from_symmetry_lines_are_their_own_mirror_images(kappa):
    period, y = len(kappa), np.linspace(0, 1, 6)
    x, y = symmetries.symmetry_lines(kappa, y)
    for strength in 2 * kappa[::-1]:
        x, y = unkick(strength, x, y)
    sites, _ = orbit(kappa, x, y, 6 * period, 1)
    here = np.arange(period) + 2 * period
    centres = set()
    for line in range(4):
        # The centre c/2 is a site or midway between two sites; x_{c-n} + x_n is a whole number.
        sums = {c: sites[c - here, line] + sites[here, line] for c in range(4 * period, 6 * period)}
        (centre,) = (c for c, sum in sums.items() if np.abs(sum - np.rint(sum)).max() < 1e-9)
        centres.add(centre)
    assert max(centres) - min(centres) == period
