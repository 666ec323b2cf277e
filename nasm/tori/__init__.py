"""Invariant tori under kicks of two frequencies: Newton's method, and a bracket of the last one."""

from nasm import face

__getattr__, __dir__ = face(
    __name__,
    newton="InvariantTorus critical_scale graph invariant_torus residual",
    last_torus="of_irrational upper_scale",
)
