"""The last barrier on a ray κ = s·profile: which circle breaks last, where, and how sure that is.

The boundary of global transport CB_gt is the envelope of the boundaries CB_ω over all ω: at each
angle another circle may be the last one. It is found and bracketed in four steps.

1. Locate. Converse KAM gives the breakup to 10⁻³ or 10⁻⁴, and beyond it the start that lives
   longest: it is next to what is left of the last circle.
2. Identify. The weighted Birkhoff average of its orbit is a rotation number to six digits or so,
   and the nobles that agree with it, the shortest first, are the candidates.
3. Value. Greene's residue says where each candidate breaks; the last one is the barrier.
4. Certify. Below the value an invariant circle of that ω, certified by Newton's method on a finer
   grid: `lower`. Above it, converse KAM on two unrelated grids finds no start that survives:
   `upper`. A survivor is on another barrier: back to step 1, four times as near to the breakup.

Each step is another method, and checks the one before. If they do not agree in the end there is no
value, but the bracket of those that do.

Where the forcing has a dominant symmetry line, converse KAM takes its starts from it
(`converse_kam.symmetry_line`). A forcing without one has no symmetric orbits either. Converse KAM
then goes by `converse_kam.transversal`, the value is that of `circles.continuation`, which needs no
symmetry, and no orbit may escape at `lower`.
"""

from dataclasses import replace
from math import floor

import numpy as np

from nasm import circles, escape, periodic
from nasm.checks import real
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line, transversal
from nasm.critical import CriticalScale, Status, no_answer
from nasm.maps import MAX_PERIOD, direction, forcing, unkick
from nasm.numbers import checked, convergents, moebius, nobles_near, parse, rational
from nasm.orbits import rotation_number
from nasm.symmetries import ray, shorten

__all__ = [
    "boundary",
    "critical_scale",
    "eliminates",
    "last_circle",
    "longest_lived",
    "remnant",
    "tied",
]
__dir__ = __all__.copy

_LOCATE = (1000, 4000, 16_000, 64_000)  # steps of converse KAM in step 1, round by round
_LOCATE_ANYWHERE = (250, 1000, 4000)  # of converse KAM on transversals
_PRECISE = 1e-6  # of the scale: what continuation is asked for, in 0.1 s a circle
_WIDE = 2  # times tol: a bracket that a caller must be told of
_ROUGH = 0.05  # of the value: a larger error of continuation is no answer
_IN_DOUBT = (Status.NOT_CONVERGED, Status.UNDECIDED)
_BEYOND = 0.5  # over the steps: where, past the breakup, the longest-lived start is asked for its ω
_NEAR = 2e-5  # of the measured rotation number; neighbours that robust are further apart
_AVERAGED = 1000  # steps
_CANDIDATES = 3
_BLURRED = 300  # period that sees a cusp, from which orbits up to 6000 may leave large errors
_ORBITS, _ESCAPE_STEPS = 64, 10**5
_LONG = 30_000  # period of the orbits then


