"""How orbits, forcings and rotation numbers move under the map's symmetries (Sec. III).

A symmetry takes (κ, x, y) to (κ', x', y') such that the orbit of (x', y') under κ' is the image of
the orbit of (x, y) under κ; each docstring says what becomes of ω. Forcings have any period P; for
the paper's map P = 2. Under the same κ, (-x, -y) has the rotation number -ω, Eq. (17), and
(x + r, y + s) with whole r and s has ω + P·s, Eq. (18).

The symmetries of the forcing generate the symmetry group of the square on the (κ1, κ2) plane. The
boundary of global transport, CB_gt, has all of it. That of one circle, CB_ω, has it up to
ω → ω + 1. `nasm.planes` finds which of them another plane of forcings has.
"""

from functools import lru_cache
from itertools import chain, product

import numpy as np

from nasm.checks import count, floats, points, real
from nasm.maps import forcing, kick, unkick
from nasm.numbers import RotationNumber, moebius, nobles_near

__all__ = [
    "alternate",
    "dominant_centre",
    "halfway_nobles",
    "lengthen",
    "negate",
    "ray",
    "shift",
    "shorten",
    "symmetry_lines",
]

_NEARLY = 3e-6  # of the largest strength: at 1e-4 neighbours break later
_ROUNDED = 1e-15  # of the largest strength: sums of cosines that were meant to be opposite
CUSP_EXPONENT = 0.6
"""At a relative distance d from a forcing of a shorter period the boundary is below what it is
there by about d^0.6: it has cusps, as that of CB_gt on |κ1| = |κ2|."""


def negate(kappa, x, y):
    """κ → -κ and x → x + 1/2, Eq. (20); ω unchanged."""
    x, y = points(x, y)
    return -forcing(kappa), x + 0.5, y


def alternate(kappa, x, y, spacing=1):
    """κ_n → (-1)ⁿ κ_n and y → y + 1/2, for even P; ω → ω + P/2.

    For P = 2 this is Eq. (21), (κ1, κ2) → (κ1, -κ2): each kick finds x further by one half
    than the kick before it did.

    Where only the sites c, c + m, c + 2m, … are kicked, c < m = spacing, their signs alternate, and
    (x, y) → (x - c/2m, y + 1/2m); ω → ω + P/2m, P being an even multiple of m.
    """
    strengths, (x, y) = forcing(kappa), points(x, y)
    spacing = count("spacing", spacing, 1, strengths.size)
    first = int(np.abs(strengths).argmax()) % spacing
    form = _alternated(strengths, spacing, first)
    if strengths.size % (2 * spacing) or (np.abs(form) != np.abs(strengths)).any():
        raise ValueError(
            f"kappa={kappa!r} does not kick every {spacing}th site alone, an even number of times "
            "in a period; e.g. repeat it twice"
        )
    return form, x - first / (2 * spacing), y + 1 / (2 * spacing)


def shift(kappa, x, y):
    """(κ_0, …, κ_{P-1}) → (κ_1, …, κ_{P-1}, κ_0) and z → S_κ0(z), Eq. (7); ω unchanged.

    For P = 2 this swaps κ1 and κ2: S_κ1 ∘ T_{κ1κ2} = T_{κ2κ1} ∘ S_κ1. (The paper's form with
    S_κ2⁻¹ is the same: S_κ1(z) = S_κ2⁻¹(T z), one step later. Its Eq. (28) has S_κ2 for S_κ2⁻¹.)
    """
    strengths = forcing(kappa)
    return np.roll(strengths, -1), *kick(strengths[0], *points(x, y))


def ray(angle):
    """(cos, sin) of an angle in degrees, shape (*angle.shape, 2): the profile of a ray.

    On the axes no strength is left over, and on the diagonals both are equal to the last bit.
    """
    angle = floats("angle", angle)
    radians = np.deg2rad(angle)
    profile = np.stack([np.cos(radians), np.sin(radians)], axis=-1)
    on_axis, on_diagonal = angle % 90 == 0, angle % 90 == 45
    profile[on_axis] = np.rint(profile[on_axis])
    profile[on_diagonal] = np.sign(profile[on_diagonal]) * np.sqrt(0.5)
    return profile


