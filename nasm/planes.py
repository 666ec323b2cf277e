"""Planes of forcings, their rays and their symmetries.

    κ(a, b) = origin + a·first + b·second,     three vectors of length P

The (κ1, κ2) plane of the paper is origin (0, 0), first (1, 0), second (0, 1); that of a rotating
map, κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ), has first (1, …, 1) and second (cos 2π(φ0 + nΩ))_n
(arXiv:1606.04824, Eqs. (4) and (53)).

Forcings that are a shift, the reversal, the negative or the alternation of one another share their
circles up to symmetry (Sec. III and `nasm.symmetries`). Of the eight elements of the symmetry group
of the square, those that carry every forcing of a plane to such a relative of itself are found by
trying; these, and no others, `fold` its rays.
"""

import json
import re
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import product
from math import cos, pi, sin

import numpy as np

from nasm.checks import floats, fraction, real, sealed
from nasm.maps import MAX_PERIOD, MAX_STRENGTH, direction, forcing
from nasm.symmetries import ray, relatives
from nasm.texts import shown

__all__ = ["Plane", "from_json", "parse", "rotating", "three_kicks", "two_kicks"]

_AXIS = re.compile(r"kappa\w*(?<!_bounds)", re.ASCII)  # which no other name in a cube matches
_LONGEST_NAME = 60  # it stands in the names of files
_SAME = 1e-14  # of the largest strength: rounding of cosines

TWO_KICKS_AXES = {
    "kappa1": "strength of the first kick",
    "kappa2": "strength of the second kick",
}
ROTATING_AXES = {
    "kappa_mean": "mean strength κ̄",
    "kappa_amplitude": "amplitude Δκ of the strengths",
}


@dataclass(frozen=True)
class Plane:
    """A plane of forcings of one period.

    name : str.
    axes : {name: words}, what the coordinates a and b are; their names begin with "kappa".
    origin, first, second : P floats each, P from 2 to 64; first and second are independent.

    ValueError, which names the field, for anything else.
    """

    name: str
    axes: dict[str, str] = field(hash=False)
    origin: tuple[float, ...]
    first: tuple[float, ...]
    second: tuple[float, ...]

    def __post_init__(self):
        for name, check in ("origin", forcing), ("first", direction), ("second", direction):
            try:
                vector = check(getattr(self, name))
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None
            object.__setattr__(self, name, tuple(vector.tolist()))
        lengths = [len(vector) for vector in (self.origin, self.first, self.second)]
        if len(set(lengths)) > 1 or not 2 <= lengths[0] <= MAX_PERIOD:
            raise ValueError(
                f"origin, first and second have {lengths} strengths; they must have one length, "
                f"from 2 to {MAX_PERIOD}"
            )
        if np.linalg.matrix_rank([self.first, self.second]) < 2:
            raise ValueError(
                f"first={self.first} and second={self.second} are dependent; a plane needs two "
                "directions"
            )
        if not isinstance(self.name, str) or not 0 < len(self.name) <= _LONGEST_NAME:
            raise ValueError(
                f"name={shown(self.name)} must be a text of at most {_LONGEST_NAME} letters, like "
                "'two-kicks'"
            )
        axes = self.axes if isinstance(self.axes, dict) else {}
        named = [_AXIS.fullmatch(name) and isinstance(words, str) for name, words in axes.items()]
        if len(named) != 2 or not all(named):
            raise ValueError(
                f"axes={shown(self.axes)} must be two names that begin with kappa, and what they "
                f"are, like {TWO_KICKS_AXES}"
            )

    @property
    def record(self):
        """What results keep: `plane`, all fields as JSON text, and digits of its SHA-256."""
        fields = asdict(self)
        return {"plane": json.dumps(fields), "plane_hash": sealed(fields)["sha256"][:12]}

    def forcing(self, a, b):
        """κ(a, b), shape (*shape, P) for arrays a and b that broadcast to one shape."""
        return np.array(self.origin) + self._along(a, b)

    def ray(self, angle):
        """The ray κ = start + s·profile in a direction: start (P,), profile (*angle.shape, P).

        angle : array_like, degrees from the axis of a to that of b.
        """
        return np.array(self.origin), self._along(*np.moveaxis(ray(angle), -1, 0))

    def rays_start_at_zero(self, method):
        """Refuse a plane with an origin, from which the method cannot follow rays; ValueError."""
        if any(self.origin):
            raise ValueError(
                f"plane={self.name} has the origin {self.origin}; {method} needs rays from zero: "
                "take a plane whose origin is zero"
            )

    def _along(self, a, b):
        a, b = floats("a", a)[..., None], floats("b", b)[..., None]
        return a * np.array(self.first) + b * np.array(self.second)

    @cached_property
    def symmetries(self):
        """Those elements of the square's group that carry each forcing to a relative of itself.

        Tuple of (mirrored, turn, omega_shift): the ray at `angle` is as that at turn + angle
        degrees, turn - angle if mirrored, and its circle of ω as that of ω + omega_shift there, up
        to the sign of ω and to multiples of P.
        """
        here = np.array([self.origin, self.first, self.second])
        found = []
        for mirrored, quarters in product((False, True), range(4)):
            cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters]
            # a' = cos·a - sin·b, b' = sin·a + cos·b, with -b for b if mirrored.
            first, second = cos * here[1] + sin * here[2], cos * here[2] - sin * here[1]
            image = np.array([here[0], first, -second if mirrored else second])
            for omega_shift, relative in relatives(here):
                if np.abs(relative - image).max() <= _SAME * np.abs(here).max():
                    found.append((mirrored, 90 * quarters, omega_shift))
                    break
        return tuple(found)

    def unfold(self, angle):
        """The rays that share their last barrier with those at `angle`.

        angle : array_like, degrees. Returns degrees in [0, 360), shape (n, *angle.shape), one for
        each of the n `symmetries`, rounded to 10⁻⁹.
        """
        angle = floats("angle", angle)
        images = [turn - angle if mirror else turn + angle for mirror, turn, _ in self.symmetries]
        return np.round(images, 9) % 360

    def fold(self, angle):
        """The ray that stands for all that share their last barrier with the one at `angle`.

        angle : array_like, degrees.

        Returns folded : ndarray, the least angle of `unfold`; for two kicks in [0, 45].
        omega_shift : ndarray of int: the circle of ω on the ray at `angle` breaks at the same scale
            as that of ω + omega_shift on the folded ray. For two kicks the mirrors κ1 → -κ1 and
            κ2 → -κ2 add 1, Eqs. (24) to (28); the swap and -κ add nothing.
        """
        images = self.unfold(angle)
        shifts = np.array([shift for *_, shift in self.symmetries])
        folded = images.min(axis=0)
        is_least = images == folded
        shifts = np.where(is_least, shifts.reshape(-1, *[1] * folded.ndim), len(self.origin))
        return folded, shifts.min(axis=0)


