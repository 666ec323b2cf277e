"""Symmetric periodic orbits, Greene's residue, and the breakup of a circle from its convergents.

In the chain (Lagrangian) form an orbit is a sequence of sites, one per kick,

    x_{n+1} - 2 x_n + x_{n-1} = (κ_n / 2π) sin 2πx_n,     y_n = x_n - x_{n-1},

and an orbit of T with rotation number p/q has N = Pq sites and x_{n+N} = x_n + p. A site c is a
*symmetry centre* of the forcing if κ_{c+j} = κ_{c-j}; an orbit with x_c = a, a = 0 or 1/2, then
equals its mirror image x_{c-j} = 2a - x_{c+j}, and half of it is enough. For P = 1 and P = 2 every
site is a centre.

What is computed and stored is the deviation u from the rotation,

    x_j = a + jp/N + u_j,     u_{-j} = -u_j,     u_{j+N} = u_j,

which obeys the same equation, the rotation being linear in j. On the lift x would grow to p and
lose the digits that the residue of a long orbit needs.

Greene's residue R = (2 - Tr DT^q)/4 comes from the same half. With v and w the solutions of the
linearised chain that are odd and even about the centre,

    R = - w'_M v_M,        M = N/2,   ' = centred difference,

since DT^q is the half orbit's matrix followed by that of its mirror image: a product, and no trace
near 2 is subtracted from 2. R itself is Greene's (J. Math. Phys. 20 (1979) 1183).

A circle of ω exists as long as the residues of its convergents p_n/q_n tend to 0, and is broken
where they grow. At the breakup R_n = R_{n+m}, m the period of the continued fraction of ω, which
needs no knowledge of the value that they share. Those crossings converge like q^-2.
"""

from itertools import islice

import numpy as np
from numba import njit
from scipy.optimize import brentq

from nasm.checks import count
from nasm.critical import CriticalScale, Status
from nasm.maps import TWO_PI, forcing
from nasm.numbers import convergents
from nasm.sine import cos2pi, sin2pi
from nasm.symmetries import shortest

MAX_PERIOD = 10**6

_ROUNDING = 1e-12  # residues below are rounding errors of the slopes v' and w', which are near 1


def symmetry_centres(kappa):
    """Sites c in 0, …, P - 1 with κ_{c+j} = κ_{c-j} for all j, as a list of ints.

    All sites for P ≤ 2. For larger P only palindromes have one: e.g. the rotating forcing with
    phase 0, whose centre is site 0; a forcing with P ≥ 3 different strengths in no such order has
    none, and its periodic orbits are not found by this module.
    """
    strengths = forcing(kappa)
    around = [np.roll(strengths, -c) for c in range(strengths.size)]
    return [c for c, k in enumerate(around) if np.array_equal(k[1:], k[:0:-1])]


def dominant_centre(kappa):
    """The centre (site, a) whose orbits are the minimax ones, R > 0.

    The symmetry centre with the largest |κ|, on x = 1/2 if κ > 0 there and on x = 0 if κ < 0.
    ValueError if the forcing has no centre.
    """
    strengths = forcing(kappa)
    centres = symmetry_centres(strengths)
    if not centres:
        raise ValueError(
            f"kappa={kappa!r} has no symmetry centre; symmetric orbits need a forcing that reads "
            "the same forwards and backwards from some site"
        )
    site = max(centres, key=lambda c: abs(strengths[c]))
    return site, 0.5 if strengths[site] > 0 else 0.0


def symmetric_orbit(kappa, p, q, centre=None):
    """The ordered symmetric orbit of rotation number p/q through a symmetry centre.

    Parameters
    ----------
    kappa : sequence of P floats, the forcing, first kick first.
    p, q : ints without common factor, 1 ≤ q ≤ 10⁶.
    centre : (site, a), a in {0, 1/2}; default `dominant_centre`, the minimax orbit. The minimizing
        orbit goes through a centre that the minimax orbit does not meet.

    Returns
    -------
    x : ndarray of shape (P·q,), the sites from the centre on, on the lift; None if the orbit is not
        found: Newton's method, continued from κ = 0, met only orbits that are not ordered like a
        rotation.
    """
    orbit = _HalfOrbit(kappa, p, q, centre)
    if not orbit.move(1.0):
        return None
    x = np.empty(orbit.profile.size * q)
    _unfold(orbit.u, x)
    return orbit.a + p * np.arange(x.size) / x.size + x


