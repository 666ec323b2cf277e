"""Residuals of the circles in a patch, as sums of two floats, with bounds on rounding errors.

    E_j(φ) = u_{j+1}(φ + α) - 2u_j(φ) + u_{j-1}(φ - α) - (κ_j/2π) sin 2π(φ + u_j(φ))

The residuals are computed for many forcings, each from the modes of its own u_j. A number is stored
as a sum a' + a'' of two floats with |a''| ≤ 2⁻⁵³|a'|, which amounts to about 106 bits. A fast
Fourier transform converts the modes of u_j to values on a grid of n points, and another converts
the sines to modes. Each stage of a transform is a multiple of an orthogonal map, so it does not
amplify rounding errors in the mean square:

    error of the transform of x ≤ √n (68 + 22 log₂ n) 2⁻¹⁰⁶ ‖x‖₂.

proofs/README.md, "Rounding in a patch", derives this bound, and the one on E that `residuals`
returns. Both rely on IEEE arithmetic with rounding to nearest, gradual underflow and a fused
multiply-add, which `nasm.proofs.transport.check_arithmetic` tests at run time, and on FLINT's
balls; the tables of sines and cosines are checked against these balls.

Arrays of numbers have a first axis of length 2, for a' and a''. Only modes with k ≥ 0 are stored,
as all functions are real. The axis before the k axis has length 2, for real and imaginary parts;
for odd functions it has length 1, for the imaginary part.
"""

from collections.abc import Iterable
from functools import lru_cache
from math import factorial, log2, pi
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nasm.arithmetic.double_double import EXACT_PI, pair, two_sum
from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.lanes import fma, rint
from nasm.proofs.precision import working_precision
from nasm.types import FloatArray

if TYPE_CHECKING:
    from nasm.proofs.barrier import Ball, Grid

ComplexArray: TypeAlias = NDArray[Any]
"""Complex numbers in doubles."""

__all__ = ["as_balls", "as_complex", "combined", "from_integers", "moved", "parts_of", "residuals"]

try:
    from flint import acb, arb
except ImportError:  # the extra `proof`
    arb = None  # type: ignore[assignment, misc]

SQUARED_ULP = 2.0**-106
TABLE_ERROR = 2.0**-104  # largest error of a number in a table
ROUNDED_UP = 1 + 2.0**-40  # covers a thousand roundings
SLACK = 1.01  # covers the roundings of the bounds themselves, and products of errors
UNDERFLOW = 2.0**-500  # exceeds the total effect of underflow
TINY = 2.0**-600  # absolute error of strengths so small that pairs underflow
_PARTS = 128  # the sine is tabulated at this many angles
_TERMS, _IN_PAIRS = 7, 4  # of the series of sine and cosine; terms that need two floats
_MIN_UNIT = -900  # smallest binary exponent of modes
_LARGEST = 1e3  # upper limit of |u|; beyond it the bounds are infinite

_SINE, _COSINE = (
    np.array([pair((-1) ** k * (2 * EXACT_PI) ** n / factorial(n)) for k, n in enumerate(powers)])
    for powers in (range(1, 2 * _TERMS, 2), range(0, 2 * _TERMS, 2))
)


class TooWideError(ArithmeticError):
    """A ball is too wide for a sum of two floats."""


# --- sums and products ----------------------------------------------------------------------------


@njit
def _sum(a, b):
    """Return a + b, with an error of at most 3.01·2⁻¹⁰⁶ (|a| + |b|)."""
    s, error = two_sum(a[0], b[0])
    return two_sum(s, error + (a[1] + b[1]))


@njit
def _product(a, b):
    """Return ab, with an error of at most 7.01·2⁻¹⁰⁶ |ab|."""
    p = a[0] * b[0]
    return two_sum(p, fma(a[0], b[0], -p) + fma(a[0], b[1], a[1] * b[0]))


@njit
def _minus(a):
    return -a[0], -a[1]


@njit
def _complex_product(a, b):
    """Return the real and imaginary parts of ab, with an error of at most 14.2·2⁻¹⁰⁶ |ab|."""
    real = _sum(_product(a[0], b[0]), _minus(_product(a[1], b[1])))
    return real, _sum(_product(a[0], b[1]), _product(a[1], b[0]))


@njit
def _at(x, i):
    """Return the complex number in row i."""
    return (x[i, 0], x[i, 1]), (x[i, 2], x[i, 3])


