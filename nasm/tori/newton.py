"""Invariant tori of the rotating standard map, for an Ω that is irrational.

The forcing κ_n = κ̄ + Δκ cos 2πφ_n, φ_n = φ0 + nΩ, never repeats itself. What circles are for
periodic ones are tori here, two-dimensional graphs over (θ, φ):

    x_n = h(θ_n, φ_n) = θ_n + u(θ_n, φ_n),     θ_{n+1} = θ_n + ω,   φ_{n+1} = φ_n + Ω,
    E = u(θ + ω, φ + Ω) - 2u + u(θ - ω, φ - Ω) - (κ(φ)/2π) sin 2πh = 0.

The unknown is u on a grid of m × n points, an array of shape (m, n), φ first. It is unique up to
θ → θ + constant, which ⟨u⟩ = 0 fixes. A torus serves all phases φ0.

Newton's step is that of `nasm.circles` with one site, (θ, φ) in place of θ. Write the correction as
h_θ w, and f⁺ for f(θ + ω, φ + Ω); up to terms of the size of E²

    c (w⁺ - w) - [c (w⁺ - w)]⁻ = -h_θ E,     c = h_θ h_θ⁺.

That is solved twice in Fourier space by the divisors e^{2πi(k₁ω + k₂Ω)} - 1, in the modes of an
ellipse that takes 36% of each axis. A vector with a divisor below 10⁻⁶ among the modes in use is
refused as resonant. Near the rim of the ellipse resonant modes are left out, the more the nearer:
the modes that they drive are missing, and Newton's method would push them away. What they would be
counts as unresolved. The axes are refined apart.

With too few modes Newton's method converges on "tori" beyond the breakup. What is called a torus
here has therefore converged again, with h_θ > 0, on a grid twice as fine along both axes.

For the breakup of tori no renormalisation predicts exponents, and norms grow by leaps. More regular
is max (h⁻¹)' = 1/min h_θ; from it `critical_scale` takes the breakup, and fits the exponent.
"""

from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from math import inf, isfinite, log, nan

import numpy as np
from numba import njit

from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.roots import root
from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import count, floats, positive, real
from nasm.circles.newton import lagrange, step_outcome
from nasm.critical import CriticalScale, Result, Status
from nasm.maps import TWO_PI, direction, forcing
from nasm.numbers import RotationNumber

__all__ = ["InvariantTorus", "critical_scale", "graph", "invariant_torus", "residual"]

_METHOD = "continuation of tori"
FIRST = 64, 128  # points of the first grid, along φ and θ
N_LARGEST = 2**22

N_MAX = 2**20  # points of a grid, on the way to a breakup and of the torus that is certified

_KEPT = 0.36  # of the points of an axis: the half axis of the ellipse of modes
_INNER = 0.5  # up to here, in parts of the ellipse's equation, all modes are used,
_HOLE = 0.2  # and further out those with a divisor above this, times how far out, squared
_OUTER = 0.72  # from here on, modes are outer ones
_DIVISOR = 1e-6
_STEPS = 12  # of Newton's method
_HALVINGS = 12  # of a step, before Newton's failures are final
_REFUSALS = 3  # halvings, before too few modes are final
_MOST_TORI = 60  # on a ray: 10 to 25 are met
_WAYS = 2  # the error, in parts of the way from the last torus: 172 of 177 had enough of that
_PART = 0.35  # of the way to the breakup, as it is estimated: the next step


@dataclass(frozen=True, eq=False)
class InvariantTorus(Result):
    """A torus of rotation vector (omega, frequency), or what Newton's method was left with.

    omega, frequency : floats, turns of θ and φ per kick.
    mean, amplitude : floats, κ̄ and Δκ.
    u : ndarray (m, n), the deviations at φ = j/m and θ = i/n; see the module.
    error : largest |E| of u on a finer grid; NaN if u never converged.
    status : OK if certified; otherwise why not.
    """

    omega: float
    frequency: float
    mean: float
    amplitude: float
    u: np.ndarray = field(repr=False)
    error: float
    status: Status

    @property
    def certified(self):
        return self.status is Status.OK


