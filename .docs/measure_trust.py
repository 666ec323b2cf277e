"""Measure how often each method keeps its promise: python .docs/measure_trust.py [--minutes 10]

The sample is the table of judged forcings, `tests/judged_forcings.csv`. Writes out/trust.csv, which
the page Trust of the site shows.
"""

import argparse
import csv
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from statistics import median

import nasm
from nasm import escape, periodic
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.critical import CriticalScale

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from judged import Row, table  # noqa: E402  (in the folder above)
from score_search import contradictions  # noqa: E402

HEAD = ("method", "promise", "asked", "answered", "kept", "worst ratio", "CPU s, median")
INTERVAL = "value ± error contains the breakup"


@dataclass(frozen=True)
class Method:
    """A method, the rows that it can be asked about, and which of their promises are judged."""

    name: str
    promise: str
    answer: Callable[[Row], CriticalScale]
    applies: Callable[[Row], bool]
    fields: tuple[str, ...]


def is_ray(row: Row) -> bool:
    return row.start is None


def has_circle(row: Row) -> bool:
    """Whether the circle that breaks last is known, and its breakup is a point."""
    return is_ray(row) and bool(row.omega) and "bracket" not in row.method


METHODS = (
    Method(
        "`nasm.critical_scale`",
        f"{INTERVAL}; a circle at lower, none at upper",
        lambda row: nasm.critical_scale(row.profile, 1e-3),
        is_ray,
        ("value", "lower", "upper"),
    ),
    Method(
        "`periodic.critical_scale`",
        INTERVAL,
        lambda row: periodic.critical_scale(row.omega, row.profile),
        has_circle,
        ("value",),
    ),
    Method(
        "`continuation.critical_scale`",
        f"{INTERVAL}; a circle at lower",
        lambda row: continuation.critical_scale(row.omega, row.profile),
        has_circle,
        ("value", "lower"),
    ),
    Method(
        "`symmetry_line.critical_scale`",
        f"{INTERVAL}; no circle at upper",
        lambda row: symmetry_line.critical_scale(row.profile, 1000),
        lambda row: is_ray(row) and len(row.profile) <= 2,
        ("value", "upper"),
    ),
    Method(
        "`escape.critical_scale`",
        INTERVAL,
        lambda row: escape.critical_scale(row.profile, 10_000, 300),
        is_ray,
        ("value",),
    ),
)


def measure(method: Method, rows: list[Row], seconds: float) -> tuple[object, ...]:
    """Return a line of the table; rows that are not reached within the CPU time are not asked."""
    end = time.process_time() + seconds
    asked = kept = 0
    ratios, times = [], []
    for row in rows:
        if time.process_time() > end:
            break
        begun = time.process_time()
        scale = method.answer(row)
        times.append(time.process_time() - begun)
        asked += 1
        if isfinite(scale.value):
            ratios.append(abs(scale.value - row.value) / (scale.error + row.error))
            kept += not set(contradictions(row, scale)) & set(method.fields)
    worst = f"{max(ratios):.2f}" if ratios else ""
    spent = f"{median(times):.2f}" if times else ""
    return method.name, method.promise, asked, len(ratios), kept, worst, spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="CPU time in all")
    options = parser.parse_args()
    lines = []
    for method in METHODS:
        rows = [row for row in table().values() if method.applies(row)]
        method.answer(rows[0])  # kernels compile before the clock starts
        lines.append(measure(method, rows, 60 * options.minutes / len(METHODS)))
        print(*lines[-1], sep="  ", flush=True)
    path = ROOT / "out" / "trust.csv"
    path.parent.mkdir(exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([HEAD, *lines])


if __name__ == "__main__":
    main()
