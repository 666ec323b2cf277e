"""The first computations of a worker: they compile a job's kernels before any tile is computed.

Otherwise compilation would count towards the time of a tile, and workers would wait for each other.
"""

from numpy.typing import ArrayLike

from nasm import barriers, circles, periodic
from nasm.action import ordered_orbits


def load_orbits() -> None:
    """Compile the kernels for ordered orbits and their residues."""
    ordered_orbits((2.0, -2.5, 1.0), 1, 1)  # an orbit that is found only by descent
    periodic.critical_scale("gamma", (0.3, 0.1), 10)


def load_search(profile: ArrayLike) -> None:
    """Compile the kernels needed to search for the last barrier on the ray along a profile."""
    load_orbits()
    circles.invariant_circle("gamma", (0.1,))
    barriers.critical_scale(profile, 0.1)


def load_searches() -> None:
    """Compile the kernels needed to search for the last barrier, for forcings of any period."""
    for profile in (1.0,), (1.0, 0.9, 1.2):
        load_search(profile)
