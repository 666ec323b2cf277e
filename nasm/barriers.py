"""The last barrier on a ray κ = s·profile: which circle breaks last, where, and how sure that is.

The boundary of global transport CB_gt is the envelope of the boundaries CB_ω over all ω: at each
angle another circle may be the last one. It is found and bracketed in four steps.

1. Locate. Converse KAM finds a scale without circles, and the start that is longest-lived there: it
   is next to the remains of the last circle.
2. Identify. With one kick or two its orbit names the candidates: the weighted Birkhoff average is a
   rotation number to six digits or so, and the nobles compatible with it are tested, shortest
   first. With three kicks or more the Farey tree is searched instead (`nasm.farey`): downwards from
   the scale of step 1 for the first circle that exists, and then for those that exist above its
   breakup.
3. Value. Greene's residue determines where each candidate breaks; the last one is the barrier. If
   residues do not cross, the value is found by bisection between a scale at which they decay and
   one at which they grow.
4. Certify. Below the value an invariant circle of that ω, certified by Newton's method on a finer
   grid: `lower`. Above it, the tree shows no circle, and converse KAM on two unrelated grids finds
   no start that survives: `upper`. A survivor between them is on another barrier: back to step 2.

Each step uses another method, and checks the one before. If they disagree in the end there is no
value, only the bracket of those that agree.

Converse KAM takes its starts from the dominant symmetry line of one or two kicks
(`converse_kam.symmetry_line`), or else from a curve that every circle crosses
(`converse_kam.transversal`). The other steps need no symmetry.
"""

from dataclasses import replace
from functools import cache
from itertools import islice
from math import floor

import numpy as np
from numpy.typing import ArrayLike

from nasm import action, circles, periodic
from nasm.checks import floats, real
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line, transversal
from nasm.converse_kam.symmetry_line import LongestLived, has_dominant_line
from nasm.critical import CriticalScale, Status, no_answer
from nasm.farey import circle_exists, find_existing_circle
from nasm.maps import direction, forcing, segment, unkick
from nasm.numbers import (
    RotationNumber,
    as_rotation_number,
    convergents,
    moebius,
    nobles_near,
    rational,
)
from nasm.orbits import rotation_number
from nasm.symmetries import dominant_centre, equivalent_forcings, half_shift_nobles, ray, shorten
from nasm.types import FloatArray, OmegaLike

__all__ = [
    "boundary",
    "critical_scale",
    "degenerate_partner",
    "eliminates",
    "last_circle",
    "longest_lived",
    "longest_lived_start",
]

_LOCATE = 1000  # steps of converse KAM in step 1 on a line,
_LOCATE_ANYWHERE = 100  # and on transversals
_WIDE = 2  # times tol: a bracket that a caller must be told of
_CLIMB = 0.01  # of the scale, where a search for survivors was wrong: the next that is tried
_BEYOND = 0.5  # over the steps: where, past the breakup, the longest-lived start is asked for its ω
_STEP = 0.2  # over the longest period that was asked: the next scale below one without circles,
_LARGEST_STEP = 0.03  # but no further away
_ASKED = 24  # scales at which circles are looked for above the leader
_NEXT = 2e-4  # of the value: so near above it the tree is asked however wide the bracket may be
_BANDS = 6e-4  # of the value: error where circles break and come back. Under 38 such forcings some
# came back in bands too narrow to be met, under three 3 to 6·10⁻⁴ above, under one 3·10⁻³.
_ROUGH = 0.01  # of the value: a bracket above it that is wider says that the last circle is unknown
_NEAR = 2e-5  # of the measured rotation number; neighbours that robust are further apart
_AVERAGED = 1000  # steps
_CANDIDATES = 3
_TOO_LONG = 3000  # period of the orbits whose residues tell if a circle stands
_LONGER_ORBITS = 10_000  # the same where a search has found no survivor
_HALVED = 1e-4  # of the scale: between what is said to stand and what is not
_HULL, _GRID, _FINEST = 20_000, 16_384, 65_536  # period of orbits, points, of circles from them
_BELOW = 1, 1.6, 2.5, 4, 10, 30  # times that: where circles are certified if not there
_CERTIFIED = 3  # circles of the tree that are tried there
_OUTSET = 0.93  # of a scale without circles: where the first candidates are to stand
_BLURRED = 300  # period that sees a cusp, from which orbits up to 6000 may leave large errors
_LONG = 30_000  # period of the orbits then
_ROUGHLY = 1.5e-4  # precision from which orbits half as long as usual give the digits
_SIMPLER = 2e-4  # of ω: a noble with a short prefix that is tried for one with a long
_FIRST, _AT_ONCE = 1500, 3e-7  # period of orbits, and error over the scale, that need no halving


