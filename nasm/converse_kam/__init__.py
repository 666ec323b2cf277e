"""Converse KAM: criteria that exclude invariant circles through an orbit.

`symmetry_line` takes its starts from the dominant symmetry line; `transversal` takes them from a
curve that every circle crosses, for forcings without such a line; `aperiodic` is for aperiodic
forcing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
