"""Invariant circles in chain form, by Newton's method, and what certifies one.

The sites of a circle's orbits are x_j = h_j(θ), j = 0, …, P - 1 within a period, and a period takes
θ to θ + ω:

    h_j(θ) = θ + jω/P + u_j(θ),     h_P(θ) = h_0(θ + ω),     h_{-1}(θ) = h_{P-1}(θ - ω),
    E_j = h_{j+1} - 2h_j + h_{j-1} - (κ_j/2π) sin 2πh_j = 0.

The unknowns are the deviations u_j on a grid of n points, an array of shape (P, n). They are unique
up to θ → θ + constant, which ⟨u_0⟩ = 0 fixes.

Newton's step is Levi and Moser's (Proc. Sympos. Pure Math. 69 (2001) 733). Write the correction of
u_j as h_j' w_j. The linearised equations times h_j' telescope, up to terms of the size of E²:

    c_j (w_{j+1} - w_j) - c_{j-1} (w_j - w_{j-1}) = -h_j' E_j,        c_j = h_j' h_{j+1}'.

Summed over a period this is an equation g(θ + ω) - g(θ) = f(θ) for the flux c_j (w_{j+1} - w_j).
Its free constant is fixed by ⟨Σ_j (w_{j+1} - w_j)⟩ = 0, where the twist ⟨Σ_j 1/c_j⟩ is not 0, and
a second such equation gives w_0. Everything is diagonal in θ or in Fourier space: O(n log n).

With too few modes Newton's method converges on "circles" far beyond the breakup. What is called a
circle here has therefore converged again, with h' > 0, on a grid four times finer.

Numba loads rocket-fft for np.fft inside kernels. Grids have up to 10⁶ points; see
`nasm.arithmetic.memory` for programs that compute many circles.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from math import prod

import numpy as np
from numba import njit

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import sin2pi
from nasm.checks import count, floats
from nasm.circles import fourier
from nasm.critical import Result, Status
from nasm.maps import TWO_PI, forcing
from nasm.numbers import RotationNumber, as_rotation_number

__all__ = ["InvariantCircle", "graph", "invariant_circle", "newton_step", "residual"]

N_FIRST = 64  # points of the first grid
N_LARGEST = 2**16

_FINER = 4  # the certificate's grid
_STEPS = 12  # of Newton's method, which needs 3 to 8 where there is a circle
UPDATE = 1e-9  # converged: the last update of u was smaller
TAIL = 3e-3  # resolved: the last 15% of the modes hold less than this part of the H³ norm
_POLISHED = 1e-9  # of max |E_j| before a step, which leaves a tenth of it or less
_ROUNDED = 1e-13  # of max |E_j|: less is rounding, and no step makes less of it
_DIVISOR = 1e-5  # with smaller divisors, rounding errors of 1e-17 are larger than UPDATE in u


@dataclass(frozen=True, eq=False)
class InvariantCircle(Result):
    """A circle of rotation number omega, or what Newton's method was left with.

    omega : RotationNumber per period.
    kappa : ndarray (P,), the forcing.
    u : ndarray (P, n), the deviations u_j at θ = i/n; see the module.
    error : largest |E_j| of u on its grid or a finer one; NaN if u never converged.
    status : OK if certified; otherwise why not.
    """

    omega: RotationNumber
    kappa: np.ndarray
    u: np.ndarray = field(repr=False)
    error: float
    status: Status

    @property
    def certified(self):
        return self.status is Status.OK


def invariant_circle(omega, kappa, n_max=4096, start=None):
    """The circle of rotation number omega under the forcing kappa.

    1. Newton's method from `start`, or continued from κ = 0 along s·kappa: steps in s double after
       a success and are halved after a failure.
    2. The number of modes doubles while the last of them carry more than 0.3% of the H³ norm.
    3. The certificate: Newton's method converges again on a grid four times finer, with h' > 0.

    omega : RotationNumber or its text, irrational; e.g. "gamma".
    kappa : sequence of P floats, first kick first.
    n_max : int, the most grid points to use, 64 to 65536; the certificate uses 4 times as many.
    start : ndarray (P, n), deviations near the circle, n a power of 2 from 16; default as above.

    Returns InvariantCircle, with a status that says why if it is not certified. A circle that
    exists may be missed (too few modes, an unlucky start); `barriers.last_circle` finds the one
    next to a known breakup, with 10⁵ modes and more. A certified circle exists to within
    floating-point arithmetic and 4n points; this is not a proof, and resonances of ω beyond those
    modes, as of a rational ω of large denominator, are not seen.
    """
    omega, kappa = as_rotation_number(omega), forcing(kappa)
    n_max = count("n_max", n_max, N_FIRST, N_LARGEST)
    if start is not None:
        u, status = settle(omega, kappa, _deviations(start, kappa.size).copy(), n_max)
    else:
        u, status = _continue_from_rotation(omega, kappa, n_max)
    if status is not Status.OK:
        return InvariantCircle(omega, kappa, u, np.nan, status)
    return certified(omega, kappa, u)


def settle(omega, kappa, u, n_max):
    """Newton's method from u (overwritten), with as many modes as it asks for.

    Returns u on the grid where it converged, and OK; or what was left, and the reason.
    """
    if as_rotation_number(omega).is_rational:
        return u, Status.RATIONAL
    while True:
        status = _newton(omega, kappa, u)[0]
        n = u.shape[-1]
        if status is not Status.TOO_FEW_MODES or 2 * n > n_max:
            return u, status
        u = fourier.resample(u, 2 * n)


def certified(omega, kappa, u):
    """The InvariantCircle of deviations, with what `certify` says of them."""
    return InvariantCircle(omega, kappa, u, *certify(omega, kappa, u))


def certify(omega, kappa, u):
    """Whether u is a circle also for the modes that it does not have.

    Returns the largest |E_j| of u on a grid four times finer, and OK if Newton's method converges
    from it on that grid with h_j' > 0, without asking for more modes still.
    """
    fine = fourier.resample(u, _FINER * u.shape[-1])
    status, error = _newton(omega, kappa, fine)
    return error, status if status in (Status.OK, Status.NEARLY_RATIONAL) else Status.NOT_CERTIFIED


def polish(omega, kappa, u):
    """Newton's method from u (overwritten) until max |E_j| < 10⁻⁹ before a step, or below 10⁻⁸ it
    shrinks no more; whether it got there, with h' > 0.

    For 10⁵ modes and more, whose small divisors let rounding into the updates of u.
    """
    constants, workspace = _constants(omega, *u.shape), _workspace(*u.shape)
    best, least = u.copy(), np.inf
    for _ in range(_STEPS):
        before = u.copy()
        error, change, slope, twist, _ = _chain_step(kappa, *constants, u, workspace)
        if not (error < 1 and slope > 0 and twist > 0.5 and change < 1):
            break
        if error < _POLISHED:
            return True
        if least < 1e-8 and error > 0.5 * least:
            break
        if error < least:
            best, least = before, error
    u[:] = best
    return least < 1e-8


def polished_is_circle(omega, kappa, u):
    """`certify` for what `polish` has made, on a grid with the modes up to the next resonance.

    There max |E_j| is below 10⁻⁸ still, and the first Newton step or the second brings it to a
    tenth or less, and below 10⁻¹⁰, or it is rounding. Beyond the breakup it does not shrink.
    """
    fine = fourier.resample(u, fourier.grid(omega, 1.5 * fourier.cut(omega, u.shape[-1])))
    constants, workspace = _constants(omega, *fine.shape), _workspace(*fine.shape)
    for _ in range(2):
        before, change, slope, twist, _ = _chain_step(kappa, *constants, fine, workspace)
        if not (before < 1e-8 and slope > 0 and twist > 0.5 and change < 1e-3):
            return False
        after = np.abs(residual(omega, kappa, fine)).max()
        if after < max(min(0.1 * before, 1e-10), _ROUNDED):
            return True
    return False


def newton_step(omega, kappa, u):
    """One step of the chain form. Returns the new u, ndarray (P, n), and max |E_j| before it."""
    kappa = forcing(kappa)
    u = _deviations(u, kappa.size).copy()
    error = _chain_step(kappa, *_constants(omega, *u.shape), u, _workspace(*u.shape))[0]
    return u, error


def residual(omega, kappa, u):
    """E_j on the grid of u, shape (P, n): zero on a circle."""
    kappa, u = forcing(kappa), floats("u", u)
    n_sites, n = u.shape
    turn = fourier.turns(omega, n // 2 + 1)
    before, after = fourier.rotate(u[-1], turn.conj()), fourier.rotate(u[0], turn)
    sites = np.vstack([before, u, after])
    h = np.arange(n) / n + _angles(omega, n_sites)[:, None] + u
    return sites[2:] - 2 * u + sites[:-2] - kappa[:, None] / TWO_PI * sin2pi(h)


def graph(circle):
    """x, y of the circle at the start of a period, at θ = i/n: two ndarrays (n,), x on the lift."""
    n_sites, n = circle.u.shape
    before = fourier.rotate(circle.u[-1], fourier.turns(circle.omega, n // 2 + 1).conj())
    x = np.arange(n) / n + circle.u[0]
    return x, float(circle.omega) / n_sites + circle.u[0] - before


def _continue_from_rotation(omega, kappa, n_max):
    at, step = 0.0, 1.0
    path = [(0.0, np.zeros((kappa.size, N_FIRST)))]
    while at < 1.0:
        target = min(at + step, 1.0)
        u, status = settle(omega, target * kappa, extrapolate(path, target), n_max)
        if status is Status.OK:
            path.append((target, u))
            at = target
            step *= 2
        elif status in (Status.RATIONAL, Status.NEARLY_RATIONAL) or step < 1e-3:
            return u, status
        else:
            step /= 2
    return u, Status.OK


def extrapolate(path, target, n=0):
    """Deviations at the scale `target`, by Lagrange's formula through the last circles of a path.

    path : list of at least one (scale, u), with grids that do not shrink. At most three are used;
    three give a Newton step less than two near the breakup.
    n : points of the result's grid, if they are more than those of the last circle.
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