def critical_scale(
    profile: ArrayLike, tol: float = 1e-4, start: ArrayLike | None = None
) -> CriticalScale:
    """Compute the scale at which the last rotational circle breaks on κ = start + s·profile.

    Parameters
    ----------
    profile : array_like, shape (P,)
        Direction of the segment, not zero; P ≤ 64 unless it repeats after one or two kicks.
    tol : float
        Width of the bracket to aim at, (upper - lower)/value, 10⁻⁵ to 10⁻¹.
    start : array_like, shape (P,), optional
        Start of the segment; default 0, a ray from the origin. From another start the result is the
        first breakup, s ≥ 0; regions without circles are skipped if they are narrower than a change
        of 0.1 of the largest strength.

    Returns
    -------
    CriticalScale
        value, error : by Greene's residue.
        lower : a circle is certified there, that of omega or another one; NaN without one.
        upper : no start on the dominant line, or on a transversal, survives there.
        omega : rotation number of the last barrier per period, in [0, P/2]. It represents ±ω and
        all ω + P·n, whose circles break together; of two partners by `degenerate_partner` it is
        the one with the shorter text.
        status : WIDE, with a value, if the bracket is more than twice as wide as tol, for example
        because no circle is certified close to the breakup. UNDECIDED, without a value, if the
        methods contradict each other; NEAR_CUSP instead if a shorter forcing is so close that
        periods up to 300 do not resolve it. lower and upper are then what was shown. From another
        start OUTSIDE if no barrier exists there, and NO_BREAKUP if one still exists where some
        strength has changed by 4.

    Raises
    ------
    ValueError
        If profile is zero, tiny or too long, start differs from it in length, or tol is out of
        range.

    Notes
    -----
    The error is at least upper - value if a later circle may have been missed, next to a cusp or
    with survivors above the value. If residues have no limit, the value is between scales at which
    they decay and grow; circles may exist again above it in narrow bands, and the error is at least
    6·10⁻⁴ of the value.

    Examples
    --------
    >>> from nasm.barriers import critical_scale
    >>> scale = critical_scale((1.0, 0.5), tol=1e-2)
    >>> scale.lower < scale.value < scale.upper
    True
    >>> scale.omega, round(scale.value, 6)
    (parse("[0;1,2,(1)]"), 0.579228)
    """
    start, profile = segment(start, profile)
    tol = real("tol", tol, 1e-5, 0.1)
    # On κ1 = κ2 the barriers are noble for the standard map, not for its second iterate.
    (begin, short), zero = shorten([start, profile], rational(0))
    scale = _last(begin, short, tol)
    if scale.omega is None:
        return scale
    if scale.upper - scale.lower > _WIDE * tol * scale.value:
        scale = replace(scale, status=Status.WIDE)
    kappa = start + scale.value * profile
    return replace(scale, omega=per_period(scale.omega, kappa, short, zero))


def _last(start, short, tol):
    """The CriticalScale of the last circle, omega per period of `short`."""
    above = tol / 5  # and the rest below, where it costs more
    upper, names = _located(start, short)
    if not 0 < upper < np.inf:
        status = Status.NO_BREAKUP if upper else Status.OUTSIDE
        return no_answer(None, status, "converse KAM")
    race = _Race(start, short, above, upper)
    # With one kick or two boundaries have one sheet, and survivors are next to the last circle.
    few = short.size <= 2
    if few:
        race.enter(names, _OUTSET * upper)
    if race.leader is None:
        race.descend()
    # Of lives: from a start the forcing changes less than the scale.
    part = upper * np.abs(short).max() / np.abs(race.at(upper)).max()
    n_certify = min(int(1.6 / above / min(max(part, 0.1), 1)), transversal.MAX_STEPS)
    n_longer = min(16 * n_certify, transversal.MAX_STEPS)
    share = above
    for _ in range(_ASKED if race.leader else 0):
        best = race.leader
        scale, n_steps = best.value * (1 + share), n_certify
        if scale > race.upper:
            if few or share > above:
                break
            # The nearer to a circle, the longer a start lives.
            scale, n_steps = (best.value + race.upper) / 2, n_longer
        omega, names, _ = (None, [], 0) if few else race.standing(scale)
        if not few and omega is None and share > _NEXT:
            omega = race.standing(nearer := best.value * (1 + _NEXT))[0]
            scale = nearer if omega else scale
        survives = omega is not None
        if survives:
            race.enter([omega], scale)
        else:
            found = longest_lived(race.at(scale), n_steps)
            survives = found.kicks == np.inf
            if not survives:
                race.eliminated.append(scale)
            near = candidates(race.at(scale), found, n_steps if survives else _AVERAGED)
            new = (name for name in [*names, *near] if name not in race.seen)
            race.enter(new, scale if survives else best.value)
            survives = scale not in race.eliminated  # it may have been known better
        if race.leader is not best:
            share = above
            continue
        if not survives:
            break
        share *= 2
    race.refine()
    return _bracketed(race, tol)


