"""The breakup of a circle, from the blow-up of its norms along the ray κ = s·profile.

The length of a circle's finest structure is 1/M,

    M = ‖u‖_{H³} / ‖u‖_{H²}  →  ∞     as  s → s_c.

Near the breakup the circle is self-similar. For ω with the tail (b_1, …, b_m) there are constants
Λ and δ such that, at a distance d from the breakup,

    M(s_c - d/δ) = Λ M(s_c - d)

up to terms that vanish as d → 0. Λ is the factor by which the denominators of the convergents grow
over m partial quotients, and δ is the unstable eigenvalue of renormalisation; both are the same for
all circles with that tail. So M blows up like d^(-ν), ν = log Λ / log δ, times a function that is
periodic in log M. This function is constant for golden tails, and varies by ±10% for tails of
fours. Three scales at which M differs by factors of Λ and Λ² are in phase, and yield s_c by
Richardson extrapolation with the ratios δ and δ².

Calleja & de la Llave (Nonlinearity 23 (2010) 2029) introduced this blow-up as a criterion for the
breakup; the paper uses their criterion (arXiv:1606.04824, Sec. VI).
"""

import sys
from dataclasses import dataclass
from itertools import islice, pairwise
from math import exp, inf, log, nan, sqrt

import numpy as np
from numpy.typing import ArrayLike

from nasm.arithmetic.reproducible import powers
from nasm.checks import positive
from nasm.circles import fourier, newton
from nasm.circles.newton import DEFAULT_NEWTON_SETTINGS, NewtonSettings
from nasm.farey import circle_exists
from nasm.maps import TWO_PI, direction
from nasm.numbers import as_rotation_number, convergents
from nasm.results import CriticalScale, Status, no_answer
from nasm.symmetries import CUSP_EXPONENT, distances_to_shorter, shorten
from nasm.types import FloatArray, OmegaLike

__all__ = ["ContinuationSettings", "critical_scale", "fineness"]

METHOD = "continuation of circles"
UNSTABLE_EIGENVALUES = {(1,): 1.6279500, (2,): 2.4416, (3,): 3.344, (4,): 4.265}
"""δ for each tail of ω. Golden: MacKay, Physica D 7 (1983) 283. Twos, threes and fours: measured
with `nasm.periodic`, as the growth of dR/ds at s_c from one convergent to the next."""


@dataclass(frozen=True)
class ContinuationSettings:
    """Limits on the continuation of circles, and lower bounds on the errors of its estimates.

    Attributes
    ----------
    max_points : int
        Number of points of the finest grid. The smallest distance from the breakup that can be
        reached is inversely proportional to it, and so is the smallest step.
    two_scale_error : float
        Error assigned to s_c if it is extrapolated from two scales, divided by the distance from
        s_c to the last circle; the largest ratio observed was 2.3.
    error_without_delta : float
        Minimum error of s_c if δ is unknown, divided by the distance from s_c to the last circle.
    max_depth_ratio : float
        Depth below which circles do not resolve a cusp, divided by the distance from the breakup to
        the second of the three scales.
    newton : NewtonSettings
        Criteria for the convergence of Newton's method.

    Examples
    --------
    >>> from nasm.circles.continuation import ContinuationSettings, critical_scale
    >>> coarse = critical_scale("gamma", 1.0, settings=ContinuationSettings(max_points=512))
    >>> coarse.error > critical_scale("gamma", 1.0).error
    True
    """

    max_points: int = 16384
    two_scale_error: float = 3
    error_without_delta: float = 0.2
    max_depth_ratio: float = 4
    newton: NewtonSettings = DEFAULT_NEWTON_SETTINGS


DEFAULT_SETTINGS = ContinuationSettings()


