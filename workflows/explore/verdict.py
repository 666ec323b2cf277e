"""The verdict in words, and the view as Python."""

import time
from collections import deque
from html import escape

from bokeh.models import Button, CustomJS, Div

from nasm.verdicts import verdict
from workflows.explore.work import spread
from workflows.shared.verdict_words import sentences

_REST = 0.05  # seconds that the point has to rest, while it is dragged


def tell(message, state, work):
    """Say the verdict in words."""
    message.min_height = 103  # the most it takes beside each other
    lane = work.latest("verdict")

    def ask():
        point = state.plane, state.point
        message.text = _html(["computing the verdict …"])
        state.take(verdict=None)
        lane.submit(_judged, work.client, state.kappa, done=lambda found: show(point, *found))

    def show(point, found, seconds):
        words = sentences(state.kappa, point, found)
        message.text = _html([*words, f"This took {seconds:.2f} s."])
        state.take(verdict=found)

    state.on("point", ask)
    ask()


def copied(state):
    """Return the button that copies the view as Python."""
    code, copy = Div(visible=False), Button(label="copy as Python")
    args = {"code": code, "copy": copy}
    copy.js_on_event("button_click", CustomJS(args=args, code="copyText(code.text, copy)"))
    state.on("point steps", lambda: code.update(text=_python(state)))
    code.text = _python(state)
    return copy, code


def _judged(client, kappa):
    """Return the verdict and its seconds. One in vain is enough: a worker does not stop."""
    time.sleep(_REST)
    found = spread(client(), deque([(None, _timed, kappa)]), priority=1)
    return next(ended[1] for ended in found if ended)


def _timed(kappa):
    begin = time.perf_counter()
    return verdict(kappa), time.perf_counter() - begin


def _html(lines):
    """Return the lines as HTML that screen readers speak, the first one stronger."""
    first, *rest = map(escape, lines)
    rest = f'<div style="columns: 2 27em">{"<br>".join(rest)}</div>'
    return f'<div role="status" aria-live="polite"><b>{first}</b>{rest}</div>'


def _python(state):
    """Return the forcing, its verdict and its portrait as a program."""
    return f"""\
from nasm import escape, orbits
from nasm.verdicts import verdict

kappa = {state.kappa.tolist()}  # one period of kicks, the first one first
found = verdict(kappa)
print(found.answer, found.evidence.value, found.boundary, sep="\\n")
times = escape.escape_time(kappa, *escape.ensemble(64), n_max={state.steps})
print(f"the first of {{times.size}} orbits escapes after {{times.min()}} steps")
x, y = orbits.portrait(kappa)
omega, digits = orbits.rotation_number(kappa, x[0], y[0], 2000)
"""
