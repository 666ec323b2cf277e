"""The ordered periodic orbits of any forcing, by the action; no symmetry is needed.

The orbits of the chain (`nasm.chain`), x_n = np/N + u_n with N = Pq sites, are where the action

    A = Σ_n (x_{n+1} - x_n)²/2 - (κ_n/4π²) cos 2πx_n,        x_{n+N} = x_n + p,

is stationary. Eliminate all sites but x_0, which minimize A for a given x_0. That leaves the
*reduced action* a(x_0), with

    a' = -G,    a'' = S,    R = -S Π(pivots)/4,

where G is the force on x_0, S the Schur complement of the other sites in the Hessian, which is
tridiagonal, and the pivots those of the elimination. One sweep to the end and one back gives all
three, and Newton's step of the other sites. Of every p/q two orbits are ordered like a rotation:
the *minimizing* one, R < 0, at the minimum of a, and the *minimax* one, R > 0, at its maximum over
the gap between the minimizing orbit and its neighbour. As x_0 moves by ±G/|S|, one rule finds both.

1. *Climb.* With x_0 held, the orbit of each convergent of ω is that of the last one, repeated, and
   the last but one, joined end to end, up to a few of Newton's steps. On a circle a hardly depends
   on x_0; where the circle is broken the joined orbits meet in the same point. So long orbits are
   reached at each forcing by itself, and where residues pass through 0 nothing is lost.
2. *Scan.* Begin the orbit where its gap is widest, and move x_0 over that gap. The highest maximum
   of a is the minimax orbit, whichever symmetry line it is on, or on none.
3. *Follow.* Long orbits are then moved along the segment of forcings by Newton's method.

Deviations u are stored, so that rounding does not grow with x. What is left of it costs R about
N² ulp; `Orbit.refined_residue` gives the digits back.

Aubry & Le Daeron, Physica D 8 (1983) 381; Mather, Comment. Math. Helv. 60 (1985) 508.
"""

from contextlib import suppress
from fractions import Fraction
from math import copysign, exp, log

import numpy as np
from numba import njit

from nasm.arithmetic.double_double import INVERSE_TWO_PI, add, divided, multiply, sincos_2pi
from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import MAX_DENOMINATOR as MAX_PERIOD
from nasm.checks import count
from nasm.maps import TWO_PI, forcing
from nasm.numbers import convergents, rational

__all__ = ["LostError", "Orbit", "ordered_orbits"]
__dir__ = __all__.copy

FLAT = 1e-12
"""Slopes of the reduced action below this are rounding: R cannot be told from 0."""

_ROUNDING = 1e-12  # of the distance of two sites
_FOUND = 1e-7  # turns: a larger last step of Newton's method has found nothing
_STEPS = 60
_PLACES = 12  # of x_0 in a gap
_AS_WIDE = 0.99  # of the widest gap: gaps that are equal up to rounding begin at the first site
_SCANNED = 600  # sites: shorter orbits are scanned at every scale, longer ones followed
_NEAR = 0.3  # over q, of the largest strength: how far a long orbit is followed
_JOINED = 1500  # period from which rounding blurs the slopes of a scan
_KEPT = 30  # scales of which orbits are kept


class LostError(Exception):
    """An orbit was not found, or only one that is not ordered like a rotation."""


