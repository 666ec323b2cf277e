"""The first breakup on a segment that begins anywhere: of the last barrier, or of one circle.

    κ(s) = start + s·profile,   s ≥ 0,       f(s) = the scale of the breakup on the ray t·κ(s)

A circle is left under κ(s) while f(s) > 1; the first s with f(s) = 1 is where it breaks. For the
last barrier `barriers` finds f, and `verdict` shows a barrier on the way, in steps, and at both
ends of the bracket what it can under the very forcing. For one circle it is `circles.continuation`
that finds f, and a circle is certified under the very forcing below the breakup. That f > 1 means a
circle, and not only one further out on the ray from zero, is not taken for granted there.
"""

from functools import partial
from math import inf, isfinite, log, nan

import numpy as np
from scipy.optimize import brentq

from nasm import barriers, circles
from nasm.checks import real
from nasm.circles import continuation
from nasm.critical import CriticalScale, Status, no_answer
from nasm.maps import direction, forcing
from nasm.numbers import checked
from nasm.verdict import Answer, Evidence, verdict

__all__ = ["circle_scale", "critical_scale"]
__dir__ = __all__.copy

_STEP = 0.1  # of the largest strength: a region without circles that is narrower is stepped over
_FARTHEST = 4.0  # change of the largest strength
_SCALES = np.arange(1, round(_FARTHEST / _STEP) + 1)  # of circles, in steps
_METHOD = "verdicts along the segment"
_BELOW = 0.01  # a circle is certified there, in parts of f


def critical_scale(start, profile, tol=1e-3):
    """The first scale at which the last barrier breaks on κ = start + s·profile, s ≥ 0.

    Parameters
    ----------
    start, profile : sequences of P floats; profile not all 0.
    tol : float, 10⁻⁵ to 10⁻¹: the width of the bracket to aim at, (upper - lower)/value.

    Returns
    -------
    CriticalScale. lower : a circle is certified under start + lower·profile; upper : no start
    survives converse KAM under start + upper·profile; as near as asked for, but NaN where `verdict`
    does not show it. omega : of the last circle to break, per period. Status OUTSIDE if there is no
    barrier at the start, NO_BREAKUP if one is left where some strength has changed by 4, and that
    of `barriers` where it has no value; UNDECIDED if `verdict` contradicts it, or the error is not
    known.
    Some 5 to 60 s of CPU time, and 100 s where `verdict` is often undecided.

    ValueError if start and profile differ in length, or as for `barriers.critical_scale`.
    """
    start, profile, step = _segment(start, profile)
    tol = real("tol", tol)
    if not 1e-5 <= tol <= 0.1:
        raise ValueError(f"tol={tol!r} must be from 1e-5 to 0.1")
    fine = min(tol, 1e-3)
    found, excess, known = _on_rays(partial(barriers.critical_scale, tol=fine), start, profile)

    def asked(s):
        said = verdict(start + s * profile)
        known[s] = said.boundary
        return said

    if asked(0.0).answer is Answer.TRANSPORT:
        return no_answer(None, Status.OUTSIDE, _METHOD)
    inside, beyond = 0.0, step
    while (answer := asked(beyond).answer) is not Answer.TRANSPORT:
        inside = beyond if answer is Answer.BARRIER else inside
        beyond += step
        if beyond > _FARTHEST / _STEP * step:
            return no_answer(None, Status.NO_BREAKUP, _METHOD)
    precision = fine * beyond / 100
    try:
        value = brentq(excess, inside, beyond, xtol=precision)
    except _NoValueError as missing:
        return no_answer(None, *missing.args)
    except ValueError:  # by brentq: f contradicts the verdicts at both ends
        return no_answer(None, Status.UNDECIDED, _METHOD)
    last, ends = found(value), (value * (1 - 0.7 * tol), value * (1 + 0.3 * tol))
    below, above = map(asked, ends)
    if below.answer is Answer.TRANSPORT or above.answer is Answer.BARRIER:
        return no_answer(last.omega, Status.UNDECIDED, last.method)
    lower = ends[0] if below.evidence is Evidence.CIRCLE else nan
    upper = ends[1] if above.answer is Answer.TRANSPORT else nan
    # f changes by so much from one end to the other, as 1/value does on a ray from zero.
    slope = log(below.boundary.value / above.boundary.value) / (ends[1] - ends[0])
    error = precision + abs(last.error / slope)
    if not isfinite(error):
        return no_answer(last.omega, Status.UNDECIDED, last.method)
    return CriticalScale(value, error, lower, upper, last.omega, Status.OK, last.method)


def circle_scale(omega, start, profile, tol=1e-4):
    """The first scale at which the circle of ω breaks on κ = start + s·profile, s ≥ 0.

    Parameters
    ----------
    omega : RotationNumber, irrational. start, profile : as for `critical_scale`.
    tol : float, the error of f to aim at.

    Returns ------- CriticalScale. error : what that of f comes to, by the slope of f. lower : the
    circle is certified under start + lower·profile, there or at the start; NaN if it is not. upper
    : NaN. Status OUTSIDE if f < 1 at the start, NO_BREAKUP as for `critical_scale`, NOT_CONVERGED
    if the error is as large as the value, and that of `circles.continuation` where it has no value.
    Some 0.2 s of CPU time.

    ValueError if start and profile differ in length, or as for
    `circles.continuation.critical_scale`.
    """
    omega, (start, profile, step) = checked(omega), _segment(start, profile)
    method = partial(continuation.critical_scale, omega, tol=tol)
    found, excess, _ = _on_rays(method, start, profile)
    try:
        if excess(0.0) <= 0:
            return no_answer(omega, Status.OUTSIDE, continuation.METHOD)
        beyond = next(s for s in step * _SCALES if excess(s) < 0)
        value = brentq(excess, beyond - step, beyond, xtol=1e-3 * tol * step)
        slope = (excess(value - 0.1 * step) - excess(value)) / (0.1 * step)
    except StopIteration:
        return no_answer(omega, Status.NO_BREAKUP, continuation.METHOD)
    except _NoValueError as missing:
        return no_answer(omega, *missing.args)
    error = found(value).error / abs(slope)
    lower = nan
    for s in (value - max(_BELOW / abs(slope), 2 * error), 0.0):
        if s >= 0 and circles.invariant_circle(omega, start + s * profile).certified:
            lower = s
            break
    if not error < value:
        return CriticalScale(nan, nan, lower, nan, omega, Status.NOT_CONVERGED, continuation.METHOD)
    return CriticalScale(value, error, lower, nan, omega, Status.OK, continuation.METHOD)


def _segment(start, profile):
    """start, profile and the step of s in which a breakup is looked for."""
    start, profile = forcing(start), direction(profile)
    if start.size != profile.size:
        raise ValueError(f"start and profile have {start.size} and {profile.size} strengths")
    return start, profile, _STEP / np.abs(profile).max()


class _NoValueError(Exception):
    """There is no value on a ray from zero; of its status and method."""


def _on_rays(method, start, profile):
    """The CriticalScale on the ray through κ(s), which is asked for once; log f; what is known."""
    known = {}

    def found(s):
        if s not in known:
            known[s] = method(start + s * profile)
        return known[s]

    def excess(s):
        if not (start + s * profile).any():
            return inf
        if not found(s).value > 0:
            raise _NoValueError(found(s).status, found(s).method)
        return log(found(s).value)

    return found, excess, known
