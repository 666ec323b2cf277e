"""Ordered periodic orbits under any forcing, computed from the action; no symmetry is needed.

An orbit is a chain of sites, one per kick,

    x_{n+1} - 2 x_n + x_{n-1} = (κ_n / 2π) sin 2πx_n,     y_n = x_n - x_{n-1}.

Under a forcing of P kicks, an orbit of rotation number p/q has N = Pq sites, x_n = np/N + u_n. Such
orbits are stationary points of the action

    A = Σ_n (x_{n+1} - x_n)²/2 - (κ_n/4π²) cos 2πx_n,        x_{n+N} = x_n + p.

All sites but x_0 are eliminated: they minimize A for a given x_0. That leaves the *reduced
action* a(x_0), with

    a' = -G,    a'' = S,    R = -S Π(pivots)/4,

where G is the force on x_0, S the Schur complement that remains of the Hessian when the other
sites are eliminated, and R Greene's residue. The block of the other sites is tridiagonal, and
Π(pivots) is the product of the pivots of its elimination. One sweep from both ends to the middle
and one sweep back yield all three quantities, and the Newton step for the other sites.

For every p/q, two orbits are ordered like a rotation: the *minimizing* one, R < 0, at the minimum
of a(x_0), and the *minimax* one, R > 0, at the maximum of a(x_0) over the gap between the
minimizing orbit and its neighbour. Steps of x_0 by +G/|S| lead to the minimizing orbit, and steps
by -G/|S| to the minimax orbit.

The orbits of the convergents of a number ω are found in order of increasing period:

1. *Constrain.* Keep x_0 fixed. Join copies of the orbit of one convergent, and one copy of the
   orbit of the convergent before it, end to end: a few Newton steps turn this chain into the orbit
   of the next convergent. Long orbits are thus found at each forcing independently, even where
   residues pass through 0.
2. *Scan.* Begin the orbit at the site with the widest gap, and move x_0 across that gap. The
   highest maximum of a(x_0) is the minimax orbit, which may lie on any symmetry line, or on none.
3. *Descend.* The scan can fail if the action is steep and has several minima, or if the maximum
   cannot be reached by moving a single site. Orbits with periods up to 100 are then found by
   descent: the sites of an orbit move along the forces on them. Orbits that descend never cross
   each other; they end at minima, and the pass between two adjacent minima is on the boundary of
   their basins of attraction. (The same argument shows that the orbits exist.) Two orbits descend
   along this boundary, one on either side; bisection keeps them close to each other (*edge
   tracking*: Skufca, Yorke & Eckhardt, Phys. Rev. Lett. 96 (2006) 174101).
4. *Follow.* Newton's method continues known orbits along the segment of forcings. Longer orbits are
   found by joining known ones end to end.

Deviations u are stored instead of x, so that rounding errors do not grow with x.

Aubry & Le Daeron, Physica D 8 (1983) 381; Mather, Comment. Math. Helv. 60 (1985) 508.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from nasm.arithmetic.double_double import INVERSE_TWO_PI, add, divided, multiply, sincos_2pi
from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import MAX_DENOMINATOR as MAX_PERIOD
from nasm.checks import count
from nasm.maps import TWO_PI, forcing
from nasm.numbers import distinct_convergents, rational
from nasm.types import FloatArray, IntArray

__all__ = [
    "Chain",
    "ConvergentOrbits",
    "LostError",
    "Orbit",
    "is_ordered",
    "joined",
    "newton_solve",
    "ordered_orbits",
    "total_action",
]

Minimizers: TypeAlias = dict[tuple[int, int], FloatArray]
"""Constrained minimizers {(p, q): deviations} under one forcing."""

SURE_PERIOD = 100
"""Longest period of orbits that are found by descent if the scan misses them."""

FLAT = 1e-15
"""Slopes of the reduced action, and steps of the sites, below this value times √N are rounding
errors; R is 0 if the slope is that small everywhere."""

_MAX_LAST_STEP = 1e-7
"""Newton's method has converged if its last step, in turns, is below this: the next step would be
about the square of it. Minima closer than this are the same one. With 1e-8, none of five circles
of [0;1,70,(1)] were resolved."""

JOIN_PERIOD = 300
"""Period above which orbits are joined from shorter ones rather than scanned for, although only the
scan finds the highest maximum."""

_MAX_NEWTON_STEPS = 60
"""Largest number of steps of Newton's method."""

_GAP_POINTS = 12
"""Number of steps of x_0 across a gap in a scan."""

_MAX_DESCENT_STEPS = 1000
"""Largest number of damped steps of a descent."""


class LostError(Exception):
    """The ordered orbits of a fraction were not found, or were lost while they were followed.

    The message states the reason. These orbits exist under any forcing. Long ones are lost far
    beyond the breakup of the circles near p/q. Short ones should always be found; if one is not,
    this says nothing about circles.

    Parameters
    ----------
    message : str
        The reason.
    period : int
        The denominator q, or 0 if the error does not concern a single fraction.

    Examples
    --------
    >>> from nasm.action import LostError
    >>> LostError("a long orbit", period=233).is_far_beyond
    True
    """

    def __init__(self, message: str, period: int = 0) -> None:
        super().__init__(message)
        self.period = period

    @property
    def is_far_beyond(self) -> bool:
        """True if the loss shows that the forcing is far beyond the breakup of circles near p/q."""
        return self.period > SURE_PERIOD


