"""A verdict in plain sentences."""

from math import isfinite, log10

from nasm.verdict import Answer, Evidence
from pipeline.sweep.progress import plural

SHOWN = 8  # kicks that are named one by one


def name_of(kappa, point):
    """Return the forcing in words, e.g. "(kappa1, kappa2) = (0.3, 0.5)".

    point : (Plane, its two coordinates), or None for a forcing that is in none.
    """
    kicks = f"kappa of {kappa.size} kicks, from {kappa.min():.6g} to {kappa.max():.6g}"
    if kappa.size <= SHOWN:
        kicks = f"kappa = ({', '.join(map(str, kappa.tolist()))})"
    if point is None:
        return kicks
    plane, (a, b) = point
    words = f"({', '.join(plane.axes)}) = ({a}, {b})"
    return f"{words}, {kicks}" if any(plane.origin) else words


def sentences(kappa, point, verdict):
    """Put the verdict into words, a list of lines."""
    boundary, omega = verdict.boundary, verdict.boundary.omega
    meaning, circle = {
        Answer.BARRIER: (
            "a rotational invariant circle is left; no orbit gets past it",
            "The circle",
        ),
        Answer.TRANSPORT: (
            "no rotational invariant circle is left; transport in y is global",
            "The last circle to break on the ray was that",
        ),
        Answer.UNDECIDED: (
            "neither a barrier nor transport could be shown",
            "The last circle to break on the ray is that",
        ),
    }[verdict.answer]
    lines = [f"{verdict.answer.name} at {name_of(kappa, point)}: {meaning}."]
    if omega is not None:
        number = f"omega = {omega} = {float(omega):.12g} per step"
        lines.append(f"{circle} of {number} (and of all ±omega + {kappa.size}n).")
    lines.append(f"Evidence: {verdict.evidence.value}.")
    if verdict.proof is not None and not verdict.proof.proved:
        lines.append(f"A proof was tried: {verdict.proof.why}.")
    if verdict.evidence is Evidence.CIRCLE_PROVED:
        words, below = "That proof says nothing of weaker kicks.", verdict.proved_below
        if below > 0:
            words = f"So it is for all kicks from 0 to {int(below * 1e4) / 1e4} times as strong."
        lines.append(words)
    if verdict.steps < float("inf"):
        steps = plural(verdict.steps, "step", "g")
        lines.append(f"The longest-lived start is eliminated after {steps}.")
    if verdict.evidence is Evidence.INTEGRABLE:
        return lines
    # Where the last circle breaks on the ray, in multiples of the strengths asked about.
    if isfinite(boundary.value):
        lines.append(
            f"It breaks at {scale_of(boundary)} times these strengths, "
            f"±{boundary.error:.1g}, by {boundary.method} (a criterion, not a proof)."
        )
    else:
        lines.append(f"Where the last one breaks on the ray is not known: {boundary.status.value}.")
    if isfinite(boundary.lower):
        lines.append(f"A circle is certified at {boundary.lower:.9g} times these strengths.")
    if isfinite(boundary.upper):
        words = f"At {boundary.upper:.9g} times these strengths converse KAM finds no circle at all"
        lines.append(f"{words}.")
    return lines


def scale_of(boundary):
    """Return the scale at which the last circle breaks, with the digits that its error leaves."""
    digits = 2 + int(min(10, max(0, log10(boundary.value / max(boundary.error, 1e-300)))))
    return f"{boundary.value:.{digits}g}"
