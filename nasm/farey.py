"""Search for circles that exist under one forcing, by residues along the Farey tree.

Between neighbours p/q and p'/q', |pq' - p'q| = 1, all fractions have denominators, and orbits have
periods, of at least q + q'; the simplest fraction is the *mediant* (p + p')/(q + q'). Every ω is
the limit of a path of mediants. If the circle of ω exists, the residues of the minimax orbits on
the path decay to 0. At the breakup of a noble circle they stay near 0.25 (Greene). Below and above
the breakup, ln(R/0.25) of a mediant is approximately the sum of the values of its two neighbours.
So no circle exists between neighbours with large residues, and beyond the last breakup a hundred
mediants typically exclude all ω.

The orbit of a mediant is obtained by joining the orbits of its neighbours (`nasm.action`). The
search leaves some cases undecided: a circle within a relative distance δ of its breakup is resolved
only by periods of order 1/δ. However, the search covers all rotation numbers without gaps. Converse
KAM, by contrast, samples starts; for three kicks or more, the surviving starts may be confined to
intervals of width 10⁻⁶.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from heapq import heappop, heappush
from itertools import count as counter
from itertools import islice, pairwise
from math import inf, log, nan
from time import thread_time
from typing import NamedTuple

from numpy.typing import ArrayLike

from nasm.action import (
    JOIN_PERIOD,
    SURE_PERIOD,
    Chain,
    ConvergentOrbits,
    LostError,
    Orbit,
    joined,
    ordered_orbits,
)
from nasm.checks import count, real
from nasm.maps import forcing
from nasm.numbers import RotationNumber, as_rotation_number, convergents, moebius, parse
from nasm.symmetries import half_shift_nobles
from nasm.types import OmegaLike

__all__ = ["TreeSettings", "circle_exists", "find_existing_circle"]

LONGEST_PERIOD = 3000
"""Period from which the residues of the convergents decide whether a circle exists."""

_GAMMA = parse("gamma")


@dataclass(frozen=True)
class TreeSettings:
    """Limits on residues that exclude a circle or show that it exists, and limits on the search.

    Attributes
    ----------
    largest_product : float
        A circle may exist between two neighbours if the product of their residues is below
        largest_product·(1 + medium_period/q), where q is the longer of their two periods. At the
        breakup of a circle whose path continues in golden steps from these neighbours, both
        residues tend to 1/4 and their product to 1/16, with deviations of order 1/q. On the paths
        to the last circles of 144 forcings with one to twelve kicks, products at the breakup were
        at most 0.19. From period 10 on they were at most 0.08, except where the continued fraction
        of ω ends in 4, 4, 4, …; there they reached 0.19. The limit must also exceed the products
        just above a breakup, so that the search tests the circle that breaks there: a limit of 0.2
        excluded a circle with this continued fraction.
    largest_residue : float
        Largest residue of two neighbours that may enclose a circle, if one of their periods is
        `short_period` or longer. On the paths above, residues were at most 0.8, except for one of
        1.57 for a forcing with 11 kicks.
    short_period : int
        `largest_residue` does not apply to neighbours whose periods are both shorter than this;
        the residues of those with periods below 10 reached 49. Up to this period, the highest
        maximum of the action is sought; for longer orbits, only the maximum close to those of the
        two neighbours.
    medium_period : int
        Shortest period of the convergents whose residues are compared; those of shorter orbits do
        not decrease regularly. At this period the limit on products is twice `largest_product`.
    small_residue : float
        If the residues of neighbours are below this value, the noble between them is tested
        directly.
    max_mediants : int
        Maximum number of mediants computed; up to 1700 were needed to decide one forcing.
    longest_ratio : int
        `circle_exists` uses periods up to this multiple of its argument `longest` if shorter ones
        do not settle the question.

    Examples
    --------
    >>> from nasm.farey import TreeSettings, find_existing_circle
    >>> few = TreeSettings(max_mediants=3)
    >>> _, nobles, _ = find_existing_circle((1.2, 0.9), settings=few)  # not excluded yet
    >>> len(nobles) > 1
    True
    """

    largest_product: float = 0.3
    largest_residue: float = 1.6
    short_period: int = 20
    medium_period: int = 60
    small_residue: float = 0.05
    max_mediants: int = 3000
    longest_ratio: int = 4


DEFAULT_SETTINGS = TreeSettings()


class _Node(NamedTuple):
    fraction: Fraction
    orbit: Orbit | None
    residue: float

    @property
    def q(self):
        return self.fraction.denominator


def find_existing_circle(
    kappa: ArrayLike,
    deepest: int = 1000,
    settings: TreeSettings = DEFAULT_SETTINGS,
    until: float = inf,
    nearby: dict[Fraction, Orbit] | None = None,
) -> tuple[RotationNumber | None, list[RotationNumber], int]:
    """Search the Farey tree for a circle that exists under a forcing.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    deepest : int
        A period from 10 to 10⁶. If either of two neighbours has a longer period, the search does
        not continue between them; instead, `circle_exists` tests the noble between them.
    settings : TreeSettings
        Which residues exclude circles, and how far the tree is searched.
    until : float
        The `time.thread_time` at which the search is given up.
    nearby : dict, optional
        Minimax orbits under a forcing nearby, by fraction; a dict that is empty at first. Short
        orbits are found from these, which takes a tenth of the time of a scan, and replace them.

    Returns
    -------
    omega : RotationNumber or None
        A noble in [0, P/2] per period whose circle exists according to `circle_exists`; None if
        none was found.
    nobles : list of RotationNumber
        If a circle was found while mediants were computed, only its noble. Otherwise all
        nobles that were not excluded, whether the search stopped at `deepest` or did not reach
        them, the simplest first; if all were excluded, the one whose exclusion required the
        longest orbit. Just beyond the last breakup, the noble of the last circle is in the list.
    period : int
        The longest period used. Excluding a circle that breaks at a relative distance δ below the
        forcing takes periods of order 1/δ.

    Raises
    ------
    TimeoutError
        If the search has not ended by `until`.

    Examples
    --------
    >>> from nasm.farey import circle_exists, find_existing_circle
    >>> omega, _, _ = find_existing_circle((0.3, 0.2, 0.25))
    >>> circle_exists(omega, (0.3, 0.2, 0.25))
    True
    >>> find_existing_circle((1.2, 0.9))[0] is None
    True
    """
    kappa, deepest = forcing(kappa), count("deepest", deepest, 10, 10**6)
    until = real("until", until)
    order, left_over, period = counter(), [], 1
    heap: list[tuple[float, int, _Node, _Node]] = []

    def push(left, right):
        if _may_enclose_circle(left, right, settings):
            product = left.residue * right.residue
            heappush(heap, (log(product), next(order), left, right))

    orbits = _MinimaxOrbits(kappa, {} if nearby is None else nearby)
    for last in _integer_neighbours(orbits, kappa.size, settings):
        push(*last)
    for _ in range(settings.max_mediants):
        if not heap:
            break
        _check_time(until)
        _, _, left, right = heappop(heap)
        if max(left.q, right.q) > deepest:
            left_over += [(omega, (left, right)) for omega in _nobles(kappa, left, right)]
            continue
        middle = _between(orbits, left, right, settings)
        if middle.q > period:
            period, last = middle.q, (left, right)
        largest = max(node.residue for node in (left, right, middle))
        if middle.q > SURE_PERIOD and largest < settings.small_residue:
            longer = max(left, right, key=lambda node: node.q)
            for omega in _nobles(kappa, longer, middle):
                if _exists(omega, kappa, (longer, middle), settings):
                    return omega, [omega], period
        push(left, middle)
        push(middle, right)
    for *_, left, right in heap:  # pairs that the search did not reach
        left_over += [(omega, (left, right)) for omega in _nobles(kappa, left, right)]
    left_over.sort(key=lambda noble: len(noble[0].prefix))
    omega = None
    for noble, pair in left_over:
        _check_time(until)
        if _exists(noble, kappa, pair, settings):
            omega = noble
            break
    return omega, [omega for omega, _ in left_over] or _nobles(kappa, *last)[:1], period


def _check_time(until):
    if thread_time() > until:
        raise TimeoutError("the search of the Farey tree took longer than it was allowed")


def _may_enclose_circle(left, right, settings):
    """Return True if a circle may exist between two neighbours, according to their residues.

    A short orbit that could not be found (is lost) does not by itself exclude anything.
    """
    residues, longer = (left.residue, right.residue), max(left.q, right.q)
    largest = settings.largest_product * (1 + settings.medium_period / longer)
    is_near = longer < settings.short_period or max(residues) < settings.largest_residue
    is_lost = left.orbit is None or right.orbit is None
    return is_near and (is_lost or residues[0] * residues[1] < largest)


def _exists(omega, kappa, nodes, settings):
    known = [node.orbit for node in nodes if node.orbit]
    return circle_exists(omega, kappa, known=known, settings=settings)


def circle_exists(
    omega: OmegaLike,
    kappa: ArrayLike,
    longest: int = LONGEST_PERIOD,
    known: Sequence[Orbit] = (),
    settings: TreeSettings = DEFAULT_SETTINGS,
) -> bool:
    """Test whether a circle exists, by the decay of the residues of its convergents.

    Parameters
    ----------
    omega : RotationNumber or str
        Rotation number per period, irrational.
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    longest : int
        Residues of orbits with shorter periods need not decrease yet. From this period on, the
        answer is False as soon as the last residue is not below the two before it. The answer is
        True as soon as the last three residues are below `settings.small_residue` and the last of
        them is the smallest, or vanishes. All periods are less than `settings.longest_ratio` times
        this one.
    known : sequence of Orbit
        Known minimax orbits of convergents of ω.
    settings : TreeSettings
        Limits on residues, and the range of periods whose residues are compared.

    Returns
    -------
    bool
        True if the residue of the last minimax orbit is below those of the two before it, or
        vanishes. False otherwise, and also if an orbit is lost because the forcing is far beyond
        the breakup.

    Examples
    --------
    >>> from nasm.farey import circle_exists
    >>> circle_exists("gamma", 0.9), circle_exists("gamma", 1.0)
    (True, False)
    """
    kappa, omega = forcing(kappa), as_rotation_number(omega)
    longest = count("longest", longest, 1, 10**6)
    fractions = list(islice(convergents(omega), len(omega.prefix) + 30))
    fractions = [f for f in fractions if f.denominator < settings.longest_ratio * longest]
    # Compare at least three convergents with periods below `longest`, even if quotients are large.
    n_short = sum(f.denominator < settings.medium_period for f in fractions)
    n_allowed = sum(f.denominator < longest for f in fractions)
    first = max(len(omega.prefix) - 1, min(n_short, n_allowed - 3))
    orbits, residues = ConvergentOrbits(kappa, 0 * kappa, fractions, known=known), [nan]
    for n in range(first, len(fractions)):
        if fractions[n].denominator >= longest and not _fall(residues):
            return False
        try:
            residues.append(orbits.at(n, 0.0, -1).residue)
        except LostError as lost:
            if lost.is_far_beyond:
                return False
            continue
        *_, before, residue = residues
        if residue > before and residue > settings.largest_residue:
            return False
        # Residues pass through 0 where the minimizing and the minimax orbit exchange roles, so
        # three of them may be small by chance.
        is_small = max(residues[-3:]) < settings.small_residue
        if is_small and (_fall(residues) or residue == 0):  # R vanishes to rounding
            return True
    return _fall(residues)


def _fall(residues):
    return len(residues) > 3 and bool(residues[-1] < min(residues[-3:-1]))


class _MinimaxOrbits:
    """Minimax orbits under one forcing, and those under a forcing nearby, by fraction."""

    def __init__(self, kappa, nearby):
        self.kappa, self.nearby, self.minimizers = kappa, nearby, {}

    def find(self, fraction, otherwise):
        """Return the orbit, found from the one nearby or else by `otherwise`; None if lost."""
        near = self.nearby.get(fraction)
        orbit = (near and near.minimax_under(self.kappa)) or otherwise(fraction)
        if orbit and fraction.denominator <= SURE_PERIOD:  # long orbits would fill the memory
            self.nearby[fraction] = orbit
        return orbit

    def scan(self, fraction):
        """Return the orbit found by a scan or by descents; None if it is lost."""
        try:
            return ordered_orbits(self.kappa, *fraction.as_integer_ratio(), self.minimizers)[1]
        except LostError:
            return None


def _integer_neighbours(orbits, period, settings):
    """Return pairs of Farey neighbours that together enclose all ω from 0 to P/2."""
    fractions = map(Fraction, range((period + 1) // 2 + 1))
    nodes = [_node(each, orbits.find(each, orbits.scan)) for each in fractions]
    if period % 2:
        nodes[-1] = _between(orbits, *nodes[-2:], settings)
    return pairwise(nodes)


def _between(orbits, left, right, settings):
    """Return the node of the mediant."""
    (p, q), (r, s) = (node.fraction.as_integer_ratio() for node in (left, right))

    def join_or_scan(fraction):
        if q + s <= settings.short_period and (orbit := orbits.scan(fraction)):
            return orbit
        if left.orbit and right.orbit:
            chain = Chain(left.orbit.chain.period, fraction)
            for first, second in (left, right), (right, left):
                if orbit := joined(first.orbit, second.orbit, chain, -1):
                    return orbit
        return orbits.scan(fraction) if settings.short_period < q + s < JOIN_PERIOD else None

    fraction = Fraction(p + r, q + s)
    return _node(fraction, orbits.find(fraction, join_or_scan))


def _node(fraction, orbit):
    # A short orbit that is lost is treated as if it had the residue of an orbit at a breakup.
    lost = 0.25 if fraction.denominator <= SURE_PERIOD else inf
    # A product of NumPy's numbers would warn where it is infinite.
    return _Node(fraction, orbit, max(float(orbit.residue), 1e-6) if orbit else lost)


def _nobles(kappa, one, other):
    """Return a list with the noble whose path from two neighbours continues in golden steps.

    If `half_shift_nobles` yields a number between the neighbours, it comes first in the list.
    """
    (p, q), (r, s) = sorted(
        (node.fraction.as_integer_ratio() for node in (one, other)), key=lambda f: f[1]
    )
    of_half_shift = half_shift_nobles(kappa, (p / q + r / s) / 2, 0.5 / (q * s), 1)
    return [*of_half_shift, moebius(_GAMMA, p, r, q, s)]
