"""Proofs that a barrier exists or that transport is global; README.md has their theorems.

Only this package proves. What the rest of `nasm` says rests on samples or on floating point.
"""

from nasm import face

__getattr__, __dir__ = face(
    __name__,
    bracket="ProvedBracket critical_scale",
    cells="proved_cells triangles",
    fan="covered proved_below",
    barrier="BarrierProof need_flint proved_lower",
    transport="TransportProof proved_upper",
    transport_cells="CellProof",
    certificates="certificate",
    certificate_checker="",
)
