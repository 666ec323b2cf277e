"""A barrier in a cell: against a second program at forcings of the cell, and against mutants."""

import inspect
import sys
import types

import numpy as np
import pytest

pytest.importorskip("flint")
from flint import arb, ctx

from nasm import certificate_checker as checker
from nasm import circles, proof_barrier, proof_barrier_cells
from nasm.numbers import parse
from nasm.proof_barrier_cells import prove_cell

GAMMA = parse("gamma")
BREAKUPS = {  # scales at which γ breaks on rays, of `barriers.critical_scale`
    0: 0.4858177,
    20: 0.5770384,
}


def on_ray(angle, distance):
    """A forcing below the breakup, in multiples of 2⁻²⁰."""
    angle = np.deg2rad(angle), BREAKUPS[angle]
    kappa = (1 - distance) * angle[1] * np.array([np.cos(angle[0]), np.sin(angle[0])])
    return tuple((np.rint(kappa * 2**20) / 2**20).tolist())


CELLS = [(on_ray(20, 0.3), 2.0**-6), (on_ray(0, 0.4), 2.0**-6)]


def at(centre, C, sigma):
    """Modes of u_j at a point of the cell, exact for dyadic σ: lists of balls without radius."""
    with ctx.workprec(2000):
        powers = []
        for s in map(arb, sigma):
            row = [arb(1), s]
            for _ in range(C.shape[1]):
                row.append(2 * s * row[-1] - row[-2])
            powers.append(row)
        modes = []
        for j in (0, 1):
            row = list(centre[j])
            for m0, m1 in np.argwhere(np.abs(C[j]).max(axis=2) > 0).tolist():
                weight = powers[0][m0] * powers[1][m1]
                for k, x in enumerate(C[j, m0, m1]):
                    row[k] += weight * (arb(float(x)) + arb(float(x - np.longdouble(float(x)))))
            assert all(x.rad() == 0 for x in row)
            modes.append(row)
        return modes


def theorem(kappa, half_width, rho, modes, sigma):
    """What the second program finds for the forcing at σ, with these modes."""
    strengths = [k + half_width * s for k, s in zip(kappa, sigma, strict=True)]
    rows = [[proof_barrier._dyadics(x) for x in row] for row in modes]
    data = {"omega": "[0;(1)]", "kappa": [k.hex() for k in strengths], "radius": (0.0).hex()}
    data |= {"rho": float(rho).hex(), "modes": rows}
    with ctx.workprec(checker.BITS):
        return checker.theorem(data)


def points(n, seed):
    """Corners of the cell and points in it, σ in multiples of 2⁻⁸."""
    corners = [(1.0, 1.0), (-1.0, 1.0)]
    return corners + (np.random.default_rng(seed).integers(-255, 256, (n, 2)) / 256).tolist()


@pytest.mark.parametrize("cell", CELLS)
def test_a_second_program_proves_the_circle_at_forcings_of_a_proved_cell(cell):
    proof = prove_cell(GAMMA, *cell)
    assert proof.proved, proof.why
    for sigma in points(1, 1):
        modes = at(proof.centre, proof.moves, sigma)
        holds, found = theorem(*cell, proof.rho, modes, sigma)
        assert holds
        for name, value in found.items():
            if name in proof.constants:
                assert value <= proof.constants[name] * (1 + 1e-9), name


def unmasked(module, b):
    """C of the polynomial through b at Chebyshev's points, where its residual is rounding."""
    Q = round(b.shape[1] ** 0.5)
    T = 2 * module._chebyshev(Q, Q).T / Q
    T[0] /= 2
    return np.einsum("am,bn,jmnk->jabk", T, T, b.reshape(2, Q, Q, -1))


