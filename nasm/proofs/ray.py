"""A barrier exists under every forcing of a ray up to a scale: κ = s·profile, 0 ≤ s ≤ s_1.

Intervals of s, low ≤ s ≤ high, each of which begins where the last one ended. In one of them

    u_j(φ; s) = Σ_{m<Q} C_jm(φ) T_m(σ),      s = (low + high)/2 + σ (high - low)/2,     |σ| ≤ 1,

T_m being Chebyshev's polynomials. For every s the theorem of `nasm.proofs.barrier` applies if its
constants hold for all σ at once: n_j and k_j by sums over m, p_j by what g_j' differs from that at
the nearest of Chebyshev's Q points σ_i, and the residual, taken in balls, by

    ‖E_j(σ)‖ ≤ Λ max_i ‖E_j(σ_i)‖ + 4B_j r^-Q/(1 - 1/r),        Λ = 1 + (2/π) log Q.

So no weaker kicks are left out: that a circle might break and come back on the way is ruled out.
See proofs/README.md, "A whole ray". What a proof rests on: `_Interval`, and what it uses of
`nasm.proofs.barrier`. How C was found does not matter.
"""

import time
from dataclasses import dataclass, field
from math import ceil, floor, inf, log, log2, nan, pi, sqrt

import numpy as np

from nasm import circles
from nasm.checks import real
from nasm.maps import direction
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

__all__ = ["BarrierRayProof", "covered", "proved_below"]
__dir__ = __all__.copy

try:
    from flint import acb, acb_mat, arb, arb_mat, ctx
except ImportError:  # the extra `proof`
    arb = None

_NARROWEST = 0.9  # an interval ends at this part of the way to the breakup from its start, at most
_WIDEST = 0.5  # and at least
_EPSILON, _POWER = 3e-19, 6.3  # ε that is small enough at 1% of the breakup; it falls so with it
_FINER = 1.1  # as many points as for one forcing
_NEAREST = 1e-4  # of the breakup: some hours
_FEWEST, MOST = 8, 64  # points of an interval
_SLOWER = 1.25  # than in proportion to 1/distance


@dataclass(frozen=True)
class BarrierRayProof:
    """Whether a circle of omega is proved to exist under s·kappa for all s from low to high.

    proved, why, omega, kappa, short_omega, short_kappa, n, rho, constants : as of a `BarrierProof`,
    for all s at once. low, high : floats.
    unit : int, and moves : list [m][j] of [re, im], lists of ints: C_jm has the modes
    (re[k] + i im[k])·2^unit, k ≥ 0; what is not in a list is 0.
    """

    proved: bool
    why: str
    omega: RotationNumber
    kappa: tuple[float, ...]
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
            "scales": in_hex(scales),
            "rho": self.rho.hex(),
            "moves": {"unit": self.unit, "numbers": self.moves},
        }
        return certificate(
            self, "A barrier exists on a ray", fields, self.kappa, (), self.omega, scales
        )


def proved_below(omega, profile, value, budget):
    """The scale up to which the circle of omega is proved to exist on all of a ray, from 0 on.

    Parameters
    ----------
    omega : RotationNumber or its text, for a period of the profile; irrational.
    profile : sequence of P floats, not all 0.
    value : float > 0, where the circle breaks, e.g. by `periodic.critical_scale`. It says only
        where to look.
    budget : float, CPU seconds to spend, as nearly as can be foreseen. With two kicks 2 s reach
        0.97 of the breakup, 12 s 0.99, 27 s 0.996, 50 s 0.997; with three 13 s reach 0.984.

    Returns
    -------
    scale : float; a circle exists under s·profile for all real s, 0 ≤ s ≤ scale. Rounded to floats,
        s·profile lies beside the ray by some 10⁻¹⁶, where nothing is proved by that.
    proofs : list of BarrierRayProof, by which it does, with their certificates.

    ImportError without python-flint; ValueError for a bad argument.
    """
    omega, profile = checked(omega), direction(profile)
    value, budget = real("value", value), real("budget", budget)
    if not 0 < value < inf:
        raise ValueError(f"value={value!r} must be positive: the scale at which the circle breaks")
    need_flint()
    (short,), short_omega = shorten([profile], omega)
    about = {"omega": omega, "kappa": tuple(profile.tolist())}
    about |= {"short_omega": short_omega, "short_kappa": tuple(short.tolist())}
    reached, proofs, part, until, pace = 0.0, [], _WIDEST, time.thread_time() + budget, 0.0
    while part <= _NARROWEST and not omega.is_rational:
        before = time.thread_time()
        # The work goes like 1/distance; where it is too much, not so near.
        distance = max((1 - reached / value) * part, _SLOWER * pace / max(until - before, 1e-9))
        if not _NEAREST < distance < _NARROWEST * (1 - reached / value):
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
    omega, profile = about["short_omega"], np.array(about["short_kappa"])
    middle, half, distance = (low + high) / 2, (high - low) / 2, 1 - high / value
    epsilon = _EPSILON * (distance / 0.01) ** _POWER / max(1, profile.size - 1) ** 3
    x = (value - middle) / half
    Q = max(_FEWEST, ceil(-log(epsilon) / log(x + sqrt(x * x - 1))))
    if Q > MOST:
        return BarrierRayProof(False, "not proved: the interval is too wide", **about)
    scales = middle + half * np.cos(pi * (2 * np.arange(Q) + 1) / (2 * Q))
    starts = []
    most = min(2**16, 2 ** ceil(log2(128 + 32 / distance)))
    for scale in scales.tolist():  # the nearest to the breakup first
        circle = circles.invariant_circle(omega, scale * profile, most)
        if not circle.certified:
            why = f"not proved: a circle was not found: {circle.status.value}"
            return BarrierRayProof(False, why, **about)
        starts.append(circle.u)
    n = fast_size(int(_FINER * grid_size(starts[0])))
    unit = floor(log2(epsilon / (1000 * n)))
    with ctx.workprec(128 if n < 2**18 else 160):
        interval = _Interval(omega, profile.tolist(), low, high, n, Q)
        modes = interval.circles(starts)
        if modes is None:
            return BarrierRayProof(False, "not proved: Newton's method diverges", **about)
        moves = interval.moves(modes, unit)
        found = interval.verified(moves, unit)
    return BarrierRayProof(**about, n=n, unit=unit, moves=moves, **found)


