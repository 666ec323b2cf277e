"""The chain form of the map, and its ordered symmetric periodic orbits.

An orbit is a sequence of sites, one per kick,

    x_{n+1} - 2 x_n + x_{n-1} = (κ_n / 2π) sin 2πx_n,     y_n = x_n - x_{n-1},

and an orbit of T with rotation number p/q has N = Pq sites and x_{n+N} = x_n + p. A site c is a
*symmetry centre* of the forcing if κ_{c+j} = κ_{c-j}; an orbit with x_c = a, a = 0 or 1/2, then
equals its mirror image x_{c-j} = 2a - x_{c+j}, and half of it is enough. (The sine allows no other
a: the mirror image must turn its sign.)

A centre may be between two sites, c = 3/2 say, where x_c is their mean. An idle kick there changes
no orbit: the chain of (κ_0/2, 0, κ_1/2, 0, …) has the same sites, and their means between them.
Its centres are sites, so it stands for the forcing wherever a centre is between sites.

What is computed and stored is the deviation u from the rotation,

    x_j = a + jp/N + u_j,     u_{-j} = -u_j,     u_{j+N} = u_j,

which obeys the same equation, the rotation being linear in j. On the lift x would grow to p and
lose the digits that the residue of a long orbit needs.

Greene's residue R = (2 - Tr DT^q)/4 comes from the same half. With v and w the solutions of the
linearised chain that are odd and even about the centre,

    R = - w'_M v_M,        M = N/2,   ' = centred difference,

since DT^q is the half orbit's matrix followed by that of its mirror image: a product, and no trace
near 2 is subtracted from 2. R itself is Greene's (J. Math. Phys. 20 (1979) 1183).

Rounding still costs R about q² ulp: the linearised chain of a long orbit near breakup amplifies it.
`refined_residue` takes the orbit that floats have found, improves it by Newton steps whose
residuals are computed in double-double arithmetic, and follows v and w in the same.
"""

from numbers import Real

import numpy as np
from numba import njit

from nasm.arithmetic.double_double import (
    INVERSE_TWO_PI,
    add,
    divided,
    multiply,
    sincos_2pi,
    two_sum,
)
from nasm.arithmetic.kernels import kernel
from nasm.arithmetic.sine import cos2pi, sin2pi
from nasm.checks import count
from nasm.maps import TWO_PI, forcing

__all__ = ["HalfOrbit", "newton", "ordered"]
__dir__ = __all__.copy

MAX_PERIOD = 10**6
_ROUNDING = 1e-12  # of the distance of two sites, 1e-14 as a rule


def is_symmetry_centre(kappa, site):
    """Whether κ_{site+j} = κ_{site-j} for all j; site is a multiple of 1/2."""
    mirror = int(2 * site) - np.arange(kappa.size)
    return np.array_equal(kappa, kappa[mirror % kappa.size])


def _is_centre(kappa, centre):
    match centre:
        case (Real() as site, 0 | 0.5) if site % 0.5 == 0:
            return is_symmetry_centre(kappa, site)
    return False


def with_idle_kicks(kappa):
    """(κ_0/2, 0, κ_1/2, 0, …), whose odd sites are between those of κ; y is half as large."""
    return np.column_stack([kappa / 2, 0 * kappa]).ravel()


