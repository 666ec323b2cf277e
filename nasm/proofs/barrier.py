"""A proof in ball arithmetic that the invariant circle of ω exists under one forcing.

The chain of `nasm.circles`, written in terms of g_j(θ + jα) = h_j(θ), has the residual

    E_j(φ) = g_{j+1}(φ + α) - 2g_j(φ) + g_{j-1}(φ - α) - (κ_j/2π) sin 2πg_j(φ),      α = ω/P,

where g_j(φ) = φ + u_j(φ), u_{j+P} = u_j. If E is small enough for some trigonometric polynomials
u_j, a true circle exists near them; the theorem "A barrier exists" of proofs/README.md states how
small E must be. With ‖f‖ = Σ_k |f_k| e^{2π|k|ρ}, the hypotheses of the theorem are stated in terms
of the upper bounds

    n_j ≥ ‖g_j'‖,    p_j ≥ ‖1/g_j'‖,    k_j ≥ ‖e^{2πig_j}‖,    ε ≥ Σ_j n_j ‖E_j‖,    C ≥ C_R + δ.

If these bounds do not suffice, the first step of the iteration in the theorem's proof is bounded
mode by mode: bounds on the modes of E_j, h_j' and 1/h_j' yield bounds on the step v_j = h_j'w_j,
and the theorem is applied to h + v.

A proof relies on FLINT's ball arithmetic (python-flint, the extra `proof`), and on the functions of
this module from `_omega_ball` to `balls`. In these functions, every number that enters a bound is a
ball or an exact dyadic number. Floats are used only to choose ρ, ρ̂, the mode at which sums are cut
off, and the polynomial that approximates 1/g_j'; the proof is sound for any choice. The functions
that follow `balls` search for u, which may come from any source.

For P ≤ 2 the u_j are odd, because h_j(θ) → -h_{-j}(-θ) maps circles to circles. Their modes are
then imaginary, so each is stored as one real number, and one transform serves two functions.
"""

import time
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache, reduce
from itertools import accumulate, islice, zip_longest
from math import ceil, inf, isnan, log, nan, pi, sqrt
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nasm import circles
from nasm.checks import count, positive, real
from nasm.circles import fourier, hull
from nasm.maps import MAX_STRENGTH, MIN_SIZE, direction, forcing
from nasm.numbers import RotationNumber, as_rotation_number, convergents
from nasm.planes import Plane
from nasm.proofs.certificates import certificate, in_hex, matrix_in_hex
from nasm.proofs.precision import working_precision
from nasm.results import Result
from nasm.symmetries import shorten
from nasm.tables import html_table, omega_text
from nasm.types import FloatArray, OmegaLike

__all__ = ["BarrierProof", "need_flint", "prove", "proved_lower"]

try:
    from flint import acb, acb_poly, arb, arb_poly, ctx
except ImportError:  # the extra `proof` is not installed
    arb = None  # type: ignore[assignment, misc]

_STEP_WIDTH = 0.7  # ρ if a step is computed, relative to ρ if not: best of 6 values on 9 patches
MODES_PER_POINT = 0.38  # modes of u per point of the grid
_MAX_NEWTON_STEPS = 6  # in ball arithmetic, 0 to 3 are needed
_MAX_POINTS = 2**22  # largest number of points of a grid
_SECONDS_PER_POINT = 1e-5  # CPU seconds per point and kick, on a fast machine
_LOG_ROUNDING = 46  # e^-46 is 10^-20, the rounding error of long doubles near 0.1

ComplexArray: TypeAlias = NDArray[Any]
"""Complex numbers, in double or long double precision."""

Ball: TypeAlias = Any
"""A ball of FLINT: an `arb` for the modes of odd functions, otherwise an `acb`."""


@dataclass(frozen=True, eq=False, repr=False)
class BarrierProof(Result):
    """A proof that a rotational invariant circle exists, or the reason why no proof was found.

    The proof is about one forcing kappa, or about a patch: all forcings s·(kappa + t·tilt) with
    scales[0] ≤ s ≤ scales[1] and |t| ≤ 1.

    Attributes
    ----------
    proved : bool
        True if the circle is proved to exist; False implies nothing about its existence.
    reason : str
        "" if proved, else "not proved: " and the reason.
    omega : RotationNumber
        Rotation number per period.
    kappa : tuple of P floats
        Forcing. The proof holds for exactly these floats.
    short_omega, short_kappa
        Rotation number and forcing after shortening (`symmetries.shorten`); the proof applies to
        these. Forcings in a triangle or a plane are not shortened.
    tilt : tuple of float
        For a patch, one float for each strength of short_kappa; otherwise empty.
    scales : tuple of 2 floats
        Bounds of s for a patch; otherwise empty.
    n : int
        Number of grid points.
    rho : float
        Half width ρ of the strip for which the constants hold; NaN if E was not bounded. If the
        first step is computed, E was bounded in the strip of half width 2ρ.
    constants : dict of float
        Upper bounds on the constants of the theorem for all s and t; see proofs/README.md. If the
        first step is computed, n, p, k and error refer to u before the step, w bounds ‖w_j‖ in
        the step, and the other constants follow from the bounds after it.
    unit : int
        Binary exponent of the coefficients.
    coefficients : list
        Entry [m][l][j] is [re, im], two lists of integers: C_jml has the modes
        (re[k] + i im[k])·2^unit, k ≥ 0, and modes beyond the lists are 0. These functions are the
        coefficients in the Chebyshev expansion u_j = Σ C_jml T_m(σ) T_l(t); σ is s, rescaled to
        [-1, 1]. For one forcing, m = l = 0.
    plane : Plane, optional
        For a patch in a plane; kappa and tilt are then coordinates, and s multiplies displacements
        from the plane's origin.
    stepped : bool
        True if the proof computes the first step, and thus uses a different theorem.

    Examples
    --------
    >>> from nasm.proofs.barrier import prove
    >>> prove("gamma", (0.3, 0.2))
    <BarrierProof: the circle [0;(1)] exists under (0.3, 0.2); proved on ... points>
    """

    proved: bool
    reason: str
    omega: RotationNumber
    kappa: tuple[float, ...]
    short_omega: RotationNumber
    short_kappa: tuple[float, ...]
    tilt: tuple[float, ...] = ()
    scales: tuple[float, ...] = ()
    n: int = 0
    rho: float = nan
    constants: dict[str, float] = field(default_factory=dict)
    unit: int = 0
    coefficients: list[Any] = field(default_factory=list)
    plane: Plane | None = None
    stepped: bool = False

    def __repr__(self) -> str:
        proved = f"exists under {self._forcings()}; proved on {self.n} points"
        outcome = proved if self.proved else f"under {self._forcings()} is {self.reason}"
        return f"<BarrierProof: the circle {self.omega} {outcome}>"

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        ratio = self.constants.get("ratio", nan)
        rows = {
            "rotation number": omega_text(self.omega, len(self.kappa)),
            "forcing": self._forcings(),
            "outcome": "a rotational invariant circle exists" if self.proved else self.reason,
            "points": f"{self.n}" if self.n else "",
            "left side of (1) in proofs/README.md, relative to its bound": (
                "" if isnan(ratio) else f"{32 * ratio:.2g}"
            ),
        }
        return html_table(rows, "Proof that a barrier exists")

    def _forcings(self) -> str:
        if not self.scales:
            return f"{self.kappa}"
        low, high = self.scales
        tilted = f"({self.kappa} + t·{self.tilt}), |t| ≤ 1" if any(self.tilt) else f"{self.kappa}"
        within = f" in {self.plane.name}" if self.plane else ""
        return f"s·{tilted}, {low:g} ≤ s ≤ {high:g}{within}"

    def certificate(self) -> dict[str, Any]:
        """Return what another program needs to check the proof, as a JSON-serializable dict.

        Raises
        ------
        ValueError
            If nothing was proved.

        Examples
        --------
        >>> from nasm.proofs import barrier, certificate_checker
        >>> certificate_checker.check(barrier.prove("gamma", (0.4, 0.2)).certificate())
        'a rotational invariant circle of [0;(1)] exists under the forcing (0.4, 0.2)'
        """
        fields: dict[str, Any] = {
            "omega": str(self.short_omega),
            "rho": self.rho.hex(),
            "moves": {"unit": self.unit, "numbers": self.coefficients},
        }
        theorem = "A barrier exists" + (" by an explicit step" if self.stepped else "")
        if self.scales:
            step = " by explicit steps" if self.stepped else ""
            fields |= {"tilt": in_hex(self.tilt), "scales": in_hex(self.scales)}
            theorem = f"A barrier exists in a fan{step}"
        if self.plane:
            fields |= {"plane": matrix_in_hex(self.plane), "centre": in_hex(self.kappa)}
            theorem = f"A barrier exists in a patch of a plane{step}"
        else:
            original = {"omega": str(self.omega), "kappa": in_hex(self.kappa)}
            fields |= {"kappa": in_hex(self.short_kappa), "shortened_from": original}
        forcings = self.kappa, self.tilt, self.omega, self.scales, self.plane
        return certificate(self, theorem, fields, *forcings)


