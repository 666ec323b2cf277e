"""The last barrier on a segment κ = start + s·profile: which circle breaks last, and where.

The *last breakup* on a ray from zero is the largest scale s at which a rotational circle exists.
With three kicks or more, circles may break and reappear in bands of scales, which may be
arbitrarily narrow close to the boundary. The search resolves bands down to relative widths of about
tol, or of 10⁻³ if tol is larger. If it finds bands, narrower ones may lie above the value;
therefore the relative error is then at least tol, or 2·10⁻³ if tol is larger, and upper is at least
value + error. On a segment that does not start at zero, the search looks for the first breakup.

The route of a search, with the functions of this module in parentheses:

- one or two kicks on a ray from zero: candidates near the longest-lived starts
  (`_search_by_survivors`);
- else, or if that fails: a scale without circles (`_outermost`), and from there inwards the Farey
  tree (`_search_by_tree`), unless two kicks are so close to a cusp that no orbit distinguishes them
  from it (`_beside_cusp`);
- then `upper`, by converse KAM (`_eliminated_above`); if it contradicts the value, the search is
  resumed above (`_confirmed_above`);
- last `lower`, by a certified circle (`_certified_below`).

The search of the tree proceeds from the outside inwards. It is a loop over two scales: no circle
was found at `outside`; a circle exists at `inside`, or `inside` is 0 and none is known yet.

1. *Ask.* Search the Farey tree (`nasm.farey`) at one scale for a circle that exists there. If the
   search finds none, it lists the nobles that it could not exclude (or, if it excluded all of them,
   the one that took longest to exclude), and the longest period used; the scale is then treated as
   having no circles. Short orbits are found from those at the scale asked before. The first scale
   is about 1% above the breakup, where converse KAM eliminates all starts in 100 steps (periods of
   the forcing).
2. *Leap.* Residues (`nasm.periodic`) determine the scale at which one circle breaks: the circle
   just found or, if none was found, the circle of the simplest noble near the first one listed. If
   the precision of this scale is sufficient, and residues show that the circle exists just below
   it, the tree is searched next at a slightly larger scale.
3. *Step.* Otherwise, lower the scale. Residues grow like s^q, so orbits of period q exclude circles
   not only at one scale, but over a relative distance of order 1/q. The step is a quarter of that,
   or half the distance to a scale with a circle. Whenever the period used has doubled, another leap
   is attempted.
4. *End.* If the tree shows a circle just above the breakup to which a leap led, this breakup is
   dropped, and the loop continues with that circle. If it shows none, this breakup is the last one,
   unless residues show that the circle of one of the listed nobles exists above it. The breakup of
   this rival then replaces it; if residues do not determine it precisely, the search ends with the
   narrow interval that remains. In bands, residues do not converge; the loop then ends when
   `outside` and `inside` are tol/2 apart, and the value is the midpoint between them.

With one or two kicks there are no bands, and a faster search is tried first. The start that
converse KAM takes longest to eliminate just beyond the breakup lies near the remains of the last
circle, and its weighted Birkhoff average yields the rotation number to six digits. The circles of
the nobles near that number are candidates; residues determine where they break, and converse KAM
shows that no start survives above these scales. If orbits do not resolve a cusp, only the bracket
is computed: the last circle of the cusp itself is tried at its lower end.

Two *witnesses* confirm the bracket or widen it. Residues and the tree only select which circles are
tried; what the witnesses show does not depend on them. At `lower`, an invariant circle is certified
by Newton's method, which starts from a long periodic orbit. At `upper`, converse KAM on two
unrelated grids finds no start that survives. A witness does not set the value. But if a start
survives on a circle that exists according to its residues, or far above the value, the search is
resumed above the value, and a circle found in this second search yields a new value.
"""

from dataclasses import dataclass, replace
from itertools import islice
from math import inf, nan
from time import thread_time

import numpy as np
from numpy.typing import ArrayLike

from nasm import action, circles, escape, periodic
from nasm.arithmetic.lanes import LANES
from nasm.checks import floats, real
from nasm.circles import hull
from nasm.converse_kam import aperiodic, symmetry_line, transversal
from nasm.farey import DEFAULT_SETTINGS as DEFAULT_TREE_SETTINGS
from nasm.farey import LONGEST_PERIOD, TreeSettings, circle_exists, find_existing_circle
from nasm.maps import MAX_PERIOD, direction, segment
from nasm.numbers import RotationNumber, nobles_near, rational
from nasm.results import CriticalScale, Status, no_answer
from nasm.survivors import LONGEST_LIFETIME, candidates, longest_lived
from nasm.symmetries import half_shift_nobles, per_period, ray, shorten
from nasm.types import FloatArray