def critical_scale(profile, tol=1e-4):
    """The scale at which the last rotational invariant circle breaks on the ray κ = s·profile.

    Parameters
    ----------
    profile : sequence of P floats, not all 0.
    tol : float, 10⁻⁵ to 10⁻¹: the width of the bracket to aim at, (upper - lower)/value.

    Returns
    -------
    CriticalScale. value, error : by Greene's residue, error no larger than the bracket; next to a
    cusp, where a later circle may have been missed, no smaller than upper - value. Without a
    dominant line both are by continuation, and error is no smaller than that either. lower : a
    circle of ω is certified there; upper : no start on the dominant line, or on a transversal,
    survives there. omega : that of the last barrier, per period, in [0, P/2], which stands for ±ω
    and all ω + P·n: their circles break together. Of two that are `tied` it is the one with the
    shorter text.
    Status WIDE, with a value, where the bracket is more than twice as wide as asked for, as where
    continuation is not precise enough or no circle is certified so near to the breakup. Status
    UNDECIDED, and no value, where the methods contradict each other, and NEAR_CUSP instead where a
    shorter forcing is so near that periods up to 300 cannot tell them apart; lower and upper are
    then what was shown. lower is NaN where no circle could be certified.

    ValueError if profile is zero or tiny, or has more than 64 kicks and no dominant symmetry line,
    or tol is out of range.
    """
    profile = direction(profile)
    tol = real("tol", tol)
    if not 1e-5 <= tol <= 0.1:
        raise ValueError(f"tol={tol!r} must be from 1e-5 to 0.1")
    # On κ1 = κ2 the barriers are noble for the standard map, not for two steps of it.
    (short,), zero = shorten([profile], rational(0))
    found = _by_symmetry(short, tol) if has_dominant_line(short) else None
    if found is None or (found.status in _IN_DOUBT and 2 < short.size <= MAX_PERIOD):
        found = _by_continuation(short, tol)
    if found.omega is None:
        return found
    if found.upper - found.lower > _WIDE * tol * found.value:
        found = replace(found, status=Status.WIDE)
    return replace(found, omega=per_period(found.omega, profile, short, zero))


def _by_symmetry(short, tol):
    """The CriticalScale on a ray with a dominant symmetry line, omega per period of `short`."""
    above = tol / 5  # and the rest below, where it costs more
    n_certify = int(1.6 / above)
    best, told = None, set()
    for steps in _LOCATE:
        located = symmetry_line.critical_scale(short, steps)
        if located.status is not Status.OK:
            return located
        beyond = located.value * (1 + _BEYOND / steps) * short
        # Lives end there at 1.2 to 1.5 steps: any larger number than 2 finds the same start.
        near = candidates(*longest_lived(beyond, 2 * steps)[0])
        scales = [_breakup(omega, short, above) for omega in near]
        told.update(scale.status for scale in scales)
        best = _most_robust(scales, best)
        if best is None:
            continue
        upper = best.value * (1 + above)
        if symmetry_line.eliminates(upper * short, n_certify):
            lower = continuation.certified_scale(best.omega, short, best.value, tol - above)
            error = best.error
            if periodic.cusp_period(short) > _BLURRED:
                # Circles follow each other so closely there that a later one may have been missed;
                # but not above the bracket, which may know better than the residues do.
                error = np.fmax(error, upper - best.value)
            error = np.fmin(error, max(best.value - lower, upper - best.value))  # NaN: no bracket
            return replace(best, error=error, lower=lower, upper=upper)
    # Of a circle that residues say nothing of, they contradict nothing.
    status = Status.NEAR_CUSP if Status.NEAR_CUSP in told else Status.UNDECIDED
    return CriticalScale(np.nan, np.nan, np.nan, located.upper, None, status, located.method)


def _by_continuation(short, tol):
    """The CriticalScale on a ray without a dominant symmetry line, omega per period of `short`."""
    above = tol / 5
    best, certified, highest = None, np.nan, np.inf

    def eliminated(scale):
        return np.isfinite(transversal.longest_lived(scale * short, int(1.6 / above))[1])

    for steps in _LOCATE_ANYWHERE:
        highest, start, _ = transversal.located(short, steps)
        beyond = np.roll(highest * short, -start.site)
        near = candidates(beyond, start.x, start.y) or [noble_between(*start.between)]
        scales = [continuation.critical_scale(omega, short, _PRECISE * highest) for omega in near]
        certified = np.fmax(certified, np.fmax.reduce([scale.lower for scale in scales]))
        # Next to a forcing of a shorter period continuation is lost: it misses by half its value.
        known = [s for s in (best, *scales) if s and s.error < _ROUGH * s.value <= _ROUGH * highest]
        best = _most_robust(known, None)
        if best is None:
            continue
        nearest = min(best.value * (1 + above), highest)
        furthest = min(max(nearest, best.value + 2 * best.error), highest)
        upper = next((s for s in (nearest, furthest) if s == highest or eliminated(s)), None)
        if upper is None:
            continue
        lower = continuation.certified_scale(best.omega, short, best.value, tol - above)
        if lower >= highest or _escapes(np.fmin(lower, best.value * (1 - tol)) * short):
            return no_answer(None, Status.UNDECIDED, best.method)
        # A later circle may have been missed, but not above the bracket.
        error = np.fmax(best.error, upper - best.value)
        error = np.fmin(error, max(best.value - lower, upper - best.value))  # NaN: no bracket
        return replace(best, error=error, lower=lower, upper=upper)
    lower = certified if certified < highest else np.nan
    blurred = periodic.cusp_period(short) > _BLURRED
    status = Status.NEAR_CUSP if blurred else Status.UNDECIDED
    return CriticalScale(np.nan, np.nan, lower, highest, None, status, "converse KAM")


