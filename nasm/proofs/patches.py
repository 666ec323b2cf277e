"""Proofs that a barrier exists under every forcing of a patch.

A patch consists of the forcings κ = s(a + tb), low ≤ s ≤ high, |t| ≤ 1. Patches with the same a
and b, each beginning at the s where the previous one ended, fill a triangle with a corner at κ = 0,
or, if b = 0, a segment of a ray. In a plane with origin o, κ = o + s(a + tb), and the corner is o.
On each patch

    u_j(φ; s, t) = Σ_{m<Q, l<R} C_jml(φ) T_m(σ) T_l(t),    s = (low + high)/2 + σ (high - low)/2,

|σ| ≤ 1, with the Chebyshev polynomials T_m. The theorem of `nasm.proofs.barrier` applies for every
s and t if its constants are valid for all σ and t. The bounds n_j and k_j are sums over m and l.
The bound p_j allows for the difference between g_j' and its value at the nearest of Q·R Chebyshev
points. The residual obeys

    ‖E_j‖ ≤ Λ_Q Λ_R max ‖E_j‖ at the points + interpolation error,    Λ_Q = 1 + (2/π) log Q.

If these bounds are too large for the theorem, the first step is bounded mode by mode, as described
in README.md, "A first step that is computed". Then only the interpolation error is bounded
without knowledge of its modes; it is small because E_j is computed at more points than there are
Chebyshev polynomials.

Adjacent patches that begin at s = 0 show that the circle exists for all weaker kicks too: it does
not break and reappear in between. See proofs/README.md, "A patch". A proof relies on
`_Patch` and the functions of `nasm.proofs.barrier` and `nasm.proofs.residuals` that it calls; C may
come from any source.
In certificates, a patch is called a fan.
"""

import time
from collections.abc import Iterable, Sequence
from itertools import product
from math import ceil, floor, log, log2, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from nasm import circles
from nasm.checks import real
from nasm.maps import MAX_STRENGTH, MIN_SIZE, direction, forcing
from nasm.numbers import RotationNumber, as_rotation_number
from nasm.planes import Plane
from nasm.proofs.barrier import (
    MODES_PER_POINT,
    Ball,
    BarrierProof,
    ComplexArray,
    Grid,
    correction,
    decay,
    fast_size,
    grid_size,
    need_flint,
    polished,
    turns,
    verified,
)
from nasm.proofs.precision import working_precision
from nasm.proofs.residuals import (
    SLACK,
    SQUARED_ULP,
    UNDERFLOW,
    TooWideError,
    as_balls,
    as_complex,
    combined,
    from_integers,
    moved,
    parts_of,
    residuals,
    to_integers,
    upper_sizes,
)
from nasm.proofs.transport import check_arithmetic
from nasm.symmetries import shorten
from nasm.types import FloatArray, OmegaLike

__all__ = ["covered_up_to", "proved_below"]

try:
    from flint import arb
except ImportError:  # the extra `proof`
    arb = None  # type: ignore[assignment, misc]

# Distance from the breakup at the end of a patch, divided by the distance at its beginning.
_MIN_DISTANCE_RATIO, _MAX_DISTANCE_RATIO = 0.5, 0.9
# The ε that suffices 1% below the breakup, and the power of the distance from the breakup to which
# ε is proportional. Both were measured on rays, and on triangles in which the golden circle breaks
# last.
_RESIDUAL_AT_1_PERCENT, _RESIDUAL_POWER = 1e-14, 4.6
# If the inequalities fail, ε is multiplied by _REDUCTION, until it reaches _MIN_REDUCTION times its
# first value; then shorter patches are tried. Triangles in which a different circle breaks last
# need one reduction.
_REDUCTION, _MIN_REDUCTION = 1e-2, 1e-4
_MORE_POINTS = 2  # E is computed at this many more points than there are degrees
_MAX_NEWTON_STEPS = 8  # 1 to 3 are needed
_UNDERFLOW = 1e-280  # a residual that is too small to be corrected in doubles
_NEWTON_GAIN = 1e-6  # measured: a Newton step reduces residuals by a factor of 10⁵ to 10¹⁰
_GRID_FACTOR = 0.75  # number of grid points, relative to that for a single forcing
_MIN_NODES, MAX_NODES = 8, 64  # Chebyshev points in s, and in t
_TRIAL_NODES = 24  # points in t at the far end of a patch, used to choose R
_STRIP_RATIO = 0.1  # ρ relative to the estimated half width of the strip of analyticity
_SLOWDOWN = 1.25  # allowance for work that grows faster than 1/distance
_BOUND_FRACTION = 0.8
"""A patch counts as proved if the left side of each inequality is below this fraction of the right.

The checker of certificates computes its own bounds. In seven patches, on rays and in triangles,
that end 2% to 50% below the breakup, its left sides were larger by 1.4% at most.
"""


