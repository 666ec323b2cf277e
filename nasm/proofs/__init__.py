"""Proofs that a barrier exists or that transport is global; README.md has their theorems.

Only this package proves. What the rest of `nasm` says rests on samples or on floating point.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
