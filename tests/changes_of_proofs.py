"""Draw one-token changes of the proof programs, and check whether the tests notice them.

    python tests/changes_of_proofs.py draw 53 100   # list the first 100 changes drawn with seed 53
    python tests/changes_of_proofs.py table         # test each unsound change in the table
    python tests/changes_of_proofs.py table 5 17    # test only the changes with these numbers

Changes are drawn from the code on which proofs rest, `PROVING`. Code that only chooses where to
search, or reports results, is left out. A constant is replaced by another one, and a comparison, a
sign or an operation by its opposite or a similar one; a `demand` or a `raise` is removed. A human
judges whether a change is unsound, that is, whether something false could then be called proved.
changes_of_proofs.toml records these judgements for the changes drawn with seed 53, in the order
drawn, up to the fortieth unsound one. From number 400 on it does so for those drawn with seed 71
from later sources. Once the sources have changed, the same seed draws different changes.

The changed program exists only in the memory of a forked process, never on disk. Tests that change
lines themselves (marker `alters_sources`) are left out: they would fail only because a line differs
from their tables.
"""

import ast
import linecache
import multiprocessing
import os
import random
import re
import sys
import tokenize
import tomllib
from importlib import import_module
from importlib.machinery import PathFinder, SourceFileLoader
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import pytest

HERE = Path(__file__).parent
FORKED = multiprocessing.get_context("fork")
# Modules that the tests import, except those that may be changed; loaded once, before forking.
COMMON = "distributed", "hypothesis", "matplotlib.figure", "xarray", "flint", "nasm.barriers"
PROOFS = HERE.parent / "nasm" / "proofs"
# For each module, the functions on which proofs rest; None means all.
PROVING = {
    "certificate_checker": None,
    "barrier": "_omega_ball _divisors _russmann Grid residual norm slope_modes "
    "bounds_of_the_residual bound_of_the_inverse both_sides inequalities verified balls "
    "largest_sine Majorant bounds_of_the_step _all_divisors bound_of_the_slope modes_of_the_sine "
    "inequalities_after_a_step verified_by_a_step _largest_sizes",
    "patches": "covered_up_to _vectors _Patch _chebyshev",
    "residuals": "_sum _product _minus _complex_product _at _put _combine _transform _sine "
    "_compute _linear residuals _radii _pairs _table _rows _grid_tables combined from_integers "
    "upper_sizes as_balls",
    "transport": "_closed is_twist _is_positive _covered _followed _tiles _arithmetic_is_ieee "
    "_follow _start _along _replay _accurate horner _next _kick",
    "transport_cells": "prove_cell prove_cell_of_plane largest_strengths _cell _covered _cover "
    "_bisect _start _coordinate _replay _trigonometry _kick",
}
KERNELS = "transport", "transport_cells"
# Tests of each module, the quickest first.
TESTS = {
    "certificate_checker": (
        "certificate_checker",
        "certificates",
        "proof_planes",
        "proof_step",
        "proof_patches",
        "proof_barrier",
    ),
    "barrier": ("proof_step", "proof_barrier", "proof_patches", "certificates"),
    "patches": ("proof_patches", "certificates"),
    "residuals": ("proof_residuals", "proof_patches"),
    "transport": ("proof_transport", "certificates", "proof_cells"),
    "transport_cells": ("proof_cells", "proof_planes", "certificates"),
}
OTHERS = {
    **{"<": (">", "<="), ">": ("<", ">="), "<=": (">=", "<"), ">=": ("<=", ">")},
    **{"==": ("!=",), "!=": ("==",), "+": ("-",), "-": ("+",), "*": ("/",), "/": ("*",)},
    **{"+=": ("-=",), "-=": ("+=",), "max": ("min",), "min": ("max",), "and": ("or",)},
    **{"or": ("and",), "any": ("all",), "all": ("any",), "maximum": ("minimum",)},
    **{"demand": ("(lambda *_: None)",), "raise": ("",), "not": ("",)},
}


class Change(NamedTuple):
    """A token of a module, at a row and a column, and its replacement."""

    module: str
    row: int
    column: int
    right: str
    wrong: str

    def __str__(self):
        line = source(self.module).splitlines()[self.row - 1]
        wrong = line[: self.column] + self.wrong + line[self.column + len(self.right) :]
        return f"{self.module}:{self.row}\n    {line.strip()}\n    {wrong.strip()}"

    def applied(self, text):
        lines = text.splitlines(keepends=True)
        line = lines[self.row - 1]
        assert line[self.column :].startswith(self.right), "the sources have changed"
        lines[self.row - 1] = (
            line[: self.column] + self.wrong + line[self.column + len(self.right) :]
        )
        return "".join(lines)


def table():
    """Return the rows of changes_of_proofs.toml."""
    return tomllib.loads((HERE / "changes_of_proofs.toml").read_text(encoding="utf-8"))["change"]


def of_row(row):
    """Return the Change that a row describes; raise LookupError if the source lacks the line."""
    lines = source(row["module"]).splitlines()
    results = [i for i, line in enumerate(lines) if line.strip() == row["right"]]
    if len(results) < row.get("occurrence", 1):
        raise LookupError(f"{row['right']!r} is not a line of the module: the table is out of date")
    i = results[row.get("occurrence", 1) - 1]
    column = len(lines[i]) - len(lines[i].lstrip())
    return Change(row["module"], i + 1, column, row["right"], row["wrong"])


