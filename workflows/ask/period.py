"""One period of kicks: the verdict in words, and its figure. For `workflows.ask`."""

from functools import partial

import numpy as np

from nasm import barriers, escape, orbits
from nasm.verdicts import Answer, verdict
from workflows.shared.phase_space import portrait
from workflows.shared.verdict_words import lifetime_of, name_of, sentences, steps_of

_STARTS, _STEPS = 64, 10**6  # of direct iteration; it only illustrates
_POINTS = 2**20  # of orbits among which one is looked for that escapes
_NEAR = 0.96  # where the boundary is nearer, no orbit escapes: none did on 12 rays, 4% beyond
_TRACED = 5000  # steps of the longest-lived start that are drawn, at most


def escaping_orbit(kappa):
    """Return x, y of an orbit up to its escape from the paper's window, or None.

    The starts that escape first in one arithmetic are followed in another: chaos lets few of them
    do so at the same step, but of many some do soon.
    """
    x, y = escape.ensemble(_STARTS)
    times = escape.escape_time(kappa, x, y, _STEPS)
    lo, hi = escape.PAPER_WINDOW
    n = 4 * times.min()
    if not np.isfinite(n):
        return None
    starts = np.argsort(times, kind="stable")[: max(4, int(_POINTS / n))]
    orbit = orbits.orbit(kappa, x[starts], y[starts], int(min(n, _STEPS)))
    escapes = np.argwhere((orbit[1] < lo) | (orbit[1] > hi))  # by steps
    if not escapes.size:
        return None
    steps, first = escapes[0]
    return tuple(values[: steps + 1, first] for values in orbit)


def drawn(kappa, point, verdict, escaping):
    """Draw the portrait of the forcing; if transport is global, with the longest-lived start."""
    from workflows.figures.ask import draw_verdict  # loading it takes as long as the verdict

    longest, name = None, name_of(kappa, point)
    if verdict.answer is Answer.TRANSPORT:
        x, y, steps = barriers.longest_lived_start(
            kappa, int(min(max(1000, 2 * verdict.steps), _STEPS))
        )
        lifetime = lifetime_of(kappa, steps)
        longest = (lifetime, *orbits.orbit(kappa, x, y, int(min(steps, _TRACED))))
    return draw_verdict(kappa, point, name, verdict, portrait(kappa), longest, escaping)


def asked_of_period(strengths, point, prove):
    """Return the verdict on one period of kicks in words, and a function that draws its figure.

    point : (Plane, its two coordinates), or None. prove : bool. ValueError if the period is long.
    """
    found = verdict(strengths, prove)
    transport = found.answer is Answer.TRANSPORT
    far = not found.boundary.value > _NEAR  # NaN: not known to be near
    escaping = escaping_orbit(strengths) if transport and far else None
    text = sentences(strengths, point, found)
    if escaping is not None:
        (x, *_), (y, *_, last) = escaping
        text.append(
            f"Direct iteration: the orbit from (x, y) = ({x:.6g}, {y:.6g}) arrives at "
            f"y = {last:.3g} after {steps_of(strengths, escaping[0].size - 1)}."
        )
    elif transport and far:
        text.append("Direct iteration: no orbit was found that escapes; this shows nothing.")
    elif transport:
        text.append("Direct iteration is too slow this near the boundary to show anything.")
    return "\n".join(text), partial(drawn, strengths, point, found, escaping)