def proved_below(
    omega: OmegaLike,
    profile: ArrayLike,
    value: float,
    budget: float,
    tilt: ArrayLike | None = None,
    nearest: float = 1e-4,
    plane: Plane | None = None,
) -> tuple[float, list[BarrierProof]]:
    """Prove that the circle of omega exists from scale 0 upwards, along a ray or in a triangle.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period of the profile, irrational.
    profile : array_like, shape (P,)
        Direction of the ray, not zero.
    value : float
        Scale at which the circle breaks, e.g. from `periodic.critical_scale`; 1e-300 to 1e306. For
        a triangle, the smallest such scale on its rays. It only determines where to attempt proofs.
    budget : float
        CPU seconds, approximately. For two kicks, 2 s suffice to reach 0.97 of the breakup and 12 s
        to reach 0.99; proofs/README.md has a table.
    tilt : array_like, shape (P,), optional
        Required for a triangle, which consists of the rays profile + t·tilt, -1 ≤ t ≤ 1.
    nearest : float
        Relative distance from the breakup at which to stop, from 0 to 1.
    plane : Plane, optional
        The plane, if profile and tilt are coordinates in one; s is measured from its origin. The
        proof holds for exactly the floats in plane, profile and tilt.

    Returns
    -------
    scale : float
        The circle exists under s·(profile + t·tilt) for all real 0 ≤ s ≤ scale, |t| ≤ 1. This is a
        statement about real numbers: forcings rounded to floats lie off the ray by about 10⁻¹⁶.
    proofs : list of BarrierProof
        Proofs for the patches that fill the ray or the triangle.

    Raises
    ------
    ImportError
        If python-flint is not installed.
    ValueError
        If an argument is out of range.

    Examples
    --------
    >>> from nasm.proofs import proved_below
    >>> scale, proofs = proved_below("gamma", (1.0,), 0.971635, budget=0.3)
    >>> 0.4 < scale < 0.971635
    True
    >>> proofs[0]
    <BarrierProof: the circle [0;(1)] exists under s·(1.0,), 0 ≤ s ≤ 0.4858...; proved on ...
    points>
    """
    omega, profile = as_rotation_number(omega), direction(profile)
    value = real("value", value, MIN_SIZE, MAX_STRENGTH / MIN_SIZE)
    if not real("budget", budget) > 0:
        raise ValueError(f"budget={budget!r} must be positive: seconds of computing time")
    real("nearest", nearest, 0, 1)
    need_flint()
    check_arithmetic()
    short, short_omega = profile, omega
    if tilt is None and plane is None:
        (short,), short_omega = shorten([profile], omega)
    tilt = np.zeros(short.size) if tilt is None else forcing(tilt)
    if tilt.shape != short.shape:
        raise ValueError(f"tilt={tilt.tolist()} must have as many numbers as the profile")
    if plane and profile.shape != (2,):
        raise ValueError(f"profile={profile.tolist()} must be two coordinates of the plane")
    about = {"omega": omega, "kappa": tuple(profile.tolist()), "tilt": tuple(tilt.tolist())}
    about |= {"short_omega": short_omega, "short_kappa": tuple(short.tolist())}
    about["plane"] = plane
    reached, part, reduction = 0.0, _MIN_DISTANCE_RATIO, 1.0
    proofs: list[BarrierProof] = []
    until, pace = time.thread_time() + budget, 0.0
    while part <= _MAX_DISTANCE_RATIO and not omega.is_rational:
        before = time.thread_time()
        # The work is roughly proportional to 1/distance.
        affordable = _SLOWDOWN * pace / max(until - before, 1e-9)
        distance = max((1 - reached / value) * part, affordable, nearest)
        if not distance < _MAX_DISTANCE_RATIO * (1 - reached / value):
            break
        high = value * (1 - distance)
        proof = _proved_between(reached, high, value, about, reduction)
        if proof.proved:
            reached, part = high, max(_MIN_DISTANCE_RATIO, part**1.5)
            proofs.append(proof)
        elif proof.n and reduction > _MIN_REDUCTION:
            reduction *= _REDUCTION
        else:
            part = sqrt(part)
        pace = (time.thread_time() - before) * distance
    return covered_up_to(proof.scales for proof in proofs), proofs