__all__ = ["Effort", "boundary", "critical_scale", "last_circle"]


@dataclass(frozen=True)
class Effort:
    """Settings of a search for the last barrier, and limits on its work.

    Attributes
    ----------
    share_above : float
        Fraction of tol that lies above the value; there, converse KAM needs a number of steps
        proportional to 1/distance. The rest lies below the value, where a circle is certified,
        which takes longer.
    first_steps : int
        Number of steps of converse KAM on transversals at the start of the search. 100 steps
        eliminate all starts about 1/100 above the breakup, where the circle that the tree excludes
        last is usually the one that breaks last. If a circle exists at that scale, higher scales
        are tried in relative steps of 1/100. Starts that survive this far above a value contradict
        the value.
    resolution : float
        Largest tolerance of the search of the Farey tree; a larger tol widens only the bracket and,
        in bands, the error. With a tolerance of 10⁻² the search missed bands for one of the
        forcings in `tests/judged_forcings.csv`, whose breakups are known from other methods. For
        more than 64 kicks it is the smallest tolerance.
    max_questions : int
        Maximum number of scales at which the Farey tree is searched. Once this number is
        reached, the search, converse KAM and certification all end. The forcings in
        `tests/judged_forcings.csv` need 10 to 20 scales, or up to 60 if they have bands.
    step : float
        Relative length of a step to lower scales, multiplied by the longest period q used. Orbits
        of that period exclude circles over about four times the length of the step. Steps are not
        shorter than share_above·tol.
    tree : TreeSettings
        Settings that determine which residues in the tree exclude circles.
    orbit_period, last_period : int
        Longest periods of the orbits used for a leap and for the final value; their residues
        yield nine and eleven digits, respectively.
    cusp_period : int
        Longest period of the orbits that determine the final value if periods up to `last_period`
        are not precise enough, as happens close to a cusp. It also limits the period of the orbits
        that show, with one or two kicks, that the circle exists close to a cusp. If the distance
        from the breakup is unknown, circles are sought near an orbit of this period or longer.
    circles_tried : int
        Maximum number of circles that are tried at each scale below a bracket, until one is
        certified.
    search_share : float
        Fraction of the CPU time after which the search ends. Half of the remaining time is reserved
        for converse KAM, and whatever is left after that is used to certify a circle.
    iterated_kicks : int
        Number of kicks in the direct iteration for more than 64 kicks, which takes a few CPU
        seconds. `upper` was 4 to 11% above the breakup on twelve random rays of three to six kicks,
        each repeated to more than 64 kicks.

    Examples
    --------
    >>> from nasm.barriers import Effort, critical_scale
    >>> scale = critical_scale((1.0, 0.5, 0.3), tol=1e-2, effort=Effort(max_questions=30))
    >>> scale.status
    Status.OK
    """

    share_above: float = 0.2
    first_steps: int = 100
    resolution: float = 1e-3
    max_questions: int = 120
    step: float = 0.25
    tree: TreeSettings = DEFAULT_TREE_SETTINGS
    orbit_period: int = 1500
    last_period: int = 6000
    cusp_period: int = 30_000
    circles_tried: int = 6
    search_share: float = 0.6
    iterated_kicks: int = 10**7

    @property
    def breakup_distance(self) -> float:
        """Relative distance, below a scale without circles, within which a breakup is sought.

        `first_steps` steps of converse KAM eliminate all starts about this far above the breakup.
        """
        return 1 / self.first_steps

    @property
    def locating_steps(self) -> int:
        """Number of steps of converse KAM that locate a breakup to `resolution` or better."""
        return max(round(1 / self.resolution), self.first_steps)

    @property
    def witness_share(self) -> float:
        """Fraction of the CPU time after which converse KAM ends."""
        return (1 + self.search_share) / 2

    def witness_steps(self, tol: float) -> int:
        """Return how many steps converse KAM takes at `upper`.

        At the smallest distance of `upper` from the value, this many usually eliminate all starts.
        Close to a shorter forcing, and in rotating maps, some starts live longer; at a large tol,
        the number is therefore ten times what is usually needed at a distance of
        share_above/first_steps.
        """
        n_steps = LONGEST_LIFETIME / (self.share_above * min(tol, 0.1 / self.first_steps))
        return int(min(n_steps, transversal.MAX_STEPS))

    def search_tol(self, tol: float) -> float:
        """Return the tolerance for searching the tree, given the tolerance of the bracket."""
        return min(tol, self.resolution)

    def error_of_leap(self, tol: float) -> float:
        """Return the smallest relative error of a value that residues determine.

        The tree shows no circle at share_above·tol above the value, but a rival that breaks in
        between may have been missed. No error was too small for that reason among the forcings in
        `tests/judged_forcings.csv`, which are searched with the default tolerance or less; with a
        tolerance of 10⁻², one of 20 values for rotating maps was.
        """
        searched = self.search_tol(tol)
        return self.share_above * searched if searched > Effort.resolution else 0.0

    def error_in_bands(self, tol: float) -> float:
        """Return the smallest relative error where circles break and reappear in bands.

        Bands that are narrower than the tolerance of the search may be missed.
        """
        return min(tol, 2 * self.resolution)


