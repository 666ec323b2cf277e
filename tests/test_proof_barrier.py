"""Proofs that circles exist, tested by identities, a second program, mutants, and false claims."""

import json
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from audit import mutant
from cases import thirds
from flint import arb, ctx

from nasm import circles, proofs
from nasm.circles import continuation, fourier, hull
from nasm.numbers import RotationNumber, parse
from nasm.proofs import barrier
from nasm.proofs import certificate_checker as checker
from nasm.proofs.barrier import prove, proved_lower
from nasm.symmetries import ray

GAMMA = parse("gamma")
# Breakups on rays, computed by `barriers.critical_scale`. `prove` must accept circles below their
# breakup, and nothing above it.
LAST = [
    ((1.0, 0.0), "[0;2,(1)]", 0.4858177030222401),
    (tuple(ray(20.0)), "[0;(1)]", 0.5770384095194057),
    (tuple(ray(30.0)), "[0;1,2,(1)]", 0.7001827090368697),
    (tuple(ray(120.0)), "[0;3,(1)]", 0.7001827090368696),
    ((1.0,), "[0;(1)]", 0.971635406),
]
# (ω, kappa, n): few points, many points, and an odd number of sites.
CASES = [("gamma", (0.3, 0.2), 64), ("[0;(3)]", (-0.5,), 128), ("gamma", (0.15, 0.1, -0.05), 72)]


def near(profile, omega, breakup, distance):
    """Return ω, kappa and deviations of a circle at this relative distance below its breakup."""
    omega, profile = parse(omega), np.array(profile)
    scale, u = hull.certified_circle(omega, profile, breakup, distance)
    return omega, scale * profile, u


@pytest.mark.parametrize("omega", ["gamma", "[0;(2)]", "[0;(8)]", "[0;(30)]", "[0;3,50,(1,2,7)]"])
@pytest.mark.parametrize("delta", [1e-1, 3e-3, 1e-4])
def test_the_bound_on_small_divisors_holds_and_is_sharp(omega, delta):
    bound = float(proofs.barrier._russmann(parse(omega), arb(delta)))
    k = np.arange(1, 10**5)
    at = np.minimum(delta, 1 / (2 * np.pi * k))
    divisors = np.abs(fourier.turns(parse(omega), 10**5)[1:] - 1)
    brute = (at * np.exp(-2 * np.pi * k * at) / divisors).max()
    assert brute <= bound * (1 + 1e-9)
    assert bound <= brute * 1.001


def assert_closed_sums_bound_all_aliases_and_all_omitted_modes(module):
    rho, hat, n, cut = 0.01, 0.05, 64, 29
    grid = module.Grid(GAMMA, [0.7], n)
    u = [[arb(0), arb(0.01), arb(0.002)]]
    (bound,) = module.bounds_of_the_residual(grid, u, [[arb(0)] * 32], arb(rho), arb(hat), cut)
    imaginary = 2 * sum(float(a) * np.sinh(2 * np.pi * k * hat) for k, a in enumerate(u[0]))
    k, most = np.arange(-3000, 3001), np.cosh(2 * np.pi * (hat + imaginary))
    sizes = most * np.exp(-2 * np.pi * hat * np.abs(k))
    beyond = (sizes * np.exp(2 * np.pi * rho * np.abs(k)))[np.abs(k) >= cut].sum()
    aliases = sum(
        np.exp(2 * np.pi * rho * abs(i)) * sizes[((k - i) % n == 0) & (k != i)].sum()
        for i in range(-cut + 1, cut)
    )
    exact = 0.7 / (2 * np.pi) * (beyond + aliases)
    assert exact <= float(bound) <= 1.05 * exact


def assert_even_a_poor_approximate_inverse_yields_a_bound(module):
    # 1/(1 + a cos) = (1 + 2 Σ (-b)^k cos)/√(1 - a²) with b = (1 - √(1 - a²))/a.
    rho, cases = 0.02, [(0.5, 5, 2, 1.03), (0.5, 3, 2, 1.5), (0.2, 1, 1, 1.2), (0.5, 40, 2, 1.0001)]
    for odd, (a, modes, kept, slack) in product((True, False), cases):
        root = np.sqrt(1 - a**2)
        b = (1 - root) / a
        inverse = np.array([(-b) ** k / root for k in range(modes)])
        exact = (1 + 2 * sum((b * np.exp(2 * np.pi * rho)) ** k for k in range(1, 200))) / root
        slope = [arb(1), arb(a / 2)]
        bound = float(module.bound_of_the_inverse(slope, inverse, arb(rho), odd, kept))
        assert exact * (1 - 1e-12) <= bound <= slack * exact


def certificate(module, omega, kappa, n=None):
    proof = module.prove(parse(omega), kappa, n=n)
    assert proof.proved, proof.reason
    return json.loads(json.dumps(proof.certificate())), proof.constants


