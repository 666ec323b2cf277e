"""Test the mode-by-mode bounds on v_j = g_j'w_j, the first step in proving that a circle exists."""

import json
from functools import cache
from itertools import product
from math import inf

import numpy as np
import pytest
from audit import mutant
from cases import thirds
from flint import arb, arb_poly, ctx
from test_proof_patches import GAMMA, UNIT, N, made_case, modes_of

from nasm.checks import with_sha256
from nasm.circles import hull
from nasm.numbers import parse
from nasm.proofs import barrier, patches
from nasm.proofs import certificate_checker as checker
from nasm.proofs.certificates import _STATEMENTS

RHO = 0.004


def near_breakup(omega, profile, value, n, distance=0.05):
    """Prove that a circle exists, on so few points that the first step must be computed."""
    omega, profile = parse(omega), np.array(profile)
    scale, u = hull.certified_circle(omega, profile, value, distance)
    return barrier.prove(omega, scale * profile, start=u, n=n)


def in_a_patch(omega, profile, tilt, low, high, value):
    about = {"omega": omega, "kappa": profile, "tilt": tilt}
    about |= {"short_omega": omega, "short_kappa": profile}
    return patches._proved_between(low, high, value, about)


PROOFS = {
    "one kick": lambda: near_breakup("gamma", (1.0,), 0.971635406, 768),
    "two kicks": lambda: near_breakup("[0;2,(1)]", (1.0, 0.0), 0.4858177030222401, 768),
    "a ray": lambda: in_a_patch(GAMMA, (1.0,), (0.0,), 0.0, 0.5, 0.97),
    "three kicks": lambda: in_a_patch(GAMMA, (1.0, 0.5, 0.7), (0.0, 0.0, 0.0), 0.0, 0.2, 0.396),
    "a triangle": lambda: in_a_patch(GAMMA, (0.5, 0.25), (0.0625, -0.125), 0.0, 0.4, 0.9),
}
made = cache(lambda name: PROOFS[name]())


@pytest.mark.parametrize("name", thirds([*PROOFS]))
def test_the_checker_confirms_a_computed_step_with_similar_constants(name):
    proof = made(name)
    assert proof.stepped, proof.reason
    certificate = json.loads(json.dumps(proof.certificate()))
    assert certificate["theorem"]["name"].endswith(("by an explicit step", "by explicit steps"))
    checker.check(certificate)
    with ctx.workprec(checker.BITS):
        holds, constants = checker.theorem(certificate)
    assert holds
    for key, slack in {"kappa": 1, "delta": 1, "C": 1, "n": 1.001, "k": 1.001, "p": 1.1}.items():
        assert 1 / slack - 1e-5 <= constants[key] / proof.constants[key] <= slack + 1e-5, key
    assert 1e-2 < constants["w"] / proof.constants["w"] < 1.5  # the checker's grid is twice as fine


def functions(rng, sites, modes, rest):
    """Return bounds on the modes of u_j, E_j and 1/g_j', and on the remainders of the last two."""
    k = np.arange(modes)
    u, E, near = (rng.uniform(0, 1, (sites, modes)) * size for size in (
        0.02 * np.exp(-0.3 * k) * (k > 0), 1e-9 * np.exp(-0.1 * k), 0.2 * np.exp(-0.4 * k)
    ))  # fmt: skip
    near[:, 0] += 1
    return u, E, near, rest * rng.uniform(0.5, 1, (2, sites))


def constants_of_both(module, seed, sites, rest, omega="gamma"):
    """Return the constants that the two programs compute from the same bounds."""
    rng = np.random.default_rng(seed)
    u, E, near, (rest_E, missing) = functions(rng, sites, 12, rest)
    kappa = [arb(float(x)) for x in rng.uniform(0.2, 0.9, sites)]
    rho, outer = arb(RHO), arb(2 * RHO)
    balls = [[[arb(float(x)) for x in row] for row in rows] for rows in (u, E, near)]
    rests = [[arb(float(x)) for x in row] for row in (1e-9 * rest_E, missing)]
    with ctx.workprec(checker.BITS):
        ball, divisors, period = checker.rotation(str(parse(omega)))
        pairs = [[*zip(*each, strict=True)] for each in zip(balls[1:], rests, strict=True)]
        polynomials = [arb_poly(row) for row in balls[0]]
        _, exact = checker.after_a_step(kappa, rho, ball, divisors, period, polynomials, *pairs)
    two_pi = 2 * arb.pi()
    slopes = [
        module.Majorant([arb(1), *(two_pi * i * x for i, x in enumerate(row) if i)], arb(0))
        for row in balls[0]
    ]
    E, inverses = ([module.Majorant(*pair) for pair in each] for each in pairs)
    w = module.bounds_of_the_step(parse(omega), slopes, E, inverses, outer, rho)
    k = [(two_pi * (rho + module.norm(row, rho))).exp() for row in balls[0]]
    _, left = module.inequalities_after_a_step(
        parse(omega),
        kappa,
        rho,
        [f.norm(rho) for f in slopes],
        [f.norm(rho) for f in inverses],
        k,
        w,
        [module.bound_of_the_slope(f, outer, rho) for f in E],
    )
    largest = max(float(x.upper()) for x in w)
    return {key: float(x.upper()) for key, x in left.items()} | {"w": largest}, exact


