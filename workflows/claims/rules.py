"""Claims, errata, and the rules that derive a verdict from a measured value.

claims.toml and errata.toml list the statements of the paper, in its order. A verdict is never
written by hand. Each rule returns the value, as text or numbers, and the Verdict:

    identity   the two sides of an equation differ by no more than rounding errors
    agrees     a value and a printed number differ by no more than the sum of their errors
    grade      the claim holds, or holds only in the weaker sense that its note states, or fails

`agrees` and `grade` are defined in `workflows.shared.judgement`. The verdict on NaN is UNDECIDED.
"""

import tomllib
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from workflows.shared.judgement import Verdict, grade


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, with our value and verdict."""

    place: str  # where the paper states it
    statement: str
    value: str  # our result, as text
    verdict: Verdict  # derived from the value by a rule
    command: str  # command that shows the value
    note: str = ""  # the sense in which the claim holds, or why it does not hold


@dataclass(frozen=True)
class Erratum:
    """An equation as printed and as it should read; `place` and `command` are as in a Claim."""

    place: str
    printed: str
    corrected: str
    printed_off: float  # error of the printed form
    corrected_off: float  # error of the corrected form
    bound: float  # bound on rounding errors
    measured: str  # description of the errors
    command: str

    @property
    def shown(self):
        """True if the numbers show that the printed form is wrong and the corrected one right."""
        return self.corrected_off <= self.bound < self.printed_off / 100


def printed_texts(kind):
    """Return {name: texts} of the "claims" or the "errata", in the paper's order."""
    return tomllib.loads(Path(__file__).with_name(f"{kind}.toml").read_text(encoding="utf-8"))


def as_texts(results):
    """Convert {name: (value, verdict)} to {name: (text of value, verdict)}, in the paper's order.

    A value is a text, or the numbers for the template in claims.toml.
    """
    written = {}
    for name, texts in printed_texts("claims").items():
        if name in results:
            value, verdict = results[name]
            value = value if isinstance(value, str) else texts["value"].format(**value)
            written[name] = value, verdict
    return written


def claims_of(results):
    """Convert {name: (text of value, verdict)}, the result of `as_texts`, to a list of Claims."""
    texts = printed_texts("claims")
    return [
        Claim(**texts[name] | {"value": value, "verdict": verdict})
        for name, (value, verdict) in results.items()
    ]


def rounding(kicks):
    """Bound the rounding error after several kicks with |κ| ≤ 2.

    Each kick adds 4·10⁻¹⁵, and multiplies earlier errors by at most 4, because ‖DS‖ ≤ 4.
    """
    return 4e-15 * 4.0**kicks


def identity(deviation, bound, label="largest deviation"):
    """Judge an equation by the deviation between its two sides."""
    text = f"{label} {deviation:.1e} (allowed: {bound:.1e})"
    return grade(text, deviation <= bound, known=isfinite(deviation))


def printed(text):
    """Return the value of a printed number, and half a unit in its last digit."""
    return float(text), 0.5 * 10.0 ** -len(text.partition(".")[2])
