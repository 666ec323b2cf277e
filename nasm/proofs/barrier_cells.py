"""A barrier exists under every forcing of a cell of the (κ1, κ2) plane: one circle, moved along.

    κ_j = k_j + σ_j h,    u_j(φ; σ) = u_j(φ) + Δ_j,    Δ_j = Σ_m C_jm(φ) T_m0(σ_0) T_m1(σ_1),

|σ_j| ≤ 1. u_j is the circle of the cell's centre, the T_m are Chebyshev's polynomials, and m_0 +
m_1 < Q. For every σ the theorem of `nasm.proofs.barrier` applies if its constants hold for all σ at
once: n_j, p_j, k_j by sums over m, as |T_m| ≤ 1, and the residual by its values at Chebyshev's Q²
points σ_i,

    ‖E_j(σ)‖ ≤ Λ² max_i ‖E_j(σ_i)‖ + (1 + Λ) 4B_j r^-Q/(1 - 1/r),        Λ = 1 + (2/π) log Q,

as all of E_j is of degree < Q in each σ but (κ_j/2π) sin 2πg_j. B_j is a bound of that where both σ
are in the ellipse with foci ±1 whose half axes have the sum r. See proofs/README.md, "A barrier
exists".

The residual of the centre is in balls. What a point of the cell adds to it is small, so that long
doubles are enough for it, with an error bound made beforehand: with s, c = sin, cos 2πg_j,

    κ_j sin 2π(g_j + Δ_j) - k_j s = (κ_j - k_j) s + κ_j (c sin 2πΔ_j - s (1 - cos 2πΔ_j)).

What a proof rests on: the functions from `_transform` to `_verified`, as in `nasm.proofs.barrier`.
"""

from dataclasses import dataclass, field
from functools import lru_cache, partial
from math import ceil, inf, log, log2, nan, pi

import numpy as np

from nasm import circles
from nasm.checks import real
from nasm.maps import forcing
from nasm.numbers import RotationNumber, checked
from nasm.proofs.barrier import (
    Grid,
    both_sides,
    concluded,
    correction,
    decay,
    need_flint,
    norm,
    refined,
    slope_modes,
    slopes_on_grid,
    turns,
)
from nasm.proofs.certificates import certificate, in_hex

__all__ = ["BarrierCellProof", "prove_cell"]
__dir__ = __all__.copy

try:
    from flint import acb, arb, ctx
except ImportError:  # the extra `proof`
    arb = None

_LONG, _UNIT = np.longdouble, 2.0**-64  # its rounding, or more
_POINTS = 20  # of the grid, times the rate of decay of u; a power of 2 is taken
_NEAREST = 0.0065  # rate of decay of u, at 3% of the breakup: rounding is too large nearer to it
_KEPT = 54  # modes of C_jm are kept to e^-54
_FEW, _MOST = 6, 30  # Chebyshev points for each strength, at first and at most
_LARGEST = 0.45  # decay of C from |m| to |m| + 1: where it is slower, the cell is left
_WIDEST = 0.55
"""‖Δ_j'‖‖1/g_j'‖, about, for the least ρ: wider cells are left. It was up to 0.49 where a proof was
found, in 60 cells of a map, and above 0.55 in 8 of 15 where none was."""
_MARGIN = 1 / 40
"""The largest ratio, of 1/32, with which a cell is called proved: the bounds of the certificate's
checker are its own, and were 1.15 times as large where it failed to confirm one, of 988."""
_PARTS, _RHOS = np.array([0.5, 0.6, 0.75]), np.geomspace(0.06, 0.3, 7)
"""Tried: ρ̂ in parts of the rate of decay, ρ in parts of ρ̂."""
_SMALL = 2e-11  # times the fifth power of the rate: where C_jm ends
_STEPS = 8
_GRAIN = 2.0**-76  # of which C_jm are multiples, so that certificates are short


