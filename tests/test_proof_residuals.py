"""Residuals of a patch, computed as sums of two floats: error bounds are derived and tested."""

import re
import time
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from math import factorial, hypot, log2, pi, sqrt

import numpy as np
import pytest
from flint import acb, arb, ctx
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from nasm.numbers import parse
from nasm.proofs import barrier
from nasm.proofs import patches as patches
from nasm.proofs import residuals as module
from nasm.proofs.precision import working_precision

NU2 = Fraction(2) ** -106
ADD, MULTIPLY, TABLE = 3.01, 7.01, 2  # bounds on errors, in units of NU2
ROOT = sqrt(2)
KAPPA = (0.8, 0.3, -0.2)


@st.composite
def pairs(draw):
    high = draw(st.floats(-2, 2).filter(lambda a: a == 0 or abs(a) > 1e-60))
    share = draw(st.sampled_from([0.0, 1.0, -1.0, 0.999, 0.5]) | st.floats(-1, 1))
    low = share * np.spacing(abs(high)) / 2
    return float(high), float(low)


def exact(x):
    return Fraction(x[0]) + Fraction(x[1])


@given(pairs(), pairs(), st.sampled_from([0, 1, 2**-20, -(2**-30), 2**-52]))
def test_sums_and_products_are_as_accurate_as_the_bounds_assume(a, b, near):
    if near:  # numbers that nearly cancel
        b = -a[0] * (1 + near), b[1] if abs(b[1]) <= abs(a[0]) * 2.0**-53 else 0.0
    total, size = exact(module._sum(a, b)), abs(exact(a)) + abs(exact(b))
    assert abs(total - exact(a) - exact(b)) <= Fraction(ADD) * NU2 * size
    product = exact(module._product(a, b))
    assert abs(product - exact(a) * exact(b)) <= Fraction(MULTIPLY) * NU2 * abs(exact(a)) * abs(
        exact(b)
    )
    for high, low in (module._sum(a, b), module._product(a, b)):
        assert abs(Fraction(low)) <= abs(Fraction(high)) / 2**53


def test_errors_of_sums_and_products_imply_the_other_constants():
    much = 1 + 1e-3  # allows for products of errors
    product = ROOT * (MULTIPLY + ADD) * much
    assert product < 14.2
    times_root = (14.2 + ROOT * TABLE) * much
    assert times_root < 18.3
    add = ADD * much
    assert sqrt(add**2 + (18.3 + add) ** 2) < 22
    assert all((18.3 + add * (r - 1)) * sqrt(r) < 68 for r in (3, 5))
    assert times_root + 3 * add < 31
    assert ROOT * (MULTIPLY + TABLE + ADD) * much < 20
    assert TABLE < 5
    assert ADD <= 3.01
    # u at the points: two products with tabulated matrices, and integers that are rounded
    assert 1 + 2 * (MULTIPLY + TABLE) * much < 20
    assert add < 3.1


def test_the_error_of_the_sine_is_less_than_eighteen_units():
    r = 2.0**-8 * (1 + 1e-6)
    theta, errors = 2 * pi * r, []
    for first, table in ((1, module._SINE), (0, module._COSINE)):
        # The last three terms use floats: coefficients, two products and two sums are rounded.
        last, p = module._IN_PAIRS, 1.001 * abs(table[module._IN_PAIRS, 0])
        e = 8 * 2.0**53 * p
        assert abs(table[last:, 0]) @ r ** (2 * np.arange(len(table) - last)) < p
        for k in range(last - 1, -1, -1):
            c, x = abs(table[k, 0]), r * r * p
            rounded = 0 if c == 1 else c
            e = r * r * e + 2 * MULTIPLY * x + ADD * (c + x) + rounded
            p = c + x
        errors.append(1.001 * (e if first == 0 else e * r + MULTIPLY * p * r))
        n = first + 2 * len(table)
        assert theta**n / factorial(n) < 0.03 * float(NU2)
        with ctx.workprec(200):
            for k, (high, low) in enumerate(table):
                power = first + 2 * k
                term = (-1) ** k * (2 * arb.pi()) ** power / factorial(power)
                assert abs(arb(high) + arb(low) - term) < abs(term) * arb(2) ** -106
    sine, cosine = errors
    assert cosine < 3.4
    assert sine < 11.4 * theta
    total = (MULTIPLY + TABLE + cosine) + (MULTIPLY + TABLE + 11.4) * theta + ADD * (1 + theta)
    assert total * 1.001 + 0.03 < 18


