"""The first breakup of one circle on a segment that begins anywhere, by continuation.

    κ(s) = start + s·profile,   s ≥ 0,       f(s) = the scale of the breakup on the ray t·κ(s)

A circle is left under κ(s) while f(s) > 1; the first s with f(s) = 1 is where it breaks.
`circles.continuation` finds f, and a circle is certified under the very forcing below the breakup.
That f > 1 means a circle, and not only one further out on the ray from zero, is not taken for
granted there. (`barriers.critical_scale` and `periodic.critical_scale` take a start themselves.)
"""

from math import inf, log, nan

import numpy as np

from nasm import circles
from nasm.arithmetic.roots import root
from nasm.circles import continuation
from nasm.critical import CriticalScale, Status, no_answer
from nasm.maps import segment
from nasm.numbers import checked

__all__ = ["circle_scale"]
__dir__ = __all__.copy

_STEP = 0.1  # of the largest strength: a region without circles that is narrower is stepped over
_FARTHEST = 4.0  # change of the largest strength
_SCALES = np.arange(1, round(_FARTHEST / _STEP) + 1)  # of circles, in steps
_BELOW = 0.01  # a circle is certified there, in parts of f


def circle_scale(omega, start, profile, tol=1e-4):
    """The first scale at which the circle of ω breaks on κ = start + s·profile, s ≥ 0.

    Parameters
    ----------
    omega : RotationNumber, irrational. start, profile : sequences of P floats; profile not all 0.
    tol : float, the error of f to aim at.

    Returns
    -------
    CriticalScale. error : what that of f comes to, by the slope of f. lower : the circle is
    certified under start + lower·profile, there or at the start; NaN if it is not. upper : NaN.
    Status OUTSIDE if f < 1 at the start, NO_BREAKUP if the circle is left where some strength has
    changed by 4, NOT_CONVERGED if the error is as large as the value, and that of
    `circles.continuation` where it has no value. Some 0.2 s of CPU time.

    ValueError if start and profile differ in length, or as for
    `circles.continuation.critical_scale`.
    """
    omega, (start, profile) = checked(omega), segment(start, profile)
    step, known = _STEP / np.abs(profile).max(), {}

    def found(s):
        if s not in known:
            known[s] = continuation.critical_scale(omega, start + s * profile, tol)
        return known[s]

    def excess(s):
        if not (start + s * profile).any():
            return inf
        if not found(s).value > 0:
            raise _NoValueError(found(s).status, found(s).method)
        return log(found(s).value)

    try:
        if excess(0.0) <= 0:
            return no_answer(omega, Status.OUTSIDE, continuation.METHOD)
        beyond = next(s for s in step * _SCALES if excess(s) < 0)
        value = root(excess, beyond - step, beyond, 1e-3 * tol * step)
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


class _NoValueError(Exception):
    """There is no value on a ray from zero; of its status and method."""
