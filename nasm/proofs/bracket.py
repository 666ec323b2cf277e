"""Both sides of the boundary on a ray κ = s·profile, proved; between the two scales nothing is.

The lower side is by the theorem of `nasm.proofs.barrier`, at one scale, and by `nasm.proofs.fan` at
every scale from 0 on, less far; the upper side is by the theorem of `nasm.proofs.transport`. What
`nasm.barriers` finds tells only where to look.
"""

import time
from dataclasses import dataclass, field
from math import nan

from nasm import barriers
from nasm.checks import positive
from nasm.critical import CriticalScale, Result
from nasm.maps import direction
from nasm.proofs.barrier import BarrierProof, proved_lower
from nasm.proofs.fan import proved_below
from nasm.proofs.transport import TransportProof, proved_upper

__all__ = ["ProvedBracket", "critical_scale"]


@dataclass(frozen=True, eq=False)
class ProvedBracket(Result):
    """What is proved of a ray, and where it was looked for.

    found : CriticalScale by `barriers.critical_scale`, which is no proof.
    lower, upper : a barrier is proved to exist at lower·profile, transport to be global at
        upper·profile, as these are rounded to floats; NaN where nothing was proved.
    barrier, transport : BarrierProof and TransportProof of that, with their certificates, or the
        last that failed; None where nothing was tried.
    below : a barrier is proved to exist at s·profile for 0 ≤ s ≤ below; NaN where not tried.
    rays : the BarrierProofs of that, of fans.
    """

    found: CriticalScale
    lower: float = nan
    upper: float = nan
    barrier: BarrierProof | None = None
    transport: TransportProof | None = None
    below: float = nan
    rays: list[BarrierProof] = field(default_factory=list, repr=False)


def critical_scale(profile, seconds=8.0):
    """The scale at which the last barrier breaks, between two scales that are proved.

    Parameters
    ----------
    profile : sequence of P floats, not all 0.
    seconds : float > 0, CPU time for the weaker kicks, and on average for each of the two sides:
        the upper one has half of it and still comes ten times as near. How near they come to the
        breakup depends on it and on the machine; what they say does not.

    Returns
    -------
    ProvedBracket. ImportError without python-flint; ValueError as `barriers.critical_scale` raises,
    or if seconds is not positive.
    """
    profile = direction(profile)
    seconds = positive("seconds", seconds, "CPU time for each proof")
    found = barriers.critical_scale(profile)
    if not found.value > 0:
        return ProvedBracket(found)
    start = time.thread_time()
    upper, transport = proved_upper(profile, found.value, seconds / 2)
    left = 2 * seconds - (time.thread_time() - start)
    lower, barrier = proved_lower(found.omega, profile, found.value, max(left, seconds))
    below, rays = proved_below(found.omega, profile, found.value, seconds)
    return ProvedBracket(found, lower, upper, barrier, transport, below, rays)
