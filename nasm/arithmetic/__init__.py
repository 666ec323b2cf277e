"""What the kernels are made of: their cache on disk, vectors, the sine, double-double numbers."""

from nasm import face

__getattr__, __dir__ = face(
    __name__,
    kernels="kernel",
    lanes="",
    sine="",
    double_double="",
    memory="keep_freed_memory",
    roots="root",
    reproducible="",
)
