"""The page: one document for each tab, with its own state and its own work."""

from html import escape
from pathlib import Path
from urllib.parse import urlencode

from bokeh.models import CategoricalSlider, CustomJS, Div, Row, TextInput
from jinja2 import Template

from nasm.planes import two_kicks
from workflows.explorer import plane, portrait, verdict
from workflows.explorer.state import Forcing
from workflows.explorer.words import alert
from workflows.explorer.work import Work

_STEPS = [m * 10**e for e in range(2, 6) for m in (1, 2, 5)] + [10**6]
_DEFAULT = 10_000
_TEMPLATE = Template((Path(__file__).parent / "page.html").read_text("utf-8"))
_QUERY = ("k1", "k2", "n", "plane")  # of the permalink


def fill(document, shared):
    """Fill the document of a new tab."""
    document.title = f"{shared.plane.name}: the explorer of the nonautonomous standard map"
    document.template = _TEMPLATE
    work = Work(document, shared.client)
    context = document.session_context
    shared.waiting[context.id] = lambda: work.tick(work.start)

    def close(_):
        shared.waiting.pop(context.id, None)
        work.close()

    document.on_session_destroyed(close)
    query = context.request.arguments  # bytes, which may spell no text
    asked = {name: query[name][0].decode(errors="replace") for name in _QUERY if name in query}
    state, wrong = asked_for(shared.plane, asked)
    roots = {
        "controls": _controls(state, wrong),
        "status": _status(document, work, shared),
        "plane": plane.panel(state, work, shared),
        "portrait": portrait.panel(state, work),
        "verdict": verdict.panel(state, work),
    }
    with document.models.freeze():  # which would count all models again after each root
        for name, root in roots.items():
            root.name = name
            document.add_root(root)


def asked_for(plane, asked):
    """Return the Forcing of a permalink {name: text}, and what is wrong with it in words, or ""."""
    sizes = [max(map(abs, vector)) for vector in (plane.first, plane.second)]
    point, steps = (0.5 / sizes[0], 0.4 / sizes[1]), _DEFAULT
    state, defaults = Forcing(plane, point, steps), list(zip(_QUERY, point, strict=False))
    try:
        if asked.get("plane", two_kicks().name if asked else plane.name) != plane.name:
            asked_plane = asked.get("plane", two_kicks().name)
            raise ValueError(f"this page shows {plane.name}; start one with --plane {asked_plane}")
        if "n" in asked:
            state.steps = _whole(asked["n"])
        given = [number(asked[name]) if name in asked else value for name, value in defaults]
        state.move(*given)
    except ValueError as error:
        return Forcing(plane, point, steps), f"the address asks for what is not there: {error}"
    return state, ""


def number(text):
    """Return the float that a text spells; ValueError in words."""
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{text!r} is no number, like 0.525") from None


def _whole(text):
    if not (text.isdecimal() and _STEPS[0] <= int(text) <= _STEPS[-1]):
        raise ValueError(f"n={text!r} must be a whole number from {_STEPS[0]} to {_STEPS[-1]}")
    return int(text)


def _controls(state, wrong):
    """Fields to type the point exactly, the slider of N, and the permalink."""
    names = plane.symbols(state.plane)
    fields = [TextInput(title=name, width=150) for name in names]
    message = Div(width=260)
    shown = {str(n): n for n in sorted({*_STEPS, state.steps})}
    title = "N, steps within which an escape counts"
    slider = CategoricalSlider(
        title=title, categories=list(shown), value=str(state.steps), width=240
    )
    link = Div(width=120)
    link.js_on_change("text", CustomJS(code=_ADDRESS))

    shows = []  # while the fields are filled in, nobody types

    def show():
        shows.append(True)
        for field, value in zip(fields, state.point, strict=True):
            field.value = repr(value)
        shows.clear()
        message.text = ""
        tell()

    def tell():
        values = dict(zip(_QUERY, (*map(repr, state.point), state.steps), strict=False))
        if state.plane != two_kicks():
            values["plane"] = state.plane.name
        link.text = f'<a href="?{urlencode(values)}">link to this view</a>'

    def typed(attr, old, new):
        if shows:
            return
        try:
            state.move(*(number(field.value) for field in fields))
        except ValueError as error:
            message.text = alert(str(error))

    show()
    message.text = alert(wrong)
    for field in fields:
        field.on_change("value", typed)
    slider.on_change("value", lambda attr, old, new: state.count(shown[new]))
    state.on("point", show)
    state.on("steps", tell)
    return Row(*fields, slider, link, message, styles={"flex-wrap": "wrap", "gap": "4px 16px"})


# The address of the page becomes the permalink.
_ADDRESS = "history.replaceState(null, '', cb_obj.text.match(/href=\"([^\"]*)/)[1])"


def _status(document, work, shared):
    """Say what is prepared or computed, and what failed."""
    line, waiting = Div(sizing_mode="stretch_width"), []

    def show():
        doing = [f"{name} ({how})" if how else name for name, how in sorted(work.busy.items())]
        words = f"computing: {', '.join(doing)} …" if doing else "ready"
        if shared.preparing:
            words = f"{shared.preparing} …"
        elif waiting:
            document.remove_periodic_callback(waiting.pop())
        failed = "; ".join(f"{name}: {why}" for name, why in work.failed.items())
        line.text = f'<span role="status">{escape(words)}</span> {alert(failed)}'

    if shared.preparing:
        waiting.append(document.add_periodic_callback(show, 300))
    work.show = show
    show()
    return line