class ConvergentOrbits:
    """Ordered orbits of convergents on the segment of forcings κ = start + s·profile.

    Parameters
    ----------
    start, profile : ndarray, shape (P,)
        The segment.
    fractions : sequence of Fraction
        Consecutive convergents of a number, in order of increasing q.
    minimizers : dict, optional
        A dict, empty at first; objects that share it reuse each other's constrained minimizers at
        s = 0. They must share `start`.
    known : sequence of Orbit
        Orbits already known on that segment.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.action import ConvergentOrbits
    >>> from nasm.numbers import distinct_convergents
    >>> fractions = distinct_convergents("gamma", 13)
    >>> orbits = ConvergentOrbits(np.zeros(1), np.ones(1), fractions)
    >>> orbit = orbits.at(len(fractions) - 1, scale=0.5, kind=-1)
    >>> orbit.chain.p, orbit.chain.q, bool(orbit.residue > 0)
    (8, 13, True)
    """

    def __init__(
        self,
        start: FloatArray,
        profile: FloatArray,
        fractions: Iterable[Fraction],
        minimizers: Minimizers | None = None,
        known: Iterable[Orbit] = (),
    ) -> None:
        self.start, self.profile = start, profile
        self.chains = [Chain(profile.size, fraction) for fraction in fractions]
        self._scale, self._minimizers = 0.0, {} if minimizers is None else minimizers
        self._latest = {(orbit.chain.p, orbit.chain.q, orbit.kind): orbit for orbit in known}
        self._answers: dict[tuple[int, int], Orbit | LostError] = {}
        # An orbit is followed while q times the change in any strength is below 1.
        self._near = 1 / np.abs(profile).max(initial=1e-300)

    def at(self, n: int, scale: float, kind: int) -> Orbit:
        """Find the minimizing (kind = 1) or the minimax orbit (kind = -1) of fraction n.

        Returns
        -------
        Orbit
            The orbit; its residue is 0 if R vanishes to rounding.

        Raises
        ------
        LostError
            If the orbit is not found.
        """
        self._forget_other_scales(scale)
        if (n, kind) not in self._answers:
            try:
                self._answers[n, kind] = self._at(n, scale, kind)
            except LostError as error:
                self._answers[n, kind] = error
        answer = self._answers[n, kind]
        if isinstance(answer, LostError):
            raise answer
        return answer

    def _forget_other_scales(self, scale):
        # Orbits are joined from two shorter ones, and these from still shorter ones; what is known
        # at the latest scale is kept, so that no orbit is computed twice.
        if scale != self._scale:
            self._scale, self._answers, self._minimizers = scale, {}, {}

    def _at(self, n: int, scale: float, kind: int) -> Orbit:
        p, q = self.chains[n].p, self.chains[n].q
        orbit = self._latest.get((p, q, kind))
        if orbit and abs(scale - orbit.scale) < self._near / q and orbit.move(scale):
            return orbit
        orbit = self._join(n, scale, kind) if q > JOIN_PERIOD and n > 1 else None
        orbits = {kind: orbit} if orbit else self.scan(n, scale)
        if orbits[kind].residue != 0:
            self._latest.update({(p, q, key): orbit for key, orbit in orbits.items()})
        return orbits[kind]

    def scan(self, n: int, scale: float) -> dict[int, Orbit]:
        """Find both orbits of fraction n by steps 1 to 3, using this scale alone.

        The steps are those listed in the module docstring.

        Returns
        -------
        dict
            {1: the minimizing Orbit, -1: the minimax one}.

        Raises
        ------
        LostError
            If the orbits are not found.
        """
        chain = self.chains[n]
        try:
            site, sites, residues = self._scan(n, scale)
        except LostError:
            if chain.q > SURE_PERIOD:
                raise
            site, sites, residues = _find_by_descent(self.start + scale * self.profile, chain)
        segment = _roll(self.start, site), _roll(self.profile, site)
        return {
            kind: Orbit(chain, segment, site, kind, u, residue, scale)
            for kind, u, residue in zip((1, -1), sites, residues, strict=True)
        }

    def _scan(self, n, scale):
        """Find both orbits by steps 1 and 2; return their first site, deviations and residues."""
        chain, (site, u) = self.chains[n], self._begin(n, scale)
        first = _widest_gap(chain, _roll(u, -site)) - site
        site, u = (site + first) % chain.period, chain.rolled(u, first)
        kappa = _roll(self.start + scale * self.profile, site)
        sites, width = np.empty((2, u.size)), (chain.right(u)[0] - u[0]) / _GAP_POINTS
        residues = _scan_gap(kappa, *chain.frame, u, width, sites)
        if np.isnan(residues).any():
            raise chain.lost("the action has no minimum or no maximum in their gap")
        return site, sites, residues

    def _begin(self, n, scale):
        """Return (site, u) of the orbit of fraction n from which a scan starts.

        This orbit is the `constrained_minimizer`. If it is lost, as happens far beyond the breakup,
        the scan starts from the minimizing orbit close to the cantorus, joined from shorter orbits.
        """
        try:
            return self.constrained_minimizer(n, scale)
        except LostError:
            orbit = self._join(n, scale, 1) if n > 1 else None
            if orbit is None:
                raise
            return orbit.site, orbit.u

    def constrained_minimizer(self, n: int, scale: float) -> tuple[int, FloatArray]:
        """Minimize the action of fraction n with x fixed at one site.

        Returns
        -------
        site : int
            The site of the largest |κ|.
        u : ndarray, shape (N,)
            Deviations of the sites, beginning at `site`.

        Raises
        ------
        LostError
            If no ordered orbit is found.
        """
        self._forget_other_scales(scale)
        kappa, orbits = self.start + scale * self.profile, self._minimizers
        site = int(np.abs(kappa).argmax())
        kappa = _roll(kappa, site)
        for i, chain in enumerate(self.chains[: n + 1]):
            if (chain.p, chain.q) in orbits:
                continue
            symmetric = np.full(chain.n_sites, 0.0 if kappa[0] > 0 else 0.5)
            shorter = [(one, orbits[one.p, one.q]) for one in self.chains[max(i - 2, 0) : i]]
            if i > 1:
                u = chain.joined(*shorter)
            else:
                u = np.resize(shorter[0][1], chain.n_sites) if i else symmetric.copy()
            if not _minimize_constrained(kappa, *chain.frame, u):
                error = chain.lost("with one site fixed, no ordered orbit was found")
                if chain.q > SURE_PERIOD:
                    raise error
                u = symmetric
                for part in np.arange(1, 9) / 8:
                    if not _minimize_constrained(part * kappa, *chain.frame, u):
                        raise error
            orbits[chain.p, chain.q] = u
        return site, orbits[self.chains[n].p, self.chains[n].q]

    def _join(self, n, scale, kind):
        last, one = (self.at(i, scale, kind) for i in (n - 2, n - 1))
        return joined(last, one, self.chains[n], kind)