class Ladder:
    """Ordered orbits of a list of fractions, one step of the ladder each, on a segment of forcings.

    start, profile : arrays of P floats, κ = start + s·profile.
    fractions : consecutive convergents of a number, as Fractions, q increasing.
    """

    def __init__(self, start, profile, fractions):
        self.start, self.profile = start, profile
        self.chains = [_Chain(profile.size, fraction) for fraction in fractions]
        self._climbed, self._scanned, self._followed = {}, {}, {}

    def kappa(self, scale, site):
        """The forcing, from that site on."""
        return np.roll(self.start + scale * self.profile, -site)

    def at(self, n, scale, kind):
        """The Orbit of fraction n: minimizing (kind = 1) or minimax (-1).

        R is 0 where it cannot be told from 0. LostError if the orbit is not found.
        """
        chain = self.chains[n]
        if chain.n_sites <= _SCANNED:
            if (n, scale) not in self._scanned:
                _forget(self._scanned)
                self._scanned[n, scale] = self.scan(n, scale)
            return self._scanned[n, scale][kind]
        near = _NEAR / np.abs(self.profile).max(initial=1e-300) / chain.q
        orbit = self._followed.get((n, kind))
        if orbit is not None and abs(scale - orbit.scale) < near:
            with suppress(LostError):
                return orbit.move(scale)
        found = self._joined(n, scale) if chain.q > _JOINED and n > 1 else {}
        found = found or self.scan(n, scale)
        if found[kind].residue() != 0:
            self._followed.update({(n, key): orbit for key, orbit in found.items()})
        return found[kind]

    def scan(self, n, scale):
        """{1: the minimizing Orbit, -1: the minimax one} of fraction n, as by `at`, by steps 1 and
        2 at this very scale."""
        chain, (site, u) = self.chains[n], self._climb(n, scale)
        first = _widest(chain, np.roll(u, site)) - site
        site, u = (site + first) % chain.period, chain.rolled(u, first)
        kappa, left, gap = self.kappa(scale, site), u[0], chain.right(u)[0] - u[0]
        slopes, orbits, guesses = [], [u], {1: [], -1: []}
        for i in range(2 * _PLACES + 1):
            u = 2 * orbits[-1] - orbits[-2] if i else u.copy()
            u[0] = left + gap * (i + 0.43) / _PLACES
            slopes.append(chain.hold(kappa, u))
            orbits.append(u)
            for kind in (1, -1) if i else ():
                if kind * slopes[-2] < 0 <= kind * slopes[-1]:
                    nearer = -2 if abs(slopes[-2]) < abs(slopes[-1]) else -1
                    guesses[kind].append(orbits[nearer])
            flat = max(map(abs, slopes)) < FLAT
            if i >= _PLACES and (flat or all(guesses.values())):
                break
        found = {}
        for kind in guesses if not flat else ():
            for u in guesses[kind]:
                orbit = Orbit(self, n, site, kind, u.copy(), scale)
                if orbit.settle(gap / _PLACES / 2) and (
                    kind not in found or kind * (orbit.action() - found[kind].action()) < 0
                ):
                    found[kind] = orbit
        if len(found) == 2:
            return found
        if max(map(abs, slopes)) > 100 * FLAT:
            raise LostError
        return {kind: Orbit(self, n, site, kind, u, scale, 0.0) for kind in guesses}

    def _climb(self, n, scale):
        """(site, u) of an orbit of fraction n that minimizes the action with x held at `site`."""
        if scale not in self._climbed:
            _forget(self._climbed)
            site = int(np.abs(self.kappa(scale, 0)).argmax())
            self._climbed[scale] = site, []
        site, orbits = self._climbed[scale]
        kappa = self.kappa(scale, site)
        for chain in self.chains[len(orbits) : n + 1]:
            i = len(orbits)
            held = np.full(chain.n_sites, 0.0 if kappa[0] > 0 else 0.5)
            try:
                if i > 1:
                    u = chain.joined(*zip(self.chains[i - 2 : i], orbits[-2:], strict=True))
                else:
                    u = np.resize(orbits[-1], chain.n_sites) if i else held.copy()
                chain.hold(kappa, u)
            except LostError:
                if chain.n_sites > _SCANNED:
                    raise
                u = held
                for part in np.arange(1, 9) / 8:
                    chain.hold(part * kappa, u)
            orbits.append(u)
        return site, orbits[n]

    def _joined(self, n, scale):
        """Both Orbits of fraction n from those of the two fractions before; {} if that fails."""
        found = {}
        for kind in (1, -1):
            last, one = (self.at(i, scale, kind) for i in (n - 2, n - 1))
            if last.site != one.site:
                return {}
            u = self.chains[n].joined((last.chain, last.u), (one.chain, one.u))
            found[kind] = Orbit(self, n, one.site, kind, u, scale)
            found[kind].relax(0, 0.0)
            if not found[kind].settle(0.1 / one.chain.q):
                return {}
        return found


