"""The last barrier on a ray κ = s·profile: which circle breaks last, where, and how sure that is.

The boundary of global transport CB_gt is the envelope of the boundaries CB_ω over all ω: at each
angle another circle may be the last one. It is found and bracketed in four steps.

1. Locate. Converse KAM gives the breakup to 10⁻⁴, and beyond it the start that lives longest: it
   is next to what is left of the last circle.
2. Identify. The weighted Birkhoff average of its orbit is a rotation number to six digits or so,
   and the nobles that agree with it, the shortest first, are the candidates.
3. Value. Greene's residue says where each candidate breaks; the last one is the barrier.
4. Certify. Below the value an invariant circle of that ω, certified by Newton's method on a finer
   grid: `lower`. Above it, converse KAM on two unrelated grids finds no start that survives:
   `upper`. A survivor is on another barrier: back to step 1, four times as near to the breakup.

Each step is another method, and checks the one before. If they do not agree in the end there is no
value, but the bracket of those that do.

`verdict` asks about one forcing. The boundary on its ray tells only where to look and how hard; the
answer comes from the forcing itself: a circle that is certified there, or no start that survives.
"""

from dataclasses import dataclass, replace
from enum import Enum
from math import floor, inf

import numpy as np

from nasm import circles, cones, continuation, periodic
from nasm.critical import CriticalScale, Status, no_answer
from nasm.maps import forcing
from nasm.numbers import convergents, moebius, nobles_near, rational
from nasm.orbits import rotation_number
from nasm.symmetries import shorten

_LOCATE = (1000, 4000, 16_000, 64_000)  # steps of converse KAM in step 1, round by round
_BEYOND = 0.5  # over the steps: where, past the breakup, the longest-lived start is asked for its ω
_NEAR = 2e-5  # of the measured rotation number; neighbours that robust are further apart
_AVERAGED = 1000  # steps
_CANDIDATES = 3

_TOLERANCES = (1e-3, 1e-4, 2e-5)  # of the boundary next to a point: 0.1 s, 0.4 s and 2 to 3 s
_MOST_STEPS = 400_000  # of converse KAM at a point, a second or two: to 4e-6 above the boundary
_MOST_POINTS = 2**15  # of a circle that is further than the first tolerance from its breakup
_NEAREST = 1.5e-5  # below the boundary: nearer, certificates fail, and take 5 s to do so


class Answer(Enum):
    """Is transport in y global?"""

    BARRIER = "barrier"
    TRANSPORT = "transport"
    UNDECIDED = "undecided"


class Evidence(Enum):
    """What an Answer rests on."""

    INTEGRABLE = "without kicks, every y is a circle"
    CIRCLE = (
        "the circle was computed for this very forcing by Newton's method, and certified on a "
        "finer grid; that is no computer-assisted proof"
    )
    CIRCLE_BEYOND = (
        "the circle is certified further out on the ray from κ = 0, not at this forcing; that it "
        "does not break and come back on the way is an assumption"
    )
    CONES = (
        "converse KAM eliminates all starts for this very forcing; near to a proof, but the starts "
        "are a sample and the arithmetic is floating point"
    )
    NONE = "no circle is certified at this forcing, and not all starts are eliminated"


@dataclass(frozen=True)
class Verdict:
    """Whether a rotational invariant circle is left under the forcing kappa.

    answer, evidence : what is known, and from what. UNDECIDED is no guess at either.
    boundary : CriticalScale of the last barrier on the ray s·kappa, s = 1 being the forcing itself.
        Its omega is the circle's, if there is one; else that of the last circle that broke.
    circle : x, y of it at the start of a period, ndarrays, x on the lift, y up to an integer; None
        unless evidence is CIRCLE.
    steps : float, within which converse KAM eliminated all starts; inf unless evidence is CONES.
    """

    answer: Answer
    evidence: Evidence
    boundary: CriticalScale
    circle: tuple[np.ndarray, np.ndarray] | None = None
    steps: float = inf


def critical_scale(profile, tol=1e-4):
    """The scale at which the last rotational invariant circle breaks on the ray κ = s·profile.

    Parameters
    ----------
    profile : sequence of P floats with a dominant symmetry line; see `nasm.cones`.
    tol : float, 10⁻⁵ to 10⁻¹: the width of the bracket to aim at, (upper - lower)/value.

    Returns
    -------
    CriticalScale. value, error : by Greene's residue. lower : a circle of ω is certified there;
    upper : no start on the dominant line survives there. omega : that of the last barrier, per
    period, in [0, P/2], which stands for ±ω and all ω + P·n: their circles break together.
    Status UNDECIDED, and no value, where the methods contradict each other; lower and upper are
    then those that were shown. lower is NaN where no circle could be certified.

    ValueError if profile is zero, has no dominant symmetry line, or tol is out of range.
    """
    profile = forcing(profile)
    if not 1e-5 <= tol <= 0.1:
        raise ValueError(f"tol={tol!r} must be from 1e-5 to 0.1")
    # On κ1 = κ2 the barriers are noble for the standard map, not for two steps of it.
    (short,), zero = shorten([profile], rational(0))
    above = tol / 5  # and the rest below, where it costs more
    n_certify = int(1.6 / above)
    best = None
    for steps in _LOCATE:
        located = cones.critical_scale(profile, steps)
        if located.status is not Status.OK:
            return located
        beyond = located.value * (1 + _BEYOND / steps) * short
        longest_lived, _ = cones.longest_lived(beyond, 2 * steps)
        best = _most_robust(_candidates(beyond, longest_lived), short, best)
        if best is None:
            continue
        upper = best.value * (1 + above)
        if cones.eliminates(upper * short, n_certify):
            lower = continuation.certified_scale(best.omega, short, best.value, tol - above)
            omega = _per_period(best.omega, profile, short, zero)
            return CriticalScale(best.value, best.error, lower, upper, omega, Status.OK)
    return CriticalScale(np.nan, np.nan, np.nan, located.upper, None, Status.UNDECIDED)