def joined(last: Orbit, one: Orbit, chain: Chain, kind: int) -> Orbit | None:
    """Join orbits of Farey neighbours end to end, and find the ordered orbit near them.

    Parameters
    ----------
    last, one : Orbit
        Orbits at the same scale, which is also the scale of the result. `last` is used once, and
        `one` as often as `chain` requires.
    chain : Chain
        Chain of the result.
    kind : int
        1 for the minimizing orbit, -1 for the minimax one.

    Returns
    -------
    Orbit or None
        The ordered orbit, or None if it is not found.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from nasm.action import Chain, joined, ordered_orbits
    >>> _, last = ordered_orbits(0.5, 1, 2)
    >>> _, one = ordered_orbits(0.5, 2, 3)
    >>> orbit = joined(last, one, Chain(1, Fraction(3, 5)), -1)
    >>> orbit.chain.q
    5
    """
    longer_period = max(last.chain.q, one.chain.q)
    for u_last in [last.u] * (last.site == one.site) + [last.beginning_like(one)]:
        u = chain.joined((last.chain, u_last), (one.chain, one.u))
        is_minimum = _minimize_constrained(one.kappa, *chain.frame, u)
        # Without a minimum to start from, the search for a minimax orbit takes the most steps and
        # usually fails; a minimizing orbit may still be reached.
        if kind < 0 and not is_minimum:
            continue
        residue = _find_extremum(one.kappa, *chain.frame, u, kind, 1 / longer_period)
        if not np.isnan(residue):
            segment = one.start, one.profile
            return Orbit(chain, segment, one.site, kind, u, residue, one.scale)
    return None


class Orbit:
    """An ordered periodic orbit on a segment of forcings, at its current scale.

    Attributes
    ----------
    chain : Chain
        Chain of its fraction p/q.
    kind : int
        1 if it is minimizing, -1 if minimax, 0 if x_0 is held fixed by a symmetry.
    site : int
        Number of its first site, 0 to P - 1.
    u : ndarray, shape (N,)
        Deviations of the sites from the rotation.
    residue : float
        R, accurate to about N² ulp.
    scale : float
        The scale s of the forcing.
    """

    def __init__(
        self,
        chain: Chain,
        segment: tuple[FloatArray, FloatArray],
        site: int,
        kind: int,
        u: FloatArray,
        residue: float,
        scale: float,
    ) -> None:
        self.chain, (self.start, self.profile) = chain, segment
        self.site, self.kind, self.u, self.scale, self.residue = site, kind, u, scale, residue
        self._before, self._step = np.empty_like(u), 0.0

    @property
    def kappa(self) -> FloatArray:
        """The forcing at the current scale, beginning with the kick at `site`."""
        return self.start + self.scale * self.profile

    def refined_residue(self) -> float:
        """Compute R, accurate to the last digits, in double-double arithmetic."""
        chain = self.chain
        return _refined_residue(self.kappa, chain.numerators, self.u, chain.frame[2])

    def sites(self) -> FloatArray:
        """Return x of all N sites on the lift, beginning at `site`: shape (N,)."""
        return np.arange(self.u.size) * (self.chain.p / self.u.size) + self.u

    def beginning_like(self, other: Orbit) -> FloatArray:
        """Return u rotated to begin at the site nearest to the first site of the other orbit."""
        first = (other.site - self.site) % self.start.size
        sites = slice(first, None, self.start.size)
        distance = self.chain.theta[sites] + self.u[sites] - other.u[0]
        nearest = np.abs(distance - np.rint(distance)).argmin()
        return self.chain.rolled(self.u, first + self.start.size * int(nearest))

    def points(self) -> tuple[FloatArray, FloatArray]:
        """Return x and y at the start of each of the q periods.

        Returns
        -------
        x, y : ndarrays, shape (q,)
            The points in order of time; x is on the lift.
        """
        x = self.sites()
        starts = slice(-self.site % self.start.size, None, self.start.size)
        return x[starts], np.diff(x, prepend=x[-1] - self.chain.p)[starts]

    def minimax_under(self, kappa: FloatArray) -> Orbit | None:
        """Find the minimax orbit near this one under another forcing, by Newton's method.

        Parameters
        ----------
        kappa : ndarray, shape (P,)
            The forcing, first kick first.

        Returns
        -------
        Orbit or None
            None if Newton's method does not end at an ordered minimax orbit whose sites are all
            within 1/4q of those of this one, a quarter of the mean distance of two sites.

        Examples
        --------
        >>> import numpy as np
        >>> from nasm.action import ordered_orbits
        >>> _, minimax = ordered_orbits((0.3, 0.5), 2, 3)
        >>> orbit = minimax.minimax_under(np.array([0.31, 0.51]))
        >>> bool(np.isclose(orbit.residue, ordered_orbits((0.31, 0.51), 2, 3)[1].residue))
        True
        """
        (theta, hop, work), u, period = self.chain.frame, self.u.copy(), self.chain.period
        forcing = _roll(kappa, self.site)
        residue = _saddle(forcing, theta, work, u)
        is_near = np.abs(u - self.u).max() < 0.25 / self.chain.q
        if not (residue > 0 and is_near and is_ordered(u, hop, period / u.size)):
            return None
        return Orbit(self.chain, (forcing, 0 * forcing), self.site, -1, u, residue, 0.0)

    def move(self, scale: float) -> bool:
        """Continue the orbit to another scale, in place.

        Returns
        -------
        bool
            False if the steps became too small before that scale was reached.
        """
        self.scale, self._step, self.residue = _follow(
            self.start, self.profile, *self.chain.frame, self.kind,
            self.scale, scale, self.residue, self.u, self._before, self._step,
        )  # fmt: skip
        return self.scale == scale


