"""The ordered periodic orbits of any forcing, by the action; no symmetry is needed.

An orbit is a chain of sites, one per kick,

    x_{n+1} - 2 x_n + x_{n-1} = (κ_n / 2π) sin 2πx_n,     y_n = x_n - x_{n-1},

and one of rotation number p/q has N = Pq sites, x_n = np/N + u_n. Such orbits are where the action

    A = Σ_n (x_{n+1} - x_n)²/2 - (κ_n/4π²) cos 2πx_n,        x_{n+N} = x_n + p,

is stationary. Eliminate all sites but x_0, which minimize A for a given x_0. That leaves the
*reduced action* a(x_0), with

    a' = -G,    a'' = S,    R = -S Π(pivots)/4,

where G is the force on x_0, S the Schur complement of the other sites in the Hessian, which is
tridiagonal, and the pivots those of the elimination. One sweep from both ends to the middle and one
back gives all three, and Newton's step of the other sites. Of every p/q two orbits are ordered like
a rotation: the *minimizing* one, R < 0, at the minimum of a, and the *minimax* one, R > 0, at its
maximum over the gap between the minimizing orbit and its neighbour. As x_0 moves by ±G/|S|, one
rule finds both.

1. *Climb.* With x_0 held, the orbit of each convergent of ω is that of the last one, repeated, and
   the last but one, joined end to end, up to a few of Newton's steps. So long orbits are reached at
   each forcing by itself, and where residues pass through 0 nothing is lost.
2. *Scan.* Begin the orbit where its gap is widest, and move x_0 over that gap. The highest maximum
   of a is the minimax orbit, whichever symmetry line it is on, or on none.
3. *Descend.* Where that fails, as with steep actions of several minima, or with maxima that no
   single site shows, periods up to 100 are found as it is shown that they exist: orbits that yield
   to the forces on their sites never cross. They come down to minima, and the pass between two of
   these is on the border of their basins.
4. *Follow.* Orbits are then moved along the segment of forcings by Newton's method, and longer ones
   joined from them.

Deviations u are stored, so that rounding does not grow with x.

Aubry & Le Daeron, Physica D 8 (1983) 381; Mather, Comment. Math. Helv. 60 (1985) 508.
"""

from fractions import Fraction
from functools import cached_property

import numpy as np
from numba import njit

from nasm.arithmetic.double_double import INVERSE_TWO_PI, add, divided, multiply, sincos_2pi
from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import MAX_DENOMINATOR as MAX_PERIOD
from nasm.checks import count
from nasm.maps import TWO_PI, forcing
from nasm.numbers import distinct_convergents, rational

__all__ = ["Chain", "Ladder", "LostError", "Orbit", "is_ordered", "joined", "ordered_orbits"]
__all__ += ["relax", "total"]

SURE_PERIOD = 100
"""Up to this period orbits that no scan finds are found by descent."""

FLAT = 1e-15
"""Slopes of the reduced action below this times √N are rounding: R cannot be told from 0."""

_ROUNDING = 1e-12  # of the distance of two sites
_FOUND = 1e-7  # turns: a larger last step of Newton's method has found nothing,
_STILL = 1e-11  # and a smaller one has left the curvature as it was
_STEPS = 60
_PLACES = 12  # of x_0 in a gap
_AS_WIDE = 0.99  # of the widest gap: gaps that are equal up to rounding begin at the first site
_NEAR = 0.3  # over q, of the largest strength: how far an orbit is followed
_FURTHEST = 0.8  # over the longer period: a step of x_0 where orbits are joined. Of 5030 orbits
# that one length of steps or another found, 0.1 lost 398, going to and fro, 0.4 266, and 0.8 178.
_JOINED = 300  # period from which orbits are joined from shorter ones rather than scanned for
_HELD = 600  # sites: an orbit this short is found again from none at all
_ASIDE = 0.05  # over q: how far sites are moved from a saddle of the action
_DESCENT = 1000  # steps from where an orbit is left to where it rests
_MINIMA = 20  # in a gap,
_SAME = 1e-6  # turns apart, or they are one
_KEPT = 30  # scales of which orbits are kept


