"""Stable and unstable manifolds of the minimizing p/q orbit, and the turnstiles of its resonance.

The minimizing orbit is hyperbolic, R < 0. With the unstable direction v at one of its points z, the
curve

    W(t) = T^{qk}(z + ε λ^{t-k} v) - (pk, 0),    k = ⌊t⌋,

where ε is small and λ > 1 is the eigenvalue of DT^q, is the unstable manifold of z up to an error
of about ε², since T^q attracts points to the manifold. In the coordinates (y - x, y), T⁻¹ is T with
the kicks in reverse order, so the stable manifold is the image of an unstable one.

The manifolds of neighbouring points of the orbit cross at the points of two homoclinic orbits: one
minimizes the action, the other is a minimax orbit. Between one point of the minimizing orbit and
the next, the manifolds enclose two lobes of equal area, the *turnstile*: in each step of T one lobe
passes upwards and the other downwards. Both homoclinic orbits are limits of periodic orbits with
rotation number (np + p')/(nq + q'), where p'/q' is the Farey neighbour of p/q above or below it, so
the area is given by `flux.action_difference`.

MacKay, Meiss & Percival, Physica D 13 (1984) 55; 27 (1987) 1.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from nasm.action import MAX_PERIOD, LostError, ordered_orbits
from nasm.checks import count, positive, real
from nasm.checks import points as checked_points
from nasm.flux import action_difference
from nasm.maps import forcing, step_tangent
from nasm.orbits import orbit
from nasm.results import Result
from nasm.tables import html_table
from nasm.types import FloatArray

__all__ = ["ManifoldSettings", "Turnstile", "stable", "turnstile", "unstable"]


@dataclass(frozen=True)
class ManifoldSettings:
    """Settings that determine how manifolds begin and how far they are followed.

    Attributes
    ----------
    epsilon : float
        Distance from the periodic point at which a branch begins, in turns: the ε above.
    max_miss : float
        Largest accepted distance from a point of a periodic orbit to its image under T^q, relative
        to the norm of DT^q, or to 1 if that is larger.
    max_points : int
        Maximum number of points on a curve.
    max_period : int
        Longest period of the orbits that approximate the homoclinic orbits of a turnstile.
    max_length : float
        Maximum length of a manifold up to its turnstile, in turns.

    Examples
    --------
    >>> from nasm.manifolds import ManifoldSettings, unstable
    >>> branch = (0.5,), 0, 1, 0.0, 0.0, 0.3, 0.1
    >>> x, _ = unstable(*branch, settings=ManifoldSettings(epsilon=1e-5))
    >>> x.round(2)
    array([0.  , 0.05, 0.09, 0.14, 0.19, 0.23])
    """

    epsilon: float = 1e-6
    max_miss: float = 1e-10
    max_points: int = 2 * 10**5
    max_period: int = 20_000
    max_length: float = 20.0


DEFAULT_SETTINGS = ManifoldSettings()


def unstable(
    kappa: ArrayLike,
    p: int,
    q: int,
    x: float,
    y: float,
    length: float,
    spacing: float = 2e-3,
    toward: int = 1,
    settings: ManifoldSettings = DEFAULT_SETTINGS,
) -> tuple[FloatArray, FloatArray]:
    """Compute one branch of the unstable manifold of a point of the minimizing p/q orbit.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    p, q : int
        Coprime, 1 ≤ q ≤ 10⁶.
    x, y : float
        A point of the minimizing orbit, in turns, x on the lift: q steps of T map it to (x + p, y).
    length : float
        Length of the branch, in turns, > 0.
    spacing : float
        Largest distance from each point of the branch to the next, in turns, > 0.
    toward : {1, -1}
        1 for the branch that starts to the right, -1 for the branch that starts to the left.
    settings : ManifoldSettings
        How the branch begins, and how many points it may have.

    Returns
    -------
    x, y : ndarray, shape (n,)
        Points on the lift, starting at (x, y); a branch is cut short at settings.max_points.

    Raises
    ------
    ValueError
        If the point is not on a p/q orbit, or is not hyperbolic.

    Examples
    --------
    >>> from nasm.manifolds import unstable
    >>> x, y = unstable((0.5,), 0, 1, 0.0, 0.0, length=0.3, spacing=0.1)
    >>> x.round(2)
    array([0.  , 0.05, 0.09, 0.14, 0.18, 0.23])
    """
    arguments = _checked(kappa, p, q, x, y, length, spacing, toward, settings)
    return _branch(*arguments, settings)


def stable(
    kappa: ArrayLike,
    p: int,
    q: int,
    x: float,
    y: float,
    length: float,
    spacing: float = 2e-3,
    toward: int = 1,
    settings: ManifoldSettings = DEFAULT_SETTINGS,
) -> tuple[FloatArray, FloatArray]:
    """Compute one branch of the stable manifold; parameters and results are as for `unstable`.

    Examples
    --------
    >>> from nasm.manifolds import stable
    >>> x, y = stable((0.5,), 0, 1, 0.0, 0.0, length=0.3, spacing=0.1)
    >>> y.round(2)
    array([ 0.  , -0.02, -0.04, -0.07, -0.09, -0.11])
    """
    kappa, p, q, x, y, length, spacing, toward = _checked(
        kappa, p, q, x, y, length, spacing, toward, settings
    )
    # In the coordinates (y - x, y), left and right are exchanged.
    xs, ys = _branch(kappa[::-1], p, q, y - x, y, length, spacing, -toward, settings)
    return ys - xs, ys


def _checked(
    kappa: ArrayLike,
    p: int,
    q: int,
    x: float,
    y: float,
    length: float,
    spacing: float,
    toward: int,
    settings: ManifoldSettings,
) -> tuple[FloatArray, int, int, float, float, float, float, int]:
    """Check the arguments of `unstable`, and return all but `settings`, converted."""
    kappa, q = forcing(kappa), count("q", q, 1, MAX_PERIOD)
    p = count("p", p, -MAX_PERIOD * kappa.size, MAX_PERIOD * kappa.size)
    x, y = (float(coordinate) for coordinate in checked_points(x, y))
    length = positive("length", length, "turns along the manifold")
    spacing = positive("spacing", spacing, "turns from one of its points to the next")
    if toward not in (1, -1):
        raise ValueError(f"toward={toward!r} must be 1, to the right, or -1, to the left")
    kicks = np.tile(kappa, q)
    (_, end_x), (_, end_y) = orbit(kicks, x, y, 1)
    miss = np.hypot(end_x - p - x, end_y - y)
    norm = float(np.linalg.norm(step_tangent(kicks, x, y)))
    if not miss < settings.max_miss * max(1.0, norm):
        raise ValueError(
            f"({x}, {y}) is not on an orbit of p/q = {p}/{q}: after q periods "
            f"it is off by {miss:.2g}; use a point of "
            f"`action.ordered_orbits(kappa, {p}, {q})[0].points()`"
        )
    return kappa, p, q, x, y, length, spacing, toward


def _branch(
    kappa: FloatArray,
    p: int,
    q: int,
    x: float,
    y: float,
    length: float,
    spacing: float,
    toward: int,
    settings: ManifoldSettings,
) -> tuple[FloatArray, FloatArray]:
    """Compute a branch of the unstable manifold; the arguments are already checked."""
    kicks, epsilon, max_points = np.tile(kappa, q), settings.epsilon, settings.max_points
    values, vectors = np.linalg.eig(step_tangent(kicks, x, y))
    largest = int(np.argmax(values.real))
    factor, (dx, dy) = values[largest].real, vectors[:, largest].real
    part = np.linspace(0, 1, 17)
    if not np.log(max(factor, 1.0)) > -np.log(epsilon) * part.size / max_points:
        raise ValueError(
            f"({x}, {y}) is not hyperbolic enough: with λ = {factor}, {max_points} points do not "
            "resolve a manifold; use a point of a minimizing orbit with R < 0"
        )
    dx, dy = (toward * np.sign(dx) * component for component in (dx, dy))
    n = ceil(-np.log(epsilon) / np.log(factor))
    while True:
        distance = epsilon * factor**part
        xs, ys = orbit(kicks, x + distance * dx, y + distance * dy, n)
        xs -= p * np.arange(n + 1)[:, None]
        gaps = np.hypot(np.diff(xs, axis=1), np.diff(ys, axis=1))
        lengths = np.cumsum(gaps.sum(axis=1))
        if lengths[-1] < length and part.size * n <= max_points:
            n += 1 + n // 8
            continue
        n_images = min(int(np.searchsorted(lengths, length)) + 1, n + 1)
        wide = (gaps[:n_images] > spacing).any(axis=0)
        if not wide.any() or part.size * n_images > max_points:
            break
        part = np.sort(np.concatenate([part, (part[1:] + part[:-1])[wide] / 2]))
    xs, ys = (np.r_[z, w[:n_images, :-1].ravel()] for z, w in ((x, xs), (y, ys)))
    arc = np.cumsum(np.hypot(np.diff(xs, prepend=x), np.diff(ys, prepend=y)))
    indices = np.unique(np.floor(2 * arc / spacing), return_index=True)[1]
    indices = indices[arc[indices] <= length]
    return xs[indices], ys[indices]


@dataclass(frozen=True, eq=False, repr=False)
class Turnstile(Result):
    """Turnstile at one edge of the p/q resonance.

    Attributes
    ----------
    area : float
        Area of a lobe, in turns times y: in each step of T this area passes upwards, and the same
        area downwards.
    lobes : tuple of two ndarrays, shape (2, n)
        x and y along the boundary of each lobe, on the lift.
    """

    area: float
    lobes: tuple[FloatArray, FloatArray]

    def __repr__(self) -> str:
        return f"<Turnstile: lobes of area {self.area:.6g}, with {self._sizes()} points>"

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        rows = {"area of a lobe, per step": f"{self.area:.12g}", "points": self._sizes()}
        return html_table(rows, "Turnstile")

    def _sizes(self) -> str:
        return " and ".join(f"{lobe.shape[1]}" for lobe in self.lobes)


def turnstile(
    kappa: ArrayLike,
    p: int,
    q: int,
    above: bool,
    spacing: float = 1e-3,
    settings: ManifoldSettings = DEFAULT_SETTINGS,
) -> Turnstile:
    """Compute the turnstile at the upper or lower edge of the p/q resonance.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    p, q : int
        Coprime.
    above : bool
        True for the upper edge.
    spacing : float
        Distance between points on the boundaries of the lobes, in turns, from 10⁻⁵ to 0.1.
    settings : ManifoldSettings
        How the manifolds begin, and how far they are followed.

    Raises
    ------
    LostError
        If the orbits that approximate the homoclinic ones are not found, are longer than
        settings.max_period, or differ only by rounding errors, as they do where R is about 0; or if
        the manifolds do not come close to the homoclinic orbits within settings.max_length.

    Examples
    --------
    >>> from nasm.manifolds import turnstile
    >>> upper = turnstile((0.9,), 0, 1, True, spacing=0.05)
    >>> print(f"{upper.area:.3g}")
    0.000383
    """
    kappa, spacing = forcing(kappa), real("spacing", spacing, 1e-5, 0.1)
    resonant, _ = ordered_orbits(kappa, p, q)
    if not resonant.residue < 0:
        raise LostError(f"the minimizing orbit of {p}/{q} is not hyperbolic up to rounding: R = 0")
    neighbour = _neighbour(p, q, above)
    # With λ^n = 1/eps, the homoclinic orbits of a turnstile are periodic orbits up to rounding.
    n = ceil(-np.log(np.finfo(float).eps) / np.arccosh(1 - 2 * resonant.residue))
    long = n * p + neighbour.numerator, n * q + neighbour.denominator
    if long[1] > settings.max_period:
        raise LostError(
            f"the resonance of {p}/{q} is too thin, R = {resonant.residue:.2g}: the orbits that "
            f"approximate its homoclinic ones have periods above {settings.max_period}"
        )
    minimizing, minimax = ordered_orbits(kappa, *long)
    if minimax.residue == 0:
        raise LostError(f"the homoclinic orbits of {p}/{q} differ only by rounding errors")
    minimizing_points, minimax_points = (
        np.array(orbit.points()) for orbit in (minimizing, minimax)
    )
    ends = np.array(resonant.points())
    offsets = (minimizing_points[:, :, None] - ends[:, None] + 0.5) % 1 - 0.5
    m = int(np.hypot(*offsets).min(axis=1).argmax())
    # In order of time, these points run from near one point of the p/q orbit, past the middle of a
    # gap, to near the next point.
    start, first, last, end = (
        _at(minimizing_points, m + j * q, long, j * p) for j in (-n // 2, 0, 1, n // 2)
    )
    onward = 1 if above else -1
    if not above:  # the minimax orbit is to the right of the minimizing one
        m += q
    middle = _at(minimax_points, m, long, p * (not above))
    crossings = [first, middle, last]
    resolution = spacing, settings
    unstable_pieces = _pieces(unstable, kappa, p, q, ends, start, onward, crossings, *resolution)
    stable_pieces = _pieces(stable, kappa, p, q, ends, end, -onward, crossings, *resolution)
    lower, upper = (
        np.hstack([there, back[:, ::-1]])
        for there, back in zip(unstable_pieces, stable_pieces, strict=True)
    )
    return Turnstile(action_difference(kappa, *long), (lower, upper))


def _at(points: FloatArray, i: int, long: tuple[int, int], shift: int) -> FloatArray:
    """Return point i of the orbit of (p, q) = `long`, on the lift, moved left by `shift` turns."""
    turns, i = divmod(i, long[1])
    return points[:, i] + [turns * long[0] - shift, 0.0]


def _pieces(
    branch: Callable[..., tuple[FloatArray, FloatArray]],
    kappa: FloatArray,
    p: int,
    q: int,
    ends: FloatArray,
    start: FloatArray,
    toward: int,
    crossings: Sequence[FloatArray],
    spacing: float,
    settings: ManifoldSettings,
) -> list[FloatArray]:
    """Return the two pieces of a branch between three crossings.

    The branch begins at the point of the p/q orbit, given by `ends`, that is nearest to `start`.
    """
    offsets = start[:, None] - ends
    offsets[0] -= np.rint(offsets[0])
    x, y = start - offsets[:, np.hypot(*offsets).argmin()]
    length = 0.5 / q
    while True:
        curve = np.array(branch(kappa, p, q, x, y, length, spacing, toward, settings))
        distances = np.hypot(*(curve[:, :, None] - np.transpose(crossings)[:, None]))
        if (distances.min(axis=0) < 2 * spacing).all():
            break
        length *= 1.5
        if length > settings.max_length:
            raise LostError(
                f"the manifolds of {p}/{q} do not come within {2 * spacing} of the homoclinic "
                f"orbits within a length of {settings.max_length} turns"
            )
    nearest = distances.argmin(axis=0)
    pieces = []
    for (i, one), (j, other) in pairwise(zip(nearest, crossings, strict=True)):
        between = curve[:, i + 1 : j] if i < j else curve[:, j + 1 : i][:, ::-1]
        pieces.append(np.column_stack([one, between, other]))
    return pieces


def _neighbour(p: int, q: int, above: bool) -> Fraction:
    """Return the Farey neighbour above or below p/q with the smallest denominator."""
    sign = 1 if above else -1
    denominator = -sign * pow(p, -1, q) % q or 1  # q·p' - p·q' = sign; q' = 1 if q = 1
    return Fraction((p * denominator + sign) // q, denominator)
