"""Results of the methods that compute the scale at which a circle breaks.

On the ray κ = s·profile, s ≥ 0, the circle of rotation number ω exists for small s and breaks at
the critical scale. The points where the circle of ω breaks form the boundary CB_ω, and those where
the last circle breaks form CB_gt (arXiv:1606.04824, Sec. V).
"""

import math
from dataclasses import dataclass, fields
from enum import Enum

import numpy as np

from nasm.numbers import RotationNumber
from nasm.tables import html_table
from nasm.texts import rounded_bracket, rounded_value

__all__ = ["CriticalScale", "Result", "Status", "no_answer"]


class Status(Enum):
    """Outcome of a method; unless it is OK, the text states the reason and a remedy.

    A result's value is NaN unless its status is OK or WIDE.

    Examples
    --------
    >>> from nasm.results import Status
    >>> print(Status.RATIONAL.value)
    omega is rational, so no circle has it; use an irrational number, like gamma
    """

    # Cubes store the index of a member: add new members at the end.
    OK = "ok"
    RATIONAL = "omega is rational, so no circle has it; use an irrational number, like gamma"
    OUTSIDE = (
        "the circle is broken at the start of the segment, or its orbits cannot be followed from "
        "there; start closer to zero"
    )
    NO_BREAKUP = (
        "no breakup found up to the largest scale searched; try another ray or rotation number"
    )
    NEAR_CUSP = (
        "even the longest orbits do not distinguish the forcing from one of shorter period, e.g. "
        "close to |κ1| = |κ2|; allow longer orbits, or take the forcing of shorter period"
    )
    DISORDERED = (
        "Newton's method found an orbit of another kind: not ordered, or with the wrong sign of R; "
        "use shorter orbits, or a method without orbits (circles.continuation, converse_kam)"
    )
    NO_CIRCLE = (
        "Newton's method finds no circle; reduce the forcing, or approach it by continuation"
    )
    TOO_FEW_MODES = (
        "the circle, if any, needs more modes than allowed; allow more, or use barriers.last_circle"
    )
    NOT_CERTIFIED = (
        "Newton's method converged on one grid but not on a finer one, so no circle is certified; "
        "reduce the forcing, or allow more modes"
    )
    NEARLY_RATIONAL = (
        "omega is so close to a fraction that rounding hides the difference; use a number with "
        "smaller partial quotients"
    )
    UNDECIDED = (
        "the methods contradict each other; change the tolerance, or compare the methods one by one"
    )
    NOT_CONVERGED = (
        "the estimates did not converge within the effort allowed; allow longer orbits, more steps "
        "or more modes"
    )
    WIDE = (
        "value and error are valid, but the bracket is more than twice as wide as requested; rely "
        "on value and error, or accept the wider bracket"
    )
    ANOMALOUS = (
        "squared displacements do not grow like n because of accelerator modes, so there is no "
        "diffusion constant; change the forcing"
    )
    TOO_LONG = (
        "the period has more than 64 kicks, so no circle was sought, and only upper is known, "
        "which is a few per cent too large; take a shorter period"
    )

    __repr__ = Enum.__str__  # Status.OK, not <Status.OK: 'ok'>


@dataclass(frozen=True, eq=False)
class Result:
    """Base class of results: dataclasses whose fields may contain arrays and NaN.

    Two results are equal if they are of the same class and all their fields are equal; arrays are
    compared entry by entry, and NaN equals NaN. A result is hashable only if its class defines a
    hash, as `CriticalScale` does.

    Examples
    --------
    >>> from nasm.results import Status, no_answer
    >>> no_answer(None, Status.RATIONAL) == no_answer(None, Status.RATIONAL)
    True
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(_same(getattr(self, f.name), getattr(other, f.name)) for f in fields(self))


def _same(a: object, b: object) -> bool:
    """Return True if two fields are equal; NaN equals NaN."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, np.ndarray | int | float) and isinstance(b, np.ndarray | int | float):
        return np.array_equal(a, b, equal_nan=True)
    numeric = isinstance(a, np.ndarray | int | float) or isinstance(b, np.ndarray | int | float)
    return not numeric and a == b


