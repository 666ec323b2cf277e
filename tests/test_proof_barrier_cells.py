"""A barrier in a cell: against a second program at forcings of the cell, and against mutants."""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval2d

pytest.importorskip("flint")
from audit import mutant
from cases import thirds
from flint import arb, ctx

from nasm import proofs
from nasm.numbers import RotationNumber, parse
from nasm.proofs import certificate_checker as checker
from nasm.proofs.barrier_cells import prove_cell

GAMMA = parse("gamma")
BREAKUPS = {0: 0.4858177, 20: 0.5770384}  # of γ on rays, by `barriers.critical_scale`


def on_ray(angle, distance):
    """A forcing below the breakup, in multiples of 2⁻²⁰."""
    angle = np.deg2rad(angle), BREAKUPS[angle]
    kappa = (1 - distance) * angle[1] * np.array([np.cos(angle[0]), np.sin(angle[0])])
    return tuple((np.rint(kappa * 2**20) / 2**20).tolist())


CELLS = [(on_ray(20, 0.3), 2.0**-6), (on_ray(0, 0.4), 2.0**-6)]


def exactly(x):
    """A long double as a ball without radius."""
    return arb(float(x)) + arb(float(x - np.longdouble(float(x))))


def nearest(x):
    """A ball's middle as a long double."""
    high = float(x.mid())
    return np.longdouble(high) + np.longdouble(float(x - high))


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
                    row[k] += weight * exactly(x)
            assert all(x.rad() == 0 for x in row)
            modes.append(row)
        return modes


def theorem(kappa, half_width, rho, modes, sigma):
    """What the second program finds for the forcing at σ, with these modes."""
    strengths = [k + half_width * s for k, s in zip(kappa, sigma, strict=True)]
    rows = [[proofs.barrier._dyadics(x) for x in row] for row in modes]
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


@dataclass(frozen=True)
class Case:
    """A cell, functions that need not solve anything, and where their norms are taken.

    u : modes of u_j, (2, L). C : of C_jm, (2, Q, Q, L). All are ≥ 0, so that norms of the sums over
    m are largest at the corner σ = (1, 1), where all T_m are 1.
    """

    kappa: tuple[float, float]
    half_width: float
    u: np.ndarray
    C: np.ndarray
    rho: float
    hat: float
    omega: RotationNumber = GAMMA
    n: int = 64

    @cached_property
    def centre(self):
        """What the program is given of the centre."""
        with ctx.workprec(128):
            grid = proofs.barrier.Grid(self.omega, list(self.kappa), 0.0, self.n)
            modes = [[arb(float(x)) for x in row] for row in self.u]
            return grid, self.half_width, 0.15, modes, proofs.barrier.residual(grid, modes)

    @cached_property
    def moves(self):
        """|Δ_j| at Chebyshev's points, (2, L, Q²)."""
        Q = self.C.shape[1]
        x = np.cos(np.pi * (2 * np.arange(Q) + 1) / (2 * Q))
        return chebval2d(np.repeat(x, Q), np.tile(x, Q), np.moveaxis(self.C.astype(float), 0, 2))

    @cached_property
    def sizes(self):
        with ctx.workprec(128):
            return proofs.barrier_cells._Sizes(proofs.barrier_cells._Centre(*self.centre), self.C)

    @cached_property
    def E(self):
        """max_i |E_j - the centre's E_j| at these points, (2, n/2), by balls."""
        *_, centre, of_centre = self.centre
        Q, added = self.C.shape[1], []
        with ctx.workprec(300):
            x = [(arb(2 * i + 1) / (2 * Q)).cos_pi().mid() for i in range(Q)]
        with ctx.workprec(160):
            for sigma in product(x, x):
                strengths = [
                    k + self.half_width * s for k, s in zip(self.kappa, sigma, strict=True)
                ]
                grid = proofs.barrier.Grid(self.omega, strengths, 0.0, self.n)
                residual = proofs.barrier.residual(grid, at(centre, self.C, sigma))
                rows = zip(residual, of_centre, strict=True)
                added.append([[nearest(x - y) for x, y in zip(*row, strict=True)] for row in rows])
        return np.abs(added).max(axis=0)


