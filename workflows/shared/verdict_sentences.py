"""Express a verdict in sentences."""

from math import inf, isfinite, log10
from typing import Any

from nasm import escape
from nasm.numbers import RotationNumber
from nasm.planes import Plane
from nasm.results import CriticalScale
from nasm.texts import rounded_bracket
from nasm.types import FloatArray
from nasm.verdicts import Answer, Evidence, Verdict
from pipeline.sweep.progress import plural

MAX_LISTED = 8
"""Maximum number of kicks for which a forcing is written out."""

Point = tuple[Plane, tuple[float, float]] | None
"""A plane and the two coordinates of a forcing in it; None if the forcing is given by its kicks."""

_MEANINGS = {
    Answer.BARRIER: "a rotational invariant circle exists; no orbit crosses it",
    Answer.TRANSPORT: "no rotational invariant circle exists; transport in y is global",
    Answer.UNDECIDED: "neither a barrier nor transport could be shown",
}


def forcing_text(kappa: FloatArray, point: Point) -> str:
    """Return the forcing as text, e.g. "(kappa1, kappa2) = (0.3, 0.5)"."""
    strengths = ", ".join(map(str, kappa.tolist()))
    if kappa.size > MAX_LISTED:
        kicks = f"kappa of {kappa.size} kicks, from {kappa.min():.6g} to {kappa.max():.6g}"
    else:
        kicks = f"kappa = {strengths}" if kappa.size == 1 else f"kappa = ({strengths})"
    if point is None:
        return kicks
    plane, (a, b) = point
    coordinates = f"({', '.join(plane.axes)}) = ({a}, {b})"
    return f"{coordinates}, {kicks}" if any(plane.origin) else coordinates


def sentences(kappa: FloatArray, point: Point, verdict: Verdict) -> list[str]:
    """Return the verdict on a forcing as a list of sentences."""
    boundary, omega = verdict.boundary, verdict.boundary.omega
    lines = [f"{verdict.answer.name} at {forcing_text(kappa, point)}: {_MEANINGS[verdict.answer]}."]
    if omega is not None:
        barrier = verdict.answer is Answer.BARRIER
        circle = "Barrier" if barrier else "Last circle to break on the ray through this forcing"
        unit = "kick" if kappa.size == 1 else f"step of {kappa.size} kicks"
        shift = "n" if kappa.size == 1 else f"{kappa.size}n"
        lines.append(
            f"{circle}: the invariant circle with rotation number ω = {omega} = "
            f"{spelt_out(omega)} = {float(omega):.12g} per {unit}, and its images ±ω + {shift} by "
            "symmetry."
        )
    lines.append(f"Evidence: {verdict.evidence.value}.")
    proof: Any = verdict.proof
    if proof is not None and not proof.proved:
        lines.append(f"A proof was attempted: {proof.reason}.")
    if verdict.evidence is Evidence.CIRCLE_PROVED:
        below = verdict.proved_below
        lines.append(
            "A barrier is also proved to exist for all weaker kicks, from 0 to "
            f"{int(below * 1e4) / 1e4} times these strengths."
            if below > 0
            else "This proof says nothing about weaker kicks."
        )
    if verdict.steps < inf:
        lifetime = lifetime_text(kappa, verdict.steps)
        lines.append(f"Converse KAM eliminates even the longest-lived start after {lifetime}.")
    if verdict.evidence is Evidence.INTEGRABLE:
        return lines
    # Report where the last circle on the ray breaks, in multiples of these strengths.
    if isfinite(boundary.value):
        lines.append(
            f"The last circle breaks at {scale_text(boundary)} ± {boundary.error:.1g} times these "
            f"strengths, by {boundary.method} (a criterion, not a proof)."
        )
    else:
        lines.append(
            "The scale at which the last circle on this ray breaks is not known: "
            f"{boundary.status.value}."
        )
    lower, upper = bracket_of(boundary)
    if lower:
        lines.append(f"A circle is certified at {lower} times these strengths.")
    if upper:
        is_escape = boundary.method == escape.METHOD
        shown = "an orbit escapes" if is_escape else "converse KAM excludes all circles"
        lines.append(f"At {upper} times these strengths {shown}.")
    return lines


def spelt_out(omega: RotationNumber) -> str:
    """Return an irrational number as a continued fraction without parentheses: [0;2,1,1,1,…]."""
    first, *rest = omega.prefix + omega.tail * max(2, 4 - len(omega.tail))
    return f"[{first};{','.join(map(str, rest))},…]"


def steps_text(kappa: FloatArray, steps: float) -> str:
    """Return a number of periods as text, e.g. "35 steps of 2 kicks", or "35 kicks" if P = 1."""
    if kappa.size == 1:
        return plural(steps, "kick", ".0f")
    return f"{plural(steps, 'step', '.0f')} of {kappa.size} kicks"


def lifetime_text(kappa: FloatArray, steps: float) -> str:
    """Return a lifetime as text in kicks, e.g. "1 kick", because it may be shorter than a step."""
    return plural(round(steps * kappa.size), "kick")


def scale_text(boundary: CriticalScale) -> str:
    """Return the scale at which the last circle breaks, to as many digits as its error allows."""
    digits = 2 + int(min(10, max(0, log10(boundary.value / max(boundary.error, 1e-300)))))
    return f"{boundary.value:.{digits}g}"


def bracket_of(boundary: CriticalScale) -> tuple[str, str]:
    """Return the ends of the bracket as strings; "" for an unknown end."""
    lower, upper = rounded_bracket(boundary.lower, boundary.upper)
    return lower, upper
