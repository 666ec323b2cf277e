"""A barrier exists under every forcing of a fan: κ = s(a + tb), low ≤ s ≤ high, |t| ≤ 1.

Fans with one a and b, each of which begins at the s where the last one ended, fill a triangle from
κ = 0 on. Where b = 0 they are a ray. In one of them

    u_j(φ; s, t) = Σ_{m<Q, l<R} C_jml(φ) T_m(σ) T_l(t),    s = (low + high)/2 + σ (high - low)/2,

|σ| ≤ 1, T_m being Chebyshev's polynomials. For every s and t the theorem of `nasm.proofs.barrier`
applies if its constants hold for all σ and t at once: n_j and k_j by sums over m and l, p_j by what
g_j' differs from that at the nearest of Q·R Chebyshev points, and the residual, taken in balls, by

    ‖E_j‖ ≤ Λ_Q Λ_R max ‖E_j‖ at the points + what they miss,        Λ_Q = 1 + (2/π) log Q.

So no weaker kicks are left out: that a circle might break and come back on the way is ruled out.
See proofs/README.md, "A fan". What a proof rests on: `_Fan`, and what it uses of
`nasm.proofs.barrier`. How C was found does not matter.
"""

import time
from dataclasses import dataclass, field
from itertools import product
from math import ceil, floor, inf, log, log2, nan, pi, sqrt

import numpy as np

from nasm import circles
from nasm.checks import real
from nasm.maps import direction, forcing
from nasm.numbers import RotationNumber, checked
from nasm.proofs.barrier import (
    KEPT,
    Grid,
    as_balls,
    best_widths,
    bound_of_the_inverse,
    bounds_of_the_residual,
    concluded,
    fast_size,
    grid_size,
    max_of,
    near_the_inverse,
    need_flint,
    norm,
    polished,
    residual,
    slope_modes,
    stepped,
    turns,
)
from nasm.proofs.certificates import certificate, in_hex
from nasm.symmetries import shorten

__all__ = ["BarrierFanProof", "covered", "proved_below"]
__dir__ = __all__.copy

try:
    from flint import acb, acb_mat, arb, arb_mat, ctx
except ImportError:  # the extra `proof`
    arb = None

_NARROWEST = 0.9  # an interval ends at this part of the way to the breakup from its start, at most
_WIDEST = 0.5  # and at least
_EPSILON, _POWER = 3e-19, 6.3  # ε that is small enough at 1% of the breakup; it falls so with it
_FINER = 1.1  # as many points as for one forcing
_FEWEST, MOST = 8, 64  # points in s, and in t
_TRIED = 10  # points across a fan to begin with
_SLOWER = 1.25  # than in proportion to 1/distance
_PART = 0.8
"""The part of the theorem's right sides below which a fan is called proved: the bounds of the
checker of its certificate are its own (1.15 times as large for one of 988 cells of forcings)."""


@dataclass(frozen=True)
class BarrierFanProof:
    """Whether a circle of omega is proved to exist under s(kappa + t·tilt) for all s from low to
    high and all t from -1 to 1.

    proved, why, omega, kappa, short_omega, short_kappa, n, rho, constants : as of a `BarrierProof`,
    for all s and t at once; nothing is shortened where tilt is not 0. tilt : tuple, of as many
    numbers as short_kappa. low, high : floats.
    unit : int, and moves : list [m][l][j] of [re, im], lists of ints: C_jml has the modes
    (re[k] + i im[k])·2^unit, k ≥ 0; what is not in a list is 0.
    """

    proved: bool
    why: str
    omega: RotationNumber
    kappa: tuple[float, ...]
    tilt: tuple[float, ...]
    low: float
    high: float
    short_omega: RotationNumber
    short_kappa: tuple[float, ...]
    n: int = 0
    rho: float = nan
    constants: dict = field(default_factory=dict, repr=False)
    unit: int = 0
    moves: list = field(default_factory=list, repr=False)

    def certificate(self):
        """What another program needs to check the proof: see proofs/README.md, "Certificates".

        ValueError if nothing was proved.
        """
        scales = self.low, self.high
        fields = {
            "shortened_from": {"omega": str(self.omega), "kappa": in_hex(self.kappa)},
            "omega": str(self.short_omega),
            "kappa": in_hex(self.short_kappa),
            "tilt": in_hex(self.tilt),
            "scales": in_hex(scales),
            "rho": self.rho.hex(),
            "moves": {"unit": self.unit, "numbers": self.moves},
        }
        return certificate(
            self, "A barrier exists in a fan", fields, self.kappa, self.tilt, self.omega, scales
        )