@pytest.fixture(scope="module")
def parts():
    """A cell so wide that what is between the points counts: centre, polynomial, residuals."""
    kappa, half_width, rate = (0.25, 0.1875), 2.0**-5, 0.15
    with ctx.workprec(128):
        grid = proof_barrier.Grid(GAMMA, list(kappa), 0.0, 128)
        start = circles.invariant_circle(GAMMA, kappa).u
        found = proof_barrier.refined(grid, start, 40)
        centre = proof_barrier_cells._Centre(
            grid, half_width, rate, found["modes"], found["residual"]
        )
        b = proof_barrier_cells._circles(centre, np.zeros((2, 16, 36), np.longdouble), 1e-15)
        C = unmasked(proof_barrier_cells, b)
        seen, rho = [], 0.02
        for sigma in points(3, 2):
            modes = at(centre.modes, C, sigma)
            _, constants = theorem(kappa, half_width, rho, modes, sigma)
            strengths = [k + half_width * s for k, s in zip(kappa, sigma, strict=True)]
            there = proof_barrier.Grid(GAMMA, strengths, 0.0, 128)
            E = proof_barrier._residual(there, modes)
            added = [
                [x - y for x, y in zip(*rows, strict=True)]
                for rows in zip(E, centre.residual, strict=True)
            ]
            b = np.array([[proof_barrier_cells._long(x) for x in row] for row in modes])
            b -= [[proof_barrier_cells._long(x) for x in row] for row in centre.modes]
            seen.append((sigma, constants, added, b[:, None, :36]))
    return centre, C, rho, seen


def audit(module, parts):
    """Everything that a wrong proof would show up in; an exception if it does."""
    given, C, rho, seen = parts
    with ctx.workprec(128):
        centre = module._Centre(
            given.grid, given.half_width, given.rate, given.modes, given.residual
        )
        sizes = module._Sizes(centre, C)
        bounds = module._constants(sizes, arb(rho), 0.1)
        bounds["p"] = [module._bound_of_the_inverse(sizes, j, rho) for j in (0, 1)]
        largest = {name: max(map(float, balls)) for name, balls in bounds.items()}
        for name, sharp in {"n": 1.05, "p": 1.5, "k": 1.3, "error": 5000}.items():
            true = max(constants[name] for _, constants, _, _ in seen)
            assert true <= largest[name] <= sharp * true, name
        worst = 0
        for sigma, _, exact, b in seen:
            E = centre.residuals(b, np.array(sigma)[:, None], np.longdouble)[:, 0]
            off = [
                [
                    float(abs(arb(float(x)) + arb(float(x - np.longdouble(float(x)))) - y))
                    for x, y in zip(*rows, strict=True)
                ]
                for rows in zip(E, exact, strict=True)
            ]
            worst = max(worst, np.sqrt(np.sum(np.square(off))))
        assert 0.002 < worst / float(module._rounding(sizes)) < 1


def test_bounds_hold_between_the_points_and_are_not_vacuous(parts):
    audit(proof_barrier_cells, parts)


def missed(rho, hat, cut, n, m):
    """What a sum to |k| < cut misses, with n points, of the mode m whose size is 1 at hat."""
    size = np.exp(-2 * np.pi * hat * m)
    seen = np.zeros(2 * m + n, complex)
    found = np.fft.fft(size * np.exp(2j * np.pi * m * np.arange(n) / n)) / n
    k = np.arange(-cut + 1, cut)
    seen[k] = found[k]
    seen[m] -= size
    k = np.fft.fftfreq(seen.size, 1 / seen.size)
    return np.sum(np.abs(seen) * np.exp(2 * np.pi * rho * np.abs(k)))


@pytest.mark.parametrize(("rho", "hat"), [(0.01, 0.02), (0.001, 0.05)])
@pytest.mark.parametrize("cut", [10, 16])
def test_what_a_cut_sum_misses_is_bounded_and_aliases_count(rho, hat, cut):
    n = 32
    bound = float(proof_barrier_cells._beyond(arb(rho), arb(hat), cut, n).mid())
    without = np.exp(2 * np.pi * (rho - hat) * cut)  # aliases
    most = max(missed(rho, hat, cut, n, m) for m in range(1, 4 * n))
    assert most <= bound < 1.5 * most
    if cut == n // 2:
        assert without < most


