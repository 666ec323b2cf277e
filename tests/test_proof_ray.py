"""Circles on all of a ray: constants that bound every forcing of it, and what they reach."""

import json
from itertools import pairwise

import numpy as np
import pytest
from audit import mutant

pytest.importorskip("flint")
from flint import arb, ctx

from nasm import barriers, proofs
from nasm.checks import sealed
from nasm.numbers import parse
from nasm.proofs import certificate_checker as checker
from nasm.proofs import ray as module
from nasm.proofs.certificate_checker import Refuted, check, claim
from nasm.symmetries import ray

GAMMA, N = parse("gamma"), 256
SIGMA = np.cos(np.linspace(0, np.pi, 61))


@pytest.mark.parametrize(
    ("profile", "seconds", "least"),
    [
        ((1.0,), 0.3, 0.7),
        (ray(20), 0.3, 0.7),
        ((0.7, -0.7), 0.3, 0.7),
        ((1.0, 0.5, 0.7), 0.3, 0.45),
        *(pytest.param(ray(angle), 30.0, 0.99, marks=pytest.mark.slow) for angle in (0, 110)),
    ],
)
def test_a_barrier_is_proved_on_all_of_a_ray(profile, seconds, least):
    found = barriers.critical_scale(profile)
    module.proved_below(found.omega, profile, found.value, 0.01)  # compiled
    below, rays = proofs.proved_below(found.omega, profile, found.value, seconds)
    assert least < below / found.value < 1
    assert rays[0].low == 0
    assert all(one.high == other.low for one, other in pairwise(rays))
    assert below == rays[-1].high == proofs.covered([(p.low, p.high) for p in rays])
    for proof in rays[:2]:
        assert f" from {proof.low} to {proof.high} times (" in check(roundtrip(proof))


def roundtrip(proof):
    return json.loads(json.dumps(proof.certificate()))


def test_intervals_are_joined_without_a_gap():
    assert proofs.covered([(0.2, 0.3), (0.0, 0.2)]) == 0.3
    assert proofs.covered([(0.0, 0.2), (np.nextafter(0.2, 1), 0.3)]) == 0.2
    assert proofs.covered([(1e-300, 0.2)]) == proofs.covered([]) == 0


@pytest.mark.parametrize("beyond", [1e-3, 0.1])
@pytest.mark.parametrize("profile", [(1.0,), (0.94, 0.34), (1.0, 0.5, 0.7)])
def test_across_the_breakup_nothing_is_proved(profile, beyond):
    found = barriers.critical_scale(profile)
    about = {"omega": found.omega, "kappa": profile}
    about |= {"short_omega": found.omega, "short_kappa": profile}
    for low, told in ((0.9, 1.2), (0.97, 1.02 + beyond)):  # with the breakup told too far out
        high = (1 + beyond) * found.value
        proof = module._proved_between(low * found.value, high, told * high, about)
        assert not proof.proved
        with pytest.raises(ValueError, match="needs proved=True"):
            proof.certificate()
    below, _ = proofs.proved_below(found.omega, profile, 1.2 * found.value, 0.3)
    assert below < found.value


# --- each constant bounds what it should, for all σ -----------------------------------------------


def interval(profile, low, high, Q, n=N, module=module):
    with ctx.workprec(128):
        return module._Interval(GAMMA, list(profile), low, high, n, Q)


def circles_at_points(profile, high, Q):
    """Circles at Q points: their residuals are small there, and not between."""
    found = interval(profile, 0.0, high, Q)
    scales = high / 2 * (1 + np.cos(np.pi * (2 * np.arange(Q) + 1) / (2 * Q)))
    starts = [proofs.barrier.circles.invariant_circle(GAMMA, s * profile).u for s in scales]
    with ctx.workprec(128):
        return profile, high, found.moves(found.circles(starts), -80)


def by_values(strength, values, profile=(1e-4, 1e-4)):
    """Functions strength·sin 2πφ times a polynomial in σ with these values at its points."""
    Q = len(values)
    found = interval(profile, 0.0, 1.0, Q)
    with ctx.workprec(128):
        rows = [[[arb(0), arb(strength * x / 2)]] * len(profile) for x in values]
        return np.array(profile), 1.0, found.moves(rows, -80)


