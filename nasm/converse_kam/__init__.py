"""Converse KAM: orbits through which no circle passes.

`symmetry_line` takes its starts from the dominant symmetry line, `transversal` from a curve that
every circle crosses, for forcings without such a line; `sequence` is for kicks that do not recur.
"""

from nasm import face

__getattr__, __dir__ = face(__name__, symmetry_line="", transversal="", sequence="")