def invariant_torus(omega, frequency, mean, amplitude, n_max=2**18):
    """The torus of rotation vector (omega, frequency) under κ(φ) = mean + amplitude·cos 2πφ.

    1. Newton's method, continued from κ = 0: steps double after a success and are halved after a
       failure.
    2. The grid doubles along the axis whose outer modes carry more than 0.3% of the second
       derivatives along that axis.
    3. The certificate: Newton's method converges again on a grid twice as fine along both axes,
       with h_θ > 0.

    omega, frequency : floats, turns of θ and φ per kick; or RotationNumbers.
    mean, amplitude : floats, κ̄ and Δκ.
    n_max : int, the most grid points m·n to use, 8192 to 2²²; the certificate uses 4 times as many.

    Returns InvariantTorus, with a status that says why if it is not certified. A torus that exists
    may be missed, by too few modes. A certified one exists to within floating point and 4 m·n
    points; resonances beyond those modes are not seen: for an Ω that is a fraction of large
    denominator the circles of all phases are certified.

    ValueError if an argument is not a finite number, or n_max is out of range.
    """
    vector, kappa = _vector(omega, frequency), forcing(_pair(mean, amplitude))
    n_max = count("n_max", n_max, FIRST[0] * FIRST[1], N_LARGEST)
    step, path, status = 1.0, [(0.0, np.zeros(FIRST))], Status.OK
    while path[-1][0] < 1.0 and status is Status.OK:
        at, u, status = _next_torus(vector, kappa, path, min(step, 1 - path[-1][0]), n_max)
        step = 2 * (at - path[-1][0])
        path.append((at, u))
    if status is not Status.OK:
        return InvariantTorus(*vector, *map(float, kappa), u, nan, status)
    error, status = certify(*vector, *kappa, u)
    return InvariantTorus(*vector, *map(float, kappa), u, error, status)


def critical_scale(omega, frequency, mean, amplitude, tol=1e-3):
    """The scale at which the torus breaks on the ray (κ̄, Δκ) = s·(mean, amplitude).

    1. Continue the torus from s = 0, each time a fixed part of the way to the breakup as it is then
       estimated: min h_θ falls like (s_c - s)^p, and three tori give s_c and p.
    2. Stop when `error` is below tol, or the modes are used up.
    3. Certify the last torus that can be, of ten.

    omega, frequency : floats, turns of θ and φ per kick; or RotationNumbers.
    mean, amplitude : floats, the direction (κ̄, Δκ), not both 0.
    tol : float, the error to aim at.

    Returns CriticalScale. lower : the scale of the certified torus, NaN without one. upper : NaN.
    error : twice the way from the last torus, or the change of the last estimate, if that is more:
    with p unknown no less is known. omega : None, a pair of numbers has no RotationNumber. Without
    an estimate value and error are NaN, and the status says why; lower is what was certified all
    the same.

    ValueError if the direction is zero or tiny, an argument is not finite or tol not positive.
    """
    vector, profile = _vector(omega, frequency), direction(_pair(mean, amplitude))
    tol = positive("tol", tol, "the error to aim at, e.g. tol=1e-3")
    path, value, error, status = _walk(vector, profile, tol)
    shown = (
        s for s, u in reversed(path[1:]) if certify(*vector, *(s * profile), u)[1] is Status.OK
    )
    lower = next(shown, nan)
    if not error < value:  # which would say nothing
        status = Status.NOT_CONVERGED if status is Status.OK else status
        return CriticalScale(nan, nan, lower, nan, None, status, _METHOD)
    return CriticalScale(value, error, lower, nan, None, Status.OK, _METHOD)


def settle(omega, frequency, mean, amplitude, u, n_max):
    """Newton's method from u, ndarray (m, n), on as fine a grid of at most n_max points as it asks.

    Returns u on the grid where it converged, and OK; or what was left, and the reason.
    """
    while True:
        u, outcome, _ = _newton(omega, frequency, mean, amplitude, u)
        m, n = u.shape
        if outcome not in _FINER or 2 * m * n > n_max:
            return u, _OUTCOMES[outcome]
        by_phi, by_theta = _FINER[outcome]
        u = resample(u, by_phi * m, by_theta * n)


def certify(omega, frequency, mean, amplitude, u):
    """Whether u is a torus also for the modes that it does not have.

    Returns the largest |E| of u on a grid twice as fine along both axes, and OK if Newton's method
    converges from it on that grid with h_θ > 0, without asking for more modes still.
    """
    m, n = u.shape
    _, outcome, error = _newton(omega, frequency, mean, amplitude, resample(u, 2 * m, 2 * n))
    status = _OUTCOMES[outcome]
    return error, status if status in (Status.OK, Status.NEARLY_RATIONAL) else Status.NOT_CERTIFIED


