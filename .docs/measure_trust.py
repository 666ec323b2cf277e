"""Measure how often each method keeps its promises: python .docs/measure_trust.py [--only NAME]

A method promises that value ± error contains the breakup; some also promise a lower or an upper
bound. One sample is the table of judged forcings, `tests/judged_forcings.csv`, whose breakups were
determined by other means. Each method is applied to these forcings in a fixed random order, so
that a short run, which reaches only some of them, still tests a representative sample. The script
also runs `workflows.stability` and `workflows.work_precision`, which provide the other samples,
and `workflows.claims`, which judges the claims of the paper. It writes .docs/trust.csv and
.docs/claims.csv, which are shown on the Trust page of the site.
"""

import argparse
import ast
import csv
import hashlib
import random
import subprocess
import sys
import time
import tokenize
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import date
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from io import StringIO
from math import isfinite, nan
from pathlib import Path
from pkgutil import resolve_name
from statistics import median
from tempfile import TemporaryDirectory

from nasm import barriers, escape, periodic
from nasm.circles import continuation
from nasm.converse_kam import symmetry_line
from nasm.results import CriticalScale
from pipeline.cubes.warm_up import load_searches
from pipeline.provenance import job_code
from workflows.shared.judgement import Verdict

HERE = Path(__file__).parent
MEASURED = HERE / "trust.csv"
JUDGED = HERE / "claims.csv"
sys.path[:0] = [str(HERE), str(HERE.parent / "tests")]

import studies  # noqa: E402  (beside this file)
from judged import Row, table  # noqa: E402  (in the folder tests)
from score_search import contradictions  # noqa: E402

SEED = 57
ROWS = table()
COMMAND = "python .docs/measure_trust.py"
STUDIES = {
    "python -m workflows.stability": studies.stability,
    "python -m workflows.work_precision": studies.work_precision,
}
CLAIMS = "python -m workflows.claims"
HEAD = (
    "method",
    "promise",
    "sample",
    "asked",
    "answered",
    "broken",
    "worst ratio",
    "CPU s, median",
    "CPU s, largest",
    "command",
    "date",
    "code",
)
CLAIMS_HEAD = ("section", *(verdict.value for verdict in Verdict), "date", "code")


def name_of(function: Callable[..., object]) -> str:
    """Return the shortest name under which users can call a function of `nasm`."""
    name, parts = function.__name__, function.__module__.split(".")
    packages = [".".join(parts[:end]) for end in range(1, len(parts) + 1)]
    known = (home for home in packages if getattr(import_module(home), name, None) is function)
    return f"{next(known)}.{name}"