def critical_scale(
    omega: OmegaLike,
    profile: ArrayLike,
    tol: float = 1e-6,
    settings: ContinuationSettings = DEFAULT_SETTINGS,
) -> CriticalScale:
    """Compute the scale at which the circle of ω breaks on κ = s·profile, from the blow-up of M.

    1. If the forcing repeats itself within its period, use the map of the shorter period, as
       `periodic.critical_scale` does.
    2. Continue the circle from s = 0, each time by a fixed fraction of the estimated distance to
       the breakup, with as many modes as each circle needs.
    3. Stop when `error` is below tol, or no more modes are available.
    4. Certify the last circle whose certification needs no finer grid than the path.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period, irrational, e.g. "gamma".
    profile : array_like, shape (P,)
        Direction of the ray, not zero; no symmetry is needed.
    tol : float
        Target for the absolute error; the error of the result may exceed it.
    settings : ContinuationSettings
        Limits on the continuation, and lower bounds on the errors of the estimates.

    Returns
    -------
    CriticalScale
        lower is the scale of the certified circle; upper is NaN. If there is no estimate, or its
        error is as large as the value, value and error are NaN, but lower is still returned. This
        happens, for example, if a large partial quotient precedes the tail of ω, so that too few
        modes are available to resolve the tail. The status is UNDECIDED if residues show that the
        circle exists beyond the estimate.

    Raises
    ------
    ValueError
        If profile is zero or tiny, or tol is not positive and finite.

    Notes
    -----
    The error is the spread of the last estimates plus their last change, or the change due to the
    third scale, whichever is larger. Near a forcing of shorter period the error includes the depth
    of the boundary's cusp there, until the circles resolve the cusp. The error is three times the
    distance from the last circle to the value if M has not yet grown by a factor of Λ², and at
    least a fifth of that distance if δ is unknown for the tail of ω.

    Examples
    --------
    >>> from nasm.circles.continuation import critical_scale
    >>> scale = critical_scale("gamma", 1.0, tol=1e-3)
    >>> abs(scale.value - 0.971635) < scale.error < 1e-3
    True
    """
    profile = direction(profile)
    tol = positive("tol", tol, "the error to aim at, e.g. tol=1e-6")
    omega = as_rotation_number(omega)
    if omega.is_rational:
        return no_answer(omega, Status.RATIONAL, METHOD)
    (short,), short_omega = shorten([profile], omega)
    path, value, error, status = _continue(short_omega, short, tol, settings)
    max_size = settings.max_points // settings.newton.certificate_ratio
    certified_scales = (
        scale
        for scale, u in reversed(path)
        if u.shape[-1] <= max_size
        and newton.certify(short_omega, scale * short, u, settings.newton)[1] is Status.OK
    )
    lower = next(certified_scales, nan)
    if not error < value:
        status = Status.NOT_CONVERGED if status is Status.OK else status
        return CriticalScale(nan, nan, lower, nan, omega, status, METHOD)
    # If the ray passes close to another sheet of the boundary, or the circle close to a resonance,
    # norms grow as if the circle broke there. Test as far beyond the breakup as the last circle is
    # before it. Golden circles under one or two kicks need no test: there is only one sheet.
    beyond = value + max(2 * error, value - path[-1][0])
    is_safe = short.size <= 2 and omega.tail == (1,)
    if not is_safe and circle_exists(short_omega, beyond * short):
        return CriticalScale(nan, nan, lower, nan, omega, Status.UNDECIDED, METHOD)
    return CriticalScale(value, error, lower, nan, omega, Status.OK, METHOD)


def fineness(u: FloatArray, n_modes: int | None = None) -> float:
    """Compute M = ‖u‖_{H³}/‖u‖_{H²}, the wave number of the finest structure.

    Parameters
    ----------
    u : ndarray, shape (P, n)
        Deviations.
    n_modes : int, optional
        Number of modes included; by default all.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.circles.continuation import fineness
    >>> u = np.sin(2 * np.pi * 3 * np.arange(32) / 32)[None]
    >>> round(fineness(u) / (2 * np.pi), 6)
    3.0
    """
    power = np.sum(np.abs(np.fft.rfft(u)[:, :n_modes]) ** 2, axis=0)
    squares = np.arange(power.size, dtype=float) ** 2
    second = power * squares**2
    return float(TWO_PI * np.sqrt(np.sum(second * squares) / np.sum(second)))


def _continue(omega, profile, tol, settings):
    """Continue the circle towards its breakup.

    Returns the path; the last estimate of the breakup; its error, or inf if there is no estimate;
    and OK, or the Status that ended the path.
    """
    growth, delta = _scaling(omega.tail)
    step_ratio = 1 - 1 / delta if growth < 2 else 0.25
    # Number of circles over which s_c - s shrinks by a factor of δ, and M passes through one
    # oscillation.
    window = max(3, 1 + round(log(delta) / -log(1 - step_ratio)))
    cusps = powers(distances_to_shorter(profile), CUSP_EXPONENT)
    path, logarithms, estimates = [(0.0, np.zeros((profile.size, newton.MIN_POINTS)))], [], []
    last_scale, first_step = 0.0, 0.1 / np.abs(profile).max()
    value, error, step, status = nan, inf, first_step, Status.OK
    while error > tol and step * settings.max_points > max(last_scale, first_step):
        target = last_scale + step
        u = newton.extrapolate(path, target)
        u, status = newton.solve(omega, target * profile, u, settings.max_points, settings.newton)
        if status is Status.NO_CIRCLE:
            step /= 2
            continue
        if status is not Status.OK:
            break
        path.append((target, u))
        # The mode after the last one kept is often resonant: if it is large, M jumps, which shows
        # that the circle is not resolved.
        n_modes = fourier.cut(omega, u.shape[-1], settings.newton.grid) + 1
        logarithms.append(log(fineness(u, n_modes)))
        before, last_scale = last_scale, target
        scales, log_m = np.array([scale for scale, _ in path[1:]]), np.array(logarithms)
        estimate, own_error = _estimate(omega, scales, log_m, growth, delta, settings)
        if own_error == inf and value > last_scale:  # keep the previous estimate
            error, estimates = max(error, settings.two_scale_error * (value - last_scale)), []
        else:
            value, error = estimate, own_error
        distance = (
            value - last_scale if error < inf else _linear_distance(scales, log_m, growth, delta)
        )
        step = min(2 * (last_scale - before), step_ratio * distance)
        if own_error < inf:
            estimates = [*estimates, value][-window:] if error < distance else []
            is_spread = len(estimates) == window
            error = max(
                error,
                np.ptp(estimates) + abs(estimates[-1] - estimates[-2]) if is_spread else distance,
            )
            # Add the depth of any cusp that these circles do not resolve; the depths found from
            # residues were 0.8 to 1.1 times those estimated here.
            depths = value * cusps
            unresolved = depths < settings.max_depth_ratio * delta * distance
            error += depths.max(where=unresolved, initial=0.0)
    return path, value, error, status