def residual(omega, frequency, mean, amplitude, u):
    """E on the grid of u, shape (m, n): zero on a torus."""
    (omega, frequency), (mean, amplitude) = _vector(omega, frequency), _pair(mean, amplitude)
    m, n = (u := floats("u", u)).shape
    kappa = mean + amplitude * cos2pi(np.arange(m) / m)[:, None]
    ahead, behind = shifted(u, omega, frequency), shifted(u, -omega, -frequency)
    return ahead - 2 * u + behind - kappa / TWO_PI * sin2pi(np.arange(n) / n + u)


def shifted(u, theta, phi):
    """u(θ + theta, φ + phi) on the grid of u."""
    m, n = u.shape
    turn = _turns(phi, _wave_numbers(m))[:, None] * _turns(theta, np.arange(n // 2 + 1))
    return np.fft.irfft2(np.fft.rfft2(u) * turn, u.shape)


def graph(torus):
    """x, y of the torus just before a kick of phase φ = j/m, at θ = i/n: two ndarrays (m, n), x on
    the lift."""
    behind = shifted(torus.u, -torus.omega, -torus.frequency)
    theta = np.arange(torus.u.shape[1]) / torus.u.shape[1]
    return theta + torus.u, torus.omega + torus.u - behind


def least_slope(u):
    """min h_θ on the grid: positive on a torus, 0 at its breakup."""
    modes = np.fft.rfft(u)
    return 1 + np.fft.irfft(modes * 2j * np.pi * np.arange(modes.shape[1]), u.shape[1]).min()


def resample(u, m, n):
    """The same function on a grid of m × n points."""
    modes, (old_m, old_n) = np.fft.rfft2(u), u.shape
    finer = np.zeros((m, n // 2 + 1), complex)
    rows, columns = min(m, old_m) // 2, min(n, old_n) // 2
    finer[:rows, :columns] = modes[:rows, :columns]
    finer[1 - rows :, :columns] = modes[1 - rows :, :columns]
    return np.fft.irfft2(finer * (m * n / u.size), (m, n))


def extrapolate(path, target):
    """Deviations at the scale `target`, through the last three of a path; see `circles.newton`."""
    scales, tori = zip(*path[-3:], strict=True)
    weights = lagrange(scales, target)
    shape = tori[-1].shape
    return sum(weight * resample(u, *shape) for weight, u in zip(weights, tori, strict=True))


def _next_torus(vector, profile, path, step, n_max):
    """Scale, deviations and Status of a torus `step` beyond the last of the path, or nearer.

    At every second failure the grid is doubled along one axis too: a resonance just beyond the
    modes of the last torus looks like the end.
    """
    for failures in range(_HALVINGS):
        target, doublings = path[-1][0] + step, failures // 2
        u = extrapolate(path, target)
        while u.size * 2**doublings > n_max and doublings > 0:
            doublings -= 1
        u = resample(u, u.shape[0] << doublings // 2, u.shape[1] << (doublings + 1) // 2)
        u, status = settle(*vector, *(target * profile), u, n_max)
        if status in (Status.OK, Status.NEARLY_RATIONAL):
            break
        if status is Status.TOO_FEW_MODES and failures >= _REFUSALS:
            break
        step /= 2
    return target, u, status


def _walk(vector, profile, tol):
    """The last tori on the way to the breakup, the estimate of it, its error, inf without one, and
    OK, or why there is no further torus."""
    path, slopes = [(0.0, np.zeros(FIRST))], [(0.0, 1.0)]
    value, error, step, status = nan, inf, 0.1 / np.abs(profile).max(), Status.OK
    while error > tol and len(slopes) < _MOST_TORI and step > 1e-6 * path[-1][0]:
        at, u, status = _next_torus(vector, profile, path, step, N_MAX)
        if status is not Status.OK:
            break
        step = 2 * (at - path[-1][0])
        path = [*path[-9:], (at, u)]
        slopes.append((at, least_slope(u)))
        last, value = value, _breakup(*zip(*slopes[-3:], strict=True)) if len(slopes) > 3 else nan
        error = max(_WAYS * (value - at), abs(value - last)) if isfinite(value - last) else inf
        step = min(step, _PART * (value - at)) if isfinite(value) else step
    return path, value, error, status


def _breakup(scales, slopes):
    """Fit min h_θ = a·(s_c - s)^p through three tori; return s_c, NaN if there is no such fit."""
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


def _vector(omega, frequency):
    """Both as floats; ValueError if one is not a finite number."""
    numbers = []
    for name, value in (("omega", omega), ("frequency", frequency)):
        number = float(value) if isinstance(value, RotationNumber) else real(name, value)
        if not isfinite(number):
            raise ValueError(f"{name}={value!r} must be finite; it counts turns per kick")
        numbers.append(number)
    return tuple(numbers)


def _pair(mean, amplitude):
    return real("mean", mean), real("amplitude", amplitude)


def _wave_numbers(m):
    k = np.arange(m)
    return np.where(2 * k < m, k, k - m)


def _turns(number, k):
    """e^{2πik·number} for whole numbers k; the phases are exact, as integers modulo 2⁶⁴."""
    unit = np.uint64(int(Fraction(number) % 1 * 2**64))
    return np.exp(1j * TWO_PI * ((k.astype(np.uint64) * unit).astype(np.int64) / 2.0**64))


@lru_cache(maxsize=8)  # of arrays as large as the grid
def _constants(omega, frequency, m, n):
    """e^{2πi(k₂Ω + k₁ω)} of all modes; what becomes of each, 0 if it is not in use, 1 if it is, 2
    and 3 if it is an outer one, on the side of θ or φ, and 4 and 5 if it is a hole there; and the
    smallest divisor in use. A hole is a resonant mode near the rim.
    """
    k2, k1 = _wave_numbers(m)[:, None], np.arange(n // 2 + 1)
    turn = _turns(frequency, k2) * _turns(omega, k1)
    across, along = (k2 / (_KEPT * m)) ** 2, (k1 / (_KEPT * n)) ** 2
    place, divisor = across + along, np.abs(turn - 1)
    hole = (place > _INNER) & (divisor < _HOLE * ((place - _INNER) / (1 - _INNER)) ** 2)
    kind = np.where(hole, 4, np.where(place > _OUTER, 2, 1)).astype(np.int8)
    kind += (kind > 1) & (along <= across)
    kind[k1 >= np.floor(_KEPT * n * np.sqrt(np.maximum(1 - across, 0)))] = 0
    kind[0, 0] = 0
    return turn, kind, divisor[(kind > 0) & (kind < 4)].min()


_OUTCOMES = (
    Status.OK,
    Status.TOO_FEW_MODES,
    Status.TOO_FEW_MODES,
    Status.NO_CIRCLE,
    Status.NEARLY_RATIONAL,
)
_FINER = {1: (1, 2), 2: (2, 1)}  # more modes along θ, or along φ


def _newton(omega, frequency, mean, amplitude, u, steps=_STEPS):
    """Newton's method on the grid of u: the new u, an index into _OUTCOMES, and the error before
    the first step."""
    turn, kind, divisor = _constants(omega, frequency, *u.shape)
    if divisor < _DIVISOR:
        return u, 4, nan
    modes = np.fft.rfft2(u)
    outcome, error = _iterate(float(mean), float(amplitude), turn, kind, modes, steps)
    return np.fft.irfft2(modes, u.shape), outcome, error


@kernel(error_model="numpy")
def _iterate(mean, amplitude, turn, kind, modes, steps):
    """Newton steps until they tell: an index into _OUTCOMES, and the error before the first step.

    As in `circles`, save that there are two axes along which modes may be missing.
    """
    first = last_error = last = 1.0
    for step in range(steps):
        error, change, slope, twist, tails = _step(mean, amplitude, turn, kind, modes)
        first = error if step == 0 else first
        outcome = step_outcome(error, change, slope, twist, tails.max(), last_error, last)
        if outcome == 0 or (outcome == 1 and tails[0] > tails[1]):
            return outcome, first
        if outcome == 1:
            return 2, first
        # By rounding, or pushed away by modes that lack.
        if outcome == 2 or (step > 3 and change > 0.5 * last):
            return 3, first
        last_error, last = error, change
    return 3, first


@njit(nogil=True, error_model="numpy")
def _step(mean, amplitude, turn, kind, modes):
    """One Newton step for the modes of u, in place: see the module.

    Returns max |E|, the largest update, min h_θ, the twist, and the tails along θ and φ: all but
    the update of u as it was before the step.
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
        for i in range(n):  # apart from the loop above, which is then one of vectors
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
    least = max(1e-16 * mass.max(), 1e-300)  # a tail of rounding does not count
    return error, change, slope, sum_inverse / (m * n), np.sqrt(edge / np.maximum(mass, least))


@njit(nogil=True, error_model="numpy")
def _fields(turn, kind, modes, mass, edge):
    """The modes of u, u⁺ - 2u + u⁻, h_θ and h_θ⁺, of those in use.

    Adds the squared second derivatives along θ and φ to mass, and those of the outer modes on the
    side of that axis to edge.
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
    """g with g - g⁻ = f if `behind`, else g⁺ - g = f; of the modes in use, and ⟨g⟩ = 0.

    The first of the two adds to edge what the modes left out would be, f̂/d²: they are not in u.
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