class _Interval:
    """Forcings s·profile, low ≤ s ≤ high, at Chebyshev's Q points, in balls."""

    def __init__(self, omega, profile, low, high, n, Q):
        if not (0 <= low < high and 1 < Q <= MOST):
            raise ValueError(f"low={low}, high={high}, Q={Q} are out of range")
        self.profile, self.Q = [arb(k) for k in profile], Q
        self.middle, self.half = (arb(low) + high) / 2, (arb(high) - low) / 2
        # T_m(σ_i), row i.
        self.T = [[(arb(m * (2 * i + 1)) / (2 * Q)).cos_pi() for m in range(Q)] for i in range(Q)]
        grid = Grid(omega, profile, 0.0, n)
        self.grids = [
            grid.under([(self.middle + self.half * row[1]) * k for k in self.profile])
            for row in self.T
        ]
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
        """Σ_i A_mi tables[i], tables of P rows of equally many balls."""
        matrix = arb_mat if self.odd else acb_mat
        rows, size = len(tables[0]), len(tables[0][0])
        flat = [x for table in tables for row in table for x in row]
        flat = matrix(self.Q, rows * size, flat)
        flat = (matrix(self.Q, self.Q, [x for row in A for x in row]) * flat).entries()
        rows = [flat[i : i + size] for i in range(0, len(flat), size)]
        return [rows[i : i + len(tables[0])] for i in range(0, len(rows), len(tables[0]))]

    def moves(self, modes, unit):
        """Whole numbers near C of the polynomial through these modes; see `BarrierRayProof`."""
        weights = [[(2 if m else 1) * row[m] / self.Q for row in self.T] for m in range(self.Q)]
        return [[_whole(row, unit) for row in table] for table in self._product(weights, modes)]

    def verified(self, moves, unit):
        """Try to verify the theorem for all σ; a dict of what came out."""
        scale, size = arb(2) ** unit, max(len(part) for t in moves for row in t for part in row)
        C = [[_balls(row, size, self.odd) for row in table] for table in moves]
        u = self._product([[scale * x for x in row] for row in self.T], C)
        E = [residual(grid, modes) for grid, modes in zip(self.grids, u, strict=True)]
        sizes = [[[x.abs_upper() * scale for x in row] for row in table] for table in C]
        return self._theorem(sizes, u, E)

    def _theorem(self, sizes, u, E):
        Q, (grid, *_) = self.Q, self.grids
        Lambda, two_pi = 1 + 2 / arb.pi() * arb(Q).log(), 2 * arb.pi()
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
        apart = [2 * (arb(m) / (4 * Q)).sin_pi() for m in range(Q)]
        n, p, k, eps = [], [], [], []
        for j, strength in enumerate(self.profile):
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
            far = [arb(x) for x in np.geomspace(1.2, 40, 50)]
            between = [self._between(abs(strength), r, [row[j] for row in norms], rho) for r in far]
            least = min(between, key=lambda x: float(x.upper()))
            eps.append(Lambda * max_of([at[j] for at in errors]) + least)
        high = self.middle + self.half
        return concluded(grid.omega, [k * high for k in self.profile], rho, eps, n, p, k)

    def _between(self, strength, r, norms, rho):
        """What interpolation misses of the sine, by the ellipse whose half axes have the sum r."""
        size = sum((r**m + r**-m) / 2 * x for m, x in enumerate(norms))
        B = strength * (self.middle + self.half * (r + 1 / r) / 2) / (2 * arb.pi())
        B *= (2 * arb.pi() * (rho + size)).exp()
        return 4 * B * r**-self.Q / (1 - 1 / r)


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


def _balls(row, size, odd):
    if any(row[1][:1]) or (odd and row[0]):
        raise ValueError("the modes of a real function are wanted, for two kicks of an odd one")
    re, im = ([*part, *[0] * (size - len(part))] for part in row)
    return [arb(-b) for b in im] if odd else [acb(a, b) for a, b in zip(re, im, strict=True)]