def residue(kappa, p, q, centre=None):
    """Greene's residue of `symmetric_orbit`: float; NaN if that orbit is not found.

    0 < R < 1 is elliptic, R < 0 hyperbolic, R > 1 hyperbolic with reflection.
    """
    orbit = _HalfOrbit(kappa, p, q, centre)
    return orbit.residue() if orbit.move(1.0) else np.nan


def critical_scale(omega, profile, q_max=3000):
    """The scale at which the circle of ω breaks on the ray κ = s·profile, by Greene's residue.

    1. Where the forcing repeats itself, up to the symmetry `alternate`, take the shorter map: on
       κ1 = κ2 the standard map itself, at ω/2. The boundaries have cusps there.
    2. For consecutive convergents solve R_n(s) = R_{n+m}(s), m the period of ω's continued
       fraction, for the minimax orbits.
    3. Extrapolate the solutions by Aitken's rule.

    Parameters
    ----------
    omega : RotationNumber, irrational.
    profile : sequence of P floats with a symmetry centre; see `symmetry_centres`.
    q_max : int, the largest period used. 3000 gives ten digits or more for noble ω.

    Returns
    -------
    CriticalScale. error : the difference of the last two extrapolated values, or that of the
    crossings where these are not geometric yet, but at least what rounding leaves. lower and upper
    are NaN: Greene's criterion is not a proof of either.

    ValueError if profile is zero or has no symmetry centre.
    """
    profile = forcing(profile)
    if not profile.any():
        raise ValueError("profile is zero; a ray needs a direction, e.g. profile=(1, 0.5)")
    short, short_omega = shortest(profile, omega)
    centre = dominant_centre(short)
    if omega.is_rational:
        return _failed(omega, Status.RATIONAL)
    period = len(short_omega.tail)
    fractions = [f for f in islice(convergents(short_omega), 200) if 3 <= f.denominator <= q_max]
    if fractions and fractions[-1].denominator < _cusp_period(short):
        return _failed(omega, Status.NEAR_CUSP)
    orbits = [_HalfOrbit(short, f.numerator, f.denominator, centre) for f in fractions]
    crossings, status = [], Status.NOT_CONVERGED
    for lower, higher in zip(orbits, orbits[period:], strict=False):
        crossing = _crossing(lower, higher, crossings)
        if not isinstance(crossing, Status):
            crossings.append(crossing)
        elif len(crossings) > 2 * period + 1:
            break  # longer orbits are out of reach; there are enough without them
        else:
            # Near a cusp the shortest orbits are not yet on the way to the limit: start afresh.
            crossings, status = [], crossing
    if len(crossings) < 2 * period + 2:
        return _failed(omega, status)
    value, ratio = _aitken(*crossings[-1 - 2 * period :: period])
    value_before, ratio_before = _aitken(*crossings[-2 - 2 * period : -1 : period])
    # The residue of q steps has lost about q² ε to rounding, and tells the scale q times better.
    rounding = 20 * np.finfo(float).eps * fractions[-1].denominator * value
    error = max(abs(value - value_before), rounding)
    if not 0.5 < ratio / ratio_before < 2 or abs(ratio) > 0.9:
        # Not geometric yet, as at small angles from a cusp: the extrapolation means nothing.
        error = max(error, abs(value - crossings[-1]), abs(crossings[-1] - crossings[-2]))
    return CriticalScale(value, error, np.nan, np.nan, omega, Status.OK)


def _failed(omega, status):
    return CriticalScale(np.nan, np.nan, np.nan, np.nan, omega, status)


def _cusp_period(profile):
    """The period from which orbits tell a ray near the cusp |κ1| = |κ2| from the cusp itself.

    At an angle δ from the cusp the boundary is below the tip by δ^0.6, which orbits of period q see
    to within 1/q; five times that period was enough in every case tried.
    """
    larger, smaller = np.sort(np.abs(profile))[::-1] if profile.size == 2 else (1.0, 0.0)
    return 5 * (1 - smaller / larger) ** -0.6


