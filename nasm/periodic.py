"""Periodic orbits, Greene's residue, and the breakup of a circle from its convergents.

A circle of ω exists as long as the residues of its convergents p_n/q_n tend to 0, and is broken
where they grow (Greene, J. Math. Phys. 20 (1979) 1183). At the breakup

    R_n(s) = R_{n+m}(s),      m the period of the continued fraction of ω,

which needs no knowledge of the value that they share. Those crossings converge like q^-2.04, and
geometrically from one period of the tail to the next, so that Aitken's rule gains several digits.

The orbits are those of `nasm.action`: of every p/q a *minimax* one, R > 0, and a *minimizing* one,
R < 0. Both families break up with the circle, and know nothing of each other.
"""

from dataclasses import replace
from functools import partial
from itertools import islice, pairwise
from math import inf, log
from operator import attrgetter

import numpy as np

from nasm.action import MAX_PERIOD, Chain, Ladder, LostError, Orbit, ordered_orbits
from nasm.arithmetic.roots import root
from nasm.checks import count, fraction
from nasm.critical import CriticalScale, Status, no_answer
from nasm.maps import direction, rotating_forcing, segment
from nasm.numbers import as_rotation_number, convergents, distinct_convergents, rational
from nasm.symmetries import CUSP_EXPONENT, distances_to_shorter, shorten

__all__ = ["critical_scale", "crossings", "residue", "torus_scale"]

METHOD = "Greene's residue"
_LOST = 1e-12  # residues below are rounding
_ROUNDED = 4e-17  # of the value for each period: κ_G was off by up to 2.7e-12 at period 10⁵
_ORDER = 2.04  # crossings converge like q^-2.04
_LONG = 100, 300, 1000  # periods of orbits that tell sheets of a boundary apart, in turn
_SHORT = 8  # enough with two kicks or one, whose boundaries have one sheet
_BROKEN = 0.05  # least residue that shows one; where the dominant line changes they pass through 0
_PRECISE = 1e-6  # of the value: longer orbits at the start are not tried then
_LEFT = 0.1  # of the logarithm of a ratio of residues: more is no crossing
_FAR = 60  # ratio of periods: orbits that much longer are not found from those before
_STRONG = 0.05  # ratio of crossings a period of the tail apart, from which it is trusted unseen


def residue(kappa, p, q):
    """Greene's residue of the minimax orbit of p/q: float; NaN if that orbit is not found, which
    says nothing of the circles near p/q (`action.ordered_orbits` says why).

    0 < R < 1 is elliptic, R > 1 hyperbolic with reflection; 0 where R cannot be told from 0. The
    minimizing orbit, R < 0, is the other one of `action.ordered_orbits`.

    kappa : sequence of P floats, the forcing, first kick first.
    p, q : ints without common factor, 1 ≤ q ≤ 10⁶.
    """
    try:
        _, minimax = ordered_orbits(kappa, p, q)
    except LostError:
        return np.nan
    return minimax.refined_residue() if minimax.residue else 0.0


def critical_scale(omega, profile, q_max=6000, start=None, between=None):
    """The scale at which the circle of ω breaks on the segment κ = start + s·profile, s ≥ 0.

    The `crossings` of the residues of its convergents, extrapolated by Aitken's rule: of minimax
    orbits, and with three kicks or more of minimizing orbits too.

    omega : RotationNumber or its text, irrational; e.g. "gamma".
    profile : sequence of P floats.
    q_max : int up to 10⁶, the largest period used. 1500 gives nine digits for noble ω, 6000 twelve.
    start : sequence of P floats; default 0, a ray from the origin; planes of forcings that do not
        contain 0 have rays from another. The circle should exist there:
        what is found is the first breakup in steps of a fiftieth of the twist region, |κ| < 2.
    between : pair of floats, scales between which the breakup is, if known; then there is no such
        search, and orbits whose residues do not cross between them are too short to tell.

    Returns CriticalScale. error : see `_limit`; next to a cusp it is doubled, up to four times the
    period from which orbits see the cusp. Of two families it is no smaller than their difference,
    and long orbits have residues that fall with q just below the value, and grow just above. lower
    and upper are NaN: Greene's criterion is not a proof of either. Status NEAR_CUSP where the
    longest orbits that were found do not see the cusp.

    ValueError if profile is zero or tiny, or start is of another length.
    """
    omega = as_rotation_number(omega)
    start, profile, short_omega, q_max = _shortened(omega, profile, q_max, start)
    if omega.is_rational:
        return no_answer(omega, Status.RATIONAL, METHOD)
    found, _ = _of_families(short_omega, start, profile, q_max, between)
    return replace(found, omega=omega, method=METHOD)


