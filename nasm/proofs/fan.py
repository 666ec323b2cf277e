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
from itertools import product
from math import ceil, floor, log, log2, pi, sqrt

import numpy as np

from nasm import circles
from nasm.checks import real
from nasm.maps import MAX_STRENGTH, MIN_SIZE, direction, forcing
from nasm.numbers import as_rotation_number
from nasm.proofs.barrier import (
    BarrierProof,
    Grid,
    as_balls,
    balls,
    decay,
    fast_size,
    grid_size,
    need_flint,
    polished,
    residual,
    stepped,
    turns,
    verified,
    whole,
)
from nasm.symmetries import shorten

__all__ = ["covered", "proved_below"]

try:
    from flint import acb_mat, arb, arb_mat, ctx
except ImportError:  # the extra `proof`
    arb = None  # type: ignore[assignment, misc]

_NARROWEST = 0.9  # an interval ends at this part of the way to the breakup from its start, at most
_WIDEST = 0.5  # and at least
_EPSILON, _POWER = 3e-19, 6.3  # ε that is small enough at 1% of the breakup; it falls so with it
_ROUNDED = 1e-15  # ε above which circles in long doubles are exact enough
_FINER = 1.1  # as many points as for one forcing
_FEWEST, MOST = 8, 64  # points in s, and in t
_TRIED = 24  # points across the far end of a fan, to choose how many there are
_STRIP = 0.1  # of the width where circles are analytic, about: ρ
_SLOWER = 1.25  # than in proportion to 1/distance
_PART = 0.8
"""The part of the theorem's right sides below which a fan is called proved: the bounds of the
checker of its certificate are its own (1.15 times as large for one of 988 cells of forcings)."""


def proved_below(omega, profile, value, budget, tilt=None, nearest=1e-4):
    """The scale up to which the circle of omega is proved to exist on all of a ray, or in all of a
    triangle, from 0 on.

    Parameters
    ----------
    omega : RotationNumber or its text, for a period of the profile; irrational.
    profile : sequence of P floats, not all 0.
    value : float, 1e-300 to 1e306, where the circle breaks, e.g. by `periodic.critical_scale`; the
        least such scale in a triangle. It says only where to look.
    budget : float > 0, CPU seconds to spend, as nearly as can be foreseen. With two kicks 2 s reach
        0.97 of the breakup, 12 s 0.99, 27 s 0.996, 50 s 0.997; with three 13 s reach 0.984.
    tilt : sequence of P floats; the triangle is that of the rays profile + t·tilt, -1 ≤ t ≤ 1.
    nearest : float from 0 to 1, distance to the breakup, in parts of it, that is near enough.

    Returns
    -------
    scale : float; a circle exists under s(profile + t·tilt) for all real s and t, 0 ≤ s ≤ scale.
        Rounded to floats, forcings lie beside them by some 10⁻¹⁶, where nothing is proved by that.
    proofs : list of BarrierProof, of fans, by which it does, with their certificates.

    ImportError without python-flint; ValueError for a bad argument.
    """
    omega, profile = as_rotation_number(omega), direction(profile)
    value = real("value", value, MIN_SIZE, MAX_STRENGTH / MIN_SIZE)
    if not real("budget", budget) > 0:
        raise ValueError(f"budget={budget!r} must be positive: seconds of computing time")
    real("nearest", nearest, 0, 1)
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
    return covered(proof.scales for proof in proofs), proofs


def covered(intervals):
    """The scale up to which all s ≥ 0 are in one of the intervals (low, high)."""
    reached = 0.0
    for low, high in sorted(intervals):
        if low <= reached:
            reached = max(reached, high)
    return reached


