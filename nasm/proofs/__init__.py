"""Proofs that a barrier exists or that transport is global; README.md states the theorems.

Only this package proves anything: all other results of `nasm` rest on samples or on
floating-point arithmetic.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
