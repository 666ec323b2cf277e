"""Invariant circles in chain form: computation by Newton's method, and certification.

The sites of a circle's orbits are x_j = h_j(θ), j = 0, …, P - 1 within a period, and a period takes
θ to θ + ω:

    h_j(θ) = θ + jω/P + u_j(θ),     h_P(θ) = h_0(θ + ω),     h_{-1}(θ) = h_{P-1}(θ - ω),
    E_j = h_{j+1} - 2h_j + h_{j-1} - (κ_j/2π) sin 2πh_j = 0.

The unknowns are the deviations u_j on a grid of n points, an array of shape (P, n). They are unique
up to a shift θ → θ + constant, which ⟨u_0⟩ = 0 fixes.

The Newton step is that of Levi and Moser (Proc. Sympos. Pure Math. 69 (2001) 733). Write the
correction of u_j as h_j' w_j. The linearised equations, multiplied by h_j', telescope up to terms
of order E²:

    c_j (w_{j+1} - w_j) - c_{j-1} (w_j - w_{j-1}) = -h_j' E_j,        c_j = h_j' h_{j+1}'.

Summed over a period, they become an equation g(θ + ω) - g(θ) = f(θ) for the flux
c_j (w_{j+1} - w_j). Its free constant is fixed by ⟨Σ_j (w_{j+1} - w_j)⟩ = 0 if the twist
⟨Σ_j 1/c_j⟩ is not 0, and a second such equation yields w_0. Everything is diagonal in θ or in
Fourier space: O(n log n).

With too few modes Newton's method converges to "circles" far beyond the breakup. Therefore a circle
is certified only if the method converges again, with h' > 0, on a grid four times finer. Circles
that are too close to their breakup for that are certified by a single step from a long periodic
orbit, in `nasm.circles.hull`.

Inside kernels, np.fft is provided by rocket-fft, which Numba loads. Grids have up to 6·10⁶ points;
see `nasm.arithmetic.memory` for programs that compute many circles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import prod

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import sin2pi
from nasm.checks import count, floats
from nasm.circles import fourier
from nasm.maps import TWO_PI, forcing
from nasm.numbers import RotationNumber, as_rotation_number
from nasm.results import Result, Status
from nasm.tables import html_table, omega_text
from nasm.types import FloatArray, OmegaLike

__all__ = [
    "InvariantCircle",
    "NewtonSettings",
    "graph",
    "invariant_circle",
    "newton_step",
    "residual",
]

MIN_POINTS, MAX_POINTS = 64, 2**16
"""Number of points on the first grid, and on the finest one."""


@dataclass(frozen=True)
class NewtonSettings:
    """Convergence criteria for Newton's method, and requirements for certification.

    Attributes
    ----------
    max_steps : int
        Maximum number of steps of Newton's method, which needs 3 to 8 if the circle exists.
    max_update : float
        The method has converged if its last update of u is at most this.
    max_tail : float
        A circle is resolved if the last 15% of its modes carry at most this fraction of the H³
        norm.
    min_divisor : float
        Smallest divisor accepted among the modes in use. Smaller ones turn rounding errors of 10⁻¹⁷
        into updates of u above `max_update`.
    certificate_ratio : int
        Number of points on the certification grid, divided by the number on the circle's grid.
    max_residual : float
        Largest max |E_j| from which a single step may certify a circle.
    reduction : float
        Largest ratio of max |E_j| after that step to max |E_j| before it. At distances d from
        1.6·10⁻⁵ to 3·10⁻³ below 47 breakups under one to six kicks, the ratio was at most 0.012
        (177 cases); at 0.03 d and 0.1 d above them, it was at least 0.035 (354 cases).
    rounding : float
        max |E_j| that is attributed to rounding.
    grid : GridSettings
        Settings for the number of modes used on a grid.

    Examples
    --------
    >>> from nasm.circles import NewtonSettings, invariant_circle
    >>> circle = invariant_circle("gamma", 0.8)
    >>> finer = invariant_circle("gamma", 0.8, settings=NewtonSettings(max_tail=1e-3))
    >>> circle.u.shape, finer.u.shape
    ((1, 128), (1, 256))
    """

    max_steps: int = 12
    max_update: float = 1e-9
    max_tail: float = 3e-3
    min_divisor: float = 1e-5
    certificate_ratio: int = 4
    max_residual: float = 1e-6
    reduction: float = 0.025
    rounding: float = 1e-13
    grid: fourier.GridSettings = fourier.DEFAULT_GRID_SETTINGS


DEFAULT_NEWTON_SETTINGS = NewtonSettings()


@dataclass(frozen=True, eq=False, repr=False)
class InvariantCircle(Result):
    """A circle of rotation number omega, or the last iterate of Newton's method.

    Attributes
    ----------
    omega : RotationNumber
        Rotation number per period.
    kappa : ndarray, shape (P,)
        The forcing, first kick first.
    u : ndarray, shape (P, n)
        Deviations u_j at θ = i/n; see the docstring of this module.
    error : float
        Largest |E_j| of u on its grid or a finer one; NaN if it was not computed.
    status : Status
        OK if certified; otherwise the reason why it is not.

    Notes
    -----
    Circles are compared by their contents, with NaN equal to NaN. Because they contain arrays,
    they cannot be hashed.
    """

    omega: RotationNumber
    kappa: FloatArray
    u: FloatArray
    error: float
    status: Status

    @property
    def certified(self) -> bool:
        """True if the status is OK."""
        return self.status is Status.OK

    def __repr__(self) -> str:
        state = "certified" if self.certified else f"not certified: {self.status.value}"
        return f"<InvariantCircle of {self.omega} under {_forcing_text(self.kappa)}, {state}>"

    def _repr_html_(self) -> str:
        rows = {
            "rotation number": omega_text(self.omega, self.kappa.size),
            "forcing": _forcing_text(self.kappa),
            "status": "certified on a finer grid" if self.certified else self.status.value,
            "grid": f"{self.u.shape[-1]} points",
            "largest residual": f"{self.error:.1e}",
        }
        return html_table(rows, "Invariant circle")


def _forcing_text(kappa: FloatArray) -> str:
    return f"kappa = {np.array2string(kappa, separator=', ', threshold=8)}"


def invariant_circle(
    omega: OmegaLike,
    kappa: ArrayLike,
    n_max: int = 4096,
    start: ArrayLike | None = None,
    settings: NewtonSettings = DEFAULT_NEWTON_SETTINGS,
) -> InvariantCircle:
    """Compute the circle of rotation number omega under the forcing kappa.

    1. Newton's method starts from `start`, or the circle is continued from κ = 0 along s·kappa: the
       step in s is doubled after a success and halved after a failure.
    2. The number of modes is doubled while the highest modes carry more than 0.3% of the H³ norm.
    3. To certify the circle, Newton's method must converge again, with h' > 0, on a grid four
       times finer.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period, irrational, e.g. "gamma".
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    n_max : int
        Maximum number of grid points, 64 to 65536; certification uses 4 times as many.
    start : array_like, shape (P, n), optional
        Deviations near the circle; n is a power of 2, at least 16.
    settings : NewtonSettings
        Criteria for convergence, and requirements for certification.

    Returns
    -------
    InvariantCircle
        The circle; if it is not certified, its status gives the reason.

    Notes
    -----
    An existing circle may be missed with too few modes or a bad start; `barriers.last_circle` finds
    the circle close to a known breakup, on 10⁵ points or more. Certification is strong evidence, in
    floating-point arithmetic on 4n points, that a circle exists. This is not a proof: resonances of
    ω beyond the modes of that grid are not detected, for example if ω is very close to a fraction.

    Examples
    --------
    >>> from nasm.circles import invariant_circle
    >>> invariant_circle("2gamma", (0.3, 0.4))
    <InvariantCircle of [1;(4)] under kappa = [0.3, 0.4], certified>
    >>> invariant_circle("2gamma", (3.0, 3.0)).certified
    False
    """
    omega, kappa = as_rotation_number(omega), forcing(kappa)
    n_max = count("n_max", n_max, MIN_POINTS, MAX_POINTS)
    if start is not None:
        u, status = solve(omega, kappa, _deviations(start, kappa.size).copy(), n_max, settings)
    else:
        u, status = _continue_from_rotation(omega, kappa, n_max, settings)
    if status is not Status.OK:
        return InvariantCircle(omega, kappa, u, np.nan, status)
    return certified(omega, kappa, u, settings)


def solve(
    omega: OmegaLike,
    kappa: FloatArray,
    u: FloatArray,
    n_max: int,
    settings: NewtonSettings = DEFAULT_NEWTON_SETTINGS,
) -> tuple[FloatArray, Status]:
    """Solve for a circle by Newton's method from u, with as many modes as the circle needs.

    Parameters
    ----------
    omega, kappa, n_max, settings
        As for `invariant_circle`.
    u : ndarray, shape (P, n)
        Deviations, which are overwritten.

    Returns
    -------
    u : ndarray, shape (P, m)
        Deviations on the grid where the method converged; the last iterate if it did not.
    status : Status
        OK, or the reason why the method did not converge.
    """
    if as_rotation_number(omega).is_rational:
        return u, Status.RATIONAL
    while True:
        status = _newton(omega, kappa, u, settings)[0]
        n = u.shape[-1]
        if status is not Status.TOO_FEW_MODES or 2 * n > n_max:
            return u, status
        u = fourier.resample(u, 2 * n)


def certified(
    omega: RotationNumber,
    kappa: FloatArray,
    u: FloatArray,
    settings: NewtonSettings = DEFAULT_NEWTON_SETTINGS,
) -> InvariantCircle:
    """Return the InvariantCircle for the deviations u, with the error and status from `certify`."""
    return InvariantCircle(omega, kappa, u, *certify(omega, kappa, u, settings))


def certify(
    omega: OmegaLike,
    kappa: FloatArray,
    u: FloatArray,
    settings: NewtonSettings = DEFAULT_NEWTON_SETTINGS,
) -> tuple[float, Status]:
    """Certify a circle on a grid four times finer.

    Returns
    -------
    error : float
        Largest |E_j| of u on that grid.
    status : Status
        OK if Newton's method converges from u on that grid with h_j' > 0, and without needing more
        modes; NEARLY_RATIONAL or NOT_CERTIFIED otherwise.
    """
    fine = fourier.resample(u, settings.certificate_ratio * u.shape[-1])
    status, error = _newton(omega, kappa, fine, settings)
    return error, status if status in (Status.OK, Status.NEARLY_RATIONAL) else Status.NOT_CERTIFIED


def certify_by_step(
    omega: OmegaLike,
    kappa: FloatArray,
    u: FloatArray,
    settings: NewtonSettings = DEFAULT_NEWTON_SETTINGS,
) -> bool:
    """Take one Newton step from u, in place; return True if the result is accepted as a circle.

    max |E_j| must be below `max_residual` before the step, and must fall below `reduction` times
    its value, or below `rounding`; h_j' must be positive after the step. These limits were measured
    for hull functions of orbits that resolve the circle. Elsewhere a step may reduce max |E_j|
    although no circle exists.

    Parameters
    ----------
    omega, kappa
        As for `invariant_circle`.
    u : ndarray, shape (P, n)
        Deviations, which are overwritten.
    settings : NewtonSettings
        Criteria for the reduction.
    """
    constants = _constants(omega, *u.shape, settings.grid)
    before, _, slope, twist, _ = _chain_step(kappa, *constants, u, _workspace(*u.shape))
    if not (before < settings.max_residual and slope > 0 and twist > 0.5):
        return False
    after = np.abs(residual(omega, kappa, u)).max()
    is_reduced = after < max(settings.reduction * before, settings.rounding)
    return bool(is_reduced and fourier.derivative(u).min() > -1)


def newton_step(omega: OmegaLike, kappa: ArrayLike, u: ArrayLike) -> tuple[FloatArray, float]:
    """Take one Newton step in chain form.

    Parameters
    ----------
    omega, kappa
        As for `invariant_circle`.
    u : array_like, shape (P, n)
        Deviations; n is a power of 2, at least 16.

    Returns
    -------
    u : ndarray, shape (P, n)
        Deviations after the step.
    error : float
        max |E_j| before the step.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles import newton_step
    >>> u, first = newton_step("gamma", 0.3, np.zeros((1, 64)))
    >>> u, second = newton_step("gamma", 0.3, u)
    >>> second < first / 10
    True
    """
    kappa = forcing(kappa)
    u = _deviations(u, kappa.size).copy()
    constants = _constants(omega, *u.shape, fourier.DEFAULT_GRID_SETTINGS)
    error = _chain_step(kappa, *constants, u, _workspace(*u.shape))[0]
    return u, error


def residual(omega: OmegaLike, kappa: ArrayLike, u: ArrayLike) -> FloatArray:
    """Compute E_j on the grid of u, an array of shape (P, n); it vanishes on a circle.

    The parameters are those of `newton_step`.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles import residual
    >>> bool(abs(residual("gamma", 0.0, np.zeros((1, 64)))).max() < 1e-15)
    True
    """
    kappa, u = forcing(kappa), floats("u", u)
    n_sites, n = u.shape
    turn = fourier.turns(omega, n // 2 + 1)
    before, after = fourier.rotate(u[-1], turn.conj()), fourier.rotate(u[0], turn)
    return _residual(kappa, _angles(omega, n_sites), np.vstack([before, u, after]))


def graph(circle: InvariantCircle) -> tuple[FloatArray, FloatArray]:
    """Return x and y of the circle at the start of a period, at θ = i/n.

    Returns
    -------
    x, y : ndarrays, shape (n,)
        Coordinates in turns; x is not reduced mod 1.

    Examples
    --------
    >>> from nasm.circles import graph, invariant_circle
    >>> x, y = graph(invariant_circle("gamma", 0.0))
    >>> y[:2].round(6)
    array([0.618034, 0.618034])
    """
    n_sites, n = circle.u.shape
    before = fourier.rotate(circle.u[-1], fourier.turns(circle.omega, n // 2 + 1).conj())
    x = np.arange(n) / n + circle.u[0]
    return x, float(circle.omega) / n_sites + circle.u[0] - before


def _continue_from_rotation(omega, kappa, n_max, settings):
    at, step = 0.0, 1.0
    path = [(0.0, np.zeros((kappa.size, MIN_POINTS)))]
    while at < 1.0:
        target = min(at + step, 1.0)
        u, status = solve(omega, target * kappa, extrapolate(path, target), n_max, settings)
        if status is Status.OK:
            path.append((target, u))
            at = target
            step *= 2
        elif status in (Status.RATIONAL, Status.NEARLY_RATIONAL) or step < 1e-3:
            return u, status
        else:
            step /= 2
    return u, Status.OK


def extrapolate(path: Sequence[tuple[float, FloatArray]], target: float, n: int = 0) -> FloatArray:
    """Extrapolate deviations to the scale `target`, by Lagrange's formula.

    Parameters
    ----------
    path : sequence of (float, ndarray)
        Scales and deviations of at least one circle, each on a grid no smaller than the one before.
        The last three circles are used, which saves a Newton step near the breakup.
    target : float
        Scale of the result.
    n : int
        Minimum number of grid points of the result, which has at least as many as the last circle.

    Returns
    -------
    ndarray, shape (P, max(n, …))
        Deviations.
    """
    path = path[-3:]
    n = max(n, path[-1][1].shape[-1])
    total = np.zeros((path[-1][1].shape[0], n // 2 + 1), complex)
    weights = lagrange([scale for scale, _ in path], target)
    for weight, (_, u) in zip(weights, path, strict=True):
        modes = np.fft.rfft(u)
        modes *= weight * n / u.shape[-1]
        total[:, : modes.shape[-1]] += modes
    return np.fft.irfft(total, n)


def lagrange(nodes: Sequence[float], at: float) -> list[float]:
    """Return Lagrange's weights for interpolating values at distinct nodes to the point `at`."""
    return [prod((at - other) / (x - other) for other in nodes if other != x) for x in nodes]