@dataclass(frozen=True, eq=False, repr=False)
class CriticalScale(Result):
    """Scale s at which a circle breaks on the ray κ = s·profile.

    It prints on one line, with the digits that the error justifies; notebooks show it as a table.
    Critical scales are compared field by field, and NaN equals NaN. They are hashable, so they can
    be members of sets and keys of dictionaries.

    Attributes
    ----------
    value : float
        Best estimate of the critical scale; NaN if status is neither OK nor WIDE.
    error : float
        Estimated absolute error of the value.
    lower, upper : float
        Bracket that the method *shows* to hold: the method finds a circle at lower, and excludes
        all circles at upper. Both rest on floating-point arithmetic, except in the methods of
        `nasm.proofs`. A bound that is not shown to hold is NaN.
    omega : RotationNumber or None
        Rotation number of the circle per period; None if the method does not identify the circle.
    status : Status
        OK, or a member whose text states the reason and a remedy.
    method : str
        Method on which the value is based, like "Greene's residue"; if there is no value, the
        method on which the status or the bracket is based.

    Examples
    --------
    >>> from nasm.results import CriticalScale, Status
    >>> from nasm.numbers import parse
    >>> CriticalScale(0.9716354, 2.1e-7, 0.971543, 0.971717, parse("gamma"), Status.OK, "residues")
    CriticalScale(0.97163540 ± 2.1e-07, bracket [0.97154, 0.97172], circle [0;(1)] = 0.618034 per
    period, method: residues, OK)
    """

    value: float
    error: float
    lower: float
    upper: float
    omega: RotationNumber | None
    status: Status
    method: str = ""

    def __post_init__(self) -> None:
        for name in ("value", "error", "lower", "upper"):  # NumPy scalars print as np.float64(…)
            object.__setattr__(self, name, float(getattr(self, name)))

    def __hash__(self) -> int:
        return hash((self.omega, self.status, self.method))

    def __repr__(self) -> str:
        lower, upper = rounded_bracket(self.lower, self.upper)
        bracket = f"bracket [{lower}, {upper}]" if lower and upper else ""
        parts = (
            self._value(),
            bracket or (f"lower {lower}" if lower else "") or (f"upper {upper}" if upper else ""),
            "" if self.omega is None else f"circle {_spell(self.omega, 6)}",
            self.method and f"method: {self.method}",
            self._outcome(),
        )
        return f"CriticalScale({', '.join(filter(None, parts))})"

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        lower, upper = rounded_bracket(self.lower, self.upper)
        shows = (
            f"a circle is found at {lower}" * bool(lower),
            f"none is found at {upper}" * bool(upper),
        )
        rows = {
            "critical scale": self._value(),
            "bracket": "; ".join(filter(None, shows)),
            "rotation number": "" if self.omega is None else _spell(self.omega, 12),
            "method": self.method,
            "status": self._outcome(),
        }
        return html_table(rows)

    def _value(self) -> str:
        return "no value" if math.isnan(self.value) else rounded_value(self.value, self.error)

    def _outcome(self) -> str:
        is_ok = self.status is Status.OK
        return self.status.name if is_ok else f"{self.status.name}: {self.status.value}"


def _spell(omega: RotationNumber, digits: int) -> str:
    return f"{omega} = {float(omega):.{digits}g} per period"


def no_answer(omega: RotationNumber | None, status: Status, method: str = "") -> CriticalScale:
    """Return the CriticalScale of a method that failed: all its numbers are NaN.

    Examples
    --------
    >>> import math
    >>> from nasm.results import Status, no_answer
    >>> math.isnan(no_answer(None, Status.NO_CIRCLE).value)
    True
    """
    return CriticalScale(math.nan, math.nan, math.nan, math.nan, omega, status, method)
