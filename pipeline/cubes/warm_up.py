"""What a worker computes first, so that the kernels of a job are compiled before any tile.

A tile that had to compile a kernel would be charged for it, and workers would wait for each other.
"""

from numpy.typing import ArrayLike

from nasm import barriers, circles, periodic
from nasm.action import ordered_orbits


def load_orbits() -> None:
    """Compile the kernels of ordered orbits and their residues."""
    ordered_orbits((2.0, -2.5, 1.0), 1, 1)  # the last of its methods finds these
    periodic.critical_scale("gamma", (0.3, 0.1), 10)


def load_search(profile: ArrayLike) -> None:
    """Compile the kernels of a search for the last barrier on the ray of a profile."""
    load_orbits()
    circles.invariant_circle("gamma", (0.1,))
    barriers.critical_scale(profile, 0.1)


def load_searches() -> None:
    """Compile the kernels of searches under forcings of any period."""
    for profile in (1.0,), (1.0, 0.9, 1.2):
        load_search(profile)
