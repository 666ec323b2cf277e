"""The page: a document for each tab, with its own state and its own computations."""

from functools import partial
from html import escape
from pathlib import Path

from bokeh.core.property.validation import without_property_validation
from bokeh.events import DocumentReady
from bokeh.models import Button, CategoricalSlider, Column, CustomJS, Div, Row, TextInput
from jinja2 import Template

from nasm.texts import parse_float
from workflows.explore import files, play, verdict
from workflows.explore.plane import PlanePanel
from workflows.explore.portrait import PortraitPanel
from workflows.explore.state import QUERY, STEPS, State
from workflows.explore.widgets import THEME, alert, field
from workflows.explore.work import Work
from workflows.figures.planes import symbols

_TEMPLATE = Template((Path(__file__).parent / "page.html").read_text("utf-8"))


@without_property_validation  # the validation would take a fifth of the time
def fill(document, shared):
    """Make a page that computes nothing until the browser has connected."""
    document.title = f"{shared.plane.name}: explorer of the nonautonomous standard map"
    document.template, document.theme = _TEMPLATE, THEME
    document.js_on_event(DocumentReady, CustomJS(code="dress()"))
    work = Work(document, shared.client, shared.loaded)
    document.session_context.begin = partial(document.add_next_tick_callback, work.start)
    document.on_session_destroyed(lambda _: work.close())
    query = document.session_context.request.arguments  # bytes, perhaps not valid UTF-8
    state, problem = State(shared.plane), ""
    try:
        state.go({name: query[name][0].decode(errors="replace") for name in QUERY if name in query})
    except ValueError as error:
        problem = f"the address of this page is not valid: {error}"
    status, message = Div(), Div()
    _show_status(status, document, work, shared)
    plane, portrait = PlanePanel(state, work, shared), PortraitPanel(state, work)
    verdict.describe(message, state, work)
    roots = {
        "controls": Row(*_controls(state, problem)),
        "plane": Column(*plane.picture),
        "lines": Column(*plane.lines, play.panel(state, work)),
        "portrait": Column(*portrait.children),
        "save": Row(*verdict.copy_button(state), *files.panel(state, work)),
        "status": status,
        "verdict": message,
    }
    with document.models.freeze():  # otherwise all models would be counted again after each root
        for name, root in roots.items():
            root.update(name=name, sizing_mode="stretch_width")
            document.add_root(root)


def _controls(state, problem):
    """Return the fields for the exact point, a button, the slider for N, a link and a message.

    The fields show ten digits; the point keeps all of its digits until another point is typed.
    """
    shown = list(state.point)
    names = symbols(state.plane.axes, plain=True)
    fields = [TextInput(title=title, width=150) for title in names]
    for i, model in enumerate(fields):
        model.update(value=_rounded(shown[i]), name=f"coordinate {i}")

    def typed(i, text):
        if text == _rounded(shown[i]):
            return
        before, shown[i] = shown[i], parse_float(text)
        try:
            state.move(*(shown[i] if i == j else value for j, value in enumerate(state.point)))
        except ValueError:
            shown[i] = before
            raise

    def moved():
        for i, model in enumerate(fields):
            if shown[i] != state.point[i]:  # otherwise keep what was typed, valid or not
                shown[i] = state.point[i]
                model.value = _rounded(shown[i])

    counts = [str(n) for n in sorted({*STEPS, state.steps})]
    title = "N, steps allowed for an escape"
    slider = CategoricalSlider(title=title, categories=counts, value=str(state.steps), width=240)
    leap = Button(label="to the boundary on this ray", disabled=True)
    leap.on_click(lambda: state.boundary and state.move(*state.boundary))
    state.on("verdict", lambda: leap.update(disabled=state.boundary is None))
    slider.on_change("value", lambda attr, old, new: state.take(steps=int(new)))
    link, message = Div(width=120), Div()
    link.js_on_change("text", CustomJS(code="showAddress(cb_obj.text)"))

    def update_link():
        if not state.plays:  # the link is not updated until playing ends
            link.text = f'<a href="?{state.address()}">link to this view</a>'
            message.text = ""

    update_link()
    message.text = alert(problem)
    state.on("point", moved)
    state.on("point steps a b x y omega orbits fraction show plays", update_link)
    columns = [field(model, partial(typed, i)) for i, model in enumerate(fields)]
    return [*columns, leap, slider, link, message]


def _rounded(value):
    return repr(float(f"{value:.10g}"))


def _show_status(line, document, work, shared):
    """Keep the status line up to date: what is being prepared or computed, and what failed."""

    def show():
        busy = sorted(work.busy.items())
        tasks = [f"{name} ({progress})" if progress else name for name, progress in busy]
        status = f"computing: {', '.join(tasks)} …" if tasks else "ready"
        if shared.preparing:
            status = f"{shared.preparing} …"
            document.add_timeout_callback(show, 300)
        failed = "; ".join(f"{name}: {reason}" for name, reason in work.failed.items())
        line.text = f'<span role="status">{escape(status)}</span> {alert(failed)}'

    work.show = show
    show()
