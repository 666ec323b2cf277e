"""Periodic orbits, Greene's residue, and the breakup of a circle from its convergents.

A circle of ω exists as long as the residues of its convergents p_n/q_n tend to 0, and is broken
where they grow (Greene, J. Math. Phys. 20 (1979) 1183). At the breakup

    R_n(s) = R_{n+m}(s),      m the period of the continued fraction of ω,

which needs no knowledge of the value that they share. Those crossings converge like q^-2.04, and
geometrically from one period of the tail to the next, so that Aitken's rule gains several digits.

Where the forcing has a symmetry centre the orbits are those of `nasm.chain`, half as long, and
without one those of `nasm.action`. Of every p/q there are two families: the *minimax* orbit, R > 0,
and the *minimizing* one (of the action), R < 0. Symmetric minimax orbits meet the symmetry centre
of the largest |κ| or another of the `dominant_lines`, the minimizing ones a centre that the other
does not meet. Both families break up with the circle.
"""

from dataclasses import replace
from fractions import Fraction
from itertools import chain, islice, pairwise, product

import numpy as np
from scipy.optimize import brentq

from nasm.action import Ladder, LostError, ordered_orbits
from nasm.chain import MAX_PERIOD, HalfOrbit, is_symmetry_centre
from nasm.checks import count, fraction
from nasm.critical import CriticalScale, Status, no_answer
from nasm.maps import direction, forcing, rotating_forcing, unkick
from nasm.numbers import checked, convergents, rational
from nasm.symmetries import CUSP_EXPONENT, distances_to_shorter, shorten

__all__ = ["critical_scale", "crossings", "residue", "symmetric_orbit", "torus_scale"]
__dir__ = __all__.copy

_METHOD = "Greene's residue"
_ROUNDING = 1e-12  # residues below are rounding errors of the slopes v' and w', which are near 1
_NO_RESONANCE = 1e-9  # of the largest: below, F_p is 0 up to rounding
_ORDER = 2.04  # crossings converge like q^-2.04
_LONG = 100, 300, 1000  # periods of orbits that tell sheets of a boundary apart, in turn
_BROKEN = 0.05  # least residue that shows one; where the dominant line changes they pass through 0
_PRECISE = 1e-6  # of the value: longer orbits at the start are not tried then
_LEFT = 0.1  # of the logarithm of a ratio of residues: more is no crossing
_STRONG = 0.05  # ratio of crossings a period of the tail apart, from which it is trusted unseen


def _places(sites):
    """Where a centre may be: on one of these sites, or between two."""
    return chain(sites, (site + 0.5 for site in sorted(sites)))


def dominant_centre(kappa):
    """The centre (site, a) whose orbits are the minimax ones, R > 0, for all ω if there is such.

    The symmetry centre on a site with the largest |κ|, on x = 1/2 if κ > 0 there and on x = 0 if
    κ < 0. Without one, a centre between two sites, and the sign is that of the sum of all κ. For
    P ≥ 3 minimax orbits of other ω may have other centres: see `dominant_lines`. ValueError if the
    forcing has no centre.
    """
    strengths = forcing(kappa)
    # Strengths in descending order: with long forcings, only the first sites need to be tried.
    for site in _places(np.argsort(-np.abs(strengths), kind="stable").tolist()):
        if is_symmetry_centre(strengths, site):
            sign = strengths.sum() if site % 1 else strengths[site]
            return site, 0.5 if sign > 0 else 0.0
    raise ValueError(
        f"kappa={kappa!r} has no symmetry centre; symmetric orbits need a forcing that reads the "
        "same forwards and backwards from some site, or from between two"
    )