def crossings(omega, profile, q_max=6000, start=None):
    """The scales at which consecutive convergents have the same residue, R_n(s) = R_{n+m}(s).

    Arguments and errors as for `critical_scale`; of minimax orbits. Where the forcing repeats
    itself, up to a symmetry, the shorter map is taken: on κ1 = κ2 the standard map, at ω/2.

    Returns q, scales : ndarrays of shape (n,): the longer of the two periods, and the crossing.
    Empty where there is no answer; `critical_scale` says why.
    """
    omega = as_rotation_number(omega)
    start, profile, short_omega, q_max = _shortened(omega, profile, q_max, start)
    if short_omega.is_rational:
        return np.empty((2, 0))
    return _of_families(short_omega, start, profile, q_max)[1]


def _shortened(omega, profile, q_max, start):
    """start, profile and ω of the shortest map, and q_max, checked."""
    (start, profile), q_max = segment(start, profile), count("q_max", q_max, 1, MAX_PERIOD)
    (start, profile), short_omega = shorten([start, profile], omega)
    return start, profile, short_omega, q_max


def _of_families(omega, start, profile, q_max, between=None):
    """The CriticalScale, and the crossings of minimax orbits. Next to exchanges of the dominant
    line short orbits mislead: then the search begins again with longer ones."""
    none, simple, status = np.empty((2, 0)), profile.size <= 2, Status.NOT_CONVERGED
    q_max = min(q_max, 10 * q_max // profile.size)
    fractions = distinct_convergents(omega, q_max)
    if any(b.denominator > _FAR * a.denominator > 2 * _FAR for a, b in pairwise(fractions)):
        return no_answer(None, status), none
    ladder, period = Ladder(start, profile, fractions), len(omega.tail)
    best, tried = None, set()
    unit = 1 / np.abs(profile).max()
    ends = between or (0.0, (2 + np.abs(start).max()) * unit)
    for least in (_SHORT,) if simple else (inf,) if between else _LONG:
        long = [n for n, f in enumerate(fractions[:-period]) if f.denominator >= least]
        n = long[0] if long else len(fractions) - 1 - period
        if n < 1 or n in tried:
            break
        about = sum(between) / 2 if between else _located(ladder, n, n + period)
        if isinstance(about, Status):
            return best or (no_answer(None, about), none)
        first = n if tried else 0
        tried.add(n)
        crossed = _crossings(ladder, omega, -1, about, first, *ends)
        found = _estimate(crossed, profile)
        if simple:
            return found, crossed[0]
        if found.status is Status.OK:
            other = _estimate(_crossings(ladder, omega, 1, about, first, *ends), profile)
            apart = abs(found.value - other.value)
            found = min(found, other, key=attrgetter("error"))
            found = replace(found, error=max(found.error, apart), status=other.status)
        if found.status is not Status.OK:
            status = found.status
            continue
        # Between two sheets of the boundary residues may cross where no circle breaks.
        step = max(4 * found.error, 2 * found.value / fractions[n].denominator)
        falls, still_falls = (
            _falls(ladder, n, n + period, found.value + sign * step) for sign in (-1, 1)
        )
        if falls and still_falls is False and not (best and best[0].error < found.error):
            best = found, crossed[0]
        if best and best[0].error < _PRECISE * best[0].value:
            break
    return best or (no_answer(None, status), none)


def _residue(ladder, n, scale):
    return ladder.scan(n, scale)[-1].residue


def _falls(ladder, shorter, longer, scale):
    """Whether the longer of two minimax orbits has the smaller residue; False where orbits are lost
    far beyond the breakup, None where one is lost that ought to be found."""
    try:
        residues = [_residue(ladder, n, scale) for n in (shorter, longer)]
    except LostError as lost:
        return False if lost.is_far_beyond else None
    return bool(residues[1] < residues[0] or residues[1] == 0)


def _located(ladder, shorter, longer):
    """The first scale at which orbits of two fractions see a breakup, or a Status."""
    unit = 1 / np.abs(ladder.profile).max()
    step, largest = 0.04 * unit, (2 + np.abs(ladder.start).max()) * unit

    def broken(scale):
        try:
            least = _residue(ladder, shorter, scale)
            return least > _BROKEN and _residue(ladder, longer, scale) > least
        except LostError as lost:
            return lost.is_far_beyond

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
    error = max(error, _ROUNDED * periods[-1] * value)
    if periods[-1] < 4 * cusp:
        error *= 2
    if error * np.abs(profile).max() > 0.01:
        return no_answer(None, Status.NEAR_CUSP if periods[-1] < cusp else Status.NOT_CONVERGED)
    return CriticalScale(value, error, np.nan, np.nan, None, Status.OK)


def _crossings(ladder, omega, kind, near, first, least, largest):
    """(periods, scales) and the status; the number of partial quotients in the tail of ω and the
    ratio of crossings that far apart; and the period that sees a cusp nearby. Of orbits of one
    kind, from the fraction `first` on, near the scale `near`.
    """
    period, chains = len(omega.tail), ladder.chains
    known = list(islice(convergents(omega), len(omega.prefix) + period + 60))
    growth = known[-1].denominator / known[-1 - period].denominator
    ratio = (-1) ** period * growth**-_ORDER
    enough = max(2 * period, 3) if abs(ratio) < _STRONG else 2 * period + 2
    found, status, longest, cusp = [], Status.NOT_CONVERGED, 0, 0.0
    first = max(first, next((n for n, chain in enumerate(chains) if chain.q >= 3), len(chains)))
    for n in range(first, len(chains) - period):
        pair, before = (n, n + period), [scale for _, scale in found]
        scale = _crossing(ladder, *pair, kind, near, before, least, largest)
        if isinstance(scale, Status):
            if len(found) >= enough:
                break  # longer orbits are out of reach; there are enough without them
            # Near a cusp the shortest orbits are not yet on the way to the limit: start afresh.
            found, status = [], scale
        else:
            longest, cusp = chains[n + period].q, cusp_period(ladder.start + scale * ladder.profile)
            found.append((longest, scale))
            if chains[-1].q < cusp:
                break
    if longest < cusp and (chains[-1].q < cusp or len(found) < enough):
        status = Status.NEAR_CUSP
    elif len(found) >= enough:
        # Without all of the prefix and a tail, these are convergents of another number.
        whole = found[-1][0] >= known[len(omega.prefix) - 1 + period].denominator
        status = Status.OK if whole else Status.NOT_CONVERGED
    found = np.array(found).T if status is Status.OK else np.empty((2, 0))
    return found, status, (period, ratio), cusp


def _crossing(ladder, shorter, longer, kind, near, crossings, least, largest):
    """The scale at which two orbits of a kind have the same residue, or a Status; about where the
    `crossings` of shorter orbits lead to, or at `near`."""
    unit, pair, seen = 1 / np.abs(ladder.profile).max(), (shorter, longer), []

    def excess(scale):
        try:
            residues = [abs(ladder.at(n, scale, kind).residue) for n in pair]
        except LostError as lost:
            if lost.is_far_beyond:
                return 100.0  # as where both overflow
            raise
        # Deep inside, both are lost in rounding, and not even their signs mean anything.
        if min(residues) <= _LOST:
            return -100.0
        if max(residues) == inf:
            return 100.0
        found = log(residues[1] / residues[0])
        seen.append((scale, found))
        return found

    precision = 1e-8 * unit / ladder.chains[longer].q
    width = min(0.02, 0.5 / ladder.chains[shorter].q) * unit
    if len(crossings) >= 2:
        near, width = crossings[-1], 2 * abs(crossings[-1] - crossings[-2])
    if len(crossings) >= 3:
        near, width = _aitken(*crossings[-3:])[0], width / 4
    try:
        bracket = _bracket(excess, near, width, least, largest)
        if isinstance(bracket, Status):
            return bracket
        # Of a smooth excess eight steps do; where it jumps, none do.
        scale = root(excess, *bracket, precision, most=16)
        # A secant step with refined residues ends what rounding had ended.
        near = 1e6 * precision
        for beside in (0.1 * near, -0.1 * near):
            steps = [(s - scale, f) for s, f in seen if 0.01 * near < abs(s - scale) < near]
            if not steps:
                excess(scale + beside)
        if not steps:
            return Status.DISORDERED
        slope = steps[0][1] / steps[0][0]
        residues = [ladder.at(n, scale, kind).refined_residue() for n in pair]
        if np.abs(residues).min() < 10 * _LOST:  # the crossing is that of -100 above
            return Status.NOT_CONVERGED
        left = _logarithm(*residues)
        if abs(left) > _LEFT:
            return Status.DISORDERED
        step = -left / slope
        if abs(step) > 1e-3 * near:  # of the longest orbits rounding moves the slope too
            residues = [ladder.at(n, scale + step, kind).refined_residue() for n in pair]
            step *= left / (left - _logarithm(*residues))
        return scale + step
    except (LostError, ValueError):  # of `root`: on its way back it met another orbit
        return Status.DISORDERED


def _logarithm(shorter, longer):
    """ln of the ratio of two residues; LostError if one is not of the family, as near a cusp."""
    if not shorter * longer > 0:
        raise LostError(f"residues {shorter} and {longer} are of different families")
    return log(longer / shorter)


def _bracket(excess, near, width, least, largest):
    """Scales between which the excess changes its sign, or a Status; from near - width on."""
    left, right = max(near - width, least), min(near + width, largest)
    while excess(left) > 0:
        if left == least:
            return Status.OUTSIDE
        left, width = max(left - width, least), 2 * width
    while excess(right) < 0:
        if right == largest:
            return Status.NO_BREAKUP
        left, right, width = right, min(right + width, largest), 1.2 * width
    return left, right


def torus_scale(omega, frequency, mean, amplitude):
    """Where a torus of the rotating standard map breaks, by the residue of one long orbit.

    The orbit has the rotation vector (p/q, Ω): κ_n = s·(κ̄ + Δκ cos 2πnΩ), and p/q per kick. With
    both fractions close to an incommensurate pair it stands for the two-dimensional torus of that
    pair, and its residues pass from tiny to huge where the torus breaks.

    omega, frequency : Fraction or str, p/q and Ω.
    mean, amplitude : float, the direction (κ̄, Δκ).

    Returns CriticalScale. value : where |R| of either symmetric orbit first reaches 1/4, in steps
    of a hundredth of the range |κ| < 2. error : how far from there |R| = 1 is, or the orbit lost;
    at least 2·value/√N for an orbit of N kicks, which sees the torus at distances of 1/√N turns
    only. (On 60 rays, for approximants of four pairs with N from 263 to 10 252, this covered the
    difference to longer ones with N up to 73 396 in 98.6% of 420 cases, the worst 1.04 times as
    large.) omega is that per period of the forcing. lower and upper are NaN. Status DISORDERED if
    the orbit is lost before.
    """
    profile = direction(rotating_forcing(mean, amplitude, frequency))
    exact = rational(fraction("omega", omega) * profile.size)
    (short,), number = shorten([profile], exact)
    (*_, turns) = convergents(number)
    # x_0 is on a symmetry line, which holds it: forcings of cosines read the same both ways from 0.
    of = (chain := Chain(short.size, turns)), (0 * short, short), 0, 0
    orbits = [Orbit(*of, np.full(chain.n_sites, a), 0.0, 0.0) for a in (0.0, 0.5)]

    def excess(scale, level):
        if not all(orbit.move(scale) for orbit in orbits):
            raise LostError(f"an orbit of {omega} cannot be followed to s = {scale}")
        return log(max(1e-300, *(abs(orbit.residue) for orbit in orbits)) / level)

    scales = []
    try:
        reached, step = 0.0, 0.02 / np.abs(short).max()
        for level in (0.25, 1.0):
            while excess(reached + step, level) < 0:
                reached += step
                if reached > 100 * step:
                    return no_answer(exact, Status.NO_BREAKUP, METHOD)
            scales.append(root(partial(excess, level=level), reached, reached + step))
    except (LostError, ValueError):
        if not scales:
            return no_answer(exact, Status.DISORDERED, METHOD)
        scales.append(reached + step)
    value, one = scales
    error = max(one - value, 2 * value / chain.n_sites**0.5)
    return CriticalScale(value, error, np.nan, np.nan, exact, Status.OK, METHOD)


def cusp_period(kappa):
    """The period from which orbits tell a forcing next to a cusp from the shorter one of the cusp:
    of d^-0.6, see `CUSP_EXPONENT`, five times as much was enough in every case tried."""
    nearest = distances_to_shorter(kappa).min(initial=np.inf)
    return 5 * nearest**-CUSP_EXPONENT if nearest > 0 else np.inf


def _limit(scales, period, ratio):
    """Where crossings tend to, and the error; ratio : that of steps a period of the tail apart.

    The value is Aitken's, of the last crossings a period apart, which converges like |ratio|^(3/2)
    in a period. The error is the largest difference of two consecutive ones, of a whole period and
    one more, each as small as it should have become by now; as long as there are fewer, the value
    that follows from the last step and the ratio is compared too. Where Aitken's ratio is not near
    that, or not known, that is the value, and the error no smaller than the last two steps.
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
    return value, max(np.abs(changes))


def _aitken(first, second, third):
    """The limit of a sequence that converges geometrically, from three terms, and its ratio."""
    step, next_step = second - first, third - second
    if step == next_step:
        return third, 1.0
    # Not next_step², which overflows for large scales, of small profiles.
    limit = third - next_step * (next_step / (next_step - step))
    return limit, next_step / step if step != 0 else 0.0
