"""Converse KAM: criteria that exclude invariant circles through an orbit.

`symmetry_line` tests orbits that start on the dominant symmetry line. For forcings without such a
line, `transversal` tests orbits that start on a curve crossed by every circle. `aperiodic` treats
aperiodic forcing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