DEFAULT_EFFORT = Effort()


def critical_scale(
    profile: ArrayLike,
    tol: float = 1e-4,
    start: ArrayLike | None = None,
    seconds: float = inf,
    effort: Effort = DEFAULT_EFFORT,
) -> CriticalScale:
    """Compute the scale at which the last rotational circle breaks on κ = start + s·profile.

    Parameters
    ----------
    profile : array_like, shape (P,)
        Direction of the segment, not zero. On rays P may be any number; with another start, the
        forcings must repeat after at most 64 kicks.
    tol : float
        Target for the width of the bracket, 10⁻⁵ to 10⁻¹: (upper - lower)/value on a ray; from
        another start, the change in the largest strength from lower to upper, relative to that
        strength.
    start : array_like, shape (P,), optional
        Start of the segment; default 0, a ray from the origin. With another start, the result is
        the first breakup at s ≥ 0; regions without circles may be missed if the largest strength
        changes by less than 0.1 across them.
    seconds : float
        Approximate limit on the CPU time. With a limit, results depend on the machine; cubes are
        computed without one. Under one or two kicks the limit applies only to the work after a
        first search, which takes about 0.2 seconds.
    effort : Effort
        Settings of the search, and other limits on its work.

    Returns
    -------
    CriticalScale
        value, error : by Greene's residue; in bands, value is the midpoint between two scales.
        lower : a scale at which a circle, of omega or of another rotation number, is certified; NaN
        if none is.
        upper : a scale at which no start on the dominant line, or on a transversal, survives; or,
        if time was short, at which the Farey tree shows no circle.
        omega : rotation number per period of the last barrier, in [0, P/2]. It represents ±ω and
        all ω + P·n, whose circles break together; of two degenerate partners (`degenerate_partner`
        in `nasm.symmetries`) it is the one with the shorter text.
        status : WIDE, with a value, if the bracket is more than twice as wide as tol, for example
        because no circle is certified close to the breakup, or time was short. NOT_CONVERGED,
        without a value, if the effort did not suffice; NEAR_CUSP if a forcing of shorter period is
        so close that orbits do not resolve the difference; UNDECIDED if the methods contradict each
        other. In these three cases lower and upper keep their meaning. TOO_LONG if P > 64: only
        upper is known, a few per cent above the breakup, by converse KAM or from an orbit that
        escapes. OUTSIDE if no barrier exists at a nonzero start.

    Raises
    ------
    ValueError
        If profile is zero, tiny or too long, start differs from it in length, or tol or seconds are
        out of range.

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
    tol, seconds = real("tol", tol, 1e-5, 0.1), real("seconds", seconds)
    if not seconds > 0:
        raise ValueError(f"seconds={seconds!r} must be positive, e.g. seconds=10")
    # On κ1 = κ2 barriers are noble under the standard map, but not under its second iterate.
    (begin, short), zero = shorten([start, profile], rational(0))
    if short.size > MAX_PERIOD and not begin.any():
        return _upper_of_long_period(short, tol, effort)
    scale = _last_breakup(_Segment(begin, short), tol, seconds, effort)
    if scale.omega is None:
        return scale
    kappa = start + scale.value * profile
    return replace(scale, omega=per_period(scale.omega, kappa, short, zero))


def _upper_of_long_period(profile, tol, effort):
    """Return the CriticalScale, without a value, of a ray with more than 64 kicks per period.

    Converse KAM is applied on straight lines, because computing transversals through all minimax
    orbits would take minutes. Where circles do not cross these lines steeply, escaping orbits yield
    a better bound; as many are iterated as the kernel advances at once.
    """
    kicks = aperiodic.around_strongest(profile)
    without_graphs = aperiodic.critical_scale(kicks, max(tol, effort.resolution)).upper
    # Converse KAM over a single kick of |κ| ≥ 2 excludes every circle.
    without_graphs = float(np.fmin(without_graphs, 2 / np.abs(profile).max()))
    n_steps = effort.iterated_kicks // profile.size + 1
    escapes = escape.onset_scale(profile, n_steps, LANES, max_scale=without_graphs)
    if escapes < without_graphs:
        return CriticalScale(nan, nan, nan, escapes, None, Status.TOO_LONG, escape.METHOD)
    return CriticalScale(nan, nan, nan, without_graphs, None, Status.TOO_LONG, "converse KAM")


@dataclass(frozen=True)
class _Segment:
    """Forcings κ = start + s·profile."""

    start: FloatArray
    profile: FloatArray

    def at(self, scale):
        """Return the forcing at a scale."""
        return self.start + scale * self.profile

    def length(self, scale, relative):
        """Return the change in scale that changes the largest strength by a relative amount."""
        return relative * np.abs(self.at(scale)).max() / np.abs(self.profile).max()


class _Tree:
    """Results of searches of the Farey tree on a segment, by scale, and the budget for all work.

    Parameters
    ----------
    segment : _Segment
    seconds : float
        CPU time allowed from now on.
    effort : Effort
    """

    def __init__(self, segment, seconds, effort):
        self.segment, self.effort, self.answers = segment, effort, {}
        self.began, self.seconds = thread_time(), seconds
        self.short_orbits = {}  # by fraction, each at the scale where it was found last
        self.eliminated_scale = inf  # a scale at which converse KAM has eliminated all starts

    def ask(self, scale):
        """Return (circle or None, nobles, period) from `find_existing_circle` at this scale.

        If the time ends before the search does, return (None, [], 1), and record no answer.
        """
        if scale not in self.answers:
            kappa, settings = self.segment.at(scale), self.effort.tree
            try:
                found = find_existing_circle(
                    kappa, settings=settings, until=self.end(1), nearby=self.short_orbits
                )
            except TimeoutError:
                return None, [], 1
            self.answers[scale] = found
        return self.answers[scale]

    def shows(self, omega, scale, longest=LONGEST_PERIOD):
        """Return True if residues show that the circle of ω exists at this scale."""
        return circle_exists(omega, self.segment.at(scale), longest, settings=self.effort.tree)

    def lowest_excluded(self, above):
        """Return the lowest scale greater than `above` at which the tree showed no circle.

        If there is no such scale yet, try higher ones; return inf if the budget is spent first.
        """
        next_scale = above
        while True:
            excluded = (s for s, (omega, *_) in self.answers.items() if omega is None and s > above)
            scale = min(excluded, default=inf)
            if scale < inf or self.is_search_over():
                return scale
            next_scale += self.segment.length(next_scale, 1 / self.effort.first_steps)
            self.ask(next_scale)

    def end(self, share):
        """Return the `time.thread_time` at which this fraction of the CPU time will be spent."""
        return self.began + share * self.seconds

    def is_search_over(self):
        """Return True if the time for the search, or `max_questions`, is used up."""
        return self.has_spent(self.effort.search_share)

    def is_elimination_over(self):
        """Return True if the time for converse KAM, or `max_questions`, is used up."""
        return self.has_spent(self.effort.witness_share)

    def has_spent(self, share):
        """Return True if this fraction of the CPU time, or `max_questions`, is used up."""
        too_many = len(self.answers) >= self.effort.max_questions
        return too_many or thread_time() > self.end(share)


@dataclass(frozen=True)
class _Bracket:
    """Two scales with the last breakup between them: no circle was found at `outside`.

    omega : a circle that exists at `inside`; None if no circle is known, and `inside` may be 0.
    breakup : where this circle breaks according to its residues; None if they do not determine it,
    as in bands, or if time was short. longest_period : the longest period of orbits that may have
    been used.
    is_eliminated : True if converse KAM eliminates all starts at `outside`.
    """

    inside: float
    outside: float
    omega: RotationNumber | None
    breakup: CriticalScale | None = None
    longest_period: int = LONGEST_PERIOD
    is_eliminated: bool = False


def _last_breakup(segment, tol, seconds, effort):
    """Return the CriticalScale; its omega is per period of the segment's profile."""
    tree = _Tree(segment, seconds, effort)
    bracket = _first_bracket(tree, tol)
    if isinstance(bracket, Status):
        return no_answer(None, bracket, "Farey tree")
    bracket, upper, survivor = _confirmed_above(tree, tol, bracket)
    value, error = _value(tree, tol, bracket)
    lower = _certified_below(tree, tol, bracket)
    cusp = periodic.cusp_period(segment.at(value))
    is_contradicted = upper > _highest_plausible(tree, tol, bracket)
    # Longer orbits are joined rather than scanned for: they do not see a cusp reliably.
    if upper > _lowest_upper(tree, tol, bracket) or cusp > action.JOIN_PERIOD:
        error = max(error, upper - value)
    status = Status.OK if upper - lower <= 2 * segment.length(value, tol) else Status.WIDE
    if cusp > bracket.longest_period:
        status = Status.NEAR_CUSP
    elif survivor is not None or bracket.outside - bracket.inside > segment.length(value, tol):
        status = Status.NOT_CONVERGED
    elif is_contradicted:
        status = Status.UNDECIDED
    if status in (Status.OK, Status.WIDE):
        return CriticalScale(value, error, lower, upper, bracket.omega, status, periodic.METHOD)
    return CriticalScale(nan, nan, lower, upper, None, status, "converse KAM")