def _proved_between(low, high, value, about):
    """Try to prove the circle for low ≤ s ≤ high, below the breakup at value."""
    about = about | {"scales": (low, high)}
    omega, profile, tilt = (about[key] for key in ("short_omega", "short_kappa", "tilt"))
    middle, half, distance = (low + high) / 2, (high - low) / 2, 1 - high / value
    epsilon = _EPSILON * (distance / 0.01) ** _POWER / max(1, len(profile) - 1) ** 3
    x = (value - middle) / half
    Q = max(_FEWEST, ceil(-log(epsilon) / log(x + sqrt(x * x - 1))))
    most = min(2**16, 2 ** ceil(log2(128 + 32 / distance)))

    def circle(sigma, t):
        kappa = (middle + half * sigma) * (np.array(profile) + t * np.array(tilt))
        return circles.invariant_circle(omega, kappa, most)

    far = [circle(1.0, t) for t in _points(_TRIED if any(tilt) else 1).tolist()]
    if lost := [one.status.value for one in far if not one.certified]:
        return BarrierProof(False, f"not proved: a circle was not found: {lost[0]}", **about)
    n = fast_size(int(_FINER * max(grid_size(one.u) for one in far)))
    R, starts = _points_across(far, n, epsilon / 10) if any(tilt) else 1, []
    if max(Q, R) > MOST:
        return BarrierProof(False, "not proved: the fan is too wide", **about)
    for sigma in _points(Q).tolist():  # the nearest to the breakup first
        for t in _points(R).tolist():
            found = circle(sigma, t)
            if not found.certified:
                why = f"not proved: a circle was not found: {found.status.value}"
                return BarrierProof(False, why, **about)
            starts.append(found.u)
    unit = floor(log2(epsilon / (1000 * n)))
    with ctx.workprec(128 if n < 2**18 else 160):
        fan = _Fan(omega, profile, tilt, low, high, n, Q, R)
        modes = fan.circles(starts, epsilon)
        if modes is None:
            return BarrierProof(False, "not proved: Newton's method diverges", **about)
        moves = fan.moves(modes, unit)
        if R > 1:
            moves = _above_rounding(moves, Q, R)
        found = fan.verified(moves, unit)
    moves = [moves[first : first + R] for first in range(0, Q * R, R)]
    return BarrierProof(**about, n=n, unit=unit, moves=moves, **found)


def _points(Q):
    return np.cos(pi * (2 * np.arange(Q) + 1) / (2 * Q))