def _bracketed(race, tol):
    """The CriticalScale of the leader, with what is shown of it, or of those that follow it."""
    best, lower = race.leader, np.nan
    # Residues know better than a search that has missed what survives.
    above = (scale for scale in race.eliminated if best is None or scale > best.value)
    upper = min(above, default=race.upper)
    for contender in race.known[:2]:
        beyond = (upper - contender.value) / contender.value
        below = 0.8 * tol if beyond < 0.201 * tol else max(0.999 * (tol - beyond), 0.5 * tol)
        given = contender.omega, race.short, contender.value, below, race.start
        found, _ = continuation.certified_circle(*given)
        lower = np.fmax(lower, found if found < upper else np.nan)
        if lower > (1 - tol) * upper:
            break
    enough = (1 - tol) * upper
    stood = [(scale, omega) for scale, omega in race.stood if enough < scale < upper]
    for scale, omega in sorted(stood, key=lambda seen: -seen[0])[:_CERTIFIED]:
        if not lower >= enough and _is_certified(omega, race.at(scale)):
            lower = scale
            if best and scale >= best.value:
                value, error = (scale + upper) / 2, (upper - scale) / 2
                best = replace(best, omega=omega, value=value, error=error)
    end = best.value if best else upper
    nearest = min((1 - 0.95 * tol) * upper, end * (1 - 0.4 * tol))
    for scale in nearest, *(end * (1 - 0.8 * tol * np.array(_BELOW))):
        if lower >= min(scale, enough) or scale <= 0:
            break
        if scale > nearest:
            continue
        if _certified_at(scale, race):
            lower = scale
            break
        nearest = (1 - 0.3 * tol) * scale
    if best is None and not race.start.any() and has_dominant_line(race.short):
        upper = np.fmin(upper, symmetry_line.critical_scale(race.short, 16 * _LOCATE).upper)
    if best is None or upper - best.value > _ROUGH * best.value:
        status = Status.NEAR_CUSP if Status.NEAR_CUSP in race.told else Status.UNDECIDED
        return CriticalScale(np.nan, np.nan, lower, upper, None, status, "converse KAM")
    error = max(best.error, *(rival.value + rival.error - best.value for rival in race.known))
    far = upper > best.value * (1 + 0.3 * tol)
    if race.halved(best) or far or periodic.cusp_period(race.at(best.value)) > _BLURRED:
        # Circles follow each other so closely that a later one may have been missed; but not above
        # the bracket, which may know better than the residues do.
        error = np.fmax(error, upper - best.value)
    if race.halved(best):  # residues that pass through 0 may be taken for those of a circle
        error = np.fmax(error, best.value - lower)
    error = np.fmin(error, max(best.value - lower, upper - best.value))  # NaN: no bracket
    if race.halved(best):
        error = max(error, _BANDS * best.value)
    return replace(best, error=error, lower=lower, upper=upper)


def _certified_at(scale, race):
    """Whether a circle is certified at a scale: of those that break last, or of the tree."""
    kappa = race.at(scale)
    known = list(dict.fromkeys(known.omega for known in race.known))
    standing_there = list(islice((omega for omega in known if race.stands(omega, scale)), 2))
    if any(_is_certified(omega, kappa) for omega in standing_there):
        return True
    _, nobles, _ = race.standing(scale)
    others = (omega for omega in nobles if omega not in known and race.stands(omega, scale))
    return any(_is_certified(omega, kappa) for omega in islice(others, _CERTIFIED))