# For each inequality: values of κ, ρ, n_0 and p_0 at which it is the first to fail as ε grows.
FIRST_TO_FAIL = {
    "ratio": (0.4, 1e-5, 1.7, 1.1),
    "chi": (0.0, 0.01, 1.0, 0.01),
    "room": (0.4, 0.01, 1.7, 1.1),
    "moved": (0.0, 9.0, 1.0, 0.1),
}


def theorem(data):
    """Return whether the second program's inequalities hold, and its constants."""
    with ctx.workprec(checker.BITS):
        return checker.theorem(data)


def audit(module):
    """Check everything that could reveal a wrong proof; raise an exception if a check fails."""
    for name, (kappa, rho, n, p) in FIRST_TO_FAIL.items():
        numbers = [[arb(n), arb(1.3)], [arb(p), arb(1.9)], [arb(1.5), arb(1.4)]]
        grid, seen = module.Grid(GAMMA, [kappa, -0.7 * kappa], 64), []
        for eps in np.geomspace(1e-22, 10, 150):
            failed, left = module.inequalities(GAMMA, grid.kappa, arb(rho), arb(eps), *numbers)
            delta, C = left["delta"], left["C"]
            holds, exact = checker.inequalities(grid.kappa, delta, C, arb(eps), *numbers)
            assert holds == (not failed)
            assert all(value.overlaps(left[key]) for key, value in exact.items())
            seen += failed[:1]
        assert seen[0] == name
    assert_closed_sums_bound_all_aliases_and_all_omitted_modes(module)
    assert_even_a_poor_approximate_inverse_yields_a_bound(module)
    for omega, kappa, n in CASES:
        data, constants = certificate(module, omega, kappa, n)
        holds, exact = theorem(data)
        assert holds
        for name, value in exact.items():
            slack = 1.5 if name in ("error", "epsilon", "ratio", "chi", "room", "moved") else 1e-5
            assert value * (1 - 1e-5) <= constants[name] <= value * (1 + slack), name


def test_a_second_program_finds_the_same_constants():
    audit(proofs.barrier)


CHANGES = [
    ("sine * (aliases + rest)", "sine * rest"),
    ("sine * (aliases + rest)", "sine * aliases"),
    ("polynomial(r_hat) - polynomial(1 / r_hat)", "polynomial(r_hat) / 2"),
    ("aliases = 1 / (1 - q) + ", "aliases = "),
    ("(beyond + moved) * size", "moved * size"),
    ("return size / (1 - small)", "return size"),
    ("strength = -grid.kappa[j] / (2 * arb.pi())", "strength = -grid.kappa[j] / arb(6.2831853)"),
    ("strength = -grid.kappa[j]", "strength = grid.kappa[j]"),
    ("(angle + 2 * x).sin_pi()", "(angle + 2 * x).cos_pi()"),
    ("row[k] += neighbours - 2 * own", "row[k] += neighbours - arb(2.0000001) * own"),
    ("else a * turn + b * turn.conjugate()", "else a * turn + b * turn"),
    ("row[k] += neighbours", "row[k] += arb(1.0000001) * neighbours"),
    ("+ arb(0, 1) * radius", "+ arb(1e-9)"),
    ("phases = [2 * alpha * k", "phases = [alpha * k"),
    ("[[-v.imag for v in y]", "[[-1.000001 * v.imag for v in y]"),
    ("(-v for v in x[:0:-1])", "(v for v in x[:0:-1])"),
    ("x / self.n for x in row", "x / (1.000001 * self.n) for x in row"),
    ("acb(x).conjugate() for x in row", "acb(x) for x in row"),
    ("return 2 * arb_poly(a)", "return arb_poly(a)"),
    ("rho).exp()) - a[0]", "rho).exp()) - 2 * a[0]"),
    ("factor * k * x for k", "factor * x for k"),
    ("factor = 2 * arb.pi() if odd", "factor = 2 * arb(3) if odd"),
    ("k.append((two_pi * (rho + sum(row[j] for row in norms)))", "k.append((two_pi * (rho))"),
    ("norm([i * x for i, x in enumerate(row)], rho)", "norm([x for x in row], rho)"),
    ("error = reduce(arb.max, [at[j] for at in errors])", "error = errors[0][0] * 0.98"),
    ("a * b for a, b in zip(n, everywhere", "b for a, b in zip(n, everywhere"),
    ("2 * abs((ball * f.denominator)", "abs((ball * f.denominator)"),
    ("abs((ball * f.denominator).sin_pi())", "abs((ball * f.denominator).sin())"),
    ("C = _russmann(omega, delta) + delta", "C = _russmann(omega, delta)"),
    ("w = 2 * C**2 * sum(q)", "w = C**2 * sum(q)"),
    ("sum(q) * (1 + eta) ** 2", "sum(q) * (1 + eta)"),
    ("zip(p, p[1:] + p[:1]", "zip(p, p"),
    ("delta = given * rho / (4 + 2 * tau)", "delta = rho / (4 + 2 * tau)"),
    ("ratio = w * eps / (2 * e * delta**3)", "ratio = w * eps / (4 * e * delta**3)"),
    ("two_pi * (1 + eta) * taylor / eps", "two_pi * taylor / eps"),
    ("b * (arb(0.5) + y / 6) * y.exp()", "b * arb(0.5) * y.exp()"),
    ("b * (arb(0.5) + y / 6) * y.exp()", "b * (arb(0.5) + y / 6)"),
    ("chi = arb(4) / 3 * (1 + eta)", "chi = (1 + eta)"),
    ("(2 * chi + chi**2)", "(2 * chi)"),
    ("(4 * y / 3).expm1()", "y.expm1()"),
    ('"ratio": arb(1) / 32', '"ratio": arb(1)'),
    ('"moved": eta}', '"moved": 2 * eta}'),
    ('"room": eta / (1 + eta)', '"room": 1.6 * eta / (1 + eta)'),
    ('"chi": eta, ', '"chi": 1.6 * eta, '),
    ("aliases *= 2 * (-two_pi", "aliases *= (-two_pi"),
    ("rest = 2 * (two_pi * cut", "rest = (two_pi * cut"),
]


