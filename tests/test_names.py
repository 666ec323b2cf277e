"""What a user types and sees: names that complete, answers that print on a line or two."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from oracles import KAPPA_G

import nasm
from nasm import periodic
from nasm.numbers import parse

MODULES = sorted(Path(nasm.__file__).parent.rglob("[!_]*.py"))
ROOMS = sorted(path.parent.name for path in Path(nasm.__file__).parent.glob("*/__init__.py"))


def defined_in(path):
    """Names that a module defines, and does not import."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            yield from (part.id for part in ast.walk(node) if isinstance(part, ast.Name))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_completion_shows_the_public_names_that_a_module_defines_itself(path):
    path_within = path.relative_to(Path(nasm.__file__).parents[1]).with_suffix("")
    module = import_module(".".join(path_within.parts))
    assert set(dir(module)) == set(module.__all__) <= set(defined_in(path))
    assert all(hasattr(module, name) and name[0] != "_" for name in module.__all__)


def test_all_names_at_the_top_and_in_the_rooms_are_there_and_no_other():
    for room in (nasm, *(getattr(nasm, name) for name in ROOMS)):
        assert all(getattr(room, name) is not None for name in dir(room))
        modules = {path.stem for path in Path(room.__file__).parent.glob("[!_]*.py")}
        assert modules - {"checks"} <= set(dir(room))
    assert (nasm.parse, nasm.boundary) == (parse, nasm.barriers.boundary)
    with pytest.raises(AttributeError, match="no attribute 'nosuch'"):
        nasm.nosuch  # noqa: B018


@pytest.mark.parametrize(
    "imports",
    [
        "import nasm, nasm.circles; assert 'numba' not in sys.modules",
        "from nasm.verdict import verdict; import nasm; assert nasm.verdict.verdict is verdict",
        "import nasm.barriers; from nasm import verdict; assert verdict is nasm.verdict",
    ],
)
def test_the_verdict_is_asked_for_at_the_top_whatever_was_imported_before(imports):
    asks = "assert nasm.verdict((0, 0)).answer is nasm.verdict.Answer.BARRIER"
    # nasm.barriers as an attribute, without an import of its own
    asks += "; nasm.barriers.critical_scale"
    subprocess.run([sys.executable, "-c", f"import sys; {imports}; {asks}"], check=True)


def test_the_boundary_at_some_angles_is_the_breakup_on_their_rays():
    found = nasm.boundary([0, 30], tol=1e-2)
    assert found == [nasm.barriers.critical_scale(p, 1e-2) for p in nasm.symmetries.ray([0, 30])]


def test_a_number_is_a_forcing_of_one_kick():
    assert nasm.maps.forcing(0.3).tolist() == [0.3]
    assert nasm.verdict(0).answer is nasm.verdict.Answer.BARRIER
    assert periodic.critical_scale("gamma", 2.0, 400).value == pytest.approx(KAPPA_G / 2, rel=1e-6)