def random_case(kappa, half_width, Q, sizes, rho, hat, only=None):
    """A Case in which |u_j| and |Δ_j| are about `sizes`. only : which m the Δ_j have; else all."""
    rng, k, m, L = np.random.default_rng(Q), np.arange(12), np.arange(Q), 12
    falling = np.exp(-k / 2) * (k > 0)
    degrees = np.add.outer(m, m)
    weights = np.where(degrees < Q, 0.5**degrees, 0)
    if only:
        weights = np.zeros((Q, Q))
        weights[tuple(np.transpose(only))] = 1
    u, C = rng.uniform(0.5, 1, (2, L)) * falling, rng.uniform(0.5, 1, (2, Q, Q, L)) * falling
    C *= weights[:, :, None]
    u *= sizes[0] / (2 * u.sum(axis=1).max())
    C *= sizes[1] / (2 * C.sum(axis=(1, 2, 3)).max())
    return Case(kappa, half_width, u, C.astype(np.longdouble), rho, hat)


def solved_case(omega, half_width, Q, rho, hat):
    """Circles near the one at rest, as good as they come: what is left is rounding."""
    rest = np.zeros((2, 12)), np.zeros((2, Q, Q, 12))
    zero = Case((0.0, 0.0), half_width, *rest, rho, hat, omega)
    module = proofs.barrier_cells
    with ctx.workprec(128):
        centre = module._Centre(*zero.centre)
        b = module._circles(centre, np.zeros((2, Q**2, 12), np.longdouble), 1e-15)
        b += module._step(centre, b, centre.residuals(b, module._nodes(Q), np.longdouble))
        b[:, :, 9:] = 0  # what is not of the step; the circles' modes there are below 10⁻²⁷
        return replace(zero, C=module._coefficients(b))


@cache
def cases():
    """By the term of the bounds that is the largest, or nearly so."""
    flat = np.full((2, 24), 1e-8) * (np.arange(24) > 0)
    same = np.zeros((2, 6, 6, 24), np.longdouble)
    same[:, 0, 0] = flat
    little = (0.3, 0.2), 0.01, 6, (1e-3, 0.003), 0.01, 0.05
    return {
        "at the points": random_case((0.3, 0.2), 0.125, 6, (0.01, 0.068), 0.01, 0.05),
        "the centre": random_case((0.3, 0.2), 2.0**-30, 6, (0.01, 1e-12), 0.01, 0.05),
        "between the points": random_case((0.0, 0.25), 0.5, 6, (0.01, 1e-3), 0.01, 0.05),
        "rounding": solved_case(parse("[0;(8)]"), 2.0**-10, 12, 0.001, 0.25),
        "few points": random_case((0.3, 0.1), 2.0**-6, 8, (1e-4, 0.02), 0.001, 0.005),
        "the last modes": Case((0.0, 0.9), 2.0**-100, flat, same, 0.02, 0.1),
        "m = (1, 1)": random_case(*little, [(1, 1)]),
        "|m| = 3": random_case(*little, [(3, 0), (1, 2)]),
    }