def plane_of(record):
    """The plane of a `record`, or of anything that contains it, as the attributes of a cube."""
    return from_json(record["plane"])


def two_kicks():
    """The (κ1, κ2) plane of the paper's T_{κ1κ2}."""
    return Plane("two-kicks", TWO_KICKS_AXES, (0, 0), (1, 0), (0, 1))


def rotating(frequency, phase=0):
    """The (κ̄, Δκ) plane of κ_n = κ̄ + Δκ cos 2π(φ0 + nΩ), Eq. (53).

    frequency : Fraction or str, Ω = p/q with 2 ≤ q ≤ 64.
    phase : Fraction or str, φ0 in turns.

    Cosines that are equal, opposite, 0 or 1 are so to the last bit, so that a forcing that is
    symmetric, or of a shorter period, is seen to be so.
    """
    frequency, phase = fraction("frequency", frequency), fraction("phase", phase)
    if not 2 <= frequency.denominator <= MAX_PERIOD:
        raise ValueError(f"frequency={frequency} must have a denominator from 2 to {MAX_PERIOD}")
    turns = [(phase + frequency * n) % 1 for n in range(frequency.denominator)]
    second = [_cosine(min(turn, 1 - turn)) for turn in turns]
    name = f"rotating:{frequency}" + (f",{phase}" if phase else "")
    return Plane(name, ROTATING_AXES, [0] * len(turns), [1] * len(turns), second)


def _cosine(turn):
    """cos 2πt of a Fraction from 0 to 1/2, exactly opposite at 1/2 - t."""
    if turn > Fraction(1, 4):
        return -_cosine(Fraction(1, 2) - turn)
    rest = Fraction(1, 4) - turn
    return cos(2 * pi * turn) if turn < rest else sin(2 * pi * rest)


def three_kicks(third):
    """The plane of (κ1, κ2, third), three kicks of which the last one is fixed."""
    third = real("third", third, -MAX_STRENGTH, MAX_STRENGTH)
    return Plane(f"three-kicks:{third}", TWO_KICKS_AXES, (0, 0, third), (1, 0, 0), (0, 1, 0))


@lru_cache
def from_json(text):
    """The plane of a JSON object with the keys name, axes, origin, first and second; ValueError."""
    try:
        return Plane(**json.loads(text, parse_int=float))  # an int may have thousands of digits
    except (TypeError, RecursionError):
        words = "must be a JSON object with the keys name, axes, origin, first and second"
        raise ValueError(f"a plane {words}") from None


def parse(text):
    """The plane of a text: "two-kicks", "rotating:1/3", "rotating:1/3,1/48" or "three-kicks:0.2".

    ValueError for any other text.
    """
    name, _, numbers = text.partition(":")
    match name, *(numbers.split(",") if numbers else ()):
        case ["two-kicks"]:
            return two_kicks()
        case ["rotating", frequency, *phase] if len(phase) <= 1:
            return rotating(frequency, *phase)
        case ["three-kicks", third]:
            return three_kicks(float(fraction("third", third)))
    raise ValueError(
        f"{shown(text)} is not a plane; write two-kicks, rotating:FREQUENCY[,PHASE] like "
        "rotating:1/3,1/48, or three-kicks:THIRD like three-kicks:0.2"
    )
