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

from itertools import chain, islice, pairwise
from math import ceil, exp, inf, log, nan, sqrt

import numpy as np

from nasm.arithmetic.reproducible import geometric, powers
from nasm.checks import positive, real
from nasm.circles import fourier, newton
from nasm.critical import CriticalScale, Status, no_answer
from nasm.farey import circle_stands
from nasm.maps import TWO_PI, direction, segment
from nasm.numbers import as_rotation_number, convergents
from nasm.symmetries import CUSP_EXPONENT, distances_to_shorter, shorten

__all__ = ["certified_circle", "critical_scale", "fineness"]

METHOD = "continuation of circles"
UNSTABLE = {(1,): 1.6279500, (2,): 2.4416, (3,): 3.344, (4,): 4.265}
"""δ by the tail of ω. Golden: MacKay, Physica D 7 (1983) 283. Twos, threes and fours: measured with
`nasm.periodic`, as the growth of dR/ds at s_c from one convergent to the next."""

N_MAX = 16384  # points of a grid
N_CERTIFIED = 2048  # points of the circle that is certified, on a grid four times finer
_MOST_CIRCLES = 100  # on a ray: 10 to 30 are met
_HALVINGS = 12  # of a step, before Newton's failures are final
_MODES = 6  # times 1/distance: enough to resolve a circle at that distance from its breakup,
_FEWER = 4.5  # and to go on from it: of 46 certificates 3.5 lost five, 4.5 none
_ROUNDS = 50  # of the fixed point iteration for s_c, which needs 5 to 20
_PARTS = np.array([0.85, 1.0])  # of the modes that a circle has
_TWO_SCALES = 3  # the error of two scales, in parts of the way from the last circle: 2.3 was met
_DELTA_UNKNOWN = 0.2  # the least error without δ, in parts of that way
_LARGEST_POWER = 700.0  # of e that is a float
_BEYOND = 0.005  # of the value: where residues of orbits up to 3000 look for the circle
_DROPS = 4  # times the way from the second of three circles: up to it, a cusp's depth is unseen


def critical_scale(omega, profile, tol=1e-6):
    """The scale at which the circle of ω breaks on the ray κ = s·profile, from the blow-up of M.

    1. Where the forcing repeats itself, take the shorter map, as `periodic.critical_scale` does.
    2. Continue the circle from s = 0, each time a fixed part of the way to the breakup as it is
       then estimated, with as many modes as each circle asks for.
    3. Stop when `error` is below tol, or the modes are used up.
    4. Certify the last circle of at most 2048 points.

    omega : RotationNumber or its text, irrational; e.g. "gamma".
    profile : sequence of P floats, not all zero; no symmetry is needed.
    tol : float, the error to aim at.

    Returns CriticalScale. lower : the scale of the certified circle. upper : NaN.
    error : the spread of the last estimates and their last change, or the change made by the third
    scale if that is larger, plus the change made by the highest modes. It may exceed tol. Near a
    forcing of a shorter period it contains the depth to which the boundary falls there, as long as
    the circles met so far cannot tell. It is three times the way from the last circle where M has
    not run over Λ² yet, and a fifth of that way or more where δ is not known for the tail of ω.
    Without an estimate, or with an error as large as the value, both are NaN, as where a large
    quotient hides the tail from all circles that have modes enough; lower is what was certified all
    the same. Status UNDECIDED where residues say that the circle is still there beyond the value.

    ValueError if profile is zero or tiny or tol not positive and finite.
    """
    profile = direction(profile)
    tol = positive("tol", tol, "the error to aim at, e.g. tol=1e-6")
    omega = as_rotation_number(omega)
    if omega.is_rational:
        return no_answer(omega, Status.RATIONAL, METHOD)
    (short,), short_omega = shorten([profile], omega)
    path, value, error, status = _walk(short_omega, short, tol)
    certified = (
        scale
        for scale, u in reversed(path)
        if u.shape[-1] <= N_CERTIFIED
        and newton.certify(short_omega, scale * short, u)[1] is Status.OK
    )
    lower = next(certified, nan)
    if not error < value:  # which would say nothing
        status = Status.NOT_CONVERGED if status is Status.OK else status
        return CriticalScale(nan, nan, lower, nan, omega, status, METHOD)
    # Where the ray misses another sheet of the circle's boundary closely, circles below it look as
    # if they were to break there. For one kick or two there is one sheet.
    beyond = value + max(2 * error, _BEYOND * value)
    if short.size > 2 and circle_stands(short_omega, beyond * short):
        return CriticalScale(nan, nan, lower, nan, omega, Status.UNDECIDED, METHOD)
    return CriticalScale(value, error, lower, nan, omega, Status.OK, METHOD)