def _first_bracket(tree, tol):
    """Return the _Bracket found without converse KAM at `upper`, or the Status if none is found."""
    bracket = _search_by_survivors(tree, tol)
    if bracket is None:
        ends = _outermost(tree)
        if isinstance(ends, Status):
            return ends
        bracket = _beside_cusp(tree, tol) or _search_by_tree(tree, tol, *ends)
    return bracket


def _confirmed_above(tree, tol, bracket):
    """Return the _Bracket, `upper`, and None, after converse KAM has been applied above it.

    While converse KAM contradicts a bracket, the tree is searched above it, and a bracket found
    there replaces it. If the budget ends while a circle is known at `upper`, that circle is
    returned instead of None, with the lowest scale at which the tree shows no circle.
    """
    upper, survivor = _eliminated_above(tree, tol, bracket)
    while not tree.is_search_over():
        if survivor is not None:
            outside = tree.lowest_excluded(upper)
            if outside == inf:
                break
            higher = _search_by_tree(tree, tol, upper, outside, survivor)
        elif upper > _highest_plausible(tree, tol, bracket):  # a leap may miss a band
            higher = _search_by_tree(tree, tol, bracket.outside, upper, leaps=False)
        else:
            break
        if higher.omega is None:
            break
        bracket = higher
        upper, survivor = _eliminated_above(tree, tol, bracket)
    if survivor is not None:  # the budget did not suffice to find where its circle breaks
        shown = min(tree.lowest_excluded(upper), tree.eliminated_scale)
        upper = shown if shown < inf else nan
    return bracket, upper, survivor


