"""The page and the JSON file of `workflows.reference`."""

import json
from collections import Counter
from itertools import groupby
from math import isfinite
from operator import itemgetter

from nasm import __version__
from nasm.texts import rounded_value
from pipeline.sweep.progress import plural
from workflows.figures import files
from workflows.reference.study import COMMAND, KINDS
from workflows.shared.page import render

CONVENTIONS = (
    "Kick n takes (x, y) to y' = y + (κ_n/2π) sin 2πx, x' = x + y', with x and y in turns. A "
    "forcing kappa is one period of strengths, first kick first; it repeats. With one kick this is "
    "the standard map of strength K = κ, with θ = 2πx and p = 2πy."
)
HEADER = "Conditions", "Value", "Second method", "Difference", "Verdict"


def write(run, entries, attributes):
    """Write OUT/reference.json and OUT/reference.html; print contradicted values."""
    counts = Counter(entry["verdict"] for entry in entries)
    summary = f"{plural(len(entries), 'reference value')}: " + ", ".join(
        f"{number} {verdict}" for verdict, number in counts.items()
    )
    run.say(f"{summary}.")
    for entry in entries:
        if entry["verdict"] == "contradicted":
            pair = entry["value"], entry["error"], entry["second_value"], entry["second_error"]
            run.say(
                "Contradicted: {}: {!r} ± {:.1g} and {!r} ± {:.1g}.".format(entry["name"], *pair)
            )
    document = {
        "title": "Reference values of the standard map under periodic and growing kicks",
        "conventions": CONVENTIONS,
        "rule": "contradicted if both values differ by more than the sum of their errors",
        "command": COMMAND,
        "program": f"nasm {__version__}",
        "computed_by": attributes["computed_by"],
        "studied_by": attributes["studied_by"],
        "values": [{name: _finite(value) for name, value in entry.items()} for entry in entries],
    }
    content = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    files.write(run.path("tables", "reference.json"), content + "\n")
    render(
        "reference/page.html",
        run.path("pages", "reference.html"),
        sections=list(sections(entries)),
        conventions=CONVENTIONS,
        summary=summary,
        command=COMMAND,
        header=HEADER,
    )


def sections(entries):
    """For each kind, yield its texts, its rows (see `cells`), and the lines of its first check."""
    for kind, group in groupby(entries, itemgetter("kind")):
        group = list(group)
        checks = [entry["check"]["lines"] for entry in group if entry["check"]]
        yield {
            **KINDS[kind],
            "method": group[0]["method"],
            "second_method": group[0]["second_method"],
            "command": group[0]["command"],
            "check": "\n".join(checks[0]) if checks else "",
            "rows": [(cells(entry), entry["verdict"]) for entry in group],
        }


def cells(entry):
    """Return the text of each table cell for one reference value."""
    return (
        ", ".join(f"{name} = {_plain(value)}" for name, value in entry["conditions"].items()),
        rounded_value(entry["value"], entry["error"]),
        rounded_value(entry["second_value"], entry["second_error"]),
        f"{entry['difference']:.1g}",
        entry["verdict"],
    )


def _finite(value):
    """Return None for NaN or infinity, which JSON lacks, and any other value unchanged."""
    return None if isinstance(value, float) and not isfinite(value) else value


def _plain(value):
    return f"({', '.join(map(str, value))})" if isinstance(value, list) else str(value)