def verdict(kappa):
    """Does a barrier exist under the forcing kappa, or is transport global?

    1. The boundary on the ray through kappa, the finer the nearer it turns out to be.
    2. Below it, the circle under kappa itself, certified, while converse KAM leaves a survivor.
    3. Above it, converse KAM under kappa itself, with as many steps as the distance asks for.

    Parameters
    ----------
    kappa : sequence of P floats with a dominant symmetry line; see `nasm.cones`.

    Returns
    -------
    Verdict. UNDECIDED closer to the boundary than some 1.5·10⁻⁵ below and 4·10⁻⁶ above, in parts of
    kappa, or where the methods fail or contradict each other; its boundary then holds the bracket.

    ValueError if kappa is not finite, too large, or has no dominant symmetry line.
    """
    kappa = forcing(kappa)
    size = float(np.abs(kappa).max())
    if size == 0:
        return Verdict(Answer.BARRIER, Evidence.INTEGRABLE, no_answer(None, Status.NO_BREAKUP))
    (short,), zero = shorten([kappa], rational(0))
    answer, evidence, circle, steps = Answer.UNDECIDED, Evidence.NONE, None, inf
    for tol in _TOLERANCES:
        boundary = _in_units_of(size, critical_scale(short / size, tol))
        if abs(boundary.value - 1) < tol / 5 and tol > _TOLERANCES[-1]:
            continue  # look closer before deciding
        end = boundary.value if np.isfinite(boundary.value) else boundary.upper
        if end < 1:
            steps = _elimination(short, 1 / end - 1) * short.size / kappa.size
            if steps < inf:
                answer, evidence = Answer.TRANSPORT, Evidence.CONES
                break
        elif end > 1:
            found = _circle_under(short, boundary)
            if found is not None:
                answer, evidence = Answer.BARRIER, Evidence.CIRCLE
                boundary = replace(boundary, omega=found.omega)
                x, y = circles.graph(found)
                circle = x, y - float(zero) / short.size  # as `alternate` moves it
                break
    else:
        if boundary.lower >= 1 and not cones.eliminates(short, _LOCATE):
            answer, evidence = Answer.BARRIER, Evidence.CIRCLE_BEYOND
    if boundary.omega is not None:
        boundary = replace(boundary, omega=_per_period(boundary.omega, kappa, short, zero))
    return Verdict(answer, evidence, boundary, circle, steps)


def _in_units_of(size, scale):
    """The scale of a profile as one of size·profile."""
    lengths = ("value", "error", "lower", "upper")
    return replace(scale, **{name: float(getattr(scale, name)) / size for name in lengths})


def _elimination(kappa, distance):
    """Steps until no start survives, that far above the boundary; inf if some do."""
    n_max = min(max(1.6 / distance, _LOCATE), _MOST_STEPS)
    return cones.longest_lived(kappa, int(n_max))[1]


def _circle_under(kappa, boundary):
    """A certified circle under kappa, below the boundary; None if there is none to show.

    None too if converse KAM contradicts it.
    """
    if cones.eliminates(kappa, _LOCATE):
        return None
    omega, distance = boundary.omega, 1 - 1 / boundary.value
    if _NEAREST <= distance < _TOLERANCES[0]:
        scale, u = continuation.certified_circle(omega, kappa, boundary.value, distance)
        if not scale > 1 - 1e-12:  # not certified here, only further in
            return None
        error = np.abs(circles.residual(omega, kappa, u)).max()
        return circles.InvariantCircle(omega, kappa, u, error, Status.OK)
    omegas = [omega]
    if omega is None:  # as next to a cusp, where residues give no value
        beyond = boundary.upper * kappa
        omegas = _candidates(beyond, cones.longest_lived(beyond, 2 * _LOCATE)[0])
    found = (circles.invariant_circle(omega, kappa, _MOST_POINTS) for omega in omegas)
    return next((circle for circle in found if circle.certified), None)


def _candidates(kappa, y):
    """Nobles near the rotation number of the orbit that starts in y on the dominant line."""
    site, a = periodic.dominant_centre(kappa)
    omega, _ = rotation_number(np.roll(kappa, -site), a, y, _AVERAGED)
    return nobles_near(float(omega), _NEAR, _CANDIDATES) if np.isfinite(omega) else []


def _most_robust(omegas, profile, best):
    """The CriticalScale of the circle that breaks last, `best` among them; None if there is none.

    Of two that residues cannot tell apart it is the one with the shorter prefix.
    """
    for omega in omegas:
        scale = periodic.critical_scale(omega, profile)
        if scale.status is Status.OK and (
            best is None or scale.value - best.value > scale.error + best.error
        ):
            best = scale
    return best


def _per_period(omega, profile, short, zero):
    """ω of the short forcing as one per period of the long one, in [0, P/2].

    ω = 0 of the long one is `zero` for the short one.
    """
    period, ratio = profile.size, profile.size // short.size
    (*_, shift) = convergents(zero)
    omega = moebius(
        omega, ratio * shift.denominator, -ratio * shift.numerator, 0, shift.denominator
    )
    omega = moebius(omega, 1, -period * floor(float(omega) / period))
    return omega if float(omega) <= period / 2 else moebius(omega, -1, period)
