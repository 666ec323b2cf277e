"""Stable and unstable manifolds of the minimizing p/q orbit, and the turnstiles of its resonance.

The minimizing orbit is hyperbolic, R < 0. Along the unstable direction v of one of its points z,

    W(t) = T^{qk}(z + ε λ^{t-k} v) - (pk, 0),    k = ⌊t⌋,    ε = 10⁻⁶,

λ > 1 the eigenvalue of DT^q, is its unstable manifold up to ε² or so, since T^q draws points to it.
T⁻¹ is T with the kicks in reversed order seen in the coordinates (y - x, y), so that the stable
manifold is the image of an unstable one.

The manifolds of neighbouring points of the orbit cross on a homoclinic orbit that minimizes the
action and on one that is minimax. From one point of the first to the next two lobes of equal area
lie between them, the *turnstile*: in each step of T one passes upwards, one downwards. Both orbits
are the limits of the periodic orbits of (np + p')/(nq + q'), with p'/q' the Farey neighbour of p/q
above or below, so that the area is that of `flux.action_difference`.

MacKay, Meiss & Percival, Physica D 13 (1984) 55; 27 (1987) 1.
"""

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import ceil

import numpy as np

from nasm.action import MAX_PERIOD, LostError, ordered_orbits
from nasm.checks import count, positive, real
from nasm.checks import points as checked_points
from nasm.critical import Result
from nasm.flux import action_difference
from nasm.maps import forcing, step_tangent
from nasm.orbits import orbit

__all__ = ["Turnstile", "stable", "turnstile", "unstable"]

_BEGIN = 1e-6  # ε
_CLOSED = 1e-10  # times the norm of DT^q: a point that comes back so near is on a periodic orbit
_MOST = 2 * 10**5  # points of a curve
_FAR = 36.0  # ln λ^n of the periodic orbits of a turnstile: they come as near as rounding
_LONGEST = 20_000  # their period
_FURTHEST = 20.0  # turns along a manifold to its turnstile


def unstable(kappa, p, q, x, y, length, spacing=2e-3, toward=1):
    """One branch of the unstable manifold of a point of the minimizing p/q orbit.

    kappa : sequence of P floats, the forcing, first kick first.
    p, q, x, y : the fraction, and a point of its minimizing orbit, x on the lift: q steps of T take
        it to (x + p, y).
    length : in turns, of the branch, > 0.
    spacing : from each of its points to the next, > 0.
    toward : 1 for the branch that begins to the right, -1 to the left.

    Returns x, y : arrays, from the point on, on the lift; shorter than asked for beyond 2·10⁵
    points.

    ValueError if the point is not on a p/q orbit, or not hyperbolic.
    """
    arguments = _checked(kappa, p, q, x, y, length, spacing, toward)
    return _branch(*arguments)


def stable(kappa, p, q, x, y, length, spacing=2e-3, toward=1):
    """One branch of the stable manifold; parameters and results are those of `unstable`."""
    kappa, p, q, x, y, *rest, toward = _checked(kappa, p, q, x, y, length, spacing, toward)
    # In these coordinates what lies to the right along it lies to the left.
    x, y = _branch(kappa[::-1], p, q, y - x, y, *rest, -toward)
    return y - x, y


def _checked(kappa, p, q, x, y, length, spacing, toward):
    kappa, q = forcing(kappa), count("q", q, 1, MAX_PERIOD)
    p = count("p", p, -MAX_PERIOD * kappa.size, MAX_PERIOD * kappa.size)
    x, y = (float(one) for one in checked_points(x, y))
    length = positive("length", length, "turns along the manifold")
    spacing = positive("spacing", spacing, "turns from one of its points to the next")
    if toward not in (1, -1):
        raise ValueError(f"toward={toward!r} must be 1, to the right, or -1, to the left")
    whole = np.tile(kappa, q)
    (_, end_x), (_, end_y) = orbit(whole, x, y, 1)
    apart = np.hypot(end_x - p - x, end_y - y)
    if not apart < _CLOSED * max(1.0, np.linalg.norm(step_tangent(whole, x, y))):
        raise ValueError(
            f"({x}, {y}) is not on an orbit of p/q = {p}/{q}: it comes back {apart:.2g} beside "
            f"itself; `action.ordered_orbits(kappa, {p}, {q})[0].points()` are"
        )
    return kappa, p, q, x, y, length, spacing, toward