def true_step(omega, kappa, u, E):
    """Return the modes of w_j(θ) on N points, in floats, from those of u_j(φ) and E_j(φ)."""
    P, k = len(kappa), np.fft.fftfreq(N, 1 / N)
    turn = np.exp(2j * np.pi * k * float(omega) / P)
    shift = turn ** np.arange(P)[:, None]  # from φ to θ

    def at_theta(modes):
        return N * np.fft.ifft(modes * shift).real

    h, E = at_theta(2j * np.pi * k * u) + 1, at_theta(E)
    whole = np.exp(2j * np.pi * k * float(omega))

    def solved(f):
        f = np.fft.fft(f) / N
        return N * np.fft.ifft(np.where(k == 0, 0, f / np.where(k == 0, 1, whole - 1))).real

    after = np.vstack([h[1:], N * np.fft.ifft(np.fft.fft(h[:1]) / N * whole).real])
    over, sums = 1 / (h * after), -np.cumsum(h * E, axis=0)
    flux = solved(sums[-1]) + sums
    flux -= (flux * over).sum() / over.sum()
    steps = flux * over
    w = solved(steps.sum(axis=0)) + np.cumsum(steps, axis=0) - steps
    return np.fft.fft(w) / N


def norms(modes, rho):
    k = np.fft.fftfreq(N, 1 / N)
    return np.abs(modes) @ (np.exp(2 * np.pi * rho * np.abs(k)) * (np.abs(k) < 100))


def audit(module):
    """Raise an exception if a bound on the step differs from the checker's, or is too small."""
    for seed, sites, rest in ((0, 1, 0), (1, 2, 0), (2, 2, 0.1), (3, 3, 0.01), (4, 1, 1)):
        for omega in ("gamma", "[0;(3)]"):
            bounds, exact = constants_of_both(module, seed, sites, rest, omega)
            for key, value in exact.items():
                if key in bounds:
                    slack = 2e-6 if key in ("C", "delta") else 1e-4
                    assert bounds[key] == pytest.approx(value, rel=slack), key
            assert {"w", "ratio", "chi", "room", "moved", "kappa", "epsilon"} <= bounds.keys()
    sine = module.modes_of_the_sine(64, arb(0.01), arb(0.05), 29)
    k, all_k = np.arange(64), np.arange(-5000, 5001)
    sizes = np.exp(-2 * np.pi * 0.05 * np.abs(all_k))
    exact = [sizes[((all_k - i) % 64 == 0) & (all_k != i)].sum() for i in range(29)]
    exact += np.exp(-2 * np.pi * 0.05 * k[29:]).tolist()
    assert [float(x) for x in sine.sizes] == pytest.approx(exact, rel=1e-9)
    beyond = sizes * np.exp(2 * np.pi * 0.01 * np.abs(all_k))
    assert float(sine.rest) == pytest.approx(beyond[np.abs(all_k) >= 64].sum(), rel=1e-9)
    wide = module._largest_sizes([[arb(1), arb(2)], [arb(3), arb(1)]])
    assert [float(x) for x in wide] == [3, 2]


def test_both_programs_find_the_same_constants_after_a_step():
    audit(barrier)