def _highest_plausible(tree, tol, bracket):
    """Return the scale above which a survivor contradicts the value of a bracket."""
    value, error = _value(tree, tol, bracket)
    relative = max(tol, 1 / tree.effort.first_steps)
    return value + max(error, tree.segment.length(value, relative))


def _value(tree, tol, bracket):
    """Return the value and error of a bracket."""
    segment, effort = tree.segment, tree.effort
    if bracket.breakup is not None:
        value, error = bracket.breakup.value, bracket.breakup.error
        return value, max(error, segment.length(value, effort.error_of_leap(tol)))
    half = (bracket.outside - bracket.inside) / 2
    error = segment.length(bracket.outside, effort.error_in_bands(tol))
    return bracket.inside + half, max(half, error)


def _outermost(tree):
    """Return (inside, outside, circle at inside or None) to begin the search with, or a Status."""
    segment, effort = tree.segment, tree.effort
    if segment.profile.size <= 2 and not segment.start.any():
        # The search by survivors failed, as it may close to a cusp. Without bands, no circle exists
        # above a scale at which all starts are eliminated.
        n_steps = 16 * effort.locating_steps
        outside = symmetry_line.critical_scale(segment.profile, n_steps).upper
        tree.eliminated_scale = outside
        return 0.0, outside, None
    n_sites = 8 if segment.start.any() else 2  # any scale without circles will do on a ray
    outside, _ = transversal.upper_scale(
        segment.profile, effort.first_steps, segment.start, n_sites, tree.end(effort.search_share)
    )
    if outside == 0:
        return Status.OUTSIDE
    circle = None if tree.is_search_over() else tree.ask(outside)[0]
    if circle is None:
        return 0.0, outside, None
    higher = tree.lowest_excluded(outside)  # a circle exists though no start survives
    return (outside, higher, circle) if higher < inf else Status.NOT_CONVERGED


