"""Claims on periodic orbits (Sec. IV)."""

import numpy as np

from nasm import fixed_points, periodic
from nasm.maps import TWO_PI, step, step_tangent, unkick
from pipeline.sweep.grid import parse_axis
from workflows.claims.rules import Claim, graded, identity
from workflows.parts.period_one import secondary_dataset

_TESTS = "python -m pytest tests/test_fixed_points.py"
_PERIOD_ONE = "python -m workflows.period_one"


def periodic_claims():
    random = np.random.default_rng(2)
    kappas = random.uniform(-4, 4, (2, 500))
    printed = _printed_stability(*kappas)
    off = np.abs(fixed_points.primary_residue(*kappas) - printed / 2).max()
    off = max(off, np.abs(_tangent_residues(kappas) - printed / 2).max())
    wrong = int((_is_stable(kappas) != ((printed > 0) & (printed < 2))).sum())
    return [
        *_carried_orbits(),
        _six_orbits(),
        Claim(
            "Sec. IV.A, Eqs. (greene_res), (period_one_r1)-(r4)",
            "2R = -κ1 - κ2 - κ1κ2/2, κ1 + κ2 - κ1κ2/2, κ2 - κ1 + κ1κ2/2, κ1 - κ2 + κ1κ2/2",
            *identity(off, 1e-13),
            f"{_TESTS}::test_primary_points_are_fixed_and_have_the_residues_of_the_tangent_map",
        ),
        Claim(
            "Sec. IV.A, Eqs. (period_one_r1)-(r4)",
            "The points are stable iff these lie between 0 and 2",
            *graded(
                f"in {wrong} of {printed.size} cases this and the eigenvalues of DT, complex or "
                "real, disagree",
                wrong == 0,
            ),
            _PERIOD_ONE,
        ),
        Claim(
            "Sec. IV.A, Fig. 3",
            "The stability diagrams satisfy the symmetries P3 and P4",
            *identity(max(_permutation_errors(kappas)), 1e-13),
            f"{_TESTS}::test_symmetries_permute_the_residues",
        ),
        *_secondary_orbits(),
    ]


def _permutation_errors(kappas):
    """Yield the errors of P3, which takes points I, II, III, IV to II, I, IV, III, and of P4."""
    here = fixed_points.primary_residue(*kappas)
    for signs, order in (((-1, -1), [1, 0, 3, 2]), ((1, -1), [2, 3, 0, 1])):
        there = fixed_points.primary_residue(*(kappas.T * signs).T)
        yield np.abs(there - here[order]).max()


def _printed_stability(kappa1, kappa2):
    product, total, difference = kappa1 * kappa2 / 2, kappa1 + kappa2, kappa1 - kappa2
    return np.stack([-total - product, total - product, product - difference, difference + product])


def _tangents(kappas):
    """Compute DT at the primary points, shape (point, forcing, 2, 2)."""
    points = fixed_points.PRIMARY
    return np.array([[step_tangent(kappa, x, y) for kappa in kappas.T] for x, y in points])


def _tangent_residues(kappas):
    return (2 - np.trace(_tangents(kappas), axis1=-2, axis2=-1)) / 4


def _is_stable(kappas):
    """Tell whether both eigenvalues are complex; the boundary between has measure zero."""
    return np.abs(np.linalg.eigvals(_tangents(kappas)).imag).min(axis=-1) > 0


def _carried_orbits():
    """Compare orbits of several p/q under κ1 > κ2 > 0 with their images under swapped kicks."""
    worst, residues = 0.0, 0.0
    for kappa in ((0.5, 0.3), (0.8, 0.1), (0.35, 0.3)):
        for p, q in ((1, 2), (1, 3), (2, 5), (5, 8)):
            x = periodic.symmetric_orbit(kappa, p, q)
            z = x[0], x[1] - x[0]  # there is no kick at the symmetry centre
            w = unkick(kappa[1], *z)
            first, second = _period(kappa, *z, p, q), _period(kappa[::-1], *w, p, q)
            worst = max(worst, first[0], second[0])
            residues = max(residues, abs(first[1] - second[1]))
    return [
        Claim(
            "Sec. IV, Eq. (wz_property)",
            "If z is an m/n-periodic orbit of T_κ1κ2, then S_κ2⁻¹z is one of T_κ2κ1",
            *identity(worst, 1e-12, "12 orbits close within"),
            f"{_TESTS.replace('fixed_points', 'periodic')}::"
            "test_residue_is_equal_under_the_symmetries",
        ),
        Claim(
            "Sec. IV",
            "Both have the same linear stability",
            *identity(residues, 1e-12, "largest difference of residues"),
            f"{_TESTS.replace('fixed_points', 'periodic')}::"
            "test_residue_is_equal_under_the_symmetries",
        ),
    ]


