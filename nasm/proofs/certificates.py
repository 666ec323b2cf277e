"""Certificates of proofs, which another program can check: see proofs/README.md, "Certificates"."""

from collections.abc import Iterable
from typing import Any, Protocol

from nasm.checks import with_sha256
from nasm.numbers import RotationNumber
from nasm.planes import Plane
from nasm.types import FloatArray

__all__ = ["certificate"]

_VERSION = 1
# SHA-256 of the statement of each theorem in proofs/README.md.
_STATEMENTS = {
    "Transport is global": "262141d95693b0b62f3f795cda61e9e083a5385af394d67e85edbe1571432456",
    "Transport is global under several kicks": (
        "c1fbdccdea0195bf4b321a527d9b0984f55a0f1bf7a78dba1f59f19aa76e3e01"
    ),
    "Transport is global in a cell": (
        "252fcfc01d65f0889b4a0b174de5a6003b903e8f7f0525d1c64b8a26d954ebb8"
    ),
    "Transport is global in a cell of a plane": (
        "26a76f764f92e1fda7615db5a3c2133bbe50d04d1bcb0200040076dae86a84e0"
    ),
    "A barrier exists": "39e7a1e397c5a92e49d751f8f00d1d304498a8c6402f591b2eea56ea3c2a93c2",
    "A barrier exists in a fan": (
        "6005a30ef68f1016cd6eb6f93af43ac9da23d17acad3487e6d00bf2b294f0fc2"
    ),
    "A barrier exists in a patch of a plane": (
        "a10d1d000a629702e0ec991e8936f7aac412e70231025aac75e281e0c8ea1814"
    ),
    "A barrier exists by an explicit step": (
        "4cf90fcef4573221fb8c5fc56576fd35bf4e5d82598861eae43448cb9fe27c0c"
    ),
    "A barrier exists in a fan by explicit steps": (
        "5fe9f8e0250ebd8163f6ca70ae73a5b70e8142f5f7c8b192d1d0f0288c7408f9"
    ),
    "A barrier exists in a patch of a plane by explicit steps": (
        "28efc222370a12e53dd8b81408034b1e7cbe8ae800b56e3b2d52823ab3f0dbd3"
    ),
}


class _Proof(Protocol):
    @property
    def proved(self) -> bool: ...

    @property
    def reason(self) -> str: ...


def certificate(
    proof: _Proof,
    theorem: str,
    fields: dict[str, Any],
    kappa: tuple[float, ...],
    half_width: tuple[float, ...] = (),
    omega: RotationNumber | None = None,
    scales: tuple[float, ...] = (),
    plane: Plane | None = None,
) -> dict[str, Any]:
    """Return the certificate of a proof as a JSON-serializable dict.

    The dict contains `fields`, the claim, the theorem, and the SHA-256 of all of these.

    Parameters
    ----------
    proof : BarrierProof, TransportProof or CellProof
        The proof.
    theorem : str
        Name of the theorem, as in proofs/README.md.
    fields : dict
        Data from which a checker can verify the hypothesis of the theorem.
    kappa : tuple of float
        Forcing in the claim; for a cell its centre, for a patch its profile.
    half_width : tuple of float
        Half width of a cell, or tilt of a patch; () for a single forcing.
    omega : RotationNumber or None
        Rotation number of the barrier; None for transport.
    scales : tuple of float
        For a patch: the forcings are s·(kappa + t·half_width), scales[0] ≤ s ≤ scales[1], |t| ≤ 1.
    plane : Plane, optional
        The plane, if the numbers above are coordinates in a plane.

    Raises
    ------
    ValueError
        If proof.proved is False.
    """
    if not proof.proved:
        raise ValueError(f"{proof.reason}; a certificate needs proved=True")
    domain, forcings = "the forcing", _decimals(kappa)
    if scales:
        forcing = "every forcing with coordinates" if plane else "every forcing"
        domain = f"{forcing} from {scales[0]!r} to {scales[1]!r} times"
        if any(half_width):
            forcings = f"({forcings} + t {_decimals(half_width)}), -1 <= t <= 1"
    elif any(half_width):
        domain = f"every forcing within {_decimals(half_width)} of"
    if plane:
        rows = map(_decimals, (plane.origin, plane.first, plane.second))
        forcings += " in the plane {} + a {} + b {}".format(*rows)
    what = f"a rotational invariant circle of {omega} exists" if omega else "transport is global"
    claim = f"{what} under {domain} {forcings}"
    statement = {"name": theorem, "version": _VERSION, "sha256": _STATEMENTS[theorem]}
    return with_sha256({"claim": claim, "theorem": statement, **fields})


def in_hex(numbers: Iterable[float]) -> list[str]:
    """Write floats exactly, as hexadecimal strings.

    Examples
    --------
    >>> from nasm.proofs.certificates import in_hex
    >>> in_hex((0.5, 0.1))
    ['0x1.0000000000000p-1', '0x1.999999999999ap-4']
    """
    return [number.hex() for number in numbers]


def matrix_in_hex(plane: Plane) -> dict[str, list[str]]:
    """Write the three vectors of a plane exactly.

    Examples
    --------
    >>> from nasm.planes import two_kicks
    >>> from nasm.proofs.certificates import matrix_in_hex
    >>> matrix_in_hex(two_kicks())["first"]
    ['0x1.0000000000000p+0', '0x0.0p+0']
    """
    return {name: in_hex(getattr(plane, name)) for name in ("origin", "first", "second")}


def columns_in_hex(rows: FloatArray) -> list[str]:
    """Write each column of a matrix as one hexadecimal string: 16 digits per float, big-endian.

    This form is compact; certificates may have a million rows.

    Examples
    --------
    >>> import numpy as np
    >>> from nasm.proofs.certificates import columns_in_hex
    >>> columns_in_hex(np.array([[0.5, -1.0]]))
    ['3fe0000000000000', 'bff0000000000000']
    """
    return [column.astype(">f8").tobytes().hex() for column in rows.T]


def _decimals(numbers: Iterable[float]) -> str:
    return f"({', '.join(map(repr, numbers))})"