def _beside_cusp(tree, tol):
    """Return a _Bracket without a value if no orbits resolve a cusp of two kicks; otherwise None.

    At its lower end, the last circle of the cusp exists at the cusp. The tree would take seconds to
    end with no value either.
    """
    profile, effort = tree.segment.profile, tree.effort
    if tree.segment.start.any() or profile.size != 2:
        return None
    if periodic.cusp_period(tree.segment.at(tree.eliminated_scale)) <= effort.cusp_period:
        return None
    cusp = critical_scale(np.sign(profile) * np.abs(profile).mean(), tol, effort=effort)
    if not cusp.lower < tree.eliminated_scale:
        return None
    return _Bracket(cusp.lower, tree.eliminated_scale, cusp.omega, longest_period=0)


def _search_by_tree(tree, tol, inside, outside, omega=None, leaps=True):
    """Return the _Bracket of the last breakup between two scales; wider if the budget runs out.

    omega : a circle that exists at `inside`, if one is known. leaps : False to lower the scale
    only by steps until a circle is found.
    """
    segment, effort, search_tol = tree.segment, tree.effort, tree.effort.search_tol(tol)
    if tree.is_search_over():
        return _Bracket(inside, outside, omega)
    _, nobles, period = tree.ask(outside)
    untried, leap_period = omega, 0  # circle to leap with next, period at the last leap
    while outside - inside > segment.length(outside, search_tol / 2) and not tree.is_search_over():
        step = max(effort.step / period, effort.share_above * search_tol)
        scale = outside - segment.length(outside, step)
        if scale <= inside:
            scale = (inside + outside) / 2
        breakup = None
        if untried or (leaps and period >= 2 * leap_period):
            named = untried or _simplest_near(nobles[0], segment.at(outside), period)
            breakup = _breakup(tree, search_tol, named, inside, outside)
            untried, leap_period = None, period
        if breakup:
            above = breakup.value + segment.length(outside, effort.share_above * search_tol)
            scale = min(above, outside)
        circle, nobles_there, period_there = tree.ask(scale)
        if scale not in tree.answers:  # time has run out
            break
        if circle is not None:
            inside, omega, untried = scale, circle, circle
            continue
        outside, nobles, period = scale, nobles_there, period_there
        if breakup:
            final = _with_rivals(tree, search_tol, breakup, inside, outside, nobles)
            return final or _Bracket(inside, outside, omega)
    return _Bracket(inside, outside, omega)


def _simplest_near(omega, kappa, period):
    """Return the simplest noble that orbits of this period cannot distinguish from ω.

    The two Farey neighbours of such an orbit are at least 4/period² apart.
    """
    near = float(omega), 4 / period**2, 1
    return [*half_shift_nobles(kappa, *near), *nobles_near(*near)][0]


def _breakup(tree, search_tol, omega, inside, outside):
    """Return a circle's CriticalScale between two scales; None if residues do not determine it."""
    segment, effort = tree.segment, tree.effort
    between = max(inside, outside - segment.length(outside, effort.breakup_distance)), outside
    found = periodic.critical_scale(
        omega, segment.profile, effort.orbit_period, segment.start, between
    )
    near = segment.length(outside, effort.share_above * search_tol)
    if found.status is not Status.OK or not found.error < near / 10:
        return None
    below = found.value - near
    exists = below <= inside or tree.shows(omega, below)
    return found if exists and between[0] < found.value < outside else None


