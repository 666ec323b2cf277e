"""The common answer of every method: at which scale does a circle, or the last one, break?

On the ray κ = s·profile, s ≥ 0, the circle of rotation number ω exists for small s and breaks at
the critical scale. The set of all critical points is the boundary CB_ω, that of the last circle
CB_gt (arXiv:1606.04824, Sec. V).
"""

import math
from dataclasses import dataclass, fields
from enum import Enum

import numpy as np

from nasm.numbers import RotationNumber

__all__ = ["CriticalScale", "Result", "Status", "no_answer"]


class Status(Enum):
    """Why a CriticalScale has the value it has; anything but OK and WIDE comes with value NaN.

    Cubes store a member by its place, so a new one comes last.
    """

    OK = "ok"
    RATIONAL = "omega is rational: no circle, its convergents end"
    OUTSIDE = "the circle is broken, or its orbits cannot be followed, at the segment's very start"
    NO_BREAKUP = "no breakup found up to the largest scale searched"
    NEAR_CUSP = "longest orbits do not yet tell the forcing from a shorter one, as on |κ1| = |κ2|"
    DISORDERED = "Newton found an orbit of another kind: not ordered, or with the other sign of R"
    NO_CIRCLE = "Newton's method finds no circle"
    TOO_FEW_MODES = "the circle, if any, needs more modes than allowed; see barriers.last_circle"
    NOT_CERTIFIED = "Newton's method converged on one grid but not on a finer one: not a circle"
    NEARLY_RATIONAL = "omega is so near a fraction that rounding hides the difference"
    UNDECIDED = "the methods contradict each other"
    NOT_CONVERGED = "the estimates did not settle within the effort allowed; allow more of it"
    WIDE = "value and error stand, but the bracket is more than twice as wide as asked for"
    ANOMALOUS = "squares of displacements do not grow like n: accelerator modes; no diffusion"

    __repr__ = Enum.__str__  # short


class Result:
    """A dataclass of what a method found, which may hold arrays and NaN: two are equal if all that
    they hold is, entry by entry, NaN to NaN too."""

    def __eq__(self, other):
        if type(other) is not type(self):
            return NotImplemented
        return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))


def _same(a, b):
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    numeric = [isinstance(value, np.ndarray | int | float) for value in (a, b)]
    return np.array_equal(a, b, equal_nan=True) if all(numeric) else not any(numeric) and a == b


@dataclass(frozen=True, eq=False)
class CriticalScale(Result):
    """What a method found out about a breakup on the ray κ = s·profile.

    value : best estimate of the critical s.
    error : estimated absolute error of it.
    lower, upper : what the method *shows*: a circle exists at lower and does not at upper; NaN
        where it shows nothing.
    omega : the circle's rotation number, None if the method does not name one.
    status : OK, or why not.
    method : what the value rests on, in words, like "Greene's residue"; without a value, what the
        status or the bounds rest on.
    """

    value: float
    error: float
    lower: float
    upper: float
    omega: RotationNumber | None
    status: Status
    method: str = ""

    def __post_init__(self):
        for name in ("value", "error", "lower", "upper"):  # NumPy's scalars print as np.float64(…)
            object.__setattr__(self, name, float(getattr(self, name)))

    def __hash__(self):
        return hash((self.omega, self.status, self.method))


def no_answer(omega, status, method=""):
    """The CriticalScale of a method that failed, and why."""
    return CriticalScale(math.nan, math.nan, math.nan, math.nan, omega, status, method)
