"""Invariant tori of the rotating standard map, for an irrational Ω.

The forcing κ_n = κ̄ + Δκ cos 2πφ_n, φ_n = φ0 + nΩ, never repeats. The analogues of circles under a
periodic forcing are tori, two-dimensional graphs over (θ, φ):

    x_n = h(θ_n, φ_n) = θ_n + u(θ_n, φ_n),     θ_{n+1} = θ_n + ω,   φ_{n+1} = φ_n + Ω,
    E = u(θ + ω, φ + Ω) - 2u + u(θ - ω, φ - Ω) - (κ(φ)/2π) sin 2πh = 0.

The unknown is u on a grid of m × n points, an array of shape (m, n) with φ along its first axis. It
is unique up to θ → θ + constant, and ⟨u⟩ = 0 fixes the constant. One torus serves all phases φ0.

The step of Newton's method is the same as in `nasm.circles`, with one site and with (θ, φ) in place
of θ. Write the correction as h_θ w, and f⁺ and f⁻ for f(θ ± ω, φ ± Ω). Up to terms of order E²,

    c (w⁺ - w) - [c (w⁺ - w)]⁻ = -h_θ E,     c = h_θ h_θ⁺.

This equation is solved by two divisions by e^{2πi(k₁ω + k₂Ω)} - 1 in Fourier space. The modes in
use lie in an ellipse whose semi-axes are 36% of the number of points along each axis. A rotation
vector is refused as resonant if a mode in use has a divisor below 10⁻⁶. Near the rim of the
ellipse, resonant modes are left out, because the modes that they drive lie beyond the rim, and
without these Newton's method would diverge. The largest divisor that counts as resonant increases
towards the rim. The estimated contribution of the modes left out is added to the unresolved part of
u. The grid is refined along each axis separately.

With too few modes Newton's method converges to "tori" beyond the breakup. Therefore a torus is
certified only if the method converges again, with h_θ > 0, on a grid twice as fine along both axes.

No renormalisation theory predicts exponents for the breakup of tori, and norms grow irregularly as
it is approached. The quantity max (h⁻¹)' = 1/min h_θ grows more regularly: `critical_scale` fits a
power law to it, which yields both the breakup and the exponent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from math import inf, isfinite, log, nan

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.roots import root
from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import count, floats, positive, real
from nasm.circles.newton import NewtonSettings, lagrange, step_outcome
from nasm.maps import TWO_PI, direction, forcing
from nasm.numbers import RotationNumber
from nasm.results import CriticalScale, Result, Status
from nasm.tables import html_table
from nasm.types import FloatArray

__all__ = [
    "InvariantTorus",
    "TorusSettings",
    "critical_scale",
    "graph",
    "invariant_torus",
    "residual",
]

_METHOD = "continuation of tori"
MAX_POINTS = 2**22
"""Largest `n_max`; the certificate uses four times as many points."""

TORUS_NEWTON_SETTINGS = NewtonSettings(min_divisor=1e-6)


@dataclass(frozen=True)
class TorusSettings:
    """Grids and modes of tori, and how far tori are continued towards their breakup.

    Attributes
    ----------
    first_grid : tuple of int
        Number of points of the first grid along φ and θ.
    max_points : int
        Maximum number of grid points of a torus on the way to its breakup; the certificate uses
        four times as many.
    inner_radius : float
        Squared relative radius, in the ellipse of modes, up to which all modes are used.
    outer_radius : float
        Squared relative radius beyond which modes count as outer modes.
    hole_divisor : float
        Divisor below which modes are left out at the rim; further in, this limit is quadratic in
        the distance from `inner_radius`.
    max_halvings : int
        Number of times a step is halved before a failure of Newton's method is final.
    max_refusals : int
        Number of times a step is halved before a lack of modes is final.
    max_tori : int
        Maximum number of tori on a ray; 10 to 25 are needed.
    kept_tori : int
        Number of tori kept at the end of a path; only these are candidates for a certificate.
    step_ratio : float
        Ratio of the next step to the estimated distance from the breakup.
    error_factor : float
        Ratio of the error estimate to the distance of the last torus from the breakup; the estimate
        was large enough in 172 of 177 cases.
    newton : NewtonSettings
        Criteria for the convergence of Newton's method, and the ratio of modes to points along an
        axis. Its fields for certificates apply to circles only.

    Examples
    --------
    >>> from nasm.tori import TorusSettings, invariant_torus
    >>> settings = TorusSettings(first_grid=(32, 64))
    >>> invariant_torus(0.618034, 0.414214, 0.1, 0.05, settings=settings).u.shape
    (32, 64)
    """

    first_grid: tuple[int, int] = (64, 128)
    max_points: int = 2**20
    inner_radius: float = 0.5
    outer_radius: float = 0.72
    hole_divisor: float = 0.2
    max_halvings: int = 12
    max_refusals: int = 3
    max_tori: int = 60
    kept_tori: int = 10
    step_ratio: float = 0.35
    error_factor: float = 2
    newton: NewtonSettings = TORUS_NEWTON_SETTINGS


DEFAULT_SETTINGS = TorusSettings()


@dataclass(frozen=True, eq=False, repr=False)
class InvariantTorus(Result):
    """A torus with rotation vector (omega, frequency), or the last iterate of Newton's method.

    Attributes
    ----------
    omega, frequency : float
        Turns of θ and φ per kick.
    mean, amplitude : float
        κ̄ and Δκ.
    u : ndarray, shape (m, n)
        Deviations at φ = j/m and θ = i/n; see the module docstring.
    error : float
        Largest |E| of u on a finer grid; NaN if u never converged.
    status : Status
        OK if certified; otherwise the reason.

    Notes
    -----
    Tori are compared by their contents, with NaN equal to NaN. They contain arrays and cannot be
    hashed.
    """

    omega: float
    frequency: float
    mean: float
    amplitude: float
    u: FloatArray
    error: float
    status: Status

    @property
    def certified(self) -> bool:
        """True if the status is OK."""
        return self.status is Status.OK

    def __repr__(self) -> str:
        state = "certified" if self.certified else f"not certified: {self.status.value}"
        return (
            f"<InvariantTorus of ({self.omega:.12g}, {self.frequency:.12g}) under "
            f"{self.mean:g} + {self.amplitude:g} cos 2πφ, {state}>"
        )

    def _repr_html_(self) -> str:
        rows = {
            "rotation vector": f"({self.omega:.15g}, {self.frequency:.15g}) per kick",
            "forcing": f"{self.mean:g} + {self.amplitude:g} cos 2πφ",
            "status": "certified on a finer grid" if self.certified else self.status.value,
            "grid": "{} × {} points".format(*self.u.shape),
            "largest residual": f"{self.error:.1e}",
        }
        return html_table(rows, "Invariant torus")


def invariant_torus(
    omega: float | RotationNumber,
    frequency: float | RotationNumber,
    mean: float,
    amplitude: float,
    n_max: int = 2**18,
    settings: TorusSettings = DEFAULT_SETTINGS,
) -> InvariantTorus:
    """Compute the torus of (omega, frequency) under κ(φ) = mean + amplitude·cos 2πφ.

    1. Continue the torus from κ = 0 by Newton's method: double the step after a success and halve
       it after a failure.
    2. Double the grid along an axis if its outer modes carry more than 0.3% of the second
       derivatives along that axis.
    3. Certify the torus: Newton's method must converge again on a grid twice as fine along both
       axes, with h_θ > 0.

    Parameters
    ----------
    omega, frequency : float or RotationNumber
        Turns of θ and φ per kick.
    mean, amplitude : float
        κ̄ and Δκ.
    n_max : int
        Maximum number m·n of grid points, 8192 to 2²²; the certificate uses 4 times as many.
    settings : TorusSettings
        Grids and modes.

    Returns
    -------
    InvariantTorus
        If the torus is not certified, the status gives the reason.

    Raises
    ------
    ValueError
        If an argument is not a finite number, or n_max is out of range.

    Notes
    -----
    With too few modes, an existing torus may be missed. The existence of a certified torus
    is established only up to floating-point errors and the resolution of 4 m·n points. Resonances
    beyond the modes of that grid are not detected: if Ω is a fraction with a large denominator, the
    certificate refers to the family of circles for all phases as a whole.

    Examples
    --------
    >>> from nasm.numbers import parse
    >>> from nasm.tori import invariant_torus
    >>> invariant_torus(parse("gamma"), 0.4142135623730951, 0.1, 0.05)
    <InvariantTorus of (0.61803398875, 0.414213562373) under 0.1 + 0.05 cos 2πφ, certified>
    """
    vector, kappa = _vector(omega, frequency), forcing(_pair(mean, amplitude))
    rotation = np.zeros(settings.first_grid)
    n_max = count("n_max", n_max, rotation.size, MAX_POINTS)
    step, path, status = 1.0, [(0.0, rotation)], Status.OK
    while path[-1][0] < 1.0 and status is Status.OK:
        step = min(step, 1 - path[-1][0])
        reached, u, status = _next_torus(vector, kappa, path, step, n_max, settings)
        step = 2 * (reached - path[-1][0])
        path.append((reached, u))
    pair = float(kappa[0]), float(kappa[1])
    if status is not Status.OK:
        return InvariantTorus(*vector, *pair, u, nan, status)
    error, status = certify(*vector, *pair, u, settings)
    return InvariantTorus(*vector, *pair, u, error, status)


def critical_scale(
    omega: float | RotationNumber,
    frequency: float | RotationNumber,
    mean: float,
    amplitude: float,
    tol: float = 1e-3,
    settings: TorusSettings = DEFAULT_SETTINGS,
) -> CriticalScale:
    """Compute the scale at which the torus breaks on the ray (κ̄, Δκ) = s·(mean, amplitude).

    1. Continue the torus from s = 0, each step being a fixed fraction of the estimated distance to
       the breakup: min h_θ falls like (s_c - s)^p, and three tori determine s_c and p.
    2. Stop when `error` is below tol, or the available modes are exhausted.
    3. Of the last ten tori, certify the last one that can be certified.

    Parameters
    ----------
    omega, frequency : float or RotationNumber
        Turns of θ and φ per kick.
    mean, amplitude : float
        The direction (κ̄, Δκ), not zero.
    tol : float
        Target absolute error of the scale.
    settings : TorusSettings
        Grids and modes, and how far tori are continued.

    Returns
    -------
    CriticalScale
        lower : the scale of the certified torus, NaN if there is none. upper : NaN. error : twice
        the distance of the last torus from the estimated breakup, or the last change of this
        estimate if that is larger; p is unknown and is fitted, too. omega : None,
        because a pair of numbers is not a RotationNumber. If there is no estimate, value and error
        are NaN and the status gives the reason; lower is reported even then.

    Raises
    ------
    ValueError
        If the direction is zero or tiny, an argument is not finite, or tol is not positive.

    Examples
    --------
    >>> from nasm.numbers import parse
    >>> from nasm.tori import critical_scale
    >>> scale = critical_scale(parse("gamma"), 0.4142135623730951, 1.0, 0.5, tol=0.2)
    >>> scale.lower < scale.value
    True
    """
    vector, profile = _vector(omega, frequency), direction(_pair(mean, amplitude))
    tol = positive("tol", tol, "the error to aim at, e.g. tol=1e-3")
    path, value, error, status = _continue(vector, profile, tol, settings)
    certified_scales = (
        s
        for s, u in reversed(path)
        if s > 0 and certify(*vector, s * profile[0], s * profile[1], u, settings)[1] is Status.OK
    )
    lower = next(certified_scales, nan)
    if not error < value:
        status = Status.NOT_CONVERGED if status is Status.OK else status
        return CriticalScale(nan, nan, lower, nan, None, status, _METHOD)
    return CriticalScale(value, error, lower, nan, None, Status.OK, _METHOD)


def solve(
    omega: float,
    frequency: float,
    mean: float,
    amplitude: float,
    u: FloatArray,
    n_max: int,
    settings: TorusSettings = DEFAULT_SETTINGS,
) -> tuple[FloatArray, Status]:
    """Solve for a torus by Newton's method, starting from u and refining the grid as needed.

    Returns
    -------
    u : ndarray
        Deviations on the grid where the method converged; the last iterate if it did not.
    status : Status
        OK, or the reason.
    """
    while True:
        u, outcome, _ = _newton(omega, frequency, mean, amplitude, u, settings)
        m, n = u.shape
        if outcome not in _REFINEMENTS or 2 * m * n > n_max:
            return u, _OUTCOMES[outcome]
        by_phi, by_theta = _REFINEMENTS[outcome]
        u = resample(u, by_phi * m, by_theta * n)


def certify(
    omega: float,
    frequency: float,
    mean: float,
    amplitude: float,
    u: FloatArray,
    settings: TorusSettings = DEFAULT_SETTINGS,
) -> tuple[float, Status]:
    """Certify a torus on a grid twice as fine along both axes.

    Returns
    -------
    error : float
        Largest |E| of u on that grid.
    status : Status
        OK if Newton's method converges from u on that grid with h_θ > 0, and without needing more
        modes; NEARLY_RATIONAL or NOT_CERTIFIED otherwise.
    """
    m, n = u.shape
    fine = resample(u, 2 * m, 2 * n)
    _, outcome, error = _newton(omega, frequency, mean, amplitude, fine, settings)
    status = _OUTCOMES[outcome]
    return error, status if status in (Status.OK, Status.NEARLY_RATIONAL) else Status.NOT_CERTIFIED


def residual(
    omega: float | RotationNumber,
    frequency: float | RotationNumber,
    mean: float,
    amplitude: float,
    u: ArrayLike,
) -> FloatArray:
    """Compute E on the grid of u, an array of shape (m, n); E is zero on a torus.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.tori import residual
    >>> residual(0.618, 0.54, 0.0, 0.0, np.zeros((16, 16))).any()
    np.False_
    """
    (omega, frequency), (mean, amplitude) = _vector(omega, frequency), _pair(mean, amplitude)
    m, n = (u := floats("u", u)).shape
    kappa = mean + amplitude * cos2pi(np.arange(m) / m)[:, None]
    ahead, behind = shifted(u, omega, frequency), shifted(u, -omega, -frequency)
    return ahead - 2 * u + behind - kappa / TWO_PI * sin2pi(np.arange(n) / n + u)


def shifted(u: FloatArray, theta: float, phi: float) -> FloatArray:
    """Compute u(θ + theta, φ + phi) on the grid of u."""
    m, n = u.shape
    turn = _turns(phi, _wave_numbers(m))[:, None] * _turns(theta, np.arange(n // 2 + 1))
    return np.fft.irfft2(np.fft.rfft2(u) * turn, u.shape)


def graph(torus: InvariantTorus) -> tuple[FloatArray, FloatArray]:
    """Return x and y of the torus just before a kick of phase φ = j/m, at θ = i/n.

    Returns
    -------
    x, y : ndarrays, shape (m, n)
        Both in turns; x is on the lift, i.e. not reduced mod 1.

    Examples
    --------
    >>> from nasm.tori import graph, invariant_torus
    >>> x, y = graph(invariant_torus(0.618, 0.54, 0.0, 0.0))
    >>> y[0, :2].round(6)
    array([0.618, 0.618])
    """
    behind = shifted(torus.u, -torus.omega, -torus.frequency)
    theta = np.arange(torus.u.shape[1]) / torus.u.shape[1]
    return theta + torus.u, torus.omega + torus.u - behind


def least_slope(u: FloatArray) -> float:
    """Compute min h_θ on the grid; it is positive on a torus and 0 at its breakup."""
    modes = np.fft.rfft(u)
    return 1 + np.fft.irfft(modes * 2j * np.pi * np.arange(modes.shape[1]), u.shape[1]).min()


def resample(u: FloatArray, m: int, n: int) -> FloatArray:
    """Interpolate u onto a grid of m × n points."""
    modes, (old_m, old_n) = np.fft.rfft2(u), u.shape
    finer = np.zeros((m, n // 2 + 1), complex)
    rows, columns = min(m, old_m) // 2, min(n, old_n) // 2
    finer[:rows, :columns] = modes[:rows, :columns]
    finer[1 - rows :, :columns] = modes[1 - rows :, :columns]
    return np.fft.irfft2(finer * (m * n / u.size), (m, n))


def extrapolate(path: Sequence[tuple[float, FloatArray]], target: float) -> FloatArray:
    """Extrapolate deviations to the scale `target`, from the last three tori of a path."""
    scales, tori = zip(*path[-3:], strict=True)
    weights = lagrange(scales, target)
    shape = tori[-1].shape
    terms = (weight * resample(u, *shape) for weight, u in zip(weights, tori, strict=True))
    return sum(terms, np.zeros(shape))


def _next_torus(vector, profile, path, step, n_max, settings):
    """Return the scale, u and Status of a torus at most `step` beyond the end of the path.

    After every second failure the grid is also doubled along one axis, because a resonance just
    beyond the modes of the last torus can be mistaken for the breakup.
    """
    for failures in range(settings.max_halvings):
        target, doublings = path[-1][0] + step, failures // 2
        u = extrapolate(path, target)
        while u.size * 2**doublings > n_max and doublings > 0:
            doublings -= 1
        u = resample(u, u.shape[0] << doublings // 2, u.shape[1] << (doublings + 1) // 2)
        u, status = solve(*vector, *(target * profile), u, n_max, settings)
        if status in (Status.OK, Status.NEARLY_RATIONAL):
            break
        if status is Status.TOO_FEW_MODES and failures >= settings.max_refusals:
            break
        step /= 2
    return target, u, status


def _continue(vector, profile, tol, settings):
    """Continue the torus towards its breakup.

    Returns the last tori, the estimate of the breakup, its error (inf without an estimate), and the
    Status: OK, or the reason why the path ends.
    """
    path, slopes = [(0.0, np.zeros(settings.first_grid))], [(0.0, 1.0)]
    value, error, step, status = nan, inf, 0.1 / np.abs(profile).max(), Status.OK
    while error > tol and len(slopes) < settings.max_tori and step > 1e-6 * path[-1][0]:
        scale, u, status = _next_torus(vector, profile, path, step, settings.max_points, settings)
        if status is not Status.OK:
            break
        step = 2 * (scale - path[-1][0])
        path = [*path, (scale, u)][-settings.kept_tori :]
        slopes.append((scale, least_slope(u)))
        last_value, value = (
            value,
            _breakup(*zip(*slopes[-3:], strict=True)) if len(slopes) > 3 else nan,
        )
        error = (
            max(settings.error_factor * (value - scale), abs(value - last_value))
            if isfinite(value - last_value)
            else inf
        )
        step = min(step, settings.step_ratio * (value - scale)) if isfinite(value) else step
    return path, value, error, status


def _breakup(scales, slopes):
    """Fit min h_θ = a·(s_c - s)^p through three tori; return s_c, or NaN if no such fit exists."""
    _, second, third = scales
    near, far = third + 1e-9 * (third - second), third + 100 * (third - scales[0])
    if not (near > third and all(slope > 0 for slope in slopes)):
        return nan
    steps = [log(before / after) for before, after in pairwise(slopes)]

    def excess(value):
        gaps = [log(value - scale) for scale in scales]
        return steps[0] * (gaps[1] - gaps[2]) - steps[1] * (gaps[0] - gaps[1])

    if not min(steps) > 0 or not excess(near) > 0 > excess(far):
        return nan
    return root(excess, near, far)


def _vector(
    omega: float | RotationNumber, frequency: float | RotationNumber
) -> tuple[float, float]:
    """Return both numbers as floats; raise ValueError if one is not finite."""
    numbers = []
    for name, value in (("omega", omega), ("frequency", frequency)):
        number = float(value) if isinstance(value, RotationNumber) else real(name, value)
        if not isfinite(number):
            raise ValueError(f"{name}={value!r} must be finite; it counts turns per kick")
        numbers.append(number)
    first, second = numbers
    return first, second


def _pair(mean: float, amplitude: float) -> tuple[float, float]:
    return real("mean", mean), real("amplitude", amplitude)


def _wave_numbers(m):
    k = np.arange(m)
    return np.where(2 * k < m, k, k - m)


def _turns(number, k):
    """Compute e^{2πik·number} for integers k; the phases are computed exactly, modulo 2⁶⁴."""
    unit = np.uint64(int(Fraction(number) % 1 * 2**64))
    return np.exp(1j * TWO_PI * ((k.astype(np.uint64) * unit).astype(np.int64) / 2.0**64))


@lru_cache(maxsize=8)  # entries hold arrays as large as the grid
def _constants(omega, frequency, m, n, settings):
    """Return e^{2πi(k₂Ω + k₁ω)} of all modes, their kinds, and the smallest divisor in use.

    The kind is 0 for the mean and for modes beyond the ellipse, 1 for an inner mode, 2 or 3 for an
    outer mode nearer to the θ or to the φ axis, and 4 or 5 likewise for a hole, which is a resonant
    mode near the rim that is left out.
    """
    k2, k1 = _wave_numbers(m)[:, None], np.arange(n // 2 + 1)
    turn = _turns(frequency, k2) * _turns(omega, k1)
    mode_ratio, inner_radius = settings.newton.grid.mode_ratio, settings.inner_radius
    across, along = (k2 / (mode_ratio * m)) ** 2, (k1 / (mode_ratio * n)) ** 2
    radius, divisor = across + along, np.abs(turn - 1)
    rim = (radius - inner_radius) / (1 - inner_radius)
    hole = (radius > inner_radius) & (divisor < settings.hole_divisor * rim**2)
    kind = np.where(hole, 4, np.where(radius > settings.outer_radius, 2, 1)).astype(np.int8)
    kind += (kind > 1) & (along <= across)
    kind[k1 >= np.floor(mode_ratio * n * np.sqrt(np.maximum(1 - across, 0)))] = 0
    kind[0, 0] = 0
    return turn, kind, divisor[(kind > 0) & (kind < 4)].min()


_OUTCOMES = (
    Status.OK,
    Status.TOO_FEW_MODES,
    Status.TOO_FEW_MODES,
    Status.NO_CIRCLE,
    Status.NEARLY_RATIONAL,
)
_REFINEMENTS = {1: (1, 2), 2: (2, 1)}  # more modes along θ, or along φ


def _newton(omega, frequency, mean, amplitude, u, settings=DEFAULT_SETTINGS):
    """Iterate Newton's method on the grid of u.

    Returns the new u, an index into _OUTCOMES, and the error before the first step.
    """
    turn, kind, divisor = _constants(omega, frequency, *u.shape, settings)
    newton = settings.newton
    if divisor < newton.min_divisor:
        return u, 4, nan
    modes, limits = np.fft.rfft2(u), (newton.max_steps, newton.max_update, newton.max_tail)
    outcome, error = _iterate(float(mean), float(amplitude), turn, kind, modes, *limits)
    return np.fft.irfft2(modes, u.shape), outcome, error


@kernel(error_model="numpy")
def _iterate(mean, amplitude, turn, kind, modes, max_steps, max_update, max_tail):
    """Take Newton steps until the outcome is clear; return its index and the first error.

    The index refers to _OUTCOMES. The iteration is the same as in `nasm.circles`, except that modes
    may be missing along either axis.
    """
    first = last_error = last_change = 1.0
    for step in range(max_steps):
        error, change, slope, twist, tails = _step(mean, amplitude, turn, kind, modes)
        first = error if step == 0 else first
        tail = tails.max()
        outcome = step_outcome(
            error, change, slope, twist, tail, last_error, last_change, max_update, max_tail
        )
        if outcome == 0 or (outcome == 1 and tails[0] > tails[1]):
            return outcome, first
        if outcome == 1:
            return 2, first
        # The iteration diverges, or stalls because of rounding or a lack of modes.
        if outcome == 2 or (step > 3 and change > 0.5 * last_change):
            return 3, first
        last_error, last_change = error, change
    return 3, first


@njit(nogil=True, error_model="numpy")
def _step(mean, amplitude, turn, kind, modes):
    """Take one Newton step for the modes of u, in place; see the module docstring.

    Returns max |E|, the largest update, min h_θ, the twist, and the tails along θ and φ. All but
    the update refer to u before the step.
    """
    m, n = modes.shape[0], 2 * (modes.shape[1] - 1)
    mass, edge = np.zeros(2), np.zeros(2)
    fields = np.fft.irfft2(_fields(turn, kind, modes, mass, edge), (m, n))
    u, bend, slopes, inverse = fields  # u, u⁺ - 2u + u⁻, h_θ and h_θ⁺, which becomes 1/c
    flux = np.empty((m, n))
    error, slope, sum_inverse = 0.0, np.inf, 0.0
    for j in range(m):
        strength = (mean + amplitude * cos2pi(j / m)) / TWO_PI
        for i in range(n):
            bend[j, i] -= strength * sin2pi(i / n + u[j, i])
            flux[j, i] = -bend[j, i] * slopes[j, i]
            inverse[j, i] = 1 / (slopes[j, i] * inverse[j, i])
        for i in range(n):  # a separate loop, so that the one above is vectorized
            error = max(error, abs(bend[j, i]))
            slope = min(slope, slopes[j, i])
            sum_inverse += inverse[j, i]
    flux = _solve_cohomology(flux, turn, kind, True, edge)
    sum_flux = 0.0
    for j in range(m):
        for i in range(n):
            flux[j, i] *= inverse[j, i]
            sum_flux += flux[j, i]
    constant = sum_flux / sum_inverse
    for j in range(m):
        for i in range(n):
            flux[j, i] -= constant * inverse[j, i]  # now w⁺ - w
    w = _solve_cohomology(flux, turn, kind, False, np.zeros(2))
    shift = change = 0.0
    for j in range(m):
        for i in range(n):
            shift += slopes[j, i] * w[j, i] / (m * n)
    for j in range(m):
        for i in range(n):
            w[j, i] = slopes[j, i] * (w[j, i] - shift)
        for i in range(n):
            change = max(change, abs(w[j, i]))
    modes += np.fft.rfft2(w)
    modes[0, 0] = 0.0
    min_mass = max(1e-16 * mass.max(), 1e-300)  # a tail that is only rounding error does not count
    return error, change, slope, sum_inverse / (m * n), np.sqrt(edge / np.maximum(mass, min_mass))


@njit(nogil=True, error_model="numpy")
def _fields(turn, kind, modes, mass, edge):
    """Return the modes of u, u⁺ - 2u + u⁻, h_θ and h_θ⁺; modes not in use are 0.

    Also adds the squared second derivatives along θ and φ to `mass`, and the contributions of the
    outer modes nearer to each axis to `edge`.
    """
    m, n = modes.shape[0], 2 * (modes.shape[1] - 1)
    fields = np.zeros((4, m, n // 2 + 1), np.complex128)
    for j in range(m):
        k2 = j if 2 * j < m else j - m
        for k in range(n // 2 + 1):
            if not 0 < kind[j, k] < 4:
                continue
            a = modes[j, k]
            derivative = complex(-TWO_PI * k * a.imag, TWO_PI * k * a.real)
            fields[0, j, k] = a
            fields[1, j, k] = a * (2 * turn[j, k].real - 2)
            fields[2, j, k] = derivative
            fields[3, j, k] = derivative * turn[j, k]
            power = a.real**2 + a.imag**2
            mass[0] += power * float(k) ** 4
            mass[1] += power * float(k2) ** 4
            if kind[j, k] > 1:
                side = kind[j, k] - 2
                edge[side] += power * float(k2 if side else k) ** 4
    fields[2:, 0, 0] = m * n  # h_θ = 1 + u_θ
    return fields


@njit(nogil=True, error_model="numpy")
def _solve_cohomology(f, turn, kind, behind, edge):
    """Solve g - g⁻ = f if `behind`, else g⁺ - g = f, in the modes in use, with ⟨g⟩ = 0.

    If `behind`, also add to `edge` the contributions of the modes that were left out of u; they are
    estimated as f̂/d², where d is the divisor of the mode.
    """
    m, n = f.shape
    modes = np.fft.rfft2(f)
    for j in range(m):
        k2 = j if 2 * j < m else j - m
        for k in range(n // 2 + 1):
            if 0 < kind[j, k] < 4:
                modes[j, k] *= (turn[j, k] if behind else 1.0) / (turn[j, k] - 1)
                continue
            if behind and kind[j, k] > 3:
                side, divisor = kind[j, k] - 4, abs(turn[j, k] - 1)
                power = (abs(modes[j, k]) / divisor**2) ** 2
                edge[side] += power * float(k2 if side else k) ** 4
            modes[j, k] = 0.0
    return np.fft.irfft2(modes, (m, n))