def covered_up_to(intervals: Iterable[tuple[float, ...]]) -> float:
    """Return the scale up to which every s ≥ 0 is in one of the intervals (low, high).

    Examples
    --------
    >>> from nasm.proofs import covered_up_to
    >>> covered_up_to([(0.0, 0.2), (0.2, 0.3), (0.4, 0.5)])
    0.3
    """
    reached = 0.0
    for low, high in sorted(intervals):
        if low <= reached:
            reached = max(reached, high)
    return reached


def _proved_between(
    low: float, high: float, value: float, about: dict[str, Any], reduction: float = 1.0
) -> BarrierProof:
    """Try to prove that the circle exists for low ≤ s ≤ high, below the breakup at `value`.

    `reduction` multiplies ε, the interpolation error for which Q and R are chosen.
    """
    about = about | {"scales": (low, high)}
    omega, plane = about["short_omega"], about.get("plane")
    origin, profile, tilt = _vectors(plane, about["short_kappa"], about["tilt"])
    middle, half, distance = (low + high) / 2, (high - low) / 2, 1 - high / value
    epsilon = (
        reduction
        * _RESIDUAL_AT_1_PERCENT
        * (distance / 0.01) ** _RESIDUAL_POWER
        / max(1, len(profile) - 1) ** 3
    )
    x = (value - middle) / half
    Q = max(_MIN_NODES, ceil(-log(epsilon) / log(x + sqrt(x * x - 1))))
    most = min(2**16, 2 ** ceil(log2(128 + 32 / distance)))

    def circle(sigma: float, t: float) -> circles.InvariantCircle:
        kappa = origin + (middle + half * sigma) * (profile + t * tilt)
        return circles.invariant_circle(omega, kappa, most)

    far = [circle(1.0, t) for t in _points(_TRIAL_NODES if any(about["tilt"]) else 1).tolist()]
    if lost := [one.status.value for one in far if not one.certified]:
        return BarrierProof(False, f"not proved: a circle was not found: {lost[0]}", **about)
    n = fast_size(int(_GRID_FACTOR * max(grid_size(one.u) for one in far)))
    R, starts = _points_across(far, n, epsilon / 10) if any(about["tilt"]) else 1, []
    if max(_more(Q, R)) > MAX_NODES:
        return BarrierProof(False, "not proved: the patch is too wide", **about)
    for sigma in _points(Q).tolist():  # the points closest to the breakup come first
        for t in _points(R).tolist():
            start = circle(sigma, t)
            if not start.certified:
                reason = f"not proved: a circle was not found: {start.status.value}"
                return BarrierProof(False, reason, **about)
            starts.append(start.u)
    unit = floor(log2(epsilon / (1000 * n)))
    try:
        with working_precision(128 if n < 2**18 else 160):
            exact = _vectors(plane, about["short_kappa"], about["tilt"], arb)
            patch = _Patch(omega, *exact[1:], low, high, n, Q, R, exact[0])
            modes = patch.circles(starts, epsilon)
            if modes is None:
                return BarrierProof(False, "not proved: Newton's method diverges", **about)
            coefficients = patch.coefficients(modes, unit)
            if R > 1:
                coefficients = _above_rounding(coefficients, Q, R)
            finer = _Patch(omega, *exact[1:], low, high, n, *_more(Q, R), exact[0])
            outcome = finer.verified(_with_zeros(coefficients, Q, R), unit)
    except TooWideError as error:  # a strength nearly cancels at a point
        return BarrierProof(False, f"not proved: {error}", **about)
    coefficients = [coefficients[first : first + R] for first in range(0, Q * R, R)]
    return BarrierProof(**about, n=n, unit=unit, coefficients=coefficients, **outcome)


