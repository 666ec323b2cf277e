"""Invariant tori of the rotating standard map: Newton's method, and a bracket on the last torus."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
