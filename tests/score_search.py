"""Score a search for the last barrier against the table of judged forcings.

    python tests/score_search.py [--tol 1e-3] [--search nasm.barriers:critical_scale]
                                 [--classes "two kicks,zeros"] [--images 5]
                                 [--minutes 10]

The table, `judged_forcings.csv`, states where last barriers break, as determined by methods that
are independent of the search. A search is a function of (profile, tol, start=None) that returns a
CriticalScale. For each class of forcings the script prints

    cases, answered  number of rows searched, and number with a value (status OK or WIDE);
    value            false values, which differ from the table's by more than both errors together;
    lower            false lower ends: above a scale beyond which no circle exists;
    upper            false upper ends: below a scale at which a circle exists;
    width            (upper - lower)/value, median and largest;
    CPU              seconds, median and largest.

Each contradiction and each row without a value is listed with its number. The exit code is 1 if
there is a contradiction. Rows not reached within --minutes of CPU time are also listed.
"""

import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass
from importlib import import_module
from math import inf, isfinite
from statistics import median

from judged import table

from nasm.results import Status

WARM = (1.0, 0.3), (0.3, 0.2, 0.25)  # searched before the clock starts, to compile the kernels


@dataclass(frozen=True)
class Score:
    """The result for one row; `false` names the fields of `found` that the row contradicts."""

    row: object
    found: object
    seconds: float
    false: tuple

    @property
    def answered(self):
        return self.found is not None and self.found.status in (Status.OK, Status.WIDE)

    @property
    def width(self):
        bracket = (self.found.upper - self.found.lower) / self.row.value if self.found else inf
        return bracket if isfinite(bracket) else inf


def contradictions(row, found):
    """Return which of the fields value, lower and upper of a CriticalScale the row contradicts."""
    rounding = 1e-14 * abs(row.value)
    false = {
        "value": abs(found.value - row.value) > found.error + row.error + rounding,
        "lower": found.lower > row.upper + rounding,
        "upper": found.upper < row.exists_below - rounding,
    }
    return tuple(name for name, is_false in false.items() if is_false)


def score(search, row, tol):
    begun = time.process_time()
    start = {} if row.start is None else {"start": row.start}
    try:
        result = search(row.profile, tol, **start)
    except Exception as error:  # a failure on a row is also a result
        print(f"row {row.number}: {type(error).__name__}: {error}", file=sys.stderr)
        return Score(row, None, time.process_time() - begun, ())
    return Score(row, result, time.process_time() - begun, contradictions(row, result))


def summary(name, scores):
    """Return one line of the table."""
    widths = [score.width for score in scores if score.answered] or [inf]
    seconds = [score.seconds for score in scores]
    false = [sum(field in score.false for score in scores) for field in ("value", "lower", "upper")]
    counts = [len(scores), sum(score.answered for score in scores), *false]
    spread = f"{median(widths):8.1e} {max(widths):8.1e} {median(seconds):7.2f} {max(seconds):7.2f}"
    return f"{name:28}" + "".join(f"{count:9}" for count in counts) + f" {spread}"


def report(scores):
    """Return the lines of a report: the table by class, the total, and false or missing results."""
    heads = ("cases", "answered", "value", "lower", "upper")
    lines = [f"{'class':28}" + "".join(f"{head:>9}" for head in heads) + "    width: median, worst"]
    lines[0] += "; CPU s"
    kinds = dict.fromkeys(score.row.kind for score in scores)
    lines += [summary(kind, [s for s in scores if s.row.kind == kind]) for kind in kinds]
    lines += [summary("total", scores), f"{sum(s.seconds for s in scores):.0f} CPU s in all"]
    for s in scores:
        if s.false:
            lines += [f"row {s.row.number}: {', '.join(s.false)}: {s.found}", f"    {s.row.text()}"]
        elif not s.answered:
            lines.append(f"row {s.row.number}: {s.found.status.name if s.found else 'exception'}")
    return lines


def with_images(rows, n_images):
    """Return the rows that were judged directly, and the first n_images exact images of each."""
    kept, seen = [], Counter()
    for row in rows:
        if row.image_of is not None:
            number, _ = row.image_of
            seen[number] += 1
            if seen[number] > n_images:
                continue
        kept.append(row)
    return kept


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tol", type=float, default=1e-3)
    parser.add_argument("--search", default="nasm.barriers:critical_scale", metavar="MODULE:NAME")
    parser.add_argument("--classes", help="score only these classes, separated by commas")
    parser.add_argument("--images", type=int, help="at most this many images of each judged row")
    parser.add_argument("--minutes", type=float, default=10.0, help="stop after this much CPU time")
    options = parser.parse_args(arguments)
    module, _, name = options.search.partition(":")
    search = getattr(import_module(module), name)
    rows = list(table().values())
    if options.classes:
        kinds = [kind.strip() for kind in options.classes.split(",")]
        if unknown := set(kinds) - {row.kind for row in rows}:
            parser.error(f"no rows of class {', '.join(sorted(unknown))}")
        rows = [row for row in rows if row.kind in kinds]
    if options.images is not None:
        rows = with_images(rows, options.images)
    for profile in WARM:
        search(profile, 1e-2)
    end = time.process_time() + 60 * options.minutes
    scores = []
    for row in rows:
        if time.process_time() < end:
            scores.append(score(search, row, options.tol))
    print(*report(scores), sep="\n")
    if left := rows[len(scores) :]:
        print("not reached in time: rows", *(row.number for row in left))
    return int(any(score.false for score in scores))


if __name__ == "__main__":
    sys.exit(main())