def certified_circle(omega, profile, breakup, distance, start=None):
    """A circle of ω that is certified, near a breakup that is known.

    1. Circles are found at the distances 1/2, 0.15, 0.045, … of the breakup, in parts of it, with
       4.5 modes or more per distance, as the finest structures there ask for.
    2. The one at `distance` is certified on a finer grid, from 2.4 modes per distance if they are
       enough, or 4.2 or 6; else one a bit, or a step, further in.

    omega : RotationNumber or its text, irrational; e.g. "gamma".
    profile : sequence of P floats.
    breakup : float, the scale of the breakup, e.g. by `periodic.critical_scale`.
    distance : float, 10⁻⁶ to 1/2.
    start : sequence of P floats, default 0: on κ = start + s·profile.

    Returns scale : float, breakup·(1 - distance) or below; NaN if no circle is certified. The work
    grows like 1/distance: 0.1 s at 10⁻⁴, 9 s and 1 GB at 10⁻⁵. There rounding sets a limit: next to
    a cusp 3·10⁻⁵ may be the nearest.
    u : ndarray (P, n), its deviations; None if no circle is certified.
    """
    start, profile = segment(start, profile)
    breakup, distance = real("breakup", breakup), real("distance", distance, 1e-6, 0.5)
    distances = geometric(0.5, distance, 1 + max(1, ceil(log(2 * distance) / log(0.3))))
    path = _begun(omega, start)

    def near(d, n_modes):
        scale = breakup * (1 - d)
        u = newton.extrapolate(path, scale, fourier.grid(omega, n_modes))
        return u if newton.polish(omega, start + scale * profile, u) else None

    for d in distances[:-1] if path else []:
        u = near(d, _FEWER / d)
        if u is None:
            break
        path.append((breakup * (1 - d), u))
    # Fewer modes at first: nothing goes on from this circle, and they let less rounding in.
    tries = [(distance, part) for part in (0.4, 0.7, 1.0)] + [(min(1.4 * distance, 0.5), 0.7)]
    nearest = ((breakup * (1 - d), near(d, part * _MODES / d)) for d, part in tries if path)
    for scale, u in chain(nearest, reversed(path[1:])):
        if u is not None and newton.polished_is_circle(omega, start + scale * profile, u):
            return scale, u
    return nan, None


def _begun(omega, start):
    """The path of circles at s = 0: [(0.0, u)]; empty if Newton's method finds none there."""
    if not start.any():
        return [(0.0, np.zeros((start.size, newton.N_FIRST)))]
    circle = newton.invariant_circle(omega, start, N_MAX)
    return [(0.0, circle.u)] if circle.certified else []


def fineness(u, last=-1):
    """M = ‖u‖_{H³}/‖u‖_{H²} of deviations u, shape (P, n): the wave number of the finest part.

    last : the highest mode that counts, or several, for an array of M; default all.
    """
    power = np.sum(np.abs(np.fft.rfft(u)) ** 2, axis=0)
    squares = np.arange(power.size, dtype=float) ** 2
    second = power * squares**2
    third = second * squares
    return TWO_PI * np.sqrt(np.cumsum(third)[last] / np.cumsum(second)[last])


def _walk(omega, profile, tol):
    """Circles on the way to the breakup: the path, the last estimate of it, its error, inf without
    one, and OK, or why there is no further circle."""
    growth, delta = _scaling(omega.tail)
    part = 1 - 1 / delta if growth < 2 else 0.25
    # As many circles as s_c - s takes to shrink by δ, and M to run through its oscillation.
    window = max(3, 1 + round(log(delta) / -log(1 - part)))
    cusps = powers(distances_to_shorter(profile), CUSP_EXPONENT)
    path, logarithms, values = [(0.0, np.zeros((profile.size, newton.N_FIRST)))], [], []
    value, error, step, status = nan, inf, 0.1 / np.abs(profile).max(), Status.OK
    # Below a relative step of 1e-14 the norms cannot tell the circle from the breakup.
    while error > tol and len(path) < _MOST_CIRCLES and step > 1e-14 * path[-1][0]:
        (at, u), status = _next_circle(omega, profile, path, step)
        if status is not Status.OK:
            break
        path.append((at, u))
        # By 85% of the modes and by all: they differ where the last ones are not resolved.
        finest = fineness(u, (_PARTS * fourier.cut(omega, u.shape[-1])).astype(int))
        logarithms.append([log(m) for m in finest])
        scales, log_m = np.array([scale for scale, _ in path[1:]]), np.array(logarithms).T[::-1]
        found, own_error = _estimate(omega, scales, log_m, growth, delta)
        if own_error == inf and value > at:  # the estimate before still stands
            error, values = max(error, _TWO_SCALES * (value - at)), []
        else:
            value, error = found, own_error
        way = value - at if error < inf else _straight_way(scales, log_m[0], growth, delta)
        step = min(2 * (at - path[-2][0]), part * way)
        if own_error < inf:
            values = [*values, value][-window:] if error < way else []
            is_spread = len(values) == window
            error = max(error, np.ptp(values) + abs(values[-1] - values[-2]) if is_spread else way)
            # What the circles met so far cannot know of: 0.8 to 1.1 of it were found by residues.
            drops = value * cusps
            error += drops.max(where=drops < _DROPS * delta * way, initial=0.0)
    return path, value, error, status