def least(case):
    """Lists of n_j, k_j, p_j, ‖Δ_j'‖ and ‖E_j‖: what the theorem asks the bounds to be, in floats.

    n_j, k_j and Δ_j' at the corner. p_j of the functions there, on a grid. E_j by the formulas,
    with the cut and the r for which they are least.
    """
    (_, Q, _, L), n, nu = case.C.shape, case.n, 2.0**-64
    C, rho, hat, h, pi = case.C.astype(float), case.rho, case.hat, case.half_width, np.pi
    k, degrees, kappa = np.arange(n), np.add.outer(range(Q), range(Q)), np.abs(case.kappa) + h
    w, w_hat = np.exp(2 * pi * np.array([[rho], [hat]]) * k)
    both = 2 * (np.abs(C) @ w[:L]).sum()
    beta = np.sqrt(2 * (case.moves**2).sum(axis=(0, 1)).max())
    phi = np.expm1(np.log2(n) * np.log1p(5 * nu))
    rounding = (2 * phi + 16 * nu) * (h / pi + kappa.max() * beta)
    Lambda, cuts = 1 + 2 / pi * np.log(Q), np.arange(L, n // 2 + 1)
    r = np.geomspace(1.01, 100, 2000)
    found = {name: [] for name in ("n", "k", "p", "moved", "error")}
    for j in (0, 1):
        moved = np.abs(C[j]).sum(axis=(0, 1))
        corner = case.u[j] + moved
        found["moved"].append(4 * pi * (k[:L] * moved) @ w[:L])
        found["n"].append(1 + 4 * pi * (k[:L] * corner) @ w[:L])
        found["k"].append(np.exp(2 * pi * (rho + 2 * corner @ w[:L])))
        slope = 1 + np.fft.irfft(2 * pi * k[:L] * (case.u[j] + C[j].sum(axis=(0, 1))), 512) * 512
        inverse = np.abs(np.fft.rfft(1 / slope)) / 512
        inverse[inverse < 1e-14] = 0
        found["p"].append(2 * inverse[:n] @ w - inverse[0])

        force = 2 * (case.u[j] + moved) @ w_hat[:L]
        force = kappa[j] / (2 * pi) * np.exp(2 * pi * (hat + force))
        missed = np.exp(-2 * pi * (hat - rho) * cuts)
        missed += np.exp(2 * pi * (rho * cuts - hat * (n - cuts)))
        noise = 2 * np.sqrt(np.cumsum(w**2)[cuts - 1]) * rounding
        noise += nu * (32 + (4 + 2 * kappa[j] * found["k"][j]) * (2 * Q + 8)) * both
        E = 2 * np.cumsum(case.sizes.E[j].astype(float) * w[: n // 2])[cuts - 1]
        grown = 2 * (np.abs(C[j]) @ w[:L])[..., None] * r ** degrees[..., None]
        B = rho + 2 * case.u[j] @ w[:L] + grown.sum(axis=(0, 1))
        B = (abs(case.kappa[j]) + h * r) / (2 * pi) * np.exp(np.minimum(2 * pi * B, 700))
        between = (4 * (1 + Lambda) * B * r**-Q / (1 - 1 / r)).min()
        found["error"].append(Lambda**2 * (E + noise + force * missed).min() + between)
    return found, rounding


SLACK = {"n": 1.0001, "k": 1.0001, "p": np.inf, "moved": 1.0001, "error": 1.5}


def audit(module):
    """Everything that a wrong proof would show up in; an exception if it does."""
    with ctx.workprec(128):
        for name, case in cases().items():
            centre = module._Centre(*case.centre)
            sizes = module._Sizes(centre, case.C)
            bounds = module._constants(sizes, arb(case.rho), case.hat)
            bounds["p"] = [module._bound_of_the_inverse(sizes, j, case.rho) for j in (0, 1)]
            wanted, rounding = least(case)
            assert rounding <= float(module._rounding(sizes)) <= 1.2 * rounding, name
            for constant, values in wanted.items():
                for value, bound in zip(values, bounds[constant], strict=True):
                    bound, least_bound = float(bound), (1 - 1e-7) * value
                    said = name, constant, bound / value
                    assert least_bound <= bound <= SLACK[constant] * value + 1e-99, said
            if name == "at the points":
                of_centre = proofs.barrier_cells._abs_upper(case.centre[4])
                off = np.sqrt(((sizes.E - of_centre - case.E) ** 2).sum())
                assert 0.01 * rounding < off < rounding
    too_far = np.full((2, 1, 2), [0, 0.021])
    E = centre.residuals(too_far, np.zeros((2, 1)), np.longdouble)  # 2π|Δ| > 1/4
    assert np.isnan(E).all()


def test_each_bound_is_what_the_theorem_asks_for():
    audit(proofs.barrier_cells)


def test_bounds_hold_between_the_points():
    case = cases()["between the points"]
    with ctx.workprec(128):
        bounds = proofs.barrier_cells._constants(case.sizes, arb(case.rho), case.hat)
    for sigma in points(1, 2):
        modes = at(case.centre[3], case.C, sigma)
        _, constants = theorem(case.kappa, case.half_width, case.rho, modes, sigma)
        for name in ("n", "k", "error"):
            assert constants[name] <= max(map(float, bounds[name])), name


CHANGES = {
    "no strength of σ": ("moved[j, part] * s + k *", "k *"),
    "no versine": (" - s * _versine(y))", ")"),
    "neighbours": ("turn * b[::-1] - 2 * b", "turn * b[::-1] - 2.0000001 * b"),
    "own neighbour": ("turn * b[::-1] - 2 * b", "turn * b - 2 * b"),
    "series": ("1 - y2 / (i * (i + 1)) * total", "1 - y2 / (i * (i + 2)) * total"),
    "series of 4 terms": ("for i in range(first + 10, ", "for i in range(first + 6, "),
    "a turn is no limit": ("if not np.abs(y).max() <= 0.25:", "if False:"),
    "between: an eighth": ("tail = 4 * (1 + Lambda) * B", "tail = 0.5 * (1 + Lambda) * B"),
    "between: r^-2Q": ("arb(r) ** -Q", "arb(r) ** (-2 * Q)"),
    "B: cell of no width": (" + arb(centre.half_width) * r)", ")"),
    "B: Δ does not grow": ("powers @ moves[:, j]", "powers**0 @ moves[:, j]"),
    "Λ once": ("Lambda**2 * at_points + between", "Lambda * at_points + between"),
    "rounding: 2^-72": ("_UNIT = np.longdouble, 2.0**-64", "_UNIT = np.longdouble, 2.0**-72"),
    "rounding of transforms: half": (
        "(11 * (sizes.centre.n.bit_length() - 1) + 16)",
        "(5 * (sizes.centre.n.bit_length() - 1) + 8)",
    ),
    "rounding of sums": ("noise += unit *", "noise += 0 *"),
    "no moves to round": ("_above(np.sqrt(2 * (b**2).sum(axis=(0, 2)).max()))", "arb(0)"),
    "nothing beyond the cut": ("+ noise + beyond", "+ noise"),
    "ρ̂: no moves": ("u_hat += _above(2 * (sizes.moves", "0 * _above(2 * (sizes.moves"),
    "strength: cell of no width": ("arb(abs(k)) + arb(centre.half_width) for", "arb(abs(k)) for"),
    "cut below the modes of u": ("min(max(cut, L), n // 2)", "min(max(cut, 8), n // 2)"),
    "no residual of the centre": ("self.E += _abs_upper(centre.residual)", "pass"),
    "only the first point": ("_nodes(Q), _LONG)).max(axis=1)", "_nodes(Q), _LONG))[:, 0]"),
    "residuals in doubles": ("_nodes(Q), _LONG)).max(axis=1)", "_nodes(Q), float)).max(axis=1)"),
    "roots in doubles": (
        "[_long(root.real) + 1j * _long(root.imag)",
        "[_LONG(float(root.real)) + 1j * _LONG(float(root.imag))",
    ),
    "n: no moves": ("sizes.u[j] * k * w[:L]).sum()) + moved", "sizes.u[j] * k * w[:L]).sum())"),
    "k: no moves": ("(two_pi * (u + move)).exp()", "(two_pi * u).exp()"),
    "p: no defect": ("small += norm([x.abs_upper() for x in modes], rho)", "small += 0"),
    "p: no Neumann": ("return size / (1 - small)", "return size"),
    "p: |m| = 3 left out": ("(sizes.moves[3:, j]", "(sizes.moves[4:, j]"),
    "p: m = (1, 1) left out": ("(0, 2), (1, 1), (2, 0)", "(0, 2), (2, 0)"),
}


@pytest.mark.parametrize("change", thirds(CHANGES))
def test_a_changed_line_is_noticed(change):
    changed = mutant(proofs.barrier_cells, change)
    with pytest.raises(AssertionError):
        audit(changed)


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
    bound = float(proofs.barrier_cells._beyond(arb(rho), arb(hat), cut, n).mid())
    without = np.exp(2 * np.pi * (rho - hat) * cut)  # aliases
    most = max(missed(rho, hat, cut, n, m) for m in range(1, 4 * n))
    assert most <= bound < 1.5 * most
    if cut == n // 2:
        assert without < most


def test_the_constant_of_interpolation_is_above_lebesgues():
    # Σ ±ℓ_i(cos θ) is an even trigonometric polynomial of degree < n, whose slope is less than n
    # times its maximum (Bernstein): what a grid misses of the maximum is known.
    for n in range(2, proofs.ray.MOST + 1):
        theta = np.linspace(0, np.pi / 2, 150 * n + 1)  # and the same beyond
        T = np.cos(np.arange(n)[:, None] * theta)
        weights = proofs.barrier_cells._chebyshev(n, n).astype(float) * 2 / n
        weights[:, 0] /= 2
        on_the_grid = np.abs(weights @ T).sum(axis=0).max()
        largest = on_the_grid / (1 - n * theta[1] / 2)
        assert 0.9 < largest / (1 + 2 / np.pi * np.log(n)) < 1


@pytest.mark.parametrize("most", [0.45, 2.0])  # by how much C may decay: the second is no hurdle
@pytest.mark.parametrize(("angle", "distance"), [(0, 0.04), (20, 0.02), (20, 0.1), (0, 0.3)])
def test_a_cell_across_the_boundary_is_not_proved(angle, distance, most, monkeypatch):
    monkeypatch.setattr(proofs.barrier_cells, "_LARGEST", most)
    half_width = 1.01 * distance * BREAKUPS[angle]  # its corner is beyond by 1% of its half width
    assert not prove_cell(GAMMA, on_ray(angle, distance), half_width).proved


@pytest.mark.parametrize("beyond", [1e-3, 0.05])
def test_beyond_the_boundary_no_cell_is_proved(beyond):
    assert not prove_cell(GAMMA, on_ray(20, -beyond), 2.0**-20).proved


def test_what_is_no_number_proves_nothing():
    case = cases()["rounding"]
    with ctx.workprec(128):
        centre = proofs.barrier_cells._Centre(*case.centre)
        assert proofs.barrier_cells._verified(centre, case.C)["proved"]
        for wrong in (np.nan, np.inf):
            changed = case.C.copy()
            changed[0, 0, 0, 1] = wrong
            assert not proofs.barrier_cells._verified(centre, changed)["proved"]


def test_long_doubles_that_are_doubles_are_refused(monkeypatch):
    monkeypatch.setattr(proofs.barrier_cells, "_LONG", np.float64)
    with pytest.raises(RuntimeError, match="64 bits"):
        prove_cell(GAMMA, *CELLS[0])


def test_a_cell_whose_certificate_might_not_be_confirmed_is_left():
    # Its ratio is 0.0299 of 1/32; the checker's bound of it is 0.0344.
    found = prove_cell(parse("gamma"), (0.45703125, 0.06640625), 2.0**-8)
    assert 1 / 40 < found.constants["ratio"] < 1 / 32
    assert not found.proved
    assert "margin" in found.why