class LostError(Exception):
    """The ordered orbits of a fraction were not found, or lost on the way; the text says why.

    They exist under any forcing. Long ones are lost far beyond the breakup of the circles near p/q;
    short ones ought to be found, so that their loss says nothing of circles.

    period : int, q; 0 if the loss is not that of one fraction.
    """

    def __init__(self, message, period=0):
        super().__init__(message)
        self.period = period

    @property
    def is_far_beyond(self):
        """Whether the loss shows that the circles near p/q are broken, by much."""
        return self.period > SURE_PERIOD


class Ladder:
    """Ordered orbits of a list of fractions on the segment of forcings κ = start + s·profile.

    start, profile : arrays of P floats. fractions : consecutive convergents of a number, as
    Fractions, q increasing. climbed : dict, {} at first, in which ladders on one segment leave each
    other what they have climbed to. known : Orbits on that segment, if there are any.
    """

    def __init__(self, start, profile, fractions, climbed=None, known=()):
        self.start, self.profile = start, profile
        self.chains = [Chain(profile.size, fraction) for fraction in fractions]
        self._climbed = {} if climbed is None else climbed
        self._latest = {(orbit.chain.p, orbit.chain.q, orbit.kind): orbit for orbit in known}
        self._scale, self._answers = None, {}
        self._near = _NEAR / np.abs(profile).max(initial=1e-300)

    def at(self, n, scale, kind):
        """The Orbit of fraction n: minimizing (kind = 1) or minimax (-1).

        R is 0 where it cannot be told from 0. LostError if the orbit is not found.
        """
        # Each is joined from two before it, which are joined in their turn: none twice.
        if scale != self._scale:
            self._scale, self._answers = scale, {}
        if (n, kind) not in self._answers:
            try:
                self._answers[n, kind] = self._at(n, scale, kind)
            except LostError as lost:
                self._answers[n, kind] = lost
        answer = self._answers[n, kind]
        if isinstance(answer, LostError):
            raise answer
        return answer

    def _at(self, n, scale, kind):
        p, q = self.chains[n].p, self.chains[n].q
        orbit = self._latest.get((p, q, kind))
        if orbit and abs(scale - orbit.scale) < self._near / q and orbit.move(scale):
            return orbit
        found = self._joined(n, scale, kind) if q > _JOINED and n > 1 else None
        found = {kind: found} if found else self.scan(n, scale)
        if found[kind].residue != 0:
            self._latest.update({(p, q, key): orbit for key, orbit in found.items()})
        return found[kind]

    def scan(self, n, scale):
        """{1: the minimizing Orbit, -1: the minimax one} of fraction n, as by `at`, by steps 1 to 3
        at this very scale."""
        chain = self.chains[n]
        try:
            site, sites, residues = self._scanned(n, scale)
        except LostError:
            if chain.q > SURE_PERIOD:
                raise
            site, sites, residues = _descended(self.start + scale * self.profile, chain)
        segment = _around(self.start, site), _around(self.profile, site)
        return {
            kind: Orbit(chain, segment, site, kind, *orbit, scale)
            for kind, *orbit in zip((1, -1), sites, residues, strict=True)
        }

    def _scanned(self, n, scale):
        """The first site, the deviations and the residues of both orbits, by steps 1 and 2."""
        chain, (site, u) = self.chains[n], self._begun(n, scale)
        first = _widest(chain, _around(u, -site)) - site
        site, u = (site + first) % chain.period, chain.rolled(u, first)
        kappa = _around(self.start + scale * self.profile, site)
        found, width = np.empty((2, u.size)), (chain.right(u)[0] - u[0]) / _PLACES
        residues = _scan(kappa, *chain.frame, u, width, found)
        if np.isnan(residues).any():
            raise chain.lost("no minimum or no maximum of the action is in their gap")
        return site, found, residues

    def _begun(self, n, scale):
        """(site, u) of an orbit of fraction n to scan from: by `held`, or where that is lost, far
        beyond the breakup, the minimizing one of the cantorus, by those before."""
        try:
            return self.held(n, scale)
        except LostError:
            found = self._joined(n, scale, 1) if n > 1 else None
            if found is None:
                raise
            return found.site, found.u

    def held(self, n, scale):
        """(site, u) of an orbit of fraction n that minimizes the action with x held at `site`."""
        if scale not in self._climbed:
            if len(self._climbed) >= _KEPT:
                del self._climbed[next(iter(self._climbed))]
            kappa = self.start + scale * self.profile
            site = int(np.abs(kappa).argmax())
            self._climbed[scale] = _around(kappa, site), site, {}
        kappa, site, orbits = self._climbed[scale]
        for i, chain in enumerate(self.chains[: n + 1]):
            if (chain.p, chain.q) in orbits:
                continue
            held = np.full(chain.n_sites, 0.0 if kappa[0] > 0 else 0.5)
            before = [(at, orbits[at.p, at.q]) for at in self.chains[max(i - 2, 0) : i]]
            if i > 1:
                u = chain.joined(*before)
            else:
                u = np.resize(before[0][1], chain.n_sites) if i else held.copy()
            if not _hold(kappa, *chain.frame, u):
                lost = chain.lost("none is ordered with one site held")
                if chain.n_sites > _HELD:
                    raise lost
                u = held
                for part in np.arange(1, 9) / 8:
                    if not _hold(part * kappa, *chain.frame, u):
                        raise lost
            orbits[chain.p, chain.q] = u
        return site, orbits[self.chains[n].p, self.chains[n].q]

    def _joined(self, n, scale, kind):
        last, one = (self.at(i, scale, kind) for i in (n - 2, n - 1))
        return joined(last, one, self.chains[n], kind)


