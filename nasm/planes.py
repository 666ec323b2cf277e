"""Planes of forcings, their rays and their symmetries.

    κ(a, b) = origin + a·first + b·second,     three vectors of length P

The (κ1, κ2) plane of the paper has origin (0, 0), first (1, 0) and second (0, 1); the plane of a
rotating map, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ), has first (1, …, 1) and second (cos 2π(φ0 + nΩ))_n
(arXiv:1606.04824, Eqs. (4) and (53)).

Two forcings are equivalent if one is a shift, the reversal, the negative or the alternation of the
other; the alternation (P even) changes the sign of every second kick. Circles under equivalent
forcings are images of each other under symmetries of the map (Sec. III and `nasm.symmetries`). Each
of the eight elements of the symmetry group of the square is tested; those that map every forcing of
the plane to an equivalent one are used to `fold` its rays.
"""

import json
import re
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import product
from math import cos, pi, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from nasm.checks import floats, fraction, real, with_sha256
from nasm.maps import MAX_PERIOD, MAX_STRENGTH, direction, forcing
from nasm.symmetries import equivalent_forcings, ray
from nasm.texts import short_repr
from nasm.types import FloatArray, IntArray

__all__ = ["Plane", "from_json", "pairs", "parse", "rotating", "three_kicks", "two_kicks"]

_AXIS = re.compile(r"kappa\w*(?<!_bounds)", re.ASCII)  # no other name in a cube matches it
_MAX_NAME_LENGTH = 60  # the name is part of file names
_ROUNDING = 1e-14  # error of the cosines, relative to the largest strength

TWO_KICKS_AXES = {
    "kappa1": "strength of the first kick",
    "kappa2": "strength of the second kick",
}
ROTATING_AXES = {
    "kappa_mean": "mean strength κ̄",
    "kappa_amplitude": "amplitude Δκ of the strengths",
}
PAIRS_AXES = {
    "kappa_whole": "strength K of the kicks at integer times",
    "kappa_delayed": "strength Kα of the kicks delayed by τ",
}