class Chain:
    """Quantities shared by all orbits of one fraction p/q under forcings of P kicks.

    Parameters
    ----------
    period : int
        Number P of kicks per period.
    fraction : Fraction
        Rotation number p/q.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from nasm.action import Chain
    >>> Chain(2, Fraction(3, 5)).n_sites
    10
    """

    def __init__(self, period: int, fraction: Fraction) -> None:
        self.period, self.p, self.q = period, fraction.numerator, fraction.denominator
        self.n_sites = period * self.q

    @cached_property
    def numerators(self) -> IntArray:
        """Angles of the rotation in units of 1/N, reduced mod N, and thus exact for any N."""
        return np.arange(self.n_sites) * (self.p % self.n_sites) % self.n_sites

    @cached_property
    def frame(self) -> tuple[FloatArray, int, FloatArray]:
        """Arguments of kernels: angles of the rotation, `hop` (see `is_ordered`), a workspace."""
        hop = self.period * (pow(self.p, -1, self.q) if self.q > 1 else 0)
        return self.numerators / self.n_sites, hop, np.empty((4, self.n_sites))

    @property
    def theta(self) -> FloatArray:
        """Angles of the rotation, in turns: shape (N,)."""
        return self.frame[0]

    def lost(self, reason: str) -> LostError:
        """Return a LostError that states why these orbits were not found."""
        return LostError(
            f"the ordered orbits of {self.p}/{self.q} were not found: {reason}", self.q
        )

    def right(self, u: FloatArray) -> FloatArray:
        """Return the next orbit to the right, which is the same orbit started at another time."""
        return _roll(u, self.frame[1]) + 1 / self.q

    def rolled(self, u: FloatArray, first: int) -> FloatArray:
        """Return the orbit from site `first` on, with x_0 in [-1/2, 1/2]."""
        u = _roll(u, first) + self.theta[first % self.n_sites]
        return u - np.rint(u[0])

    def joined(self, last: tuple[Chain, FloatArray], one: tuple[Chain, FloatArray]) -> FloatArray:
        """Join the orbits of two fractions end to end: `one` repeatedly, then `last` once.

        Returns
        -------
        ndarray, shape (N,)
            Deviations from the rotation of this fraction, which is the Farey sum of the fractions
            of all the orbits joined.
        """
        (before, u_before), (chain, u) = last, one
        copies = (self.q - before.q) // chain.q
        drift, drift_before = (
            (other.p * self.q - self.p * other.q) / (self.n_sites * other.q)
            for other in (chain, before)
        )
        sites = np.arange(copies * u.size)
        end = sites.size * drift + u_before + np.arange(u_before.size) * drift_before
        return np.concatenate([np.tile(u, copies) + sites * drift, end])


def ordered_orbits(
    kappa: ArrayLike, p: int, q: int, minimizers: Minimizers | None = None
) -> tuple[Orbit, Orbit]:
    """Find the two ordered orbits of rotation number p/q per period.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        Strengths of the kicks, first kick first.
    p, q : int
        Coprime integers, 1 ≤ q ≤ 10⁶.
    minimizers : dict, optional
        A dict, empty at first; calls for the same forcing that share it reuse each other's work.

    Returns
    -------
    minimizing, minimax : Orbit
        Both begin at the site with the widest gap. If R vanishes to rounding, both
        returned orbits are the same one.

    Raises
    ------
    LostError
        If the orbits are not found. Both exist under any forcing, and are found up to twice the
        scale at which the last circle breaks; far beyond the breakup of all circles near p/q,
        orbits with periods above 100 may be lost.

    Examples
    --------
    >>> from nasm.action import ordered_orbits
    >>> minimizing, minimax = ordered_orbits((0.3, 0.5), 1, 3)
    >>> bool(minimizing.residue < 0 < minimax.residue)
    True
    >>> minimax.points()[0].shape
    (3,)
    """
    kappa, q = forcing(kappa), count("q", q, 1, MAX_PERIOD)
    p = count("p", p, -MAX_PERIOD * kappa.size, MAX_PERIOD * kappa.size)
    if np.gcd(p, q) != 1:
        raise ValueError(f"p/q = {p}/{q} has a common factor; write it in lowest terms")
    fractions = distinct_convergents(rational(Fraction(p, q)), q)
    orbits = ConvergentOrbits(kappa, 0 * kappa, fractions, minimizers).scan(len(fractions) - 1, 0.0)
    return orbits[1], orbits[-1]