def test_the_error_of_the_sine_is_within_its_bound():
    rng, (angles, _) = np.random.default_rng(3), module._grid_tables(128)
    x = [*rng.uniform(-1.5, 1.5, 2000), *(np.arange(-300, 301) / 256), 1e-300, 0.5, 900.1]
    worst = arb(0)
    with ctx.workprec(256):
        for high in map(float, x):
            low = float(rng.uniform(-0.5, 0.5) * np.spacing(high))
            value = module._sine((high, low), angles)
            error = arb(value[0]) + arb(value[1]) - (2 * (arb(high) + arb(low))).sin_pi()
            worst = worst.max(abs(error))
    assert 0.5 < worst * 2**106 < 18


def inputs(n):
    """Yield complex vectors: random ones, and ones whose errors might add up."""
    rng, i = np.random.default_rng(n), np.arange(n)
    yield rng.normal(size=n) + 1j * rng.normal(size=n)
    yield np.ones(n) * (1 + 1j) / 3
    yield np.exp(2j * np.pi * (n // 3) * i / n)  # one large result
    yield np.exp(1j * np.pi * i * i / n)  # all results have the same size
    yield (-1.0) ** i * (0.1 + 0.7j)
    yield np.where(i == n - 1, 1 / 3 + 1j / 7, 0)
    yield np.exp(-1.5 * i) * (1 + 1j)
    yield np.where(i % 2, 1e-20, 1.0) * rng.normal(size=n) + 0j


def in_rows(x, rng):
    """Return the vector, with small random low parts, as rows of four floats."""
    high = np.stack([x.real, x.imag], axis=-1)
    both = np.stack([high, high * rng.uniform(-1, 1, high.shape) * 2.0**-54], axis=-1)
    return np.ascontiguousarray(both.reshape(len(x), 4))


def in_balls(rows):
    return [acb(arb(a) + arb(b), arb(c) + arb(d)) for a, b, c, d in rows.tolist()]


@pytest.mark.parametrize("n", [64, 96, 160, pytest.param(2560, marks=pytest.mark.slow)])
def test_the_error_of_a_transform_is_within_its_bound(n):
    first, (turns, _) = n // (n & -n), module._grid_tables(n)
    ratios = []
    for x in inputs(n):
        rows, y = in_rows(x, np.random.default_rng(1)), np.empty((n, 4))
        module._transform(rows, turns, first, y)
        with ctx.workprec(256):
            # FLINT's transform has the opposite sign in its exponent: reverse the order
            values = acb.dft(in_balls(rows))
            values = [values[-k % n] for k in range(n)]
            error = sum((abs(a - b) ** 2 for a, b in zip(in_balls(y), values, strict=True)), arb(0))
            size = sum((abs(a) ** 2 for a in in_balls(rows)), arb(0))
            bound = (68 + 22 * log2(n)) * arb(2) ** -106 * (n * size).sqrt()
            ratios.append(float(error.sqrt() / bound))
    assert max(ratios) < 1
    assert max(ratios) > 1e-3  # observed: 0.005 to 0.02


def modes_of(case, n, n_sites):
    """Return modes of shape (2, 3, P, parts, K) for three forcings."""
    rng, K, parts = np.random.default_rng(n), int(0.38 * n), 1 if n_sites <= 2 else 2
    k = np.arange(K)
    decaying = {"decaying": np.exp(-20.0 * k / n), "flat": 1.0 / n, "large": np.exp(-9.0 * k / n)}
    u = np.zeros((2, 3, n_sites, parts, K))
    u[0] = rng.normal(size=u[0].shape) * decaying[case] * (3.0 if case == "large" else 0.02)
    u[0, 1:2] = 0.01 * np.sign(u[0, 1:2]) * decaying[case]
    u[..., 0, 0] = u[..., -1, 0] = 0
    u[1] = u[0] * rng.uniform(-1, 1, u[0].shape) * 2.0**-54
    return u


def exactly(u, node, odd):
    """Return the modes at a forcing as exact balls, the input to `barrier.residual`."""
    rows = []
    for part in np.moveaxis(u[:, node], 0, -1).tolist():
        balls = [[arb(a) + arb(b) for a, b in row] for row in part]
        rows.append([-x for x in balls[0]] if odd else [acb(*z) for z in zip(*balls, strict=True)])
    return rows


@pytest.mark.parametrize(("n", "size"), [(64, 33), (112, 20)])
def test_grids_that_do_not_fit_the_modes_are_refused(n, size, monkeypatch):
    """Nothing is computed, so that a grid that is not refused fails here, without a crash."""
    monkeypatch.setattr(module, "_compute", lambda *_: None)
    u = np.zeros((2, 1, 2, 1, size))
    with ctx.workprec(128):
        grid = barrier.Grid(parse("gamma"), KAPPA[:2], n)
        with pytest.raises(ValueError, match="do not fit"):
            module.residuals([grid], u, u[0, 0, :, 0])


@pytest.mark.parametrize("case", ["decaying", "flat", "large"])
@pytest.mark.parametrize(("n", "n_sites"), [(128, 1), (96, 2), (160, 2), (96, 3), (80, 4)])
def test_residuals_enclose_those_computed_with_256_bits(n, n_sites, case):
    omega, kappa, u = parse("gamma"), (*KAPPA, 0.1)[:n_sites], modes_of(case, n, n_sites)
    rng = np.random.default_rng(4)
    errors = np.abs(u[0]).max(axis=(0, 2)) * 1e-28
    with ctx.workprec(128):
        grid = barrier.Grid(omega, kappa, n)
        grids = [grid.under([s * k for k in grid.kappa]) for s in (1, arb(0.1), 0)]
        E, radii = module.residuals(grids, u, errors)
        balls = module.as_balls(E, radii)
    ratios = []
    for node, scale in enumerate((1, arb(0.1), 0)):
        with ctx.workprec(256):
            grid = barrier.Grid(omega, kappa, n)
            with ctx.workprec(128):
                strengths = [scale * k for k in grid.kappa]
            true = exactly(u, node, grid.odd)
            for row, most in zip(true, errors.tolist(), strict=True):
                signs = rng.choice([-1, 1], len(row)).tolist()
                row[1:] = [x + s * arb(a) for x, s, a in zip(row, signs, most, strict=True)][1:]
            wanted = barrier.residual(grid.under([k.mid() for k in strengths]), true)
            for j, row in enumerate(wanted):
                for x, y, r in zip(row, balls[node][j], radii[node, j].tolist(), strict=True):
                    assert (y - x).contains(0)
                    middle = acb(acb(y).real.mid(), acb(y).imag.mid())
                    ratios.append(float(abs(middle - x).abs_upper() / (r + 1e-300)))
    assert max(ratios) > 0.1  # the errors added to u are the largest allowed


def test_the_bound_on_rounding_is_at_most_10000_times_too_large():
    n, u = 320, modes_of("decaying", 320, 2)
    with ctx.workprec(256):
        grid = barrier.Grid(parse("gamma"), KAPPA[:2], n)
        E, radii = module.residuals([grid] * 3, u, np.zeros(u.shape[2:5:2]))
        ratio = max(
            float(abs(-(arb(a) + arb(b)) - x) / r)
            for node in range(3)
            for j, row in enumerate(barrier.residual(grid, exactly(u, node, True)))
            for x, a, b, r in zip(row, *E[:, node, j, 0].tolist(), radii[node, j], strict=True)
        )
    assert 1e-4 < ratio < 1
    assert radii.max() < 1e-28


def test_the_bound_on_a_residual_contains_those_on_its_neighbours():
    """Without kicks, compare with the other terms of the bound in README.md, one by one."""
    rng, u = np.random.default_rng(9), np.zeros((2, 2, 4, 2, 9))
    u[0], errors = rng.normal(size=u[0].shape), rng.uniform(size=(4, 9)) * 2.0**-102
    radii = module._radii(np.zeros((2, 4)), u, errors, 64)
    assert (radii[..., 9:] == 2.0**-500).all()
    for node, j, k in np.ndindex(2, 4, 9):
        terms = [
            31 * 2.0**-106 * hypot(*u[0, node, i % 4, :, k]) + errors[i % 4, k]
            for i in (j - 1, j, j, j + 1)
        ]
        assert radii[node, j, k] == pytest.approx(1.01 * sum(terms), rel=1e-12, abs=0)


def test_errors_of_combinations_are_within_their_bound():
    rng, shapes = np.random.default_rng(6), ((5, 4), (3, 7))
    x = np.zeros((2, 4 * 7, 2, 1, 9))
    x[0] = rng.normal(size=x[0].shape)
    x[1] = x[0] * rng.uniform(-1, 1, x[0].shape) * 2.0**-54
    with ctx.workprec(256):
        A, B = (
            np.array([[arb(v) / 3 for v in row] for row in rng.uniform(-3, 3, shape).tolist()])
            for shape in shapes
        )
        result = module.combined([A, B], x)
        assert result.shape == (2, 15, 2, 1, 9)
        high, low = x.reshape(2, 4, 7, 18).tolist()
        sizes = np.abs(x[0]).reshape(28, 18).sum(axis=0)
        worst = 0.0
        for i, j, m in np.ndindex(5, 3, 18):
            total = sum(
                (
                    A[i, q] * B[j, r] * (arb(high[q][r][m]) + arb(low[q][r][m]))
                    for q in range(4)
                    for r in range(7)
                ),
                arb(0),
            )
            a, b = result.reshape(2, 5, 3, 18)[:, i, j, m].tolist()
            error = abs(arb(a) + arb(b) - total)
            worst = max(worst, float(error * 2**106 / (20 + 3.1 * 11) / float(sizes[m])))
    assert 1e-3 < worst < 1


def test_modes_survive_conversion_to_integers_and_back():
    rng = np.random.default_rng(7)
    numbers = [[[[], [0, 3**60, -(3**55)]]], [[[], [0, *map(int, rng.integers(-99, 99, 4))]]]]
    modes = module.from_integers(numbers, -80, True)
    assert modes.shape == (2, 2, 1, 1, 5)
    assert [module.to_integers(table, -80) for table in modes.swapaxes(0, 1)] == numbers
    numbers = [[[[1, 2], [0, 5]]]]
    modes = module.from_integers(numbers, -3, False)
    assert modes[0, 0, 0].tolist() == [[0.125, 0.25], [0, 0.625]]
    assert module.to_integers(modes[:, 0], -3) == numbers[0]
    assert module.upper_sizes(modes)[0, 0] == pytest.approx([0.125, hypot(0.25, 0.625)])


def test_modes_so_small_that_floats_underflow_are_refused():
    with pytest.raises(ValueError, match="unit=-1100 must be at least -900"):
        module.from_integers([[[[], [0, 1]]]], -1100, True)


def test_the_sine_of_a_huge_number_is_not_a_number():
    angles, _ = module._grid_tables(module._PARTS)
    for x in (2.0**24, -np.inf, np.nan):
        assert np.isnan(module._sine((x, 0.0), angles)).all()
    assert module._sine((2.0**24 - 0.25, 0.0), angles)[0] == -1


def test_upper_sizes_are_not_below_the_sizes():
    rng = np.random.default_rng(8)
    modes = np.zeros((2, 1, 1, 2, 500))
    modes[0] = rng.normal(size=modes[0].shape) * 10.0 ** rng.uniform(-200, 2, modes[0].shape)
    modes[1] = np.spacing(np.abs(modes[0])) / 2 * np.sign(modes[0])
    squares = [sum(exact(x) ** 2 for x in z) for z in modes[:, 0, 0].transpose(2, 1, 0).tolist()]
    sizes = module.upper_sizes(modes)[0, 0].tolist()
    assert all(Fraction(a) ** 2 >= x for a, x in zip(sizes, squares, strict=True))


def test_balls_contain_both_parts_and_the_radius():
    modes = np.array([[[[[0.0, 1.0]]]], [[[[0.0, -(2.0**-54)]]]]])
    (((_, ball),),) = module.as_balls(modes, np.array([[[0.0, 2.0**-55]]]))
    assert (ball + 1).contains(arb(2) ** -54 + arb(2) ** -55)
    assert float(ball.rad()) < 2.0**-53


def test_numbers_that_are_not_known_to_106_bits_are_refused():
    with pytest.raises(ArithmeticError, match="too wide"):
        module._pairs([arb(0.1, 1e-31)])
    with pytest.raises(ArithmeticError, match="too wide"):
        module._pairs([arb(1e-9, 1e-39)], relative=True)
    assert module._pairs([arb(1e-300)], relative=True) == [(1e-300, 0.0)]


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200, 600.0])
def test_modes_that_are_not_finite_or_too_large_have_no_bound(value):
    u = modes_of("decaying", 96, 2)
    u[0, 1, 0, 0, 3] = value
    with ctx.workprec(128):
        grid = barrier.Grid(parse("gamma"), KAPPA[:2], 96)
        _, radii = module.residuals([grid] * 3, u, np.zeros(u.shape[2:5:2]))
    assert not np.isfinite(radii[1]).any()
    assert np.isfinite(radii[[0, 2]]).all()


def test_a_thread_does_not_change_the_precision_of_other_threads():
    def bits(precision):
        with working_precision(precision):
            time.sleep(0.001)  # lets another thread run
            with working_precision(64):
                pass
            return ctx.prec

    precisions = [100, 200, 300, 400] * 5
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(bits, precisions)) == precisions


@pytest.mark.slow  # compiles the kernels
def test_operations_are_neither_reordered_nor_fused():
    u = modes_of("decaying", 96, 2)
    with ctx.workprec(128):
        grid = barrier.Grid(parse("gamma"), KAPPA[:2], 96)
        module.residuals([grid] * 3, u, np.zeros(u.shape[2:5:2]))
        half = np.array([[arb(0.5)]], object)
        module.combined([half, half], u[:, :1])
    for kernel in (module._compute, module._combine):
        options = {name: on for name, on in kernel.targetoptions.items() if name != "nopython"}
        function = njit(**options)(kernel.py_func)
        function.compile(kernel.nopython_signatures[0])
        (code,) = function.inspect_llvm().values()
        flags = re.findall(r"= f(?:add|sub|mul|div) (.*?)(?:<\d+ x double>|double)", code)
        assert len(flags) > 10
        assert not any(flags)
        assert "@llvm.fma" in code