def relatives(vectors):
    """What alternation, reversal, negation and shifts make of the rows; each with its shift of ω.

    Those that leave ω alone come first.
    """
    period = vectors.shape[1]
    alternations = [(0, vectors)]
    if period % 2 == 0:
        alternations.append((period // 2, vectors * (-1.0) ** np.arange(period)))
    for (omega_shift, form), sign, order in product(alternations, (1, -1), (1, -1)):
        for places in range(period):
            yield omega_shift, sign * np.roll(form[:, ::order], places, axis=1)


def dominant_centre(kappa):
    """The centre (site, a) whose orbits are the minimax ones, R > 0, for all ω if there is such.

    The symmetry centre on a site with the largest |κ|, on x = 1/2 if κ > 0 there and on x = 0 if
    κ < 0. Without one, a centre between two sites, and the sign is that of the sum of all κ. For
    P ≥ 3 minimax orbits of other ω may have other centres. ValueError if the forcing has no centre.
    """
    strengths = forcing(kappa)
    # Strengths in descending order: with long forcings, only the first sites need to be tried.
    sites = np.argsort(-np.abs(strengths), kind="stable").tolist()
    for site in chain(sites, (site + 0.5 for site in sorted(sites))):
        mirror = int(2 * site) - np.arange(strengths.size)
        if np.array_equal(strengths, strengths[mirror % strengths.size]):
            sign = strengths.sum() if site % 1 else strengths[site]
            return site, 0.5 if sign > 0 else 0.0
    raise ValueError(
        f"kappa={kappa!r} has no symmetry centre; symmetric orbits need a forcing that reads the "
        "same forwards and backwards from some site, or from between two"
    )


def primitive(kappa):
    """One period of the forcing, the shortest."""
    strengths = forcing(kappa)
    sizes = _divisors(strengths.size)
    return next(strengths[:n] for n in sizes if (strengths[n:] == strengths[:-n]).all())


def symmetry_lines(kappa, y):
    """The lines on which orbits are their own mirror images, at the start of a period.

    kappa : sequence of P floats with a symmetry centre c, the forcing, first kick first.
    y : array; it runs along each line, whose image under y → y + 1 is a line too.

    Returns x, y : ndarrays of shape (4, *y.shape), on the lift: x_c = 0 and x_c = 1/2, followed
    back from site c to site 0, and so at the other centre, c + P/2.

    ValueError if the forcing has no centre.
    """
    strengths = primitive(kappa)
    site, _ = dominant_centre(strengths)
    y, lines = floats("y", y), []
    other = (site + strengths.size / 2) % strengths.size
    for centre, a in product((site, other), (0.0, 0.5)):
        point = a + y * (centre % 1), y  # between two sites x_c is their mean
        for strength in strengths[: int(np.ceil(centre))][::-1]:
            point = unkick(strength, *point)
        lines.append(np.broadcast_arrays(*point))
    return tuple(np.stack(lines, axis=1))


def shorten(forcings, omega):
    """The shortest forcings with the same orbits up to symmetry, and ω per their shorter period.

    On κ1 = κ2 one step is two of the standard map, at ω/2; on κ1 = -κ2 so it is up to `alternate`.

    forcings : sequence of forcings of one period P, which are shortened alike.
    omega : RotationNumber per P kicks, e.g. `numbers.parse("gamma")`.

    Returns forcings : list of arrays of shape (P',), P' a divisor of P. omega : RotationNumber, in
    [0, P'], to which y → y + 1 takes it.
    """
    kappas = np.array([forcing(kappa, "forcings") for kappa in forcings])
    length, spacing, short = _shortest(kappas)
    if spacing:
        omega = moebius(omega, 1, kappas.shape[1] // (2 * spacing))
    omega = moebius(omega, 1, 0, 0, kappas.shape[1] // length)
    whole, *rest = omega.prefix
    return list(short), RotationNumber((whole % length, *rest), omega.tail)


def halfway_nobles(kappa, value, width, n):
    """Rotation numbers near a float of which (ω + 1)/2 is noble, the simplest first; at most n.

    Where κ_{j+P/2} = -κ_j, or nearly, a period is two steps of half a period and x → x + 1/2, of
    that rotation number: under (1, 1, -1, -1) the circle of [0;(4)] = 2γ - 1 breaks last. Under
    other forcings none.

    kappa : ndarray (P,). value : float, ω per period. width : float > 0. n : int.
    """
    value, width, n = real("value", value), real("width", width), count("n", n, 0, 10**6)
    if not _distance_to_turned(forcing(kappa)) <= _NEARLY:
        return []
    return [moebius(rho, 2, -1) for rho in nobles_near((value + 1) / 2, width / 2, n)]


def lengthen(kappa, x, y):
    """(x, y) under the forcing that `shorten` makes of kappa → that orbit's (x, y) under kappa."""
    strengths, (x, y) = forcing(kappa), points(x, y)
    _, spacing, _ = _shortest(strengths[None])
    if not spacing:
        return x, y
    _, before, above = alternate(strengths, 0.0, 0.0, spacing)
    return x - before, y - above


def distances_to_shorter(kappa):
    """How far a forcing is from the forms that `shorten` shortens, one for each shorter period; and
    from kicks that turn after half a period, see `halfway_nobles`, if it is not one of these.

    ndarray: the largest change of a strength that it takes, in parts of the largest |κ|.
    """
    strengths = forcing(kappa)
    size = np.abs(strengths).max()
    found = [change / size if size > 0 else 0.0 for change, *_ in _shorter(strengths[None])]
    turned = _distance_to_turned(strengths)
    if _ROUNDED < turned < np.inf:
        found.append(turned)
    return np.array(found)


def _distance_to_turned(kappa):
    """How far it is from κ_{j+P/2} = -κ_j; inf for an odd P, and for κ = 0."""
    size = np.abs(kappa).max()
    if kappa.size % 2 or size == 0:
        return np.inf
    return np.abs(np.roll(kappa, kappa.size // 2) + kappa).max() / size


def _shortest(kappas):
    """The shortest period of forcings, rows of an array; the spacing m of the kicks whose signs
    must alternate for it, or 0; and the rows of that period."""
    exact = (found for change, *found in _shorter(kappas) if change == 0)
    return next(exact, (kappas.shape[1], 0, kappas))


def _shorter(kappas):
    """The change that gives forcings a shorter period, and what `_shortest` returns of each.

    The change makes |κ| that of a form, and the form periodic: the forcings themselves; and, for
    each spacing m, those sites m apart, with alternating signs, among which the largest |κ| is.
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


def _alternated(kappas, spacing, first):
    form = np.zeros_like(kappas)
    form[..., first :: 2 * spacing] = kappas[..., first :: 2 * spacing]
    form[..., first + spacing :: 2 * spacing] = -kappas[..., first + spacing :: 2 * spacing]
    return form


@lru_cache
def _divisors(n):
    return [divisor for divisor in range(1, n + 1) if n % divisor == 0]