class Orbit:
    """An ordered periodic orbit on a segment, at the scale last moved to.

    site : int, 0 to P - 1, of the first of its sites. u : ndarray (N,), their deviations.
    kind : 1 if it is minimizing, -1 if minimax.
    """

    def __init__(self, ladder, n, site, kind, u, scale, residue=np.nan):
        self.ladder, self.chain = ladder, ladder.chains[n]
        self.site, self.kind, self.u, self.scale = site, kind, u, scale
        self._before, self._residue = None, residue

    def residue(self):
        """R, good to about N² ulp."""
        return self._residue

    def refined_residue(self):
        """R good to the last digits, in double-double arithmetic."""
        chain = self.chain
        return _refined_residue(self._kappa(), chain.numerators, self.u, chain.work)

    def sites(self):
        """x of all N sites from `site` on, on the lift."""
        return self.chain.theta_on_lift() + self.u

    def action(self):
        """A over the N sites, less the constant p²/2N."""
        angle = TWO_PI * (self.chain.theta + self.u)
        stretch = np.roll(self.u, -1) - self.u
        kicks = np.resize(self._kappa(), angle.size)
        return float(np.sum(stretch**2) / 2 - np.sum(kicks * np.cos(angle)) / TWO_PI**2)

    def settle(self, furthest, n_steps=_STEPS):
        """Move to the extremum, x_0 at most so far a step; whether it is an ordered orbit there."""
        largest, curvature, logarithm, bad = self.relax(self.kind, furthest, n_steps)
        if largest < _FOUND and not bad and self.kind * curvature > 0:
            size = exp(min(logarithm + log(abs(curvature) / 4), 600.0))
            self._residue = -copysign(size, curvature)
            return self.chain.is_ordered(self.u)
        return False

    def relax(self, kind, furthest, n_steps=_STEPS):
        largest, curvature, _, logarithm, bad = _relax(
            self._kappa(), self.chain.theta, self.u, kind, furthest, n_steps, self.chain.work
        )
        return largest, curvature, logarithm, bad

    def move(self, scale):
        """Continue the orbit to that scale, itself; LostError if the steps become too small."""
        step = scale - self.scale
        while self.scale != scale:
            target = scale if abs(step) >= abs(scale - self.scale) else self.scale + step
            at, u, residue = self.scale, self.u, self._residue
            self.u, self.scale = u.copy(), target
            if self._before is not None:
                ratio = (target - at) / (at - self._before[0])
                if abs(ratio) < 3:
                    self.u += ratio * (u - self._before[1])
            if self.settle(0.1 / self.chain.q, 15) and np.abs(self.u - u).max() < 0.25:
                self._before = at, u
                step *= 2
            else:
                self.u, self.scale, self._residue = u, at, residue
                step /= 2
                if abs(step) < 0.1 * abs(scale - at) or at + step == at:
                    raise LostError
        return self

    def _kappa(self):
        return self.ladder.kappa(self.scale, self.site)


class _Chain:
    """What orbits of p/q under forcings of P kicks have in common."""

    def __init__(self, period, fraction):
        self.period, self.p, self.q = period, fraction.numerator, fraction.denominator
        self.n_sites = n_sites = period * self.q
        # Exact for any length, as in `nasm.chain`.
        self.numerators = np.arange(n_sites) * (self.p % n_sites) % n_sites
        self.theta = self.numerators / n_sites
        self._hop = period * (pow(self.p, -1, self.q) if self.q > 1 else 0)
        self.work = np.empty((4, n_sites))

    def theta_on_lift(self):
        return np.arange(self.n_sites) * (self.p / self.n_sites)

    def right(self, u):
        """The next orbit to the right: the same one, at another time."""
        return np.roll(u, -self._hop) + 1 / self.q

    def is_ordered(self, u):
        return _is_ordered(u, self._hop, 1 / self.q)

    def rolled(self, u, first):
        """The orbit from site `first` on; x_0 in [-1/2, 1/2]."""
        u = np.roll(u, -first) + self.theta[first % self.n_sites]
        return u - np.rint(u[0])

    def hold(self, kappa, u):
        """Minimize the action over all sites but x_0, in place; its slope a'. LostError if that
        fails."""
        largest, _, force, _, bad = _relax(kappa, self.theta, u, 0, 0.0, _STEPS, self.work)
        if not largest < _FOUND or bad or not self.is_ordered(u):
            raise LostError
        return -force

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


def ordered_orbits(kappa, p, q):
    """The two ordered orbits of rotation number p/q per period.

    Parameters
    ----------
    kappa : sequence of P floats, the forcing, first kick first.
    p, q : ints without common factor, 1 ≤ q ≤ 10⁶.

    Returns
    -------
    minimizing, minimax : Orbit, both from the same site on, in the gap that is widest there. Where
    R cannot be told from 0 both are one orbit of those that differ by rounding.

    LostError if they are not found, as may be far beyond the breakup of all circles near p/q.
    """
    kappa, q = forcing(kappa), count("q", q, 1, MAX_PERIOD)
    p = count("p", p, -MAX_PERIOD * kappa.size, MAX_PERIOD * kappa.size)
    if np.gcd(p, q) != 1:
        raise ValueError(f"p/q = {p}/{q} has a common factor; write it in lowest terms")
    fractions = {f.denominator: f for f in convergents(rational(Fraction(p, q)))}
    ladder = Ladder(kappa, 0 * kappa, list(fractions.values()))
    minimizing, minimax = (ladder.at(len(fractions) - 1, 0.0, kind) for kind in (1, -1))
    return minimizing, minimax


def _forget(kept):
    if len(kept) >= _KEPT:
        del kept[next(iter(kept))]


def _widest(chain, u):
    """The site of the widest gap, the first of those that are as wide."""
    gaps = chain.right(u) - u
    by_site = gaps.reshape(-1, chain.period).max(axis=0)
    site = int(np.argmax(by_site >= _AS_WIDE * by_site.max()))
    return site + chain.period * int(gaps[site :: chain.period].argmax())


@kernel
def _is_ordered(u, hop, gap):
    """Whether sites whose angles differ by the least, `gap`, `hop` sites apart, keep their order,
    as far as rounding can tell."""
    n = u.size
    for j in range(n):
        k = j + hop
        if not u[k - n if k >= n else k] - u[j] + gap > -_ROUNDING:
            return False
    return True