def _points_across(far, n, missed):
    """R for which interpolation in t misses so little, by the bound of `_Fan._between` from the
    norms that coefficients of circles at the far end have."""
    degrees, turn = np.arange(_TRIED)[:, None], turns(far[0].omega, len(far[0].kappa), n // 2 + 1)
    modes = np.array([polished(one.kappa, n, turn, one.u) for one in far], complex)
    if not np.isfinite(modes).all():
        return MOST + 1
    rho = _STRIP * decay(np.abs(modes).max(axis=(0, 1)))
    T = np.cos(degrees * np.arccos(_points(_TRIED))) * np.minimum(degrees + 1, 2) / _TRIED
    weights = 2 * np.exp(2 * pi * rho * np.arange(modes.shape[-1]))
    sizes = (np.abs(np.tensordot(T, modes, 1)) @ weights).max(axis=1)
    end = max(4, np.argmax(np.append(sizes < 1e-10 * sizes.max(), True)))  # then of rounding
    rate = (sizes[end - 1] / sizes[end // 2 - 1]) ** (1 / (end - end // 2))
    rate = np.clip(rate, 0.01, 0.95)
    r = np.geomspace(1.01, 0.98 / rate, 80)
    size = sizes[:end] @ (r ** degrees[:end] + r ** -degrees[:end]) / 2
    size += sizes[end - 1] / 2 * r**end * rate / (1 - rate * r)
    B = np.abs([one.kappa for one in far]).max() * (r + 1 / r) / (4 * pi)
    B *= np.exp(2 * pi * (rho + np.minimum(size, 50)))
    return max(_FEWEST, ceil(min(np.log(4 * B / (1 - 1 / r) / missed) / np.log(r))))


def _above_rounding(moves, Q, R):
    """C, and nothing where it is of no use, as small as the rounding of the modes by long doubles.

    C falls with the sum of its degrees: where both are high, rounding is all there is.
    """
    size = max(1, *(len(part) for table in moves for row in table for part in row))
    sizes = np.zeros((Q * R, size))
    for total, table in zip(sizes, moves, strict=True):
        for part in (part for row in table for part in row):
            total[: len(part)] += np.abs(np.array(part, float))
    rho = _STRIP * decay(sizes[0])
    norms = sizes @ np.exp(2 * pi * rho * np.arange(sizes.shape[1]))
    rounding = norms.reshape(Q, R)[3 * Q // 4 :, 3 * R // 4 :].max()
    nothing = [[[], []]] * len(moves[0])
    return [C if x > 2 * rounding else nothing for C, x in zip(moves, norms, strict=True)]


class _Fan:
    """Forcings s(profile + t·tilt), low ≤ s ≤ high, |t| ≤ 1, at Chebyshev's Q·R points, in balls.

    A list has all points, or all degrees, t's running faster.
    """

    def __init__(self, omega, profile, tilt, low, high, n, Q, R):
        if not (0 <= low < high and 1 < Q <= MOST and 1 <= R <= MOST and (R > 1 or not any(tilt))):
            raise ValueError(f"low={low}, high={high}, Q={Q}, R={R} are out of range")
        self.profile, self.tilt = [arb(k) for k in profile], [arb(k) for k in tilt]
        self.shape = Q, R
        self.middle, self.half, self.high = (arb(low) + high) / 2, (arb(high) - low) / 2, arb(high)
        self.T = [_chebyshev(Q), _chebyshev(R)]
        grid = Grid(omega, profile, n)
        self.grids = []
        for row, across in product(*self.T):
            s, t = self.middle + self.half * row[1], across[1] if R > 1 else arb(0)
            both = zip(self.profile, self.tilt, strict=True)
            self.grids.append(grid.under([s * (a + t * b) for a, b in both]))
        self.odd, self.turn = grid.odd, turns(omega, grid.sites, n // 2 + 1)

    def circles(self, starts, epsilon=0.0):
        """Modes of circles at the points, exact balls, from values on grids, a step of Newton's
        from long doubles where epsilon is near their rounding; None if there are none."""
        found = []
        for grid, start in zip(self.grids, starts, strict=True):
            modes = polished(grid.kappa, grid.n, self.turn, start)
            if not np.isfinite(modes).all():
                return None
            modes[0, 0] = 0  # the same phase at all points, beyond rounding
            modes = as_balls(modes, self.odd)
            if epsilon < _ROUNDED:
                modes = stepped(grid, self.turn, modes, residual(grid, modes))
            found.append(modes)
            if modes is None:
                return None
        return found

    def _product(self, A, tables):
        """Σ A_mi A'_li' tables[i, i'], A being A, A', tables of P rows of equally many balls."""
        matrix, tables = arb_mat if self.odd else acb_mat, np.array(tables, object)
        x = tables.reshape(*self.shape, -1)
        for B in A:  # along the first axis, which then is the second
            both = matrix(B) * matrix(x.reshape(len(B), -1).tolist())
            x = np.array(both.entries(), object).reshape(x.shape).swapaxes(0, 1)
        return x.reshape(tables.shape).tolist()

    def moves(self, modes, unit):
        """Whole numbers near C of the polynomial through these modes; see `BarrierProof`."""
        A = [
            [[(2 if m else 1) * row[m] / len(T) for row in T] for m in range(len(T))]
            for T in self.T
        ]
        return [[whole(row, unit) for row in table] for table in self._product(A, modes)]

    def verified(self, moves, unit):
        """Try to verify the theorem for all s and t; a dict of what came out."""
        size = max(1, *(len(part) for t in moves for row in t for part in row))
        C = [balls(table, unit, size, self.odd) for table in moves]
        u = self._product(self.T, C)
        E = [residual(grid, modes) for grid, modes in zip(self.grids, u, strict=True)]
        sizes = [[[x.abs_upper() for x in row] for row in table] for table in C]
        # |T_m(σ) - T_m(σ_i)| for the nearest σ_i: their angles differ by π/2Q or less.
        steps = [[2 * (arb(m) / (4 * n)).sin_pi() for m in range(n)] for n in self.shape]
        apart = [a + b for a, b in product(*steps)]
        kappa = [self.high * self._largest(j) for j in range(len(self.profile))]
        found = verified(self.grids, u, E, sizes, apart, kappa, self._between, _PART)
        return {key: found[key] for key in found if key != "least"}

    def _largest(self, j, t=1):
        return abs(self.profile[j]) + abs(self.tilt[j]) * t

    def _between(self, error, rho, norms, j):
        """‖E_j‖ for all σ and t. What interpolation in σ, and that in t, misses of the sine is
        bounded by the ellipses whose half axes have the sum r."""
        (Q, R), two_pi, found = self.shape, 2 * arb.pi(), []
        degrees = [*product(range(Q), range(R))]
        for axis, count in enumerate(self.shape):
            least = arb.pos_inf() if count > 1 else arb(0)  # nothing depends on t
            sums = [arb(0)] * count
            for m, x in zip(degrees, norms, strict=True):
                sums[m[axis]] += x
            for r in [arb(x) for x in np.geomspace(1.2, 40, 50)] if count > 1 else []:
                axes = (r + 1 / r) / 2
                s, t = (self.middle + self.half * axes, 1) if axis == 0 else (self.high, axes)
                size = rho + sum((r**m + r**-m) / 2 * x for m, x in enumerate(sums))
                B = s * self._largest(j, t) / two_pi * (two_pi * size).exp()
                bound = 4 * B * r**-count / (1 - 1 / r)
                least = bound if bound < least else least
            found.append(least)
        (along, beside), (Lambda, across) = found, (1 + 2 / arb.pi() * arb(n).log() for n in (Q, R))
        return Lambda * (across * error + beside) + along


def _chebyshev(Q):
    """T_m(σ_i), row i."""
    return [[(arb(m * (2 * i + 1)) / (2 * Q)).cos_pi() for m in range(Q)] for i in range(Q)]