def code_alone(source: str) -> str:
    """Return Python source code without comments, docstrings or white space.

    The result is the same in all versions of Python.
    """
    lines = source.splitlines()
    for token in tokenize.generate_tokens(StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            lines[node.lineno - 1 : node.end_lineno] = [""] * (node.end_lineno - node.lineno + 1)
    return "".join("".join(lines).split())


@cache
def code_of_module(name: str) -> str:
    spec = find_spec(name)
    return code_alone(Path(spec.origin).read_text(encoding="utf-8"))


def digest(modules: Iterable[str]) -> str:
    """Return the first 12 digits of the SHA-256 of the modules' code, without comments."""
    code = "\n".join(map(code_of_module, modules))
    return hashlib.sha256(code.encode()).hexdigest()[:12]


def code_of(function: Callable[..., object]) -> str:
    """Return the digest of all modules that a function depends on."""
    return digest(job_code.code_of(function).modules)


def has_changed(row: Mapping[str, str]) -> bool:
    """Return True if the code of a method, or of the claims, differs from its recorded digest."""
    if "method" in row:
        return row["code"] != code_of(resolve_name(row["method"]))
    return row["code"] != digest(job_code.EVERYTHING.modules)


@dataclass(frozen=True)
class Method:
    """A method of `nasm` whose promises are tested.

    Attributes
    ----------
    function : callable
        The method itself.
    arguments : str
        The arguments of its call, as text shown on the Trust page.
    answer : callable
        Computes the method's answer for a row of the table.
    applies : callable
        Returns True for a row to which the method applies.
    fields : tuple of str
        Names of the fields of its answer that are tested: one or more of value, lower and upper.
    """

    function: Callable[..., CriticalScale]
    arguments: str
    answer: Callable[[Row], CriticalScale]
    applies: Callable[[Row], bool]
    fields: tuple[str, ...]


def is_ray(row: Row) -> bool:
    return row.start is None


def has_circle(row: Row) -> bool:
    """Return True if the circle that breaks last is known and does not reappear once broken."""
    if row.image_of is not None:
        number, _ = row.image_of
        return bool(row.omega) and has_circle(ROWS[number])
    return bool(row.omega) and "bracket" not in row.method


# Cheap methods come first; later methods may also use the CPU time that is left over.
METHODS = (
    Method(
        symmetry_line.critical_scale,
        "(profile, 1000)",
        lambda row: symmetry_line.critical_scale(row.profile, 1000),
        lambda row: is_ray(row) and len(row.profile) <= 2,
        ("value", "upper"),
    ),
    Method(
        continuation.critical_scale,
        "(omega, profile)",
        lambda row: continuation.critical_scale(row.omega, row.profile),
        lambda row: is_ray(row) and has_circle(row),
        ("value", "lower"),
    ),
    Method(
        periodic.critical_scale,
        "(omega, profile)",
        lambda row: periodic.critical_scale(row.omega, row.profile, start=row.start),
        has_circle,
        ("value",),
    ),
    Method(
        escape.critical_scale,
        "(profile, 10_000, 300)",
        lambda row: escape.critical_scale(row.profile, 10_000, 300),
        is_ray,
        ("value",),
    ),
    Method(
        barriers.critical_scale,
        "(profile, 1e-3)",
        lambda row: barriers.critical_scale(row.profile, 1e-3, start=row.start),
        lambda row: True,
        ("value", "lower", "upper"),
    ),
)


def row_of(function: Callable[..., object], *cells: object) -> dict[str, str]:
    """Return a row of the table; `cells` are the entries between the method and the date."""
    cells = name_of(function), *cells, date.today().isoformat(), code_of(function)
    return dict(zip(HEAD, map(str, cells), strict=True))


def short(number: float) -> str:
    return f"{number:.2g}" if isfinite(number) else ""


def measure(method: Method, seconds: float) -> dict[str, str]:
    """Test a method on as many forcings as the CPU time allows; return its row for the table."""
    rows = [row for row in ROWS.values() if method.applies(row)]
    random.Random(SEED).shuffle(rows)
    load_searches()  # compiles the kernels before the clock starts
    method.answer(rows[0])
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
        print(f"{method.arguments} breaks its promise on rows {broken}", file=sys.stderr)
    n_independent = sum(row.image_of is None for row in rows[: len(times)])
    sample = f"judged forcings, {n_independent} of them independent"
    if len(times) < len(rows):
        sample += f", the first {len(times)} of {len(rows)}"
    return row_of(
        method.function,
        f"{', '.join(method.fields)}: `{method.arguments}`",
        sample,
        len(times),
        len(ratios),
        len(broken),
        short(max(ratios, default=nan)),
        short(median(times) if times else nan),
        short(max(times, default=nan)),
        COMMAND,
    )


def run(command: str, folder: Path) -> Path:
    """Run a command of `workflows`; return the folder with its results."""
    module = command.split()[-1]
    out = folder / module
    subprocess.run([sys.executable, "-m", module, "--quiet", "--out", out], check=True)
    return out


def rows_of_study(command: str, folder: Path) -> list[dict[str, str]]:
    """Run a study; return its rows for the table."""
    return [
        row_of(
            each.method,
            each.promise,
            each.sample,
            each.asked,
            each.answered,
            each.broken,
            short(each.worst),
            "",
            "",
            command,
        )
        for each in STUDIES[command](run(command, folder))
    ]


def rows_of_claims(folder: Path) -> list[dict[str, str]]:
    """Judge the claims of the paper; return a row for each section."""
    code = digest(job_code.EVERYTHING.modules)
    rows = []
    for section, counts in studies.claims(run(CLAIMS, folder)):
        cells = section, *(counts[verdict] for verdict in Verdict), date.today(), code
        rows.append(dict(zip(CLAIMS_HEAD, map(str, cells), strict=True)))
    return rows


def read(path: Path) -> list[dict[str, str]]:
    """Return the rows that an earlier run wrote to the file; [] if there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write(path: Path, head: Iterable[str], rows: Iterable[Mapping[str, str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, head, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--minutes", type=float, default=12.0, help="CPU minutes for the judged forcings"
    )
    parser.add_argument(
        "--only", default="", help="run only methods and commands whose names contain this text"
    )
    parser.add_argument(
        "--studies", default="", help="folder with earlier runs of the commands, to be continued"
    )
    options = parser.parse_args()
    methods = [method for method in METHODS if options.only in name_of(method.function)]
    commands = [command for command in (*STUDIES, CLAIMS) if options.only in command]
    if not [*methods, *commands]:
        parser.error(f"no method or command has {options.only!r} in its name")
    measured, seconds = [], 60 * options.minutes
    for number, method in enumerate(methods):
        begun = time.process_time()
        measured.append(measure(method, seconds / (len(methods) - number)))
        seconds = max(0.0, seconds - (time.process_time() - begun))
        print(*measured[-1].values(), sep="  ", flush=True)
    with TemporaryDirectory() as temporary:
        folder = Path(options.studies or temporary)
        for command in commands:
            if command == CLAIMS:
                write(JUDGED, CLAIMS_HEAD, rows_of_claims(folder))
            else:
                measured += rows_of_study(command, folder)
    if measured:
        renewed = {row["method"] for row in measured if row["command"] == COMMAND}
        kept = [
            row
            for row in read(MEASURED)
            if row["command"] not in commands
            and not (row["command"] == COMMAND and row["method"] in renewed)
        ]
        write(MEASURED, HEAD, sorted([*kept, *measured], key=order))


def order(row: Mapping[str, str]) -> tuple[str, bool, str]:
    """Return a sort key: by method, with the row for the judged forcings first."""
    return row["method"], row["command"] != COMMAND, row["command"]


if __name__ == "__main__":
    main()