class HalfOrbit:
    """A symmetric orbit of p/q on the segment κ = start + s·profile, at the s last moved to.

    start, profile : sequences of P floats. p, q : ints without common factor. centre : (site, a),
    site a multiple of 1/2; if it is between two sites the chain is that of `with_idle_kicks`.
    ValueError if the segment's forcings have no such centre or p/q is not in lowest terms.
    """

    def __init__(self, start, profile, p, q, centre):
        self.start, self.profile = forcing(start), forcing(profile)
        self.q = count("q", q, 1, MAX_PERIOD)
        self.p = p = count("p", p, -MAX_PERIOD * self.profile.size, MAX_PERIOD * self.profile.size)
        if np.gcd(p, q) != 1:
            raise ValueError(f"p/q = {p}/{q} has a common factor; write it in lowest terms")
        if not all(_is_centre(strengths, centre) for strengths in (self.start, self.profile)):
            raise ValueError(
                f"centre={centre!r} is no symmetry centre (site, a); κ must read the same forwards "
                "and backwards from the site, a multiple of 1/2, and a is 0 or 0.5"
            )
        self.site, self.a = centre
        self.sites_apart = 2 if self.site % 1 else 1
        self.site = int(self.sites_apart * self.site)
        if self.sites_apart == 2:
            self.start, self.profile = map(with_idle_kicks, (self.start, self.profile))
        n_sites = self.profile.size * q
        # The rotation's angles in units of 1/N, reduced mod N: exact for any length.
        self.numerators = np.arange(n_sites // 2 + 2) * (p % n_sites) % n_sites
        self.theta = self.a + self.numerators / n_sites
        self.u = np.zeros(self.theta.size)
        self.stride = pow(p, -1, q) if q > 1 else 0
        self._begin()

    def _begin(self):
        """To the start of the segment, from κ = 0, where u = 0."""
        self.u[:] = 0.0
        self.scale = 0.0
        self.at_start = (
            not self.start.any()
            or self._follow(np.zeros_like(self.start), self.start, 0.0, 1.0) == 1.0
        )

    def move(self, scale):
        """Continue the orbit to that scale; whether it got there."""
        if not self.at_start:
            return False
        self.scale = self._follow(self.start, self.profile, self.scale, scale)
        if self.scale != scale:  # far out, the way back may be barred where the way up is not
            self._begin()
            self.scale = self._follow(self.start, self.profile, 0.0, scale)
        return self.scale == scale

    def residue(self):
        """R, good to about q² ulp."""
        return _residue(self.strengths, self.site, self.n_sites, self.theta, self.u)

    def refined_residue(self):
        """R of the forcing `strengths`, good to the last digits; some hundred times slower."""
        return _refined_residue(
            self.strengths, self.site, self.n_sites, self.numerators, self.a, self.u
        )

    def deviations(self):
        """u of all N sites from the centre on, idle ones too."""
        u = np.empty(self.n_sites)
        _unfold(self.u, u)
        return u

    def sites(self):
        """x of all sites from the centre on, on the lift, without idle ones."""
        x = self.a + self.p * np.arange(self.n_sites) / self.n_sites + self.deviations()
        return x[self.sites_apart - 1 :: self.sites_apart]

    @property
    def n_sites(self):
        return self.profile.size * self.q

    @property
    def strengths(self):
        return self.start + self.scale * self.profile

    def _follow(self, start, profile, begin, end):
        return _follow(
            start, profile, begin, end, self.site, self.q, self.theta, self.stride, self.u
        )


@kernel
def newton(kappa, site, n_sites, theta, u, workspace):
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
        if largest < 1e-16 or (largest < 1e-8 and largest >= 0.25 * last):
            return True
        last = largest
    return False


@kernel
def _unfold(half, u):
    """The deviations of all N sites from those of half of them: u_{N-j} = -u_j."""
    n = u.size
    for j in range(n // 2 + 1):
        u[j] = half[j]
    for j in range(n // 2 + 1, n):
        u[j] = -half[n - j]


@kernel
def ordered(half, q, stride, u):
    """Whether the orbit is ordered like the rotation: sites whose angles differ by the least, 1/q,
    and which are `stride` steps of T apart in time, keep their order, as far as rounding can tell:
    on a cantorus they may be nearer to each other."""
    _unfold(half, u)
    n = u.size
    hop = n // q * stride
    for j in range(n):
        k = j + hop
        if not u[k - n if k >= n else k] - u[j] + 1 / q > -_ROUNDING:
            return False
    return True


@kernel
def _follow(start, profile, begin, end, site, q, theta, stride, u):
    """Continue an ordered half orbit, in place, on κ = start + s·profile from s = begin to end.

    Steps adapt: doubled after each success, halved when Newton fails or finds another orbit.
    Returns the scale that was reached: `end`, or short of it if the steps became too small.
    """
    n_sites = profile.size * q
    workspace = np.empty((2, u.size))
    trial, before, full = u.copy(), u.copy(), np.empty(n_sites)
    at, last_step, step = begin, 0.0, end - begin
    while at != end:
        if abs(step) >= abs(end - at):
            step = end - at
        target = end if step == end - at else at + step
        for j in range(u.size):  # extrapolate linearly in the scale
            trial[j] = u[j] + ((u[j] - before[j]) * (step / last_step) if last_step != 0 else 0.0)
        if newton(start + target * profile, site, n_sites, theta, trial, workspace) and ordered(
            trial, q, stride, full
        ):
            for j in range(u.size):
                before[j], u[j] = u[j], trial[j]
            at, last_step = target, step
            step *= 2
        else:
            step /= 2
            if abs(step) < 1e-6 * abs(end - begin):
                return at
    return at


@kernel
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


@njit(nogil=True)
def _angle(numerator, n_sites, a, u_hi, u_lo):
    """x = a + numerator/N + u."""
    theta = divided(float(numerator), float(n_sites))
    return add(add(theta, (a, 0.0)), (u_hi, u_lo))


@njit(nogil=True)
def _refine(kappa, site, n_sites, numerators, a, u, low, cos, cos_low, workspace):
    """One Newton step for the pairs (u, low), in place, and cos 2πx of the result; the largest
    change.

    Residuals in double-double, the linear solve in floats: its errors are those of a small change.
    """
    odd = n_sites % 2 == 1
    unknowns = n_sites // 2 if odd else n_sites // 2 - 1
    ratio, right, sin = workspace[0], workspace[1], workspace[2]
    c = d = 0.0
    for j in range(1, unknowns + 1):
        strength = kappa[(site + j) % kappa.size]
        sine, cosine = sincos_2pi(_angle(numerators[j], n_sites, a, u[j], low[j]))
        force = multiply(multiply((strength, 0.0), INVERSE_TWO_PI), sine)
        error = add((u[j + 1], low[j + 1]), (u[j - 1], low[j - 1]))
        error = add(error, (-2 * u[j], -2 * low[j]))
        error = add(error, (-force[0], -force[1]))
        diagonal = -2 - strength * cosine[0]
        if odd and j == unknowns:
            diagonal -= 1
        c, d = 1 / (diagonal - c), -(error[0] + d) / (diagonal - c)
        ratio[j], right[j], sin[j] = c, d, sine[0]
        cos[j], cos_low[j] = cosine
    largest = change = 0.0
    for j in range(unknowns, 0, -1):
        change = right[j] - ratio[j] * change
        u[j], low[j] = add((u[j], low[j]), (change, 0.0))
        cos[j], cos_low[j] = add((cos[j], cos_low[j]), (-TWO_PI * sin[j] * change, 0.0))
        largest = max(largest, abs(change))
    if odd:
        u[unknowns + 1], low[unknowns + 1] = -u[unknowns], -low[unknowns]
    return largest


@kernel
def _refined_residue(kappa, site, n_sites, numerators, a, u):
    """`_residue` in double-double arithmetic, of the orbit that floats have found."""
    u, low, workspace = u.copy(), np.zeros(u.size), np.empty((3, u.size))
    cos, cos_low = np.empty(u.size), np.empty(u.size)
    for _ in range(4):
        # The step is quadratic: after a small one nothing is left to gain.
        change = _refine(kappa, site, n_sites, numerators, a, u, low, cos, cos_low, workspace)
        if change < 1e-12:
            break
    end = n_sites // 2
    # Differences instead of the three-term recurrence: v' = v_{j+1} - v_j, v'_j = v'_{j-1} + c v_j.
    half_kick = kappa[site % kappa.size] / 2 * (1.0 if a == 0 else -1.0)
    v_last, v, v_step = (0.0, 0.0), (1.0, 0.0), (1.0, 0.0)
    w_step = (half_kick, 0.0)
    w = two_sum(1.0, half_kick)
    for j in range(1, end + 1 if n_sites % 2 else end):
        c = multiply((kappa[(site + j) % kappa.size], 0.0), (cos[j], cos_low[j]))
        v_step, w_step = add(v_step, multiply(c, v)), add(w_step, multiply(c, w))
        v_last, v, w = v, add(v, v_step), add(w, w_step)
    if n_sites % 2:  # the second centre is halfway between the last two sites
        product = multiply(w_step, add(v, v_last))
        return -product[0] / 2
    turned = a + numerators[end] / n_sites  # a multiple of 1/2
    half_kick = kappa[(site + end) % kappa.size] / 2 * (1.0 if turned % 1.0 == 0 else -1.0)
    product = multiply(add(w_step, multiply((half_kick, 0.0), w)), v)
    return -product[0]