def _find_by_descent(kappa, chain):
    """Find both orbits by step 3; return their first site, deviations and residues."""
    theta, hop, work = chain.frame
    # The descent starts from a rotation without symmetry, so it cannot end on the boundary between
    # two basins.
    u = np.full(chain.n_sites, 0.3 / chain.q)
    error = chain.lost(f"descents of {_MAX_DESCENT_STEPS} steps did not lead to them")
    if not _descend(kappa, theta, work, u):
        raise error
    first = _widest_gap(chain, u)
    kappa, u = _roll(kappa, first), chain.rolled(u, first)
    minima, passes = [u, chain.right(u)], []
    while len(passes) < len(minima) - 1:
        middle, n = np.empty(chain.n_sites), len(passes)
        residue = _find_pass(kappa, theta, hop, work, *minima[n : n + 2], middle)
        if residue > 0:
            passes.append((middle, residue))
        elif residue < 0 and len(minima) <= chain.period + 1:
            minima.insert(n + 1, middle)
        else:
            raise error
    lowest, highest = (
        int(np.argmin([sign * total_action(kappa, theta, u) for u in orbits]))
        for sign, orbits in ((1, minima[:-1]), (-1, [u for u, _ in passes]))
    )
    minimizing, (minimax, residue) = minima[lowest], passes[highest]
    if highest < lowest:
        minimax = chain.right(minimax)
    least = _find_extremum(kappa, theta, hop, work, minimizing, 1, 0.1 / chain.q)
    if np.isnan(least):
        raise error
    return first % chain.period, (minimizing, minimax), (least, residue)


def _roll(u, first):
    """Return u rotated to begin at index `first`; np.roll takes five times as long."""
    first %= u.size
    return np.concatenate((u[first:], u[:first]))


def _widest_gap(chain, u):
    """Return the site of the widest gap; if several are equal to within convergence, the first."""
    gaps = chain.right(u) - u
    by_site = gaps.reshape(-1, chain.period).max(axis=0)
    site = int(np.argmax(by_site > by_site.max() - _MAX_LAST_STEP))
    return site + chain.period * int(gaps[site :: chain.period].argmax())


@kernel
def is_ordered(u, hop, gap):
    """Return True if the sites are in the order of their angles, to within rounding.

    The site `hop` places after any given site has the next larger angle; the difference of the two
    angles is `gap`.
    """
    n = u.size
    for j in range(n):
        k = j + hop
        if not u[k - n if k >= n else k] - u[j] + gap > -FLAT * n:
            return False
    return True


@kernel
def total_action(kappa, theta, u):
    """Compute A of the N sites, less the constant p²/2N."""
    n, action = u.size, 0.0
    for j in range(n):
        stretch = u[j + 1 if j < n - 1 else 0] - u[j]
        action += stretch**2 / 2 - kappa[j % kappa.size] / TWO_PI**2 * cos2pi(theta[j] + u[j])
    return action


@kernel
def _minimize_constrained(kappa, theta, hop, work, u):
    """Minimize A over all sites but x_0, in place; return True if the orbit is ordered."""
    change, _, _, _, n_bad = newton_solve(kappa, theta, u, 0, 0.0, _MAX_LAST_STEP, work)
    if n_bad and u.size <= SURE_PERIOD * kappa.size:
        # A symmetric orbit may be at rest on a saddle; half the shift between mirror images breaks
        # the symmetry.
        u[1:] += 0.25 / u.size
        change, _, _, _, n_bad = newton_solve(kappa, theta, u, 0, 0.0, _MAX_LAST_STEP, work)
    return change < _MAX_LAST_STEP and n_bad == 0 and is_ordered(u, hop, kappa.size / u.size)


@kernel
def _find_extremum(kappa, theta, hop, work, u, kind, max_step):
    """Move u to an extremum of the action, in place; return R, or NaN if no orbit is found.

    Each step of x_0 is at most max_step.
    """
    flat = FLAT * np.sqrt(u.size)
    change, curvature, slope, log_pivots, n_bad = newton_solve(
        kappa, theta, u, kind, max_step, flat, work
    )
    if flat <= change < max_step and abs(slope) < flat:
        # If the curvature is small, rounding errors in the slope alone move x_0. Fix x_0, and
        # compute S with the other sites at rest.
        change, curvature, _, log_pivots, n_bad = newton_solve(kappa, theta, u, 0, 0.0, flat, work)
    if not (change < _MAX_LAST_STEP and n_bad == 0 and (kind * curvature > 0 or kind == 0)):
        return np.nan
    if not is_ordered(u, hop, kappa.size / u.size):
        return np.nan
    size = np.exp(min(log_pivots + np.log(abs(curvature) / 4), 600.0)) if curvature != 0 else 0.0
    return -np.copysign(size, curvature)