def prove(
    omega: OmegaLike,
    kappa: ArrayLike,
    n: int | None = None,
    start: ArrayLike | None = None,
    budget: float = 20.0,
) -> BarrierProof:
    """Prove that the circle with rotation number omega exists under the forcing kappa.

    1. Shorten the forcing if it repeats itself (`symmetries.shorten`).
    2. Compute the circle in doubles, by `circles.invariant_circle`, unless `start` is passed.
    3. Refine it by Newton's method, with linear algebra in doubles and the residual E in
       ball arithmetic.
    4. Try to verify the hypotheses of the theorem with each residual. If they cannot be verified,
       repeat step 3 on a grid with at least a third more points, as long as a finer grid helps and
       the budget lasts.

    FLINT's precision is global to the process, so proofs in several threads wait for each other.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period, irrational, e.g. "gamma".
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first. The proof holds for exactly these floats.
    n : int, optional
        Number of grid points, even, from 64 to 4194304; by default chosen from the decay of the
        modes.
    start : array_like, shape (P, m), optional
        Approximate deviations u of the circle on a grid. If the forcing is shortened, only the
        first rows are used.
    budget : float
        CPU seconds; grids that would take longer are not attempted, unless n is given.

    Returns
    -------
    BarrierProof
        A failed proof implies nothing about the circle's existence.

    Raises
    ------
    ImportError
        If python-flint is not installed.
    ValueError
        If omega is not a rotation number, if kappa is too large or not finite, or if another
        argument is out of range.

    References
    ----------
    J.-Ll. Figueras, A. Haro and A. Luque, Found. Comput. Math. 17 (2017) 1123, arXiv:1601.00084:
    computer-assisted a-posteriori KAM proofs. `nasm/proofs/README.md` states the theorem used here.

    Examples
    --------
    >>> from nasm.proofs.barrier import prove
    >>> prove("gamma", (0.9,)).proved
    True
    >>> prove("3/5", (0.2,)).reason
    'not proved: omega is rational, so its circles are not barriers'
    """
    omega = as_rotation_number(omega)
    kappa = forcing(kappa)
    budget = positive("budget", budget, "seconds of computing time")
    if n is not None and count("n", n, 64, _MAX_POINTS) % 2:
        raise ValueError(f"n={n} must be even; it is the number of grid points")
    need_flint()
    (short,), short_omega = shorten([kappa], omega)
    about: dict[str, Any] = {"omega": omega, "kappa": tuple(kappa.tolist())}
    about |= {"short_omega": short_omega, "short_kappa": tuple(short.tolist())}
    if omega.is_rational:
        reason = "not proved: omega is rational, so its circles are not barriers"
        return BarrierProof(False, reason, **about)
    until = time.thread_time() + budget
    if start is None:
        circle = circles.invariant_circle(short_omega, short, 2**16)
        if not circle.certified:
            reason = f"not proved: no circle was found: {circle.status.value}"
            return BarrierProof(False, reason, **about)
        start = circle.u
    else:
        start = np.asarray(start, dtype=float)
        # If rounding has made strengths equal, start may have more rows than the short forcing.
        rows = range(short.size, kappa.size + 1, short.size)
        if start.ndim != 2 or start.shape[0] not in rows or not start.size:
            raise ValueError(
                f"start has shape {start.shape}; for the shortened forcing {short.tolist()} it "
                f"must have {short.size} rows, each with the values of one function on a grid"
            )
        start = start[: short.size]
    if not np.isfinite(start).all():
        return BarrierProof(False, "not proved: the start is not finite", **about)
    return _proved(short_omega, short, start, n, until, about)