def complex_modes():
    """Three sites, whose functions are not odd."""
    rng = np.random.default_rng(5)
    rows = [[[0, *rng.integers(-(2**20), 2**20, 3).tolist()] for _ in "ri"] for _ in range(9)]
    return np.array([0.3, -0.2, 0.1]), 1.0, [rows[i : i + 3] for i in (0, 3, 6)]


CASES = {
    "between": lambda: circles_at_points(np.array([0.5, 0.3]), 0.5, 4),
    # At σ = 1 interpolation makes of them its constant, nearly.
    "points": lambda: by_values(0.02, [1, -1, 1, -1]),
    "steep": lambda: by_values(0.1, [0.8, 0.6, 0.0, -0.6, -0.8]),
    "kicks": lambda: by_values(1e-9, [1] * 8, (0.5, 0.3)),
    "single": lambda: circles_at_points(np.array([0.8]), 1.0, 3),
    "complex": complex_modes,
}
UNIT = {"complex": -29}


def constants(case, module=module):
    profile, high, moves = CASES[case]()
    found = interval(profile, 0.0, high, len(moves), module=module)
    with ctx.workprec(128):
        return found.verified(moves, UNIT.get(case, -80))


def truth(case, rho):
    """The largest n, p, k, ‖E‖ that SIGMA meets, in floats, of each."""
    profile, high, moves = CASES[case]()
    P, k = len(profile), np.fft.fftfreq(N, 1 / N)
    weight, alpha = np.exp(2 * np.pi * rho * np.abs(k)) * (np.abs(k) < 100), float(GAMMA) / P
    C = np.zeros((len(moves), P, N), complex)
    for m, table in enumerate(moves):
        for j, row in enumerate(table):
            for factor, part in zip((1, 1j), row, strict=True):
                C[m, j, : min(len(part), 100)] += factor * np.array(part[:100], float)
    C[..., 1:] += C[..., :0:-1].conj()
    C *= 2.0 ** UNIT.get(case, -80)

    def norm(f):  # of values on the grid
        return np.abs(np.fft.fft(f)) / N @ weight

    largest = dict.fromkeys(["n", "p", "k", "error"], 0.0)
    for sigma in SIGMA:
        u = np.tensordot(np.cos(np.arange(len(moves)) * np.arccos(sigma)), C, 1)
        turn = np.exp(2j * np.pi * k * alpha)
        g = np.arange(N) / N + N * np.fft.ifft(u).real
        slope = 1 + N * np.fft.ifft(2j * np.pi * k * u).real
        E = np.roll(u, -1, 0) * turn + np.roll(u, 1, 0) / turn - 2 * u
        strength = high * (1 + sigma) / 2 * profile[:, None] / (2 * np.pi)
        E = N * np.fft.ifft(E).real - strength * np.sin(2 * np.pi * g)
        wave = np.exp(2 * np.pi * rho) * norm(np.exp(2j * np.pi * (g - np.arange(N) / N)))
        here = {"n": norm(slope), "p": norm(1 / slope), "k": wave, "error": norm(E)}
        largest = {key: max(largest[key], here[key].max()) for key in here}
    return largest


def too_small(bounds, largest):
    return [key for key in largest if bounds[key] < (1 - 1e-9) * largest[key] - 1e-13]


def too_large(bounds, largest):
    """NaN too."""
    most = {key: 60 if key == "error" else 2.5 for key in largest}
    return [key for key in largest if not bounds[key] < most[key] * largest[key]]


@pytest.mark.parametrize("case", CASES)
def test_constants_bound_those_of_all_forcings_of_a_ray(case):
    found = constants(case)
    bounds, largest = found["constants"], truth(case, found["rho"])
    assert too_small(bounds, largest) == too_large(bounds, largest) == []


WRONG = {  # a changed line: the case in which a constant is then too small
    ("Lambda * max_of", "max_of"): "points",
    ("[at[j] for at in errors]) + least", "[at[j] for at in errors])"): "between",
    ("chosen['kept'], moved)", "chosen['kept'])"): "steep",
    ("n.append(1 + sum(row[j] for row in slopes))", "n.append(1 + slopes[0][j])"): "steep",
    ("(rho + sum(row[j] for row in norms))", "(rho + norms[0][j])"): "steep",
    ("norm([i * x for i, x", "norm([x for i, x"): "between",
    ("[(self.middle + self.half * row[1]) * k", "[0 * k"): "kicks",
}