@njit(nogil=True)
def _solve(force, diagonal, kind, furthest, inverse, pull):
    """Newton's step, in place of the forces: of all sites with x_0 held (kind = 0), or moved by
    kind·G/|S|, at most `furthest`.

    Returns S, G, the logarithm of the product of the pivots, and how many are not positive. After
    it `pull` is how far each site moves with x_0.
    """
    n = force.size
    logarithm, product, bad = 0.0, 1.0, 0
    for j in range(1, n):
        pivot, ends = diagonal[j], (1.0 if j == 1 else 0.0) + (1.0 if j == n - 1 else 0.0)
        if j > 1:
            before = inverse[j - 1]
            pivot -= before
            force[j] += force[j - 1] * before
            ends += pull[j - 1] * before
        if not pivot > _ROUNDING:
            bad, pivot = bad + 1, 1.0
        inverse[j], pull[j] = 1 / pivot, ends
        product *= pivot
        if not 1e-200 < product < 1e200:
            logarithm, product = logarithm + np.log(product), 1.0
    logarithm += np.log(product)
    step = along = 0.0
    for j in range(n - 1, 0, -1):
        step, along = (force[j] + step) * inverse[j], (pull[j] + along) * inverse[j]
        force[j], pull[j] = step, along
    if n > 1:
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


@kernel
def _relax(kappa, theta, u, kind, furthest, n_steps, work):
    """Steps of `_solve`, in place, until rounding ends them.

    Returns the largest change of the last step, S, G, and the rest as `_solve`.
    """
    n, period = u.size, kappa.size
    inverse, pull, force, diagonal = work
    largest, last, curvature, left, logarithm, bad = np.inf, np.inf, 0.0, 0.0, 0.0, 0
    stiffness = 0.0  # where the action is not convex, springs to where the sites are
    for _ in range(n_steps):
        site, behind, here = 0, u[n - 1], u[0]
        for j in range(n):
            ahead = u[j + 1] if j < n - 1 else u[0]
            x, strength = theta[j] + here, kappa[site]
            force[j] = (ahead - here) - (here - behind) - strength / TWO_PI * sin2pi(x)
            diagonal[j] = 2 + strength * cos2pi(x) + (stiffness if j else 0.0)
            behind, here = here, ahead
            site = site + 1 if site < period - 1 else 0
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
        if relaxed and (largest < 1e-15 or (largest < 1e-8 and largest >= 0.5 * last)):
            break
        last = largest
    return largest, curvature, left, logarithm, bad


@njit(nogil=True)
def _angle(numerator, n_sites, u, low):
    return add(divided(float(numerator), float(n_sites)), (u, low))


@kernel
def _refined_residue(kappa, numerators, u, work):
    """R of the orbit that floats have found: Newton's steps with forces in double-double, then the
    trace of the product of all tangent maps in the same."""
    n, period = u.size, kappa.size
    inverse, pull, force, diagonal = work
    u, low = u.copy(), np.zeros(n)
    for _ in range(4):
        for j in range(n):
            ahead, behind = j + 1 if j < n - 1 else 0, j - 1 if j else n - 1
            strength = kappa[j % period]
            sine, cosine = sincos_2pi(_angle(numerators[j], n, u[j], low[j]))
            kick = multiply(multiply((strength, 0.0), INVERSE_TWO_PI), sine)
            left = add((u[ahead], low[ahead]), (u[behind], low[behind]))
            left = add(left, (-2 * u[j], -2 * low[j]))
            force[j] = add(left, (-kick[0], -kick[1]))[0]
            diagonal[j] = 2 + strength * cosine[0]
        curvature, left, _, _ = _solve(force, diagonal, 0, 0.0, inverse, pull)
        step = left / curvature if curvature != 0 else 0.0
        largest = abs(step)
        for j in range(n):
            change = step if j == 0 else force[j] + pull[j] * step
            u[j], low[j] = add((u[j], low[j]), (change, 0.0))
            largest = max(largest, abs(change))
        if largest < 1e-12:  # quadratic: nothing is left to gain
            break
    x_x, y_x, x_y, y_y = (1.0, 0.0), (0.0, 0.0), (0.0, 0.0), (1.0, 0.0)
    for j in range(n):
        _, cosine = sincos_2pi(_angle(numerators[j], n, u[j], low[j]))
        slope = multiply((kappa[j % period], 0.0), cosine)
        y_x, y_y = add(y_x, multiply(slope, x_x)), add(y_y, multiply(slope, x_y))
        x_x, x_y = add(x_x, y_x), add(x_y, y_y)
    trace = add(x_x, y_y)
    return add((2.0, 0.0), (-trace[0], -trace[1]))[0] / 4