def primitive(kappa):
    """One period of the forcing, the shortest."""
    strengths = forcing(kappa)
    for size in range(1, strengths.size // 2 + 1):
        if strengths.size % size == 0 and (strengths[size:] == strengths[:-size]).all():
            return strengths[:size]
    return strengths


def dominant_lines(kappa):
    """The symmetry lines that the minimax orbits are on, to first order in κ, for each ω.

    A forcing of shortest period P has two centres, c and c + P/2, and the two symmetric orbits of
    p/q meet two lines each:

        (c, a)  and  (c + P/2, a + p/2)  if q is odd,      (c, 0)  and  (c, 1/2)  if q is even.

    To first order the action depends on where the orbit is only for q = 1, by

        F_p cos 2πa,      F_p = Σ_n κ_n cos(2πp(n - c)/P),

    and the minimax orbit is where that is negative. So from p to p + 1 both minimax orbits are on
    one line: that of c if F_p and F_{p+1} have the same sign, and else that of c + P/2. Where F_p
    is 0 the next p counts; if they are an even number apart and of different signs, no line has
    both. For P ≤ 2 all F_p have the sign of κ_c, which is then the larger |κ|.

    Returns
    -------
    List of (t, centre, dominant): the line of the minimax orbits with |ω|/P from t up to the next
    t, the last up to 1/2. dominant : bool; False where no line has both, and centre is one of p.
    (x, y) → (-x, -y) takes ω to -ω and keeps the lines, y → y + 1 takes ω to ω + P, and between
    sites a to a + 1/2.

    ValueError if the forcing has no centre.
    """
    strengths = primitive(kappa)
    size = strengths.size
    site, a = dominant_centre(strengths)
    if size <= 2 or not strengths.any():
        return [(0.0, (site, a), True)]
    p = np.arange(size // 2 + 1)
    # Re(e^{iφ} FFT) is F_p, also where c is between two sites.
    resonances = (np.exp(2j * np.pi * site * p / size) * np.fft.fft(strengths)[p]).real
    sizes = np.abs(resonances)
    known = np.flatnonzero(sizes > _NO_RESONANCE * sizes.max()).tolist()
    on = [0.5 if resonances[p] > 0 else 0.0 for p in known]
    # F_{-p} = F_p, and F_{P-p} = ±F_p, minus if c is between two sites.
    anchors = [(-known[0], on[0]), *zip(known, on, strict=True)]
    anchors.append((size - known[-1], 0.5 - on[-1] if site % 1 else on[-1]))
    lines = []
    for (p, a), (next_p, next_a) in pairwise(anchors):
        odd, same = (next_p - p) % 2, a == next_a
        centre = (site, a) if same or not odd else (_half_on(site, size), (a + p / 2) % 1.0)
        if p == next_p or (same and not odd and lines and lines[-1][2]):
            continue  # where both lines have both, it stays
        line = centre, bool(same or odd)
        if not lines or lines[-1][1:] != line:
            lines.append((max(p, 0) / size, *line))
    return lines


def _half_on(site, size):
    """The other centre of a forcing of that shortest period: int, or between two sites."""
    other = (site + size / 2) % size
    return other if other % 1 else int(other)


def minimax_centre(kappa, p, q):
    """A centre (site, a) of the minimax orbit of p/q, R > 0, by `dominant_lines`."""
    strengths = forcing(kappa)
    if strengths.size <= 2:
        return dominant_centre(strengths)
    omega = Fraction(p, q * strengths.size)
    turns = round(omega)
    lines = dominant_lines(strengths)
    *_, (site, a) = (line for t, line, _ in lines if t < abs(omega - turns) or t == 0)
    return site, (a + turns / 2) % 1.0 if site % 1 else a


def minimizing_centre(kappa, p, q):
    """A centre (site, a) of the minimizing orbit of p/q, R < 0: one that the minimax orbit does not
    meet.

    That one has x = a at site s and x = a + p/2 (mod 1) half a period later, at s + Pq/2. The
    other centre of the forcing is P/2 from s, P its shortest period: with P = 1 between two sites.
    """
    strengths = forcing(kappa)
    site, a = minimax_centre(strengths, p, q)
    short = primitive(strengths).size
    if Fraction(p * short, q * strengths.size).denominator % 2:
        return site, 0.5 - a
    return _half_on(site, short), 0.5 - a


def symmetric_orbit(kappa, p, q, centre=None):
    """The ordered symmetric orbit of rotation number p/q through a symmetry centre.

    Parameters
    ----------
    kappa : sequence of P floats, the forcing, first kick first.
    p, q : ints without common factor, 1 ≤ q ≤ 10⁶.
    centre : (site, a), a in {0, 1/2}; default `minimax_centre`; see also `minimizing_centre`.

    Returns
    -------
    x : ndarray of shape (P·q,), the sites from the centre on, or from the next one if it is between
        two, on the lift; None if the orbit is not found: Newton's method, continued from κ = 0, met
        only orbits that are not ordered like a rotation. (Ordered is what orbits of one rotation
        number p/q are at different times; with q = 1 there is nothing to compare, and only the
        small steps of the continuation protect.)
    """
    orbit = _orbit(kappa, p, q, centre)
    return orbit.sites() if orbit.move(1.0) else None


def cycle(kappa, p, q, centre=None):
    """The points of `symmetric_orbit` at the start of each period.

    Returns x, y: ndarrays of shape (q,), in time, x on the lift; None if the orbit is not found.
    Arguments as for `symmetric_orbit`.
    """
    strengths = forcing(kappa)
    centre = minimax_centre(strengths, p, q) if centre is None else centre
    x = symmetric_orbit(strengths, p, q, centre)
    if x is None:
        return None
    starts = slice(int(-np.ceil(centre[0])) % strengths.size, None, strengths.size)
    return x[starts], np.diff(x, prepend=x[-1] - p)[starts]


def symmetry_lines(kappa, y):
    """The lines on which orbits are their own mirror images, at the start of a period.

    Parameters
    ----------
    kappa : sequence of P floats with a symmetry centre c, the forcing, first kick first.
    y : array; it runs along each line, whose image under y → y + 1 is a line too.

    Returns
    -------
    x, y : ndarrays of shape (4, *y.shape), on the lift: x_c = 0 and x_c = 1/2, followed back from
    site c to site 0, and so at the other centre, c + P/2; see `dominant_lines`.

    ValueError if the forcing has no centre.
    """
    strengths = primitive(kappa)
    site, _ = dominant_centre(strengths)
    y, lines = np.asarray(y, dtype=float), []
    for centre, a in product((site, _half_on(site, strengths.size)), (0.0, 0.5)):
        point = a + y * (centre % 1), y  # between two sites x_c is their mean
        for strength in strengths[: int(np.ceil(centre))][::-1]:
            point = unkick(strength, *point)
        lines.append(np.broadcast_arrays(*point))
    return tuple(np.stack(lines, axis=1))


def residue(kappa, p, q, centre=None):
    """Greene's residue of `symmetric_orbit`: float; NaN if that orbit is not found.

    0 < R < 1 is elliptic, R < 0 hyperbolic, R > 1 hyperbolic with reflection. Without a centre it
    is that of the minimax orbit, also of a forcing that has no symmetry centre; 0 where it cannot
    be told from 0 then.
    """
    strengths = forcing(kappa)
    if centre is None and not _is_symmetric(strengths, strengths):
        try:
            _, minimax = ordered_orbits(strengths, p, q)
        except LostError:
            return np.nan
        return minimax.refined_residue() if minimax.residue() else 0.0
    orbit = _orbit(kappa, p, q, centre)
    return orbit.refined_residue() if orbit.move(1.0) else np.nan


def _orbit(kappa, p, q, centre):
    profile = forcing(kappa)
    centre = minimax_centre(profile, p, q) if centre is None else centre
    return HalfOrbit(0 * profile, profile, p, q, centre)


def critical_scale(omega, profile, q_max=6000, start=None, family=minimax_centre):
    """The scale at which the circle of ω breaks on the segment κ = start + s·profile, s ≥ 0.

    The `crossings` of the residues of its convergents, extrapolated by Aitken's rule. Where all
    forcings of the segment have a symmetry centre the orbits are those of `nasm.chain`. Without
    one, or where symmetric orbits of three kicks or more give no answer, they are those of
    `nasm.action`, of both families.

    Parameters
    ----------
    omega : RotationNumber or its text, irrational; e.g. "gamma".
    profile : sequence of P floats.
    q_max : int up to 10⁶, the largest period used. 1500 gives nine digits for noble ω, 6000 twelve.
    start : sequence of P floats; default 0, a ray from the origin; planes of forcings that do not
        contain 0 have rays from another. The circle should exist there:
        what is found is the first breakup in steps of a fiftieth of the twist region, |κ| < 2.
    family : `minimax_centre` or `minimizing_centre`, whose symmetric orbits are used: two routes to
        one value. Within a few degrees of the diagonals the symmetric orbits of some p/q are no
        longer minimizing, and the second route is barred.

    Returns
    -------
    CriticalScale. error : see `_limit`; next to a cusp it is doubled, up to four times the period
    from which orbits see the cusp. Of two families it is no smaller than their difference, and long
    orbits have residues that fall with q just below the value, and grow just above. lower and upper
    are NaN: Greene's criterion is not a proof of either. Status NEAR_CUSP where the longest orbits
    that were found do not see the cusp.

    ValueError if profile is zero or tiny, or start is of another length.
    """
    omega = checked(omega)
    start, profile, short_omega, q_max = _shortened(omega, profile, q_max, start)
    if omega.is_rational:
        return no_answer(omega, Status.RATIONAL, _METHOD)
    if _is_symmetric(start, profile):
        orbits = _SymmetricOrbits(start, profile, family)
        found = _estimate(_crossings(short_omega, q_max, orbits), profile)
        if found.status is Status.OK or profile.size <= 2 or family is not minimax_centre:
            return replace(found, omega=omega, method=_METHOD)
    found = _of_both_families(short_omega, start, profile, q_max)
    return replace(found, omega=omega, method=_METHOD)


def crossings(omega, profile, q_max=6000, start=None, family=minimax_centre):
    """The scales at which consecutive convergents have the same residue, R_n(s) = R_{n+m}(s).

    Arguments as for `critical_scale`; of symmetric orbits. Where the forcing repeats itself, up to
    the symmetry `alternate`, the shorter map is taken: on κ1 = κ2 the standard map itself, at ω/2.
    The boundaries have cusps there.

    Returns
    -------
    q, scales : ndarrays of shape (n,): the longer of the two periods, and the crossing. Empty where
    there is no answer; `critical_scale` says why.

    ValueError as for `critical_scale`, or if the forcings have no common symmetry centre.
    """
    start, profile, short_omega, q_max = _shortened(omega, profile, q_max, start)
    dominant_centre(start + profile)
    if short_omega.is_rational:
        return np.empty((2, 0))
    return _crossings(short_omega, q_max, _SymmetricOrbits(start, profile, family))[0]


def circle_remains(omega, kappa, q):
    """Whether the residues of long minimax orbits fall with q under a forcing: its circle exists.

    omega : RotationNumber or its text, irrational. kappa : P floats. q : int, 10 to 10⁵; two
    convergents of about that period, or the next longer ones, are compared: the residue of the
    longer is less than half as large. False where an orbit is not found.

    ValueError if omega is rational.
    """
    omega, q = checked(omega), count("q", q, 10, 10**5)
    if omega.is_rational:
        raise ValueError(f"omega={omega} is rational; a circle needs an irrational rotation number")
    (kappa,), omega = shorten([kappa], omega)
    period = len(omega.tail)
    known = _fractions(omega)
    n = next(n for n, f in enumerate(known) if f.denominator >= q)
    ladder = Ladder(kappa, 0 * kappa, known[: n + period + 1])
    try:
        shorter, longer = (ladder.scan(i, 0.0)[-1].residue() for i in (n, n + period))
    except LostError:
        return False
    return longer <= 0.5 * shorter < 0.5


def _shortened(omega, profile, q_max, start):
    """start, profile and ω of the shortest map, and q_max, checked."""
    profile, q_max = direction(profile), count("q_max", q_max, 1, MAX_PERIOD)
    start = np.zeros_like(profile) if start is None else forcing(start)
    if start.shape != profile.shape:
        raise ValueError(f"start={start} and profile={profile} differ in length")
    (start, profile), short_omega = shorten([start, profile], omega)
    return start, profile, short_omega, q_max


def _is_symmetric(start, profile):
    """Whether the forcings of a segment have a common symmetry centre."""
    return any(
        is_symmetry_centre(start, site) and is_symmetry_centre(profile, site)
        for site in _places(range(profile.size))
    )


def _fractions(omega):
    """Convergents of ω far beyond its prefix, in order, the last of those of one period."""
    known = islice(convergents(omega), len(omega.prefix) + 200)
    return list({fraction.denominator: fraction for fraction in known}.values())


def _of_both_families(omega, start, profile, q_max):
    """The CriticalScale by minimax and by minimizing orbits, by the action.

    Next to exchanges of the dominant line short orbits mislead: the search begins with longer ones
    again, unless the value is precise.
    """
    q_max = min(q_max, 10 * q_max // profile.size)
    fractions = [f for f in _fractions(omega) if f.denominator <= q_max]
    ladder, period = Ladder(start, profile, fractions), len(omega.tail)
    best, status, tried = None, Status.NOT_CONVERGED, set()
    for least in _LONG:
        long = [n for n, f in enumerate(fractions[:-period]) if f.denominator >= least]
        n = long[0] if long else len(fractions) - 1 - period
        if n < 1 or n in tried:
            break
        near = _located(ladder, n, n + period)
        if isinstance(near, Status):
            return best or no_answer(None, near)
        q_min = fractions[n].denominator if tried else 3
        tried.add(n)
        found = []
        for kind in (-1, 1):
            orbits = _AllOrbits(ladder, kind, near)
            found.append(_estimate(_crossings(omega, q_max, orbits, q_min), profile))
            if found[-1].status is not Status.OK:
                status = found[-1].status
                break
        else:
            value, other = sorted(found, key=lambda scale: scale.error)
            apart = abs(value.value - other.value)
            found = replace(value, error=max(value.error, apart))
            # Between two sheets of the boundary residues may cross where no circle breaks.
            step = max(4 * found.error, 2 * found.value / fractions[n].denominator)
            falls, still_falls = (
                _falls(ladder, n, n + period, found.value + sign * step) for sign in (-1, 1)
            )
            if falls and not still_falls and not (best and best.error < found.error):
                best = found
            if best and best.error < _PRECISE * best.value:
                break
    return best or no_answer(None, status)


def _falls(ladder, shorter, longer, scale):
    """Whether the longer of two minimax orbits has the smaller residue: neither is lost, then."""
    try:
        residues = [ladder.scan(n, scale)[-1].residue() for n in (shorter, longer)]
    except LostError:
        return False
    return residues[1] < residues[0] or residues[1] == 0


def _located(ladder, shorter, longer):
    """The first scale at which orbits of two fractions see a breakup, or a Status."""
    unit = 1 / np.abs(ladder.profile).max()
    step, largest = 0.04 * unit, (2 + np.abs(ladder.start).max()) * unit

    def broken(scale):
        try:
            residues = [ladder.scan(n, scale)[-1].residue() for n in (shorter, longer)]
        except LostError:
            return True
        seen.append((scale, residues[1]))
        return residues[1] > residues[0] > _BROKEN

    seen = []
    if ladder.start.any() and broken(0.0):
        return Status.OUTSIDE
    inside, outside = 0.0, step
    while not broken(outside):
        if outside > largest:
            return Status.NO_BREAKUP
        inside, outside = outside, outside + step
    while outside - inside > 0.1 * unit / ladder.chains[longer].q:
        middle = (inside + outside) / 2
        inside, outside = (inside, middle) if broken(middle) else (middle, outside)
    return inside


def _estimate(crossed, profile):
    """The CriticalScale of `_crossings`, without ω."""
    (periods, scales), status, tail, cusp = crossed
    if status is not Status.OK:
        return no_answer(None, status)
    value, error = _limit(scales, *tail)
    if periods[-1] < 4 * cusp:
        error *= 2
    if error * np.abs(profile).max() > 0.01:
        return no_answer(None, Status.NEAR_CUSP if periods[-1] < cusp else Status.NOT_CONVERGED)
    return CriticalScale(value, error, np.nan, np.nan, None, Status.OK)


def _crossings(omega, q_max, orbits, q_min=3):
    """(periods, scales) and the status; the number of partial quotients in the tail of ω and the
    ratio of crossings that far apart; and the period that sees a cusp nearby.
    """
    start, profile, none = orbits.start, orbits.profile, np.empty((2, 0))
    period = len(omega.tail)
    known = list(islice(convergents(omega), len(omega.prefix) + 200))
    growth = known[-1].denominator / known[-1 - period].denominator
    ratio = (-1) ** period * growth**-_ORDER
    enough = max(2 * period, 3) if abs(ratio) < _STRONG else 2 * period + 2
    fractions = [f for f in known if q_min <= f.denominator <= q_max]
    found, status, longest, cusp = [], Status.NOT_CONVERGED, 0, 0.0
    for n, (lower, higher) in enumerate(zip(fractions, fractions[period:], strict=False)):
        scale = _crossing(orbits, lower, higher, [scale for _, scale in found])
        if isinstance(scale, Status):
            if len(found) >= enough:
                break  # longer orbits are out of reach; there are enough without them
            # Near a cusp the shortest orbits are not yet on the way to the limit: start afresh.
            found, status = [], status if status is Status.OUTSIDE else scale
            if orbits.near is not None and len(fractions) - period - n <= enough:
                break
        else:
            longest, cusp = higher.denominator, cusp_period(start + scale * profile)
            found.append((longest, scale))
            if q_max < cusp:
                break
    if longest < cusp and (q_max < cusp or len(found) < enough) and status is not Status.OUTSIDE:
        status = Status.NEAR_CUSP
    elif len(found) >= enough:
        # Without all of the prefix and a tail, these are convergents of another number.
        whole = found[-1][0] >= known[len(omega.prefix) - 1 + period].denominator
        status = Status.OK if whole else Status.NOT_CONVERGED
    found = np.array(found).T if status is Status.OK else none
    return found, status, (period, ratio), cusp


def torus_scale(omega, frequency, mean, amplitude):
    """Where a torus of the rotating standard map breaks, by the residue of one long orbit.

    The orbit has the rotation vector (p/q, Ω): κ_n = s·(κ̄ + Δκ cos 2πnΩ), and p/q per kick. With
    both fractions close to an incommensurate pair it stands for the two-dimensional torus of that
    pair, and its residues pass from tiny to huge where the torus breaks.

    Parameters
    ----------
    omega, frequency : Fraction or str, p/q and Ω.
    mean, amplitude : float, the direction (κ̄, Δκ).

    Returns
    -------
    CriticalScale. value : where |R| of either symmetric orbit first reaches 1/4, in steps of a
    hundredth of the range |κ| < 2. error : how far from there |R| = 1 is, or the orbit lost; at
    least 2·value/√N for an orbit of N kicks, which sees the torus at distances of 1/√N turns only.
    (On 60 rays, for approximants of four pairs with N from 263 to 10 252, this covered the
    difference to longer ones with N up to 73 396 in 98.6% of 420 cases, the worst 1.04 times as
    large.) omega is that per period of the forcing. lower and upper are NaN. Status DISORDERED if
    the orbit is lost before.
    """
    profile = rotating_forcing(mean, amplitude, frequency)
    if not profile.any():
        raise ValueError("mean and amplitude are zero; a ray needs a direction")
    direction(profile)
    exact = rational(fraction("omega", omega) * profile.size)
    (short,), number = shorten([profile], exact)
    (*_, turns) = convergents(number)
    site, a = dominant_centre(short)
    orbits = [
        HalfOrbit(0 * short, short, turns.numerator, turns.denominator, (site, line))
        for line in (a, 0.5 - a)
    ]

    def excess(scale, level):
        if not all(orbit.move(scale) for orbit in orbits):
            raise LostError
        return np.log(max(1e-300, *(abs(orbit.residue()) for orbit in orbits)) / level)

    scales = []
    try:
        reached, step = 0.0, 0.02 / np.abs(short).max()
        for level in (0.25, 1.0):
            while excess(reached + step, level) < 0:
                reached += step
                if reached > 100 * step:
                    return no_answer(exact, Status.NO_BREAKUP, _METHOD)
            scales.append(brentq(excess, reached, reached + step, args=(level,), xtol=1e-12))
    except (LostError, ValueError):
        if not scales:
            return no_answer(exact, Status.DISORDERED, _METHOD)
        scales.append(reached + step)
    value, one = scales
    error = max(one - value, 2 * value / orbits[0].n_sites ** 0.5)
    return CriticalScale(value, error, np.nan, np.nan, exact, Status.OK, _METHOD)


def cusp_period(kappa):
    """The period from which orbits tell a forcing next to a cusp from the shorter one of the cusp.

    At a distance d from the cusp the boundary is below the tip by d^0.6, which orbits of period q
    see to within 1/q; five times that period was enough in every case tried.
    """
    nearest = distances_to_shorter(kappa).min(initial=np.inf)
    return 5 * nearest**-CUSP_EXPONENT if nearest > 0 else np.inf


class _AllOrbits:
    """The orbits of one family on a segment, by the action; `near` is where it breaks up, about."""

    def __init__(self, ladder, kind, near):
        self.start, self.profile, self.near = ladder.start, ladder.profile, near
        self._ladder, self._kind = ladder, kind
        self._steps = {(chain.p, chain.q): n for n, chain in enumerate(ladder.chains)}

    def at(self, fraction, scale):
        return self._ladder.at(
            self._steps[fraction.numerator, fraction.denominator], scale, self._kind
        )


class _SymmetricOrbits:
    """The orbits of one family on a segment, each made when it is first asked for."""

    near = None

    def __init__(self, start, profile, family):
        self.start, self.profile, self.family = start, profile, family
        self._made, self._centres = {}, {}

    def at(self, fraction, scale):
        """The orbit of that rotation number, moved to that scale. LostError if it is not found."""
        p, q = fraction.numerator, fraction.denominator
        # The centre may change along a segment that is no ray, as on |κ1| = |κ2|.
        if self.start.any() or fraction not in self._centres:
            self._centres[fraction] = self.family(self.start + scale * self.profile, p, q)
        key = fraction, self._centres[fraction]
        if key not in self._made:
            self._made[key] = HalfOrbit(self.start, self.profile, p, q, key[1])
        if not self._made[key].move(scale):
            raise LostError
        return self._made[key]


def _crossing(orbits, lower, higher, crossings):
    """The scale at which two orbits of a family have the same residue, or a Status.

    Below it the longer orbit has the smaller residue.
    """
    pair = lower, higher

    def excess(scale):
        residues = np.abs([orbits.at(f, scale).residue() for f in pair])
        if not residues.min() < np.inf:  # far outside, both overflow
            raise LostError
        # Deep inside, both are lost in rounding, and not even their signs mean anything.
        return np.log(residues[1] / residues[0]) if residues.min() > _ROUNDING else -100.0

    precision = 1e-8 / np.abs(orbits.profile).max() / higher.denominator
    try:
        bracket = _bracket(excess, orbits, crossings, lower.denominator)
        if isinstance(bracket, Status):
            return bracket
        scale = brentq(excess, *bracket, xtol=precision)
        # A secant step with refined residues ends what rounding had ended.
        near = 1e6 * precision
        slope = (excess(scale + near) - excess(scale - near)) / (2 * near)
        residues = [orbits.at(f, scale).refined_residue() for f in pair]
        if np.abs(residues).min() < 10 * _ROUNDING:  # the crossing is that of -100 above
            return Status.NOT_CONVERGED
        if residues[0] * residues[1] < 0:  # one is not of the family, as happens near a cusp
            return Status.DISORDERED
        left = np.log(residues[1] / residues[0])
        if abs(left) > _LEFT:
            return Status.DISORDERED
        step = -left / slope
        if abs(step) > 1e-3 * near:  # of the longest orbits rounding moves the slope too
            residues = [orbits.at(f, scale + step).refined_residue() for f in pair]
            step *= left / (left - np.log(residues[1] / residues[0]))
        return scale + step
    except (LostError, ValueError):  # brentq's: on its way back it met another orbit
        return Status.DISORDERED


def _bracket(excess, orbits, crossings, period):
    """Scales between which the excess changes its sign, or a Status.

    The search starts around where the crossings so far tend to, or from the start of the segment.
    """
    unit = 1 / np.abs(orbits.profile).max()
    largest = (2 + np.abs(orbits.start).max()) * unit  # beyond the twist region, |κ| < 2
    if len(crossings) < 2 and orbits.near is None:
        if orbits.start.any() and not _inside(excess):
            return Status.OUTSIDE
        left, width = 0.0, 0.04 * unit
        right = crossings[-1] if crossings else width
    else:
        near, width = orbits.near, min(0.02, 0.5 / period) * unit
        if len(crossings) >= 2:
            near, width = crossings[-1], 2 * abs(crossings[-1] - crossings[-2])
        left, right = max(near - width, 0.0), near + width
        while excess(left) > 0:
            if left == 0.0:
                return Status.OUTSIDE
            left, width = max(left - width, 0.0), 2 * width
    while True:
        try:
            if excess(right) >= 0:
                break
        except LostError:  # too far beyond
            if orbits.near is None or width < 1e-12 * unit:
                raise
            width /= 2
            right = left + width
            continue
        if right > largest:
            return Status.NO_BREAKUP
        left, right, width = right, right + width, 1.2 * width
    if left == 0.0 and not orbits.start.any():
        left = 0.5 * right
        while excess(left) > 0:
            left *= 0.5
    return left, right


def _inside(excess):
    """Whether the segment starts where the longer orbit has the smaller residue."""
    try:
        return excess(0.0) < 0
    except LostError:
        return False


def _limit(scales, period, ratio):
    """Where crossings tend to, and the error of that.

    ratio : that of the steps between crossings a period of the tail apart, as it is in the limit.

    The value is Aitken's, of the last crossings a period apart. Such values differ from the limit
    by what shrinks like |ratio|^(3/2) in a period. So the error is the largest difference of two
    consecutive ones, of a whole period and one more, each as small as it should have become by
    now: of fewer, two may agree by chance. As long as there are fewer, the value that follows from
    the last step and the ratio of the limit is compared too.

    Where Aitken's ratio is not near that of the limit, as with orbits that hardly see a cusp, or is
    not known, that is the value, and the error no smaller than the last two steps.
    """
    ends = range(len(scales), 2 * period, -1)[: period + 2]
    extrapolated = [_aitken(*scales[end - 1 - 2 * period : end : period]) for end in ends]
    by_ratio = scales[period:] + (scales[period:] - scales[:-period]) * ratio / (1 - ratio)
    ratios = [found / ratio for _, found in extrapolated[:2]]
    if len(ratios) == 2 and min(ratios) > 0.6 and max(ratios) < 1.6:
        value, shrunk = extrapolated[0][0], abs(extrapolated[0][1]) ** (1.5 / period)
        changes = [(v - w) * shrunk**n for n, ((v, _), (w, _)) in enumerate(pairwise(extrapolated))]
        if len(extrapolated) < period + 2:
            changes.append(value - by_ratio[-1])
    else:
        value, (last, before, first) = by_ratio[-1], scales[:-4:-1]
        changes = [value - last, last - before, (before - first) * abs(ratio) ** (1 / period)]
        changes.extend(np.diff(by_ratio[-2:]))
    return value, max(4 * np.spacing(value), *np.abs(changes))


def _aitken(first, second, third):
    """The limit of a sequence that converges geometrically, from three terms, and its ratio."""
    step, next_step = second - first, third - second
    if step == next_step:
        return third, 1.0
    # Not next_step², which overflows for large scales, of small profiles.
    limit = third - next_step * (next_step / (next_step - step))
    return limit, next_step / step if step != 0 else 0.0