def joined(last, one, chain, kind):
    """The Orbit of a kind, 1 or -1, that two of Farey neighbours, `last` and as often as it takes
    `one`, make end to end where these are; None if that fails. chain : Chain of that Orbit."""
    longer = max(last.chain.q, one.chain.q)
    for u_last in [last.u] * (last.site == one.site) + [last.beginning_like(one)]:
        u = chain.joined((last.chain, u_last), (one.chain, one.u))
        _hold(one.kappa, *chain.frame, u)
        residue = _settle(one.kappa, *chain.frame, u, kind, _FURTHEST / longer, _STEPS)
        if not np.isnan(residue):
            segment = one.start, one.profile
            return Orbit(chain, segment, one.site, kind, u, residue, one.scale)
    return None


class Orbit:
    """An ordered periodic orbit on a segment, at the scale last moved to.

    kind : 1 if it is minimizing, -1 if minimax, 0 if x_0 is held, where a symmetry keeps it.
    site : int, 0 to P - 1, of the first of its sites. u : ndarray (N,), their deviations.
    residue : R, good to about N² ulp.
    """

    def __init__(self, chain, segment, site, kind, u, residue, scale):
        self.chain, (self.start, self.profile) = chain, segment
        self.site, self.kind, self.u, self.scale, self.residue = site, kind, u, scale, residue
        self._before, self._step = np.empty_like(u), 0.0

    @property
    def kappa(self):
        """The forcing, from `site` on."""
        return self.start + self.scale * self.profile

    def refined_residue(self):
        """R good to the last digits, in double-double arithmetic."""
        chain = self.chain
        return _refined_residue(self.kappa, chain.numerators, self.u, chain.frame[2])

    def sites(self):
        """x of all N sites from `site` on, on the lift."""
        return np.arange(self.u.size) * (self.chain.p / self.u.size) + self.u

    def beginning_like(self, other):
        """u from the site on that is nearest to the other orbit's first one."""
        first = (other.site - self.site) % self.start.size
        sites = slice(first, None, self.start.size)
        away = self.chain.theta[sites] + self.u[sites] - other.u[0]
        nearest = np.abs(away - np.rint(away)).argmin()
        return self.chain.rolled(self.u, first + self.start.size * int(nearest))

    def points(self):
        """x, y at the start of each of the q periods, in time, x on the lift."""
        x = self.sites()
        starts = slice(-self.site % self.start.size, None, self.start.size)
        return x[starts], np.diff(x, prepend=x[-1] - self.chain.p)[starts]

    def move(self, scale):
        """Continue the orbit to that scale, itself; whether it got there, and did not have to
        shrink its steps too much."""
        self.scale, self._step, self.residue = _follow(
            self.start, self.profile, *self.chain.frame, self.kind,
            self.scale, scale, self.residue, self.u, self._before, self._step,
        )  # fmt: skip
        return self.scale == scale


