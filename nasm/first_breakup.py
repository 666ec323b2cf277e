"""The first breakup of the last barrier on a segment that begins anywhere.

    κ(s) = start + s·profile,   s ≥ 0,       f(s) = the scale of the last breakup on the ray t·κ(s)

A barrier is left under κ(s) while f(s) > 1. `barriers` finds f; the first s with f(s) = 1 is where
global transport begins on the segment. `verdict` shows a barrier on the way, in steps, and at both
ends of the bracket what it can under the very forcing: that f > 1 means a barrier, and not only one
further out on the ray from zero, is not taken for granted.
"""

import numpy as np
from scipy.optimize import brentq

from nasm import barriers
from nasm.checks import real
from nasm.critical import CriticalScale, Status, no_answer
from nasm.maps import direction, forcing
from nasm.verdict import Answer, Evidence, verdict

_STEP = 0.1  # of the largest strength: a region without barriers that is narrower is stepped over
_FARTHEST = 4.0  # change of the largest strength


def critical_scale(start, profile, tol=1e-3):
    """The first scale at which the last barrier breaks on κ = start + s·profile, s ≥ 0.

    Parameters
    ----------
    start, profile : sequences of P floats; profile not all 0.
    tol : float, 10⁻⁵ to 10⁻¹: the width of the bracket to aim at, (upper - lower)/value.

    Returns
    -------
    CriticalScale. lower : a circle is certified under start + lower·profile; upper : no start
    survives converse KAM under start + upper·profile; NaN where `verdict` does not show it. omega :
    of the last circle to break, per period. Status OUTSIDE if there is no barrier at the start,
    NO_BREAKUP if one is left where some strength has changed by 4, and that of `barriers` where it
    has no value; UNDECIDED if `verdict` contradicts it, or the error is not known.
    Some 5 to 20 s of CPU time.

    ValueError if start and profile differ in length, or as for `barriers.critical_scale`.
    """
    start, profile, tol = forcing(start), direction(profile), real("tol", tol)
    if not 1e-5 <= tol <= 0.1:
        raise ValueError(f"tol={tol!r} must be from 1e-5 to 0.1")
    if start.size != profile.size:
        raise ValueError(f"start and profile have {start.size} and {profile.size} strengths")
    step = _STEP / np.abs(profile).max()
    if verdict(start).answer is Answer.TRANSPORT:
        return no_answer(None, Status.OUTSIDE)
    inside, beyond = 0.0, step
    while (answer := verdict(start + beyond * profile).answer) is not Answer.TRANSPORT:
        inside = beyond if answer is Answer.BARRIER else inside
        beyond += step
        if beyond > _FARTHEST / _STEP * step:
            return no_answer(None, Status.NO_BREAKUP)
    fine = min(tol, 1e-3)
    precision = fine * beyond / 100
    try:
        value = brentq(lambda s: _excess(start + s * profile, fine), inside, beyond, xtol=precision)
    except _NoValueError as missing:
        return no_answer(None, missing.args[0])
    except ValueError:  # by brentq: f contradicts the verdicts at both ends
        return no_answer(None, Status.UNDECIDED)
    last = barriers.critical_scale(start + value * profile, fine)
    ends = value * (1 - 0.7 * tol), value * (1 + 0.3 * tol)
    below, above = (verdict(start + s * profile) for s in ends)
    if below.answer is Answer.TRANSPORT or above.answer is Answer.BARRIER:
        return no_answer(last.omega, Status.UNDECIDED)
    lower = ends[0] if below.evidence is Evidence.CIRCLE else np.nan
    upper = ends[1] if above.answer is Answer.TRANSPORT else np.nan
    # f changes by so much from one end to the other, as 1/value does on a ray from zero.
    slope = np.log(below.boundary.value / above.boundary.value) / (ends[1] - ends[0])
    error = precision + abs(last.error / slope)
    if not np.isfinite(error):
        return no_answer(last.omega, Status.UNDECIDED)
    return CriticalScale(value, error, lower, upper, last.omega, Status.OK)


class _NoValueError(Exception):
    """`barriers` has no value on a ray from zero; of its status."""


def _excess(kappa, tol):
    """log f: how far the boundary is beyond a forcing on the ray from zero."""
    if not kappa.any():
        return np.inf
    found = barriers.critical_scale(kappa, tol)
    if not found.value > 0:
        raise _NoValueError(found.status)
    return np.log(found.value)
