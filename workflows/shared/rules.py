"""Verdicts on what a command claims, made of measured values by a rule, never written by hand."""

from enum import Enum

import numpy as np


class Verdict(Enum):
    HOLDS = "holds"
    CAVEAT = "holds with a caveat"
    FAILS = "does not hold"
    UNDECIDED = "not decided"


def graded(text, literal, weaker=False, known=True):
    """Judge by whether a claim holds literally, or in a weaker sense; `known`: if at all."""
    if not known:
        return text, Verdict.UNDECIDED
    if literal:
        return text, Verdict.HOLDS
    return text, Verdict.CAVEAT if weaker else Verdict.FAILS


def finding(claim, measured, literal, weaker=False, known=True):
    """Return a claim, its verdict, see `graded`, and what was measured, in sentences."""
    _, verdict = graded(measured, literal, weaker, known)
    if not known:
        return f"Claim: {claim}. This is {verdict.value}: the run has too few values for it."
    return f"Claim: {claim}. This {verdict.value}: {measured}."


def span(values, form=".2g"):
    """Say from where to where the finite ones of an array are: "0.1 to 0.3", or "0.1"."""
    known = values[np.isfinite(values)]
    ends = (
        dict.fromkeys(f"{end:{form}}" for end in (known.min(), known.max())) if known.size else ()
    )
    return " to ".join(ends) or "unknown"
