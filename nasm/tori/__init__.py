"""Invariant tori of the rotating standard map: Newton's method, and where the last torus breaks."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