def _with_rivals(tree, search_tol, breakup, inside, outside, nobles):
    """Return the _Bracket of a breakup, or of the later breakup of a rival, below `outside`.

    Return None if the time ends before all rivals have been tested.
    """
    segment, longest = tree.segment, tree.effort.tree.longest_ratio * LONGEST_PERIOD
    for omega in nobles:
        if thread_time() > tree.end(1):
            return None
        distance = segment.length(outside, tree.effort.step / longest)
        just_above = min(breakup.value + distance, outside)
        if omega != breakup.omega and tree.shows(omega, just_above):
            later = _breakup(tree, search_tol, omega, inside, outside)
            if later is None or later.value < breakup.value:  # the rival breaks above just_above
                return _Bracket(just_above, outside, omega)
            breakup = later
    near = segment.length(outside, tree.effort.share_above * search_tol)
    around = breakup.value - near, breakup.value + near
    period = tree.effort.last_period
    if period > tree.effort.orbit_period:
        longer = periodic.critical_scale(
            breakup.omega, segment.profile, period, segment.start, around
        )
        if longer.status is Status.OK and longer.error < breakup.error:
            breakup = longer
    return _Bracket(around[0], outside, breakup.omega, breakup)


def _search_by_survivors(tree, tol):
    """Return the _Bracket of the last breakup under one or two kicks; None if it is not found."""
    segment, effort, profile = tree.segment, tree.effort, tree.segment.profile
    if segment.start.any() or profile.size > 2:
        return None
    n_steps = effort.locating_steps
    located = symmetry_line.critical_scale(profile, n_steps)
    if located.status is not Status.OK:
        return None
    # At this scale lifetimes are 1.2 to 1.5 times n_steps.
    beyond = segment.at(located.value * (1 + 0.5 / n_steps))
    names = candidates(beyond, longest_lived(beyond, 2 * n_steps))
    last, seen = None, set()
    while new := [omega for omega in names if omega not in seen]:
        seen.update(new)
        for omega in new:
            if tree.shows(omega, (1 - effort.breakup_distance) * located.upper):
                last = _later(last, _breakup_of_two_kicks(omega, profile, tol, effort))
        if last is None:
            return None
        near = effort.share_above * tol * last.value
        outside = last.value + near
        n_steps = effort.witness_steps(tol)
        longest = longest_lived(segment.at(outside), n_steps)
        if longest.kicks < inf:
            inside = last.value - near
            # Close to a cusp, shorter orbits do not distinguish the forcing from the cusp.
            is_blurred = periodic.cusp_period(segment.at(last.value)) > action.JOIN_PERIOD
            period = effort.cusp_period if is_blurred else LONGEST_PERIOD
            if not tree.shows(last.omega, inside, period):
                return None
            return _Bracket(inside, outside, last.omega, last, effort.cusp_period, True)
        names = candidates(segment.at(outside), longest, n_steps)
    return None


def _breakup_of_two_kicks(omega, profile, tol, effort):
    """Return the CriticalScale of a circle, from longer orbits if a cusp is unresolved."""
    for longest in (effort.last_period, effort.cusp_period):
        found = periodic.critical_scale(omega, profile, longest)
        is_precise = found.error <= effort.share_above * tol * found.value
        if is_precise or found.status not in (Status.OK, Status.NEAR_CUSP):
            break
    return found


def _later(one, other):
    """Return the CriticalScale of the circle that breaks later; `one` if errors overlap."""
    if other.status is not Status.OK:
        return one
    if one is None or other.value - one.value > one.error + other.error:
        return other
    return one


def _lowest_upper(tree, tol, bracket):
    """Return the scale above a bracket at which converse KAM begins, the target for `upper`.

    At a large tol this is farther above the value than the tree was searched, so that few steps
    suffice; from tol = 1/first_steps on, the distance no longer grows, and `upper` stays close.
    """
    effort, (value, error) = tree.effort, _value(tree, tol, bracket)
    relative = effort.share_above * min(tol, 1 / effort.first_steps)
    above = max(error, tree.segment.length(value, relative))
    return max(bracket.outside, min(value + above, tree.eliminated_scale))