class Chain:
    """What orbits of p/q under forcings of P kicks have in common."""

    def __init__(self, period, fraction):
        self.period, self.p, self.q = period, fraction.numerator, fraction.denominator
        self.n_sites = period * self.q

    @cached_property
    def numerators(self):
        """The rotation's angles in units of 1/N, reduced mod N: exact for any length."""
        return np.arange(self.n_sites) * (self.p % self.n_sites) % self.n_sites

    @cached_property
    def frame(self):
        """What kernels take: the same angles in turns, the sites to the next one, and room."""
        hop = self.period * (pow(self.p, -1, self.q) if self.q > 1 else 0)
        return self.numerators / self.n_sites, hop, np.empty((4, self.n_sites))

    @property
    def theta(self):
        return self.frame[0]

    def lost(self, reason):
        """The LostError of these orbits."""
        return LostError(
            f"the ordered orbits of {self.p}/{self.q} were not found: {reason}", self.q
        )

    def right(self, u):
        """The next orbit to the right: the same one, at another time."""
        return _around(u, self.frame[1]) + 1 / self.q

    def rolled(self, u, first):
        """The orbit from site `first` on; x_0 in [-1/2, 1/2]."""
        u = _around(u, first) + self.theta[first % self.n_sites]
        return u - np.rint(u[0])

    def joined(self, last, one):
        """Deviations of the orbits of two fractions, `one` repeated and then `last`, end to end,
        from the rotation of this fraction, their sum."""
        (before, u_before), (chain, u) = last, one
        copies = (self.q - before.q) // chain.q
        drift, drift_before = (
            (other.p * self.q - self.p * other.q) / (self.n_sites * other.q)
            for other in (chain, before)
        )
        sites = np.arange(copies * u.size)
        end = sites.size * drift + u_before + np.arange(u_before.size) * drift_before
        return np.concatenate([np.tile(u, copies) + sites * drift, end])


def ordered_orbits(kappa, p, q, climbed=None):
    """The two ordered orbits of rotation number p/q per period.

    kappa : sequence of P floats, the forcing, first kick first.
    p, q : ints without common factor, 1 ≤ q ≤ 10⁶.
    climbed : dict, {} at first: where one call leaves the next what it has found on its way.

    Returns minimizing, minimax : Orbit, both from the same site on, in the gap that is widest
    there. Where R cannot be told from 0 both are one orbit of those that differ by rounding.

    LostError if they are not found. Both exist under any forcing, and are found up to twice the
    breakup of the last circle; far beyond the breakup of all circles near p/q, periods above 100
    may be lost.
    """
    kappa, q = forcing(kappa), count("q", q, 1, MAX_PERIOD)
    p = count("p", p, -MAX_PERIOD * kappa.size, MAX_PERIOD * kappa.size)
    if np.gcd(p, q) != 1:
        raise ValueError(f"p/q = {p}/{q} has a common factor; write it in lowest terms")
    fractions = distinct_convergents(rational(Fraction(p, q)), q)
    found = Ladder(kappa, 0 * kappa, fractions, climbed).scan(len(fractions) - 1, 0.0)
    return found[1], found[-1]


def _descended(kappa, chain):
    """The first site, the deviations and the residues of both orbits, by step 3."""
    theta, hop, work = chain.frame
    # No symmetry keeps this rotation: it is not at rest on the border of two basins.
    u = np.full(chain.n_sites, 0.3 / chain.q)
    lost = chain.lost(f"they are not at rest after a descent of {_DESCENT} steps")
    if not _descend(kappa, theta, work, u):
        raise lost
    first = _widest(chain, u)
    kappa, u = _around(kappa, first), chain.rolled(u, first)
    minima, passes = [u, chain.right(u)], []
    while len(passes) < len(minima) - 1:
        middle, n = np.empty(chain.n_sites), len(passes)
        residue = _pass(kappa, theta, hop, work, *minima[n : n + 2], middle)
        if residue > 0:
            passes.append((middle, residue))
        elif residue < 0 and len(minima) < _MINIMA:
            minima.insert(n + 1, middle)
        else:
            raise lost
    lowest, highest = (
        int(np.argmin([sign * total(kappa, theta, u) for u in orbits]))
        for sign, orbits in ((1, minima[:-1]), (-1, [u for u, _ in passes]))
    )
    minimizing, (minimax, residue) = minima[lowest], passes[highest]
    if highest < lowest:
        minimax = chain.right(minimax)
    least = _settle(kappa, theta, hop, work, minimizing, 1, 0.1 / chain.q, _STEPS)
    if np.isnan(least):
        raise lost
    return first % chain.period, (minimizing, minimax), (least, residue)