@njit
def _put(x, i, z):
    x[i, 0], x[i, 1] = z[0]
    x[i, 2], x[i, 3] = z[1]


@kernel
def _combine(A, x, result):
    """Set result[:, i, m, k] to Σ_l A[:, i, l] x[:, l, m, k]."""
    for i in range(A.shape[1]):
        for m in range(x.shape[2]):
            high, low = result[0, i, m], result[1, i, m]
            high[:], low[:] = 0.0, 0.0
            for j in range(A.shape[2]):
                a, x_high, x_low = (A[0, i, j], A[1, i, j]), x[0, j, m], x[1, j, m]
                for k in range(x.shape[3]):
                    high[k], low[k] = _sum((high[k], low[k]), _product(a, (x_high[k], x_low[k])))


# --- the transform and the sine -------------------------------------------------------------------


@njit
def _transform(x, turns, first, y):
    """Set y_k to Σ_i x_i turns_{ik mod n}, n = first · 2^m; turns are powers of a root of unity.

    Begin with transforms of length `first`, each over every 2^m-th number; then repeatedly combine
    two transforms, over the numbers with even and with odd index, into one of twice the length.
    """
    n = len(x)
    blocks = n // first
    start = 0
    for block in range(blocks):
        for k in range(first):
            total = _at(x, start)
            for j in range(1, first):
                term = _complex_product(
                    _at(turns, j * k % first * blocks), _at(x, start + j * blocks)
                )
                total = _sum(total[0], term[0]), _sum(total[1], term[1])
            _put(y, block * first + k, total)
        bit = blocks >> 1  # the next start, in bit-reversed order
        while start & bit:
            start ^= bit
            bit >>= 1
        start ^= bit
    half = first
    while half < n:
        for begin in range(0, n, 2 * half):
            for k in range(half):
                a = _at(y, begin + k)
                b = _complex_product(_at(turns, k * (n // (2 * half))), _at(y, begin + half + k))
                _put(y, begin + k, (_sum(a[0], b[0]), _sum(a[1], b[1])))
                difference = _sum(a[0], _minus(b[0])), _sum(a[1], _minus(b[1]))
                _put(y, begin + half + k, difference)
        half *= 2


@njit
def _sine(x, angles):
    """Return sin 2πx, with an error of at most 18·2⁻¹⁰⁶; return NaN for |x| ≥ 2²⁴ or NaN.

    `angles` contains e^{2πii'/128}, 0 ≤ i < 128, where i' is the imaginary unit.
    """
    if not abs(x[0]) < 2.0**24:
        return np.nan, np.nan
    nearest = rint(_PARTS * x[0])
    r = two_sum(x[0] - nearest / _PARTS, x[1])  # both differences are exact
    square = _product(r, r)
    s, c = _SINE[_TERMS - 1, 0], _COSINE[_TERMS - 1, 0]
    for k in range(_TERMS - 2, _IN_PAIRS - 1, -1):
        s, c = s * square[0] + _SINE[k, 0], c * square[0] + _COSINE[k, 0]
    sine, cosine = (s, 0.0), (c, 0.0)
    for k in range(_IN_PAIRS - 1, -1, -1):
        sine = _sum((_SINE[k, 0], _SINE[k, 1]), _product(sine, square))
        cosine = _sum((_COSINE[k, 0], _COSINE[k, 1]), _product(cosine, square))
    at = _at(angles, int(nearest) & (_PARTS - 1))
    return _sum(_product(at[1], cosine), _product(at[0], _product(sine, r)))


# --- the residual ---------------------------------------------------------------------------------


@kernel
def _compute(u, strengths, shifts, turns, points, angles, first, E):
    """Set E to the modes of the residuals: see `residuals`."""
    _, n_nodes, n_sites, parts, K = u.shape
    n = len(turns)
    back, x, y = turns.copy(), np.empty((n, 4)), np.empty((n, 4))
    back[:, 2:] *= -1
    together = 2 if parts == 1 else 1  # two odd functions share one transform, as f + ig
    for node in range(n_nodes):
        for j in range(0, n_sites, together):
            both = parts == 1 and j + 1 < n_sites
            x[:] = 0.0
            for k in range(K):
                if parts == 1:  # f has the modes ia, g has ib
                    a = u[0, node, j, 0, k], u[1, node, j, 0, k]
                    b = (u[0, node, j + 1, 0, k], u[1, node, j + 1, 0, k]) if both else (0.0, 0.0)
                    here, there = (_minus(b), a), (b, _minus(a))
                else:
                    a = u[0, node, j, 0, k], u[1, node, j, 0, k]
                    b = u[0, node, j, 1, k], u[1, node, j, 1, k]
                    here, there = (a, b), (a, _minus(b))
                if k > 0:
                    _put(x, n - k, there)
                _put(x, k, here)
            _transform(x, turns, first, y)
            for i in range(n // 2 + 1 if parts == 1 else n):
                point, value = (points[i, 0], points[i, 1]), _at(y, i)
                real = _sine(_sum(point, value[0]), angles)
                imaginary = _sine(_sum(point, value[1]), angles) if both else (0.0, 0.0)
                if parts == 1 and i > 0:
                    _put(x, n - i, (_minus(real), _minus(imaginary)))
                _put(x, i, (real, imaginary))
            _transform(x, back, first, y)
            for k in range(n // 2):
                z = _at(y, k)
                if parts == 1:
                    E[0, node, j, 0, k], E[1, node, j, 0, k] = z[1]
                    if both:
                        E[0, node, j + 1, 0, k], E[1, node, j + 1, 0, k] = _minus(z[0])
                else:
                    E[0, node, j, 0, k], E[1, node, j, 0, k] = z[0]
                    E[0, node, j, 1, k], E[1, node, j, 1, k] = z[1]
        for j in range(n_sites):
            strength = _minus((strengths[0, node, j], strengths[1, node, j]))
            after, before = (j + 1) % n_sites, (j - 1) % n_sites
            for part in range(parts):
                for k in range(n // 2):
                    sine = E[0, node, j, part, k], E[1, node, j, part, k]
                    total = _product(strength, sine)
                    if k < K:
                        total = _sum(_linear(u, shifts, node, j, after, before, part, k), total)
                    E[0, node, j, part, k], E[1, node, j, part, k] = total


@njit
def _linear(u, shifts, node, j, after, before, part, k):
    """Return a mode of u_{j+1}(φ + α) - 2u_j(φ) + u_{j-1}(φ - α)."""
    turn = _at(shifts, k)
    own = -2 * u[0, node, j, part, k], -2 * u[1, node, j, part, k]
    if u.shape[3] == 1:  # terms in sin 2πkα cancel, as u_{j+1} = u_{j-1}
        a = u[0, node, after, 0, k], u[1, node, after, 0, k]
        b = _product(a, turn[0])
        return _sum(_sum(b, b), own)
    a = (
        (u[0, node, after, 0, k], u[1, node, after, 0, k]),
        (u[0, node, after, 1, k], u[1, node, after, 1, k]),
    )
    b = (
        (u[0, node, before, 0, k], u[1, node, before, 0, k]),
        (u[0, node, before, 1, k], u[1, node, before, 1, k]),
    )
    a, b = _complex_product(turn, a), _complex_product((turn[0], _minus(turn[1])), b)
    return _sum(_sum(a[part], b[part]), own)


def residuals(
    grids: "list[Grid]", u: FloatArray, errors: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute the residuals of many circles, and bounds on their errors.

    Parameters
    ----------
    grids : list of N Grid
        The forcings, on one grid of n = 2^m, 3·2^m or 5·2^m points.
    u : array, shape (2, N, P, parts, K)
        Modes of u_j, K ≤ n/2; see the module docstring.
    errors : array, shape (P, K)
        Bounds on |u - true u| for each mode, valid for all forcings.

    Returns
    -------
    E : array, shape (2, N, P, parts, n/2)
        Modes of the residuals; their sine terms are aliased.
    radii : array, shape (N, P, n/2)
        Bounds on |E - true E|; infinite where E is not finite.
    """
    grid, n = grids[0], grids[0].n
    first, parts = n // (n & -n), 1 if grid.odd else 2
    if not (first in (1, 3, 5) and 2 * u.shape[-1] <= n < 2**40 and u.shape[-2] == parts):
        raise ValueError(f"modes of shape {u.shape} do not fit a grid of n={n} points")
    strengths = np.array([[k / (2 * arb.pi()) for k in one.kappa] for one in grids], object)
    pairs = _table(strengths / n, relative=True)
    shifts = [acb(x) / 2 for x in grid.turn] if grid.odd else grid.turn
    E = np.empty((*u.shape[:4], n // 2))
    angles, _ = _grid_tables(_PARTS)
    _compute(u, pairs, _rows(shifts[: u.shape[-1]]), *_grid_tables(n), angles, first, E)
    radii = _radii(np.abs(strengths).astype(float), u, errors, n)
    radii[~np.isfinite(E).all(axis=(0, 3))] = np.inf
    return E, radii


@np.errstate(over="ignore", invalid="ignore")
def _radii(strengths: FloatArray, u: FloatArray, errors: FloatArray, n: int) -> FloatArray:
    """Bound the errors of the residuals; strengths are |κ_j|/2π, of shape (N, P)."""
    sizes = np.sqrt((u[0] ** 2).sum(axis=2))  # [node, j, k]; SLACK covers u[1]
    largest = 2 * sizes.sum(axis=2).max(axis=1)
    square = np.sqrt(2 * (sizes**2).sum(axis=(1, 2)))  # ≥ ‖Z‖₂ of each transform
    transform = (68 + 22 * log2(n)) * SQUARED_ULP
    values = transform * square + np.sqrt(2 * (errors**2).sum())
    angle = (5 + 3.01 * (1 + largest)) * SQUARED_ULP
    sine = 1.415 * (2 * pi * (values + angle) + 18 * SQUARED_ULP + transform)
    sine[~(largest < _LARGEST)] = np.inf
    radii = (strengths * (sine + 20 * SQUARED_ULP)[:, None])[..., None].repeat(n // 2, axis=2)
    for of, error in ((sizes, 31 * SQUARED_ULP), (errors[None], 1.0)):
        around = np.roll(of, 1, axis=1) + np.roll(of, -1, axis=1) + 2 * of
        radii[..., : u.shape[-1]] += error * around
    return SLACK * radii + UNDERFLOW


# --- tables and combinations ----------------------------------------------------------------------


def _pairs(numbers: Iterable["Ball"], relative: bool = False) -> list[tuple[float, float]]:
    """Round real balls to sums of two floats; raise if the error may exceed TABLE_ERROR/2."""
    result = []
    for x in numbers:
        high = float(x.mid())
        low = float((x - high).mid())
        most = TABLE_ERROR / 2 * (abs(x) if relative else 1) + arb(TINY)
        if not (abs(x - high - low) <= most and high + low == high):
            raise TooWideError(f"{x} is too wide for a sum of two floats")
        result.append((high, low))
    return result


def _table(numbers: NDArray[Any], relative: bool = False) -> FloatArray:
    """Return an array of real balls as sums of two floats."""
    pairs = np.array(_pairs(numbers.ravel().tolist(), relative))
    return np.ascontiguousarray(pairs.T.reshape(2, *numbers.shape))


def _rows(numbers: Iterable["Ball"]) -> FloatArray:
    """Return complex balls, |z| ≤ 1, as rows of four floats."""
    both = zip(*((z.real, z.imag) for z in numbers), strict=True)
    return np.hstack([np.array(_pairs(part)) for part in both])


@lru_cache(maxsize=8)
def _grid_tables(n: int) -> tuple[FloatArray, FloatArray]:
    """Return e^{2πii'/n} and i/n, 0 ≤ i < n, where i' is the imaginary unit."""
    with working_precision(160):
        turns = _rows([acb(arb(2 * i) / n).exp_pi_i() for i in range(n)])
        return turns, np.array(_pairs([arb(i) / n for i in range(n)]))


def combined(matrices: list[NDArray[Any]], x: FloatArray) -> FloatArray:
    """Return Σ A_im B_kl x_ml, where the entries of A and B are real balls with |z| ≤ 1.

    Parameters
    ----------
    matrices : two arrays of Ball, shapes (Q', Q) and (R', R)
    x : array, shape (2, Q·R, P, parts, K)

    Returns
    -------
    array, shape (2, Q'·R', P, parts, K)
        The sums; their errors are at most (18.2 + 3.02(Q + R)) 2⁻¹⁰⁶ Σ_ml |x_ml|.
    """
    shape, (A, B) = x.shape[2:], map(_table, matrices)
    Q, R = A.shape[2], B.shape[2]
    inner = np.empty((2, B.shape[1], Q, x[0, 0].size))
    # The axis to be summed over is moved to the front: [Q, R, ...] → [R', Q, ...] → [Q', R', ...].
    x = x.reshape(2, Q, R, -1).swapaxes(1, 2)
    _combine(B, np.ascontiguousarray(x), inner)
    result = np.empty((2, A.shape[1], B.shape[1], x.shape[-1]))
    _combine(A, np.ascontiguousarray(inner.swapaxes(1, 2)), result)
    return result.reshape(2, -1, *shape)


# --- modes as integers, as complex numbers and as balls -------------------------------------------


def from_integers(coefficients: list[Any], unit: int, odd: bool) -> FloatArray:
    """Convert the integers of a `BarrierProof` to modes, with relative errors up to 2⁻¹⁰⁶.

    Parameters
    ----------
    coefficients : list
        Entry [m][j] is [re, im]: the modes of a function are (re[k] + i im[k])·2^unit.
    unit : int
        Binary exponent.
    odd : bool
        True if all functions are odd.

    Returns
    -------
    array, shape (2, M, P, parts, K)

    Raises
    ------
    ValueError
        If a function is not real, or not odd although `odd` is true; or if `unit` is so small that
        floats underflow.
    """
    if unit < _MIN_UNIT:
        raise ValueError(f"unit={unit} must be at least {_MIN_UNIT}")
    size = max(1, *(len(part) for table in coefficients for row in table for part in row))
    result = np.zeros((2, len(coefficients), len(coefficients[0]), 2 - odd, size))
    for i, table in enumerate(coefficients):
        for j, row in enumerate(table):
            if any(row[1][:1]) or (odd and row[0]):
                raise ValueError("modes must be those of a real function, odd for one or two kicks")
            for part, numbers in enumerate(row[odd:]):
                high = [float(x) for x in numbers]
                low = [float(x - int(y)) for x, y in zip(numbers, high, strict=True)]
                result[:, i, j, part, : len(numbers)] = high, low
    return np.ldexp(result, unit)


def to_integers(modes: FloatArray, unit: int) -> list[list[list[int]]]:
    """Round modes of shape (2, P, parts, K) to integers times 2^unit, as in a `BarrierProof`."""
    high, low = np.ldexp(modes, -unit)
    whole = np.rint(high)
    rest = np.rint(high - whole + low)
    result: list[list[list[int]]] = []
    for rows in zip(whole.tolist(), rest.tolist(), strict=True):
        result.append([[]] if modes.shape[2] == 1 else [])
        for parts in zip(*rows, strict=True):
            numbers = [int(a) + int(b) for a, b in zip(*parts, strict=True)]
            while numbers and not numbers[-1]:
                numbers.pop()
            result[-1].append(numbers)
    return result


def parts_of(modes: ComplexArray, odd: bool) -> FloatArray:
    """Return the parts of complex modes, stacked along a new axis before the last one."""
    return np.stack([modes.imag] if odd else [modes.real, modes.imag], axis=-2)


def as_complex(parts: FloatArray) -> ComplexArray:
    """Return the complex modes with these parts."""
    result: ComplexArray = 1j * parts[..., -1, :]
    return result if parts.shape[-2] == 1 else result + parts[..., 0, :]


def moved(modes: FloatArray, step: FloatArray) -> FloatArray:
    """Add floats to sums of two floats."""
    total = modes[0] + step
    part = total - modes[0]
    low = (modes[0] - (total - part)) + (step - part) + modes[1]
    high = total + low
    return np.array([high, low - (high - total)])


def upper_sizes(modes: FloatArray) -> FloatArray:
    """Return upper bounds on the absolute values of modes, of shape (M, P, K)."""
    return np.hypot.reduce(modes[0], axis=-2, initial=0.0) * ROUNDED_UP


def as_balls(modes: FloatArray, radii: FloatArray) -> list[list[list["Ball"]]]:
    """Return balls around modes, as in `nasm.proofs.barrier`: nested lists over nodes, sites and k.

    Parameters
    ----------
    modes : array, shape (2, N, P, parts, K)
    radii : array that is broadcast to the shape (N, P, K)
        Bounds on the errors of the modes.
    """
    radii = (np.abs(modes[1]) + radii[..., None, :]) * ROUNDED_UP
    balls = [
        [
            [[arb(a, r) for a, r in zip(*both, strict=True)] for both in zip(*parts, strict=True)]
            for parts in zip(*rows, strict=True)
        ]
        for rows in zip(modes[0].tolist(), radii.tolist(), strict=True)
    ]
    if modes.shape[3] == 1:
        return [[[-x for x in parts[0]] for parts in rows] for rows in balls]
    return [[[*map(acb, *parts)] for parts in rows] for rows in balls]
