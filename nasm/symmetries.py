"""Symmetries of the map: their action on orbits, forcings and rotation numbers (Sec. III).

A symmetry takes (κ, x, y) to (κ', x', y') such that the orbit of (x', y') under κ' is the image of
the orbit of (x, y) under κ; each docstring states the image of ω. A forcing may have any period P;
for the paper's map P = 2. Under the same κ, (-x, -y) has the rotation number -ω, Eq. (17), and
(x + r, y + s) with integers r and s has ω + P·s, Eq. (18).

The symmetries of the forcing generate the symmetry group of the square on the (κ1, κ2) plane. The
boundary of global transport, CB_gt, is invariant under the whole group; the boundary of one circle,
CB_ω, is invariant up to ω → ω + 1. `nasm.planes` determines which of these symmetries another plane
of forcings has.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import chain, product
from math import floor

import numpy as np
from numpy.typing import ArrayLike

from nasm.checks import count, floats, points, real
from nasm.maps import forcing, kick, unkick
from nasm.numbers import RotationNumber, as_rotation_number, convergents, moebius, nobles_near
from nasm.types import FloatArray, OmegaLike

__all__ = [
    "alternate",
    "degenerate_partner",
    "dominant_centre",
    "half_shift_nobles",
    "lengthen",
    "negate",
    "ray",
    "shift",
    "shorten",
    "symmetry_lines",
]

CUSP_EXPONENT = 0.6
"""The boundary has a cusp at each forcing of shorter period, as CB_gt does on |κ1| = |κ2|. At a
relative distance d from that forcing, the boundary is lower by about d^0.6."""


def negate(
    kappa: ArrayLike, x: ArrayLike, y: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Negate the forcing: κ → -κ and x → x + 1/2, Eq. (20); ω is unchanged.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    x, y : array_like
        Points, in turns; x on the lift. Their shapes broadcast.

    Returns
    -------
    kappa, x, y : ndarray
        The images of the forcing, shape (P,), and of the points, in their broadcast shape.

    Examples
    --------
    >>> from nasm.symmetries import negate
    >>> kappa, x, y = negate((0.3, 0.5), 0.1, 0.25)
    >>> print(kappa, x, y)
    [-0.3 -0.5] 0.6 0.25
    """
    x, y = points(x, y)
    return -forcing(kappa), x + 0.5, y