def _around(u, first):
    """u from place `first` on, and around to it; np.roll takes five times as long."""
    first %= u.size
    return np.concatenate((u[first:], u[:first]))


def _widest(chain, u):
    """The site of the widest gap, the first of those that are as wide."""
    gaps = chain.right(u) - u
    by_site = gaps.reshape(-1, chain.period).max(axis=0)
    site = int(np.argmax(by_site >= _AS_WIDE * by_site.max()))
    return site + chain.period * int(gaps[site :: chain.period].argmax())


@kernel
def is_ordered(u, hop, gap):
    """Whether sites whose angles differ by the least, `gap`, `hop` sites apart, keep their order,
    as far as rounding can tell."""
    n = u.size
    for j in range(n):
        k = j + hop
        if not u[k - n if k >= n else k] - u[j] + gap > -_ROUNDING:
            return False
    return True


@kernel
def total(kappa, theta, u):
    """A over the N sites, less the constant p²/2N."""
    n, action = u.size, 0.0
    for j in range(n):
        stretch = u[j + 1 if j < n - 1 else 0] - u[j]
        action += stretch**2 / 2 - kappa[j % kappa.size] / TWO_PI**2 * cos2pi(theta[j] + u[j])
    return action


@kernel
def _hold(kappa, theta, hop, work, u):
    """Minimize the action over all sites but x_0, in place; whether that is an ordered orbit."""
    largest, _, _, _, bad = relax(kappa, theta, u, 0, 0.0, _STEPS, work)
    if bad and u.size <= _HELD:  # a symmetric guess stays on a saddle: no force pulls it aside
        u[1:] += _ASIDE * kappa.size / u.size
        largest, _, _, _, bad = relax(kappa, theta, u, 0, 0.0, _STEPS, work)
    return largest < _FOUND and bad == 0 and is_ordered(u, hop, kappa.size / u.size)


@kernel
def _settle(kappa, theta, hop, work, u, kind, furthest, n_steps):
    """Move to the extremum, in place, x_0 at most so far a step: R, NaN if no orbit is there."""
    largest, curvature, left, logarithm, bad = relax(kappa, theta, u, kind, furthest, n_steps, work)
    if _STILL <= largest < furthest and abs(left) < FLAT * np.sqrt(u.size):
        # Of a small curvature even a slope that is rounding moves x_0: it stays where it is now,
        # and S is that of sites at rest.
        largest, curvature, _, logarithm, bad = relax(kappa, theta, u, 0, 0.0, n_steps, work)
    if not (largest < _FOUND and bad == 0 and (kind * curvature > 0 or kind == 0)):
        return np.nan
    if not is_ordered(u, hop, kappa.size / u.size):
        return np.nan
    size = np.exp(min(logarithm + np.log(abs(curvature) / 4), 600.0)) if curvature != 0 else 0.0
    return -np.copysign(size, curvature)


@kernel
def _scan(kappa, theta, hop, work, u, width, found):
    """Residues of the lowest minimum and the highest maximum that x_0 meets in steps of that width;
    0 if the action is flat, NaN if none is met. Their sites are left in `found`."""
    left, at, last, flat = u[0], u.copy(), u.copy(), FLAT * np.sqrt(u.size)
    residues, actions, steepest, before = np.full(2, np.nan), np.empty(2), -1.0, 0.0
    for i in range(2 * _PLACES + 1):
        for j in range(u.size if i else 0):
            last[j], at[j] = at[j], 2 * at[j] - last[j]
        at[0] = left + width * (i + 0.43)
        largest, _, force, _, bad = relax(kappa, theta, at, 0, 0.0, _STEPS, work)
        if not largest < _FOUND or bad or not is_ordered(at, hop, kappa.size / u.size):
            break  # on a cantorus the gap ends where the sites meet
        steepest = max(steepest, abs(force))
        for row in range(2):
            kind = 1 - 2 * row
            # The first orbit, on a cantorus, may be the minimum itself.
            met = kind * before > 0 >= kind * force if i else kind > 0
            for guess in range(2 if met else 0):
                trial = at.copy() if guess else last.copy()
                residue = _settle(kappa, theta, hop, work, trial, kind, width, _STEPS)
                action = total(kappa, theta, trial)
                better = np.isnan(residues[row]) or kind * (action - actions[row]) < 0
                if better and not np.isnan(residue):
                    residues[row], actions[row], found[row] = residue, action, trial
        before = force
        if i >= _PLACES and (steepest < flat or not np.isnan(residues).any()):
            break
    if steepest < 0:  # not one orbit is ordered: that is no flat action
        return residues
    if steepest < flat or (np.isnan(residues).any() and steepest <= 100 * flat):
        residues[:], found[0], found[1] = 0.0, u, u
    return residues