def _vectors(
    plane: Plane | None, profile: Sequence[float], tilt: Sequence[float], number: Any = float
) -> tuple[Any, Any, Any]:
    """Return o, a and b of the forcings o + s(a + tb) as arrays of floats, or of balls."""

    def vector(row: Sequence[float]) -> Any:
        return np.array([number(x) for x in row])

    if plane is None:
        return vector([0.0] * len(profile)), vector(profile), vector(tilt)
    along, beside = (
        number(a) * vector(plane.first) + number(b) * vector(plane.second)
        for a, b in (profile, tilt)
    )
    return vector(plane.origin), along, beside


def _points(Q: int) -> FloatArray:
    """Return the Q Chebyshev points."""
    return np.cos(pi * (2 * np.arange(Q) + 1) / (2 * Q))


def _points_across(far: list[circles.InvariantCircle], n: int, max_error: float) -> int:
    """Choose R so that the interpolation error in t is at most max_error.

    The error is estimated as in `_Patch._between`, from the norms of the coefficients of the
    circles at the far end.
    """
    degrees = np.arange(_TRIAL_NODES)[:, None]
    turn = turns(far[0].omega, len(far[0].kappa), n // 2 + 1)
    refined = [polished(one.kappa.tolist(), n, turn, one.u) for one in far]
    modes: ComplexArray = np.array(refined).astype(np.complex128)
    if not np.isfinite(modes).all():
        return MAX_NODES + 1
    rho = _STRIP_RATIO * decay(np.abs(modes).max(axis=(0, 1)))
    T = np.cos(degrees * np.arccos(_points(_TRIAL_NODES)))
    T *= np.minimum(degrees + 1, 2) / _TRIAL_NODES
    weights = 2 * np.exp(2 * pi * rho * np.arange(modes.shape[-1]))
    sizes = (np.abs(np.tensordot(T, modes, 1)) @ weights).max(axis=1)
    # Beyond `end` the sizes are rounding errors.
    end = max(4, int(np.argmax(np.append(sizes < 1e-10 * sizes.max(), True))))
    rate = (sizes[end - 1] / sizes[end // 2 - 1]) ** (1 / (end - end // 2))
    rate = np.clip(rate, 0.01, 0.95)
    r = np.geomspace(1.01, 0.98 / rate, 80)
    size = sizes[:end] @ (r ** degrees[:end] + r ** -degrees[:end]) / 2
    size += sizes[end - 1] / 2 * r**end * rate / (1 - rate * r)
    B = np.abs([one.kappa for one in far]).max() * (r + 1 / r) / (4 * pi)
    B *= np.exp(2 * pi * (rho + np.minimum(size, 50)))
    return max(_MIN_NODES, ceil(min(np.log(4 * B / (1 - 1 / r) / max_error) / np.log(r))))


def _modes_of(start: FloatArray, turn: ComplexArray, K: int) -> ComplexArray:
    """Return the modes k < K of u_j, for all j, from the values of u on a grid."""
    known, modes = np.fft.rfft(start)[:, :K] / start.shape[1], np.zeros((len(start), K), complex)
    to_sites = turn[: known.shape[1]].conj() ** np.arange(len(start))[:, None]
    modes[:, : known.shape[1]] = known * to_sites
    return modes


def _above_rounding(coefficients: list[Any], Q: int, R: int) -> list[Any]:
    """Replace coefficients C by 0 if they are as small as rounding errors.

    C decays with the sum of its degrees: if both degrees are high, only rounding errors are left.
    """
    size = max(1, *(len(part) for table in coefficients for row in table for part in row))
    sizes = np.zeros((Q * R, size))
    for total, table in zip(sizes, coefficients, strict=True):
        for part in (part for row in table for part in row):
            total[: len(part)] += np.abs(np.array(part, float))
    rho = _STRIP_RATIO * decay(sizes[0])
    norms = sizes @ np.exp(2 * pi * rho * np.arange(sizes.shape[1]))
    rounding = norms.reshape(Q, R)[3 * Q // 4 :, 3 * R // 4 :].max()
    nothing: list[Any] = [[[], []]] * len(coefficients[0])
    return [C if x > 2 * rounding else nothing for C, x in zip(coefficients, norms, strict=True)]


def _more(Q: int, R: int) -> tuple[int, int]:
    """Return the numbers of points in s and t at which residuals are computed, for Q·R degrees."""
    return Q + _MORE_POINTS, R + _MORE_POINTS if R > 1 else 1


def _with_zeros(coefficients: list[Any], Q: int, R: int) -> list[Any]:
    """Pad the coefficients with zeros, so that there is one for each point of `_more`."""
    more, across = _more(Q, R)
    zero: list[Any] = [[[], []]] * len(coefficients[0])
    rows = [coefficients[first : first + R] + [zero] * (across - R) for first in range(0, Q * R, R)]
    return [C for row in rows for C in row] + [zero] * (across * (more - Q))


class _Patch:
    """The forcings of a patch at Q·R Chebyshev points, in ball arithmetic.

    The patch consists of the forcings origin + s(profile + t·tilt), low ≤ s ≤ high, |t| ≤ 1. Lists
    have an entry for each point, or for each pair of degrees; the index for t varies fastest.
    """

    def __init__(
        self,
        omega: RotationNumber,
        profile: Sequence[float | Ball],
        tilt: Sequence[float | Ball],
        low: float,
        high: float,
        n: int,
        Q: int,
        R: int,
        origin: Sequence[float | Ball] = (),
    ) -> None:
        if not (
            0 <= low < high
            and 1 < Q <= MAX_NODES
            and 1 <= R <= MAX_NODES
            and (R > 1 or all(x == 0 for x in tilt))
        ):
            raise ValueError(f"low={low}, high={high}, Q={Q}, R={R} are out of range")
        self.profile, self.tilt = [arb(k) for k in profile], [arb(k) for k in tilt]
        self.origin = [arb(k) for k in origin] or [arb(0)] * len(self.profile)
        self.shape = Q, R
        self.middle, self.half, self.high = (arb(low) + high) / 2, (arb(high) - low) / 2, arb(high)
        self.T = [_chebyshev(Q), _chebyshev(R)]
        self.lebesgue = [1 + 2 / arb.pi() * arb(n).log() for n in (Q, R)]
        grid = Grid(omega, profile, n)
        self.grids = []
        for row, across in product(*self.T):
            s, t = self.middle + self.half * row[1], across[1] if R > 1 else arb(0)
            rows = zip(self.origin, self.profile, self.tilt, strict=True)
            self.grids.append(grid.under([o + s * (a + t * b) for o, a, b in rows]))
        self.sites, self.odd, self.turn = grid.sites, grid.odd, turns(omega, grid.sites, n // 2 + 1)

    def circles(self, starts: list[FloatArray], epsilon: float = 0.0) -> FloatArray | None:
        """Compute the modes of the circles at all points by Newton's method from values on grids.

        The steps and the first residual are computed in doubles, later residuals as sums of two
        floats. The modes are such sums too, of shape (2, N, P, parts, K); see
        `nasm.proofs.residuals`. Return None if Newton's method diverges.
        """
        n, K = self.grids[0].n, int(MODES_PER_POINT * self.grids[0].n) + 1
        u = np.zeros((2, len(starts), self.sites, 2 - self.odd, K))
        for modes, start in zip(u[0], starts, strict=True):
            modes[:] = parts_of(_modes_of(start, self.turn, K), self.odd)
        last, best = np.inf, u
        for step in range(_MAX_NEWTON_STEPS):
            u[:, :, 0, :, 0] = 0  # fixes the same phase at all points
            modes = as_complex(u[0])
            if step == 0:
                E = self._residual_in_doubles(modes)
            else:
                E = as_complex(residuals(self.grids, u, np.zeros((self.sites, K)))[0][0])
            size = np.abs(E[..., :K]).max()
            if not np.isfinite(size):
                return None
            if not size < 0.5 * last:
                break
            best, last = u, size
            if size < _UNDERFLOW:
                break
            v = correction(self.turn, modes.swapaxes(0, 1), (E / size).swapaxes(0, 1))
            u = moved(u, size * parts_of(v[..., :K].swapaxes(0, 1), self.odd))
            if size * _NEWTON_GAIN <= epsilon / (8000 * n):
                u[:, :, 0, :, 0] = 0
                return u if np.isfinite(u).all() else None
        return best

    def _residual_in_doubles(self, u: ComplexArray) -> ComplexArray:
        """Return the modes of the residuals at the points, given u of shape (N, P, K)."""
        n, turn = self.grids[0].n, self.turn[: u.shape[-1]].astype(complex)
        x = np.arange(n) / n + np.fft.irfft(u, n) * n
        strengths = np.array([[float(k) for k in grid.kappa] for grid in self.grids])
        E: ComplexArray = strengths[..., None] / (-2 * pi * n) * np.fft.rfft(np.sin(2 * pi * x))
        E[..., : u.shape[-1]] += np.roll(u, -1, axis=1) * turn - 2 * u
        E[..., : u.shape[-1]] += np.roll(u, 1, axis=1) * turn.conj()
        return E[..., : n // 2]

    def coefficients(self, modes: FloatArray, unit: int) -> list[Any]:
        """Interpolate modes at the points; return C rounded to integers, as in `BarrierProof`."""
        A = [
            [[(2 if m else 1) * row[m] / len(T) for row in T] for m in range(len(T))]
            for T in self.T
        ]
        C = combined([np.array(matrix, object) for matrix in A], modes)
        return [to_integers(table, unit) for table in C.swapaxes(0, 1)]

    def verified(self, coefficients: list[Any], unit: int) -> dict[str, Any]:
        """Try to verify the inequalities for all s and t; return fields of a `BarrierProof`."""
        C = from_integers(coefficients, unit, self.odd)
        modes = combined([np.array(T, object) for T in self.T], C)
        sizes = upper_sizes(C)
        errors = SLACK * (20 + 3.1 * sum(self.shape)) * SQUARED_ULP * sizes.sum(axis=0) + UNDERFLOW
        E, radii = residuals(self.grids, modes, errors)
        if not np.isfinite(radii).all():
            return {"proved": False, "reason": "not proved: the residual is not finite"}
        u, E = as_balls(modes, errors), as_balls(E, radii)
        sizes = [[[arb(x) for x in row] for row in table] for table in sizes.tolist()]
        # Bounds on |T_m(σ) - T_m(σ_i)| for the nearest σ_i: arccos σ_i and arccos σ differ by at
        # most π/2Q.
        steps = [[2 * (arb(m) / (4 * n)).sin_pi() for m in range(n)] for n in self.shape]
        apart = [a + b for a, b in product(*steps)]
        kappa = [self._largest(j, self.high) for j in range(len(self.profile))]
        largest = self.lebesgue[0] * self.lebesgue[1]
        outcome = verified(
            self.grids, u, E, sizes, apart, kappa, self._between, largest, _BOUND_FRACTION
        )
        return {key: outcome[key] for key in outcome if key != "estimated_ratio"}

    def _largest(self, j: int, s: Ball, t: Ball | int = 1) -> Ball:
        """Bound |κ_j| for |s| and |t| at most `s` and `t`."""
        return abs(self.origin[j]) + s * (abs(self.profile[j]) + abs(self.tilt[j]) * t)

    def _between(self, error: Ball, rho: Ball, norms: list[Ball], j: int) -> Ball:
        """Bound ‖E_j‖ for all σ and t, from its bound `error` at the points.

        The interpolation error of the sine, in σ and in t, is bounded on ellipses whose semi-axes
        add up to r.
        """
        (Q, R), two_pi, misses = self.shape, 2 * arb.pi(), []
        degrees = [*product(range(Q), range(R))]
        for axis, count in enumerate(self.shape):
            least = arb.pos_inf() if count > 1 else arb(0)  # one point: nothing depends on t
            sums = [arb(0)] * count
            for m, x in zip(degrees, norms, strict=True):
                sums[m[axis]] += x
            for r in [arb(x) for x in np.geomspace(1.2, 40, 50)] if count > 1 else []:
                axes = (r + 1 / r) / 2
                s, t = (self.middle + self.half * axes, 1) if axis == 0 else (self.high, axes)
                size = rho + sum((r**m + r**-m) / 2 * x for m, x in enumerate(sums))
                B = self._largest(j, s, t) / two_pi * (two_pi * size).exp()
                bound = 4 * B * r**-count / (1 - 1 / r)
                least = bound if bound < least else least
            misses.append(least)
        (along, beside), (Lambda, across) = misses, self.lebesgue
        return Lambda * (across * error + beside) + along


def _chebyshev(Q: int) -> list[list[Ball]]:
    """Return T_m(σ_i), with a row for each i."""
    return [[(arb(m * (2 * i + 1)) / (2 * Q)).cos_pi() for m in range(Q)] for i in range(Q)]