@pytest.mark.alters_sources
@pytest.mark.parametrize("change", thirds(CHANGES))
def test_a_changed_line_is_noticed(change):
    changed = mutant(proofs.barrier, change)
    with pytest.raises((AssertionError, ValueError)):
        audit(changed)


def test_the_bound_on_small_divisors_holds_in_the_narrowest_strips():
    for delta in (1e-9, 1e-12, 1e-15):
        least = 5**0.5 / (4 * np.pi**2 * np.e)
        assert least <= float(proofs.barrier._russmann(GAMMA, arb(delta))) <= 1.1 * least
        with ctx.workprec(checker.BITS):
            _, divisors, period = checker.rotation("[0;(1)]")
            assert least <= float(checker.russmann(divisors, period, arb(delta)))


@pytest.mark.parametrize("case", thirds([*product(LAST, (0.05, 0.3))]))
def test_circles_below_the_breakup_are_proved(case):
    last, distance = case
    omega, kappa, u = near(*last, distance)
    proof = prove(omega, kappa, start=u)
    assert proof.proved, proof.reason
    assert proof.kappa == tuple(kappa)


@pytest.mark.parametrize(
    ("omega", "kappa"),
    [
        ("[0;(8)]", (0.3,)),
        ("[0;(30)]", (0.05,)),
        ("[0;1,2,3,1000,(1,2,7)]", (0.2,)),
        ("gamma", (0.1, 0.1, 0.1, 0.1, 0.12)),
        ("[0;(2)]", (0.05, 0.1, -0.2, 0.1)),
        ("gamma", (0.0, 0.0)),
        ("gamma", (1e-300, 0.0)),
    ],
)
def test_circles_are_proved_for_any_quadratic_omega_and_any_period(omega, kappa):
    assert prove(parse(omega), kappa).proved


@pytest.mark.parametrize("case", thirds([*product((0.3, 0.05), (64, 128, 512, 2048))]))
def test_more_points_than_needed_do_not_prevent_a_proof(case):
    kappa, n = case
    assert prove(GAMMA, (kappa,), n=n).proved


def settled(omega, kappa, u):
    """Return the Newton iterate with the smallest residual, the best start beyond the breakup."""
    best, least = u, np.inf
    for _ in range(25):
        after, error = circles.newton_step(omega, kappa, u)
        if error < least:
            best, least = u, error
        if not error < 10:
            break
        u = after
    return best


def proofs_above(profile, omega, breakup, n, beyond):
    """Return, for each of two starts, whether `prove` accepts a circle that does not exist.

    The starts are the best Newton iterate, and a certified circle 2% below the breakup.
    """
    omega, profile = parse(omega), np.array(profile)
    path = [hull.certified_circle(omega, profile, breakup, d) for d in (0.04, 0.02)]
    kappa = breakup * (1 + beyond) * profile
    ahead = circles.newton.extrapolate(path, breakup * (1 + beyond))
    u = settled(omega, kappa, fourier.resample(ahead, n))
    return [prove(omega, kappa, start=start, n=n).proved for start in (u, path[-1][1])]