def _next_circle(omega, profile, path, step):
    """(scale, u) of a circle `step` beyond the last of the path, or nearer where Newton's method is
    lost; and a Status."""
    at = path[-1][0]
    for _ in range(_HALVINGS):
        target = at + step
        u = newton.extrapolate(path, target)
        u, status = newton.settle(omega, target * profile, u, N_MAX)
        if status is not Status.NO_CIRCLE:
            break
        step /= 2
    return (target, u), status


def _estimate(omega, scales, log_m, growth, delta):
    """s_c by three scales, at M, M/Λ and M/Λ², or by the first two; and an error.

    M counts from the wave number at which the tail of ω begins: the last denominator of its prefix.
    NaN and inf where M has not run over Λ yet.
    """
    falls = np.flatnonzero(np.diff(log_m[0]) <= 0)  # far from the breakup M need not grow
    start = falls[-1] + 1 if falls.size else 0
    scales, (whole, most) = scales[start:], log_m[:, start:]
    *_, fraction = islice(convergents(omega), len(omega.prefix))
    first = max(whole[0], log(TWO_PI * fraction.denominator))
    order = min(int((whole[-1] - first) / log(growth)), 2)
    if scales.size < 4 or order < 1:
        return nan, inf
    value, lower_order = _extrapolation(scales, whole, growth, delta, order)
    if not value > scales[-1]:
        return nan, inf
    way = value - scales[-1]
    if order == 1:
        return value, _TWO_SCALES * way
    error = abs(value - lower_order)
    error += abs(value - _extrapolation(scales, most, growth, delta, order)[0])
    if omega.tail not in UNSTABLE:
        error = max(error, _DELTA_UNKNOWN * way)
    return value, error if error < way else way


def _extrapolation(scales, log_m, growth, delta, order):
    """s_c, and that of one order less, by Richardson's rule; NaN if the iteration for it is lost.

    The rule needs the scales at M, M/Λ, …, which are interpolated in log(s_c - s).
    """
    at = [log_m[-1] - k * log(growth) for k in range(1, order + 1)]
    nodes = [_interpolation(scales, log_m, x) for x in at]
    wild = sum(abs(weight) for node in nodes for weight, _ in node) > 100
    value = scales[-1] + _straight_way(scales, log_m, growth, delta)
    for _ in range(_ROUNDS):
        # Beyond 10 times the last scale, or by wild weights, there is nothing to be found.
        if not scales[-1] < value < 10 * scales[-1] or wild:
            break
        guess = value
        column = [scales[-1], *(guess - _way(node, guess) for node in nodes)]
        for power in range(1, order + 1):
            lower_order = column[0]
            column = [a + (a - b) / (delta**power - 1) for a, b in pairwise(column)]
        value = column[0]
        if abs(value - guess) < 1e-11 * value:
            return value, lower_order
    return nan, nan


def _straight_way(scales, log_m, growth, delta):
    """s_c - s from the last circle, by a straight line through the last two M^(-1/ν)."""
    if len(scales) < 2 or not log_m[-1] > log_m[-2]:
        return inf
    shrink = exp((log_m[-2] - log_m[-1]) * log(delta) / log(growth))
    return (scales[-1] - scales[-2]) * shrink / (1 - shrink) if shrink < 1 else inf


def _interpolation(scales, log_m, at):
    """Four (weight, scale) around log M = `at`, whose weighted sum is the value of the cubic."""
    start = min(max(int(np.searchsorted(log_m, at)) - 2, 0), log_m.size - 4)
    weights = newton.lagrange(log_m[start : start + 4].tolist(), at)
    return list(zip(weights, scales[start : start + 4].tolist(), strict=True))


def _way(nodes, value):
    """s_c - s, if s_c is `value`, by interpolation of its logarithm between the nodes."""
    logarithm = 0.0
    for weight, scale in nodes:  # in this order on every processor, as no matrix product is
        logarithm += weight * log(value - scale)
    return exp(min(logarithm, _LARGEST_POWER))


def _scaling(tail):
    """Λ and δ of a tail; where δ is not known, δ = Λ, as ν is 0.987 to 1.04 for the ten tried."""
    (a, b), (c, d) = (1.0, 0.0), (0.0, 1.0)
    for quotient in tail:  # times the matrix [[quotient, 1], [1, 0]]
        (a, b), (c, d) = (a * quotient + b, a), (c * quotient + d, c)
    trace, determinant = a + d, (-1) ** len(tail)
    growth = (trace + sqrt(trace**2 - 4 * determinant)) / 2
    return growth, UNSTABLE.get(tail, growth)