def _escapes(kappa):
    """Whether one of 64 orbits gets past where all circles would be, within 10⁵ steps: bool."""
    x, y = escape.ensemble(_ORBITS)
    return bool(np.isfinite(escape.first_escape([kappa], x, y, [_ORBITS], _ESCAPE_STEPS)).any())


def longest_lived(kappa, n_max):
    """The start that converse KAM is longest to eliminate: (kappa from its site on, x, y); and its
    life in steps, inf if on no line or transversal all starts are eliminated within n_max steps.
    """
    if has_dominant_line(kappa):
        place, steps = symmetry_line.longest_lived(kappa, n_max)
        if steps < np.inf or kappa.size <= 2:
            return symmetry_line.start(kappa, place), steps
    start, steps = transversal.longest_lived(kappa, n_max)
    return (np.roll(kappa, -start.site), start.x, start.y), steps


def remnant(kappa, n_max):
    """Where the last circle was: the start by `longest_lived`, moved to the start of its period.

    Returns x, y, steps: floats, steps inf if a start survives n_max steps, and it is one of those.
    """
    strengths = forcing(kappa)
    (rolled, x, y), steps = longest_lived(strengths, n_max)
    sites = range(strengths.size)  # the first of some, if the forcing repeats itself
    site = next(site for site in sites if (np.roll(strengths, -site) == rolled).all())
    for strength in strengths[:site][::-1]:
        x, y = unkick(strength, x, y)
    return float(x), float(y), float(steps)


def eliminates(kappa, n_max):
    """Whether converse KAM eliminates all starts within n_max steps, on the dominant line, or if
    there is none on a transversal: bool."""
    if has_dominant_line(kappa):
        return symmetry_line.eliminates(kappa, n_max)
    return bool(np.isfinite(transversal.longest_lived(kappa, n_max)[1]))


def has_dominant_line(kappa):
    """Whether the forcing has a centre, and lines that the minimax orbits of all ω are on: bool."""
    try:
        return all(dominant for *_, dominant in periodic.dominant_lines(kappa))
    except ValueError:
        return False


def last_circle(found, profile):
    """The last circle on the ray, as it is at `found.lower`, just before it breaks.

    `circles.graph` of it is its graph. It has 10⁵ points or so where `found` is precise to 10⁻⁴: so
    near to the breakup `circles.invariant_circle` is left with too few modes. This one comes by
    `circles.continuation.certified_circle`, from circles that were met further in.

    Parameters
    ----------
    found : CriticalScale with omega, value and lower, e.g. by `critical_scale`.
    profile : the ray that it was found on.

    Returns
    -------
    InvariantCircle of found.omega under the forcing found.lower·profile; status NOT_CERTIFIED, and
    no deviations, if it is not certified again.

    ValueError if found has no lower scale, or no value.
    """
    profile = direction(profile)
    if not 0 < found.lower < found.value:
        raise ValueError(
            f"lower={found.lower!r} of value={found.value!r}: no circle was certified on this ray; "
            "ask for a wider bracket, e.g. critical_scale(profile, tol=1e-3)"
        )
    omega, distance = found.omega, 1 - found.lower / found.value
    scale, u = continuation.certified_circle(omega, profile, found.value, distance)
    if u is None:
        u, status = np.empty((profile.size, 0)), Status.NOT_CERTIFIED
        return circles.InvariantCircle(omega, found.lower * profile, u, np.nan, status)
    error = np.abs(circles.residual(omega, scale * profile, u)).max()
    return circles.InvariantCircle(omega, scale * profile, u, error, Status.OK)


