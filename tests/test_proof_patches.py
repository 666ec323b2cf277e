"""Proofs that circles exist throughout a patch of forcings: constants, and the scales reached."""

import json
from functools import cache
from itertools import chain, pairwise, product

import numpy as np
import pytest
from audit import mutant
from cases import thirds
from flint import arb, ctx

from nasm import barriers, periodic, proofs
from nasm.numbers import parse
from nasm.proofs import barrier, residuals
from nasm.proofs import certificate_checker as checker
from nasm.proofs import patches as module
from nasm.proofs.certificate_checker import check
from nasm.symmetries import ray

GAMMA, N = parse("gamma"), 256
TRIANGLE = (0.5, 0.25), (0.0625, -0.125)  # profile, tilt: rays from 12.5° to 40.6°, used with γ


@pytest.mark.parametrize(
    ("profile", "nearest"),
    [
        ((1.0,), 0.25),
        (ray(20), 0.25),
        ((0.7, -0.7), 0.25),
        pytest.param((1.0, 0.5, 0.7), 0.4, marks=pytest.mark.slow),
        *(pytest.param(ray(angle), 0.0095, marks=pytest.mark.slow) for angle in (0, 110)),
    ],
)
def test_a_barrier_is_proved_along_a_whole_ray(profile, nearest):
    result = barriers.critical_scale(profile)
    reached(result.omega, profile, result.value, None, nearest)


@pytest.mark.parametrize("nearest", [0.3, pytest.param(0.125, marks=pytest.mark.slow)])
def test_a_barrier_is_proved_throughout_a_triangle(nearest):
    reached(GAMMA, TRIANGLE[0], breakup(*TRIANGLE), TRIANGLE[1], nearest)


def reached(omega, profile, value, tilt, nearest):
    below, patches = proofs.proved_below(omega, profile, value, np.inf, tilt, nearest)
    assert below == pytest.approx((1 - nearest) * value)
    scales = [proof.scales for proof in patches]
    assert scales[0][0] == 0
    assert all(one[1] == other[0] for one, other in pairwise(scales))
    assert below == scales[-1][1] == proofs.covered_up_to(scales)
    for proof, (low, high) in zip(patches[:2], scales, strict=False):
        certificate = json.loads(json.dumps(proof.certificate()))
        assert f" from {low} to {high} times (" in check(certificate)


def breakup(profile, tilt):
    """Return the smallest scale at which γ's circle breaks on any of five rays, using residues."""
    across = np.array(profile) + np.linspace(-1, 1, 5)[:, None] * tilt
    return min(periodic.critical_scale(GAMMA, kappa).value for kappa in across)


def test_intervals_cover_scales_up_to_the_first_gap():
    assert proofs.covered_up_to([(0.2, 0.3), (0.0, 0.2)]) == 0.3
    assert proofs.covered_up_to([(0.0, 0.2), (np.nextafter(0.2, 1), 0.3)]) == 0.2
    assert proofs.covered_up_to([(1e-300, 0.2)]) == proofs.covered_up_to([]) == 0


@pytest.mark.parametrize("failure", range(1, 6))
def test_a_failed_interval_is_shortened_and_retried_before_the_next(failure, monkeypatch):
    tried = []

    def proof_of(low, high, value, about, reduction):
        assert reduction == 1
        tried.append((low, high))
        proved = len(tried) != failure
        return barrier.BarrierProof(
            proved, "" if proved else "not proved: ", **about, scales=(low, high)
        )

    monkeypatch.setattr(module, "_proved_between", proof_of)
    below, patches = module.proved_below(GAMMA, (1.0,), 0.97, np.inf, nearest=0.01)
    scales = [proof.scales for proof in patches]
    assert len(tried) == len(scales) + 1
    assert scales[0][0] == 0
    assert all(one[1] == other[0] for one, other in pairwise(scales))
    assert 0.9 < below == scales[-1][1] == proofs.covered_up_to(scales)