@pytest.mark.parametrize("changes", WRONG)
def test_a_constant_that_leaves_something_out_is_noticed(changes):
    case = WRONG[changes]
    right, wrong = (text.replace("'", '"') for text in changes)
    found = constants(case, mutant(module, (right, wrong)))
    assert too_small(found["constants"], truth(case, found["rho"]))


def checked_constants(case, checker=checker):
    profile, high, moves = CASES[case]()
    moves = {"unit": UNIT.get(case, -80), "numbers": json.loads(json.dumps(moves, default=int))}
    kappa, scales = ([float(x).hex() for x in numbers] for numbers in (profile, (0, high)))
    data = {"rho": (0.01).hex(), "omega": str(GAMMA), "kappa": kappa, "scales": scales}
    with ctx.workprec(checker.BITS):
        return checker.theorem_of_ray(data | {"moves": moves})[1]


@pytest.mark.parametrize("case", CASES)
def test_the_checkers_constants_bound_those_of_all_forcings_of_a_ray(case):
    bounds, largest = checked_constants(case), truth(case, 0.01)
    assert too_small(bounds, largest) == too_large(bounds, largest) == []


WRONG_CHECKS = {  # what lies between the points is too little to be noticed at Q + 4 of them
    ("errors[j] = lebesgue * errors[j] + between", "errors[j] += between"): "points",
    ("defect + moved * d.norm()", "defect"): "steep",
    ("n = [1 + sum(column) for column", "n = [1 + column[0] for column"): "steep",
    ("(two_pi * (rho + 2 * f(r))).exp()", "(two_pi * rho).exp()"): "steep",
    (
        "errors = [old.max(new) for old, new in zip(errors, found, strict=True)] # Between",
        "errors = found # Between",
    ): "kicks",
    ("p[j] = p[j].max(neumann(", "p[j] = (neumann("): "between",
    ("kappa = [(middle + half * angle.cos_pi())", "kappa = [(0 * middle)"): "kicks",
}


@pytest.mark.parametrize("changes", WRONG_CHECKS)
def test_a_check_of_a_ray_that_leaves_something_out_is_noticed(changes):
    case = WRONG_CHECKS[changes]
    assert too_small(checked_constants(case, mutant(checker, changes)), truth(case, 0.01))


@pytest.mark.parametrize(("low", "high", "Q"), [(0.2, 0.2, 8), (-0.1, 0.2, 8), (0, 1, 65)])
def test_what_is_no_interval_is_refused(low, high, Q):
    with pytest.raises(ValueError, match="out of range"):
        interval((1.0, 0.5), low, high, Q)


@pytest.mark.parametrize("row", [[[], [1]], [[1], []]])
def test_modes_that_are_not_real_or_not_odd_are_refused(row):
    with pytest.raises(ValueError, match="real function"):
        interval((1.0, 0.5), 0, 0.1, 2).verified([[row] * 2] * 2, -9)


# --- certificates ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made():
    (proof,) = proofs.proved_below(GAMMA, (0.7, 0.2, 0.4), 0.4, 1e-3)[1]
    return roundtrip(proof)


def changed(certificate):
    """Certificates that do not prove what they say, though they are sealed."""
    texts = [json.dumps(certificate)] * 5
    further, other, mode, kick, gap = map(json.loads, texts)
    further["scales"][1] = (2 * float.fromhex(further["scales"][1])).hex()
    other["omega"] = other["shortened_from"]["omega"] = "[0;3,(1)]"
    mode["moves"]["numbers"][1][0][1][1] += 1 << 30
    kick["kappa"][0] = kick["shortened_from"]["kappa"][0] = (0.71).hex()
    gap["scales"].reverse()
    return {"inequality": [further, other, mode, kick], "no part": [gap]}


def test_a_changed_certificate_of_a_ray_is_refused(made):
    for reason, certificates in changed(made).items():
        for certificate in certificates:
            certificate["claim"] = claim(certificate)
            kept = {key: value for key, value in certificate.items() if key != "sha256"}
            with pytest.raises(Refuted, match=reason):
                check(sealed(kept))