@njit(nogil=True)
def _yield(kappa, theta, work, u, stiffness):
    """A step (H + σ) Δu = force of all sites, in place; σ = stiffness.

    It keeps the order of any two orbits as long as H + σ is positive definite and 2π|κ_n Δu_n| < σ.
    Otherwise there is no step but a larger σ. Next to a minimum σ falls to 0, which is Newton's.

    Returns the next σ, and the largest Δu; inf without a step.
    """
    inverse, pull, force, diagonal = work[0], work[1], work[2], work[3]
    _forces(kappa, theta, u, force, diagonal)
    diagonal += stiffness
    curvature, _, _, bad = _solve(force, diagonal, 1, 1.0, inverse, pull)
    largest = np.abs(force).max()
    if bad or not curvature > 0 or TWO_PI * np.abs(kappa).max() * largest > stiffness + 1e-6:
        return max(4 * stiffness, 1e-8), np.inf
    u += force
    return stiffness / 4 if stiffness > 1e-8 else 0.0, largest


@kernel
def _descend(kappa, theta, work, u):
    """Let all sites yield to the forces on them, in place; whether that ends at a minimum."""
    stiffness = 1.5 * np.abs(kappa).max()
    for _ in range(_DESCENT):
        used = stiffness
        stiffness, largest = _yield(kappa, theta, work, u, stiffness)
        if used == 0 and largest < 1e-12:
            return True
    return False


@kernel
def _saddle(kappa, theta, work, u):
    """Newton's steps of all sites, in place, to a stationary orbit: its R if the action has one
    negative curvature there, NaN otherwise."""
    inverse, pull, force, diagonal = work[0], work[1], work[2], work[3]
    for _ in range(20):
        _forces(kappa, theta, u, force, diagonal)
        curvature, left, logarithm, bad = _solve(force, diagonal, 0, 0.0, inverse, pull)
        if curvature == 0:
            break
        force[0] = left / curvature
        force[1:] += force[0] * pull[1:]
        largest = np.abs(force).max()
        if not largest < 0.1:
            break
        u += force
        if largest < 1e-12:
            one = bad + (curvature < 0) == 1
            return np.exp(min(logarithm + np.log(abs(curvature) / 4), 600.0)) if one else np.nan
    return np.nan


@kernel
def _pass(kappa, theta, hop, work, left, right, found):
    """The pass between two minima, in `found`, and its R; or another minimum between them, and -1;
    or NaN, if neither is found.

    Orbits between them descend to the one or the other. From the border of the basins, found by
    bisection, the way down leads past the pass.
    """
    low, high = left.copy(), right.copy()
    # Not all sites at the same part of the way: the pass may be less symmetric than the minima.
    part = 0.5 + 0.1 * np.cos(np.arange(left.size) ** 2)
    u, close = left, 1e-4
    while close > 1e-16:
        while np.abs(high - low).max() > close:
            u = low + part * (high - low)
            found[:] = u
            if not _descend(kappa, theta, work, found):
                break  # it rests on the border itself
            if np.abs(found - left).max() < _SAME:
                low = u
            elif np.abs(found - right).max() < _SAME:
                high = u
            else:
                return -1.0
        stiffness, way = 1.5 * np.abs(kappa).max(), u.copy()
        for _ in range(_DESCENT):
            found[:] = way
            residue = _saddle(kappa, theta, work, found)
            between = (left < found).all() and (found < right).all()
            if residue > 0 and between and is_ordered(found, hop, kappa.size / left.size):
                return residue
            stiffness, largest = _yield(kappa, theta, work, way, stiffness)
            if stiffness == 0 and largest < 1e-6:
                break
        close /= 1000
    return np.nan