def test_a_patch_whose_inequalities_fail_is_retried_with_a_smaller_residual(monkeypatch):
    tried = []

    def proof_of(low, high, value, about, reduction):
        tried.append((low, high, reduction))
        return barrier.BarrierProof(reduction < 1, "", **about, scales=(low, high), n=64)

    monkeypatch.setattr(module, "_proved_between", proof_of)
    below, patches = module.proved_below(GAMMA, (1.0,), 0.97, np.inf, nearest=0.01)
    assert [reduction for *_, reduction in tried] == [1.0] + [0.01] * len(patches)
    assert tried[0][:2] == tried[1][:2] == patches[0].scales
    assert below == patches[-1].scales[1]


@pytest.mark.slow
def test_other_circles_are_proved_to_exist_close_to_the_boundary():
    # The triangle lies between 34.5 and 40 degrees, where [0;1,3,(1)] breaks last.
    low, high = np.array([0.64836, 0.44560]), np.array([0.73828, 0.61949])
    middle, tilt = (low + high) / 2, (high - low) / 2
    at = [periodic.critical_scale("[0;1,3,(1)]", middle + t * tilt).value for t in (-1, 0, 1)]
    below, _ = proofs.proved_below("[0;1,3,(1)]", middle, min(at), np.inf, tilt, 0.03)
    assert below > 0.965 * min(at)


def test_the_proved_scale_ends_at_the_first_gap_between_proofs(monkeypatch):
    def with_a_gap(low, high, value, about, reduction):
        scales = (low + 0.1 * (low > 0.6), high)
        return barrier.BarrierProof(True, "", **about, scales=scales)

    monkeypatch.setattr(module, "_proved_between", with_a_gap)
    below, patches = module.proved_below(GAMMA, (1.0,), 0.97, np.inf, nearest=0.01)
    assert below == proofs.covered_up_to(proof.scales for proof in patches) < patches[-1].scales[1]


@pytest.mark.parametrize("profile", [(1e-300, 0.0), (1e-200, 1e-210, 0.0)])
def test_proofs_for_kicks_too_weak_to_move_a_circle_pass_the_check(profile):
    below, patches = module.proved_below(GAMMA, profile, 0.9, 0.3)
    assert 0.4 < below < 0.9
    check(json.loads(json.dumps(patches[0].certificate())))