@kernel
def _scan_gap(kappa, theta, hop, work, u, width, sites):
    """Scan a gap in steps of `width` for the lowest minimum and the highest maximum of the action.

    Returns both residues: 0 if the action is flat, NaN for an orbit that is not found. The orbits
    are written to `sites`.
    """
    left, orbit, last_orbit, flat_slope = u[0], u.copy(), u.copy(), FLAT * np.sqrt(u.size)
    residues, actions, steepest, before = np.full(2, np.nan), np.empty(2), -1.0, 0.0
    for i in range(2 * _GAP_POINTS + 1):
        for j in range(u.size if i else 0):
            last_orbit[j], orbit[j] = orbit[j], 2 * orbit[j] - last_orbit[j]
        orbit[0] = left + width * (i + 0.43)
        change, _, force, _, n_bad = newton_solve(kappa, theta, orbit, 0, 0.0, flat_slope, work)
        if not change < _MAX_LAST_STEP or n_bad or not is_ordered(orbit, hop, kappa.size / u.size):
            break  # on a cantorus the gap ends where the sites meet
        steepest = max(steepest, abs(force))
        for row in range(2):
            kind = 1 - 2 * row
            # On a cantorus the first orbit may be the minimum itself.
            is_extremum = kind * before > 0 >= kind * force if i else kind > 0
            for guess in range(2 if is_extremum else 0):
                trial = orbit.copy() if guess else last_orbit.copy()
                residue = _find_extremum(kappa, theta, hop, work, trial, kind, width)
                action = total_action(kappa, theta, trial)
                better = np.isnan(residues[row]) or kind * (action - actions[row]) < 0
                if better and not np.isnan(residue):
                    residues[row], actions[row], sites[row] = residue, action, trial
        before = force
        if i >= _GAP_POINTS and (steepest < flat_slope or not np.isnan(residues).any()):
            break
    if steepest < 0:  # no ordered orbit was found, so this is not the flat case
        return residues
    if steepest < flat_slope or (np.isnan(residues).any() and steepest <= 100 * flat_slope):
        residues[:], sites[0], sites[1] = 0.0, u, u
    return residues


@njit(nogil=True)
def _damped_step(kappa, theta, work, u, stiffness):
    """Take the step Δu that solves (H + σ) Δu = force for all sites, in place; σ = stiffness.

    The step preserves the order of any two orbits as long as H + σ is positive definite and
    max 2π|κ_n Δu_n| ≤ σ; otherwise no step is taken. Where σ is larger than the curvatures, Δu is
    proportional to 1/σ, and the geometric mean of the two sides is the smallest σ that preserves
    order. The next σ is twice this mean. Near a minimum σ falls to 0, and the steps become those of
    Newton's method.

    Returns the next σ and the largest |Δu|; the latter is inf if no step was taken.
    """
    inverse, pull, force, diagonal = work[0], work[1], work[2], work[3]
    _forces(kappa, theta, u, force, diagonal)
    diagonal += stiffness
    curvature, _, _, n_bad = _newton_step(force, diagonal, 1, 1.0, inverse, pull)
    if n_bad or not curvature > 0:
        return max(4 * stiffness, 1e-8), np.inf
    change = np.abs(force).max()
    needed = TWO_PI * np.abs(kappa).max() * change
    following = 2 * np.sqrt(needed * max(stiffness, 1e-8))
    if needed > stiffness + 1e-6:
        return following, np.inf
    u += force
    return following if following > 1e-8 else 0.0, change


@kernel
def _descend(kappa, theta, work, u):
    """Move all sites by damped steps, in place; return True if they end at a minimum."""
    stiffness = 1.5 * np.abs(kappa).max()
    for _ in range(_MAX_DESCENT_STEPS):
        last_stiffness = stiffness
        stiffness, change = _damped_step(kappa, theta, work, u, stiffness)
        if last_stiffness == 0 and change < 1e-12:
            return True
    return False


@kernel
def _saddle(kappa, theta, work, u):
    """Move all sites by Newton steps, in place, to a stationary orbit.

    Returns R if exactly one curvature of the action is negative at that orbit, NaN otherwise.
    """
    inverse, pull, force, diagonal = work[0], work[1], work[2], work[3]
    for _ in range(_MAX_NEWTON_STEPS):
        _forces(kappa, theta, u, force, diagonal)
        curvature, slope, log_pivots, n_bad = _newton_step(force, diagonal, 0, 0.0, inverse, pull)
        if curvature == 0:
            break
        force[0] = slope / curvature
        force[1:] += force[0] * pull[1:]
        change = np.abs(force).max()
        if not change < 0.1:
            break
        u += force
        if change < 1e-12:
            is_saddle = n_bad + (curvature < 0) == 1
            return (
                np.exp(min(log_pivots + np.log(abs(curvature) / 4), 600.0)) if is_saddle else np.nan
            )
    return np.nan