@kernel
def _follow(
    start, profile, theta, hop, work, kind, begin, end, residue, u, before, last_step
):  # fmt: skip
    """Continue an orbit, in place, from s = begin to end; `before` is what it was a step before.

    Returns the scale that was reached, short of the end if steps became too small; the last step;
    and R.
    """
    at, step, gap = begin, end - begin, profile.size / u.size
    while at != end:
        if abs(step) >= abs(end - at):
            step = end - at
        target = end if step == end - at else at + step
        ratio = step / last_step if abs(step) < 3 * abs(last_step) else 0.0
        trial = u + ratio * (u - before) if ratio != 0 else u.copy()
        kappa = start + target * profile
        found = _settle(kappa, theta, hop, work, trial, kind, 0.1 * gap, 30)
        if not np.isnan(found) and np.abs(trial - u).max() < 0.25:
            before[:], u[:], residue = u, trial, found
            at, last_step = target, step
            step *= 2
        else:
            step /= 2
            if abs(step) < 0.1 * abs(end - at) or at + step == at:
                break
    return at, last_step, residue


@njit(nogil=True)
def _solve(force, diagonal, kind, furthest, inverse, pull):
    """Newton's step, in place of the forces: of all sites with x_0 held (kind = 0), or moved by
    kind·G/|S|, at most `furthest`.

    Returns S, G, ln |product of the pivots|, and how many of these are not positive. After it
    `pull` is how far each site moves with x_0.
    """
    n, half = force.size, force.size // 2
    logarithm, product, bad = 0.0, 1.0, 0
    # From both ends to the middle: two chains of divisions take no longer than one.
    ahead = behind = 0.0, 0.0, 1.0
    for i in range(1, n - half):
        ahead, pivot = _eliminate(i, ahead, force, diagonal, inverse, pull)
        product, bad = product * pivot, bad + (not pivot > _ROUNDING)
        if i < half:
            behind, pivot = _eliminate(n - i, behind, force, diagonal, inverse, pull)
            product, bad = product * pivot, bad + (not pivot > _ROUNDING)
        if not 1e-200 < abs(product) < 1e200:
            logarithm, product = logarithm + np.log(abs(product)), 1.0
    if n > 1:
        middle, ends = n - half, (ahead[0] + behind[0], ahead[1] + behind[1], ahead[2] + behind[2])
        (_, step, along), pivot = _eliminate(middle, ends, force, diagonal, inverse, pull)
        logarithm = logarithm + np.log(abs(product * pivot))
        bad += not pivot > _ROUNDING
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
        left = force[0] + (force[1] + force[n - 1])
    else:
        curvature, left = diagonal[0] - 2, force[0]  # its own neighbour on both sides
    step = 0.0
    if kind != 0 and curvature != 0:
        step = min(max(kind * left / abs(curvature), -furthest), furthest)
    force[0] = step
    for j in range(1, n):
        force[j] += pull[j] * step
    return curvature, left, logarithm, bad


@njit(nogil=True)
def _eliminate(j, before, force, diagonal, inverse, pull):
    """Eliminate site j, after the one next to it, `before`: 1/pivot, and that times force and pull.
    Returns the same of site j, and the pivot."""
    pivot = diagonal[j] - before[0]
    force[j] += before[1]
    pull[j], inverse[j] = before[2], 1 / pivot if abs(pivot) > _ROUNDING else 1.0
    return (inverse[j], force[j] * inverse[j], pull[j] * inverse[j]), pivot


