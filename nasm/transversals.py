"""Converse KAM without a symmetry: starts on a curve that every rotational circle crosses.

Along an orbit of the chain, x_{n+1} - 2x_n + x_{n-1} = (κ_n/2π) sin 2πx_n, let v solve the
linearised chain forwards from the start, and likewise u backwards:

    v_{n+1} = (2 + κ_n cos 2πx_n) v_n - v_{n-1},   v_0 = 0,  v_1 = 1;    u_0 = 0,  u_{-1} = 1.

No rotational invariant circle passes through the start if some v_n ≤ 0 or u_{-n} ≤ 0, n ≥ 1, or if

    Σ_{n≥1} 1/(v_n v_{n+1}) + Σ_{n≥1} 1/(u_{-n} u_{-n-1})  ≥  2 + κ_0 cos 2πx_0

in a partial sum. For a circle gives a solution ξ_n > 0 of the linearised chain (see `nasm.cones`).
ξ_n v_{n+1} - ξ_{n+1} v_n = ξ_0 is constant, so v_n > 0, and ξ_n/v_n falls by ξ_0/(v_n v_{n+1}) from
each site to the next: ξ_1 > ξ_0 Σ 1/(v_n v_{n+1}). The same holds backwards, and ξ_1 + ξ_{-1} is
ξ_0 times the right side. On a symmetry line both sums are equal, and the criterion is that of
`nasm.cones`.

Every rotational circle crosses a curve that leads from y = -∞ to y = ∞. If all starts on one are
eliminated, no circle is left. Taken here is the *transversal*

    x = a + c_1 sin 2πy + c_2 sin 4πy + … + c_8 sin 16πy   before the kick of one site,

which the symmetries y → y + 1 and (x, y) → (-x, -y) keep for a = 0 and 1/2: starts with y from 0 to
1/2 suffice. Orbits that minimize the action are never eliminated. The transversal must pass through
the gaps that they leave, around the minimax orbits, for every ω; where the forcing has a centre and
a dominant line that is the straight line x = a, and for others it bends. To first order the minimax
orbit of ω = p is at the maximum of -Σ_n κ_n cos 2π(x + np/P), whose place depends on p.

Beyond the last circle's breakup, at the scale s_c of a ray, the longest life on a transversal that
passes through the widest gap of the last circle's remains is T, s/s_c - 1 ≈ C/T, as on a symmetry
line. C is 0.65 to 0.75 in steps for P = 3, 0.4 to 0.7 for P = 2 and 0.9 for P = 1. On transversals
beside that gap lives are longer. Near to a proof, and none, as all is sampled in floating point.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numba import njit

from nasm import escape
from nasm.checks import count, points
from nasm.cones import beam_search, longest_found
from nasm.critical import CriticalScale, Status, no_answer
from nasm.kernels import kernel
from nasm.maps import direction, forcing, kick
from nasm.sine import cos2pi

MAX_STEPS = 10**6

_GRIDS = ((1024, 0.5), (797, 0.382))  # starts, and the place of the start in its cell
_HARMONICS = 8  # with 3, bounds on some rays of three kicks were up to six times as far off
_BENDS = np.arange(-8, 9) / 40  # c_1 of the first transversals tried
_SHORTEST = 12  # kicks of the first round; each round has three times those of the one before
_LOCAL = 100  # kicks from which on only neighbours of the best transversal are tried
_STEP = 0.2  # over the kicks: by how much the scale is lowered at a time, in parts
_NEIGHBOUR = 6.0  # over the kicks: how far off the neighbours are in c_k
_EXCESS = 0.7  # steps: C of the law
_ORBITS, _ESCAPE_STEPS = 256, 10**6
_UNCERTAIN = 3.0  # errors in parts of upper - value: on a transversal beside the widest gap


@dataclass(frozen=True)
class Transversal:
    """The curve x = a + Σ_k c_k sin 2πky before the kick of `site`."""

    site: int
    a: float
    bends: tuple[float, ...]
    """c_1, c_2, …"""

    def x(self, y):
        """x at each y of a vector."""
        k = np.arange(1, len(self.bends) + 1)
        return self.a + np.sin(2 * np.pi * np.outer(y, k)) @ np.array(self.bends)


def elimination_time(kappa, site, x, y, n_kicks):
    """When each start (x, y) before the kick of `site` is eliminated.

    Parameters
    ----------
    kappa : sequence of P floats, the forcing, first kick first; site : int, 0 to P - 1.
    x, y : arrays of one shape.
    n_kicks : int, kicks in either direction.

    Returns
    -------
    ndarray of float64: the kicks in either direction that it takes; inf for a start that survives
    n_kicks. A finite time shows that no rotational circle passes through the start.
    """
    strengths = forcing(kappa)
    strengths = np.roll(strengths, -count("site", site, 0, strengths.size - 1))
    x, y = points(x, y)
    n_kicks = count("n_kicks", n_kicks, 1, MAX_STEPS)
    times = np.full(x.size, np.inf)
    _elimination_times(strengths, x.ravel(), y.ravel(), n_kicks, False, times)
    return times.reshape(x.shape)


def longest_lived(kappa, transversal, n_kicks):
    """The start on a transversal that takes longest to be eliminated.

    Parameters
    ----------
    kappa, n_kicks : as for `elimination_time`.
    transversal : Transversal of one of the sites.

    Returns
    -------
    y : float, in [0, 1/2]. kicks : float, in either direction; inf for a start that survives
    n_kicks, which need not be the last one then.

    The beam search of `cones.longest_lived`, on two unrelated grids: it may miss a survivor.
    """
    strengths = forcing(kappa)
    n_kicks = count("n_kicks", n_kicks, 1, MAX_STEPS)
    count("site", transversal.site, 0, strengths.size - 1)
    if not np.isfinite([transversal.a, *transversal.bends]).all():
        raise ValueError(f"{transversal} is not finite; a and the bends must be finite numbers")
    return _longest_lived(strengths, transversal, n_kicks)


def _longest_lived(kappa, transversal, n_kicks):
    return longest_found(_lifetimes(kappa, transversal, n_kicks), _GRIDS)


def _lifetimes(kappa, transversal, n_kicks):
    """y → kicks of the starts on a transversal, up to the first survivor; 0 of those behind it."""
    strengths = np.roll(kappa, -transversal.site)

    def lifetimes(y):
        times = np.zeros(y.size)
        _elimination_times(strengths, transversal.x(y), y, n_kicks, True, times)
        return times

    return lifetimes


def critical_scale(profile, n_max):
    """The scale at which the last circle breaks on the ray κ = s·profile, for any forcing.

    1. Start where the largest |κ| is 2. Of transversals of all sites, both a and many bends take
       the one on which all starts are eliminated within a few kicks at the lowest scale.
    2. Allow three times the kicks, and lower the scale again on that transversal, its neighbours in
       c_k, the best one's neighbours, and so on until none is better.
    3. Repeat that until the kicks are those of n_max steps. After a search on another grid that is
       `upper`.
    4. `value` is lower by 0.7/T, T the longest life there in steps.
    5. No orbit must escape there within 10⁶ steps: none does just beyond the breakup.

    Parameters
    ----------
    profile : sequence of P floats, not all 0.
    n_max : int, 30 to 10⁶, steps.

    Returns
    -------
    CriticalScale. upper : no start on a transversal was found to survive n_max steps there. error :
    three times upper - value, or how much the last round lowered the scale, if that is more: the
    search may get stuck on a transversal beside the widest gap, and is further out then than the
    law says. lower is NaN and omega None: the method shows no circle, and names none. Status
    NO_BREAKUP if no transversal is eliminated where the largest |κ| is 2; UNDECIDED, and no value,
    if an orbit escapes below what the search found: `upper` is where it did.

    ValueError if profile is zero or tiny or n_max out of range.
    """
    profile = direction(profile)
    n_max = profile.size * count("n_max", n_max, 30, MAX_STEPS)
    straight = (0.0,) * (_HARMONICS - 1)
    tried = [
        Transversal(site, a, (bend, *straight))
        for site, a, bend in product(range(profile.size), (0.5, 0.0), _BENDS.tolist())
    ]
    best, scale = None, 2 / np.abs(profile).max()
    rounds = int(np.log(n_max / _SHORTEST) / np.log(3))
    for n_kicks in (n_max // 3**left for left in range(rounds, -1, -1)):
        scale_before = scale
        if best is None or n_kicks <= _LOCAL:
            best, scale = _lowest(profile, tried, best, scale, n_kicks)
        else:
            best, scale = _descended(profile, best, scale, n_kicks)
        if best is None:
            return no_answer(None, Status.NO_BREAKUP)
    # Of many transversals the best may be one on which the search missed a survivor.
    while np.isinf(time := _longest_lived(scale * profile, best, n_max)[1]):
        scale *= 1 + _STEP / n_max
    gap = scale * _EXCESS * profile.size / time
    value, error = scale - gap, max(_UNCERTAIN * gap, scale_before - scale)
    if _escapes(value * profile):
        return CriticalScale(np.nan, np.nan, np.nan, value, None, Status.UNDECIDED)
    return CriticalScale(value, error, np.nan, scale, None, Status.OK)


def _escapes(kappa):
    """Whether some orbit is seen to get past where all circles would be."""
    x, y = escape.ensemble(_ORBITS)
    return bool(np.isfinite(escape.first_escape([kappa], x, y, [_ORBITS], _ESCAPE_STEPS)).any())


def _descended(profile, best, scale, n_kicks):
    """`_lowest` from one transversal on, by neighbours of neighbours until none is better."""
    _, scale = _lowest(profile, [best], best, scale, n_kicks)
    while True:
        better, scale = _lowest(profile, _neighbours(best, n_kicks), best, scale, n_kicks)
        if better is best:
            return best, scale
        best = better


def _neighbours(transversal, n_kicks):
    """Transversals with one of the bends changed."""
    distance = _NEIGHBOUR / n_kicks
    for k, change in product(range(_HARMONICS), (distance, -distance)):
        bends = list(transversal.bends)
        bends[k] += change
        yield Transversal(transversal.site, transversal.a, tuple(bends))


def _lowest(profile, transversals, best, scale, n_kicks):
    """The transversal that is eliminated within n_kicks at the lowest scale, and that scale.

    `best` is known to be so at `scale`, and stays if no other is lower.
    """
    for transversal in transversals:
        while True:
            lower = scale * (1 - _STEP / n_kicks)
            lifetimes = _lifetimes(lower * profile, transversal, n_kicks)
            if np.isinf(beam_search(lifetimes, *_GRIDS[0])[1]):
                break
            best, scale = transversal, lower
    return best, scale


@kernel
def _elimination_times(kappa, x, y, n_kicks, one_is_enough, times):
    for i in range(x.size):
        times[i] = _elimination_time(kappa, x[i], y[i], n_kicks)
        if one_is_enough and np.isinf(times[i]):
            return


@njit(nogil=True)
def _elimination_time(kappa, x, y, n_kicks):
    """Kicks in either direction until the start is eliminated, inf if more than n_kicks."""
    period = kappa.size
    bound = 2 + kappa[0] * cos2pi(x)
    # Backwards the chain is one with the strengths in reverse order.
    ahead, p = kick(kappa[0], x, y)
    behind, q = x - y, -y
    v_before, v, u_before, u, total = 0.0, 1.0, 0.0, 1.0, 0.0
    if bound <= 0:
        return 1.0
    for n in range(1, n_kicks):
        forwards, backwards = kappa[n % period], kappa[-n % period]
        v_before, v = v, (2 + forwards * cos2pi(ahead)) * v - v_before
        u_before, u = u, (2 + backwards * cos2pi(behind)) * u - u_before
        if v <= 0 or u <= 0:
            return n + 1.0
        total += 1 / (v_before * v) + 1 / (u_before * u)
        if total >= bound:
            return n + 1.0
        ahead, p = kick(forwards, ahead, p)
        behind, q = kick(backwards, behind, q)
    return np.inf