@pytest.mark.parametrize("beyond", [1e-3, pytest.param(0.1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("profile", [(1.0,), (0.94, 0.34), (1.0, 0.5, 0.7)])
def test_nothing_is_proved_across_the_breakup(profile, beyond):
    result = barriers.critical_scale(profile)
    for low, value in ((0.9, 1.2), (0.97, 1.02 + beyond)):  # `value` is too large
        scales = np.array([low, 1 + beyond, value + beyond]) * result.value
        assert not tried(result.omega, profile, np.zeros(len(profile)), scales).proved
    below, _ = proofs.proved_below(result.omega, profile, 1.2 * result.value, 0.3)
    assert below < result.value


def tried(omega, profile, tilt, scales):
    """Attempt a proof from the first of three scales to the second, with the third as `value`."""
    about = {"omega": omega, "kappa": tuple(profile), "tilt": tuple(tilt)}
    about |= {"short_omega": omega, "short_kappa": tuple(profile)}
    return module._proved_between(*map(float, scales), about)


@pytest.mark.parametrize("beyond", thirds([0.3, 0.02, 1e-3]))
@pytest.mark.parametrize("end", [1, pytest.param(-1, marks=pytest.mark.slow)])
def test_nothing_is_proved_if_one_side_of_a_patch_crosses_the_breakup(beyond, end):
    # At t = 0 the largest scale is 10% below the breakup; at t = end it is beyond the breakup.
    inner, outer = (barriers.critical_scale(k, 1e-4).value * k for k in (ray(20), ray(25)))
    inner, tilt = 0.9 * inner, end * ((1 + beyond) * outer - 0.9 * inner)
    assert not tried(GAMMA, inner, tilt, (0.8, 1.0, 1.1)).proved
    below, _ = proofs.proved_below(GAMMA, inner, 1.1, np.inf, tilt, 0.08)
    assert below < 1 / (1 + beyond)


# --- each constant is a bound for all σ and t -----------------------------------------


def patch(profile, tilt, low, high, shape, module=module, origin=()):
    with ctx.workprec(128):
        return module._Patch(GAMMA, list(profile), list(tilt), low, high, N, *shape, origin)


def nodes(n):
    return np.cos(np.pi * (2 * np.arange(n) + 1) / (2 * n))


def circles_at_points(profile, tilt, high, shape):
    """Return a case built from circles at Q·R points; its residuals are small only there."""
    result, kappa = patch(profile, tilt, 0.0, high, shape), np.array(profile)
    starts = [
        proofs.barrier.circles.invariant_circle(GAMMA, high / 2 * (1 + s) * (kappa + t * b)).u
        for s, t, b in product(*map(nodes, shape), [np.array(tilt)])
    ]
    with ctx.workprec(128):
        return profile, tilt, high, shape, result.coefficients(result.circles(starts), -80)


def by_values(strength, values, others=(1,), profile=(1e-4, 1e-4), tilt=(0.0, 0.0)):
    """Return a case: strength·sin 2πφ times a polynomial in σ and t.

    At the points the polynomial has the values x·y, with x from `values` and y from `others`.
    """
    shape = len(values), len(others)
    result = patch(profile, tilt, 0.0, 1.0, shape)
    modes = np.zeros((2, result.shape[0] * result.shape[1], len(profile), 1, 2))
    modes[0, :, :, 0, 1] = -strength / 2 * np.outer(values, others).reshape(-1, 1)
    with ctx.workprec(128):
        return profile, tilt, 1.0, shape, result.coefficients(modes, -80)


def complex_modes(tilt, shape):
    """Return random modes, at three sites, for functions that are not odd."""
    rng = np.random.default_rng(5)
    moves = [
        [[[0, *rng.integers(-(2**20), 2**20, 3).tolist()] for _ in "ri"] for _ in range(3)]
        for _ in range(shape[0] * shape[1])
    ]
    return (0.3, -0.2, 0.1), tilt, 1.0, shape, moves


NONE, STEEP = (0.0, 0.0), [0.8, 0.6, 0.0, -0.6, -0.8]
CASES = {
    "between": lambda: circles_at_points((0.5, 0.3), NONE, 0.5, (4, 1)),
    "between in t": lambda: circles_at_points((0.05, 0.05), (0.3, 0.2), 0.9, (6, 3)),
    # At σ = 1 interpolation magnifies these values by nearly its Lebesgue constant.
    "points": lambda: by_values(0.02, [1, -1, 1, -1]),
    "points in t": lambda: by_values(0.005, [1, -1, 1, -1], [1, -1, 1, -1], tilt=(1e-4, 0.0)),
    "steep": lambda: by_values(0.1, STEEP),
    # This function is twice as steep at σ = 1 as at the points.
    "steep between points": lambda: by_values(0.035, [1, -1, 1, -1, 1, -1, 1, 0]),
    "steep in t": lambda: by_values(0.1, [1, 1], STEEP, tilt=(1e-4, 0.0)),
    "kicks": lambda: by_values(1e-9, [1] * 8, (1,), (0.5, 0.3)),
    "kicks in t": lambda: by_values(1e-9, [1] * 8, (1,) * 4, (1e-4, 1e-4), (0.3, 0.5)),
    "kicks in a plane": lambda: by_values(1e-9, [1] * 8, (1,) * 4, (0.03, 0.01), (0.01, 0.02)),
    "single": lambda: circles_at_points((0.8,), (0.0,), 1.0, (3, 1)),
    "complex": lambda: complex_modes((0.0, 0.0, 0.0), (3, 1)),
    "complex in t": lambda: complex_modes((0.05, 0.1, 0.1), (3, 2)),
}
ORIGIN = {"kicks in a plane": (0.4, -0.3)}  # origin of the plane that contains profile and tilt
UNIT = {"complex": -29, "complex in t": -31}
made_case = cache(lambda case: CASES[case]())


def proved_constants(case, module=module):
    """Return ρ and the constants of a proof."""
    profile, tilt, high, shape, moves = made_case(case)
    result = patch(profile, tilt, 0.0, high, shape, module, ORIGIN.get(case, ()))
    with ctx.workprec(128):
        result = result.verified(moves, UNIT.get(case, -80))
    return result["rho"], result["constants"]


def checked_constants(case, checker=checker, rho=0.01):
    """Return ρ and the constants that the checker computes."""
    profile, tilt, high, (Q, R), moves = made_case(case)
    moves = [moves[first : first + R] for first in range(0, Q * R, R)]
    moves = {"unit": UNIT.get(case, -80), "numbers": json.loads(json.dumps(moves, default=int))}
    rows = [[float(x).hex() for x in numbers] for numbers in (profile, tilt, (0, high))]
    data = dict(zip(("kappa", "tilt", "scales"), rows, strict=True))
    data |= {"rho": float(rho).hex(), "omega": str(GAMMA), "moves": moves}
    if case in ORIGIN:
        matrix = dict(zip(("origin", "first", "second"), [ORIGIN[case], *np.eye(2)], strict=True))
        data["plane"] = {name: [float(x).hex() for x in row] for name, row in matrix.items()}
        data["centre"] = data.pop("kappa")
    with ctx.workprec(checker.BITS):
        return rho, checker.theorem(data)[1]


NAMES = "n", "p", "k", "error", "kappa"


def modes_of(case):
    """Return all N modes of the coefficients of a case as floats, shape (Q·R, P, N)."""
    profile, _, _, (Q, R), moves = made_case(case)
    C = np.zeros((Q * R, len(profile), N), complex)
    for m, table in enumerate(moves):
        for j, row in enumerate(table):
            for factor, part in zip((1, 1j), row, strict=True):
                C[m, j, : min(len(part), 100)] += factor * np.array(part[:100], float)
    C[..., 1:] += C[..., :0:-1].conj()
    return C * 2.0 ** UNIT.get(case, -80)


@cache
def truth(case, rho):
    """Return the largest n, p, k, ‖E‖ and |κ| over many σ and t, computed in floats."""
    profile, tilt, high, (Q, R), _ = made_case(case)
    P, k = len(profile), np.fft.fftfreq(N, 1 / N)
    weight, alpha = np.exp(2 * np.pi * rho * np.abs(k)) * (np.abs(k) < 100), float(GAMMA) / P
    C = modes_of(case)

    def norm(f):  # norm of a function with values f on the grid
        return np.abs(np.fft.fft(f)) / N @ weight

    angles = np.linspace(0, np.pi, 61 if R == 1 else 25), np.linspace(0, np.pi, 1 if R == 1 else 25)
    largest, turn = dict.fromkeys(NAMES, 0.0), np.exp(2j * np.pi * k * alpha)
    for theta, beside in product(*angles):
        s, t = high * (1 + np.cos(theta)) / 2, np.cos(beside)
        T = np.outer(np.cos(np.arange(Q) * theta), np.cos(np.arange(R) * beside)).ravel()
        u = np.tensordot(T, C, 1)
        g = np.arange(N) / N + N * np.fft.ifft(u).real
        slope = 1 + N * np.fft.ifft(2j * np.pi * k * u).real
        E = np.roll(u, -1, 0) * turn + np.roll(u, 1, 0) / turn - 2 * u
        strength = s * (np.array(profile) + t * np.array(tilt))[:, None] / (2 * np.pi)
        strength += np.array(ORIGIN.get(case, np.zeros(P)))[:, None] / (2 * np.pi)
        E = N * np.fft.ifft(E).real - strength * np.sin(2 * np.pi * g)
        wave = np.exp(2 * np.pi * rho) * norm(np.exp(2j * np.pi * (g - np.arange(N) / N)))
        here = {"n": norm(slope), "p": norm(1 / slope), "k": wave, "error": norm(E)}
        here["kappa"] = 2 * np.pi * np.abs(strength)
        largest = {key: max(largest[key], here[key].max()) for key in here}
    return largest


def too_small(case, rho, bounds):
    largest = truth(case, rho)
    return [key for key in largest if bounds[key] < (1 - 1e-9) * largest[key] - 1e-13]


def too_large(case, rho, bounds):
    """List constants that are NaN or too large; interpolation errors have a wider tolerance."""
    largest, of_circles = truth(case, rho), case in ("between", "between in t", "single")
    most = dict.fromkeys(largest, 2.5) | {"error": 60 if of_circles else 8}
    return [key for key in largest if not bounds[key] < most[key] * largest[key]]


@pytest.mark.parametrize("case", thirds([*CASES]))
@pytest.mark.parametrize("program", [proved_constants, checked_constants])
def test_constants_are_bounds_for_all_forcings_in_a_patch(program, case):
    result = program(case)
    assert too_small(case, *result) == too_large(case, *result) == []


@pytest.mark.parametrize("case", ["between", "between in t", "single"])
def test_both_programs_allow_for_the_same_interpolation_error(case):
    """Both programs use one more point than there are degrees.

    The checker always does so; `patches` does so here, because zeros are added to its modes.
    """
    profile, tilt, high, (Q, R), moves = made_case(case)
    across, nothing = R + (R > 1), [[[[], []]] * len(profile)]
    rows = [moves[i : i + R] + nothing * (across - R) for i in range(0, Q * R, R)]
    with ctx.workprec(128):
        finer = patch(profile, tilt, 0.0, high, (Q + 1, across))
        result = finer.verified([*chain(*rows), *nothing * across], -80)
    _, checked = checked_constants(case, rho=result["rho"])
    assert 0.95 < checked["error"] / result["constants"]["error"] < 1.01


SUM = "Lambda * (across * error + beside) + along"
WRONG = {  # a changed line: the case in which it makes a constant too small
    (SUM, "across * error + beside + along"): "points",
    (SUM, "Lambda * (error + beside) + along"): "points in t",
    (SUM, "Lambda * (across * error + beside)"): "between",
    (SUM, "Lambda * (across * error) + along"): "between in t",
    ("chosen['kept'], moved)", "chosen['kept'])"): "steep",
    ("[a + b for a, b in product(*steps)]", "[a for a, b in product(*steps)]"): "steep in t",
    ("n.append(1 + sum(row[j] for row in slopes))", "n.append(1 + slopes[0][j])"): "steep",
    ("(rho + sum(row[j] for row in norms))", "(rho + norms[0][j])"): "steep",
    ("norm([i * x for i, x", "norm([x for i, x"): "between",
    ("[o + s * (a + t * b) for", "[o + 0 * s for"): "kicks",
    ("[o + s * (a + t * b) for", "[o + s * a for"): "kicks in t",
    ("[o + s * (a + t * b) for", "[s * (a + t * b) for"): "kicks in a plane",
    ("return abs(self.origin[j]) + s", "return s"): "kicks in a plane",
    (
        "steps = [[2 * (arb(m) / (4 * n))",
        "steps = [[2 * (arb(m) / (8 * n))",
    ): "steep between points",
    ("kappa = [self._largest(j, self.high)", "kappa = [self._largest(j, self.middle)"): "kicks",
    ("inequalities(grid.omega, kappa, rho", "inequalities(grid.omega, grid.kappa, rho"): "kicks",
}


@pytest.mark.alters_sources
@pytest.mark.parametrize("changes", thirds([*WRONG]))
def test_an_omission_in_a_constant_is_noticed(changes):
    case = WRONG[changes]
    right, wrong = (text.replace("'", '"') for text in changes)
    try:
        changed = mutant(module, (right, wrong))
    except LookupError:  # the line is in code shared with proofs for a single forcing
        changed = mutant(module)
        changed.verified = mutant(barrier, (right, wrong)).verified
    assert too_small(case, *proved_constants(case, changed))


TOTAL = "missed[0] + constants[0] * (missed[1] + constants[1] * errors[j])"
WRONG_CHECKS = {
    (TOTAL, "missed[0] + missed[1] + constants[1] * errors[j]"): "points",
    (TOTAL, "missed[0] + constants[0] * (missed[1] + errors[j])"): "points in t",
    ("defect + moved[j] * size", "defect"): "steep",
    ("(step[0][m] + step[1][i])", "step[0][m]"): "steep in t",
    ("n = [1 + sum(column) for column", "n = [1 + column[0] for column"): "steep",
    ("(two_pi * (rho + real_norm(f, r))).exp() for", "(two_pi * rho).exp() for"): "steep",
    (
        "errors = [old.max(new) for old, new in zip(errors, found, strict=True)] for j, f in",
        "errors = found\n        for j, f in",
    ): "kicks",
    ("p[j] = p[j].max(bound)", "p[j] = bound"): "between",
    ("[o + s * (a + t * b) for", "[o + 0 * s for"): "kicks",
    ("[o + s * (a + t * b) for", "[o + s * a for"): "kicks in t",
    ("[o + s * (a + t * b) for", "[s * (a + t * b) for"): "kicks in a plane",
    ("strongest = [abs(o) + high * x", "strongest = [abs(o) + middle * x"): "kicks",
    ("x in zip(origin, largest", "x in zip(origin, kappa"): "kicks in t",
    ("strongest = [abs(o) + high * x", "strongest = [high * x"): "kicks in a plane",
}


@pytest.mark.alters_sources
@pytest.mark.parametrize("changes", thirds([*WRONG_CHECKS]))
def test_an_omission_in_the_check_of_a_patch_is_noticed(changes):
    case = WRONG_CHECKS[changes]
    assert too_small(case, *checked_constants(case, mutant(checker, changes)))


@pytest.mark.parametrize(
    ("tilt", "low", "high", "shape"),
    [
        (NONE, 0.2, 0.2, (8, 1)),
        (NONE, -0.1, 0.2, (8, 1)),
        (NONE, 0, 1, (65, 1)),
        (NONE, 0, 1, (8, 65)),
        ((0.0, 0.1), 0, 1, (8, 1)),
    ],
)
def test_patches_with_invalid_scales_or_shapes_are_refused(tilt, low, high, shape):
    with pytest.raises(ValueError, match="out of range"):
        patch((1.0, 0.5), tilt, low, high, shape)


@pytest.mark.parametrize("row", [[[], [1]], [[1], []]])
def test_modes_that_are_not_real_or_not_odd_are_refused(row):
    with pytest.raises(ValueError, match="real function"):
        patch((1.0, 0.5), NONE, 0, 0.1, (2, 1)).verified([[row] * 2] * 2, -9)


def test_the_interpolation_constant_is_above_the_lebesgue_constant():
    # Σ ±ℓ_i(cos θ) is an even trigonometric polynomial of degree < n. By Bernstein's
    # inequality, its slope is less than n times its maximum. This bounds how far its maximum can
    # exceed its values on a grid.
    for n in range(2, module.MAX_NODES + 1):
        theta = np.linspace(0, np.pi / 2, 150 * n + 1)  # the rest follows by symmetry
        T = np.cos(np.arange(n)[:, None] * theta)
        weights = np.cos(np.outer(np.arccos(nodes(n)), np.arange(n))) * 2 / n
        weights[:, 0] /= 2
        on_the_grid = np.abs(weights @ T).sum(axis=0).max()
        largest = on_the_grid / (1 - n * theta[1] / 2)
        assert 0.9 < largest / (1 + 2 / np.pi * np.log(n)) < 1


def test_the_interpolation_error_is_bounded_on_the_best_ellipse():
    (Q, R), rho, r = (6, 4), 0.01, np.geomspace(1.2, 40, 5000)[:, None]
    m, k = np.array([*product(range(Q), range(R))]).T
    norms = 0.05 * 0.7 ** (m + k)
    result = patch((0.3, 0.5), (0.1, 0.2), 0.2, 1.0, (Q, R))
    with ctx.workprec(128):
        bound = float(result._between(arb(0), arb(rho), [arb(x) for x in norms], 1))

    def missed(strength, degrees, n):
        sizes = rho + ((r**degrees + r**-degrees) / 2 * norms).sum(axis=1)[:, None]
        B = strength / (2 * np.pi) * np.exp(2 * np.pi * np.minimum(sizes, 100))
        return (4 * B * r ** (-n) / (1 - 1 / r)).min()

    axes = (r + 1 / r) / 2
    along, beside = missed((0.6 + 0.4 * axes) * 0.7, m, Q), missed(0.5 + 0.2 * axes, k, R)
    exact = (1 + 2 / np.pi * np.log(Q)) * beside + along
    assert (1 - 1e-9) * exact <= bound < 1.05 * exact


def test_the_interpolation_constants_of_the_checker_are_lebesgue_constants():
    for n in range(2, checker.MAX_DEGREES + 4):
        theta = np.linspace(0, np.pi / 2, 20 * n + 1)
        weights = np.cos(np.outer(np.arccos(nodes(n)), np.arange(n))) * 2 / n
        weights[:, 0] /= 2
        on_a_grid = np.abs(weights @ np.cos(np.arange(n)[:, None] * theta)).sum(axis=0).max()
        with ctx.workprec(checker.BITS):
            assert 0.999 < on_a_grid / float(checker.lebesgue(n)) < 1 + 1e-12


def test_coefficients_as_small_as_rounding_errors_are_omitted():
    """Coefficients decay with the sum of the degrees; the rounding errors added to them do not."""
    rng, (Q, R) = np.random.default_rng(2), (12, 16)
    largest = [4.0 ** (20 - m - n) for m, n in product(range(Q), range(R))]
    moves = [[[[], [0, round(size) + rng.integers(-50, 50)]] for _ in range(2)] for size in largest]
    kept = [table != [[[], []]] * 2 for table in module._above_rounding(moves, Q, R)]
    assert min(size for size, stays in zip(largest, kept, strict=True) if stays) > 50
    assert max(size for size, stays in zip(largest, kept, strict=True) if not stays) < 500


def test_circles_at_all_points_have_the_same_phase():
    # If phases were rounded differently, coefficients of high degree would not decay, but the
    # bounds require that they do.
    kappa, shape = np.array([0.3, 0.1, 0.2]), (3, 1)
    starts = [
        barrier.circles.invariant_circle(GAMMA, (1 + s) / 2 * kappa).u for s in nodes(shape[0])
    ]
    with ctx.workprec(128):
        modes = patch(kappa, (0.0,) * 3, 0.0, 1.0, shape).circles(starts)
    assert not modes[:, :, 0, :, 0].any()


def test_no_patch_is_proved_if_a_strength_is_not_known_to_106_bits(monkeypatch):
    def strength_nearly_cancels(*_):
        return residuals._pairs([arb(1e-9, 1e-39)], relative=True)

    monkeypatch.setattr(module, "residuals", strength_nearly_cancels)
    result = tried(GAMMA, *TRIANGLE, np.array([0.0, 0.5, 1.0]) * breakup(*TRIANGLE))
    assert not result.proved
    assert "too wide for a sum of two floats" in result.reason


def test_a_patch_whose_certificate_might_not_be_confirmed_is_not_proved(monkeypatch):
    scales = np.array([0.0, 0.5, 1.0]) * breakup(*TRIANGLE)
    result = tried(GAMMA, *TRIANGLE, scales)
    assert result.proved
    most = {"ratio": 1 / 32, "chi": 1 / 100, "room": 1 / 101, "moved": 1 / 100}
    part = max(result.constants[name] / right for name, right in most.items())
    for _BOUND_FRACTION, proved in ((0.999 * part, False), (1.001 * part, True)):
        monkeypatch.setattr(module, "_BOUND_FRACTION", _BOUND_FRACTION)
        assert tried(GAMMA, *TRIANGLE, scales).proved == proved


@pytest.mark.parametrize(
    ("profile", "tilt", "low", "high"),
    [((0.5, 0.25), NONE, 0.87, 0.94), (*TRIANGLE, 0, 0.5), (*TRIANGLE, 0.5, 0.75)],
)
def test_the_checker_needs_no_larger_margin_than_a_proof_leaves(profile, tilt, low, high):
    result = tried(GAMMA, profile, tilt, np.array([low, high, 1.0]) * breakup(profile, tilt))
    assert result.proved
    with ctx.workprec(checker.BITS):
        holds, found = checker.theorem(result.certificate())
    assert holds
    for name in ("ratio", "chi", "room", "moved"):
        assert module._BOUND_FRACTION * found[name] <= result.constants[name]