def proved_below(omega, profile, value, budget, tilt=None, nearest=1e-4):
    """The scale up to which the circle of omega is proved to exist on all of a ray, or in all of a
    triangle, from 0 on.

    Parameters
    ----------
    omega : RotationNumber or its text, for a period of the profile; irrational.
    profile : sequence of P floats, not all 0.
    value : float > 0, where the circle breaks, e.g. by `periodic.critical_scale`; the least such
        scale in a triangle. It says only where to look.
    budget : float, CPU seconds to spend, as nearly as can be foreseen. With two kicks 2 s reach
        0.97 of the breakup, 12 s 0.99, 27 s 0.996, 50 s 0.997; with three 13 s reach 0.984.
    tilt : sequence of P floats; the triangle is that of the rays profile + t·tilt, -1 ≤ t ≤ 1.
    nearest : float, distance to the breakup, in parts of it, that is near enough.

    Returns
    -------
    scale : float; a circle exists under s(profile + t·tilt) for all real s and t, 0 ≤ s ≤ scale.
        Rounded to floats, forcings lie beside them by some 10⁻¹⁶, where nothing is proved by that.
    proofs : list of BarrierFanProof, by which it does, with their certificates.

    ImportError without python-flint; ValueError for a bad argument.
    """
    omega, profile = checked(omega), direction(profile)
    value, budget = real("value", value), real("budget", budget)
    if not 0 < value < inf:
        raise ValueError(f"value={value!r} must be positive: the scale at which the circle breaks")
    need_flint()
    short, short_omega = profile, omega
    if tilt is None:
        (short,), short_omega = shorten([profile], omega)
    tilt = np.zeros(short.size) if tilt is None else forcing(tilt)
    if tilt.shape != short.shape:
        raise ValueError(f"tilt={tilt.tolist()} must have a number for each kick of the profile")
    about = {"omega": omega, "kappa": tuple(profile.tolist()), "tilt": tuple(tilt.tolist())}
    about |= {"short_omega": short_omega, "short_kappa": tuple(short.tolist())}
    reached, proofs, part, until, pace = 0.0, [], _WIDEST, time.thread_time() + budget, 0.0
    while part <= _NARROWEST and not omega.is_rational:
        before = time.thread_time()
        # The work goes like 1/distance; where it is too much, not so near.
        foreseen = _SLOWER * pace / max(until - before, 1e-9)
        distance = max((1 - reached / value) * part, foreseen, nearest)
        if not distance < _NARROWEST * (1 - reached / value):
            break
        high = value * (1 - distance)
        proof = _proved_between(reached, high, value, about)
        if proof.proved:
            reached, part = high, max(_WIDEST, part**1.5)
            proofs.append(proof)
        else:
            part = sqrt(part)
        pace = (time.thread_time() - before) * distance
    return reached, proofs


def covered(intervals):
    """The scale up to which all s ≥ 0 are in one of the intervals (low, high)."""
    reached = 0.0
    for low, high in sorted(intervals):
        if low <= reached:
            reached = max(reached, high)
    return reached


def _proved_between(low, high, value, about):
    """Try to prove the circle for low ≤ s ≤ high, below the breakup at value."""
    about = about | {"low": low, "high": high}
    omega, profile, tilt = (about[key] for key in ("short_omega", "short_kappa", "tilt"))
    middle, half, distance = (low + high) / 2, (high - low) / 2, 1 - high / value
    epsilon = _EPSILON * (distance / 0.01) ** _POWER / max(1, len(profile) - 1) ** 3
    x = (value - middle) / half
    Q = max(_FEWEST, ceil(-log(epsilon) / log(x + sqrt(x * x - 1))))
    most = min(2**16, 2 ** ceil(log2(128 + 32 / distance)))

    def circle(sigma, t):
        kappa = (middle + half * sigma) * (np.array(profile) + t * np.array(tilt))
        return circles.invariant_circle(omega, kappa, most)

    R, starts = _points_across(circle, epsilon) if any(tilt) else 1, []
    if max(Q, R) > MOST:
        return BarrierFanProof(False, "not proved: the fan is too wide", **about)
    for sigma in _points(Q).tolist():  # the nearest to the breakup first
        for t in _points(R).tolist():
            found = circle(sigma, t)
            if not found.certified:
                why = f"not proved: a circle was not found: {found.status.value}"
                return BarrierFanProof(False, why, **about)
            starts.append(found.u)
    n = fast_size(int(_FINER * max(map(grid_size, starts[:R]))))
    unit = floor(log2(epsilon / (1000 * n)))
    with ctx.workprec(128 if n < 2**18 else 160):
        fan = _Fan(omega, profile, tilt, low, high, n, Q, R)
        modes = fan.circles(starts)
        if modes is None:
            return BarrierFanProof(False, "not proved: Newton's method diverges", **about)
        moves = fan.moves(modes, unit)
        found = fan.verified(moves, unit)
    moves = [moves[first : first + R] for first in range(0, Q * R, R)]
    return BarrierFanProof(**about, n=n, unit=unit, moves=moves, **found)


