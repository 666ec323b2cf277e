"""The flux through broken circles, compared with areas, exact reductions and renormalisation."""

import math

import numpy as np
import pytest
from oracles import LITERATURE

from nasm import maps, periodic
from nasm.action import ordered_orbits
from nasm.flux import action_difference, flux
from nasm.numbers import parse
from nasm.results import Status

GOLDEN = parse("gamma")
GOLDEN_AXIS = periodic.critical_scale(GOLDEN, (1.0, 0.0)).value


def turnstile_area(kappa, p, q, n=200_000):
    """Return the area between a segment and its image under T^q, as the difference of their ∫y dx.

    The segment joins a minimizing point to the next minimax point. Its image has the same ends,
    shifted by p turns.
    """
    (x0, y0), (x1, y1) = (orbit.points() for orbit in ordered_orbits(kappa, p, q))
    ahead = (x1 - x0[0]) % 1
    j = ahead.argmin()
    t = np.linspace(0, 1, n)
    x, y = x0[0] + t * ahead[j], y0[0] + t * (y1[j] - y0[0])
    area = np.trapezoid(y, x)
    for _ in range(q):
        x, y = maps.step(kappa, x, y)
    return abs(np.trapezoid(y, x) - area)


@pytest.mark.parametrize(
    ("kappa", "p", "q"),
    [((1.2,), 1, 3), ((1.2,), 2, 5), ((0.7, 0.4), 1, 3), ((0.7, 0.4), 3, 4), ((0.9, -0.5), 2, 5),
     ((0.2, 0.9), 1, 2), ((0.8, 0.3, 0.3), 1, 3), ((0.8, 0.3, 0.3), 2, 5), ((1.2,), 1, 2),
     ((0.0, 0.6, 0.6), 1, 2), ((0.6, 0.2, 0.3), 3, 5)],
)  # fmt: skip
def test_the_difference_in_action_is_the_area_of_the_turnstile(kappa, p, q):
    expected = turnstile_area(np.array(kappa), p, q)
    assert action_difference(kappa, p, q) == pytest.approx(expected, rel=1e-6)


def test_the_action_difference_of_fixed_points_is_the_potential_difference():
    # The orbits are (0, 0) and (1/2, 0); their actions differ only by the difference in potential.
    assert action_difference((0.8,), 0, 1) == pytest.approx(0.8 / (2 * math.pi**2), rel=1e-14)


@pytest.mark.parametrize("part", [0.9, 0.99, 0.999])
def test_nothing_passes_through_a_circle(part):
    result = flux(GOLDEN, (part * GOLDEN_AXIS, 0.0))
    assert result.status is Status.OK
    assert abs(result.value) <= result.error < 1e-15


def test_no_value_is_returned_at_the_breakup():
    result = flux(GOLDEN, (GOLDEN_AXIS, 0.0))
    assert result.status is Status.NOT_CONVERGED
    assert math.isnan(result.value)


def test_the_claimed_error_covers_the_change_due_to_longer_orbits():
    for excess in (1e-3, 1e-2, 0.1):
        kappa = (GOLDEN_AXIS * (1 + excess), 0.0)
        answers = (flux(GOLDEN, kappa, q_max) for q_max in (50, 200, 800, 3200, 12_800))
        rough, fine = next(f for f in answers if f.status is Status.OK), flux(GOLDEN, kappa)
        assert abs(rough.value - fine.value) < rough.error < 0.011 * rough.value


def test_the_exponent_agrees_with_renormalisation():
    # The exponent approaches MacKay's ln(αβ)/ln δ from below; the deviation is proportional to the
    # distance from the breakup.
    x = np.array([5e-4, 1e-3, 2e-3])
    values = [flux(GOLDEN, (GOLDEN_AXIS * (1 + e), 0.0)).value for e in x]
    slopes = np.diff(np.log(values)) / np.log(2)
    assert 2 * slopes[0] - slopes[1] == pytest.approx(
        LITERATURE["flux_exponent"]["value"], abs=1e-3
    )


@pytest.mark.parametrize(("kappa", "p", "q"), [(0.9, 377, 305), (1.2, 21, 17), (1.8, 21, 17)])
def test_the_flux_in_the_standard_map_is_found_despite_even_denominators(kappa, p, q):
    # Convergents of 2γ: 5/4, 21/17, 89/72, 377/305. For q = 4 and 72 the minimizing orbit has no
    # symmetry centre on a site if P = 1. At each strength, p/q is the convergent with the largest
    # odd q for which the orbits are found; its action difference is already close to the limit.
    result = flux(parse("2gamma"), (kappa,))
    assert result.status is Status.OK
    assert result.error < 1e-2 * result.value
    assert result.value == pytest.approx(action_difference((kappa,), p, q), rel=0.02)
    thrice = flux(parse("6gamma"), (kappa,) * 3)
    assert thrice.value == pytest.approx(3 * result.value, rel=1e-9)
