"""What a proof leaves for another program to check; see proofs/README.md, "Certificates"."""

from nasm.checks import with_sha256

__all__ = ["certificate"]

_VERSION = 1
# SHA-256 of each statement in proofs/README.md.
_STATEMENTS = {
    "Transport is global": "262141d95693b0b62f3f795cda61e9e083a5385af394d67e85edbe1571432456",
    "Transport is global under several kicks": (
        "c1fbdccdea0195bf4b321a527d9b0984f55a0f1bf7a78dba1f59f19aa76e3e01"
    ),
    "Transport is global in a cell": (
        "252fcfc01d65f0889b4a0b174de5a6003b903e8f7f0525d1c64b8a26d954ebb8"
    ),
    "A barrier exists": "39e7a1e397c5a92e49d751f8f00d1d304498a8c6402f591b2eea56ea3c2a93c2",
    "A barrier exists in a fan": (
        "6005a30ef68f1016cd6eb6f93af43ac9da23d17acad3487e6d00bf2b294f0fc2"
    ),
}


def certificate(proof, theorem, fields, kappa, within=(), omega=None, scales=()):
    """The certificate of a proof: a dict fit for JSON, `fields` with claim, theorem and seal.

    kappa : tuple of floats, of the claim; within : of how far around each, where it is a cell or a
    box of forcings. omega : RotationNumber of the barrier, None for transport. scales : from which
    to which times kappa + t·within, |t| ≤ 1, in a fan. ValueError if proof.proved is False.
    """
    if not proof.proved:
        raise ValueError(f"{proof.why}; a certificate needs proved=True")
    under, given = "the forcing", _spelled(kappa)
    if scales:
        under = f"every forcing from {scales[0]!r} to {scales[1]!r} times"
        if any(within):
            given = f"({given} + t {_spelled(within)}), -1 <= t <= 1"
    elif any(within):
        under = f"every forcing within {_spelled(within)} of"
    what = f"a rotational invariant circle of {omega} exists" if omega else "transport is global"
    about = {"name": theorem, "version": _VERSION, "sha256": _STATEMENTS[theorem]}
    return with_sha256({"claim": f"{what} under {under} {given}", "theorem": about, **fields})


def in_hex(numbers):
    """Floats as text, exactly."""
    return [number.hex() for number in numbers]


def columns_in_hex(rows):
    """The columns of a matrix of floats, each as one text: the 8 bytes of every number, the first
    being that of its sign, as 16 digits. There are a million rows in some, and so it takes little.
    """
    return [column.astype(">f8").tobytes().hex() for column in rows.T]


def _spelled(numbers):
    return f"({', '.join(map(repr, numbers))})"