def _crossing(lower, higher, crossings):
    """The scale at which two minimax orbits have the same residue, or a Status.

    Below it the longer orbit has the smaller residue. The search starts around where the crossings
    so far tend to, or from the origin.
    """

    def excess(scale):
        if not (lower.move(scale) and higher.move(scale)):
            raise _LostError
        residues = np.clip([lower.residue(), higher.residue()], -1.0, 1e300)
        # Deep inside, both are lost in rounding, and not even their signs mean anything.
        return np.log(residues[1] / residues[0]) if residues.min() > _ROUNDING else -100.0

    largest = 2 / np.abs(lower.profile).max()  # the twist region ends there
    try:
        if len(crossings) < 2:
            left, width = 0.0, largest / 50
            right = crossings[-1] if crossings else width
        else:
            width = 2 * abs(crossings[-1] - crossings[-2])
            left, right = crossings[-1] - width, crossings[-1] + width
            while excess(left) > 0:
                left, width = max(left - width, 0.0), 2 * width
        while excess(right) < 0:
            if right > largest:
                return Status.NO_BREAKUP
            left, right, width = right, right + width, 1.2 * width
        if left == 0.0:
            left = 0.5 * right
            while excess(left) > 0:
                left *= 0.5
        return brentq(excess, left, right, xtol=1e-16 * right, rtol=1e-15)
    except (_LostError, ValueError):  # brentq's: on its way back it met another orbit
        return Status.DISORDERED


class _LostError(Exception):
    """An orbit could not be followed."""


def _aitken(first, second, third):
    """The limit of a sequence that converges geometrically, from three terms, and its ratio."""
    step, next_step = second - first, third - second
    if step == next_step:
        return third, 1.0
    return third - next_step**2 / (next_step - step), next_step / step if step != 0 else 0.0