@dataclass(frozen=True)
class BarrierCellProof:
    """Whether a rotational invariant circle of omega is proved to exist for all of a cell.

    proved, why, omega, n, rho, constants : as of a `BarrierProof`, for all forcings at once.
    kappa : tuple of two floats, the centre. half_width : float; the cell is |κ_j - kappa_j| ≤ it.
    centre : its modes, as of a `BarrierProof`. moves : ndarray (2, Q, Q, K) of long doubles, the
    modes of C_jm, index j, m_0, m_1, k.
    """

    proved: bool
    why: str
    omega: RotationNumber
    kappa: tuple[float, float]
    half_width: float
    n: int = 0
    rho: float = nan
    constants: dict = field(default_factory=dict, repr=False)
    centre: list = field(default_factory=list, repr=False)
    moves: np.ndarray | None = field(default=None, repr=False)

    def certificate(self):
        """What another program needs to check the proof: see proofs/README.md, "Certificates".

        ValueError if nothing was proved.
        """
        half_width = (self.half_width,) * 2
        numbers = [] if self.moves is None else np.rint(self.moves / _GRAIN)
        fields = {
            "kappa": in_hex(self.kappa),
            "half_width": in_hex(half_width),
            "omega": str(self.omega),
            "rho": self.rho.hex(),
            "centre": [[[int(part) for part in x.man_exp()] for x in row] for row in self.centre],
            "moves": {
                "unit": round(log2(_GRAIN)),
                "numbers": [
                    [[list(map(int, np.trim_zeros(row, "b"))) for row in rows] for rows in table]
                    for table in numbers
                ],
            },
        }
        cell = self.kappa, half_width, self.omega
        return certificate(self, "A barrier exists in a cell", fields, *cell)


def prove_cell(omega, kappa, half_width):
    """Prove that the circle of omega exists under every forcing of a cell.

    1. The circle of the centre, refined and verified in balls, as `barrier.prove` does.
    2. Circles at a few Chebyshev points. From the decay of their coefficients in m, Q; a cell in
       which they decay too slowly is left.
    3. Circles at the Q² points, from the polynomial through those; their coefficients are C.
    4. The residuals of the polynomial at the Q² points, and the theorem with them.

    Parameters
    ----------
    omega : RotationNumber for a period of two kicks, irrational.
    kappa : two floats, the centre. half_width : float > 0.

    Returns
    -------
    BarrierCellProof. proved=False means nothing. Some 0.3 s far from the breakup, 3 s at 3% of it.

    ImportError without python-flint. ValueError if an argument is out of range. RuntimeError where
    long doubles have not 64 bits.
    """
    kappa, half_width = forcing(kappa), real("half_width", half_width)
    if kappa.size != 2:
        raise ValueError(f"kappa={kappa.tolist()}: the centre of a cell has two strengths")
    if not 0 < half_width < inf:
        raise ValueError(f"half_width={half_width!r} must be positive")
    omega = checked(omega)
    if omega.is_rational:
        raise ValueError(f"omega={omega} is rational, so its circles are no barriers")
    need_flint()
    check_long_doubles()
    about = {"omega": omega, "kappa": tuple(kappa.tolist()), "half_width": half_width}

    def left(why):
        return BarrierCellProof(False, f"not proved: {why}", **about)

    circle = circles.invariant_circle(omega, kappa, 2**14)
    if not circle.certified:
        return left(f"no circle was found at the centre: {circle.status.value}")
    rate = decay(np.abs(np.fft.rfft(circle.u)).max(axis=0), 1e-6)
    if rate < _NEAREST:
        return left("the cell is too near to the breakup")
    n = max(128, 2 ** ceil(log2(_POINTS / rate)))
    with ctx.workprec(128):
        grid = Grid(omega, kappa.tolist(), 0.0, n)
        found = refined(grid, circle.u, int(_KEPT / (2 * pi * min(rate, 0.15))))
        if not found["proved"]:
            return left("the circle of the centre is not proved")
        rate = min(rate, _POINTS / 128)
        centre = _Centre(grid, half_width, rate, found["modes"], found["residual"])
        C = _moves(centre)
        if C is None:
            return left("the cell is too large for one polynomial")
        return BarrierCellProof(**about, n=n, centre=centre.modes, moves=C, **_verified(centre, C))


def check_long_doubles():
    """RuntimeError unless long doubles are rounded to nearest, to 64 bits or more."""
    one, unit = _LONG(1), _LONG(2) ** -63
    parts = [unit / 4, unit * 3 / 4]
    if not (one + unit > one and all(abs(one + part - one - part) <= unit / 4 for part in parts)):
        raise RuntimeError(
            "a proof for cells needs long doubles of 64 bits or more, as x86 processors have them"
        )


# --- the residual ---------------------------------------------------------------------------------


def _long(x):
    """A ball's middle, to one unit in the last place."""
    high = float(x.mid())
    return _LONG(high) + _LONG(float(x.mid() - arb(high)))