@kernel
def _find_pass(kappa, theta, hop, work, left, right, orbit):
    """Find the pass between two minima, write it to `orbit`, and return R.

    If there is another minimum between them, write this minimum to `orbit` and return -1; return
    NaN if neither a pass nor a minimum is found. Orbits between two adjacent minima descend to one
    or the other. Two orbits on either side of the boundary of their basins descend together, along
    the boundary, to the pass. Whenever they have moved apart, bisection brings them back together.
    """
    low, high, tolerance, n_steps = left.copy(), right.copy(), 5e-3, 0
    # Weights differ from site to site because the pass may be less symmetric than the minima.
    weights = 0.5 + 0.1 * np.cos(np.arange(left.size) ** 2)
    while n_steps < _MAX_DESCENT_STEPS:
        while np.abs(high - low).max() > tolerance:
            u = low + weights * (high - low)
            orbit[:] = u
            if not _descend(kappa, theta, work, orbit):
                low, high = u, u.copy()  # the descent stays on the boundary itself
            elif np.abs(orbit - left).max() < _MAX_LAST_STEP:
                low = u
            elif np.abs(orbit - right).max() < _MAX_LAST_STEP:
                high = u
            else:
                return -1.0
        tolerance = 1e-4  # from now on; the first bisection alone usually leads to the pass
        below = above = 1.5 * np.abs(kappa).max()
        while n_steps < _MAX_DESCENT_STEPS and np.abs(high - low).max() < 1e-2:
            orbit[:] = (low + high) / 2
            residue = _saddle(kappa, theta, work, orbit)
            # All three orbits may be equal to within rounding at most sites.
            is_between = min((orbit - left).min(), (right - orbit).min()) > -FLAT * left.size
            if residue > 0 and is_between and is_ordered(orbit, hop, kappa.size / left.size):
                return residue
            below, _ = _damped_step(kappa, theta, work, low, below)
            above, _ = _damped_step(kappa, theta, work, high, above)
            n_steps += 1
    return np.nan


@kernel
def _follow(
    start, profile, theta, hop, work, kind, begin, end, residue, u, before, last_step
):  # fmt: skip
    """Continue an orbit, in place, from s = begin to end; `before` is the orbit one step earlier.

    Returns the scale that was reached, the last step, and R. The scale differs from `end` if the
    steps became too small.
    """
    at, step, gap = begin, end - begin, profile.size / u.size
    while at != end:
        if abs(step) >= abs(end - at):
            step = end - at
        target = end if step == end - at else at + step
        ratio = step / last_step if abs(step) < 3 * abs(last_step) else 0.0
        trial = u + ratio * (u - before) if ratio != 0 else u.copy()
        kappa = start + target * profile
        trial_residue = _find_extremum(kappa, theta, hop, work, trial, kind, 0.1 * gap)
        if not np.isnan(trial_residue) and np.abs(trial - u).max() < 0.25:
            before[:], u[:], residue = u, trial, trial_residue
            at, last_step = target, step
            step *= 2
        else:
            step /= 2
            if abs(step) < 0.1 * abs(end - at) or at + step == at:
                break
    return at, last_step, residue


@njit(nogil=True)
def _newton_step(force, diagonal, kind, max_step, inverse, pull):
    """Compute Newton's step, and write it over the forces.

    The step moves all sites but x_0. Unless kind = 0, it also moves x_0 by kind·G/|S|, but at most
    by max_step. Returns S, G, ln |product of the pivots|, and the number of pivots that are not
    positive; `pull` becomes the derivative of each site with respect to x_0.
    """
    n, half = force.size, force.size // 2
    log_pivots, product, n_bad = 0.0, 1.0, 0
    # Eliminate sites from both ends to the middle: two independent chains of divisions run in
    # parallel, and take no longer than one.
    ahead = behind = 0.0, 0.0, 1.0
    for i in range(1, n - half):
        ahead, pivot = _eliminate(i, ahead, force, diagonal, inverse, pull)
        product, n_bad = product * pivot, n_bad + (not pivot > FLAT)
        if i < half:
            behind, pivot = _eliminate(n - i, behind, force, diagonal, inverse, pull)
            product, n_bad = product * pivot, n_bad + (not pivot > FLAT)
        if not 1e-200 < abs(product) < 1e200:
            log_pivots, product = log_pivots + np.log(abs(product)), 1.0
    if n > 1:
        middle, ends = n - half, (ahead[0] + behind[0], ahead[1] + behind[1], ahead[2] + behind[2])
        (_, step, along), pivot = _eliminate(middle, ends, force, diagonal, inverse, pull)
        log_pivots = log_pivots + np.log(abs(product * pivot))
        n_bad += not pivot > FLAT
        force[middle], pull[middle] = step, along
        back, back_along = step, along
        for i in range(middle - 1, 0, -1):
            step, along = (force[i] + step) * inverse[i], (pull[i] + along) * inverse[i]
            force[i], pull[i] = step, along
            if i < half:
                j = n - i
                back, back_along = (
                    (force[j] + back) * inverse[j],
                    (pull[j] + back_along) * inverse[j],
                )
                force[j], pull[j] = back, back_along
        curvature = diagonal[0] - (pull[1] + pull[n - 1])
        slope = force[0] + (force[1] + force[n - 1])
    else:
        curvature, slope = diagonal[0] - 2, force[0]  # x_0 is its own neighbour on both sides
    step = 0.0
    if kind != 0 and curvature != 0:
        step = min(max(kind * slope / abs(curvature), -max_step), max_step)
    force[0] = step
    for j in range(1, n):
        force[j] += pull[j] * step
    return curvature, slope, log_pivots, n_bad