def proved_lower(
    omega: OmegaLike, profile: ArrayLike, value: float, budget: float
) -> tuple[float, BarrierProof | None]:
    """Search for a scale s, as large as possible, at which the circle of omega is proved to exist.

    The forcing is s·profile. Proofs are attempted closer and closer to the breakup until the budget
    is spent; the work is proportional to the distance from the breakup to the power -1.2 to -1.4. A
    proof holds for exactly s·profile rounded to doubles. It implies nothing about smaller scales,
    at which the circle might not exist; `patches.proved_below` covers these scales.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period, irrational.
    profile : array_like, shape (P,)
        Direction of the ray, not zero.
    value : float
        Scale at which the circle breaks, e.g. from `periodic.critical_scale`; between 1e-300 and
        1e306. Used only to choose where to try proofs.
    budget : float
        Approximate limit in CPU seconds. Proofs reach 0.95 of the breakup scale in 0.1 s, and more
        than 0.99 in 1 s.

    Returns
    -------
    scale : float
        Scale at which the proof holds; NaN if nothing was proved.
    proof : BarrierProof or None
        Proof at that scale, or the last failed attempt; None if no circle was found in doubles.

    Raises
    ------
    ImportError
        If python-flint is not installed.
    ValueError
        If an argument is out of range.

    Examples
    --------
    >>> from nasm.proofs import proved_lower
    >>> scale, proof = proved_lower("gamma", (1.0,), 0.971635, budget=0.2)
    >>> proof.proved, 0.9 < scale < 0.971635
    (True, True)
    """
    omega, profile = as_rotation_number(omega), direction(profile)
    value = real("value", value, MIN_SIZE, MAX_STRENGTH / MIN_SIZE)
    budget = positive("budget", budget, "seconds of computing time")
    need_flint()
    (short,), short_omega = shorten([profile], omega)
    best, best_proof, distance, until = nan, None, 0.05, time.thread_time() + budget
    while 1e-6 <= distance <= 0.5:
        before = time.thread_time()
        scale, u = hull.certified_circle(short_omega, short, value, distance)
        proof = u is not None and prove(
            omega, scale * profile, start=u, budget=max(until - before, 1e-3)
        )
        now = time.thread_time()
        if proof and proof.proved and not scale <= best:
            best, best_proof = scale, proof
            closer = min(16, (max(until - now, 0) / (1.1 * (now - before))) ** 0.7)
            distance /= closer if closer > 1.1 else inf
        elif best_proof is None or not best_proof.proved:
            best_proof, distance = proof or None, 2 * distance
        else:  # go halfway back to the best scale
            distance = sqrt(distance * (1 - best / value))
            if distance > 0.9 * (1 - best / value) or now > until:
                break
    return best, best_proof


def need_flint() -> None:
    """Check that python-flint is installed.

    Raises
    ------
    ImportError
        If it is not installed; the `name` of the error is "flint".

    Examples
    --------
    >>> from nasm.proofs import need_flint
    >>> need_flint()
    """
    if arb is None:
        message = "a proof needs python-flint: pip install 'nasm-transport[proof]'"
        raise ImportError(message, name="flint")


