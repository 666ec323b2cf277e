"""The code of a job: the modules that its function imports, and the user's own functions."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from pipeline.provenance.own_code import identify, is_own, module_of
from pipeline.provenance.sources import VERSIONS, closure, digest, home, modules


@dataclass(frozen=True)
class Code:
    """The code that determines the numbers of a cube.

    Attributes
    ----------
    modules : tuple of str
        Modules of `nasm` and `pipeline.cubes`.
    own : str
        Digest of the user's own functions; "" if there are none.
    """

    modules: tuple[str, ...]
    own: str = ""

    @property
    def computed_by(self) -> str:
        """The code as one line: digests of this process's files, and versions of the libraries."""
        own = [f"own code {self.own}"] if self.own else []
        return ", ".join([f"mathematics {digest(self.modules)}", *own, VERSIONS])


EVERYTHING = Code(modules())
"""All modules: the code recorded for cubes that are computed without a job."""


def code_of(function: Callable[..., Any]) -> Code:
    """Return the code that a function depends on.

    Parameters
    ----------
    function : callable
        A function from these packages, the user's own function, or a `functools.partial` of these.

    Raises
    ------
    ValueError
        If something that the user's function refers to cannot be identified.

    Examples
    --------
    >>> from nasm.maps import kick
    >>> from pipeline.provenance.job_code import code_of
    >>> "nasm.maps" in code_of(kick).modules, "nasm.escape" in code_of(kick).modules
    (True, False)
    """
    modules: set[str] = set()
    own: list[str] = []
    for each in _functions(function):
        if is_own(module_of(each)):
            text, names = identify(each)
            own.append(text)
            modules.update(*map(home, names))
        else:
            modules.update(home(module_of(each)))
    digest_of_own = hashlib.sha256("\0".join(own).encode()).hexdigest()[:12] if own else ""
    return Code(closure(tuple(sorted(modules))), digest_of_own)


def _functions(function: Any) -> list[Any]:
    """Return the unwrapped function, or all functions in a partial that is not the user's own."""
    if isinstance(function, partial) and not is_own(module_of(function)):
        parts = [function.func, *function.args, *function.keywords.values()]
        return [each for part in parts if callable(part) for each in _functions(part)]
    inner = getattr(function, "__wrapped__", None)
    return [function] if inner is None else _functions(inner)