def _eliminated_above(tree, tol, bracket):
    """Return a scale above a bracket at which converse KAM eliminates all starts, and None.

    If a start survives on a circle that exists according to its residues, return that scale and the
    circle instead. If the time or `max_questions` is used up, return the scale reached by then: the
    bracket's upper end or above.
    """
    segment, effort = tree.segment, tree.effort
    value, _ = _value(tree, tol, bracket)
    n_steps, scale = effort.witness_steps(tol), _lowest_upper(tree, tol, bracket)
    until, plausible = tree.end(effort.witness_share), _highest_plausible(tree, tol, bracket)
    while scale < tree.eliminated_scale and not (
        bracket.is_eliminated or tree.is_elimination_over()
    ):
        longest = longest_lived(segment.at(scale), n_steps, until)
        if longest.kicks < inf:
            return scale, None
        for omega in candidates(segment.at(scale), longest, n_steps):
            if tree.shows(omega, scale):
                return scale, omega
        farther = min(value + 2 * (scale - value), tree.eliminated_scale)
        scale = min(farther, plausible) if scale < plausible else farther
    return scale, None


def _certified_below(tree, tol, bracket):
    """Return the scale of a certified circle at or below a bracket's lower end; NaN if none."""
    segment, effort = tree.segment, tree.effort
    value, _ = _value(tree, tol, bracket)
    lower, begin = nan, bracket.inside
    if bracket.breakup is not None and not tree.has_spent(1):
        # The part of tol that is left below the value.
        distance = max(tol - (bracket.outside - value) / segment.length(value, 1), tol / 2)
        lower, _ = hull.certified_circle(
            bracket.omega, segment.profile, value, distance, segment.start, tree.end(1)
        )
        begin = value - segment.length(value, tol)
        if lower >= begin:
            return lower
    for distance in (0, *(tol / 4 * 2**n for n in range(8))):
        scale = begin - segment.length(value, distance)
        if scale <= np.fmax(lower, 0) or tree.has_spent(1):
            break
        circle, nobles, _ = tree.ask(scale)
        names = dict.fromkeys([*filter(None, (bracket.omega, circle)), *nobles])
        kappa, period = segment.at(scale), effort.cusp_period
        for omega in islice(names, effort.circles_tried):
            exists = tree.shows(omega, scale)
            if exists and hull.circle_near_orbit(omega, kappa, period) is not None:
                return scale
    return lower


def last_circle(scale: CriticalScale, profile: ArrayLike) -> circles.InvariantCircle:
    """Compute the last circle on the ray, as it is at `scale.lower`, just before it breaks.

    It has about 10⁵ points if `scale` is precise to 10⁻⁴. `circles.invariant_circle` runs out of
    modes so close to the breakup; therefore `circles.hull.certified_circle` computes the circle
    from a long periodic orbit.

    Parameters
    ----------
    scale : CriticalScale
        A result with omega, value and lower, e.g. from `critical_scale`.
    profile : array_like, shape (P,)
        Direction of the ray for which `scale` was computed.

    Returns
    -------
    InvariantCircle
        The circle of scale.omega under the forcing scale.lower·profile, or under a weaker forcing
        if the circle is certified only there; `circles.graph` returns its graph. If no circle
        is certified, the status is NOT_CERTIFIED, and the array of deviations is empty.

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
            f"lower={scale.lower!r}, value={scale.value!r}: no circle was certified on this ray; "
            "ask for a wider bracket, e.g. critical_scale(profile, tol=1e-3)"
        )
    omega, distance = scale.omega, 1 - scale.lower / scale.value
    reached, u = hull.certified_circle(omega, profile, scale.value, distance)
    if u is None:
        u, status = np.empty((profile.size, 0)), Status.NOT_CERTIFIED
        return circles.InvariantCircle(omega, scale.lower * profile, u, np.nan, status)
    error = np.abs(circles.residual(omega, reached * profile, u)).max()
    return circles.InvariantCircle(omega, reached * profile, u, error, Status.OK)


def boundary(angles: ArrayLike, tol: float = 1e-4) -> list[CriticalScale]:
    """Compute the boundary of global transport for two kicks, ray by ray.

    Parameters
    ----------
    angles : float or sequence of floats
        Angles of the rays (κ1, κ2) = s·(cos angle, sin angle), in degrees.
    tol : float
        As for `critical_scale`; a ray takes 0.16 s of CPU time at 10⁻⁴, and 0.5 s at 2·10⁻⁵.

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
