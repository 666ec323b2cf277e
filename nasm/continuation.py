"""The breakdown of a circle, from how its norms blow up along the ray κ = s·profile.

The length of a circle's finest structure is 1/M,

    M = ‖u‖_{H³} / ‖u‖_{H²}  →  ∞     as  s → s_c.

Near the breakup it is self-similar. For ω with the tail (b_1, …, b_m) there are Λ and δ with

    M(s_c - d/δ) = Λ M(s_c - d)

up to terms that vanish with d. Λ is the growth of the denominators of the convergents over m
partial quotients, and δ the unstable eigenvalue of renormalisation, the same for all circles of
that tail. So M blows up like d^(-ν), ν = log Λ / log δ, times a function that is periodic in log M:
flat for golden tails, ±10% for the tail of fours. Three scales at which M differs by Λ and Λ² do
not notice it. They give s_c by Richardson's extrapolation, with the ratios δ and δ².

That the blow-up marks the breakup is Calleja & de la Llave's criterion (Nonlinearity 23 (2010)
2029), which the paper uses (arXiv:1606.04824, Sec. VI).
"""

from itertools import islice
from math import ceil, inf, log, nan, prod, sqrt

import numpy as np

from nasm import circles, fourier
from nasm.checks import real
from nasm.critical import CriticalScale, Status, no_answer
from nasm.maps import direction, forcing
from nasm.numbers import checked, convergents
from nasm.symmetries import CUSP_EXPONENT, distances_to_shorter, shorten

UNSTABLE = {(1,): 1.6279500, (2,): 2.4416, (3,): 3.344, (4,): 4.265}
"""δ by the tail of ω. Golden: MacKay, Physica D 7 (1983) 283. Twos, threes and fours: measured with
`nasm.periodic`, as the growth of dR/ds at s_c from one convergent to the next."""

N_MAX = 16384  # points of a grid
N_CERTIFIED = 2048  # points of the circle that is certified, on a grid four times finer
_MOST_CIRCLES = 100  # on a ray: 10 to 30 are met
_HALVINGS = 12  # of a step, before Newton's failures are final
_MODES = 6  # times 1/distance: enough to resolve a circle at that distance from its breakup
_ROUNDS = 50  # of the fixed point iteration for s_c, which needs 5 to 20


def critical_scale(omega, profile, tol=1e-6):
    """The scale at which the circle of ω breaks on the ray κ = s·profile, from the blow-up of M.

    1. Where the forcing repeats itself, take the shorter map, as `periodic.critical_scale` does.
    2. Continue the circle from s = 0, each time a fixed part of the way to the breakup as it is
       then estimated, with as many modes as each circle asks for.
    3. Stop when `error` is below tol, or the modes are used up.
    4. Certify the last circle of at most 2048 points.

    Parameters
    ----------
    omega : RotationNumber, irrational; e.g. `numbers.parse("gamma")`.
    profile : sequence of P floats, not all zero; no symmetry is needed.
    tol : float, the error to aim at.

    Returns
    -------
    CriticalScale. lower : the scale of the certified circle. upper : NaN.
    error : half the spread of the last estimates, or of the last one and its neighbour of lower
    order. It may exceed tol. On 360 rays of random angle, with the paper's six circles, it covered
    the difference to residues in 99.7%, 98.9% and 97.2% for tol = 10⁻⁴, 10⁻⁵ and 10⁻⁶. Near a
    forcing of a shorter period, as on |κ1| = |κ2|, it contains the depth to which the boundary
    falls there, as long as the circles met so far cannot tell; where δ is not known for the tail of
    ω, or the circles do not have the modes to tell ω from one with another tail, the whole way from
    the last circle. Without an estimate, value and error are NaN; lower is what was certified all
    the same.

    ValueError if profile is zero or tiny or tol not positive and finite.
    """
    profile = direction(profile)
    tol = real("tol", tol)
    if not 0 < tol < inf:
        raise ValueError(
            f"tol={tol} must be positive and finite; it is the error to aim at, e.g. tol=1e-6"
        )
    if checked(omega).is_rational:
        return no_answer(omega, Status.RATIONAL)
    (short,), short_omega = shorten([profile], omega)
    growth, delta = _scaling(short_omega.tail)
    part = 1 - 1 / delta if growth < 2 else 0.25
    # As many circles as s_c - s takes to shrink by δ, and M to run through its oscillation.
    window = max(3, 1 + round(log(delta) / -log(1 - part)))
    path = [(0.0, np.zeros((short.size, circles.N_FIRST)))]
    finest, estimates, limit, error = [], [], inf, inf
    step = 0.1 / np.abs(short).max()
    while error > tol and len(path) < _MOST_CIRCLES:
        at = path[-1][0]
        step = min(step, part * (limit - at))
        if not step > 1e-14 * at:  # as good as there, as far as the norms can tell
            break
        circle, status = _next_circle(short_omega, short, path, step)
        if status is not Status.OK:
            break
        path.append(circle)
        finest.append(fineness(circle[1]))
        step = 2 * (circle[0] - at)
        limit, lower_order = _breakup(path[1:], finest, growth, delta)
        if lower_order is None:
            continue
        estimates.append(limit)
        last = estimates[-window:]
        if len(last) == window:
            error = 0.5 * max(max(last) - min(last), abs(limit - lower_order))
            if short_omega.tail not in UNSTABLE or not _sees_tail(short_omega, circle[1]):
                error = max(error, limit - circle[0])
    lower = _last_certified(short_omega, short, path)
    if error < inf and not _sees_tail(short_omega, path[-1][1]):
        error = max(error, estimates[-1] - lower) if lower == lower else inf
    if error == inf:
        status = Status.NOT_CONVERGED if status is Status.OK else status
        return CriticalScale(nan, nan, lower, nan, omega, status)
    value = estimates[-1]
    drops = value * distances_to_shorter(short) ** CUSP_EXPONENT
    # What the circles met so far cannot know of: 0.8 to 1.1 of it were found by residues.
    error += drops.max(where=drops < 3 * (value - path[-1][0]), initial=0.0)
    return CriticalScale(value, error, lower, nan, omega, Status.OK)