@pytest.mark.parametrize("case", thirds([*product(LAST[::2], (1e-6, 1e-4, 1e-2, 0.1))]))
def test_above_the_breakup_nothing_is_proved(case):
    last, beyond = case
    assert not any(proofs_above(*last, 512, beyond))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_above_the_breakup_nothing_is_proved_under_random_kicks(seed):
    # One to five kicks of either sign. The breakup is known to 10⁻³ or better.
    rng = np.random.default_rng(seed)
    omega, profile = ["gamma", "[0;2,(1)]", "[0;(2)]"][seed % 3], rng.normal(0, 1, 1 + seed % 5)
    result = continuation.critical_scale(parse(omega), profile, 1e-4)
    assert result.error < 1e-3 * result.value
    for n in (128, 256, 512, 1024):
        for beyond in (2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1):
            assert not any(proofs_above(profile, omega, result.value, n, beyond))


def test_more_time_proves_a_circle_closer_to_the_breakup(monkeypatch):
    # The clock counts predicted work, so that no other process can make a proof run out of time.
    refined, now = barrier.refined, [0.0]

    def timed(grid, start):
        now[0] += barrier._SECONDS_PER_POINT * grid.n * grid.sites
        return refined(grid, start)

    monkeypatch.setattr(barrier, "refined", timed)
    monkeypatch.setattr(barrier, "time", SimpleNamespace(thread_time=lambda: now[0]))
    profile, omega, breakup = LAST[0]
    scales = [proved_lower(parse(omega), profile, breakup, seconds)[0] for seconds in (0.1, 0.5)]
    assert scales[0] < scales[1] < breakup


def test_a_lower_bound_is_proved_even_if_rounding_equates_strengths():
    profile, values = np.array([0.7, np.nextafter(0.7, 1)]), (0.9, 0.92)
    first = [(1 - 0.05) * value * profile for value in values]
    assert {len(set(kappa)) for kappa in first} == {1, 2}
    for value in values:
        scale, proof = proved_lower(GAMMA, profile, value, 0.05)
        assert proof.proved
        assert proof.kappa == tuple(scale * profile)


def test_no_lower_bound_is_proved_if_no_circle_exists():
    scale, proof = proved_lower(GAMMA, (1.0,), 3.0, 0.2)  # the circle breaks at 0.97
    assert np.isnan(scale)
    assert proof is None or not proof.proved


NO_CIRCLES = [np.full((1, 64), value) for value in (np.nan, np.inf, 1e300, 0.0)]
NO_CIRCLES += [np.random.default_rng(1).normal(0, s, (1, n)) for s, n in ((1, 64), (1e-2, 200))]


@pytest.mark.parametrize("start", NO_CIRCLES)
def test_a_start_that_is_not_a_circle_proves_nothing_and_raises_no_error(start):
    assert not prove(GAMMA, (1.1,), start=start, n=128).proved


@pytest.mark.parametrize(
    ("omega", "kappa", "options", "expected"),
    [
        (parse("3/5"), (0.2,), {}, "rational"),
        (GAMMA, (1.2,), {}, "no circle was found"),
        (GAMMA, (5.0, 1.0), {}, "no circle was found"),
        (RotationNumber((0, 1, 10**6), (1,)), (0.5,), {}, "no circle was found"),
        (GAMMA, (0.96,), {"budget": 0.01}, "beyond the budget"),  # no proof is attempted
        (GAMMA, (0.9,), {"n": 64}, "ratio"),
    ],
)
def test_a_proof_that_fails_gives_the_reason(omega, kappa, options, expected):
    proof = prove(omega, kappa, **options)
    assert not proof.proved
    assert expected in proof.reason
    with pytest.raises(ValueError, match=r"not proved: .*needs proved=True"):
        proof.certificate()


def test_a_bound_outside_its_strip_is_refused():
    # With ρ ≥ ρ̂ the sums of the tails would be negative.
    grid = proofs.barrier.Grid(GAMMA, [0.3], 64)
    zero = [[arb(0)] * 8]
    for rho, cut in ((0.05, 8), (0.06, 8), (0.01, 7), (0.01, 33)):
        with pytest.raises(ValueError, match="out of range"):
            proofs.barrier.bounds_of_the_residual(grid, zero, zero, arb(rho), arb(0.05), cut)


@pytest.mark.parametrize(("kappa", "n"), [
    pytest.param(0.9713, 7 * 2**16, marks=pytest.mark.slow),
    pytest.param(0.9716, 7 * 2**19, marks=pytest.mark.release),  # needs 4 GB of memory
])  # fmt: skip
def test_the_golden_circle_is_proved_as_close_to_its_breakup_as_published(kappa, n):
    """Figueras, Haro and Luque (2017) proved that this circle exists at κ = 0.9716.

    This value of κ is 99.996% of the value at which the circle breaks.
    """
    omega, near_kappa, u = near((1.0,), "gamma", 0.971635406, 1 - kappa / 0.971635406)
    assert near_kappa == pytest.approx(kappa, abs=1e-9)
    assert prove(omega, (kappa,), start=u, n=n).proved