@lru_cache(maxsize=16)
def _roots(n):
    with ctx.workprec(128):
        roots = [acb(arb(-2 * i) / n).exp_pi_i() for i in range(n // 2)]
        return np.array([_long(root.real) + 1j * _long(root.imag) for root in roots])


def _transform(x):
    """Σ_i x_i e^{-2πiki/n}, k = 0, …, n - 1, along the first of two axes; n is a power of 2."""
    n, width = x.shape
    roots, half, stride = _roots(n).astype(x.dtype), n // 2, 1
    while half:
        x = x.reshape(2, half, stride * width)
        y = np.empty((half, 2, stride * width), x.dtype)
        np.add(x[0], x[1], out=y[:, 0])
        np.subtract(x[0], x[1], out=y[:, 1])
        if half > 1:
            y[:, 1] *= roots[::stride, None]
        x, half, stride = y, half // 2, 2 * stride
    return x.reshape(n, width)


class _Centre:
    """A cell about a circle in balls: what the residuals in the cell need again and again."""

    def __init__(self, grid, half_width, rate, modes, residual):
        self.grid, self.half_width, self.rate = grid, half_width, rate
        self.modes, self.residual = modes, residual
        self.n, self.kappa = grid.n, [float(k) for k in grid.kappa]
        tables = [
            [(a + 2 * x).sin_cos_pi() for a, x in zip(grid.angles, row, strict=True)]
            for row in grid.samples(modes)
        ]
        # At 0 < φ < 1/2: beyond it the functions are odd and even.
        self.sine, self.cosine = (
            np.array([[_long(x[i]) for x in row[1:]] for row in tables]) for i in (0, 1)
        )
        self.turn = np.array([_long(x) for x in grid.turn])
        self.phase = turns(grid.omega, 2, self.n // 2 + 1)
        self.u = np.array([[float(x) for x in row] for row in modes])
        near = np.fft.rfft(1 / slopes_on_grid(-1j * self.u, self.n))[:, :-1].real / self.n
        self.near = np.where(np.abs(near) < 1e-13, 0, near)

    def inverse(self, rho):
        """‖d_j‖, about, of d_j near 1/g_j'."""
        return 2 * (np.abs(self.near) * np.exp(2 * pi * rho * np.arange(self.n // 2))).sum(axis=1)

    def residuals(self, b, sigma, dtype):
        """Modes 0, …, n/2 - 1 of what E_j has besides the centre's, shape (2, nodes, n/2); NaN if
        2π|Δ| > 1/4 somewhere.

        b : modes of Δ_j, (2, nodes, K). sigma : (2, nodes). As in û_k = -i b_k, all are real.
        """
        n, (_, nodes, K) = self.n, b.shape
        tables = (self.sine, self.cosine, np.array(self.kappa), self.turn[:K])
        sine, cosine, strength, turn = (x.astype(dtype) for x in tables)
        b, two_pi = b.astype(dtype), dtype(_long(2 * arb.pi()))
        moved = dtype(self.half_width) * sigma.astype(dtype)
        transform = _transform if dtype is _LONG else partial(np.fft.fft, axis=0)
        E, width = np.empty((2, nodes, n // 2), dtype), max(1, 2**14 // n)
        for first in range(0, nodes, width):  # a part that stays in the cache
            part = slice(first, first + width)
            z = np.zeros((n, b[0, part].shape[0]), np.result_type(dtype, np.complex64))
            z[1:K] = (1j * b[0, part, 1:] - b[1, part, 1:]).T  # Δ_0 + iΔ_1 at -k: it is odd
            z[: n - K : -1] = -z[1:K]
            odd = transform(z)
            odd = (odd[1 : n // 2] - odd[: n // 2 : -1]) / 2
            for j, delta in enumerate((odd.real, odd.imag)):
                y = two_pi * delta
                if not np.abs(y).max() <= 0.25:
                    return np.full_like(E, nan)
                s, c = sine[j, :, None], cosine[j, :, None]
                k = strength[j] + moved[j, part]
                delta[:] = moved[j, part] * s + k * (c * (y * _series(y, 2)) - s * _versine(y))
            z[1 : n // 2], z[: n // 2 : -1], z[n // 2] = odd, -odd, 0
            z = transform(z)[: n // 2] / (n * two_pi)
            E[0, part], E[1, part] = z.imag.T, -z.real.T
        E[:, :, :K] += turn * b[::-1] - 2 * b
        return E


def _series(y, first):
    """1 - y²/(f(f+1)) (1 - y²/((f+2)(f+3)) (1 - …)): sin y/y for f = 2, 2(1 - cos y)/y² for 3."""
    y2, total = y * y, 1
    for i in range(first + 10, first - 1, -2):
        total = 1 - y2 / (i * (i + 1)) * total
    return total


def _versine(y):
    return y * y / 2 * _series(y, 3)


# --- the theorem, for all of a cell ---------------------------------------------------------------


def _chebyshev(n, m):
    """T_m at the n Chebyshev points, a matrix (n, m) of long doubles."""
    with ctx.workprec(128):
        return np.array(
            [[_long((arb(i * (2 * j + 1)) / (2 * n)).cos_pi()) for i in range(m)] for j in range(n)]
        )


def _nodes(n):
    """σ at the n² points, (2, n²)."""
    x = _chebyshev(n, 2)[:, 1]
    return np.array([np.repeat(x, n), np.tile(x, n)])


def _at(C, n):
    """The polynomials at the n² points: (2, Q, Q, K) to (2, n², K)."""
    T = _chebyshev(n, C.shape[1])
    values = T @ (T @ np.moveaxis(C, 3, 1).swapaxes(2, 3)).swapaxes(2, 3)
    return np.moveaxis(values, 1, 3).reshape(2, n * n, -1)


def _coefficients(b):
    """C of the polynomial through values at the Q² points; those of |m| ≥ Q are left out."""
    Q = round(b.shape[1] ** 0.5)
    T = 2 * _chebyshev(Q, Q).T / Q
    T[0] /= 2
    values = np.moveaxis(b.reshape(2, Q, Q, -1), 3, 1)
    C = T @ (T @ values.swapaxes(2, 3)).swapaxes(2, 3)
    C[..., np.add.outer(range(Q), range(Q)) >= Q] = 0
    return np.moveaxis(C, 1, 3)


def _above(x):
    """A ball above a sum of numbers ≥ 0, x as computed; 10⁻⁹ is for the sum's rounding."""
    return arb(float(np.nextafter(float(x) * (1 + 1e-9), inf)))


def _weights(rho, n):
    """Upper bounds of e^{2πρk}, k = 0, …, n - 1: each factor is 10⁻⁹ too large."""
    factors = np.full(n, float(_above((2 * arb.pi() * rho).exp().upper())))
    factors[0] = 1
    return np.cumprod(factors)


class _Sizes:
    """Bounds of modes in all of the cell, from which `_constants` makes norms.

    u : |û_k| of the centre, (2, L). moves : Σ |C_jm|, |m| = t, (t, j, k). E : max_i |E_j| at the Q²
    points, (2, n/2), but for rounding. spread : bound of (Σ_j Σ_k |Δ_j|²)^½ there.
    """

    def __init__(self, centre, C):
        self.Q = Q = C.shape[1]
        degrees, b = np.add.outer(range(Q), range(Q)), _at(C, Q)
        self.centre, self.C = centre, C
        self.kappa = [arb(abs(k)) + arb(centre.half_width) for k in centre.kappa]
        self.u = _abs_upper(centre.modes)
        sums = [np.abs(C)[:, degrees == t].sum(axis=1) for t in range(2 * Q - 1)]
        self.moves = np.array(sums).astype(float)
        self.E = np.abs(centre.residuals(b, _nodes(Q), _LONG)).max(axis=1)
        self.E += _abs_upper(centre.residual)
        self.spread = _above(np.sqrt(2 * (b**2).sum(axis=(0, 2)).max()))


def _abs_upper(rows):
    return np.array([[float(x.abs_upper()) for x in row] for row in rows])


def _rounding(sizes):
    """(Σ_j Σ_k |error of mode k of E_j|²)^½ at a point, from the transforms and the sine."""
    half_width, strength = sizes.centre.half_width, sizes.kappa[0].max(sizes.kappa[1])
    size = arb(half_width) / arb.pi() + strength * sizes.spread
    return (11 * (sizes.centre.n.bit_length() - 1) + 16) * arb(_UNIT) * size


def _beyond(rho, hat, cut, n):
    """Bound of what a sum to |k| < cut misses with n points: all from cut on, and aliases, of a
    function whose ‖.‖_ρ̂ is 1; ρ̂ = hat.
    """
    two_pi = 2 * arb.pi()
    return (two_pi * (rho - hat) * cut).exp() + (two_pi * (rho * cut - hat * (n - cut))).exp()


def _constants(sizes, rho, hat):
    """Lists of n_j, k_j, ‖E_j‖ and ‖Δ_j'‖: bounds for all of the cell with this ρ; ρ̂ = hat."""
    if not 0 < rho < hat:
        raise ValueError(f"rho={rho}, rho_hat={hat} are out of range")
    centre, n, two_pi, unit = sizes.centre, sizes.centre.n, 2 * arb.pi(), arb(_UNIT)
    (T, _, K), (_, L), Q = sizes.moves.shape, sizes.u.shape, sizes.Q
    k, w, w_hat = np.arange(L), _weights(rho, n // 2), _weights(hat, L)
    radii, E = np.geomspace(2, 64, 40), sizes.E.astype(float)
    powers = radii[:, None] ** np.arange(T)
    moves = 2 * (sizes.moves * w[:K]).sum(axis=2)
    both, Lambda = _above(moves.sum()), 1 + 2 / arb.pi() * arb(Q).log()
    rounding = _rounding(sizes)
    found = {"n": [], "k": [], "error": [], "moved": []}
    for j, strength in enumerate(sizes.kappa):
        u, move = rho + _above(2 * (sizes.u[j] * w[:L]).sum()), _above(moves[:, j].sum())
        u_hat = hat + _above(2 * (sizes.u[j] * w_hat).sum())
        u_hat += _above(2 * (sizes.moves[:, j] * w_hat[:K]).sum())
        moved = two_pi * _above(2 * (sizes.moves[:, j] * (k * w[:L])[:K]).sum())
        found["moved"].append(moved)
        found["n"].append(1 + two_pi * _above(2 * (sizes.u[j] * k * w[:L]).sum()) + moved)
        found["k"].append((two_pi * (u + move)).exp())

        force = strength / two_pi * (two_pi * u_hat).exp()  # of the sine, for ρ̂
        cut = float((force / rounding).log().mid()) / (2 * pi * hat)
        cut = int(min(max(cut, L), n // 2)) if cut < inf else n // 2
        beyond = force * _beyond(arb(rho), arb(hat), cut, n)
        noise = _above(2 * np.sqrt((w[:cut] ** 2).sum())) * rounding
        noise += unit * (32 + (4 + 2 * strength * found["k"][j]) * (2 * Q + 8)) * both
        at_points = _above(2 * (E[j, :cut] * w[:cut]).sum()) + noise + beyond

        between = arb.pos_inf()
        for r, grown in zip(radii.tolist(), powers @ moves[:, j], strict=True):
            grown = (two_pi * (u + _above(grown))).exp()
            B = (abs(arb(centre.kappa[j])) + arb(centre.half_width) * r) / two_pi * grown
            tail = 4 * (1 + Lambda) * B * arb(r) ** -Q / (1 - 1 / arb(r))
            between = tail if tail < between else between
        found["error"].append(Lambda**2 * at_points + between)
    return found


def _bound_of_the_inverse(sizes, j, rho):
    """p_j ≥ ‖1/g_j'‖ for all of the cell, by d near that of the centre; inf if it is poor.

    C_jm' d is multiplied out for |m| ≤ 2.
    """
    near, K = sizes.centre.near[j], sizes.moves.shape[2]
    weighted = np.abs(near) * np.exp(2 * pi * rho * np.arange(near.size))
    many = int((weighted[::-1].cumsum()[::-1] > 1e-5 * weighted.sum()).sum())
    slopes = 4 * pi * (sizes.moves[3:, j] * np.arange(K) * _weights(arb(rho), K)).sum()
    with ctx.workprec(64):
        rho, d = arb(rho), [arb(x) for x in near[:many].tolist()]
        size, both = norm([abs(x) for x in d], rho), both_sides(d, True)
        small = size * _above(slopes)
        rows = [slope_modes(sizes.centre.modes[j], True)]
        for m in ((0, 0), (0, 1), (1, 0), (0, 2), (1, 1), (2, 0)):
            exact = [arb(float(x)) + arb(float(x - _LONG(float(x)))) for x in sizes.C[j][m]]
            rows.append([arb(0), *slope_modes(exact, True)[1:]])
        for i, row in enumerate(rows):
            product, middle = both_sides(row, True) * both, len(row) + many - 2
            modes = [product[middle + k] for k in range(middle + 1)]
            modes[0] -= 1 if i == 0 else 0  # 1 - g_j'd of the centre
            small += norm([x.abs_upper() for x in modes], rho)
        return size / (1 - small) if small < 1 else arb.pos_inf()


@np.errstate(all="ignore")  # NaN and inf fail the comparisons at the end
def _verified(centre, C):
    """Try to verify the theorem for all of the cell; a dict of what came out.

    Floats choose ρ, ρ̂, r, the cut and d; any choice is sound.
    """
    sizes = _Sizes(centre, C)

    def with_widths(rho, hat, inverse):
        found = _constants(sizes, arb(rho), hat)
        numbers = found["error"], found["n"], inverse(rho, found["moved"]), found["k"]
        return concluded(centre.grid.omega, sizes.kappa, arb(rho), *numbers)

    def guessed(rho, moved):
        size, moved = centre.inverse(rho), np.array(moved, dtype=float)
        return [arb(x) for x in (size / np.maximum(1 - 0.7 * moved * size, 0.01)).tolist()]

    best, chosen = inf, None
    for hat in (centre.rate * _PARTS).tolist():
        for rho in (hat * _RHOS).tolist():
            left = with_widths(rho, hat, guessed)["constants"]
            worst = max(32 * left["ratio"], 100 * left["room"])
            if worst < best:
                best, chosen = worst, (rho, hat)
    if not best < 10:
        return {"proved": False, "why": f"not proved: the residual is {best:.1e} times too large"}
    bounded = partial(_bound_of_the_inverse, sizes)
    found = with_widths(*chosen, lambda rho, _: [bounded(j, rho) for j in (0, 1)])
    if found["proved"] and not found["constants"]["ratio"] < _MARGIN:
        why = "not proved: with so small a margin that its checker may not confirm it"
        found |= {"proved": False, "why": why}
    return found


# --- what need not be right: the polynomial -------------------------------------------------------


@np.errstate(all="ignore")
def _moves(centre):
    """C of the circles of the cell; None if there are none, or C decays too slowly in |m|."""
    K = min(centre.u.shape[1], int(_KEPT / (2 * pi * centre.rate)))
    b = _circles(centre, np.zeros((2, _FEW**2, K), _LONG), 1e-8)
    if b is None:
        return None
    C = np.abs(_coefficients(b))
    rho = _PARTS[0] * _RHOS[0] * centre.rate
    moved = (C.sum(axis=(1, 2)) * np.arange(K) * _weights(arb(rho), K)).sum(axis=1)
    if (4 * pi * moved * centre.inverse(rho)).max() > _WIDEST:
        return None
    C = C.sum(axis=(0, 3))  # the degrees of what leads and what ends it
    first, last = (np.trace(C[::-1], t - _FEW + 1) for t in (1, _FEW - 1))
    decay_in_m = float(last / first) ** (1 / (_FEW - 2))
    if not decay_in_m < _LARGEST:
        return None
    Q = max(_FEW, 1 + ceil(log(_SMALL * centre.rate**5 / float(first)) / log(decay_in_m)))
    b = _circles(centre, _at(_coefficients(b), Q), 1e-15) if Q <= _MOST else None
    if b is None:
        return None
    C = _coefficients(b + _step(centre, b, centre.residuals(b, _nodes(Q), _LONG)))
    return np.rint(C / _GRAIN) * _GRAIN


def _circles(centre, b, small):
    """Newton's method in doubles at Chebyshev points, from b; None if it fails."""
    last, sigma = inf, _nodes(round(b.shape[1] ** 0.5))
    for _ in range(_STEPS):
        E = centre.residuals(b, sigma, float)
        size = np.abs(E).max()
        if not size < 0.5 * last:
            return b if last < 1e-12 else None
        b, last = b + _step(centre, b, E), size
        if size < small:
            return b
    return None


def _step(centre, b, E):
    """Newton's step; from all modes of E, those at the end would grow with each step."""
    size, K = np.abs(E).max(), b.shape[2]
    modes, E = b.astype(float) + centre.u[:, None, :K], (E / size).astype(float)[..., : K * 4 // 5]
    return -size * correction(centre.phase, -1j * modes, -1j * E)[..., :K].imag
