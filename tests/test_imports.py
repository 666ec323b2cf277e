"""Imports point down only: workflows → pipeline → nasm."""

import ast
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path
    for package in ("nasm", "pipeline", "workflows")
    for path in sorted((ROOT / package).rglob("*.py"))
}


def imports(module):
    """All that the module imports, inside functions too; both a and a.b for `from a import b`."""
    names = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0  # the whole path is written
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def packages(module):
    return {name.split(".")[0] for name in imports(module)}


CHECKER = "nasm.certificate_checker"
NASM, PIPELINE, FIGURES, WORKFLOWS = (
    [module for module in MODULES if module.startswith(package)]
    for package in ("nasm", "pipeline", "workflows.figures", "workflows.")
)


@pytest.mark.parametrize("module", NASM)
def test_nasm_knows_no_file_cluster_or_plot(module):
    allowed = {"nasm", "llvmlite", "numba", "numpy", "rocket_fft", "scipy"}
    if module == "nasm.kernels":  # the compiled kernels on disk have more than one writer
        allowed.add("filelock")
    if module.startswith("nasm.proof_barrier") or module == CHECKER:  # the extra `proof`
        allowed.add("flint")
    assert packages(module) <= allowed | sys.stdlib_module_names


def test_the_checker_of_certificates_shares_no_code_with_the_proofs():
    assert packages(CHECKER) <= {"flint"} | sys.stdlib_module_names


@pytest.mark.parametrize("module", PIPELINE)
def test_pipeline_knows_no_workflow(module):
    assert "workflows" not in packages(module)


@pytest.mark.parametrize("module", WORKFLOWS)
def test_commands_and_their_parts_import_no_other_command(module):
    inside = {name.split(".")[1] for name in imports(module) if name.startswith("workflows.")}
    own = module.split(".")[1]
    assert inside <= {"parts", "figures", own, "explorer" if own == "explore" else own}


@pytest.mark.parametrize("module", FIGURES)
def test_figures_compute_no_physics(module):
    assert "pipeline" not in packages(module)
    labels = {f"nasm.numbers{name}" for name in ("", ".NAMES", ".moebius", ".parse")}
    labels |= {f"nasm.planes{name}" for name in ("", ".plane_of", ".two_kicks")}
    assert {name for name in imports(module) if name.startswith("nasm.")} <= labels


def test_nasm_has_no_circular_import():
    graph = {module: imports(module) & set(NASM) - {module, "nasm"} for module in NASM[1:]}
    assert {"nasm.maps", "nasm.sine"} <= graph["nasm.escape"]
    tuple(TopologicalSorter(graph).static_order())  # CycleError names the circle
