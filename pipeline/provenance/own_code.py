"""The user's own functions: what identifies them, and how they are sent to workers.

A function is identified by its text and by the objects that it refers to. Of these objects, the
user's own functions and classes are identified in the same way, the user's own modules by their
whole text, and constants by their values. Texts are compared as Python parses them, so comments and
layout do not matter. Python itself and installed packages are identified by name only.
"""

import ast
import inspect
import sys
import sysconfig
import textwrap
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

import cloudpickle
import numpy as np

from pipeline.provenance.sources import names_used

_STDLIB, _SITES = sysconfig.get_path("stdlib"), {"site-packages", "dist-packages"}
_CONSTANTS = bool, int, float, complex, str, bytes, type(None)


class ByValue:
    """A function sent to workers as code, together with the user's own modules that it uses.

    Workers need not be able to import these modules.

    Examples
    --------
    >>> import math, pickle
    >>> from pipeline.provenance.own_code import ByValue
    >>> pickle.loads(pickle.dumps(ByValue(math.hypot)))(3, 4)
    5.0
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.__wrapped__ = function

    def __call__(self, *args: Any) -> Any:
        return self.__wrapped__(*args)

    def __reduce__(self) -> tuple[Any, ...]:
        modules = [m for m in _own_modules(self.__wrapped__) if m.__name__ != "__main__"]
        registered = cloudpickle.list_registry_pickle_by_value()
        modules = [module for module in modules if module.__name__ not in registered]
        for module in modules:
            cloudpickle.register_pickle_by_value(module)
        try:
            return _received, (cloudpickle.dumps(self.__wrapped__),)
        finally:
            for module in modules:
                cloudpickle.unregister_pickle_by_value(module)


@lru_cache(16)  # a worker receives the same bytes with every batch
def _received(data: bytes) -> ByValue:
    return ByValue(cloudpickle.loads(data))


def identify(function: Callable[..., Any]) -> tuple[str, set[str]]:
    """Identify one of the user's own functions.

    Returns
    -------
    text : str
        Text that changes only if the function, or something that it refers to, changes.
    names : set of str
        Full names of everything that this code uses from other modules, e.g. "nasm.maps.kick".

    Raises
    ------
    ValueError
        If the text of a function, or the value of something that it refers to, cannot be obtained.

    Examples
    --------
    >>> import math
    >>> from pipeline.provenance.own_code import identify
    >>> identify(math.hypot)
    ('math.hypot', {'math.hypot'})
    """
    texts: list[str] = []
    names: set[str] = set()
    for _, text, used in _parts(function):
        texts.append(text)
        names |= used
    return "\0".join(texts), names


def _own_modules(function: Callable[..., Any]) -> list[ModuleType]:
    """Return the user's own modules that a function belongs to or uses, even indirectly."""
    items = [item for item, *_ in _parts(function)]
    named = {module_of(item) for item in items if _is_code(item)}
    return [sys.modules[name] for name in sorted(named) if is_own(name) and name in sys.modules]


def _parts(function: Callable[..., Any]) -> Iterator[tuple[Any, str, set[str]]]:
    """Yield (item, its text, full names that it uses) for a function and all it depends on."""
    waiting: list[tuple[str, Any]] = [("the function", function)]
    seen: dict[int, Any] = {}  # keeps the items alive, so that no two have the same id
    while waiting:
        label, item = waiting.pop(0)
        item = inspect.unwrap(item.py_func if _is_compiled(item) else item)
        if id(item) in seen:
            continue
        seen[id(item)] = item
        if isinstance(item, partial):
            arguments = [*enumerate(item.args), *item.keywords.items()]
            waiting += [(label, item.func), *((f"argument {key}", each) for key, each in arguments)]
        elif not _is_code(item):
            yield item, f"{label} = {_value(label, item)}", set()
            if is_own(type(item).__module__):
                waiting.append((label, type(item)))
        elif not is_own(module_of(item)):
            name = _full_name(item)
            yield item, name, {name}
        else:
            tree, named = _tree(label, item), _named(item)
            known = {name: _full_name(value) for name, value in named.items() if _is_code(value)}
            yield item, ast.dump(tree), names_used(tree, known)
            used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
            waiting += [(name, named[name]) for name in sorted(used & named.keys())]
            defaults = getattr(item, "__defaults__", None), getattr(item, "__kwdefaults__", None)
            waiting += [(f"the defaults of {label}", each) for each in defaults if each]
            if inspect.ismethod(item):
                waiting.append((f"the object of {label}", item.__self__))


