"""Imports point only downwards: workflows → pipeline → nasm."""

import ast
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path
    for package in ("nasm", "pipeline", "workflows")
    for path in sorted((ROOT / package).rglob("*.py"))
}
PACKAGES = {module.removesuffix(".__init__") for module in MODULES if "__init__" in module}


@cache
def imports(module):
    """Return the names of everything that the module imports, including imports inside functions.

    `from a import b` counts as a.b, and also as a unless a is a package.
    """
    names = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0  # imports are absolute
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {node.module} - PACKAGES  # for a package, only the imported names count
    return names


def packages(module):
    return {name.split(".")[0] for name in imports(module)}


NASM, PIPELINE, FIGURES, WORKFLOWS = (
    [module for module in MODULES if module.startswith(package)]
    for package in ("nasm", "pipeline", "workflows.figures", "workflows.")
)

# Several processes write kernels to disk, hence the lock; the extra `proof` installs flint.
MORE = {"arithmetic.kernels": "filelock", "proofs.barrier": "flint", "proofs.patches": "flint"}
MORE |= {"proofs.residuals": "flint", "proofs.precision": "flint"}


@pytest.mark.parametrize("module", NASM)
def test_nasm_imports_only_allowed_libraries_and_the_checker_only_flint(module):
    allowed = {"nasm", "lazy_loader", "llvmlite", "numba", "numpy", "rocket_fft", "scipy"}
    allowed.add(MORE.get(module.removeprefix("nasm."), "nasm"))
    if module == "nasm.proofs.certificate_checker":
        allowed = {"flint"}
    assert packages(module) <= allowed | sys.stdlib_module_names


@pytest.mark.parametrize("module", PIPELINE)
def test_pipeline_does_not_import_workflows(module):
    assert "workflows" not in packages(module)


@pytest.mark.parametrize("module", WORKFLOWS)
def test_commands_and_shared_packages_do_not_import_other_commands(module):
    inside = {name.split(".")[1] for name in imports(module) if name.startswith("workflows.")}
    own = module.split(".")[1]
    assert inside <= {"shared", "figures", own}


DEFINITIONS = ["checks", "maps", "numbers", "planes", "symmetries", "texts", "types"]
DEFINITIONS = {f"nasm.{name}" for name in DEFINITIONS}


@pytest.mark.parametrize("module", FIGURES)
def test_figures_compute_no_physics_directly_or_through_their_imports(module):
    labels = {f"nasm.numbers{name}" for name in ("", ".NAMES", ".moebius", ".parse")}
    labels |= {f"nasm.planes{name}" for name in ("", ".plane_of", ".two_kicks")}
    assert {name for name in imports(module) if name.startswith("nasm.")} <= labels
    seen, left = set(), {module}
    while left:
        seen |= left
        left = {name for each in left for name in imports(each) if name in MODULES} - seen
    rooms = ("workflows.figures.", "nasm.arithmetic.")
    assert {name for name in seen if not name.startswith(rooms)} <= DEFINITIONS


def home(name):
    """Return the subpackage or top-level module of nasm that a name belongs to."""
    return ".".join(name.split(".")[:2])


def test_nasm_has_no_circular_import_of_modules_or_subpackages():
    graph = {home(module): set() for module in NASM}
    for module in NASM:
        graph[home(module)] |= {home(name) for name in imports(module)} - {home(module)}
    assert {"nasm.maps", "nasm.arithmetic"} <= graph["nasm.escape"]
    assert {"nasm.circles", "nasm.converse_kam"} <= graph["nasm.barriers"]
    tuple(TopologicalSorter(graph).static_order())  # raises CycleError, which names the cycle


@pytest.mark.parametrize("room", sorted({home(m) for m in NASM if home(m) in PACKAGES}))
def test_imports_within_a_package_form_no_cycle_and_avoid_its_init(room):
    own = {module for module in NASM if home(module) == room and "__init__" not in module}
    graph = {}
    for module in own:
        names = {name for name in imports(module) if home(name) == room}
        graph[module] = {".".join(name.split(".")[:3]) for name in names}
        assert graph[module] <= own, module
    assert len(graph) > 1
    tuple(TopologicalSorter(graph).static_order())


@pytest.mark.parametrize("module", [m for m in NASM if not m.startswith("nasm.proofs")])
def test_only_nasm_proofs_claims_that_something_is_proved(module):
    if module == "nasm.verdicts":  # it passes on the result of a proof by nasm.proofs
        return
    lines = MODULES[module].read_text(encoding="utf-8").splitlines()
    claims = [
        line for line in lines if re.search(r"\bprove[sdn]?\b|(?<!no )(?<!not a )\bproof\b", line)
    ]
    assert all("nasm.proofs" in line for line in claims), claims


SENDING = """
import asyncio, sys
from bokeh.server.util import bind_sockets
from tornado.httpclient import AsyncHTTPClient
from nasm.planes import two_kicks
from workflows.explore import server

async def send():
    sockets, port = bind_sockets("127.0.0.1", 0)
    server.server_of(server.Shared(two_kicks(), None, None), sockets, port)
    return await AsyncHTTPClient().fetch(f"http://localhost:{port}/")

assert b"<script" in asyncio.run(send()).body
"""


WORKING = """
import sys
import numpy as np
from nasm.planes import two_kicks
from workflows.explore import field, on_workers, rays

on_workers.load_portrait_kernels()
assert on_workers.timed_verdict((0.3, 0.2))
assert field._escapes(np.ones((1, 2)), 10).shape == (1,)
assert rays._on_ray(two_kicks(), 30.0, 0.1)
assert rays._circle_on_rays(two_kicks(), "gamma", [30.0], 100)[0] > 0
"""


@pytest.mark.parametrize(("code", "more"), [(SENDING, []), (WORKING, ["bokeh"])])
def test_the_explorer_imports_slow_libraries_only_when_it_uses_them(code, more):
    """It sends its page first. Its workers never need these libraries."""
    slow = {"dask.array", "distributed", "matplotlib", "pandas", "scipy.ndimage", "xarray", "zarr"}
    code += f"print({slow.union(more)} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


@pytest.mark.parametrize("readme", ["README.md", "nasm/proofs/README.md", "pipeline/README.md"])
def test_names_imported_in_a_readme_exist(readme):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / readme).read_text(encoding="utf-8"), re.S)
    lines = re.findall(r"^(?:>>> )?((?:from|import) .+)$", "".join(blocks), re.M)
    assert lines
    for line in lines:
        exec(line, {})
