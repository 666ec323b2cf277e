"""Measure how often each method keeps its promise: python .docs/measure_trust.py [--method NAME]

The sample is the table of judged forcings, `tests/judged_forcings.csv`. Each method is asked about
its forcings in a random order that is always the same, so that the first of them, all that a short
run reaches, are a fair sample. Writes .docs/trust.csv, which the page Trust of the site shows.
"""

import argparse
import csv
import random
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from math import isfinite
from pathlib import Path
from statistics import median

from nasm import barriers, escape, periodic
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.critical import CriticalScale
from pipeline.provenance import job_code
from pipeline.provenance.sources import digest

HERE = Path(__file__).parent
MEASURED = HERE / "trust.csv"
sys.path.insert(0, str(HERE.parent / "tests"))

from judged import Row, table  # noqa: E402  (in the folder above)
from score_search import contradictions  # noqa: E402

SEED = 57
ROWS = table()
HEAD = (
    "method",
    "call",
    "promises",
    "forcings",
    "asked",
    "with a value",
    "broken",
    "worst ratio",
    "CPU s, median",
    "CPU s, largest",
    "date",
    "code",
)


@dataclass(frozen=True)
class Method:
    """A method of `nasm` whose promise is judged.

    Attributes
    ----------
    function : callable
        The method itself.
    call : str
        How it is called, for the page.
    answer : callable
        Its answer about a row of the table.
    applies : callable
        Whether it can be asked about a row.
    fields : tuple of str
        Which of value, lower and upper are promised.
    """

    function: Callable[..., CriticalScale]
    call: str
    answer: Callable[[Row], CriticalScale]
    applies: Callable[[Row], bool]
    fields: tuple[str, ...]

    @property
    def name(self) -> str:
        """The name by which the method is called, without arguments."""
        return self.call.partition("(")[0]

    @property
    def code(self) -> str:
        """The digest of all modules that the method depends on."""
        return digest(job_code.code_of(self.function).modules)


def is_ray(row: Row) -> bool:
    return row.start is None


def has_circle(row: Row) -> bool:
    """Whether the circle that breaks last is known, and breaks once: it does not come back."""
    if image := re.match(r"image of (\d+)", row.method):
        return bool(row.omega) and has_circle(ROWS[int(image[1])])
    return bool(row.omega) and "bracket" not in row.method


# The cheap ones first: the time that they leave is for the search.
METHODS = (
    Method(
        symmetry_line.critical_scale,
        "nasm.converse_kam.symmetry_line.critical_scale(profile, 1000)",
        lambda row: symmetry_line.critical_scale(row.profile, 1000),
        lambda row: is_ray(row) and len(row.profile) <= 2,
        ("value", "upper"),
    ),
    Method(
        continuation.critical_scale,
        "nasm.circles.continuation.critical_scale(omega, profile)",
        lambda row: continuation.critical_scale(row.omega, row.profile),
        lambda row: is_ray(row) and has_circle(row),
        ("value", "lower"),
    ),
    Method(
        periodic.critical_scale,
        "nasm.periodic.critical_scale(omega, profile)",
        lambda row: periodic.critical_scale(row.omega, row.profile, start=row.start),
        has_circle,
        ("value",),
    ),
    Method(
        escape.critical_scale,
        "nasm.escape.critical_scale(profile, 10_000, 300)",
        lambda row: escape.critical_scale(row.profile, 10_000, 300),
        is_ray,
        ("value",),
    ),
    Method(
        barriers.critical_scale,
        "nasm.critical_scale(profile, 1e-3)",
        lambda row: barriers.critical_scale(row.profile, 1e-3, start=row.start),
        lambda row: True,
        ("value", "lower", "upper"),
    ),
)


def measure(method: Method, seconds: float) -> dict[str, object]:
    """Return a method's line of the table; rows not reached within the CPU time are not asked."""
    rows = [row for row in ROWS.values() if method.applies(row)]
    random.Random(SEED).shuffle(rows)
    method.answer(rows[0])  # kernels compile before the clock starts
    end = time.process_time() + seconds
    ratios, times, broken = [], [], []
    for row in rows:
        if time.process_time() > end:
            break
        begun = time.process_time()
        scale = method.answer(row)
        times.append(time.process_time() - begun)
        if isfinite(scale.value):
            ratios.append(abs(scale.value - row.value) / (scale.error + row.error))
        if set(contradictions(row, scale)) & set(method.fields):
            broken.append(row.number)
    if broken:
        print(f"{method.call} breaks its promise on rows {broken}", file=sys.stderr)
    line = (
        method.name,
        method.call,
        ", ".join(method.fields),
        len(rows),
        len(times),
        len(ratios),
        len(broken),
        f"{max(ratios):.2g}" if ratios else "",
        f"{median(times):.2g}" if times else "",
        f"{max(times):.2g}" if times else "",
        date.today().isoformat(),
        method.code,
    )
    return dict(zip(HEAD, line, strict=True))


def kept() -> dict[str, dict[str, object]]:
    """Return the lines measured before, by their methods."""
    if not MEASURED.exists():
        return {}
    with MEASURED.open(encoding="utf-8", newline="") as file:
        return {line["method"]: line for line in csv.DictReader(file)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=12.0, help="CPU time in all")
    parser.add_argument("--method", default="", help="only those with this in their name")
    options = parser.parse_args()
    methods = [method for method in METHODS if options.method in method.call]
    if not methods:
        parser.error(f"no method has {options.method!r} in its name")
    lines, seconds = kept(), 60 * options.minutes
    for number, method in enumerate(methods):
        begun = time.process_time()
        line = measure(method, seconds / (len(methods) - number))
        seconds = max(0.0, seconds - (time.process_time() - begun))
        lines[method.name] = line
        print(*line.values(), sep="  ", flush=True)
    with MEASURED.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, HEAD)
        writer.writeheader()
        writer.writerows(lines[method.name] for method in METHODS if method.name in lines)


if __name__ == "__main__":
    main()