class _HalfOrbit:
    """A symmetric orbit of p/q on the ray κ = s·profile, at the scale that it was last moved to."""

    def __init__(self, profile, p, q, centre):
        self.profile = forcing(profile)
        self.q = count("q", q, 1, MAX_PERIOD)
        p = count("p", p, -MAX_PERIOD, MAX_PERIOD)
        if np.gcd(p, q) != 1:
            raise ValueError(f"p/q = {p}/{q} has a common factor; write it in lowest terms")
        self.site, self.a = dominant_centre(self.profile) if centre is None else centre
        centres = symmetry_centres(self.profile)
        if self.site not in centres or self.a not in (0, 0.5):
            raise ValueError(
                f"centre={centre!r} is no symmetry centre; sites are {centres}, a is 0 or 0.5"
            )
        n_sites = self.profile.size * q
        # The rotation's angles, reduced mod 1 in integers: exact for any length.
        self.theta = self.a + np.arange(n_sites // 2 + 2) * (p % n_sites) % n_sites / n_sites
        self.u = np.zeros(self.theta.size)
        self.scale = 0.0
        self.stride = pow(p, -1, q) if q > 1 else 0

    def move(self, scale):
        """Continue the orbit to that scale; whether it got there."""
        self.scale = _follow(
            self.profile, self.scale, scale, self.site, self.q, self.theta, self.stride, self.u
        )
        return self.scale == scale

    def residue(self):
        strengths = self.scale * self.profile
        return _residue(strengths, self.site, self.profile.size * self.q, self.theta, self.u)


@njit(nogil=True)
def _newton(kappa, site, n_sites, theta, u, workspace):
    """Newton's method for the deviations u of a half orbit, in place; whether it converged.

    The linearised chain is tridiagonal: one sweep of elimination, one back; O(N) a step. The
    unknowns are the sites strictly between the two centres. The second centre is the site N/2,
    where u = 0; for odd N it is halfway between two sites, and u_{M+1} = -u_M for M = (N - 1)/2.
    """
    odd = n_sites % 2 == 1
    unknowns = n_sites // 2 if odd else n_sites // 2 - 1
    ratio, right = workspace[0], workspace[1]
    last = np.inf
    for _ in range(25):
        if odd:
            u[unknowns + 1] = -u[unknowns]
        c = d = 0.0
        for j in range(1, unknowns + 1):
            strength = kappa[(site + j) % kappa.size]
            x = theta[j] + u[j]
            error = u[j + 1] - 2 * u[j] + u[j - 1] - strength / TWO_PI * sin2pi(x)
            diagonal = -2 - strength * cos2pi(x)
            if odd and j == unknowns:
                diagonal -= 1
            c, d = 1 / (diagonal - c), -(error + d) / (diagonal - c)
            ratio[j], right[j] = c, d
        largest = change = 0.0
        for j in range(unknowns, 0, -1):
            change = right[j] - ratio[j] * change
            u[j] += change
            largest = max(largest, abs(change))
        if odd:
            u[unknowns + 1] = -u[unknowns]
        if not largest < 0.5:
            return False
        # Quadratic convergence ends in rounding: stop there, and not before.
        if largest < 1e-16 or (largest < 1e-10 and largest >= 0.25 * last):
            return True
        last = largest
    return False


@njit(nogil=True)
def _unfold(half, u):
    """The deviations of all N sites from those of half of them: u_{N-j} = -u_j."""
    n = u.size
    for j in range(n // 2 + 1):
        u[j] = half[j]
    for j in range(n // 2 + 1, n):
        u[j] = -half[n - j]


@njit(nogil=True)
def _ordered(half, q, stride, u):
    """Whether the orbit is ordered like the rotation: sites whose angles differ by the least, 1/q,
    and which are `stride` steps of T apart in time, keep their order."""
    _unfold(half, u)
    n = u.size
    hop = n // q * stride
    for j in range(n):
        k = j + hop
        if not u[k - n if k >= n else k] - u[j] + 1 / q > 0:
            return False
    return True


@njit(nogil=True)
def _follow(profile, start, end, site, q, theta, stride, u):
    """Continue an ordered half orbit, in place, from the forcing start·profile to end·profile.

    Steps adapt: doubled after each success, halved when Newton fails or finds another orbit.
    Returns the scale that was reached: `end`, or short of it if the steps became too small.
    """
    n_sites = profile.size * q
    workspace = np.empty((2, u.size))
    trial, before, full = u.copy(), u.copy(), np.empty(n_sites)
    at, last_step, step = start, 0.0, end - start
    while at != end:
        if abs(step) >= abs(end - at):
            step = end - at
        target = end if step == end - at else at + step
        for j in range(u.size):  # extrapolate linearly in the scale
            trial[j] = u[j] + ((u[j] - before[j]) * (step / last_step) if last_step != 0 else 0.0)
        if _newton(target * profile, site, n_sites, theta, trial, workspace) and _ordered(
            trial, q, stride, full
        ):
            for j in range(u.size):
                before[j], u[j] = u[j], trial[j]
            at, last_step = target, step
            step *= 2
        else:
            step /= 2
            if abs(step) < 1e-6 * abs(end - start):
                return at
    return at


@njit(nogil=True)
def _residue(kappa, site, n_sites, theta, u):
    """R of a half orbit, by the formula at the head of the module."""
    end = n_sites // 2
    c = kappa[site % kappa.size] * cos2pi(theta[0])
    v_last, v = 0.0, 1.0  # odd about the centre: v_0 = 0, v_1 = 1
    w_last, w = 1.0, 1 + c / 2  # even: w_0 = 1, w_1 = w_{-1}
    steps = end if n_sites % 2 else end - 1
    for j in range(1, steps + 1):
        c = 2 + kappa[(site + j) % kappa.size] * cos2pi(theta[j] + u[j])
        v_last, v = v, c * v - v_last
        w_last, w = w, c * w - w_last
    if n_sites % 2:  # the second centre is halfway between the last two sites
        return -(w - w_last) * (v + v_last) / 2
    c = 1 + kappa[(site + end) % kappa.size] * cos2pi(theta[end]) / 2
    return -(c * w - w_last) * v