CHANGES = [
    ("return norm(self.sizes, rho) + self.rest", "return norm(self.sizes, rho)"),
    ("[a + b for a, b in both], self.rest + other.rest", "[a + b for a, b in both], self.rest"),
    ("rest = norm(self.sizes, rho) * other.rest + ", "rest = "),
    ("other.rest + self.rest * other.norm(rho)", "other.rest"),
    ("self.rest * other.norm(rho)", "self.rest * norm(other.sizes, rho)"),
    ("self.rest * sigma", "self.rest"),
    ("x / divisor for x, divisor in pairs", "x for x, divisor in pairs"),
    ("delta = (outer - rho) / 2", "delta = outer - rho"),
    ("_russmann(omega, delta) / delta", "_russmann(omega, delta)"),
    ("a.times(b, outer) for a, b", "a for a, b"),
    ("inverses[1:] + inverses[:1]", "inverses"),
    ("[turned + f for f in sums]", "[turned for f in sums]"),
    ("f.norm(arb(0)) for f in fluxes", "f.rest for f in fluxes"),
    ("f + Majorant([mean], arb(0)) for f", "f for f"),
    ("f.times(g, middle) for f, g", "f for f, g"),
    ("accumulate([first, *steps[:-1]])", "[first for _ in steps]"),
    ("2 * abs((ball * k).sin_pi())", "2 * abs((ball * k).sin())"),
    ("for k in range(1, size + 1)", "for k in range(size)"),
    ("narrow = 2 * arb.pi(), rho * 98 / 100", "narrow = 2 * arb.pi(), rho * 97 / 100"),
    ("y = two_pi * a * size", "y = two_pi * size"),
    ("moved = a * size / (", "moved = size / ("),
    ('after["n"].append(a + moved)', 'after["n"].append(a)'),
    ("b / (1 - b * moved) if", "b if"),
    ('after["k"].append(c * y.exp())', 'after["k"].append(c)'),
    ("slope * size + abs(strength)", "abs(strength)"),
    ("abs(strength) / two_pi * taylor)", "strength * taylor / 10)"),
    ("taylor = c * (arb(0.5)", "taylor = c * (arb(0.25)"),
    ('zip(after["n"], after["error"]', 'zip(n, after["error"]'),
    ("narrow, eps, after", "rho, eps, after"),
    ("two_pi * i * x for i, x in enumerate(f.sizes)", "two_pi * x for i, x in enumerate(f.sizes)"),
    ("return slopes + f.rest", "return slopes + 0 * f.rest"),
    ("(r_hat**k + r_hat**-k) * around", "(r_hat**-k) * around"),
    ("around = r_hat**-n / (1", "around = r_hat ** (-2 * n) / (1"),
    ("2 * q**n / (1 - q)", "q**n / (1 - q)"),
    ("reduce(arb.max, sizes) for sizes", "reduce(arb.min, sizes) for sizes"),
]


@pytest.mark.alters_sources
@pytest.mark.parametrize("change", thirds(CHANGES))
def test_a_changed_line_in_the_bounds_on_the_step_is_noticed(change):
    changed = mutant(barrier, change)
    with pytest.raises((AssertionError, ValueError)):
        audit(changed)


# --- the input: bounds on the modes of g_j', E_j and 1/g_j' for all forcings of a patch ---


def pairs_of(case, module=barrier):
    """Return the strip's half width, majorants and bounds on w for a case in test_proof_patches."""
    profile, tilt, high, shape, moves = made_case(case)
    seen = []

    def record(omega, slopes, E, inverses, outer, rho):
        w = kept(omega, slopes, E, inverses, outer, rho)
        seen.extend([float(outer), (slopes, E, inverses), [float(x) for x in w]])
        return w

    kept, original = module.bounds_of_the_step, patches.verified
    module.bounds_of_the_step, patches.verified = record, module.verified
    try:
        with ctx.workprec(128):
            result = patches._Patch(GAMMA, list(profile), list(tilt), 0.0, high, N, *shape)
            result.verified(moves, UNIT.get(case, -80))
    finally:
        module.bounds_of_the_step, patches.verified = kept, original
    return seen


def lacking(case, module=barrier):
    """Return which of g', E, 1/g' and w exceed their bounds under at least one of many forcings."""
    outer, pairs, w = pairs_of(case, module)
    profile, tilt, high, (Q, R), _ = made_case(case)
    P, k = len(profile), np.fft.fftfreq(N, 1 / N)
    C = modes_of(case)
    turn = np.exp(2j * np.pi * k * float(GAMMA) / P)
    found = set()
    angles = np.linspace(0, np.pi, 41 if R == 1 else 17), np.linspace(0, np.pi, 1 if R == 1 else 17)
    for theta, beside in product(*angles):
        s, t = high * (1 + np.cos(theta)) / 2, np.cos(beside)
        T = np.outer(np.cos(np.arange(Q) * theta), np.cos(np.arange(R) * beside)).ravel()
        u = np.tensordot(T, C, 1)
        g, slope = np.arange(N) / N + N * np.fft.ifft(u).real, 2j * np.pi * k * u
        slope[:, 0] = 1
        kappa = s * (np.array(profile) + t * np.array(tilt))[:, None]
        E = np.roll(u, -1, 0) * turn + np.roll(u, 1, 0) / turn - 2 * u
        E = E - np.fft.fft(kappa / (2 * np.pi) * np.sin(2 * np.pi * g)) / N
        inverse = np.fft.fft(1 / (N * np.fft.ifft(slope).real)) / N
        for name, modes, bounds in zip(
            ("g'", "E", "1/g'"), (slope, E, inverse), pairs, strict=True
        ):
            for row, bound in zip(np.abs(modes), bounds, strict=True):
                sizes = np.array([float(x.upper()) for x in bound.sizes])
                sizes = np.append(sizes, np.zeros(N))[np.abs(k).astype(int)]
                over = np.maximum(row - (1 + 1e-9) * sizes - 1e-16, 0) * (np.abs(k) < 60)
                over = over @ np.exp(2 * np.pi * outer * np.abs(k))
                if over > (1 + 1e-9) * float(bound.rest.upper()) + 1e-13:
                    found.add(name)
        if (norms(true_step(GAMMA, kappa, u, E), outer / 2) > w).any():
            found.add("w")
    return found


