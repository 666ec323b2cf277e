"""A claim, an erratum, and the rules by which a measured value becomes a verdict.

What the paper says is in claims.toml and errata.toml, in its order. A verdict is never written by
hand. Each rule returns the value, in words or numbers, and the Verdict:

    identity    the two sides of an equation differ by no more than rounding explains
    agrees      a value and a number in print differ by no more than the errors of both
    grade      as it is written; or only in the weaker sense that the note states; or not at all;
                this one is in `workflows.shared.judgement`

NaN is UNDECIDED.
"""

import tomllib
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from workflows.shared.judgement import Verdict, grade


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, judged."""

    place: str  # where the paper makes it
    statement: str  # what it says
    value: str  # what we find, in words
    verdict: Verdict  # what a rule makes of the value
    command: str  # what shows it
    note: str = ""  # in which sense it holds, or why not


@dataclass(frozen=True)
class Erratum:
    """An equation as printed and as it should read; place and command as of a Claim."""

    place: str
    printed: str
    corrected: str
    printed_off: float  # by how much the printed form fails
    corrected_off: float  # the same of the corrected form
    bound: float  # what rounding explains
    measured: str  # what was measured, in words
    command: str

    @property
    def shown(self):
        """Tell whether the numbers show that the printed form is wrong, the corrected one right."""
        return self.corrected_off <= self.bound < self.printed_off / 100


def printed_texts(kind):
    """Return {name: texts} of the "claims" or the "errata", in the paper's order."""
    return tomllib.loads(Path(__file__).with_name(f"{kind}.toml").read_text(encoding="utf-8"))


def in_words(found):
    """Return {name: (value in words, verdict)} of {name: (value, verdict)}, in the paper's order.

    A value is a text, or the numbers that the text in claims.toml is made of.
    """
    words = {}
    for name, texts in printed_texts("claims").items():
        if name in found:
            value, verdict = found[name]
            value = value if isinstance(value, str) else texts["value"].format(**value)
            words[name] = value, verdict
    return words


def judged(words):
    """Return the Claims of {name: (value in words, verdict)}, of `in_words`."""
    texts = printed_texts("claims")
    return [
        Claim(**texts[name] | {"value": value, "verdict": verdict})
        for name, (value, verdict) in words.items()
    ]


def rounding(kicks):
    """Bound the rounding error of some kicks with |κ| ≤ 2: 4·10⁻¹⁵ each, and ‖DS‖ ≤ 4."""
    return 4e-15 * 4.0**kicks


def identity(deviation, bound, words="largest deviation"):
    text = f"{words} {deviation:.1e}, of {bound:.1e} allowed"
    return grade(text, deviation <= bound, known=isfinite(deviation))


def printed(text):
    """Return a number as printed, and half a unit of its last digit."""
    return float(text), 0.5 * 10.0 ** -len(text.partition(".")[2])


def agrees(value, error, expected, uncertainty=0.0):
    """Compare with a number in print, or what theory makes of one, with its rounding."""
    near, known = abs(value - expected) <= error + uncertainty, isfinite(value + error)
    return grade(f"{value:.12g} ± {error:.1g}; to compare with {expected:.12g}", near, known=known)
