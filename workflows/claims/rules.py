"""A claim, an erratum, and the rules by which a measured value becomes a verdict.

A verdict is never written by hand. Each rule returns the text of the value and the Verdict:

    identity    the two sides of an equation differ by no more than rounding explains
    agrees      a value and a number in print differ by no more than the errors of both
    graded      as it is written; or only in the weaker sense that the note states; or not at all

A value that is not a number decides nothing.
"""

from dataclasses import dataclass
from enum import Enum
from math import isfinite


class Verdict(Enum):
    HOLDS = "holds"
    CAVEAT = "holds with a caveat"
    FAILS = "does not hold"
    UNDECIDED = "not decided"


@dataclass(frozen=True)
class Claim:
    """place, statement: in the paper. value: ours. command: what shows it. note: why, if at all."""

    place: str
    statement: str
    value: str
    verdict: Verdict
    command: str
    note: str = ""


@dataclass(frozen=True)
class Erratum:
    """An equation as printed and as it should read, and by how much each of them fails."""

    place: str
    printed: str
    corrected: str
    printed_off: float
    corrected_off: float
    bound: float
    measured: str
    command: str

    @property
    def shown(self):
        """Whether the numbers show that the printed form is wrong and the other one right."""
        return self.corrected_off <= self.bound < self.printed_off / 100


CLAIMS = "python -m workflows.claims"


def rounding(kicks):
    """What rounding makes of so many kicks with |κ| ≤ 2: 4·10⁻¹⁵ each, and ‖DS‖ ≤ 4."""
    return 4e-15 * 4.0**kicks


def identity(deviation, bound, words="largest deviation"):
    verdict = Verdict.HOLDS if deviation <= bound else Verdict.FAILS
    return f"{words} {deviation:.1e}, of {bound:.1e} allowed", _known(verdict, deviation)


def printed(text):
    """A number as printed, and half a unit of its last digit."""
    return float(text), 0.5 * 10.0 ** -len(text.partition(".")[2])


def agrees(value, error, expected, uncertainty=0.0):
    """`expected` is a number in print or what theory makes of one, `uncertainty` its rounding."""
    near = abs(value - expected) <= error + uncertainty
    text = f"{value:.12g} ± {error:.1g}; to compare with {expected:.12g}"
    return text, _known(Verdict.HOLDS if near else Verdict.FAILS, value, error)


def graded(text, literal, weaker=False, known=True):
    """literal, weaker : whether it holds so. known : whether there was an answer to judge by."""
    if not known:
        return text, Verdict.UNDECIDED
    if literal:
        return text, Verdict.HOLDS
    return text, Verdict.CAVEAT if weaker else Verdict.FAILS


def _known(verdict, *values):
    return verdict if all(isfinite(value) for value in values) else Verdict.UNDECIDED