def _branch(kappa, p, q, x, y, length, spacing, toward):
    whole = np.tile(kappa, q)
    values, vectors = np.linalg.eig(step_tangent(whole, x, y))
    largest = int(np.argmax(values.real))
    factor, (dx, dy) = values[largest].real, vectors[:, largest].real
    part = np.linspace(0, 1, 17)
    if not np.log(max(factor, 1.0)) > -np.log(_BEGIN) * part.size / _MOST:
        raise ValueError(
            f"({x}, {y}) is not hyperbolic, with λ = {factor}; it has no manifolds, or none that "
            f"{_MOST} points show"
        )
    dx, dy = (toward * np.sign(dx) * along for along in (dx, dy))
    n = ceil(-np.log(_BEGIN) / np.log(factor))
    while True:
        away = _BEGIN * factor**part
        xs, ys = orbit(whole, x + away * dx, y + away * dy, n)
        xs -= p * np.arange(n + 1)[:, None]
        gaps = np.hypot(np.diff(xs, axis=1), np.diff(ys, axis=1))
        so_far = np.cumsum(gaps.sum(axis=1))
        if so_far[-1] < length and part.size * n <= _MOST:
            n += 1 + n // 8
            continue
        enough = min(int(np.searchsorted(so_far, length)) + 1, n + 1)
        wide = (gaps[:enough] > spacing).any(axis=0)
        if not wide.any() or part.size * enough > _MOST:
            break
        part = np.sort(np.concatenate([part, (part[1:] + part[:-1])[wide] / 2]))
    xs, ys = (np.r_[z, w[:enough, :-1].ravel()] for z, w in ((x, xs), (y, ys)))
    along = np.cumsum(np.hypot(np.diff(xs, prepend=x), np.diff(ys, prepend=y)))
    kept = np.unique(np.floor(2 * along / spacing), return_index=True)[1]
    kept = kept[along[kept] <= length]
    return xs[kept], ys[kept]


@dataclass(frozen=True, eq=False)
class Turnstile(Result):
    """What passes one edge of the resonance of p/q.

    area : of a lobe, in turns times y, that passes upwards in one step of T, and as much downwards.
    lobes : two arrays (2, n), x and y of their edges on the lift.
    """

    area: float
    lobes: tuple


def turnstile(kappa, p, q, above, spacing=1e-3):
    """The turnstile of the upper (above) or lower edge of the resonance of p/q.

    kappa : sequence of P floats, the forcing, first kick first.
    p, q : ints without common factor.
    spacing : of the points of the lobes' edges, in turns, from 10⁻⁵ to 0.1.

    LostError if the orbits that tend to the homoclinic ones are not found, or differ by rounding,
    as where R is about 0.
    """
    kappa, spacing = forcing(kappa), real("spacing", spacing, 1e-5, 0.1)
    points, _ = ordered_orbits(kappa, p, q)
    if not points.residue < 0:
        raise LostError(f"the minimizing orbit of {p}/{q} is not hyperbolic up to rounding: R = 0")
    near = _neighbour(p, q, above)
    n = ceil(_FAR / np.arccosh(1 - 2 * points.residue))
    long = n * p + near.numerator, n * q + near.denominator
    if long[1] > _LONGEST:
        raise LostError(
            f"the resonance of {p}/{q} is too thin, R = {points.residue:.2g}: the orbits next to "
            f"its homoclinic ones have periods above {_LONGEST}"
        )
    minimizing, minimax = ordered_orbits(kappa, *long)
    if minimax.residue == 0:
        raise LostError(f"the homoclinic orbits of {p}/{q} differ by less than rounding")
    least, most = (np.array(found.points()) for found in (minimizing, minimax))
    ends = np.array(points.points())
    apart = (least[:, :, None] - ends[:, None] + 0.5) % 1 - 0.5
    m = int(np.hypot(*apart).min(axis=1).argmax())
    # In time: from next to a point of the p/q orbit, past the middle of a gap, to the next point.
    start, first, last, end = (_at(least, m + j * q, long, j * p) for j in (-n // 2, 0, 1, n // 2))
    onward = 1 if above else -1
    if not above:  # a minimax orbit is to the right of the minimizing one
        m += q
    middle = _at(most, m, long, p * (not above))
    points = [first, middle, last]
    curves = [
        _through(branch, kappa, p, q, ends, z, toward, points, spacing)
        for branch, z, toward in ((unstable, start, onward), (stable, end, -onward))
    ]
    lobes = tuple(np.hstack([one, other[:, ::-1]]) for one, other in zip(*curves, strict=True))
    return Turnstile(action_difference(kappa, *long), lobes)


def _at(points, i, long, whole):
    """Point i of a periodic orbit of p, q = `long`, on the lift, so many turns to the left."""
    turns, i = divmod(i, long[1])
    return points[:, i] + [turns * long[0] - whole, 0.0]


def _through(branch, kappa, p, q, ends, start, toward, points, spacing):
    """The pieces of a branch from one of three points to the next; it begins next to `start`."""
    away = start[:, None] - ends
    away[0] -= np.rint(away[0])
    x, y = start - away[:, np.hypot(*away).argmin()]
    length = 0.5 / q
    while True:
        curve = np.array(branch(kappa, p, q, x, y, length, spacing, toward))
        apart = np.hypot(*(curve[:, :, None] - np.transpose(points)[:, None]))
        if (apart.min(axis=0) < 2 * spacing).all():
            break
        length *= 1.5
        if length > _FURTHEST:
            raise LostError(
                f"the manifolds of {p}/{q} do not come within {2 * spacing} of the homoclinic "
                f"orbits in {_FURTHEST} turns"
            )
    at = apart.argmin(axis=0)
    pieces = []
    for (i, one), (j, other) in pairwise(zip(at, points, strict=True)):
        between = curve[:, i + 1 : j] if i < j else curve[:, j + 1 : i][:, ::-1]
        pieces.append(np.column_stack([one, between, other]))
    return pieces


def _neighbour(p, q, above):
    """The Farey neighbour of p/q with the least denominator, above or below it."""
    sign = 1 if above else -1
    q_near = -sign * pow(p, -1, q) % q or 1  # q·p' - p·q' = sign; 1 if q = 1
    return Fraction((p * q_near + sign) // q, q_near)
