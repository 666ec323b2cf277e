"""Ordered orbits by the action: high precision, symmetric shooting, copies, and continuation."""

import mpmath
import numpy as np
import oracles
import pytest

from nasm import action, periodic
from nasm.circles import continuation
from nasm.critical import Status
from nasm.maps import rotating_forcing
from nasm.numbers import distinct_convergents, parse
from nasm.symmetries import ray

ASYMMETRIC = np.array((1, 0.7, 0.3))


@pytest.mark.parametrize("family", ["minimizing", "minimax"])
def test_residues_without_a_symmetry_against_fifty_digits(family):
    kappa, p, q = 0.4 * ASYMMETRIC, 37, 29
    orbit = dict(zip(("minimizing", "minimax"), action.ordered_orbits(kappa, p, q), strict=True))
    orbit = orbit[family]
    strengths, x = np.roll(kappa, -orbit.site), orbit.sites()
    assert np.argsort((x[::3] - x[0]) % 1).tolist() == np.argsort(np.arange(q) * p % q).tolist()
    with mpmath.workdps(50):
        at = mpmath.matrix([mpmath.mpf(x[0]), mpmath.mpf(x[0] - (x[-1] - p))])
        for _ in range(3):  # Newton's method for T^q(x, y) = (x + p, y)
            here, y, matrix = at[0], at[1], mpmath.eye(2)
            for strength in np.tile(strengths, q):
                c = mpmath.mpf(strength) * mpmath.cospi(2 * here)
                matrix = mpmath.matrix([[1 + c, 1], [c, 1]]) * matrix
                here, y = oracles.exact_step([strength], here, y)
            at -= mpmath.lu_solve(matrix - mpmath.eye(2), mpmath.matrix([here - p, y]) - at)
        assert abs(at[0] - x[0]) < 1e-12
        expected = float((2 - matrix[0, 0] - matrix[1, 1]) / 4)
    assert (expected > 0) == (family == "minimax")
    assert orbit.residue == pytest.approx(expected, rel=(3 * q) ** 2 * 2**-52)
    assert orbit.refined_residue() == pytest.approx(expected, rel=1e-14)


def test_a_breakup_beyond_a_near_miss_is_found_and_is_no_breakup_by_norms():
    # The ray passes 4e-4 below another sheet of the boundary, at 0.5195. Circles below it look as
    # if they were to break there; the residues of long orbits fall beyond it and rise at the end.
    omega, profile = parse("[0;1,2,1,3,1,2,(1)]"), rotating_forcing(*ray(160), "1/3", 0)
    by_norms = continuation.critical_scale(omega, profile, 1e-3)
    assert by_norms.status is Status.UNDECIDED
    assert by_norms.lower < 0.5195
    found = periodic.critical_scale(omega, profile)
    assert found.status is Status.OK
    assert found.error < 1e-6
    assert by_norms.lower < found.value
    for scale in (0.523, found.value - 0.002):
        assert oracles.residues_fall(omega, scale * profile, 800)
    assert not oracles.residues_fall(omega, (found.value + 0.002) * profile, 800)


def test_far_beyond_the_breakup_orbits_are_lost_and_have_no_residue_of_0():
    # The first place tried in the gap had no ordered orbit: that was taken for a flat action.
    kappa = 0.5585 * np.array([0.0494274894847, 0.792760428306, -0.139033252069, 0.792760428306])
    for fraction in distinct_convergents(parse("[0;1,4,1,4,(1)]"), 200)[-3:]:
        residue = periodic.residue(kappa, fraction.numerator, fraction.denominator)
        assert np.isnan(residue) or residue > 10
