"""Verdicts on the claims of a command, derived from measured values by a rule, never by hand."""

from enum import Enum
from math import isfinite
from typing import Any

import numpy as np

from nasm.types import FloatArray


class Verdict(Enum):
    HOLDS = "holds"
    CAVEAT = "holds with a caveat"
    FAILS = "does not hold"
    UNDECIDED = "not decided"


WORST_FIRST = [Verdict.FAILS, Verdict.CAVEAT, Verdict.UNDECIDED, Verdict.HOLDS]
"""The order in which a page lists verdicts."""


def grade(
    measured: Any, literal: bool, weaker: bool = False, known: bool = True
) -> tuple[Any, Verdict]:
    """Judge a claim by whether it holds literally, or in a weaker sense.

    Parameters
    ----------
    measured : str or dict
        What was measured; returned unchanged.
    literal, weaker : bool
        Whether the claim holds as written, and whether it holds in a weaker sense.
    known : bool
        Whether the measurement is sufficient to decide the claim.

    Returns
    -------
    measured : str or dict
    verdict : Verdict
    """
    if not known:
        return measured, Verdict.UNDECIDED
    if literal:
        return measured, Verdict.HOLDS
    return measured, Verdict.CAVEAT if weaker else Verdict.FAILS


def agrees(
    value: float, error: float, expected: float, uncertainty: float = 0.0
) -> tuple[str, Verdict]:
    """Compare a value with `expected`; they agree if they differ by at most the sum of the errors.

    The verdict for NaN is UNDECIDED.
    """
    holds, known = abs(value - expected) <= error + uncertainty, isfinite(value + error)
    text = f"{value:.12g} ± {error:.1g}, compared with {expected:.12g}"
    return grade(text, holds, known=known and isfinite(expected + uncertainty))


def finding(
    claim: str, measured: str, literal: bool, weaker: bool = False, known: bool = True
) -> str:
    """Return a claim, its verdict (see `grade`) and what was measured, as sentences."""
    _, verdict = grade(measured, literal, weaker, known)
    if not known:
        return f"Claim: {claim}. Not decided: the run has too few values."
    return f"Claim: {claim}. {_SUPPORT[verdict]}: {measured}."


_SUPPORT = {
    Verdict.HOLDS: "Supported",
    Verdict.CAVEAT: "Supported with a caveat",
    Verdict.FAILS: "Not supported",
}


def span(values: FloatArray, form: str = ".2g") -> str:
    """Return the range of the finite values as text: "0.1 to 0.3", or "0.1"."""
    known = values[np.isfinite(values)]
    ends = (
        dict.fromkeys(f"{end:{form}}" for end in (known.min(), known.max())) if known.size else ()
    )
    return " to ".join(ends) or "unknown"