def certified_scale(omega, profile, breakup, distance):
    """A scale at which the circle of ω is certified, near a breakup that is known.

    Parameters
    ----------
    omega, profile, breakup, distance : as for `certified_circle`.

    Returns
    -------
    scale : float, breakup·(1 - distance) or below; NaN if no circle is certified.
    """
    return certified_circle(omega, profile, breakup, distance)[0]


def certified_circle(omega, profile, breakup, distance):
    """A circle of ω that is certified, near a breakup that is known.

    1. Circles are found at the distances 1/2, 0.15, 0.045, … of the breakup, in parts of it, with
       6 modes or more per distance, as the finest structures there ask for.
    2. The one at `distance` is certified on a finer grid; else one a bit, or a step, further in.

    Parameters
    ----------
    omega : RotationNumber, irrational; e.g. `numbers.parse("gamma")`.
    profile : sequence of P floats.
    breakup : float, the scale of the breakup, e.g. by `periodic.critical_scale`.
    distance : float, 10⁻⁶ to 1/2.

    Returns
    -------
    scale : float, breakup·(1 - distance) or below; NaN if no circle is certified. The work grows
    like 1/distance: 0.2 s at 10⁻⁴, 2 s and 400 MB at 10⁻⁵. There rounding sets a limit: next to a
    cusp 3·10⁻⁵ may be the nearest.
    u : ndarray (P, n), its deviations; None if no circle is certified.
    """
    profile = forcing(profile)
    if not 1e-6 <= distance <= 0.5:
        raise ValueError(f"distance={distance!r} must be from 1e-6 to 0.5, a part of the breakup")
    distances = np.geomspace(0.5, distance, 1 + max(1, ceil(log(2 * distance) / log(0.3))))
    path = [(0.0, np.zeros((profile.size, circles.N_FIRST)))]
    for d in distances[:-1]:
        u = _circle_near(omega, profile, path, breakup * (1 - d), _MODES / d)
        if u is None:
            break
        path.append((breakup * (1 - d), u))
    # Fewer modes at first: nothing goes on from this circle, and they let less rounding in.
    for d, modes in ((distance, 0.7), (distance, 1.0), (min(1.4 * distance, 0.5), 0.7)):
        u = _circle_near(omega, profile, path, breakup * (1 - d), modes * _MODES / d)
        if u is not None and circles.polished_is_circle(omega, breakup * (1 - d) * profile, u):
            return breakup * (1 - d), u
    for scale, u in reversed(path[1:]):
        if circles.polished_is_circle(omega, scale * profile, u):
            return scale, u
    return nan, None