def candidates(kappa, x, y):
    """Nobles near the rotation number of the orbit that starts in (x, y), as far as it has one."""
    omega, _ = rotation_number(kappa, x, y, _AVERAGED)
    return nobles_near(float(omega), _NEAR, _CANDIDATES) if np.isfinite(omega) else []


def noble_between(one, other):
    """The noble next to two Farey neighbours, with golden steps from the first place on."""
    low, high = sorted((one, other), key=lambda omega: omega.denominator)
    return moebius(parse("gamma"), low.numerator, high.numerator, low.denominator, high.denominator)


def _breakup(omega, profile, precision):
    """The CriticalScale of one circle, by longer orbits if a cusp is near and blurs the others."""
    scale = periodic.critical_scale(omega, profile)
    if scale.error > precision * scale.value and periodic.cusp_period(profile) > _BLURRED:
        longer = periodic.critical_scale(omega, profile, _LONG)
        return longer if longer.status is Status.OK else scale
    return scale


def _most_robust(scales, best):
    """The CriticalScale of the circle that breaks last, `best` among them; None if there is none.

    Of two that residues cannot tell apart it is the one with the shorter prefix.
    """
    for scale in scales:
        if scale.status is Status.OK and (
            best is None or scale.value - best.value > scale.error + best.error
        ):
            best = scale
    return best


def per_period(omega, profile, short, zero):
    """ω of the short forcing as one per period of the long one, in [0, P/2].

    ω = 0 of the long one is `zero` for the short one.
    """
    period, ratio = profile.size, profile.size // short.size
    (*_, shift) = convergents(zero)
    omega = moebius(
        omega, ratio * shift.denominator, -ratio * shift.numerator, 0, shift.denominator
    )
    omega = moebius(omega, 1, -period * floor(float(omega) / period))
    omega = omega if float(omega) <= period / 2 else moebius(omega, -1, period)
    return min(omega, tied(omega, profile) or omega, key=lambda ω: len(ω.prefix + ω.tail))


def tied(omega, profile):
    """P/2 - ω, whose circle breaks together with that of ω if every other kick is zero; else None.

    y → y + 1/2 is then a symmetry (`symmetries.alternate`), which takes ω to ω + P/2. So γ and
    1 - γ break together on the axes of the (κ1, κ2) plane, where the paper writes γ.
    """
    profile, omega = np.asarray(profile), checked(omega)
    if profile.size % 2 or (profile[::2].any() and profile[1::2].any()):
        return None
    return moebius(omega, -1, profile.size // 2)


def boundary(angles, tol=1e-4):
    """The boundary of global transport of two kicks, ray by ray: a list of CriticalScale.

    Parameters
    ----------
    angles : sequence of floats, degrees; (κ1, κ2) = s·(cos angle, sin angle).
    tol : float, as for `critical_scale`: half a second of CPU time a ray at 10⁻⁴, 2 s at 2·10⁻⁵.
    """
    angles = np.ravel(np.asarray(angles, dtype=float))
    if not np.isfinite(angles).all():
        raise ValueError(f"angles={angles.tolist()} must be finite numbers, in degrees")
    return [critical_scale(profile, tol) for profile in ray(angles)]