MUTANTS = [
    ("moved[j, part] * s + k *", "k *"),
    (" - s * _versine(y))", ")"),
    ("turn * b[::-1] - 2 * b", "turn * b[::-1] - 2.0000001 * b"),
    ("turn * b[::-1] - 2 * b", "turn * b - 2 * b"),
    ("1 - y2 / (i * (i + 1)) * total", "1 - y2 / (i * (i + 2)) * total"),
    ("Lambda**2 * at_points + between", "Lambda**2 * at_points"),
    ("arb(r) ** -Q", "arb(r) ** (-2 * Q)"),
    ("_UNIT = np.longdouble, 2.0**-64", "_UNIT = np.longdouble, 2.0**-72"),
    ("sizes.u[j] * k * w[:L]).sum()) + moved", "sizes.u[j] * k * w[:L]).sum())"),
    ("(two_pi * (u + move)).exp()", "(two_pi * u).exp()"),
    ("small += norm([x.abs_upper() for x in modes], rho)", "small += 0"),
    ("return size / (1 - small)", "return size"),
]


@pytest.mark.parametrize(("right", "wrong"), MUTANTS)
def test_a_changed_line_is_noticed(right, wrong, parts, monkeypatch):
    source = inspect.getsource(proof_barrier_cells)
    assert source.count(right) == 1
    mutant = types.ModuleType("mutant")
    monkeypatch.setitem(sys.modules, "mutant", mutant)
    exec(source.replace(right, wrong), mutant.__dict__)
    with pytest.raises(AssertionError):
        audit(mutant, parts)


def test_the_constant_of_interpolation_is_above_lebesgues():
    x = np.linspace(-1, 1, 4001)
    for n in range(proof_barrier_cells._FEW, proof_barrier_cells._MOST + 1):
        T = np.cos(np.arange(n)[:, None] * np.arccos(x))
        weights = proof_barrier_cells._chebyshev(n, n).astype(float) * 2 / n
        weights[:, 0] /= 2
        largest = np.abs(weights @ T).sum(axis=0).max()  # Σ|ℓ_i(x)|
        assert 0.9 < largest / (1 + 2 / np.pi * np.log(n)) < 1


@pytest.mark.parametrize("most", [0.45, 2.0])  # by how much C may decay: the second is no hurdle
@pytest.mark.parametrize(("angle", "distance"), [(0, 0.04), (20, 0.02), (20, 0.1), (0, 0.3)])
def test_a_cell_across_the_boundary_is_not_proved(angle, distance, most, monkeypatch):
    monkeypatch.setattr(proof_barrier_cells, "_LARGEST", most)
    half_width = 1.01 * distance * BREAKUPS[angle]  # its corner is beyond by 1% of its half width
    assert not prove_cell(GAMMA, on_ray(angle, distance), half_width).proved


@pytest.mark.parametrize("beyond", [1e-3, 0.05])
def test_beyond_the_boundary_no_cell_is_proved(beyond):
    assert not prove_cell(GAMMA, on_ray(20, -beyond), 2.0**-20).proved


def test_what_is_no_number_proves_nothing(parts):
    centre, C, *_ = parts
    with ctx.workprec(128):
        for wrong in (np.nan, np.inf):
            changed = C.copy()
            changed[0, 0, 0, 1] = wrong
            assert not proof_barrier_cells._verified(centre, changed)["proved"]


def test_long_doubles_that_are_doubles_are_refused(monkeypatch):
    monkeypatch.setattr(proof_barrier_cells, "_LONG", np.float64)
    with pytest.raises(RuntimeError, match="64 bits"):
        prove_cell(GAMMA, *CELLS[0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((GAMMA, (0.1, 0.2, 0.1), 0.1), "two strengths"),
        ((GAMMA, (0.1, np.nan), 0.1), "not finite"),
        ((GAMMA, (0.1, 0.2), 0.0), "positive"),
        ((parse("3/5"), (0.1, 0.2), 0.1), "rational"),
    ],
)
def test_bad_arguments_raise(arguments, message):
    with pytest.raises(ValueError, match=message):
        prove_cell(*arguments)