def lagrange(nodes, at):
    """The weights of values at the nodes, all different, in Lagrange's formula for that at `at`."""
    return [prod((at - other) / (x - other) for other in nodes if other != x) for x in nodes]


def _deviations(u, n_sites):
    u = floats("deviations", u)
    if u.ndim != 2 or u.shape[0] != n_sites or u.shape[1] < 16 or u.shape[1] & (u.shape[1] - 1):
        raise ValueError(
            f"deviations of shape {u.shape}; they are P={n_sites} functions on a grid of n points, "
            "n a power of 2 from 16, e.g. np.zeros((2, 64)) for the rotation"
        )
    if not np.isfinite(u).all():
        raise ValueError("deviations must be finite numbers")
    return u


def _angles(omega, n_sites):
    return float(as_rotation_number(omega)) * np.arange(n_sites) / n_sites


@lru_cache(maxsize=16)  # of arrays as long as the grid
def _constants(omega, n_sites, n):
    return _angles(omega, n_sites), fourier.turns(omega, n // 2 + 1), fourier.cut(omega, n)


_OUTCOMES = (Status.OK, Status.TOO_FEW_MODES, Status.NO_CIRCLE)


def _newton(omega, kappa, u):
    """Newton's method on the grid of u, in place: a Status, and the error before the first step."""
    angles, turn, kept = _constants(omega, *u.shape)
    if np.abs(turn[1:kept] - 1).min() < _DIVISOR:
        return Status.NEARLY_RATIONAL, np.nan
    outcome, error = _iterate(kappa, angles, turn, kept, u)
    return _OUTCOMES[outcome], error


@kernel(error_model="numpy")
def _iterate(kappa, angles, turn, kept, u):
    """Newton steps until they tell: an index into _OUTCOMES, and the error before the first."""
    workspace = _workspace(*u.shape)
    first = last_error = last = 1.0
    for step in range(_STEPS):
        error, change, slope, twist, tail = _chain_step(kappa, angles, turn, kept, u, workspace)
        first = error if step == 0 else first
        outcome = step_outcome(error, change, slope, twist, tail, last_error, last)
        if outcome < 3:
            return outcome, first
        last_error, last = error, change
    return 2, first


@njit(nogil=True, error_model="numpy")
def step_outcome(error, change, slope, twist, tail, last_error, last):
    """What a Newton step tells: 0, converged, 1, too few modes, 2, lost, or 3, go on.

    The update squares each time, so the last one need not be made.
    """
    lost = not (error < 1 and slope > 0 and twist > 0.5 and change < 1)  # NaN ends it too
    if lost or error > max(2 * last_error, 1e-9):
        return 2
    if tail > TAIL and change < 1e-3:
        return 1
    next_change = change * (change / last) ** 2
    return 0 if change < UPDATE or (change < 1e-6 and next_change < 1e-2 * UPDATE) else 3


@kernel(error_model="numpy")
def _workspace(n_sites, n):
    """Arrays for `_chain_step`. Above n = 4096 to allocate them anew takes as long as the step."""
    return (
        np.empty((n_sites, n // 2 + 1), np.complex128),
        np.zeros((2 * n_sites + 3, n // 2 + 1), np.complex128),
        np.empty((2 * n_sites + 3, n)),
        np.empty(n // 2 + 1, np.complex128),
    )


@kernel(error_model="numpy")
def _chain_step(kappa, angles, turn, kept, u, workspace):
    """One Newton step, in place: see the module.

    Returns max |E|, the largest update, min h', the twist, and the tail: all but the update of u as
    it was before the step.
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
        for i in range(n):  # apart from the loop above, which is then one of vectors
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
    """Fill values with u_{-1}, …, u_P and h_0', …, h_P', of the modes below `kept`, with ⟨u_0⟩ = 0.

    Returns the part of the H³ norm in the last 15% of these modes.
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
    """`fourier.solve_cohomology` into g."""
    np.fft.rfft(f, out=modes)
    modes[0] = 0.0
    for k in range(1, kept):
        modes[k] /= turn[k] - 1
    modes[kept:] = 0.0
    np.fft.irfft(modes, f.size, out=g)