def _circle_near(omega, profile, path, scale, n_modes):
    """Newton's method from the circles of a path, with that many modes; None if it fails."""
    u = circles.extrapolate(path, scale)
    u = fourier.resample(u, max(fourier.grid(omega, n_modes), u.shape[-1]))
    return u if circles.polish(omega, scale * profile, u) else None


def fineness(u):
    """M = ‖u‖_{H³}/‖u‖_{H²} of deviations u, shape (P, n): the wave number of the finest part."""
    third, second = (np.linalg.norm(fourier.sobolev_norm(u, order)) for order in (3, 2))
    return third / second


def _next_circle(omega, profile, path, step):
    """(scale, u) of a circle `step` beyond the last of the path, or nearer; and a Status.

    The step is halved while Newton's method is lost. It is not when the modes are used up: then the
    circles met before are as near to the breakup as it pays to go.
    """
    at = path[-1][0]
    for _ in range(_HALVINGS):
        target = at + step
        u = circles.extrapolate(path, target)
        u, status = circles.settle(omega, target * profile, u, N_MAX)
        if status is not Status.NO_CIRCLE:
            break
        step /= 2
    return (target, u), status


def _last_certified(omega, profile, path):
    """The scale of the last circle that is certified, of those of at most N_CERTIFIED points."""
    for scale, u in reversed([point for point in path if point[1].shape[-1] <= N_CERTIFIED]):
        if circles.certify(omega, scale * profile, u)[1] is Status.OK:
            return scale
    return nan


def _sees_tail(omega, u):
    """Whether u has the modes of the first convergent that knows all of the prefix of ω.

    A large partial quotient may break the circle at resonances that fewer modes do not have.
    """
    *_, fraction = islice(convergents(omega), len(omega.prefix))
    return fourier.cut(omega, u.shape[-1]) >= fraction.denominator


def _breakup(path, finest, growth, delta):
    """s_c from the last circles of the path, and a value of lower order to compare it with.

    Three scales at M, M/Λ and M/Λ², the last two by interpolation. As long as the path does not
    reach back so far: a straight line through the last two M^(-1/ν), and None.
    """
    scales, log_m = np.array([s for s, _ in path]), np.log(finest)
    falls = np.flatnonzero(np.diff(log_m) <= 0)  # far from the breakup M need not grow
    if falls.size:
        scales, log_m = scales[falls[-1] + 1 :], log_m[falls[-1] + 1 :]
    if scales.size < 2:
        return inf, None
    last, nu = scales[-1], log(growth) / log(delta)
    shrink = np.exp((log_m[-2] - log_m[-1]) / nu)
    limit = last + (last - scales[-2]) * shrink / (1 - shrink) if shrink < 1 else inf
    if limit == inf or scales.size < 4 or log_m[-1] - 2 * log(growth) < log_m[0]:
        return limit, None
    first = _interpolation(log_m, log_m[-1] - log(growth))
    second = _interpolation(log_m, log_m[-1] - 2 * log(growth))
    guess = limit
    for _ in range(_ROUNDS):
        log_distance = np.log(guess - scales)
        at_first, at_second = guess - np.exp([first @ log_distance, second @ log_distance])
        lower_order = last + (last - at_first) / (delta - 1)
        earlier = at_first + (at_first - at_second) / (delta - 1)
        value = lower_order + (lower_order - earlier) / (delta**2 - 1)
        if not value > last:
            break
        if abs(value - guess) < 1e-11 * value:
            return value, lower_order
        guess = value
    return limit, None


def _interpolation(x, at):
    """Weights w: w @ y is the cubic through those four of the points (x, y) around `at`, there."""
    start = min(max(np.searchsorted(x, at) - 2, 0), x.size - 4)
    weights = np.zeros(x.size)
    four = range(start, start + 4)
    for i in four:
        weights[i] = prod((at - x[j]) / (x[i] - x[j]) for j in four if j != i)
    return weights


def _scaling(tail):
    """Λ and δ of a tail; where δ is not known, Λ = 2 and ν = 0.99, which is near that of all."""
    if tail not in UNSTABLE:
        return 2.0, 2.0 ** (1 / 0.99)
    matrix = np.eye(2)
    for b in tail:
        matrix = matrix @ np.array([[b, 1.0], [1.0, 0.0]])
    trace, determinant = np.trace(matrix), (-1) ** len(tail)
    return (trace + sqrt(trace**2 - 4 * determinant)) / 2, UNSTABLE[tail]
