"""Proved lower and upper bounds on the boundary along a ray κ = s·profile.

`nasm.proofs.barrier` proves the lower bound: a barrier exists at one scale. `nasm.proofs.patches`
proves that one exists at every scale from 0 up to a slightly smaller scale. The upper bound is
proved by `nasm.proofs.transport`. `nasm.barriers` only chooses the scales for the proofs.
"""

import time
from dataclasses import dataclass, field
from math import nan

from numpy.typing import ArrayLike

from nasm import barriers
from nasm.checks import positive
from nasm.maps import direction
from nasm.proofs.barrier import BarrierProof, proved_lower
from nasm.proofs.patches import proved_below
from nasm.proofs.transport import TransportProof, proved_upper
from nasm.results import CriticalScale, Result
from nasm.tables import html_table
from nasm.texts import rounded_bracket

__all__ = ["ProvedBracket", "critical_scale"]


@dataclass(frozen=True, eq=False, repr=False)
class ProvedBracket(Result):
    """Proved bounds on the scale at which the last barrier breaks on a ray.

    Between `lower` and `upper` nothing is proved.

    Attributes
    ----------
    estimate : CriticalScale
        Result of `barriers.critical_scale`, which proves nothing.
    lower : float
        A barrier is proved to exist at lower·profile, rounded to floats; NaN if not proved.
    upper : float
        Transport is proved to be global at upper·profile, rounded to floats; NaN if not proved.
    barrier : BarrierProof or None
        Proof at `lower`, or the last failed attempt; None if no proof was attempted.
    transport : TransportProof or None
        Proof at `upper`, or the last failed attempt; None if no proof was attempted.
    below : float
        A barrier is proved to exist at s·profile for all 0 ≤ s ≤ below; NaN if not attempted.
    below_proofs : list of BarrierProof
        Proofs for intervals of s that together cover 0 ≤ s ≤ below.

    Examples
    --------
    >>> from nasm.proofs import critical_scale
    >>> critical_scale((1.0,), seconds=0.2)
    <ProvedBracket: a barrier exists at 0.9..., transport is global at ...; a barrier exists at all
    scales up to 0...>
    """

    estimate: CriticalScale
    lower: float = nan
    upper: float = nan
    barrier: BarrierProof | None = None
    transport: TransportProof | None = None
    below: float = nan
    below_proofs: list[BarrierProof] = field(default_factory=list)

    def __repr__(self) -> str:
        rows = self._rows()
        both = ", ".join(filter(None, (rows["lower bound"], rows["upper bound"])))
        parts = filter(None, (both, rows["at all scales"]))
        return f"<ProvedBracket: {'; '.join(parts) or 'nothing is proved'}>"

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        return html_table(
            {"estimate, not proved": repr(self.estimate)} | self._rows(), "Proved bounds on a ray"
        )

    def _rows(self) -> dict[str, str]:
        lower, upper = rounded_bracket(self.lower, self.upper)
        below, _ = rounded_bracket(self.below, nan)
        return {
            "lower bound": f"a barrier exists at {lower}" if lower else "",
            "upper bound": f"transport is global at {upper}" if upper else "",
            "at all scales": (
                f"a barrier exists at all scales up to {below}" if self.below > 0 else ""
            ),
        }


def critical_scale(profile: ArrayLike, seconds: float = 8.0) -> ProvedBracket:
    """Compute proved bounds on the scale at which the last barrier breaks.

    Parameters
    ----------
    profile : array_like, shape (P,)
        Direction of the ray, not zero.
    seconds : float
        CPU time for `below`; the two bounds together may take twice as much. The upper bound uses
        only seconds/2, but is ten times tighter than the lower one. The width of the bracket
        depends on the time and on the machine, but its bounds are proved regardless.

    Returns
    -------
    ProvedBracket

    Raises
    ------
    ImportError
        If python-flint is not installed.
    ValueError
        If profile is zero, not finite or too large, or seconds is not positive.

    Examples
    --------
    >>> from nasm.proofs import critical_scale
    >>> bracket = critical_scale((1.0,), seconds=0.5)
    >>> bracket.lower < bracket.estimate.value < bracket.upper
    True
    """
    profile = direction(profile)
    seconds = positive("seconds", seconds, "CPU time for each proof")
    estimate = barriers.critical_scale(profile)
    if not estimate.value > 0 or estimate.omega is None:
        return ProvedBracket(estimate)
    start = time.thread_time()
    upper, transport = proved_upper(profile, estimate.value, seconds / 2)
    remaining = 2 * seconds - (time.thread_time() - start)
    lower, barrier = proved_lower(estimate.omega, profile, estimate.value, max(remaining, seconds))
    below, proofs = proved_below(estimate.omega, profile, estimate.value, seconds)
    return ProvedBracket(estimate, lower, upper, barrier, transport, below, proofs)
