"""The sources of `nasm` and `pipeline.cubes`: the imports of each module, and digests of files.

The closure of a module is the set of modules that it imports, directly or indirectly, according to
the import statements in their texts; nothing is executed. If a name is imported from a package, the
package's stub shows which module it comes from.
"""

import ast
import hashlib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path

from nasm import __version__
from nasm.sources import DISTRIBUTION

_ROOT = Path(__file__).parents[2]
_LIBRARIES = "llvmlite", "numba", "numpy", "rocket-fft", "scipy", "xarray", "zarr"


def _read(suffix: str) -> dict[str, bytes]:
    """Return the contents of files with a suffix, by module; an __init__ represents its package."""
    paths = [*_ROOT.glob(f"nasm/**/*{suffix}"), *_ROOT.glob(f"pipeline/cubes/**/*{suffix}")]
    files = {}
    for path in sorted(paths):
        parts = path.relative_to(_ROOT).with_suffix("").parts
        files[".".join(part for part in parts if part != "__init__")] = path.read_bytes()
    return files


# The files are read at import, so a process that is running when they are edited keeps the old
# text.
_SOURCES, _STUBS = _read(".py"), _read(".pyi")

PROGRAM = f"{DISTRIBUTION} {__version__}"
"""Name and version of this program, stored as the attribute `source` of cubes."""

VERSIONS = ", ".join(f"{library} {version(library)}" for library in _LIBRARIES)
"""Versions of the libraries that affect the numbers, on one line."""


def modules() -> tuple[str, ...]:
    """List all modules of `nasm` and `pipeline.cubes`.

    Examples
    --------
    >>> from pipeline.provenance.sources import modules
    >>> "nasm.maps" in modules()
    True
    """
    return tuple(_SOURCES)


@cache
def digest(modules: tuple[str, ...]) -> str:
    """Compute the first 12 digits of the SHA-256 of modules' files; a missing file counts as empty.

    Examples
    --------
    >>> from pipeline.provenance.sources import digest
    >>> len(digest(("nasm.maps", "nasm.numbers")))
    12
    """
    sha = hashlib.sha256()
    for module in modules:
        sha.update(module.encode() + b"\0" + _SOURCES.get(module, b"") + b"\0")
    return sha.hexdigest()[:12]


@cache
def closure(modules: tuple[str, ...]) -> tuple[str, ...]:
    """List the given modules, all modules that they import, even indirectly, and their packages.

    Examples
    --------
    >>> from pipeline.provenance.sources import closure
    >>> closure(("nasm.types",))
    ('nasm', 'nasm.checks', 'nasm.numbers', 'nasm.sources', 'nasm.texts', 'nasm.types')
    """
    known: set[str] = set()
    waiting = set().union(*map(home, modules))
    while waiting:
        known |= waiting
        waiting = {name for module in waiting for name in _imported(module)} - known
    return tuple(sorted(known))


@cache
def _imported(module: str) -> set[str]:
    """Return the modules that a module imports, at top level or inside functions."""
    return set().union(*map(home, names_used(ast.parse(_SOURCES[module]), {})))


def names_used(tree: ast.AST, known: Mapping[str, str]) -> set[str]:
    """Return the full names of everything that code imports, and of what it uses from its imports.

    Parameters
    ----------
    tree : ast.AST
        The code.
    known : mapping of str to str
        Full names of what the code uses without importing it, e.g. {"np": "numpy"}.

    Returns
    -------
    set of str
        The full names; for a package used as a value, as in `getattr(nasm, …)`, also NAME.*.

    Examples
    --------
    >>> import ast
    >>> from pipeline.provenance.sources import names_used
    >>> sorted(names_used(ast.parse("from nasm import tori; tori.graph(1)"), {}))
    ['nasm.tori', 'nasm.tori.graph']
    """
    full_names, used, nodes = dict(known), set(), list(ast.walk(tree))
    for node in nodes:
        if isinstance(node, ast.Import):
            for alias in node.names:
                used.add(alias.name)
                bound = alias.name if alias.asname else alias.name.partition(".")[0]
                full_names[alias.asname or bound] = bound
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                used.add(f"{node.module}.{alias.name}")
                full_names[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    bases = {id(node.value) for node in nodes if isinstance(node, ast.Attribute)}
    for node in nodes:
        if isinstance(node, ast.Name | ast.Attribute) and id(node) not in bases:
            first, *rest = _parts(node)
            if first in full_names:
                used.add(".".join([full_names[first], *(rest or "*")]))
    return used


def _parts(node: ast.expr) -> list[str]:
    """Return the parts of a dotted name; the first is "" if the base is not a name."""
    rest: list[str] = []
    while isinstance(node, ast.Attribute):
        rest.insert(0, node.attr)
        node = node.value
    return [node.id if isinstance(node, ast.Name) else "", *rest]


def home(name: str) -> set[str]:
    """Return the modules that a full name belongs to: its own, and the packages that contain it.

    Examples
    --------
    >>> from pipeline.provenance.sources import home
    >>> sorted(home("nasm.tori.graph")), home("numpy.sin")
    (['nasm', 'nasm.tori', 'nasm.tori.newton'], set())
    """
    found: set[str] = set()
    module = ""
    for part in name.split("."):
        inner = f"{module}.{part}".lstrip(".")
        if inner in _SOURCES or inner == "pipeline":
            module = inner
            found |= {module} & _SOURCES.keys()
        elif part == "*" and module in _STUBS:
            return found | {each for each in _SOURCES if each.startswith(f"{module}.")}
        else:
            elsewhere = _exports(module).get(part, "")
            return found | home(elsewhere) if elsewhere else found
    return found


@cache
def _exports(package: str) -> dict[str, str]:
    """Return the full name of each name that a package exports, according to its stub."""
    return {
        alias.asname or alias.name: f"{package}.{node.module}.{alias.name}"
        for node in ast.parse(_STUBS.get(package, b"")).body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