@njit(nogil=True)
def _eliminate(j, before, force, diagonal, inverse, pull):
    """Eliminate site j after its neighbour, whose (1/pivot, force/pivot, pull/pivot) is `before`.

    Returns the same three quotients for site j, and its pivot.
    """
    pivot = diagonal[j] - before[0]
    force[j] += before[1]
    pull[j], inverse[j] = before[2], 1 / pivot if abs(pivot) > FLAT else 1.0
    return (inverse[j], force[j] * inverse[j], pull[j] * inverse[j]), pivot


@kernel
def newton_solve(kappa, theta, u, kind, max_step, tolerance, work):
    """Repeat `_newton_step`, in place, until no site moves by more than `tolerance`.

    The steps also end where rounding errors prevent smaller ones. Returns the largest change in the
    last step, followed by what `_newton_step` returns.
    """
    n = u.size
    # Numba treats rows unpacked in one assignment as strided, and would not vectorize the loops.
    inverse, pull, force, diagonal = work[0], work[1], work[2], work[3]
    change, last_change, curvature, slope, log_pivots, n_bad = np.inf, np.inf, 0.0, 0.0, 0.0, 0
    stiffness = 0.0  # added to the Hessian while the action is not convex
    for _ in range(_MAX_NEWTON_STEPS):
        _forces(kappa, theta, u, force, diagonal)
        for j in range(1, n if stiffness else 0):
            diagonal[j] += stiffness
        curvature, slope, log_pivots, n_bad = _newton_step(
            force, diagonal, kind, max_step, inverse, pull
        )
        if n_bad:
            stiffness = max(8 * stiffness, 1e-4)
            continue
        is_free = stiffness == 0
        stiffness = stiffness / 8 if stiffness > 1e-6 else 0.0
        change = 0.0
        for j in range(n):
            change = max(change, abs(force[j]))
        if not change < 1e3:
            return np.inf, curvature, slope, log_pivots, n
        fraction = 0.1 / change if change > 0.1 else 1.0
        for j in range(n):
            u[j] += fraction * force[j]
        is_at_rest = change < _MAX_LAST_STEP and change >= 0.5 * last_change
        if is_free and (change < tolerance or is_at_rest):
            break
        last_change = change
    return change, curvature, slope, log_pivots, n_bad


@njit(nogil=True)
def _forces(kappa, theta, u, force, diagonal):
    """Write the force on each site, and the diagonal of the Hessian, into two vectors."""
    n, period = u.size, kappa.size
    _sines(theta, u, force, diagonal)
    site, behind, centre = 0, u[n - 1], u[0]
    for j in range(n):
        ahead, strength = u[j + 1] if j < n - 1 else u[0], kappa[site]
        force[j] = (ahead - centre) - (centre - behind) - strength / TWO_PI * force[j]
        diagonal[j] = 2 + strength * diagonal[j]
        behind, centre = centre, ahead
        site = site + 1 if site < period - 1 else 0


@njit(nogil=True)
def _sines(theta, u, sine, cosine):
    """Write sin and cos of 2πx into vectors, in a separate loop that can be vectorized."""
    for j in range(u.size):
        x = theta[j] + u[j]
        sine[j], cosine[j] = sin2pi(x), cos2pi(x)


@kernel
def _refined_residue(kappa, numerators, u, work):
    """Compute R in double-double arithmetic.

    Newton steps with forces in double-double arithmetic come first; R then follows from the trace
    of the product of all tangent maps.
    """
    n, period = u.size, kappa.size
    inverse, pull, force, diagonal = work[0], work[1], work[2], work[3]
    u, low, slopes, bends = u.copy(), np.zeros(n), np.empty((2, n)), np.empty(n)
    for _ in range(_MAX_NEWTON_STEPS):
        for j in range(n):
            ahead, behind = j + 1 if j < n - 1 else 0, j - 1 if j else n - 1
            strength = kappa[j % period]
            turns = divided(float(numerators[j]), float(n))
            sine, cosine = sincos_2pi(add(turns, (u[j], low[j])))
            kick = multiply(multiply((strength, 0.0), INVERSE_TWO_PI), sine)
            remainder = add((u[ahead], low[ahead]), (u[behind], low[behind]))
            remainder = add(remainder, (-2 * u[j], -2 * low[j]))
            force[j] = add(remainder, (-kick[0], -kick[1]))[0]
            diagonal[j] = 2 + strength * cosine[0]
            slopes[0, j], slopes[1, j] = multiply((strength, 0.0), cosine)
            bends[j] = -TWO_PI * strength * sine[0]
        curvature, remainder, _, _ = _newton_step(force, diagonal, 0, 0.0, inverse, pull)
        step = remainder / curvature if curvature != 0 else 0.0
        largest_change = abs(step)
        for j in range(n):
            change = step if j == 0 else force[j] + pull[j] * step
            u[j], low[j] = add((u[j], low[j]), (change, 0.0))
            slopes[0, j], slopes[1, j] = add((slopes[0, j], slopes[1, j]), (bends[j] * change, 0.0))
            largest_change = max(largest_change, abs(change))
        if largest_change < 1e-12:  # convergence is quadratic, so the next change is negligible
            break
    x_x, y_x, x_y, y_y = (1.0, 0.0), (0.0, 0.0), (0.0, 0.0), (1.0, 0.0)
    for j in range(n):
        slope = slopes[0, j], slopes[1, j]
        y_x, y_y = add(y_x, multiply(slope, x_x)), add(y_y, multiply(slope, x_y))
        x_x, x_y = add(x_x, y_x), add(x_y, y_y)
    trace = add(x_x, y_y)
    return add((2.0, 0.0), (-trace[0], -trace[1]))[0] / 4