def _tree(label: str, item: Any) -> ast.Module:
    """Return the parsed text of a function, a class or a module, without comments."""
    try:
        # For code made by eval or exec, Python 3.13 returns the text of a different call.
        if inspect.isfunction(item) and item.__code__.co_filename == "<string>":
            raise OSError("it was made by eval, exec or python -c")
        return ast.parse(textwrap.dedent(inspect.getsource(item)))
    except (OSError, TypeError, SyntaxError):
        cure = "define it with def, in a file or in a notebook cell"
        raise ValueError(f"{label}: the text of {item!r} cannot be read; {cure}") from None


def _named(item: Any) -> dict[str, Any]:
    """Return the names that an item may use, each with its value."""
    if isinstance(item, ModuleType):  # its constants are part of its text
        return {name: value for name, value in vars(item).items() if _is_code(value)}
    if inspect.isclass(item):
        return dict(vars(sys.modules[item.__module__]))
    enclosing = zip(item.__code__.co_freevars, item.__closure__ or (), strict=True)
    return item.__globals__ | {name: cell.cell_contents for name, cell in enclosing}


def _is_code(value: Any) -> bool:
    is_module = isinstance(value, ModuleType)
    return is_module or inspect.isroutine(value) or inspect.isclass(value) or _is_compiled(value)


def _is_compiled(value: Any) -> bool:
    """Return True for a function compiled by Numba."""
    return inspect.isfunction(getattr(value, "py_func", None))


def _full_name(item: Any) -> str:
    if isinstance(item, ModuleType):
        return item.__name__
    return f"{module_of(item)}.{getattr(item, '__qualname__', '')}"


def module_of(item: Any) -> str:
    """Return the name of the module of a function, class, partial or module; "" if it has none.

    Examples
    --------
    >>> from functools import partial
    >>> from nasm.maps import kick
    >>> from pipeline.provenance.own_code import module_of
    >>> module_of(partial(kick, 0.3))
    'nasm.maps'
    """
    while isinstance(item, partial):
        item = item.func
    if isinstance(item, ModuleType):
        return item.__name__
    return getattr(item, "__module__", None) or ""


def is_own(module: str) -> bool:
    """Return True unless a module belongs to Python, an installed package, `nasm` or `pipeline`.

    Modules of `workflows` count as the user's own, installed or not: workers need not have them.

    Examples
    --------
    >>> from pipeline.provenance.own_code import is_own
    >>> is_own("numpy"), is_own("nasm.maps"), is_own("__main__")
    (False, False, True)
    """
    if module == "__main__":  # even if a launcher runs the script
        return True
    root = module.partition(".")[0]
    if root in ("nasm", "pipeline") or not module:
        return False
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:  # built in, or created in an interactive session
        return root not in sys.stdlib_module_names
    is_installed = Path(file).is_relative_to(_STDLIB) or bool(_SITES & {*Path(file).parts})
    return root == "workflows" or not is_installed


def _value(label: str, value: Any) -> str:
    """Return the value of a constant as a string."""
    if isinstance(value, np.ndarray | np.generic) and value.dtype != object:
        return f"{value.dtype}{value.shape}{value.tobytes()!r}"
    if isinstance(value, list | tuple | set | frozenset | dict):
        items = value.items() if isinstance(value, dict) else value
        texts = [_value(label, each) for each in items]
        return f"{type(value).__name__}{sorted(texts) if isinstance(value, set) else texts}"
    if isinstance(value, _CONSTANTS):
        return repr(value)
    try:
        return repr(cloudpickle.dumps(value))
    except Exception:
        raise ValueError(
            f"{label}={value!r:.80}: the function refers to it, but its value cannot be stored; "
            "create it inside the function"
        ) from None
