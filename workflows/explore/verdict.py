"""The verdict as sentences, and the view as a Python program."""

import time
from html import escape

from bokeh.models import Button, CustomJS, Div

from workflows.explore.on_workers import timed_verdict
from workflows.explore.work import spread
from workflows.shared.verdict_sentences import sentences

_START_DELAY = 0.05  # seconds to wait for a newer point while the point is dragged


def describe(message, state, work):
    """Describe the verdict on the state's point in a message, and keep the message up to date."""
    message.min_height = 103  # pixels, enough for the longest verdict in two columns
    lane = work.latest("verdict")

    def compute():
        point = state.plane, state.point
        message.text = _html(["computing the verdict …"])
        state.take(verdict=None)
        client, kappa = work.client, state.kappa
        lane.submit(_verdict_and_seconds, client, kappa, done=lambda result: show(point, *result))

    def show(point, verdict, seconds):
        lines = sentences(state.kappa, point, verdict)
        message.text = _html([*lines, f"This took {seconds:.2f} s."])
        state.take(verdict=verdict)

    state.on("point", compute)
    compute()


def copy_button(state):
    """Return the button that copies the view as Python, and the hidden text that it copies."""
    code, copy = Div(visible=False), Button(label="copy as Python")
    args = {"code": code, "copy": copy}
    copy.js_on_event("button_click", CustomJS(args=args, code="copyText(code.text, copy)"))
    state.on("point steps", lambda: code.update(text=_python(state)))
    code.text = _python(state)
    return copy, code


def _verdict_and_seconds(client, kappa):
    """Return the verdict and its computing time; wait first, as workers cannot be interrupted."""
    time.sleep(_START_DELAY)
    results = spread(client(), [(None, timed_verdict, kappa)], priority=1)
    return next(result[1] for result in results if result)


def _html(lines):
    """Return the lines as HTML that screen readers read aloud, with the first line in bold."""
    first, *rest = map(escape, lines)
    rest = f'<div style="columns: 2 27em">{"<br>".join(rest)}</div>'
    return f'<div role="status" aria-live="polite"><b>{first}</b>{rest}</div>'


def _python(state):
    """Return a Python program that computes the verdict and the portrait of the forcing."""
    return f"""\
from nasm import escape, orbits
from nasm.verdicts import verdict

kappa = {state.kappa.tolist()}  # one period, first kick first
result = verdict(kappa)
print(result.answer, result.evidence.value, result.boundary, sep="\\n")
times = escape.escape_time(kappa, *escape.ensemble(64), n_max={state.steps})
print(f"the first of {{times.size}} orbits escapes after {{times.min()}} steps")
x, y = orbits.portrait(kappa)
omega, digits = orbits.rotation_number(kappa, x[0], y[0], 2000)
"""