@kernel
def relax(kappa, theta, u, kind, furthest, n_steps, work):
    """Steps of `_solve`, in place, until rounding ends them.

    Returns the largest change of the last step, S, G, and the rest as `_solve`.
    """
    n = u.size
    # Rows that are unpacked at once are strided to Numba, and no loop takes many of them at once.
    inverse, pull, force, diagonal = work[0], work[1], work[2], work[3]
    largest, last, curvature, left, logarithm, bad = np.inf, np.inf, 0.0, 0.0, 0.0, 0
    stiffness = 0.0  # where the action is not convex, springs to where the sites are
    for _ in range(n_steps):
        _forces(kappa, theta, u, force, diagonal)
        for j in range(1, n if stiffness else 0):
            diagonal[j] += stiffness
        curvature, left, logarithm, bad = _solve(force, diagonal, kind, furthest, inverse, pull)
        if bad:
            stiffness = max(8 * stiffness, 1e-4)
            continue
        relaxed = stiffness == 0
        stiffness = stiffness / 8 if stiffness > 1e-6 else 0.0
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(force[j]))
        if not largest < 1e3:
            return np.inf, curvature, left, logarithm, n
        part = 0.1 / largest if largest > 0.1 else 1.0
        for j in range(n):
            u[j] += part * force[j]
        if relaxed and (largest < 1e-15 + 2e-16 * n or (largest < 1e-8 and largest >= 0.5 * last)):
            break
        last = largest
    return largest, curvature, left, logarithm, bad


@njit(nogil=True)
def _forces(kappa, theta, u, force, diagonal):
    """The force on each site, and the diagonal of the Hessian, into two vectors."""
    n, period = u.size, kappa.size
    _sines(theta, u, force, diagonal)
    site, behind, here = 0, u[n - 1], u[0]
    for j in range(n):
        ahead, strength = u[j + 1] if j < n - 1 else u[0], kappa[site]
        force[j] = (ahead - here) - (here - behind) - strength / TWO_PI * force[j]
        diagonal[j] = 2 + strength * diagonal[j]
        behind, here = here, ahead
        site = site + 1 if site < period - 1 else 0


@njit(nogil=True)
def _sines(theta, u, sine, cosine):
    """sin and cos of 2πx into vectors; in a loop of its own the compiler takes many at once."""
    for j in range(u.size):
        x = theta[j] + u[j]
        sine[j], cosine[j] = sin2pi(x), cos2pi(x)


@kernel
def _refined_residue(kappa, numerators, u, work):
    """R of the orbit that floats have found: Newton's steps with forces in double-double, then the
    trace of the product of all tangent maps in the same."""
    n, period = u.size, kappa.size
    inverse, pull, force, diagonal = work[0], work[1], work[2], work[3]
    u, low, slopes, bends = u.copy(), np.zeros(n), np.empty((2, n)), np.empty(n)
    for _ in range(8):
        for j in range(n):
            ahead, behind = j + 1 if j < n - 1 else 0, j - 1 if j else n - 1
            strength = kappa[j % period]
            turns = divided(float(numerators[j]), float(n))
            sine, cosine = sincos_2pi(add(turns, (u[j], low[j])))
            kick = multiply(multiply((strength, 0.0), INVERSE_TWO_PI), sine)
            left = add((u[ahead], low[ahead]), (u[behind], low[behind]))
            left = add(left, (-2 * u[j], -2 * low[j]))
            force[j] = add(left, (-kick[0], -kick[1]))[0]
            diagonal[j] = 2 + strength * cosine[0]
            slopes[0, j], slopes[1, j] = multiply((strength, 0.0), cosine)
            bends[j] = -TWO_PI * strength * sine[0]
        curvature, left, _, _ = _solve(force, diagonal, 0, 0.0, inverse, pull)
        step = left / curvature if curvature != 0 else 0.0
        largest = abs(step)
        for j in range(n):
            change = step if j == 0 else force[j] + pull[j] * step
            u[j], low[j] = add((u[j], low[j]), (change, 0.0))
            slopes[0, j], slopes[1, j] = add((slopes[0, j], slopes[1, j]), (bends[j] * change, 0.0))
            largest = max(largest, abs(change))
        if largest < 1e-12:  # quadratic: nothing is left to gain
            break
    x_x, y_x, x_y, y_y = (1.0, 0.0), (0.0, 0.0), (0.0, 0.0), (1.0, 0.0)
    for j in range(n):
        slope = slopes[0, j], slopes[1, j]
        y_x, y_y = add(y_x, multiply(slope, x_x)), add(y_y, multiply(slope, x_y))
        x_x, x_y = add(x_x, y_x), add(x_y, y_y)
    trace = add(x_x, y_y)
    return add((2.0, 0.0), (-trace[0], -trace[1]))[0] / 4