def alternate(
    kappa: ArrayLike, x: ArrayLike, y: ArrayLike, spacing: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Alternate signs: κ_n → (-1)ⁿ κ_n and y → y + 1/2, for even P; ω → ω + P/2.

    For P = 2 this is Eq. (21), (κ1, κ2) → (κ1, -κ2): between kicks x advances by an extra 1/2.

    If only the sites c, c + m, c + 2m, … are kicked, where m = `spacing` and c < m, every second
    one of these kicks changes sign, and (x, y) → (x - c/2m, y + 1/2m); ω → ω + P/2m. P must be an
    even multiple of m.

    Parameters
    ----------
    kappa, x, y : array_like
        As for `negate`.
    spacing : int
        The distance m between kicked sites, from 1 to P.

    Returns
    -------
    kappa, x, y : ndarray
        As for `negate`.

    Raises
    ------
    ValueError
        If other sites are kicked, or P is not an even multiple of `spacing`.

    Examples
    --------
    >>> from nasm.symmetries import alternate
    >>> kappa, x, y = alternate((0.3, 0.5), 0.1, 0.25)
    >>> print(kappa, x, y)
    [ 0.3 -0.5] 0.1 0.75
    """
    strengths, (x, y) = forcing(kappa), points(x, y)
    spacing = count("spacing", spacing, 1, strengths.size)
    first = int(np.abs(strengths).argmax()) % spacing
    form = _alternated(strengths, spacing, first)
    if strengths.size % (2 * spacing) or (np.abs(form) != np.abs(strengths)).any():
        raise ValueError(
            f"kappa={kappa!r} must have an even number of kicks per period, at a spacing of "
            f"{spacing}, and no others; e.g. repeat it twice"
        )
    return form, x - first / (2 * spacing), y + 1 / (2 * spacing)


def shift(
    kappa: ArrayLike, x: ArrayLike, y: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Begin the period with the second kick: z → S_κ0(z), Eq. (7); ω is unchanged.

    (κ_0, …, κ_{P-1}) becomes (κ_1, …, κ_{P-1}, κ_0). Parameters and results are as for `negate`.

    Notes
    -----
    For P = 2 this swaps κ1 and κ2: S_κ1 ∘ T_{κ1κ2} = T_{κ2κ1} ∘ S_κ1. The paper's form with S_κ2⁻¹
    is equivalent: S_κ1(z) = S_κ2⁻¹(T z), one step later. In the paper's Eq. (28), S_κ2 should read
    S_κ2⁻¹.

    Examples
    --------
    >>> from nasm.symmetries import shift
    >>> kappa, x, y = shift((0.3, 0.5), 0.0, 0.25)
    >>> print(kappa, x, y)
    [0.5 0.3] 0.25 0.25
    """
    strengths = forcing(kappa)
    return np.roll(strengths, -1), *kick(strengths[0], *points(x, y))


def ray(angle: ArrayLike) -> FloatArray:
    """Compute the profile (cos, sin) of rays in the plane of two strengths.

    Parameters
    ----------
    angle : array_like
        Angles of the rays, in degrees.

    Returns
    -------
    ndarray, shape (*angle.shape, 2)
        On the axes one component is exactly 0; on the diagonals both components have
        the same modulus, to the last bit.

    Examples
    --------
    >>> from nasm.symmetries import ray
    >>> ray([0, 30]).round(4)
    array([[1.   , 0.   ],
           [0.866, 0.5  ]])
    """
    angle = floats("angle", angle)
    radians = np.deg2rad(angle)
    profile = np.stack([np.cos(radians), np.sin(radians)], axis=-1)
    on_axis, on_diagonal = angle % 90 == 0, angle % 90 == 45
    profile[on_axis] = np.rint(profile[on_axis])
    profile[on_diagonal] = np.sign(profile[on_diagonal]) * np.sqrt(0.5)
    return profile


def equivalent_forcings(vectors: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Apply every alternation, reversal, negation and shift to all rows of `vectors` alike.

    Yield (shift of ω, image of the rows); the images with unchanged ω come first.
    """
    period = vectors.shape[1]
    alternations = [(0, vectors)]
    if period % 2 == 0:
        alternations.append((period // 2, vectors * (-1.0) ** np.arange(period)))
    for (omega_shift, form), sign, order in product(alternations, (1, -1), (1, -1)):
        for places in range(period):
            yield omega_shift, sign * np.roll(form[:, ::order], places, axis=1)


def dominant_centre(kappa: ArrayLike) -> tuple[float, float]:
    """Find the symmetry centre whose orbits are minimax (R > 0) for all ω, if such a centre exists.

    Among the sites that are centres, this is the one with the largest |κ|, at x = 1/2 if κ > 0
    there and at x = 0 if κ < 0. If no site is a centre, the centre lies between two sites, and the
    sign of the sum of all κ determines x.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first. For P ≥ 3 minimax orbits of different ω may have different
        centres.

    Returns
    -------
    site : float
        From 0 to P - 1/2; a half-integer if the centre lies between two sites.
    x : float
        0 or 1/2, in turns.

    Raises
    ------
    ValueError
        If the forcing has no symmetry centre.

    Examples
    --------
    >>> from nasm.symmetries import dominant_centre
    >>> dominant_centre((0.3, 0.5))
    (1, 0.5)
    """
    strengths = forcing(kappa)
    # Try the strongest kicks first: for long forcings, only the first few sites need to be tried.
    sites = np.argsort(-np.abs(strengths), kind="stable").tolist()
    for site in chain(sites, (site + 0.5 for site in sorted(sites))):
        mirror = int(2 * site) - np.arange(strengths.size)
        if np.array_equal(strengths, strengths[mirror % strengths.size]):
            sign = strengths.sum() if site % 1 else strengths[site]
            return site, 0.5 if sign > 0 else 0.0
    raise ValueError(
        f"kappa={kappa!r} has no symmetry centre; symmetric orbits need a forcing that reads the "
        "same forwards and backwards from a site, or from halfway between two sites"
    )


def primitive(kappa: ArrayLike) -> FloatArray:
    """Return the kicks of the shortest period of the forcing, as an array."""
    strengths = forcing(kappa)
    sizes = _divisors(strengths.size)
    return next(strengths[:n] for n in sizes if (strengths[n:] == strengths[:-n]).all())


def symmetry_lines(kappa: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Compute points on the symmetry lines; their orbits are their own mirror images.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        A forcing with a symmetry centre c, first kick first.
    y : array_like
        Parameter along each line, in turns. The image of a line under y → y + 1 is
        also a symmetry line.

    Returns
    -------
    x, y : ndarray, shape (4, *y.shape)
        Points before the first kick, in turns, x on the lift. The first two rows belong to the
        lines x_c = 0 and x_c = 1/2, mapped back from site c to site 0; the last two rows, to the
        same lines for the other centre, c + P/2.

    Raises
    ------
    ValueError
        If the forcing has no centre.

    Examples
    --------
    >>> from nasm.symmetries import symmetry_lines
    >>> x, y = symmetry_lines((0.3, 0.5), [0.1])
    >>> x.ravel().round(3)
    array([-0.1,  0.4,  0. ,  0.5])
    """
    strengths = primitive(kappa)
    site, _ = dominant_centre(strengths)
    y, lines = floats("y", y), []
    other = (site + strengths.size / 2) % strengths.size
    for centre, a in product((site, other), (0.0, 0.5)):
        point = a + y * (centre % 1), y  # between two sites, x_c is the mean of their x
        for strength in strengths[: int(np.ceil(centre))][::-1]:
            point = unkick(strength, *point)
        lines.append(np.broadcast_arrays(*point))
    return tuple(np.stack(lines, axis=1))


def shorten(
    forcings: Sequence[ArrayLike] | FloatArray, omega: OmegaLike
) -> tuple[list[FloatArray], RotationNumber]:
    """Find the shortest forcings with the same orbits up to symmetry; convert ω to their period.

    On κ1 = κ2 one step consists of two steps of the standard map, with rotation number ω/2. On
    κ1 = -κ2 the same holds up to the symmetry `alternate`.

    Parameters
    ----------
    forcings : sequence of array_like, shape (P,)
        Forcings of the same period, all shortened in the same way.
    omega : RotationNumber or str
        Rotation number per P kicks.

    Returns
    -------
    forcings : list of ndarray, shape (P',)
        P' is a divisor of P.
    omega : RotationNumber
        Rotation number per P' kicks, shifted by y → y + 1 into [0, P'].

    Examples
    --------
    >>> from nasm.symmetries import shorten
    >>> shorten([(0.3, 0.3)], "gamma")
    ([array([0.3])], parse("[0;3,(4)]"))
    """
    kappas = np.array([forcing(kappa, "forcings") for kappa in forcings])
    length, spacing, short = _shortest(kappas)
    if spacing:
        omega = moebius(omega, 1, kappas.shape[1] // (2 * spacing))
    omega = moebius(omega, 1, 0, 0, kappas.shape[1] // length)
    whole, *rest = omega.prefix
    return list(short), RotationNumber((whole % length, *rest), omega.tail)


def half_shift_nobles(
    kappa: ArrayLike, value: float, width: float, n: int, max_distance: float = 3e-6
) -> list[RotationNumber]:
    """List the rotation numbers ω close to `value` for which (ω + 1)/2 is noble.

    If the forcing is antiperiodic, κ_{j+P/2} = -κ_j exactly or nearly, one period is the square of
    a single map: half a period, followed by x → x + 1/2. The rotation number of this map is
    (ω + 1)/2. Under (1, 1, -1, -1) the circle of [0;(4)] = 2γ - 1 breaks last.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing; unless it is antiperiodic to within `max_distance`, the result is empty.
    value : float
        ω per period.
    width : float
        Largest distance from `value`, > 0.
    n : int
        Maximum number of rotation numbers to return.
    max_distance : float
        Distance from κ_{j+P/2} = -κ_j, relative to the largest strength, up to which these circles
        break last; at a distance of 10⁻⁴ other circles do.

    Returns
    -------
    list of RotationNumber
        Sorted by the length of the prefix of (ω + 1)/2, the shortest first.

    Examples
    --------
    >>> from nasm.symmetries import half_shift_nobles
    >>> half_shift_nobles((1, 1, -1, -1), 0.236, 1e-3, 1)
    [parse("[0;(4)]")]
    """
    value, width, n = real("value", value), real("width", width), count("n", n, 0, 10**6)
    max_distance = real("max_distance", max_distance)
    if not _distance_to_antiperiodic(forcing(kappa)) <= max_distance:
        return []
    return [moebius(rho, 2, -1) for rho in nobles_near((value + 1) / 2, width / 2, n)]


def lengthen(kappa: ArrayLike, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Undo `shorten` for points: map points under the shortened forcing to points under kappa.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing that was shortened.
    x, y : array_like
        Points of an orbit under the shortened forcing, in turns; x on the lift.

    Returns
    -------
    x, y : ndarray
        Points of the same orbit under kappa.

    Examples
    --------
    >>> from nasm.symmetries import lengthen
    >>> x, y = lengthen((0.3, -0.3), 0.1, 0.7)
    >>> print(f"{x:.2f} {y:.2f}")
    0.10 0.20
    """
    strengths, (x, y) = forcing(kappa), points(x, y)
    _, spacing, _ = _shortest(strengths[None])
    if not spacing:
        return x, y
    _, before, above = alternate(strengths, 0.0, 0.0, spacing)
    return x - before, y - above


def distances_to_shorter(kappa: ArrayLike, rounding: float = 1e-15) -> FloatArray:
    """Compute the distances of a forcing from the forcings that `shorten` can shorten.

    There is at least one distance for each shorter period. If P is even, the distance from
    antiperiodic forcings, κ_{j+P/2} = -κ_j, is included, unless kappa is antiperiodic to rounding.

    Parameters
    ----------
    kappa : array_like, shape (P,)
        The forcing, first kick first.
    rounding : float
        Largest distance from antiperiodic forcings that is attributed to rounding of cosines.

    Returns
    -------
    ndarray, shape (n,)
        Each distance is the largest change in a strength that is needed to reach such a forcing,
        relative to the largest |κ|.
    """
    strengths = forcing(kappa)
    size = np.abs(strengths).max()
    distances = [change / size if size > 0 else 0.0 for change, *_ in _shorter(strengths[None])]
    antiperiodic = _distance_to_antiperiodic(strengths)
    if rounding < antiperiodic < np.inf:
        distances.append(antiperiodic)
    return np.array(distances)


def _distance_to_antiperiodic(kappa: FloatArray) -> float:
    """Compute the relative distance from κ_{j+P/2} = -κ_j; inf for an odd P, and for κ = 0."""
    size = np.abs(kappa).max()
    if kappa.size % 2 or size == 0:
        return np.inf
    return np.abs(np.roll(kappa, kappa.size // 2) + kappa).max() / size


def _shortest(kappas: FloatArray) -> tuple[int, int, FloatArray]:
    """Return (period, spacing, rows) for the shortest period of the forcings in the rows.

    The spacing is the distance between the kicks whose signs must be alternated to reach this
    period; it is 0 if no signs change.
    """
    exact = (
        (length, spacing, rows) for change, length, spacing, rows in _shorter(kappas) if change == 0
    )
    return next(exact, (kappas.shape[1], 0, kappas))


def _shorter(kappas: FloatArray) -> Iterator[tuple[float, int, int, FloatArray]]:
    """Yield (change, period, spacing, rows) for each shorter period.

    `change` is the largest change in a strength that is needed to reach that period; the other
    values are as in `_shortest`. Either the forcings themselves or, for each spacing m, their
    alternated forms are made periodic with the shorter period. The alternated form keeps every m-th
    kick, including the one with the largest |κ|, and changes the sign of every second one of them;
    all other strengths are 0.
    """
    period, size = kappas.shape[1], np.abs(kappas)
    largest = int(size.max(axis=0).argmax())
    spacings = [m for m in _divisors(period) if period // m % 2 == 0]
    forms = [(0, kappas)] + [(m, _alternated(kappas, m, largest % m)) for m in spacings]
    for length, (spacing, form) in product(_divisors(period)[:-1], forms):
        if spacing == 0 or length % spacing == 0:
            periods = form.reshape(len(form), -1, length)
            change = max(np.ptp(periods, axis=1).max(), (size - np.abs(form)).max())
            yield change, length, spacing, form[:, :length]


def _alternated(kappas: FloatArray, spacing: int, first: int) -> FloatArray:
    form = np.zeros_like(kappas)
    form[..., first :: 2 * spacing] = kappas[..., first :: 2 * spacing]
    form[..., first + spacing :: 2 * spacing] = -kappas[..., first + spacing :: 2 * spacing]
    return form


@lru_cache
def _divisors(n: int) -> list[int]:
    return [divisor for divisor in range(1, n + 1) if n % divisor == 0]


def per_period(
    omega: RotationNumber, profile: FloatArray, short: FloatArray, zero: RotationNumber
) -> RotationNumber:
    """Convert ω under a shortened forcing to ω per period of the long forcing, in [0, P/2].

    Parameters
    ----------
    omega : RotationNumber
        Rotation number per period of `short`.
    profile, short : ndarrays, shapes (P,) and (P',)
        The forcing, and its shorter form from `shorten`.
    zero : RotationNumber
        ω under `short` that corresponds to ω = 0 under `profile`.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.symmetries import per_period
    >>> from nasm.numbers import parse, rational
    >>> per_period(parse("gamma"), np.ones(2), np.ones(1), rational(0))
    parse("[0;1,3,(4)]")
    """
    period, ratio = profile.size, profile.size // short.size
    (*_, shift) = convergents(zero)
    omega = moebius(
        omega, ratio * shift.denominator, -ratio * shift.numerator, 0, shift.denominator
    )
    omega = moebius(omega, 1, -period * floor(float(omega) / period))
    omega = omega if float(omega) <= period / 2 else moebius(omega, -1, period)
    return min(
        omega, degenerate_partner(omega, profile) or omega, key=lambda ω: len(ω.prefix + ω.tail)
    )


def degenerate_partner(omega: OmegaLike, profile: ArrayLike) -> RotationNumber | None:
    """Return P/2 - ω if its circle breaks together with that of ω; otherwise None.

    y → y + 1/2 changes the sign of every other kick (`alternate`) and takes ω to ω + P/2. The two
    circles break together if another symmetry restores the signs: a shift in time, time reversal or
    x → x + 1/2. This is the case if every other kick is zero, or under (1, 1, -1, -1). For
    example, the circles of γ and 1 - γ break together on the axes of the (κ1, κ2) plane; the paper
    calls this last circle γ.

    Examples
    --------
    >>> from nasm.symmetries import degenerate_partner
    >>> degenerate_partner("gamma", (1, 0))
    parse("[0;2,(1)]")
    >>> degenerate_partner("gamma", (1, 0.5)) is None
    True
    """
    profile, omega = forcing(profile, "profile"), as_rotation_number(omega)
    equivalent = equivalent_forcings(profile[None])
    same = (turn for turn, (kappa,) in equivalent if np.array_equal(kappa, profile))
    return moebius(omega, -1, profile.size // 2) if any(same) else None
