"""Verdicts as records, which `workflows.ask` writes as JSON or, for many forcings, as a table."""

import csv
from io import StringIO
from math import isfinite

from nasm.verdicts import verdict

_COLUMNS = ("forcing", "kicks", "answer", "evidence", "omega", "rotation_number", "value")
_COLUMNS += ("error", "lower", "upper", "status", "steps")


def answered(strengths, prove):
    """Return the verdict on one period of kicks as a dict of strings and numbers.

    value, error, lower and upper are factors that multiply the strengths; steps is a number of
    periods. Unknown numbers are None.
    """
    result = verdict(strengths, prove)
    boundary, omega = result.boundary, result.boundary.omega
    names = "value", "error", "lower", "upper"
    numbers = {name: getattr(boundary, name) for name in names} | {"steps": result.steps}
    return {
        "kappa": strengths.tolist(),
        "kicks": strengths.size,
        "answer": result.answer.value,
        "evidence": result.evidence.name.lower(),
        "omega": None if omega is None else str(omega),
        "rotation_number": None if omega is None else float(omega),
        **{name: float(x) if isfinite(x) else None for name, x in numbers.items()},
        "status": boundary.status.name.lower(),
    }


def line(record):
    """Return the answer and the scale of the breakup on one line."""
    value, upper = record["value"], record["upper"]
    if value is not None:
        return f"{record['answer']}; the last circle breaks at {value:.7g} times these strengths"
    return f"{record['answer']}" + (
        f"; no circle at {upper:.7g} times these strengths" if upper else ""
    )


def csv_of(records):
    """Return records as the text of a CSV table, with an empty cell for None."""
    text = StringIO()
    table = csv.DictWriter(text, _COLUMNS, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    table.writerows({"forcing": n, **record} for n, record in enumerate(records, 1))
    return text.getvalue()
