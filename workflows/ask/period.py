"""The verdict on one period of kicks, as text and as a figure, for `workflows.ask`."""

from functools import partial

import numpy as np

from nasm import escape, orbits, survivors
from nasm.results import Status
from nasm.verdicts import Answer, verdict
from workflows.shared.phase_space import portrait
from workflows.shared.verdict_sentences import forcing_text, lifetime_text, sentences, steps_text

_STARTS, _STEPS = 64, 10**6  # for direct iteration, which only illustrates the verdict
_POINTS = 2**20  # total length of the orbits searched for an escape
# No escape is sought if the boundary is above this multiple of the strengths: on 12 rays, no orbit
# was found to escape 4% beyond the boundary.
_NEAR = 0.96
_TRACED = 5000  # maximum number of steps drawn from the longest-lived start


def escaping_orbit(kappa):
    """Return x, y of an orbit up to its escape from the paper's window; None if no orbit escapes.

    The orbits that escape first are iterated again by `orbits.orbit`, whose rounding differs.
    Because they are chaotic, few of them escape at the same step as before; but among many orbits,
    some still escape early.
    """
    x, y = escape.ensemble(_STARTS)
    times = escape.escape_time(kappa, x, y, _STEPS)
    lo, hi = escape.PAPER_WINDOW
    n = 4 * times.min()
    if not np.isfinite(n):
        return None
    starts = np.argsort(times, kind="stable")[: max(4, int(_POINTS / n))]
    orbit = orbits.orbit(kappa, x[starts], y[starts], int(min(n, _STEPS)))
    escapes = np.argwhere((orbit[1] < lo) | (orbit[1] > hi))  # in order of steps
    if not escapes.size:
        return None
    steps, first = escapes[0]
    return tuple(values[: steps + 1, first] for values in orbit)


def drawn(kappa, point, verdict, escaping):
    """Draw the portrait of the forcing, with the longest-lived start if transport is global."""
    from workflows.figures.ask import (
        draw_verdict,
    )  # imported late, as the import takes as long as the verdict

    longest, name = None, forcing_text(kappa, point)
    is_long = verdict.boundary.status is Status.TOO_LONG  # then no minimax orbits are known
    if verdict.answer is Answer.TRANSPORT and not is_long:
        n_max = int(min(max(1000, 2 * verdict.steps), _STEPS))
        x, y, steps = survivors.longest_lived_start(kappa, n_max)
        lifetime = lifetime_text(kappa, steps)
        longest = (lifetime, *orbits.orbit(kappa, x, y, int(min(steps, _TRACED))))
    return draw_verdict(kappa, point, name, verdict, portrait(kappa), longest, escaping)


def answer_periodic(strengths, point, prove):
    """Return the verdict on one period of kicks as text, and a function that draws its figure.

    point : (Plane, its two coordinates), or None. prove : bool. Raises ValueError if a strength is
    not finite or too large.
    """
    result = verdict(strengths, prove)
    transport = result.answer is Answer.TRANSPORT
    far = not result.boundary.value > _NEAR  # NaN counts as far
    escaping = escaping_orbit(strengths) if transport and far else None
    text = sentences(strengths, point, result)
    if escaping is not None:
        (x, *_), (y, *_, last) = escaping
        text.append(
            f"Direct iteration: the orbit from (x, y) = ({x:.6g}, {y:.6g}) reaches "
            f"y = {last:.3g} after {steps_text(strengths, escaping[0].size - 1)}."
        )
    elif transport and far:
        text.append("Direct iteration: no escaping orbit was found, which proves nothing.")
    elif transport:
        text.append(
            "Direct iteration: this close to the boundary, escapes take too long to be observed."
        )
    return "\n".join(text), partial(drawn, strengths, point, result, escaping)
