"""Invariant circles: Newton's method, the continuation to their breakup, their symmetries."""

from nasm import face

__getattr__, __dir__ = face(
    __name__,
    newton="InvariantCircle graph invariant_circle newton_step residual",
    continuation="",
    fourier="",
    parameterization="",
    symmetries="",
)
