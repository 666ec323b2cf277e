"""Examples in docstrings: each is run, and must print the output shown."""

import doctest
from importlib import import_module
from pkgutil import walk_packages

import pytest

import nasm
import pipeline


def examples():
    """Yield the examples of each docstring of both packages, as a DocTest."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    for package in nasm, pipeline:
        for module in walk_packages(package.__path__, f"{package.__name__}."):
            yield from finder.find(import_module(module.name), module.name)


@pytest.mark.parametrize(
    "example", [example for example in examples() if example.examples], ids=lambda test: test.name
)
def test_an_example_prints_the_output_shown(example, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    report = []
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    runner = doctest.DocTestRunner(verbose=False, optionflags=flags)  # regardless of pytest's -v
    runner.run(example, out=report.append)
    assert not report, "".join(report)