def _deviations(u, n_sites):
    u = floats("deviations", u)
    if u.ndim != 2 or u.shape[0] != n_sites or u.shape[1] < 16 or u.shape[1] & (u.shape[1] - 1):
        raise ValueError(
            f"deviations of shape {u.shape}; they are P={n_sites} functions on a grid of n points, "
            "n a power of 2, at least 16, e.g. np.zeros((2, 64)) for the rotation"
        )
    if not np.isfinite(u).all():
        raise ValueError("deviations must be finite numbers")
    return u


def _angles(omega, n_sites):
    return float(as_rotation_number(omega)) * np.arange(n_sites) / n_sites


@lru_cache(maxsize=16)  # the arrays are as long as the grid
def _constants(omega, n_sites, n, grid_settings):
    turn, kept = fourier.turns(omega, n // 2 + 1), fourier.cut(omega, n, grid_settings)
    return _angles(omega, n_sites), turn, kept


_OUTCOMES = (Status.OK, Status.TOO_FEW_MODES, Status.NO_CIRCLE)


def _newton(omega, kappa, u, settings):
    """Iterate Newton's method on the grid of u, in place; return a Status and the initial error."""
    angles, turn, kept = _constants(omega, *u.shape, settings.grid)
    if np.abs(turn[1:kept] - 1).min() < settings.min_divisor:
        return Status.NEARLY_RATIONAL, np.nan
    limits = settings.max_steps, settings.max_update, settings.max_tail
    outcome, error = _iterate(kappa, angles, turn, kept, u, *limits)
    return _OUTCOMES[outcome], error


@kernel(error_model="numpy")
def _iterate(kappa, angles, turn, kept, u, max_steps, max_update, max_tail):
    """Take Newton steps until the outcome is clear; return its index and the initial error."""
    workspace = _workspace(*u.shape)
    first = last_error = last_change = 1.0
    for step in range(max_steps):
        error, change, slope, twist, tail = _chain_step(kappa, angles, turn, kept, u, workspace)
        first = error if step == 0 else first
        outcome = step_outcome(
            error, change, slope, twist, tail, last_error, last_change, max_update, max_tail
        )
        if outcome < 3:
            return outcome, first
        last_error, last_change = error, change
    return 2, first


@njit(nogil=True, error_model="numpy")
def step_outcome(error, change, slope, twist, tail, last_error, last_change, max_update, max_tail):
    """Classify a Newton step: 0 converged, 1 too few modes, 2 diverged, 3 continue.

    Convergence is quadratic, so the next update can be predicted and need not be computed.
    """
    diverged = not (error < 1 and slope > 0 and twist > 0.5 and change < 1)  # also if NaN
    if diverged or error > max(2 * last_error, 1e-9):
        return 2
    if tail > max_tail and change < 1e-3:
        return 1
    next_change = change * (change / last_change) ** 2
    return 0 if change < max_update or (change < 1e-6 and next_change < 1e-2 * max_update) else 3


@kernel
def _residual(kappa, angles, sites):
    """Return E_j, given u_{-1}, …, u_P in the rows of `sites`."""
    n = sites.shape[1]
    residuals = np.empty((kappa.size, n))
    for j in range(kappa.size):
        strength = kappa[j] / TWO_PI
        for i in range(n):
            kick = strength * sin2pi(i / n + angles[j] + sites[j + 1, i])
            residuals[j, i] = sites[j + 2, i] - 2 * sites[j + 1, i] + sites[j, i] - kick
    return residuals


@kernel(error_model="numpy")
def _workspace(n_sites, n):
    """Allocate arrays for `_chain_step`; above n = 4096 this takes as long as a step."""
    return (
        np.empty((n_sites, n // 2 + 1), np.complex128),
        np.zeros((2 * n_sites + 3, n // 2 + 1), np.complex128),
        np.empty((2 * n_sites + 3, n)),
        np.empty(n // 2 + 1, np.complex128),
    )


@kernel(error_model="numpy")
def _chain_step(kappa, angles, turn, kept, u, workspace):
    """Take one Newton step in place, as described in the docstring of this module.

    Returns max |E|, the largest update, min h', the twist, and the tail; all except the update
    refer to u before the step.
    """
    n_sites, n = u.shape
    own, modes, values, line = workspace
    tail = _sites(u, turn, kept, own, modes, values)
    x, slopes = values[: n_sites + 2], values[n_sites + 2 :]  # u_{-1}, …, u_P and h_0', …, h_P'
    flux, inverse, residual = np.empty((3, n_sites, n))
    total, w = np.zeros(n), np.empty(n)
    error, slope = 0.0, np.inf
    for j in range(n_sites):
        strength = kappa[j] / TWO_PI
        for i in range(n):
            kick = strength * sin2pi(i / n + angles[j] + x[j + 1, i])
            residual[j, i] = x[j + 2, i] - 2 * x[j + 1, i] + x[j, i] - kick
            total[i] -= slopes[j, i] * residual[j, i]
            flux[j, i] = total[i]
            u[j, i] = x[j + 1, i]
        for i in range(n):  # a separate loop, so that the one above is vectorized
            error = max(error, abs(residual[j, i]))
            slope = min(slope, slopes[j, i])
    _solve_cohomology(total, turn, kept, line, w)  # the flux into site 0
    sum_flux = sum_inverse = 0.0
    for j in range(n_sites):
        for i in range(n):
            inverse[j, i] = 1 / (slopes[j, i] * slopes[j + 1, i])
            flux[j, i] = (w[i] + flux[j, i]) * inverse[j, i]
            sum_flux += flux[j, i]
            sum_inverse += inverse[j, i]
    constant = -sum_flux / sum_inverse
    total[:] = 0.0
    for j in range(n_sites):
        for i in range(n):
            flux[j, i] += constant * inverse[j, i]  # now w_{j+1} - w_j
            total[i] += flux[j, i]
    _solve_cohomology(total, turn, kept, line, w)
    mean = change = 0.0
    for i in range(n):
        mean += slopes[0, i] * w[i] / n
    for i in range(n):
        w[i] -= mean
    for j in range(n_sites):
        for i in range(n):
            x[j, i] = slopes[j, i] * w[i]
            u[j, i] += x[j, i]
            w[i] += flux[j, i]
        for i in range(n):
            change = max(change, abs(x[j, i]))
    return error, change, slope, sum_inverse / n, tail


@njit(nogil=True, error_model="numpy")
def _sites(u, turn, kept, own, modes, values):
    """Fill `values` with u_{-1}, …, u_P and h_0', …, h_P', from the modes below `kept`.

    The mean ⟨u_0⟩ is set to 0.

    Return the fraction of the H³ norm in the last 15% of these modes.
    """
    n_sites, n = u.shape
    np.fft.rfft(u, out=own)
    mass = edge = 0.0
    own[0, 0] = 0.0
    for j in range(n_sites):
        for k in range(kept):
            a = own[j, k]
            modes[j + 1, k] = a
            modes[n_sites + 2 + j, k] = complex(-TWO_PI * k * a.imag, TWO_PI * k * a.real)
            part = (a.real**2 + a.imag**2) * float(k) ** 6
            mass += part
            if k >= 0.85 * kept:
                edge += part
    for k in range(kept):
        modes[0, k] = modes[n_sites, k] * turn[k].conjugate()
        modes[n_sites + 1, k] = modes[1, k] * turn[k]
        modes[2 * n_sites + 2, k] = modes[n_sites + 2, k] * turn[k]
    modes[n_sites + 2 :, 0] = n  # h' = 1 + u'
    np.fft.irfft(modes, n, out=values)
    return np.sqrt(edge / mass) if mass > 0 else 0.0


@njit(nogil=True, error_model="numpy")
def _solve_cohomology(f, turn, kept, modes, g):
    """Write the result of `fourier.solve_cohomology` to g."""
    np.fft.rfft(f, out=modes)
    modes[0] = 0.0
    for k in range(1, kept):
        modes[k] /= turn[k] - 1
    modes[kept:] = 0.0
    np.fft.irfft(modes, f.size, out=g)