def _period(kappa, x, y, p, q):
    """Return how far an orbit is from p/q-periodic, and its residue."""
    start, tangent = (x, y), np.eye(2)
    for _ in range(q):
        tangent = step_tangent(kappa, x, y) @ tangent
        x, y = step(kappa, x, y)
    return max(abs(x - p - start[0]), abs(y - start[1])), (2 - np.trace(tangent)) / 4


def _six_orbits():
    """Count sign changes of y' - y, where 2y = m - (κ1/2π) sin 2πx gives x' = x + m."""
    random, x = np.random.default_rng(3), (np.arange(4000) + 0.5) / 4000
    counts = np.array(
        [
            [_sign_changes(kappa, m, x) for m in (-1, 0, 1)]
            for kappa in random.uniform(-1, 1, (200, 2))
        ]
    )
    six, four = int(counts.sum(axis=1).min()), int(counts[:, 1:].sum(axis=1).min())
    return Claim(
        "Sec. IV.A",
        "There are six primary period-one orbits",
        *graded(
            f"{six} with rotation number -1, 0 or 1, {four} but for y → y + 1, at all of 200 "
            "forcings with |κ_i| < 1",
            four == 6,
            six == 6,
        ),
        f"{_TESTS}::test_primary_points_are_fixed_and_have_the_residues_of_the_tangent_map",
        "Points with y = ½ and y = -½ are translates of one another, as are endlessly many more; "
        "up to translation there are four.",
    )


def _sign_changes(kappa, m, x):
    y = (m - kappa[0] / TWO_PI * np.sin(TWO_PI * x)) / 2
    rise = step(kappa, x, y)[1] - y
    return np.count_nonzero(rise * np.roll(rise, 1) < 0)


def _secondary_orbits():
    found = secondary_dataset(parse_axis("0:8:80"))
    kappa1, kappa2 = np.meshgrid(found.kappa1, found.kappa2)
    exists = np.isfinite(found.z.values)
    primary = fixed_points.primary_residue(kappa1, kappa2)[1]
    x, y, residue = (found[name].values[exists] for name in ("x", "y", "residue"))
    ends = [
        step(kappa, *point)
        for kappa, *point in zip(np.stack([kappa1, kappa2], -1)[exists], x, y, strict=True)
    ]
    off = np.abs(np.array(ends) - np.stack([x, y], -1)).max()
    stable, near = (residue > 0) & (residue < 1), primary[exists] > -0.25
    elsewhere = int((exists != (primary < 0)).sum())
    return [
        Claim(
            "Sec. IV.A, Eqs. (second1), (second2)",
            "Solutions of these are the secondary period-one orbits",
            *identity(off, 1e-12, f"{exists.sum()} points are fixed within"),
            f"{_TESTS}::test_secondary_points_are_fixed",
        ),
        _cubic_estimate(),
        Claim(
            "Sec. IV.A, Fig. 4",
            "The region where secondary orbits exist ends where (½, 0) loses its stability",
            *graded(
                f"in {elsewhere} of {exists.size} cells with 0 < κ_i < 8 they exist without R < 0 "
                "at (½, 0), or the other way round",
                elsewhere == 0,
            ),
            _PERIOD_ONE,
        ),
        Claim(
            "Sec. IV.A, Fig. 4",
            "These secondary orbits are stable",
            *graded(
                f"0 < R < 1 at {stable.mean():.0%} of those with κ_i < 8, and at "
                f"{stable[near].mean():.0%} of those next to the pitchfork, where -¼ < R < 0 at "
                "(½, 0)",
                stable.all(),
                stable[near].all(),
            ),
            _PERIOD_ONE,
            "Next to the pitchfork that makes them; further on they lose their stability in turn.",
        ),
    ]


def _cubic_estimate():
    exact, as_printed, corrected = cubic_estimates(1e-3)
    as_printed, corrected = abs(as_printed - exact), abs(corrected - exact)
    return Claim(
        "Sec. IV.A, Eq. (z_aprox)",
        "z² = (6κ1 + 6κ2 + 3κ1κ2)/(κ1 - κ1κ2/2 + κ2(1 - κ1/2)³) next to (½, 0)",
        *graded(
            f"at κ1 = κ2 = 4.001 z² = {exact:.3g}, from which the printed form is off by "
            f"{as_printed:.2g}, and the one with -3κ1κ2 by {corrected:.1e}",
            as_printed < exact**1.5,
            corrected < exact**1.5,
        ),
        f"{_TESTS}::test_the_estimate_as_printed_does_not_vanish_at_the_pitchfork",
        "A misprint of the sign; see the errata.",
    )


def cubic_estimates(epsilon):
    """Return z² of (second2), and as estimated in print and corrected, at κ1 = κ2 = 4 + epsilon."""
    kappa = 4 + epsilon
    exact = float(fixed_points.secondary(kappa, kappa)[0][0]) ** 2
    denominator = kappa - kappa**2 / 2 + kappa * (1 - kappa / 2) ** 3
    as_printed = (12 * kappa + 3 * kappa**2) / denominator
    return exact, as_printed, float(fixed_points.cubic_estimate(kappa, kappa)) ** 2