@dataclass(frozen=True)
class Plane:
    """A plane of forcings with the same period, κ(a, b) = origin + a·first + b·second.

    Planes with equal fields are equal. Planes are hashable, so they can be members of sets.

    Parameters
    ----------
    name : str
        At most 60 characters.
    axes : dict of str to str
        Names and descriptions of the coordinates a and b; the names begin with "kappa".
    origin, first, second : sequence of float, shape (P,)
        2 ≤ P ≤ 64; first and second are linearly independent.

    Raises
    ------
    ValueError
        If a field is invalid; the message names it.

    Examples
    --------
    >>> from nasm.planes import Plane
    >>> axes = {"kappa1": "kick on even sites", "kappa2": "kick on odd sites"}
    >>> plane = Plane("four-kicks", axes, (0, 0, 0, 0), (1, 0, 1, 0), (0, 1, 0, 1))
    >>> plane.forcing(0.3, 0.5)
    array([0.3, 0.5, 0.3, 0.5])
    """

    name: str
    axes: dict[str, str] = field(hash=False)
    origin: tuple[float, ...]
    first: tuple[float, ...]
    second: tuple[float, ...]

    def __post_init__(self) -> None:
        for name, check in ("origin", forcing), ("first", direction), ("second", direction):
            try:
                vector = check(getattr(self, name))
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None
            object.__setattr__(self, name, tuple(vector.tolist()))
        lengths = [len(vector) for vector in (self.origin, self.first, self.second)]
        if len(set(lengths)) > 1 or not 2 <= lengths[0] <= MAX_PERIOD:
            raise ValueError(
                f"origin, first and second have {lengths} strengths; they must have the same "
                f"number, from 2 to {MAX_PERIOD}"
            )
        if np.linalg.matrix_rank([self.first, self.second]) < 2:
            raise ValueError(
                f"first={self.first} and second={self.second} are dependent; a plane needs two "
                "directions"
            )
        if not isinstance(self.name, str) or not 0 < len(self.name) <= _MAX_NAME_LENGTH:
            raise ValueError(
                f"name={short_repr(self.name)} must be a string of at most {_MAX_NAME_LENGTH} "
                "characters, like 'two-kicks'"
            )
        axes = self.axes if isinstance(self.axes, dict) else {}
        valid = [_AXIS.fullmatch(name) and isinstance(text, str) for name, text in axes.items()]
        if len(valid) != 2 or not all(valid):
            raise ValueError(
                f"axes={short_repr(self.axes)} must be two names that begin with kappa, and their "
                f"descriptions, like {TWO_KICKS_AXES}"
            )

    @property
    def record(self) -> dict[str, str]:
        """Attributes that describe the plane in results.

        `plane` contains the fields as JSON; `plane_hash` is derived from their SHA-256.
        """
        fields = asdict(self)
        return {"plane": json.dumps(fields), "plane_hash": with_sha256(fields)["sha256"][:12]}

    def forcing(self, a: ArrayLike, b: ArrayLike) -> FloatArray:
        """Compute κ(a, b), of shape (*shape, P) if a and b broadcast to `shape`.

        Examples
        --------
        >>> from nasm.planes import two_kicks
        >>> two_kicks().forcing([0.1, 0.2], 0.5)
        array([[0.1, 0.5],
               [0.2, 0.5]])
        """
        return np.array(self.origin) + self._along(a, b)

    def ray(self, angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Compute the ray κ = start + s·profile in a direction.

        Parameters
        ----------
        angle : array_like
            Degrees, measured from the axis of a towards the axis of b.

        Returns
        -------
        start : ndarray, shape (P,)
        profile : ndarray, shape (*angle.shape, P)

        Examples
        --------
        >>> from nasm.planes import three_kicks
        >>> start, profile = three_kicks(0.2).ray(90)
        >>> print(start, profile)
        [0.  0.  0.2] [0. 1. 0.]
        """
        return np.array(self.origin), self._along(*np.moveaxis(ray(angle), -1, 0))

    def rays_start_at_zero(self, method: str) -> None:
        """Raise a ValueError if the origin is not zero: `method` needs rays from zero."""
        if any(self.origin):
            raise ValueError(
                f"plane={self.name} has the origin {self.origin}; {method} needs rays from zero: "
                "use a plane whose origin is zero"
            )

    def _along(self, a: ArrayLike, b: ArrayLike) -> FloatArray:
        a, b = floats("a", a)[..., None], floats("b", b)[..., None]
        return a * np.array(self.first) + b * np.array(self.second)

    @cached_property
    def symmetries(self) -> tuple[tuple[bool, int, int], ...]:
        """Symmetries of the square that map each forcing of the plane to an equivalent one.

        Each is a tuple (mirrored, turn, omega_shift). The ray at `angle` is equivalent to the ray
        at turn + angle degrees, or at turn - angle if mirrored. The circle with rotation number
        ω on the first ray corresponds to the one with ω + omega_shift on the second, up to the
        sign of ω and multiples of P.
        """
        return self._symmetries(_ROUNDING)

    @cached_property
    def exact_symmetries(self) -> tuple[tuple[bool, int, int], ...]:
        """The `symmetries` for which the equivalence is exact, down to the last bit.

        For the planes in this module, all of them are exact.

        Examples
        --------
        >>> from nasm.planes import rotating
        >>> rotating("1/3").exact_symmetries == rotating("1/3").symmetries
        True
        """
        return self._symmetries(0.0)

    def _symmetries(self, rounding: float) -> tuple[tuple[bool, int, int], ...]:
        vectors = np.array([self.origin, self.first, self.second])
        elements = []
        for mirrored, quarters in product((False, True), range(4)):
            cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters]
            # a' = cos·a - sin·b, b' = sin·a + cos·b, with -b for b if mirrored.
            origin, a, b = vectors
            first, second = cos * a + sin * b, cos * b - sin * a
            image = np.array([origin, first, -second if mirrored else second])
            for omega_shift, equivalent in equivalent_forcings(vectors):
                if np.abs(equivalent - image).max() <= rounding * np.abs(vectors).max():
                    elements.append((mirrored, 90 * quarters, omega_shift))
                    break
        return tuple(elements)

    @cached_property
    def wedge(self) -> tuple[float, float]:
        """Smallest range of angles (degrees) whose images under `exact_symmetries` cover all rays.

        If they include reflections, the range extends from one mirror axis to the next.

        Examples
        --------
        >>> from nasm.planes import pairs, two_kicks
        >>> two_kicks().wedge, pairs("1/3").wedge
        ((0.0, 45.0), (45.0, 135.0))
        """
        elements = self.exact_symmetries
        begin = min((turn / 2 for mirrored, turn, _ in elements if mirrored), default=0.0)
        return begin, begin + 360 / len(elements)

    def unfold(self, angle: ArrayLike) -> FloatArray:
        """List the rays that are equivalent to the ray at `angle`.

        Parameters
        ----------
        angle : array_like
            Degrees.

        Returns
        -------
        ndarray, shape (n, *angle.shape)
            Degrees in [0, 360), one for each of the n `symmetries`, rounded to 10⁻⁹.

        Examples
        --------
        >>> from nasm.planes import two_kicks
        >>> sorted(two_kicks().unfold(30).tolist())
        [30.0, 60.0, 120.0, 150.0, 210.0, 240.0, 300.0, 330.0]
        """
        angle = floats("angle", angle)
        images = [turn - angle if mirror else turn + angle for mirror, turn, _ in self.symmetries]
        return np.round(images, 9) % 360

    def fold_keeping_circles(self, angle: ArrayLike) -> FloatArray:
        """Choose one representative of the rays on which each circle breaks at the same scale.

        These are fewer rays than those of `fold`, whose symmetries may also change rotation
        numbers.

        Parameters
        ----------
        angle : array_like
            Degrees.

        Returns
        -------
        ndarray, shape of angle
            The smallest angle of `unfold` whose symmetry preserves every ω, in degrees.

        Examples
        --------
        >>> from nasm.planes import two_kicks
        >>> two_kicks().fold_keeping_circles([60, 120, 150])
        array([ 30., 120., 120.])
        """
        preserves_omega = [shift == 0 for *_, shift in self.symmetries]
        return self.unfold(angle)[preserves_omega].min(axis=0)

    def fold(self, angle: ArrayLike) -> tuple[FloatArray, IntArray]:
        """Choose one representative of the rays that are equivalent to the ray at `angle`.

        Parameters
        ----------
        angle : array_like
            Degrees.

        Returns
        -------
        folded : ndarray, shape of angle
            The smallest angle of `unfold`, in degrees; it is in [0, 45] for two kicks.
        omega_shift : ndarray of int, shape of angle
            The circle with rotation number ω on the ray at `angle` breaks at the same scale as the
            one with ω + omega_shift on the folded ray. For two kicks the reflections κ1 → -κ1 and
            κ2 → -κ2 add 1, Eqs. (24) to (28); swapping the kicks, or κ → -κ, adds 0.

        Examples
        --------
        >>> from nasm.planes import two_kicks
        >>> two_kicks().fold([60, 120])
        (array([30., 30.]), array([0, 1]))
        """
        images = self.unfold(angle)
        shifts = np.array([shift for *_, shift in self.symmetries])
        folded = images.min(axis=0)
        is_least = images == folded
        shifts = np.where(is_least, shifts.reshape(-1, *[1] * folded.ndim), len(self.origin))
        return folded, shifts.min(axis=0)


def plane_of(record: dict[Any, Any]) -> Plane:
    """Return the plane from a `record`, or from a dict that contains one, like a cube's attributes.

    Examples
    --------
    >>> from nasm.planes import plane_of, two_kicks
    >>> plane_of(two_kicks().record) == two_kicks()
    True
    """
    return from_json(record["plane"])


def two_kicks() -> Plane:
    """Return the (κ1, κ2) plane of the paper's T_{κ1κ2}.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> two_kicks().first, two_kicks().second
    ((1.0, 0.0), (0.0, 1.0))
    """
    return Plane("two-kicks", TWO_KICKS_AXES, (0, 0), (1, 0), (0, 1))


def rotating(frequency: Fraction | str, phase: Fraction | str | int = 0) -> Plane:
    """Return the (κ̄, Δκ) plane of κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ), Eq. (53).

    Parameters
    ----------
    frequency : Fraction or str
        Ω = p/q with 2 ≤ q ≤ 64.
    phase : Fraction or str
        φ0, in turns.

    Notes
    -----
    Cosines that are mathematically 0, 1 or equal up to sign are exactly so in floating point.
    Forcings that are symmetric or have a shorter period are therefore recognized as such.

    Examples
    --------
    >>> from nasm.planes import rotating
    >>> rotating("1/4").second
    (1.0, 0.0, -1.0, 0.0)
    """
    frequency, phase = fraction("frequency", frequency), fraction("phase", phase)
    if not 2 <= frequency.denominator <= MAX_PERIOD:
        raise ValueError(f"frequency={frequency} must have a denominator from 2 to {MAX_PERIOD}")
    turns = [(phase + frequency * n) % 1 for n in range(frequency.denominator)]
    second = [_cosine(min(turn, 1 - turn)) for turn in turns]
    name = f"rotating:{frequency}" + (f",{phase}" if phase else "")
    zero, one = (0.0,) * len(turns), (1.0,) * len(turns)
    return Plane(name, ROTATING_AXES, zero, one, tuple(second))


def _cosine(turn: Fraction) -> float:
    """Compute cos 2πt for a Fraction t from 0 to 1/2; 1/2 - t gives exactly the negative."""
    if turn > Fraction(1, 4):
        return -_cosine(Fraction(1, 2) - turn)
    rest = Fraction(1, 4) - turn
    return cos(2 * pi * turn) if turn < rest else sin(2 * pi * rest)


def three_kicks(third: float) -> Plane:
    """Return the plane of the forcings (κ1, κ2, third), whose third kick is fixed.

    Examples
    --------
    >>> from nasm.planes import three_kicks
    >>> three_kicks(0.2).forcing(0.3, 0.5)
    array([0.3, 0.5, 0.2])
    """
    third = real("third", third, -MAX_STRENGTH, MAX_STRENGTH)
    return Plane(f"three-kicks:{third}", TWO_KICKS_AXES, (0, 0, third), (1, 0, 0), (0, 1, 0))


def pairs(delay: Fraction | str) -> Plane:
    """Return the (K, K_α) plane of two series of kicks: K at integer times, K_α a time τ later.

    Parameters
    ----------
    delay : Fraction or str
        τ = a/q in lowest terms, 0 < τ < 1 and q ≤ 64.

    Notes
    -----
    The unit of time is the period, as in the physics literature: a kick changes the momentum p by
    (K/2π) sin 2πx, and x changes by p in unit time. In a time 1/q, x changes by y = p/q. The
    forcing therefore has q kicks: the first is K/q, the a-th after it is K_α/q, and the others
    are 0.

    References
    ----------
    Chernyshov, Satanin & Shchur, arXiv:2509.11593; for K_α = -K, Jones et al., physics/0408088.

    Examples
    --------
    >>> from nasm.planes import pairs
    >>> pairs("1/4").forcing(0.8, -0.4)
    array([ 0.2, -0.1,  0. ,  0. ])
    """
    delay = fraction("delay", delay)
    if not 0 < delay < 1 or delay.denominator > MAX_PERIOD:
        raise ValueError(
            f"delay={delay} must be between 0 and 1, with a denominator of at most {MAX_PERIOD}"
        )
    a, q = delay.as_integer_ratio()
    first, second = (tuple((np.arange(q) == site) / q) for site in (0, a))
    return Plane(f"pairs:{delay}", PAIRS_AXES, (0.0,) * q, first, second)


@lru_cache
def from_json(text: str) -> Plane:
    """Parse a plane from a JSON object with the keys name, axes, origin, first and second.

    Raises
    ------
    ValueError
        If the text is anything else.

    Examples
    --------
    >>> from nasm.planes import from_json, two_kicks
    >>> from_json(two_kicks().record["plane"]) == two_kicks()
    True
    """
    try:
        return Plane(**json.loads(text, parse_int=float))  # an int may have thousands of digits
    except (TypeError, RecursionError):
        raise ValueError(
            "a plane must be a JSON object with the keys name, axes, origin, first and second"
        ) from None


def parse(text: str) -> Plane:
    """Return the plane with the given name.

    The name is "two-kicks", "rotating:1/3,1/48" (a frequency, and a phase if it is not 0),
    "three-kicks:0.2" or "pairs:1/3".

    Raises
    ------
    ValueError
        If `text` is anything else.

    Examples
    --------
    >>> from nasm.planes import parse
    >>> parse("three-kicks:0.2").origin
    (0.0, 0.0, 0.2)
    """
    name, _, numbers = text.partition(":")
    match name, *(numbers.split(",") if numbers else ()):
        case ["two-kicks"]:
            return two_kicks()
        case ["rotating", frequency, *phase] if len(phase) <= 1:
            return rotating(frequency, *phase)
        case ["three-kicks", third]:
            return three_kicks(float(fraction("third", third)))
        case ["pairs", delay]:
            return pairs(delay)
    raise ValueError(
        f"{short_repr(text)} is not a plane; write two-kicks, rotating:FREQUENCY[,PHASE] like "
        "rotating:1/3,1/48, three-kicks:THIRD like three-kicks:0.2, or pairs:DELAY like pairs:1/3"
    )
