"""A verdict in plain sentences."""

from math import inf, isfinite, log10

from nasm.texts import rounded_bracket
from nasm.verdicts import Answer, Evidence
from pipeline.sweep.progress import plural

SHOWN = 8  # kicks that are named one by one

_MEANINGS = {
    Answer.BARRIER: "a rotational invariant circle exists; no orbit crosses it",
    Answer.TRANSPORT: "no rotational invariant circle exists; transport in y is global",
    Answer.UNDECIDED: "neither a barrier nor transport could be shown",
}


def name_of(kappa, point):
    """Return the forcing in words, e.g. "(kappa1, kappa2) = (0.3, 0.5)".

    point : (Plane, its two coordinates), or None for a forcing that is in none.
    """
    strengths = ", ".join(map(str, kappa.tolist()))
    if kappa.size > SHOWN:
        kicks = f"kappa of {kappa.size} kicks, from {kappa.min():.6g} to {kappa.max():.6g}"
    else:
        kicks = f"kappa = {strengths}" if kappa.size == 1 else f"kappa = ({strengths})"
    if point is None:
        return kicks
    plane, (a, b) = point
    words = f"({', '.join(plane.axes)}) = ({a}, {b})"
    return f"{words}, {kicks}" if any(plane.origin) else words


def sentences(kappa, point, verdict):
    """Put the verdict into words, a list of lines."""
    boundary, omega = verdict.boundary, verdict.boundary.omega
    lines = [f"{verdict.answer.name} at {name_of(kappa, point)}: {_MEANINGS[verdict.answer]}."]
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
    if verdict.proof is not None and not verdict.proof.proved:
        lines.append(f"A proof was tried: {verdict.proof.why}.")
    if verdict.evidence is Evidence.CIRCLE_PROVED:
        words, below = "That proof says nothing of weaker kicks.", verdict.proved_below
        if below > 0:
            words = f"So it is for all kicks from 0 to {int(below * 1e4) / 1e4} times as strong."
        lines.append(words)
    if verdict.steps < inf:
        lifetime = lifetime_of(kappa, verdict.steps)
        lines.append(f"Converse KAM eliminates even the longest-lived start after {lifetime}.")
    if verdict.evidence is Evidence.INTEGRABLE:
        return lines
    # Where the last circle breaks on the ray, in multiples of the strengths asked about.
    if isfinite(boundary.value):
        lines.append(
            f"The last circle breaks at {scale_of(boundary)} ± {boundary.error:.1g} times these "
            f"strengths, by {boundary.method} (a criterion, not a proof)."
        )
    else:
        lines.append(
            f"Where the last circle breaks on the ray is not known: {boundary.status.value}."
        )
    lower, upper = bracket_of(boundary)
    if lower:
        lines.append(f"A circle is certified at {lower} times these strengths.")
    if upper:
        lines.append(f"At {upper} times these strengths converse KAM excludes all circles.")
    return lines


def spelt_out(omega):
    """Return an irrational number as a continued fraction without parentheses: [0;2,1,1,1,…]."""
    first, *rest = omega.prefix + omega.tail * max(2, 4 - len(omega.tail))
    return f"[{first};{','.join(map(str, rest))},…]"


def steps_of(kappa, steps):
    """Return a number of periods of the forcing in words, "35 steps of 2 kicks", or "35 kicks"."""
    if kappa.size == 1:
        return plural(steps, "kick", ".0f")
    return f"{plural(steps, 'step', '.0f')} of {kappa.size} kicks"


def lifetime_of(kappa, steps):
    """Return how long a start lives, in kicks, as it may end within a step: "1 kick"."""
    return plural(round(steps * kappa.size), "kick")


def scale_of(boundary):
    """Return the scale at which the last circle breaks, with the digits that its error leaves."""
    digits = 2 + int(min(10, max(0, log10(boundary.value / max(boundary.error, 1e-300)))))
    return f"{boundary.value:.{digits}g}"


def bracket_of(boundary):
    """Return the ends of the bracket as texts, "" for an end that is not known."""
    return rounded_bracket(boundary.lower, boundary.upper)