def source(module):
    return (PROOFS / f"{module}.py").read_text(encoding="utf-8")


def candidates(module):
    """Yield all possible one-token changes of the code on which proofs rest."""
    text, names = source(module), PROVING[module]
    rows = {
        row
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and (names is None or node.name in names.split())
        for row in range(node.lineno, node.end_lineno + 1)
    }
    for kind, right, (row, column), *_ in tokenize.generate_tokens(StringIO(text).readline):
        if row not in rows:
            continue
        if kind == tokenize.NUMBER and re.fullmatch(r"\d+", right):
            others = str(int(right) + 1), str(max(int(right) - 1, 0))
        elif kind == tokenize.NUMBER:
            others = f"({right} / 2)", f"({right} * 2)"
        else:
            others = OTHERS.get(right, ()) if kind in (tokenize.OP, tokenize.NAME) else ()
        for wrong in others:
            if wrong != right:
                yield Change(module, row, column, right, wrong)


def draw(seed, count):
    """Return changes in random order, at most one per place."""
    everything = [change for module in PROVING for change in candidates(module)]
    random.Random(seed).shuffle(everything)
    chosen, places = [], set()
    for change in everything:
        if len(chosen) == count:
            break
        if change[:3] not in places:
            places.add(change[:3])
            try:
                compile(change.applied(source(change.module)), "changed", "exec")
            except SyntaxError:  # for example, if the * of x[*rows] was changed
                continue
            chosen.append(change)
    return chosen


def noticed_by(change, seconds=3600):
    """Return the first test, fast or slow, that fails with the change; "" if none does."""
    ahead, behind = FORKED.Pipe(False)
    child = FORKED.Process(target=_tested, args=(change, behind))
    child.start()
    behind.close()
    try:
        return ahead.recv() if ahead.poll(seconds) else "no answer within an hour"
    except EOFError:
        return "the process died"
    finally:
        child.terminate()
        child.join()


def _tested(change, pipe):
    """Run the tests in this process, which has not imported the module yet, until one fails."""
    with open(os.devnull, "w") as nowhere:
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nowhere.fileno(), stream.fileno())
    sys.meta_path.insert(0, _Finder(change))
    files = [str(HERE / f"test_{name}.py") for name in TESTS[change.module]]
    first = _First()
    options = [
        "-x",
        "-q",
        "--assert=plain",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "-m",
        "not benchmark and not alters_sources",
    ]
    status = pytest.main([*options, "-o", "addopts=", *files], [first])
    pipe.send(first.failed or (f"pytest exited with status {status}" if status else ""))


class _First:
    """Pytest plugin that runs quick tests first and records the first failure."""

    failed = ""

    def pytest_collection_modifyitems(self, items):
        audits = re.compile("a_kick|bound|constants|refused")
        items.sort(key=lambda item: ("slow" in item.keywords, not audits.search(item.name)))

    def pytest_runtest_logreport(self, report):
        if report.failed and not self.failed:
            self.failed = report.nodeid

    def pytest_collectreport(self, report):
        if report.failed:
            self.failed = report.nodeid


class _Loader(SourceFileLoader):
    """Load a module without using cached kernels; apply the change if it is in this module."""

    def __init__(self, name, path, change):
        super().__init__(name, path)
        text = Path(path).read_text(encoding="utf-8")
        self.text = change.applied(text) if name.endswith(f".{change.module}") else text

    def get_code(self, _):
        return compile(self.text, self.path, "exec", dont_inherit=True)

    def exec_module(self, module):
        # Audits that read the source must read the changed text.
        lines = self.text.splitlines(keepends=True)
        linecache.cache[self.path] = len(self.text), None, lines, self.path
        kernels = import_module("nasm.arithmetic.kernels")
        kept, kernels.directory = kernels.directory, lambda: None
        try:
            super().exec_module(module)
        finally:
            kernels.directory = kept


class _Finder:
    def __init__(self, change):
        self.change = change
        names = KERNELS if change.module in KERNELS else (change.module,)
        self.names = {f"nasm.proofs.{name}" for name in names}

    def find_spec(self, name, path=None, target=None):
        if name not in self.names:
            return None
        spec = PathFinder.find_spec(name, path, target)
        spec.loader = _Loader(name, spec.origin, self.change)
        return spec


if __name__ == "__main__":
    what, *numbers = sys.argv[1], *map(int, sys.argv[2:])
    if what == "draw":
        print(*(f"{i}: {change}" for i, change in enumerate(draw(*numbers))), sep="\n")
    else:
        for module in COMMON:
            import_module(module)
        assert not any(name.startswith("nasm.proofs.") for name in sys.modules)
        for row in table():
            if row["number"] in numbers or not (numbers or "harmless" in row):
                change = of_row(row)
                print(f"{row['number']}: {change}", flush=True)
                print(f"    {noticed_by(change) or 'SURVIVES'}", flush=True)
