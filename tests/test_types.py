"""Public functions and methods have annotated parameters and results."""

import inspect
from importlib import import_module
from pkgutil import walk_packages

import pytest
from numba.core.dispatcher import Dispatcher

import nasm
import pipeline
import workflows.shared

# Prefixes of the names of modules that are not annotated yet.
LATER = """

"""


def functions():
    """Yield (name, function) for all public functions and all public methods of public classes."""
    for package in nasm, pipeline, workflows.shared:
        for info in walk_packages(package.__path__, f"{package.__name__}."):
            if not info.ispkg and not info.name.startswith(tuple(LATER.split())):
                yield from public(import_module(info.name))


def public(module):
    for name, value in vars(module).items():
        own = getattr(value, "__module__", None) == module.__name__
        if name.startswith("_") or not own or isinstance(value, Dispatcher):
            continue
        if inspect.isclass(value):
            for method, function in vars(value).items():
                if inspect.isfunction(function) and not method.startswith("_"):
                    yield f"{module.__name__}.{name}.{method}", function
        elif inspect.isfunction(value):
            yield f"{module.__name__}.{name}", value


@pytest.mark.parametrize(("name", "function"), list(functions()))
def test_a_public_function_is_annotated(name, function):
    parameters = inspect.signature(function).parameters.values()
    bare = [p.name for p in parameters if p.annotation is p.empty and p.name not in ("self", "cls")]
    assert not bare
    assert "return" in function.__annotations__