def _is_certified(omega, kappa):
    """Whether the circle of ω is certified under a forcing, from the sites of a long orbit there,
    one of them held: no circle has to exist under weaker kicks."""
    fractions = [f for f in islice(convergents(omega), 60) if f.denominator < _HULL]
    ladder = action.ConvergentOrbits(kappa, 0 * kappa, fractions)
    try:
        first, u = ladder.constrained_minimizer(len(fractions) - 1, 0.0)
    except action.LostError:
        return False
    # Deviations at each site of a period, by the phase at its start, with a mean of 0 at the first.
    p, n_sites, site = fractions[-1].numerator, u.size, np.arange(kappa.size)[:, None]
    hits = (np.arange(0, n_sites, kappa.size) + (site - first) % kappa.size) % n_sites
    u = u[hits]
    mean = u[0].mean()
    phase = (ladder.chains[-1].theta[hits] - site * p / n_sites + mean) % 1
    order = np.argsort(phase, axis=1)
    modes = np.fft.rfft(np.take_along_axis(u - mean, order, 1))[:, : _GRID // 3] / u.shape[1]
    modes = modes * np.exp(-2j * np.pi * phase.min(axis=1)[:, None] * np.arange(modes.shape[1]))
    start = np.fft.irfft(modes, _GRID) * _GRID
    return circles.invariant_circle(omega, kappa, _FINEST, start).certified


def _located(start, profile):
    """A scale without circles, and nobles near ω of the start that lives longest there, or just
    above."""
    if not start.any() and has_dominant_line(profile):
        located = symmetry_line.critical_scale(profile, _LOCATE)
        if located.status is Status.OK:
            beyond = located.value * (1 + _BEYOND / _LOCATE) * profile
            # Lives end there at 1.2 to 1.5 steps: any larger number than 2 finds the same start.
            return located.upper, candidates(beyond, longest_lived(beyond, 2 * _LOCATE))
    # From zero the tree goes on from any scale without circles: two transversals are enough.
    n_sites = 8 if profile.size <= 2 or start.any() else 2
    upper, found = transversal.upper_scale(profile, _LOCATE_ANYWHERE, start, n_sites)
    return upper, candidates(start + upper * profile, found) if found else []


class _Race:
    """Circles on a segment, by the scales at which residues say that they break.

    eliminated : list of float, scales at which no start was found to survive. stands : function of
    a circle and a scale. stood : list of the scales and the circles of which it said yes.
    """

    def __init__(self, start, short, precision, upper):
        self.start, self.short, self.precision = start, short, precision
        self.eliminated = [upper]
        self.leader, self.known, self.told, self.seen = None, [], set(), set()
        self.stands, self.stood = cache(self._stands), []
        self.standing = cache(lambda scale: find_existing_circle(self.at(scale)))

    def _stands(self, omega, scale, *longest):
        if stands := circle_exists(omega, self.at(scale), *longest):
            self.stood.append((scale, omega))
        return stands

    def at(self, scale):
        """The forcing there."""
        return self.start + scale * self.short

    @property
    def upper(self):
        """The lowest scale known without circles."""
        return min(self.eliminated)

    def blurred(self, scale):
        """Whether a cusp is so near that the orbits which are asked do not see it."""
        if not periodic.cusp_period(self.at(scale)) > _TOO_LONG:
            return False
        self.told.add(Status.NEAR_CUSP)
        return True

    def enter(self, names, reached):
        """Let circles take the lead that stand at a scale and break later than the leader, but not
        above a scale without circles. Next to a cusp that orbits do not see none does. A circle
        that is known to break below may come back: with three kicks boundaries have sheets."""
        if self.short.size > 2 and self.blurred(reached):
            return
        for omega in names:
            if self.leader:
                reached = max(reached, self.leader.value)
            if not self.stands(omega, reached):
                continue
            self.seen.add(omega)
            scale = no_answer(omega, Status.UNDECIDED)
            if self.short.size <= 2:
                scale = self.by_residues(omega)
            plausible = reached - scale.error <= scale.value <= self.upper + scale.error
            if scale.status is not Status.NEAR_CUSP and not plausible:
                scale = self.by_halving(omega, reached)
            if scale.status is Status.OK:
                self.known = sorted([*self.known, scale], key=lambda known: -known.value)
                self.leader = _most_robust([scale], self.leader)

    def descend(self):
        """Enter the first circle that stands below what is eliminated, and above the leader, in
        steps of what the periods that were asked can tell. First that is tried which the tree was
        longest to rule out: mostly it is the last one."""
        scale = self.upper
        if self.short.size > 2 and self.blurred(scale):
            return
        while True:
            omega, names, period = self.standing(scale)
            if omega:
                self.enter([omega], scale)
                return
            if scale == self.upper and self.short.size > 2:
                omega = _nobles(self.at(scale), float(names[0]), _SIMPLER, 1)[0]
                if found := self.at_once(omega, _OUTSET * scale, scale):
                    self.leader, self.known = found, [found]
                    return
            scale *= 1 - min(max(_STEP / period, self.precision), _LARGEST_STEP)
            if scale < 0.1 * self.upper or (self.leader and scale < self.leader.value):
                return

    def by_residues(self, omega, between=None, q_max=6000):
        """The CriticalScale of one circle by the crossings of its residues; by longer orbits if a
        cusp is near and blurs the others."""
        scale = periodic.critical_scale(omega, self.short, q_max, self.start, between)
        precise = scale.error <= self.precision * scale.value  # NaN is not
        cusp = periodic.cusp_period(self.at(self.upper))
        if not precise and cusp > _BLURRED and self.short.size <= 2:
            longer = periodic.critical_scale(omega, self.short, _LONG, self.start, between)
            scale = longer if longer.status is Status.OK else scale
        self.told.add(scale.status)
        return scale

    def by_halving(self, omega, below):
        """The CriticalScale of a circle that stands below. A scale at which it stands too is none
        without circles: searches for survivors are samples, and residues know better."""
        if self.blurred(below):
            return no_answer(omega, Status.NEAR_CUSP)
        while self.stands(omega, self.upper, _LONGER_ORBITS):
            if len(self.eliminated) == 1 and not self.climbed(omega):
                return no_answer(omega, Status.UNDECIDED)
            self.eliminated.remove(self.upper)
        above = self.upper
        if not any(map(self.halved, self.known)) and (found := self.at_once(omega, below, above)):
            return found
        while above - below > _HALVED * above:
            middle = (below + above) / 2
            below, above = (middle, above) if self.stands(omega, middle) else (below, middle)
        value, method = (below + above) / 2, "Greene's residue"
        return CriticalScale(value, above - below, np.nan, np.nan, omega, Status.OK, method)

    def climbed(self, omega):
        """Find another scale without circles, above one where a circle is certified; whether it
        is."""
        scale = self.upper
        if not _is_certified(omega, self.at(scale)):
            return False
        while len(self.eliminated) == 1:
            scale += _CLIMB * np.abs(self.at(scale)).max() / np.abs(self.short).max()
            if longest_lived(self.at(scale), _LOCATE_ANYWHERE).kicks < np.inf:
                self.eliminated.append(scale)
        return True

    def halved(self, scale):
        """Whether a circle's breakup is known by halving only."""
        return scale.error > _HALVED / 2 * scale.value

    def at_once(self, omega, below, above):
        """The CriticalScale of a circle between two scales, if short orbits tell it; else None."""
        found = self.by_residues(omega, (below, above), _FIRST)
        if found.status is not Status.OK or not found.error < _AT_ONCE * found.value:
            return None
        near = _HALVED / 2 * found.value
        if not self.stands(omega, found.value - near) or self.stands(omega, found.value + near):
            return None
        return self.precise(found, near)

    def precise(self, known, far):
        """The same by longer orbits, if they agree to within `far`."""
        between = known.value - far, known.value + far
        for longest in (3000, 6000)[self.precision < _ROUGHLY :]:
            scale = self.by_residues(known.omega, between, longest)
            if abs(scale.value - known.value) < far:
                return scale
        return known

    def refine(self):
        """Ask residues for the digits of the leader, and of those that may break as late. Where
        they tell none of one, its error is left, and they are not asked of the others."""
        for i, known in enumerate(self.known):
            if self.halved(known) and known.value + known.error > self.leader.value:
                self.known[i] = self.precise(known, 2 * known.error)
                if self.known[i] is known:
                    break
        if self.known:
            shortest = sorted(self.known, key=lambda known: len(known.omega.prefix))
            self.leader = _most_robust(shortest, None)


def longest_lived(kappa: ArrayLike, n_max: int) -> LongestLived:
    """Find the start that converse KAM takes longest to eliminate.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    n_max : int
        Most steps (periods of the forcing).

    Returns
    -------
    LongestLived
        Its kicks are inf if starts survive n_max steps on every line or transversal.

    Examples
    --------
    >>> from nasm.barriers import longest_lived
    >>> longest_lived((1.2, 0.9), 1000).kicks < 1000
    True
    """
    kappa = forcing(kappa)
    if has_dominant_line(kappa):
        y, steps = symmetry_line.longest_lived(kappa, n_max)
        site, x = dominant_centre(kappa)
        return LongestLived(int(site), x, y, steps * kappa.size)
    return transversal.longest_lived(kappa, n_max)


def longest_lived_start(kappa: ArrayLike, n_max: int) -> tuple[float, float, float]:
    """Find the start by `longest_lived`, and move it to the start of its period.

    Beyond the breakup it is close to the remains of the last circle.

    Returns
    -------
    x, y : float
        The start.
    steps : float
        Steps until it is eliminated; inf if a start survives n_max steps, and it is one of those.

    Examples
    --------
    >>> from nasm.barriers import longest_lived_start
    >>> x, y, steps = longest_lived_start((1.2, 0.9), 1000)
    >>> x, steps < 1000
    (0.5, True)
    """
    strengths = forcing(kappa)
    longest = longest_lived(strengths, n_max)
    x, y = longest.x, longest.y
    for strength in strengths[: longest.site][::-1]:
        x, y = unkick(strength, x, y)
    return float(x), float(y), float(longest.kicks / strengths.size)


def eliminates(kappa: ArrayLike, n_max: int) -> bool:
    """Return True if converse KAM eliminates all starts within n_max steps.

    The starts are on the dominant line, or without one on a transversal. That is strong evidence,
    not a proof, that no circle exists.

    Examples
    --------
    >>> from nasm.barriers import eliminates
    >>> eliminates((1.2, 0.9), 1000), eliminates((0.3, 0.4), 1000)
    (True, False)
    """
    return bool(np.isfinite(longest_lived(forcing(kappa), n_max).kicks))


def last_circle(scale: CriticalScale, profile: ArrayLike) -> circles.InvariantCircle:
    """Compute the last circle on the ray, as it is at `scale.lower`, just before it breaks.

    It has 10⁵ points or so if `scale` is precise to 10⁻⁴: so close to the breakup
    `circles.invariant_circle` runs out of modes. This one is computed by
    `circles.continuation.certified_circle`, from circles farther from the breakup.

    Parameters
    ----------
    scale : CriticalScale
        With omega, value and lower, e.g. by `critical_scale`.
    profile : array_like, shape (P,)
        The ray of that scale.

    Returns
    -------
    InvariantCircle
        Of scale.omega under the forcing scale.lower·profile; its graph is `circles.graph`. Status
        NOT_CERTIFIED, and no deviations, if it is not certified again.

    Raises
    ------
    ValueError
        If scale has no lower end, or no value.

    Examples
    --------
    >>> from nasm.barriers import critical_scale, last_circle
    >>> profile = (1.0, 0.5)
    >>> last_circle(critical_scale(profile, tol=1e-2), profile).certified
    True
    """
    profile = direction(profile)
    if scale.omega is None or not 0 < scale.lower < scale.value:
        raise ValueError(
            f"lower={scale.lower!r} of value={scale.value!r}: no circle was certified on this ray; "
            "ask for a wider bracket, e.g. critical_scale(profile, tol=1e-3)"
        )
    omega, distance = scale.omega, 1 - scale.lower / scale.value
    reached, u = continuation.certified_circle(omega, profile, scale.value, distance)
    if u is None:
        u, status = np.empty((profile.size, 0)), Status.NOT_CERTIFIED
        return circles.InvariantCircle(omega, scale.lower * profile, u, np.nan, status)
    error = np.abs(circles.residual(omega, reached * profile, u)).max()
    return circles.InvariantCircle(omega, reached * profile, u, error, Status.OK)


def candidates(kappa: FloatArray, start: LongestLived, n: int = _AVERAGED) -> list[RotationNumber]:
    """Return the nobles close to the rotation number of an orbit, averaged over n steps.

    Parameters
    ----------
    kappa : ndarray, shape (P,)
        The forcing.
    start : LongestLived
        Start of the orbit.
    n : int
        Steps.

    Returns
    -------
    list of RotationNumber
        Empty if the average has not converged.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.barriers import candidates, longest_lived
    >>> kappa = np.array([0.972])
    >>> candidates(kappa, longest_lived(kappa, 100_000))[0]
    parse("[0;2,(1)]")
    """
    omega, _ = rotation_number(np.roll(kappa, -start.site), start.x, start.y, n)
    return _nobles(kappa, float(omega), _NEAR, _CANDIDATES) if np.isfinite(omega) else []


def _nobles(kappa, *near):
    return half_shift_nobles(kappa, *near) + nobles_near(*near)


def _most_robust(scales, best):
    """The CriticalScale of the circle that breaks last, `best` among them, or None; of two that
    residues cannot tell apart the first."""
    for scale in scales:
        if scale.status is Status.OK and (
            best is None or scale.value - best.value > scale.error + best.error
        ):
            best = scale
    return best


def per_period(
    omega: RotationNumber, profile: FloatArray, short: FloatArray, zero: RotationNumber
) -> RotationNumber:
    """Convert ω of a shortened forcing to one per period of the long forcing, in [0, P/2].

    Parameters
    ----------
    omega : RotationNumber
        Per period of `short`.
    profile, short : ndarrays, shapes (P,) and (P',)
        The forcing, and its shorter form by `symmetries.shorten`.
    zero : RotationNumber
        ω under `short` of what is ω = 0 under `profile`.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.barriers import per_period
    >>> from nasm.numbers import parse, rational
    >>> per_period(parse("gamma"), np.ones(2), np.ones(1), rational(0))
    parse("[0;1,3,(4)]")
    """
    period, ratio = profile.size, profile.size // short.size
    (*_, shift) = convergents(zero)
    omega = moebius(
        omega, ratio * shift.denominator, -ratio * shift.numerator, 0, shift.denominator
    )
    omega = moebius(omega, 1, -period * floor(float(omega) / period))
    omega = omega if float(omega) <= period / 2 else moebius(omega, -1, period)
    return min(
        omega, degenerate_partner(omega, profile) or omega, key=lambda ω: len(ω.prefix + ω.tail)
    )


def degenerate_partner(omega: OmegaLike, profile: ArrayLike) -> RotationNumber | None:
    """Return P/2 - ω if its circle breaks together with that of ω; otherwise None.

    y → y + 1/2 changes the sign of every other kick (`symmetries.alternate`) and takes ω to ω +
    P/2. The two circles break together if another symmetry restores the signs: a shift in time,
    time reversal or x → x + 1/2. This is the case if every other kick is zero, or under
    (1, 1, -1, -1). So γ and 1 - γ break together on the axes of the (κ1, κ2) plane, where the paper
    writes γ.

    Examples
    --------
    >>> from nasm.barriers import degenerate_partner
    >>> degenerate_partner("gamma", (1, 0))
    parse("[0;2,(1)]")
    >>> degenerate_partner("gamma", (1, 0.5)) is None
    True
    """
    profile, omega = forcing(profile, "profile"), as_rotation_number(omega)
    equivalent = equivalent_forcings(profile[None])
    same = (turn for turn, (kappa,) in equivalent if np.array_equal(kappa, profile))
    return moebius(omega, -1, profile.size // 2) if any(same) else None


def boundary(angles: ArrayLike, tol: float = 1e-4) -> list[CriticalScale]:
    """Compute the boundary of global transport of two kicks, ray by ray.

    Parameters
    ----------
    angles : float or sequence of floats
        Degrees; (κ1, κ2) = s·(cos angle, sin angle).
    tol : float
        As for `critical_scale`: 0.25 s of CPU time a ray at 10⁻⁴, 0.8 s at 2·10⁻⁵.

    Returns
    -------
    list of CriticalScale
        One for each angle.

    Examples
    --------
    >>> from nasm.barriers import boundary
    >>> [round(scale.value, 5) for scale in boundary([0, 30], tol=1e-2)]
    [0.48582, 0.70018]
    """
    degrees = np.atleast_1d(floats("angles", angles))
    if degrees.ndim > 1 or not np.isfinite(degrees).all():
        raise ValueError(f"angles={angles!r} must be a list of finite numbers, in degrees")
    return [critical_scale(profile, tol) for profile in ray(degrees)]