def _points(Q):
    return np.cos(pi * (2 * np.arange(Q) + 1) / (2 * Q))


def _points_across(circle, epsilon):
    """R, by how fast the coefficients of circles at the far end decay in l."""
    found = [circle(1.0, t) for t in _points(_TRIED).tolist()]
    if not all(one.certified for one in found):
        return _TRIED
    K = min(one.u.shape[1] for one in found) // 2
    modes = np.array([np.fft.rfft(one.u)[:, :K] / one.u.shape[1] for one in found])
    sizes = [
        np.abs(np.tensordot(np.cos(m * np.arccos(_points(_TRIED))), modes, 1)).max() * 2 / _TRIED
        for m in range(_TRIED)
    ]
    later, last = max(sizes[3:5]), max(sizes[-2:])
    rate = (last / later) ** (1 / (_TRIED - 5))
    return max(_TRIED // 2, _TRIED + ceil(log(1e-3 * epsilon / last) / log(rate)))


class _Fan:
    """Forcings s(profile + t·tilt), low ≤ s ≤ high, |t| ≤ 1, at Chebyshev's Q·R points, in balls.

    A list has all points, or all degrees, t's running faster.
    """

    def __init__(self, omega, profile, tilt, low, high, n, Q, R):
        if not (0 <= low < high and 1 < Q <= MOST and 1 <= R <= MOST and (R > 1 or not any(tilt))):
            raise ValueError(f"low={low}, high={high}, Q={Q}, R={R} are out of range")
        self.profile, self.tilt = [arb(k) for k in profile], [arb(k) for k in tilt]
        self.shape = Q, R
        self.middle, self.half = (arb(low) + high) / 2, (arb(high) - low) / 2
        self.T = [_chebyshev(Q), _chebyshev(R)]
        grid = Grid(omega, profile, 0.0, n)
        self.grids = []
        for row, across in product(*self.T):
            s, t = self.middle + self.half * row[1], across[1] if R > 1 else arb(0)
            self.grids.append(
                grid.under([s * (a + t * b) for a, b in zip(self.profile, self.tilt, strict=True)])
            )
        self.odd, self.turn = grid.odd, turns(omega, grid.sites, n // 2 + 1)

    def circles(self, starts):
        """Modes of circles at the points, exact balls, a step of Newton's from values on grids;
        None if there are none."""
        found = []
        for grid, start in zip(self.grids, starts, strict=True):
            modes = polished(grid, self.turn, start, int(KEPT * grid.n))
            if not np.isfinite(modes).all():
                return None
            modes = as_balls(modes, self.odd)
            found.append(stepped(grid, self.turn, modes, residual(grid, modes)))
            if found[-1] is None:
                return None
        return found

    def _product(self, A, tables):
        """Σ A_mi A'_li' tables[i, i'], A being A, A', tables of P rows of equally many balls."""
        matrix, (Q, R) = arb_mat if self.odd else acb_mat, self.shape
        P, size = len(tables[0]), len(tables[0][0])
        flat = [x for table in tables for row in table for x in row]
        first, second = (matrix(len(B), len(B), [x for row in B for x in row]) for B in A)
        flat = (first * matrix(Q, R * P * size, flat)).entries()
        found = []
        for i in range(0, len(flat), R * P * size):
            rows = (second * matrix(R, P * size, flat[i : i + R * P * size])).entries()
            rows = [rows[k : k + size] for k in range(0, len(rows), size)]
            found += [rows[k : k + P] for k in range(0, len(rows), P)]
        return found

    def moves(self, modes, unit):
        """Whole numbers near C of the polynomial through these modes; see `BarrierFanProof`."""
        A = [
            [[(2 if m else 1) * row[m] / len(T) for row in T] for m in range(len(T))]
            for T in self.T
        ]
        return [[_whole(row, unit) for row in table] for table in self._product(A, modes)]

    def verified(self, moves, unit):
        """Try to verify the theorem for all s and t; a dict of what came out."""
        scale, size = arb(2) ** unit, max(len(part) for t in moves for row in t for part in row)
        C = [[_balls(row, size, scale, self.odd) for row in table] for table in moves]
        u = self._product(self.T, C)
        E = [residual(grid, modes) for grid, modes in zip(self.grids, u, strict=True)]
        sizes = [[[x.abs_upper() for x in row] for row in table] for table in C]
        return self._theorem(sizes, u, E)

    def _theorem(self, sizes, u, E):
        (grid, *_), two_pi = self.grids, 2 * arb.pi()
        Lambda, across = (1 + 2 / arb.pi() * arb(n).log() for n in self.shape)
        bounds = [[[[x.abs_upper() for x in row] for row in t] for t in part] for part in (u, E)]
        largest = [np.array(part, dtype=float).max(axis=0) for part in bounds]
        inverses = [near_the_inverse(grid, modes) for modes in u]
        chosen = best_widths(grid, *largest, np.abs(inverses[0]))
        rho = arb(chosen["rho"])
        errors = [
            bounds_of_the_residual(grid, *both, rho, arb(chosen["rho_hat"]), chosen["cuts"])
            for grid, *both in zip(self.grids, *bounds, strict=True)
        ]
        norms = [[norm(row, rho) for row in table] for table in sizes]  # [m][j]
        slopes = [
            [two_pi * norm([i * x for i, x in enumerate(row)], rho) for row in t] for t in sizes
        ]
        # |T_m(σ) - T_m(σ_i)| for the nearest σ_i: their angles differ by π/2Q or less.
        steps = [[2 * (arb(m) / (4 * n)).sin_pi() for m in range(n)] for n in self.shape]
        apart = [a + b for a, b in product(*steps)]
        n, p, k, eps = [], [], [], []
        for j in range(len(self.profile)):
            n.append(1 + sum(row[j] for row in slopes))
            k.append((two_pi * (rho + sum(row[j] for row in norms))).exp())
            moved = sum(a * row[j] for a, row in zip(apart, slopes, strict=True))
            of_points = []
            with ctx.workprec(64):
                for modes, near in zip(u, inverses, strict=True):
                    slope, d = slope_modes(modes[j], self.odd), near[j, : chosen["modes"]]
                    bound = bound_of_the_inverse(slope, d, rho, self.odd, chosen["kept"], moved)
                    of_points.append(bound)
            p.append(max_of(of_points))
            along, beside = self._between(rho, [row[j] for row in norms], j)
            eps.append(Lambda * (across * max_of([at[j] for at in errors]) + beside) + along)
        kappa = [(self.middle + self.half) * self._largest(j) for j in range(len(n))]
        return concluded(grid.omega, kappa, rho, eps, n, p, k, _PART)

    def _largest(self, j, t=1):
        return abs(self.profile[j]) + abs(self.tilt[j]) * t

    def _between(self, rho, norms, j):
        """What interpolation in σ, and that in t, misses of the sine, by the ellipses whose half
        axes have the sum r."""
        (Q, R), two_pi, found = self.shape, 2 * arb.pi(), []
        high = self.middle + self.half
        degrees = [*product(range(Q), range(R))]
        for axis, count in enumerate(self.shape):
            least = arb.pos_inf() if count > 1 else arb(0)  # nothing depends on t
            sums = [arb(0)] * count
            for m, x in zip(degrees, norms, strict=True):
                sums[m[axis]] += x
            for r in [arb(x) for x in np.geomspace(1.2, 40, 50)] if count > 1 else []:
                axes = (r + 1 / r) / 2
                s, t = (self.middle + self.half * axes, 1) if axis == 0 else (high, axes)
                size = rho + sum((r**m + r**-m) / 2 * x for m, x in enumerate(sums))
                B = s * self._largest(j, t) / two_pi * (two_pi * size).exp()
                bound = 4 * B * r**-count / (1 - 1 / r)
                least = bound if bound < least else least
            found.append(least)
        return found


def _chebyshev(Q):
    """T_m(σ_i), row i."""
    return [[(arb(m * (2 * i + 1)) / (2 * Q)).cos_pi() for m in range(Q)] for i in range(Q)]


def _whole(row, unit):
    """[re, im] of modes in whole numbers, times 2^unit."""
    if not isinstance(row[0], acb):  # they are -ib
        return [[], [-x for x in _rounded(row, unit)]]
    return [_rounded([x.real for x in row], unit), _rounded([x.imag for x in row], unit)]


def _rounded(balls, unit):
    numbers = []
    for x in balls:
        mantissa, exponent = (int(part) for part in x.mid().man_exp())
        shift = exponent - unit
        half = 1 << -shift - 1 if shift < 0 else 0
        numbers.append(mantissa << shift if shift >= 0 else mantissa + half >> -shift)
    while numbers and not numbers[-1]:
        numbers.pop()
    return numbers


def _balls(row, size, scale, odd):
    if any(row[1][:1]) or (odd and row[0]):
        raise ValueError("the modes of a real function are wanted, for two kicks of an odd one")
    re, im = ([*(x * scale for x in part), *[0] * (size - len(part))] for part in row)
    return [arb(-b) for b in im] if odd else [acb(a, b) for a, b in zip(re, im, strict=True)]