STEPPED = ["points", "points in t", "steep", "steep between points", "steep in t", "kicks"]
STEPPED += ["kicks in t", "between", "complex", "complex in t"]


@pytest.mark.parametrize("case", thirds(STEPPED))
def test_bounds_on_modes_hold_under_all_forcings_in_a_patch(case):
    assert not lacking(case)


WRONG = {  # a changed line: the case in which a bound becomes too small
    ("[largest * x for x in points.sizes]", "[x for x in points.sizes]"): "points",
    ("outer, grid.odd, chosen['kept'], moved=moved", "outer, grid.odd, chosen['kept']"): "steep",
    (
        "inverse = Majorant(_largest_sizes(near), reduce",
        "inverse = Majorant(near[0], 0 * reduce",
    ): "steep",
    ("inverse = Majorant(_largest_sizes(near), reduce(arb.max, missed))",
     "inverse = Majorant(_largest_sizes(near), arb(0))"): "steep between points",
    ("total = sum((arb_poly(row[j]) for row in sizes), arb_poly())",
     "total = sum((arb_poly([x / 2 for x in row[j]]) for row in sizes), arb_poly())"): "steep",
    ("rest = between(points.rest, outer", "rest = 0 * between(points.rest, outer"): "between",
    ("known = Majorant(_largest_sizes([row[j][:cut] for row in bounds[1]])",
     "known = Majorant(bounds[1][-1][j][:cut]"): "kicks",
}  # fmt: skip


@pytest.mark.alters_sources
@pytest.mark.parametrize("changes", thirds([*WRONG]))
def test_an_omission_in_a_bound_on_modes_is_noticed(changes):
    right, wrong = (text.replace("'", '"') for text in changes)
    assert lacking(WRONG[changes], mutant(barrier, (right, wrong)))


# --- false claims and degenerate inputs ----------------------------------------------------------


def test_a_step_that_is_too_large_proves_nothing():
    numbers = [[arb(1.5)], [arb(1.3)], [arb(1.4)]]
    proved = []
    for w in np.geomspace(1e-14, 1e3, 60):
        failed, _ = barrier.inequalities_after_a_step(
            GAMMA, [arb(0.9)], arb(RHO), *numbers, [arb(w)], [arb(1e-3)]
        )
        proved.append(not failed)
    assert proved[0]
    assert not any(proved[proved.index(False) :])
    for w in (inf, np.nan):
        failed, _ = barrier.inequalities_after_a_step(
            GAMMA, [arb(0.9)], arb(RHO), *numbers, [arb(w)], [arb(1e-3)]
        )
        assert failed


def test_bounds_outside_their_strip_are_refused():
    for rho, hat, cut in ((0.05, 0.05, 8), (0.06, 0.05, 8), (0.01, 0.05, 33), (0.01, 0.05, 0)):
        with pytest.raises(ValueError, match="out of range"):
            barrier.modes_of_the_sine(64, arb(rho), arb(hat), cut)


@pytest.mark.parametrize("name", ["one kick", "a ray"])
def test_a_step_for_a_different_circle_or_theorem_is_refused(name):
    good = json.loads(json.dumps(made(name).certificate()))
    body = {key: value for key, value in good.items() if key != "sha256"}
    weaker = good["theorem"]["name"].partition(" by ")[0]
    theorem = {"name": weaker, "version": 1, "sha256": _STATEMENTS[weaker]}
    with pytest.raises(checker.Refuted, match="inequality"):
        checker.check(with_sha256(body | {"theorem": theorem}))
    part = body["moves"]["numbers"][-1 if name == "one kick" else 0][0][0][1]
    part[1] += part[1] // 1000  # another circle
    with pytest.raises(checker.Refuted, match="inequality"):
        checker.check(with_sha256(body))


@pytest.mark.parametrize("beyond", [1e-5, 1e-3, 0.02])
def test_beyond_breakup_no_step_proves_that_a_circle_exists(beyond):
    omega, profile, value = GAMMA, np.array([1.0]), 0.971635406
    for distance in (0.01, 0.05):
        _, u = hull.certified_circle(omega, profile, value, distance)
        for n in (256, 1024, 4096):
            proof = barrier.prove(omega, (1 + beyond) * value * profile, start=u, n=n)
            assert not proof.proved
