"""The first computations of a worker: they compile a job's kernels before any tile is computed.

Otherwise compilation would count towards the time of a tile, and workers would wait for each other.
"""

from collections.abc import Callable
from functools import partial
from zlib import crc32

from numpy.typing import ArrayLike

from nasm import barriers, circles, periodic
from nasm.action import ordered_orbits


def in_own_order(*loads: Callable[[], object]) -> None:
    """Call all functions, each worker beginning with another one.

    Workers that need the same kernel wait until one of them has compiled it. Those that begin with
    different functions compile at the same time.
    """
    from distributed import get_worker

    try:
        name = get_worker().name
    except ValueError:  # this process is not a worker
        name = 0
    first = (name if isinstance(name, int) else crc32(str(name).encode())) % len(loads)
    for load in (*loads[first:], *loads[:first]):
        load()


def load_orbits() -> None:
    """Compile the kernels for ordered orbits and their residues."""
    ordered_orbits((2.0, -2.5, 1.0), 1, 1)  # an orbit that is found only by descent
    periodic.critical_scale("gamma", (0.3, 0.1), 10)


def load_search(profile: ArrayLike) -> None:
    """Compile the kernels needed to search for the last barrier on the ray along a profile."""
    in_own_order(
        load_orbits,
        partial(circles.invariant_circle, "gamma", (0.1,)),
        partial(barriers.critical_scale, profile, 0.1),
    )


def load_searches() -> None:
    """Compile the kernels needed to search for the last barrier, for forcings of any period."""
    for profile in (1.0,), (1.0, 0.9, 1.2):
        load_search(profile)