def _estimate(omega, scales, log_m, growth, delta, settings):
    """Estimate s_c and its error from three scales, at M, M/Λ and M/Λ², or from the first two.

    The growth of M is measured from the wave number at which the tail of ω begins: the denominator
    of the last convergent of its prefix. Returns NaN and inf if M has not yet grown by
    a factor of Λ.
    """
    decreases = np.flatnonzero(np.diff(log_m) <= 0)  # far from the breakup M may decrease
    start = decreases[-1] + 1 if decreases.size else 0
    scales, log_m = scales[start:], log_m[start:]
    *_, fraction = islice(convergents(omega), len(omega.prefix))
    first = max(log_m[0], log(TWO_PI * fraction.denominator))
    order = min(int((log_m[-1] - first) / log(growth)), 2)
    if scales.size < 4 or order < 1:
        return nan, inf
    value, lower_order = _extrapolate(scales, log_m, growth, delta, order, settings)
    if not value > scales[-1]:
        return nan, inf
    distance = value - scales[-1]
    if order == 1:
        return value, settings.two_scale_error * distance
    error = abs(value - lower_order)
    if omega.tail not in UNSTABLE_EIGENVALUES:
        error = max(error, settings.error_without_delta * distance)
    return value, error if error < distance else distance


def _extrapolate(scales, log_m, growth, delta, order, settings):
    """Return s_c by Richardson extrapolation, and the result of one order lower; NaN if it fails.

    The extrapolation needs the scales at M, M/Λ, …; they are found by interpolating log(s_c - s).
    It is therefore repeated with the resulting s_c, usually 5 to 20 times. It has diverged if s_c
    exceeds twice the last scale, or changes no less than in the repetition before.
    """
    levels = [log_m[-1] - k * log(growth) for k in range(1, order + 1)]
    nodes = [_interpolate(scales, log_m, level) for level in levels]
    value = scales[-1] + _linear_distance(scales, log_m, growth, delta)
    change = inf
    while scales[-1] < value < 2 * scales[-1]:
        guess, last_change = value, change
        column = [scales[-1], *(guess - _distance(node, guess) for node in nodes)]
        for power in range(1, order + 1):
            lower_order = column[0]
            column = [a + (a - b) / (delta**power - 1) for a, b in pairwise(column)]
        value = column[0]
        change = abs(value - guess)
        if change < settings.newton.max_update * value:
            return value, lower_order
        if change >= last_change:
            break
    return nan, nan


def _linear_distance(scales, log_m, growth, delta):
    """Return s_c - s at the last circle, from a line through the last two values of M^(-1/ν)."""
    if len(scales) < 2 or not log_m[-1] > log_m[-2]:
        return inf
    shrink = exp((log_m[-2] - log_m[-1]) * log(delta) / log(growth))
    return (scales[-1] - scales[-2]) * shrink / (1 - shrink) if shrink < 1 else inf


def _interpolate(scales, log_m, level):
    """Return (weight, scale) of four circles, for cubic interpolation to log M = level."""
    start = min(max(int(np.searchsorted(log_m, level)) - 2, 0), log_m.size - 4)
    weights = newton.lagrange(log_m[start : start + 4].tolist(), level)
    return list(zip(weights, scales[start : start + 4].tolist(), strict=True))


def _distance(nodes, value):
    """Return s_c - s for s_c = `value`, by interpolating its logarithm between the nodes."""
    logarithm = 0.0
    for weight, scale in nodes:  # same order on every processor, unlike a matrix product
        logarithm += weight * log(value - scale)
    return exp(logarithm) if logarithm < log(sys.float_info.max) else inf


def _scaling(tail):
    """Return Λ and δ of a tail.

    If δ is unknown, δ = Λ is used, because ν = log Λ / log δ is close to 1: for the ten tails
    tested it is 0.987 to 1.04.
    """
    (a, b), (c, d) = (1.0, 0.0), (0.0, 1.0)
    for quotient in tail:  # multiply by the matrix [[quotient, 1], [1, 0]]
        (a, b), (c, d) = (a * quotient + b, a), (c * quotient + d, c)
    trace, determinant = a + d, (-1) ** len(tail)
    growth = (trace + sqrt(trace**2 - 4 * determinant)) / 2
    return growth, UNSTABLE_EIGENVALUES.get(tail, growth)
