"""What every method promises: a number or a reason, over random nobles and forcings; its name; and
that the size of a ray's profile is only the unit of the scale.

NumPy's warnings are errors in this suite, so that nothing overflows unseen either.
"""

import numpy as np
import pytest
from cases import thirds

from nasm import barriers, circles, escape, flux, periodic, verdict
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.critical import Status
from nasm.numbers import RotationNumber, parse

GAMMA = parse("gamma")


def answers(omega, profile, part):
    """Of each method: a number that is NaN without an answer, and the status."""
    yield from (
        (found.value, found.status)
        for found in (
            continuation.critical_scale(omega, profile, 1e-4),
            periodic.critical_scale(omega, profile, 1500),
            flux.flux(omega, profile, 3000),
        )
    )
    circle = circles.invariant_circle(omega, part * profile)
    if circle.status is not Status.NOT_CERTIFIED:  # its error says by how much it is none
        yield circle.error, circle.status


def test_a_rational_omega_has_no_circle():
    for method in (continuation.critical_scale, periodic.critical_scale, flux.flux):
        found = method(parse("3/5"), (0.6, 0.1))
        assert found.status is Status.RATIONAL
        assert np.isnan([found.value, found.error]).all()
    circle = circles.invariant_circle(parse("3/5"), (0.2, 0.1))
    assert (circle.status, circle.certified) == (Status.RATIONAL, False)


PROFILE = np.array([1.0, 0.4])
METHODS = {
    "barriers": lambda profile, size: barriers.critical_scale(profile, 1e-1),
    "cones": lambda profile, size: symmetry_line.critical_scale(profile, 300),
    "continuation": lambda profile, size: continuation.critical_scale(GAMMA, profile, 1e-4 / size),
    "escape": lambda profile, size: escape.critical_scale(profile, 1000, 100),
    "periodic": lambda profile, size: periodic.critical_scale(GAMMA, profile, 300),
}


@pytest.mark.parametrize("name", METHODS)
def test_a_ray_s_size_is_a_unit_down_to_the_smallest(name):
    expected = METHODS[name](PROFILE, 1.0)
    assert expected.status is Status.OK
    for size in (2.0**-996, 2.0**13):  # without rounding, which would change escapes
        found = METHODS[name](size * PROFILE, size)
        assert (found.status, found.omega) == (expected.status, expected.omega)
        assert found.error * size == pytest.approx(expected.error, rel=0.3)
        assert abs(found.value * size - expected.value) <= 0.1 * expected.error


def test_too_short_periods_are_admitted():
    omega = parse("gamma")
    for found in (periodic.critical_scale(omega, (1, 0), 13), flux.flux(omega, (0.6, 0.1), 5)):
        assert found.status is Status.NOT_CONVERGED
        assert np.isnan(found.value)


@pytest.mark.parametrize("n_kicks", thirds([2, 4, 3, 1, 5, 6]))
def test_a_method_gives_a_number_or_a_reason_and_no_warning(n_kicks):
    rng = np.random.default_rng(n_kicks)
    for _ in range(4):
        quotients = (10 ** rng.uniform(0, 1.7, rng.integers(0, 4))).astype(int)
        omega = RotationNumber((int(rng.integers(-2, 3)), *quotients.tolist()), (1,))
        half = rng.normal(size=n_kicks)
        profile = (half + np.roll(half[::-1], 1)) * 10 ** rng.uniform(-3, 1)  # symmetric at site 0
        for number, status in answers(omega, profile, rng.uniform(0, 1)):
            assert np.isnan(number) == (status is not Status.OK)


@pytest.mark.parametrize("n_kicks", thirds([2, 4, 3, 1, 6]))
def test_the_methods_for_the_last_barrier_give_a_number_or_a_reason_and_no_warning(n_kicks):
    rng = np.random.default_rng(n_kicks)
    profile = rng.uniform(0, 0.4) ** np.arange(n_kicks)  # its first kick has the dominant line
    profile = np.maximum(profile, np.roll(profile[::-1], 1)) * 10 ** rng.uniform(-3, 1)
    methods = [barriers.critical_scale(profile, 1e-2)]
    if n_kicks <= 2:
        methods.append(symmetry_line.critical_scale(profile, 100))
    for found in methods:
        assert np.isnan(found.value) == (found.status not in (Status.OK, Status.WIDE))
    said = verdict.verdict(profile)
    undecided = said.answer is verdict.Answer.UNDECIDED
    assert undecided == (said.evidence is verdict.Evidence.NONE)
