"""What a user types and sees: the names that tab completion offers, and how results are printed."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from oracles import KAPPA_G

import nasm
from nasm import periodic
from nasm.numbers import parse

MODULES = sorted(Path(nasm.__file__).parent.rglob("[!_]*.py"))
PACKAGES = sorted(path.parent.name for path in Path(nasm.__file__).parent.glob("*/__init__.py"))


def defined_in(path):
    """Yield the names that a module defines itself, not those that it imports."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            yield from (part.id for part in ast.walk(node) if isinstance(part, ast.Name))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_the_public_names_of_a_module_are_defined_there(path):
    path_within = path.relative_to(Path(nasm.__file__).parents[1]).with_suffix("")
    module = import_module(".".join(path_within.parts))
    assert set(module.__all__) <= set(defined_in(path))
    assert all(hasattr(module, name) and name[0] != "_" for name in module.__all__)


@pytest.mark.parametrize("package", [nasm, *(getattr(nasm, name) for name in PACKAGES)])
def test_completion_of_a_package_offers_its_modules_and_public_names(package):
    folder = Path(package.__file__).parent
    modules = {path.stem for path in folder.glob("[!_]*.py")}
    packages = {path.parent.name for path in folder.glob("*/__init__.py")}
    assert modules | packages <= set(dir(package)) == set(package.__all__)
    homes = {
        name: getattr(package, name).__module__ for name in set(dir(package)) - modules - packages
    }
    assert all(name in import_module(home).__all__ for name, home in homes.items())
    with pytest.raises(AttributeError, match="nosuch"):
        package.nosuch  # noqa: B018


def test_the_most_used_functions_are_at_the_top_level():
    assert (nasm.parse, nasm.boundary) == (parse, nasm.barriers.boundary)
    assert nasm.critical_scale is nasm.barriers.critical_scale
    assert nasm.verdict is nasm.verdicts.verdict


def test_importing_the_package_does_not_load_numba():
    code = "import sys, nasm, nasm.circles; assert 'numba' not in sys.modules; nasm.maps.kick"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_boundary_on_axes_and_diagonal_agrees_with_the_standard_map():
    """The standard map's strength is 2κ if every other kick is 0, and κ if both kicks are equal."""
    scales = nasm.boundary([0, 45, 90, 180], tol=1e-2)
    assert all(scale.status is nasm.Status.OK for scale in scales)
    expected = KAPPA_G * np.array([0.5, 2**0.5, 0.5, 0.5])
    assert [scale.value for scale in scales] == pytest.approx(expected, rel=1e-6)
    for scale, kappa in zip(scales, expected, strict=True):
        assert scale.lower < kappa < scale.upper


def test_the_boundary_at_an_angle_is_the_breakup_of_its_last_circle():
    (scale,) = nasm.boundary([30], tol=1e-2)
    assert str(scale.omega) == "[0;1,2,(1)]"
    breakup = periodic.critical_scale("[0;1,2,(1)]", nasm.symmetries.ray(30))
    assert scale.value == pytest.approx(breakup.value, rel=1e-9)


def test_a_single_number_is_a_forcing_of_one_kick():
    assert nasm.maps.forcing(0.3).tolist() == [0.3]
    assert nasm.verdict(0).answer is nasm.Answer.BARRIER
    assert periodic.critical_scale("gamma", 2.0, 400).value == pytest.approx(KAPPA_G / 2, rel=1e-6)


def test_a_verdict_prints_on_one_line_and_as_a_table():
    verdict = nasm.verdict((0.3, 0.4))
    assert "BARRIER" in repr(verdict)
    assert "\n" not in repr(verdict)
    table = verdict._repr_html_()
    for text in str(verdict.boundary.omega), "per kick", "± ", "on a finer grid", "residue":
        assert text in table
    assert nasm.verdict(0)._repr_html_().count("<tr>") == 2


@pytest.mark.parametrize("kappa", [0.3, 3.0])
def test_a_circle_prints_on_one_line_and_as_a_table(kappa):
    circle = nasm.invariant_circle("gamma", kappa)
    assert repr(circle).startswith(f"<InvariantCircle of [0;(1)] under kappa = [{kappa:g}")
    table = circle._repr_html_()
    for text in "[0;(1)] = 0.61803398875 per kick", "points", f"{kappa:g}":
        assert text in table
    assert ("certified on a finer grid" in table) == circle.certified == (kappa == 0.3)