def _proved(
    omega: RotationNumber,
    kappa: FloatArray,
    start: FloatArray,
    n: int | None,
    until: float,
    about: dict[str, Any],
) -> BarrierProof:
    """Try to prove that a circle exists near `start`, on finer and finer grids."""
    size, before = n or grid_size(start), None
    while True:
        seconds = _SECONDS_PER_POINT * size * kappa.size
        if not n and (size > _MAX_POINTS or seconds > until - time.thread_time()):
            reason = f"not proved: {size} points, some {seconds:.1g} seconds, are beyond the budget"
            return BarrierProof(False, reason, **about, n=size)
        with working_precision(128 if size < 2**18 else 160):
            outcome = refined(Grid(omega, kappa.tolist(), size), start)
        ratio = outcome.pop("estimated_ratio", inf)
        proof = BarrierProof(**about, n=size, **outcome)
        if proof.proved or n or (before is not None and not ratio < 0.5 * before):
            return proof
        size, before = fast_size(4 * size // 3), ratio


# --- the rotation number --------------------------------------------------------------------------


def _omega_ball(omega: RotationNumber, bits: int) -> Ball:
    """Return ω as a ball: |ω - p_n/q_n| < 1/(q_n q_{n+1}), with q_n q_{n+1} > 2^bits."""
    last = None
    for f in convergents(omega):
        if last is not None and last.denominator * f.denominator >> bits:
            radius = arb(1) / (last.denominator * f.denominator)
            return arb(last.numerator) / last.denominator + arb(0, 1) * radius
        last = f


@lru_cache(maxsize=64)
def _divisors(omega: RotationNumber) -> list[tuple[int, Ball, bool]]:
    """Return (q_n, |e^{2πiq_nω} - 1|, whether n is in the last period) for n = 0, 1, …

    The last period of quotients returned begins 40 quotients or more after the start of the tail;
    its terms bound the terms of all later n.
    """
    length = len(omega.tail)
    last = len(omega.prefix) + (40 // length + 2) * length
    fractions = [*islice(convergents(omega), last)]
    bits = 2 * max(map(abs, fractions[-1].as_integer_ratio())).bit_length() + 64
    with working_precision(bits):
        ball = _omega_ball(omega, bits)
        return [
            (f.denominator, 2 * abs((ball * f.denominator).sin_pi()), n >= last - length)
            for n, f in enumerate(fractions)
        ]


def _russmann(omega: RotationNumber, delta: Ball) -> Ball:
    """Bound C_R = sup δ'σ(δ') over 0 < δ' ≤ δ, σ(δ) = sup_k e^{-2πkδ}/|e^{2πikω} - 1|.

    For any delta, the terms of the last period are replaced by their peaks. Multiplied by 1 + 10⁻⁶,
    these bound the terms of all later n. See README.md, "Small divisors".
    """
    worst, two_pi = arb(0), 2 * arb.pi()
    for q, divisor, ends in _divisors(omega):
        if not ends and 1 / (two_pi * q) > delta:
            term = delta * (-two_pi * q * delta).exp() / divisor
        else:
            term = 1 / (two_pi * arb(1).exp() * q * divisor)
        worst = worst.max(term * (1 + arb(10) ** -6) if ends else term)
    return worst


# --- the residual ---------------------------------------------------------------------------------


class Grid:
    """The chain of P sites on n points, with the balls that every call of `residual` needs."""

    def __init__(self, omega: RotationNumber, kappa: Sequence[float], n: int) -> None:
        self.omega, self.n, self.sites, self.odd = omega, n, len(kappa), len(kappa) <= 2
        self.kappa = [arb(k) for k in kappa]
        alpha, half = _omega_ball(omega, ctx.prec + 40) / self.sites, n // 2
        phases = [2 * alpha * k for k in range(half)]
        if self.odd:  # factors for u_{j+1}(φ + α) + u_{j-1}(φ - α), as u_{j+1} = u_{j-1}
            self.turn = [2 * x.cos_pi() for x in phases]
        else:
            self.turn = [acb(x).exp_pi_i() for x in phases]
        self.angles = [arb(2 * i) / n for i in range(half if self.odd else n)]

    def under(self, kappa: list[Ball]) -> Self:
        """Return a copy of this grid with different strengths."""
        other = copy(self)
        other.kappa = kappa
        return other

    def samples(self, modes: list[list[Ball]]) -> list[list[Ball]]:
        """Return the values of real functions at φ = i/n, i < n/2 if they are odd, else i < n."""
        rows = [row + [arb(0)] * (self.n // 2 - len(row)) for row in modes]
        if self.odd:
            return self._sines(rows)
        ends = [([acb(x).conjugate() for x in row], row[:0:-1]) for row in rows]
        return [[v.real for v in acb.dft([*low, arb(0), *high])] for low, high in ends]

    def modes(self, values: list[list[Ball]]) -> list[list[Ball]]:
        """Return the modes 0, …, n/2 - 1, aliased, of the real functions with these values."""
        rows = self._sines(values) if self.odd else map(acb.dft, values)
        return [[x / self.n for x in row[: self.n // 2]] for row in rows]

    def _sines(self, rows: list[list[Ball]]) -> list[list[Ball]]:
        """Return 2 Σ_k x_k sin(2πki/n), i < n/2, for one or two rows of n/2 reals with x_0 = 0."""
        x = [acb(*pair) for pair in zip(*rows, strict=True)]
        y = acb.dft([*x, arb(0), *(-v for v in x[:0:-1])])[: self.n // 2]  # -i times the sum
        return [[-v.imag for v in y], [v.real for v in y]][: len(rows)]


def residual(grid: Grid, u: list[list[Ball]]) -> list[list[Ball]]:
    """Return the modes 0, …, n/2 - 1 of E_j, in which the contribution of the sine is aliased."""
    sines = [
        [(angle + 2 * x).sin_pi() for angle, x in zip(grid.angles, row, strict=True)]
        for row in grid.samples(u)
    ]
    E = []
    for j, sine in enumerate(grid.modes(sines)):
        strength = -grid.kappa[j] / (2 * arb.pi())
        row = [strength * x for x in sine]
        after, before = u[(j + 1) % grid.sites], u[j - 1]
        for k, (own, a, b, turn) in enumerate(zip(u[j], after, before, grid.turn, strict=False)):
            neighbours = a * turn if grid.odd else a * turn + b * turn.conjugate()
            row[k] += neighbours - 2 * own
        E.append(row)
    return E


# --- the theorem ----------------------------------------------------------------------------------


def norm(a: list[Ball], rho: Ball) -> Ball:
    """Bound ‖f‖_ρ = Σ|f_k| e^{2π|k|ρ} of a real f with |f_k| ≤ a_k, k ≥ 0."""
    return 2 * arb_poly(a)((2 * arb.pi() * rho).exp()) - a[0]


def slope_modes(row: list[Ball], odd: bool) -> list[Ball]:
    """Return the modes of g_j' = 1 + u_j'."""
    factor = 2 * arb.pi() if odd else 2 * arb.pi() * acb(0, 1)
    return [arb(1), *(factor * k * x for k, x in enumerate(row[1:], 1))]


def bounds_of_the_residual(
    grid: Grid,
    u: list[list[Ball]],
    E: list[list[Ball]],
    rho: Ball,
    rho_hat: Ball,
    cut: int,
) -> list[Ball]:
    """Bound ‖E_j‖_ρ, given bounds u and E on the absolute values of the modes.

    |sin 2πg_j| ≤ M for |Im φ| ≤ ρ̂, so its modes are below M e^{-2πρ̂|k|}. Modes |k| < cut are taken
    from E, which contains their aliases k + n, k - n, …; the others are modes of the sine alone.
    """
    n, two_pi, bounds = grid.n, 2 * arb.pi(), []
    if not (max(map(len, u)) <= cut <= n // 2 and 0 < rho < rho_hat):
        raise ValueError(f"cut={cut}, rho={rho}, rho_hat={rho_hat} are out of range")
    r, r_hat = (two_pi * rho).exp(), (two_pi * rho_hat).exp()
    q, less = r / r_hat, 1 - (-two_pi * rho_hat * n).exp()
    aliases = 1 / (1 - q) + (two_pi * cut * (rho + rho_hat)).exp() / (r * r_hat - 1)
    aliases *= 2 * (-two_pi * n * rho_hat).exp() / less
    rest = 2 * (two_pi * cut * (rho - rho_hat)).exp() / (1 - q)
    for a, e, kappa in zip(u, E, grid.kappa, strict=True):
        sine = abs(kappa) / two_pi * largest_sine(a, rho_hat)
        bounds.append(norm(e[:cut], rho) + sine * (aliases + rest))
    return bounds


def largest_sine(u: list[Ball], rho_hat: Ball) -> Ball:
    """Return M ≥ |sin 2πg_j| for |Im φ| ≤ ρ̂, given bounds on the absolute values of the modes."""
    polynomial, r_hat = arb_poly(u), (2 * arb.pi() * rho_hat).exp()
    return (2 * arb.pi() * (rho_hat + polynomial(r_hat) - polynomial(1 / r_hat))).cosh()


def bound_of_the_inverse(
    slope: list[Ball],
    near: ComplexArray,
    rho: Ball,
    odd: bool,
    kept: int,
    moved: Ball | int = 0,
) -> Ball:
    """Bound p ≥ ‖1/g'‖_ρ = ‖d/(1 - (1 - g'd))‖ for all g' with ‖g' - slope‖ ≤ moved.

    The modes of d are doubles near those of 1/g'; the bound is infinite if ‖1 - g'd‖ ≥ 1. The
    product g'd is computed for the first `kept` modes of slope, and bounded for the others.
    """
    d = [arb(x.real) if odd else acb(x.real, x.imag) for x in near]
    sizes = [x.abs_upper() for x in slope]
    beyond = norm([arb(0)] * kept + sizes[kept:], rho) if kept < len(slope) else 0
    both = [both_sides(half, odd) for half in (slope[:kept], d)]
    product, middle = both[0] * both[1], len(slope[:kept]) + len(d) - 2
    defect = [product[middle + k] for k in range(middle + 1)]
    defect[0] -= 1
    size = norm([x.abs_upper() for x in d], rho)
    small = norm([x.abs_upper() for x in defect], rho) + (beyond + moved) * size
    return size / (1 - small) if small < 1 else arb.pos_inf()


def both_sides(half: list[Ball], odd: bool) -> Any:
    """Return the polynomial with all modes of a real f as coefficients, given those with k ≥ 0."""
    if odd:
        return arb_poly(half[:0:-1] + half)
    return acb_poly([acb(x).conjugate() for x in half[:0:-1]] + half)


def inequalities(
    omega: RotationNumber,
    kappa: list[Ball],
    rho: Ball,
    eps: Ball,
    n: list[Ball],
    p: list[Ball],
    k: list[Ball],
    part: float = 1,
) -> tuple[list[str], dict[str, Ball]]:
    """Return the names of the inequalities that fail, and the constants of the theorem.

    The constants are the left-hand sides, the largest |κ_j|, δ, C and ε. An inequality fails unless
    its left-hand side is below `part` times its right-hand side, 0 < part ≤ 1.
    """
    two_pi, e = 2 * arb.pi(), arb(1).exp()
    eps = eps.max(arb(2) ** -1000)  # any upper bound is valid, and 0 would give 0/0
    tau, eta, given = arb(1) / 10, arb(1) / 100, arb(99) / 100
    delta = given * rho / (4 + 2 * tau)
    C = _russmann(omega, delta) + delta
    q = [a * b for a, b in zip(p, p[1:] + p[:1], strict=True)]
    w = 2 * C**2 * sum(q) * (1 + eta) ** 2  # ‖w_j‖ ≤ w ε/δ²
    x = [two_pi * (1 + eta) * a * w * eps / delta**2 for a in n]  # 2π‖v_j‖
    ratio = w * eps / (2 * e * delta**3)
    for a, b, strength, y in zip(n, k, kappa, x, strict=True):
        taylor = b * (arb(0.5) + y / 6) * y.exp() * y**2
        ratio += a * abs(strength) / two_pi * (1 + eta) * taylor / eps
    chi = arb(4) / 3 * (1 + eta) * w * eps / (e * tau * delta**3)
    room, moved = arb(0), arb(0)
    for a, b, c, y in zip(q, n, n[1:] + n[:1], x, strict=True):
        room = room.max(a * b * c * (2 * chi + chi**2))
        moved = moved.max((4 * y / 3).expm1())
    left = {"ratio": ratio, "chi": chi, "room": room, "moved": moved}
    right = {"ratio": arb(1) / 32, "chi": eta, "room": eta / (1 + eta), "moved": eta}
    failed = [name for name in left if not left[name] < part * right[name]]
    largest = reduce(arb.max, map(abs, kappa))
    return failed, left | {"kappa": largest, "delta": delta, "C": C, "epsilon": eps}


def verified(
    grids: list[Grid],
    u: list[list[list[Ball]]],
    E: list[list[list[Ball]]],
    sizes: list[list[list[Ball]]],
    apart: list[Ball],
    kappa: list[Ball],
    between: Callable[[Ball, Ball, list[Ball], int], Ball],
    largest: Ball,
    part: float = 1,
) -> dict[str, Any]:
    """Try to verify the theorem for all forcings of a patch.

    Parameters
    ----------
    grids, u, E
        Grids with the forcings at the interpolation points of the patch, and the modes of u and E
        at these points.
    sizes
        For each degree (m, l), the absolute values of the modes of C_jml.
    apart
        For each degree, a bound on the deviation of T_m T_l from its value at the nearest point.
    kappa
        The strengths κ_j; for a patch, bounds on |κ_j|.
    between : callable
        Maps (error, rho, norms of the C_jml, j) to a bound on ‖E_j‖ on the whole patch, where
        `error` is the bound at the points.
    largest
        Bound on Σ|ℓ_i|, where the polynomials ℓ_i interpolate between the points.
    part : float
        As for `inequalities`.

    Returns
    -------
    dict
        Fields of a `BarrierProof`, and `estimated_ratio`, the left-hand side of (1) in README.md,
        estimated in floats. Apart from this, floats are used only to choose ρ, ρ̂, the cut and
        the polynomials near 1/g_j'.
    """
    (grid, *_), two_pi = grids, 2 * arb.pi()
    bounds = [[[[x.abs_upper() for x in row] for row in t] for t in rows] for rows in (u, E)]
    largest_u, largest_E = (np.array(rows, dtype=float).max(axis=0) for rows in bounds)
    inverses = [
        np.fft.rfft(1 / slopes_on_grid(as_doubles(x, grid.odd), grid.n)) / grid.n for x in u
    ]
    chosen = best_widths(grid, largest_u, largest_E, np.abs(inverses[0]))
    rho, rho_hat = arb(chosen["rho"]), arb(chosen["rho_hat"])
    errors = [
        bounds_of_the_residual(grid, u_sizes, E_sizes, rho, rho_hat, chosen["cut"])
        for grid, u_sizes, E_sizes in zip(grids, *bounds, strict=True)
    ]
    norms = [[norm(row, rho) for row in table] for table in sizes]  # [m][j]
    slopes = [[two_pi * norm([i * x for i, x in enumerate(row)], rho) for row in t] for t in sizes]
    n, p, k, everywhere = [], [], [], []
    for j in range(grid.sites):
        n.append(1 + sum(row[j] for row in slopes))
        k.append((two_pi * (rho + sum(row[j] for row in norms))).exp())
        moved = sum(a * row[j] for a, row in zip(apart, slopes, strict=True))
        of_points = []
        with working_precision(64):
            for modes, near in zip(u, inverses, strict=True):
                slope, d = slope_modes(modes[j], grid.odd), near[j, : chosen["modes"]]
                bound = bound_of_the_inverse(slope, d, rho, grid.odd, chosen["kept"], moved)
                of_points.append(bound)
        p.append(reduce(arb.max, of_points))
        error = reduce(arb.max, [at[j] for at in errors])
        everywhere.append(between(error, rho, [row[j] for row in norms], j))
    eps = sum(a * b for a, b in zip(n, everywhere, strict=True))
    failed, left = inequalities(grid.omega, kappa, rho, eps, n, p, k, part)
    outcome = _outcome(failed, left, rho, {"error": everywhere, "n": n, "p": p, "k": k})
    if failed:
        after = verified_by_a_step(
            grids, u, bounds, sizes, apart, kappa, between, largest, part, inverses, chosen
        )
        outcome = after if after["proved"] else outcome
    return outcome | {"estimated_ratio": chosen["estimated_ratio"]}


def _outcome(
    failed: list[str], left: dict[str, Ball], rho: Ball, of_sites: dict[str, list[Ball]]
) -> dict[str, Any]:
    """Return fields of a `BarrierProof`, given the constants of the theorem and of the sites."""
    left = left | {key: reduce(arb.max, values) for key, values in of_sites.items()}
    # Round up: the float nearest to the upper end of a ball may be below it.
    constants = {key: float(np.nextafter(float(x.upper()), inf)) for key, x in left.items()}
    reason = f"not proved: inequalities of the theorem fail: {', '.join(failed)}" if failed else ""
    return {"proved": not failed, "reason": reason, "rho": float(rho), "constants": constants}


# --- the theorem after a computed first step ------------------------------------------------------


@dataclass(frozen=True)
class Majorant:
    """Bounds on f = f₁ + f₂: |modes of f₁| ≤ sizes, and ‖f₂‖ ≤ rest in the norm of some strip.

    Entry k of sizes bounds the modes k and -k. The strip of `rest` is not stored: the caller
    passes it to each function that depends on it. In a narrower strip the same bounds hold.
    """

    sizes: list[Ball]
    rest: Ball

    def norm(self, rho: Ball) -> Ball:
        """Bound ‖f‖_ρ, in the strip of `rest` or a narrower one."""
        return norm(self.sizes, rho) + self.rest

    def __add__(self, other: Self) -> "Majorant":
        both = zip_longest(self.sizes, other.sizes, fillvalue=arb(0))
        return Majorant([a + b for a, b in both], self.rest + other.rest)

    def times(self, other: "Majorant", rho: Ball) -> "Majorant":
        """Bound the product in the strip ρ, which must not be wider than that of either rest."""
        product = both_sides(self.sizes, True) * both_sides(other.sizes, True)
        middle = len(self.sizes) + len(other.sizes) - 2
        rest = norm(self.sizes, rho) * other.rest + self.rest * other.norm(rho)
        return Majorant([product[middle + k] for k in range(middle + 1)], rest)

    def divided(self, divisors: list[Ball], sigma: Ball) -> "Majorant":
        """Bound Rf in a strip that is narrower by δ, given sigma ≥ σ(δ).

        R drops the mean of f and divides mode k by e^{2πikω} - 1; see README.md, "The step".
        """
        pairs = zip(self.sizes[1:], divisors[: len(self.sizes) - 1], strict=True)
        return Majorant([arb(0), *(x / divisor for x, divisor in pairs)], self.rest * sigma)


def bounds_of_the_step(
    omega: RotationNumber,
    slopes: list[Majorant],
    E: list[Majorant],
    inverses: list[Majorant],
    outer: Ball,
    rho: Ball,
) -> list[Ball]:
    """Bound ‖w_j‖_ρ in the step v_j = g_j'w_j, from majorants of g_j', E_j, 1/g_j' in `outer`.

    Up to phases, which do not affect the bounds, this is the step defined in README.md, "The step".
    """
    delta = (outer - rho) / 2
    middle, sigma = outer - delta, _russmann(omega, delta) / delta
    sums = [*accumulate(a.times(b, outer) for a, b in zip(slopes, E, strict=True))]
    over = [a.times(b, middle) for a, b in zip(inverses, inverses[1:] + inverses[:1], strict=True)]
    divisors = _all_divisors(omega, len(sums[-1].sizes) + max(len(f.sizes) for f in over))
    turned = sums[-1].divided(divisors, sigma)
    fluxes = [turned + f for f in sums]
    mean = reduce(arb.max, [f.norm(arb(0)) for f in fluxes])  # ≥ |b| in README.md
    fluxes = [f + Majorant([mean], arb(0)) for f in fluxes]
    steps = [f.times(g, middle) for f, g in zip(fluxes, over, strict=True)]
    first = reduce(Majorant.__add__, steps).divided(divisors, sigma)
    return [w.norm(rho) for w in accumulate([first, *steps[:-1]])]


def modes_of_the_sine(n: int, rho: Ball, rho_hat: Ball, cut: int) -> Majorant:
    """Bound the error of E_j if only modes |k| < cut, computed on n points, are used.

    The error consists of the aliases of these modes and of the omitted modes. The bounds assume
    that |sin 2πg_j| ≤ 1 in |Im φ| ≤ ρ̂ and |κ_j| = 2π; the caller rescales them. Modes |k| ≥ n are
    bounded by `rest`, in the strip ρ.
    """
    if not (0 < cut <= n // 2 and 0 < rho < rho_hat):
        raise ValueError(f"cut={cut}, rho={rho}, rho_hat={rho_hat} are out of range")
    r_hat, q = (2 * arb.pi() * rho_hat).exp(), (2 * arb.pi() * (rho - rho_hat)).exp()
    around = r_hat**-n / (1 - r_hat**-n)
    aliases = [(r_hat**k + r_hat**-k) * around for k in range(cut)]
    return Majorant([*aliases, *(r_hat**-k for k in range(cut, n))], 2 * q**n / (1 - q))


def _all_divisors(omega: RotationNumber, size: int) -> list[Ball]:
    """Return |e^{2πikω} - 1| for k = 1, …, size."""
    ball = _omega_ball(omega, ctx.prec + 40)
    return [2 * abs((ball * k).sin_pi()) for k in range(1, size + 1)]


def bound_of_the_slope(f: Majorant, outer: Ball, rho: Ball) -> Ball:
    """Bound ‖f'‖_ρ, given a majorant of f in the strip `outer`."""
    two_pi = 2 * arb.pi()
    slopes = norm([two_pi * i * x for i, x in enumerate(f.sizes)], rho)
    return slopes + f.rest / (arb(1).exp() * (outer - rho))


def inequalities_after_a_step(
    omega: RotationNumber,
    kappa: list[Ball],
    rho: Ball,
    n: list[Ball],
    p: list[Ball],
    k: list[Ball],
    w: list[Ball],
    slopes_of_E: list[Ball],
    part: float = 1,
) -> tuple[list[str], dict[str, Ball]]:
    """Return what `inequalities` returns, for g_j + v_j in the strip 0.98ρ.

    The constants n, p and k are those of g_j in the strip ρ; w and slopes_of_E are bounds on
    ‖w_j‖_ρ and ‖E_j'‖_ρ.
    """
    two_pi, narrow = 2 * arb.pi(), rho * 98 / 100
    after: dict[str, list[Ball]] = {"n": [], "p": [], "k": [], "error": []}
    for a, b, c, size, slope, strength in zip(n, p, k, w, slopes_of_E, kappa, strict=True):
        y = two_pi * a * size  # 2π‖v_j‖
        moved = a * size / (arb(1).exp() * (rho - narrow))  # ‖v_j'‖
        after["n"].append(a + moved)
        after["p"].append(b / (1 - b * moved) if b * moved < 1 else arb.pos_inf())
        after["k"].append(c * y.exp())
        taylor = c * (arb(0.5) + y / 6) * y.exp() * y**2
        after["error"].append(slope * size + abs(strength) / two_pi * taylor)
    eps = sum(a * b for a, b in zip(after["n"], after["error"], strict=True))
    return inequalities(omega, kappa, narrow, eps, after["n"], after["p"], after["k"], part)


def verified_by_a_step(
    grids: list[Grid],
    u: list[list[list[Ball]]],
    bounds: list[list[list[list[Ball]]]],
    sizes: list[list[list[Ball]]],
    apart: list[Ball],
    kappa: list[Ball],
    between: Callable[[Ball, Ball, list[Ball], int], Ball],
    largest: Ball,
    part: float,
    inverses: list[ComplexArray],
    chosen: dict[str, Any],
) -> dict[str, Any]:
    """Try to verify the theorem after computing a first step, for all forcings of a patch.

    Most arguments are those of `verified`. At the points, `bounds` contains the absolute values of
    the modes of u and E, and `inverses` approximate modes of 1/g_j'. `chosen` is the result of
    `best_widths`.
    """
    (grid, *_), two_pi = grids, 2 * arb.pi()
    rho, rho_hat = arb(_STEP_WIDTH * chosen["rho"]), arb(chosen["rho_hat"])
    outer, cut = 2 * rho, chosen["cut"]
    if max(len(row) for rows in bounds[0] for row in rows) > cut:
        raise ValueError(f"cut={cut} is below the highest mode of u")
    n, p, k, errors, slopes_of_E, majorants = [], [], [], [], [], []
    with working_precision(64):
        for j in range(grid.sites):
            total = sum((arb_poly(row[j]) for row in sizes), arb_poly())
            weighted = [[i * x for i, x in enumerate(row[j])] for row in sizes]
            slope = Majorant(
                [arb(1), *(two_pi * i * total[i] for i in range(1, len(total)))], arb(0)
            )
            moved = two_pi * sum(a * norm(x, outer) for a, x in zip(apart, weighted, strict=True))
            near, missed = [], []
            for modes, of_inverse in zip(u, inverses, strict=True):
                d = of_inverse[j, : chosen["modes"]]
                bound = bound_of_the_inverse(
                    slope_modes(modes[j], grid.odd), d, outer, grid.odd, chosen["kept"], moved=moved
                )
                near.append([abs(arb(x.real) if grid.odd else acb(x.real, x.imag)) for x in d])
                missed.append(bound - norm(near[-1], outer))
            inverse = Majorant(_largest_sizes(near), reduce(arb.max, missed))
            known = Majorant(_largest_sizes([row[j][:cut] for row in bounds[1]]), arb(0))
            sines = [
                abs(at.kappa[j]) / two_pi * largest_sine(row[j], rho_hat)
                for at, row in zip(grids, bounds[0], strict=True)
            ]
            unknown = modes_of_the_sine(grid.n, outer, rho_hat, cut)
            points = known + unknown.times(Majorant([reduce(arb.max, sines)], arb(0)), outer)
            rest = between(points.rest, outer, [norm(row[j], outer) for row in sizes], j)
            error = Majorant([largest * x for x in points.sizes], rest)
            majorants.append((slope, error, inverse))
            n.append(slope.norm(rho))
            p.append(inverse.norm(rho))
            k.append(
                (two_pi * (rho + norm([total[i] for i in range(max(1, len(total)))], rho))).exp()
            )
            errors.append(error.norm(rho))
            slopes_of_E.append(bound_of_the_slope(error, outer, rho))
        of_slopes, of_E, of_inverses = ([row[i] for row in majorants] for i in range(3))
        w = bounds_of_the_step(grid.omega, of_slopes, of_E, of_inverses, outer, rho)
        failed, left = inequalities_after_a_step(
            grid.omega, kappa, rho, n, p, k, w, slopes_of_E, part
        )
    of_sites = {"error": errors, "n": n, "p": p, "k": k, "w": w}
    return _outcome(failed, left, rho, of_sites) | {"stepped": True}


def _largest_sizes(rows: list[list[Ball]]) -> list[Ball]:
    """Return the largest of the bounds on each mode."""
    return [reduce(arb.max, sizes) for sizes in zip(*rows, strict=True)]


def balls(coefficients: list[list[list[int]]], unit: int, size: int, odd: bool) -> list[list[Ball]]:
    """Return the exact modes k < size of functions, given the integers of a `BarrierProof`."""
    scale: Ball = arb(2) ** unit
    rows = []
    for parts in coefficients:
        if any(parts[1][:1]) or (odd and parts[0]):
            raise ValueError("modes must be those of a real function, odd for one or two kicks")
        re, im = ([*(x * scale for x in part), *[arb(0)] * (size - len(part))] for part in parts)
        rows.append([arb(-b) for b in im] if odd else [acb(*x) for x in zip(re, im, strict=True)])
    return rows


# --- choices and Newton's method, on which no proof depends ---------------------------------------


@np.errstate(all="ignore")
def best_widths(grid: Grid, u: FloatArray, e: FloatArray, near: FloatArray) -> dict[str, Any]:
    """Choose ρ, ρ̂ and the cut, in floats; `estimated_ratio` is the resulting left side of (1)."""
    n, K = grid.n, u.shape[1] - 1
    k, strength = np.arange(n // 2), np.abs(np.array(grid.kappa, dtype=float))[:, None] / (2 * pi)
    hats = decay(u.max(axis=0)) * np.geomspace(0.005, 1.25, 60)
    imaginary = [2 * (u * np.sinh(2 * pi * hat * k[: K + 1])).sum(axis=1) for hat in hats]
    sizes = np.cosh(2 * pi * (hats[:, None] + imaginary)) * np.exp(-pi * n * hats)[:, None]
    best = np.argmin(np.nan_to_num(sizes.max(axis=1), nan=inf))
    hat, M = hats[best], sizes[best][:, None] * np.exp(pi * n * hats[best])
    beyond = (e[:, K + 1 :] > strength * M * np.exp(-2 * pi * hat * k[K + 1 :])).all(axis=0)
    cut = K + 1 + int(beyond.argmax()) if beyond.any() else n // 2
    near = np.where(near < 1e-13 * near.max(), 0, near)  # remove rounding errors
    trials = []
    for rho in hat * np.geomspace(0.015, 0.24, 12):
        weights = np.where(k > 0, 2, 1) * np.exp(2 * pi * rho * k)
        errors = e[:, :cut] @ weights[:cut]
        ends = np.exp(2 * pi * cut * (rho - hat)) + np.exp(2 * pi * (cut * (rho + hat) - n * hat))
        errors += (strength * M)[:, 0] * ends / (pi * (hat - rho))
        slopes = 2 * pi * u * k[: K + 1] * weights[: K + 1]
        n_j = 1 + slopes.sum(axis=1)
        inverse = near[:, :-1] * weights
        p = inverse.sum(axis=1)
        size = np.exp(2 * pi * (rho + (u * weights[: K + 1]).sum(axis=1)))
        n_balls, p_balls, k_balls = ([arb(x) for x in row] for row in (n_j, p, size))
        eps = arb((n_j * errors).sum())
        _, left = inequalities(grid.omega, grid.kappa, arb(rho), eps, n_balls, p_balls, k_balls)
        trials.append(
            {
                "estimated_ratio": np.nan_to_num(float(left["ratio"].mid()), nan=inf),
                "rho": float(rho),
                "rho_hat": float(hat),
                "cut": cut,
                "kept": _leading(slopes, 1e-6),
                "modes": _leading(inverse, 1e-5),
            }
        )
    return min(trials, key=lambda trial: trial["estimated_ratio"])


def _leading(weighted: FloatArray, small: float) -> int:
    """Count the leading columns that contain all but a fraction `small` of each row's sum."""
    left = np.cumsum(weighted[:, ::-1], axis=1)[:, ::-1] < small * weighted.sum(axis=1)[:, None]
    return int(left.all(axis=0).argmax()) or weighted.shape[1]


def decay(sizes: FloatArray, least: float = 1e-12) -> float:
    """Fit ρ in sizes_k ~ e^{-2πρk} to the modes larger than `least` times the largest."""
    k = np.arange(len(sizes))
    good = (k > 0) & (sizes > least * sizes[1:].max(initial=0))
    good[: good.sum() // 10] = False
    if good.sum() < 3:
        return 1.0
    return max(-np.polyfit(k[good], np.log(sizes[good]), 1)[0] / (2 * pi), 0.1 / len(k))


@np.errstate(all="ignore")
def refined(grid: Grid, start: FloatArray) -> dict[str, Any]:
    """Refine `start` by Newton's method until the theorem is verified, or the residual stagnates.

    Return fields of a `BarrierProof`, and `estimated_ratio`, as `verified` does.
    """
    K, turn = int(MODES_PER_POINT * grid.n), turns(grid.omega, grid.sites, grid.n // 2 + 1)
    modes, last, unit = polished(grid.kappa, grid.n, turn, start), inf, -ctx.prec
    if not np.isfinite(modes).all():
        return {"proved": False, "reason": "not proved: Newton's method diverges for this start"}
    modes = as_balls(modes, grid.odd)
    for _ in range(_MAX_NEWTON_STEPS):
        coefficients = [integers(row, unit) for row in modes]
        modes = balls(coefficients, unit, K + 1, grid.odd)
        E, sizes = residual(grid, modes), [[[x.abs_upper() for x in row] for row in modes]]
        outcome = verified(
            [grid], [modes], [E], sizes, [0], grid.kappa, lambda error, *_: error, arb(1)
        )
        outcome |= {"unit": unit, "coefficients": [[coefficients]]}
        size = _largest_mode(E, K + 1)
        if outcome["proved"] or not size < 0.5 * last:
            break
        last, following = size, stepped(grid, turn, modes, E)
        if following is None:
            break
        modes = following
    return outcome


def _largest_mode(E: list[list[Ball]], K: int) -> float:
    return max(float(x.abs_upper()) for row in E for x in row[:K])


def stepped(
    grid: Grid, turn: ComplexArray, modes: list[list[Ball]], E: list[list[Ball]]
) -> list[list[Ball]] | None:
    """Return the modes after a Newton step, given the residual E, or None if the step fails."""
    K = len(modes[0])
    scale = arb(_largest_mode(E, K))
    step = correction(turn, as_doubles(modes, grid.odd), as_doubles(E, grid.odd, 1 / scale))
    if not np.isfinite(step).all():
        return None
    return [
        [(a + scale * b).mid() for a, b in zip(row, add, strict=True)]
        for row, add in zip(modes, as_balls(step[:, :K], grid.odd), strict=True)
    ]


def turns(omega: RotationNumber, n_sites: int, n_modes: int) -> ComplexArray:
    """Return e^{2πikα}, α = ω/P, in long double, from a convergent of ω; see `fourier.turns`."""
    for f in convergents(omega):
        if f.denominator * n_sites > 10**12:
            break
        p, q = f.numerator, f.denominator * n_sites
    x = (np.arange(n_modes) * (p % q) % q).astype(np.longdouble) / q
    return np.exp(2j * np.arccos(np.longdouble(-1)) * x)


def polished(kappa: Sequence[Any], n: int, turn: ComplexArray, start: FloatArray) -> ComplexArray:
    """Refine values of a circle on a grid by Newton's method in long double; return its modes.

    Modes as small as rounding errors are left unchanged, because small divisors would make their
    errors larger than u itself.
    """
    modes = np.zeros((len(kappa), int(MODES_PER_POINT * n) + 1), np.clongdouble)
    known = np.fft.rfft(start)[:, : modes.shape[1]] / start.shape[1]
    to_sites = turn[: known.shape[1]].conj() ** np.arange(len(kappa))[:, None]
    modes[:, : known.shape[1]] = known * to_sites
    K, last, best = modes.shape[1], inf, modes
    kept = np.arange(K) < _LOG_ROUNDING / (
        2 * pi * decay(np.abs(modes).max(axis=0).astype(float), 1e-6)
    )
    two_pi, rotation = 2 * np.arccos(np.longdouble(-1)), turn[:K]
    strength, theta = np.array(kappa, float)[:, None] / two_pi, np.arange(n) / np.longdouble(n)
    for _ in range(_MAX_NEWTON_STEPS):
        x = theta + np.fft.irfft(modes, n) * n
        E = -np.fft.rfft(strength * np.sin(two_pi * x)) / n
        E[:, :K] += np.roll(modes, -1, axis=0) * rotation - 2 * modes
        E[:, :K] += np.roll(modes, 1, axis=0) * rotation.conj()
        size = np.abs(E[:, :K]).max()
        if not size < 0.5 * last:
            break
        best, last = modes, size
        step = correction(turn, modes.astype(complex), (E / size).astype(complex))
        modes = modes + size * step[:, :K] * kept
    return best


def correction(turn: ComplexArray, modes: ComplexArray, E: ComplexArray) -> ComplexArray:
    """Return the modes of Levi and Moser's step, in doubles, for the modes E of the residual.

    `modes` and `E` have shape (P, ..., number of modes). See `nasm.circles`.
    """
    n, sites = 2 * (turn.size - 1), np.arange(len(modes)).reshape(-1, *[1] * (modes.ndim - 1))
    turn = turn.astype(complex)
    shift = turn**sites  # the step is computed for h_j(θ), with the same θ for all j
    slopes = slopes_on_grid(modes * shift[..., : modes.shape[-1]], n)
    residual = np.fft.irfft(E * shift[..., : E.shape[-1]], n) * n
    whole = turn ** len(modes)
    inverse = 1 / (slopes * np.concatenate([slopes[1:], fourier.rotate(slopes[:1], whole)]))
    flux = -np.cumsum(slopes * residual, axis=0)
    flux = fourier.solve_cohomology(flux[-1], whole, n // 2) + flux
    mean = (flux * inverse).sum((0, -1)) / inverse.sum((0, -1))
    flux = (flux - mean[..., None]) * inverse
    w = fourier.solve_cohomology(flux.sum(axis=0), whole, n // 2)
    w = w + np.cumsum(flux, axis=0) - flux
    w -= (slopes[0] * w[0]).mean(-1)[..., None]
    return np.fft.rfft(slopes * w) / n * shift.conj()


def slopes_on_grid(modes: ComplexArray, n: int) -> FloatArray:
    """Return g_j' at φ = i/n."""
    k = np.arange(modes.shape[-1])
    return 1 + np.fft.irfft(2j * pi * k * modes, n) * n


def as_balls(modes: ComplexArray, odd: bool) -> list[list[Ball]]:
    """Convert modes in long double to exact balls; each long double is split into two doubles."""

    def exact(x):
        high = x.astype(float)
        low = (x - high).astype(float)
        return [arb(a) + arb(b) for a, b in zip(high.tolist(), low.tolist(), strict=True)]

    if odd:
        return [exact(-row.imag) for row in modes]
    both = [zip(exact(row.real), exact(row.imag), strict=True) for row in modes]
    return [[acb(*pair) for pair in row] for row in both]


def as_doubles(rows: list[list[Ball]], odd: bool, scale: Ball | int = 1) -> ComplexArray:
    """Round balls to an array of complex doubles."""
    if odd:
        return -1j * np.array([[float(x * scale) for x in row] for row in rows])
    return np.array([[complex(x * scale) for x in row] for row in rows])


def integers(row: list[Ball], unit: int) -> list[list[int]]:
    """Round modes to integers times 2^unit; return the integers as [re, im]."""
    odd, scale = isinstance(row[0], arb), arb(2) ** -unit  # odd: the modes are -i·row
    rounded = []
    parts = ([], [-x for x in row]) if odd else ([x.real for x in row], [x.imag for x in row])
    for part in parts:
        numbers = [int((x * scale + 0.5).mid().floor().unique_fmpz()) for x in part]
        while numbers and not numbers[-1]:
            numbers.pop()
        rounded.append(numbers)
    return rounded


def grid_size(start: FloatArray) -> int:
    """Choose the grid size from the decay of the circle's modes; it suffices on nearly all rays."""
    rate = decay(np.abs(np.fft.rfft(start)).max(axis=0), 1e-6)
    return fast_size(max(64, 2 * ceil(max(5.5, -2.2 * log(rate)) / rate)))


def fast_size(n: int) -> int:
    """Return the smallest 2^k, 5·2^k or 6·2^k ≥ n; FLINT transforms these sizes twice as fast."""
    power = 2 ** (n.bit_length() - 3)
    return power * next(m for m in (4, 5, 6, 8) if m * power >= n)
