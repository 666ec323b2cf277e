"""Parts of the panels: figures and their data, text fields and their error messages."""

from contextlib import suppress
from html import escape
from itertools import product
from math import ceil, log10

from bokeh import models
from bokeh.core.property.descriptors import UnsetValueError
from bokeh.plotting import figure
from bokeh.themes import Theme

from workflows.explore.state import ZOOM, State

_DELAY = 20  # milliseconds; the browser reports related changes within this time
_TOOLS = "box_zoom,pan,wheel_zoom,zoom_in,zoom_out,reset,save"
_ATTRIBUTES = {
    "Toolbar": {"logo": None, "styles": {"min-width": "230px"}}
}  # a narrower toolbar would hide a tool
_ATTRIBUTES["Axis"] = {"axis_label_text_font_style": "normal"}
_ATTRIBUTES["Row"] = {"stylesheets": [":host { flex-wrap: wrap; gap: 4px 16px }"]}  # for phones
_ATTRIBUTES["Figure"] = {"border_fill_color": None}  # a white border would flash in dark mode
THEME = Theme(json={"attrs": _ATTRIBUTES})


def alert(text):
    """Return `text` as an HTML message that screen readers speak, or "" if `text` is empty."""
    return f'<span role="alert" style="color: var(--alert)">{escape(text)}</span>' if text else ""


def field(model, take):
    """Return a text field with a message below it.

    take : function that is called with the text whenever the text changes. The message is the text
    of a ValueError that `take` raises, or the text that it returns, if any. The field keeps what
    was typed.
    """
    message = models.Div(width=model.width, margin=(0, 5))

    def typed(attr, old, new):
        message.text = ""
        try:
            message.text = escape(take(new.strip()) or "")
        except ValueError as error:
            message.text = alert(str(error))

    model.on_change("value", typed)
    return models.Column(model, message)


def boxes(state, labels, **options):
    """Return check boxes that select which of the names in `labels` are shown."""
    names = list(labels)

    def chosen(attr, old, new):
        state.take(show=(state.show - {*names}) | {names[i] for i in new})

    active = [i for i, name in enumerate(names) if name in state.show]
    group = models.CheckboxGroup(labels=[*labels.values()], active=active, **options)
    group.on_change("active", chosen)
    return group


def picture(state, names, labels, max_zoom=ZOOM[1], **options):
    """Return a figure whose axes show two ranges of the state, "ab" or "xy"; it can be reset.

    labels : labels of its axes. max_zoom : largest ranges, relative to the initial ones.
    """
    for axis, name, label in zip("xy", names, labels, strict=True):
        low, high = getattr(State(state.plane), name)
        settings = {"reset_start": low, "reset_end": high, "min_interval": ZOOM[0] * (high - low)}
        settings |= {"max_interval": max_zoom * (high - low)}
        options[f"{axis}_range"] = models.Range1d(*getattr(state, name), **settings)
        options[f"{axis}_axis_label"] = label
    options |= {"tools": _TOOLS, "active_scroll": "wheel_zoom", "toolbar_location": "above"}
    plot = figure(sizing_mode="scale_width", **options)
    plot.grid.visible = False
    return plot


def add_bar(plot, mapper, title):
    """Add a colour bar to a figure, with a title centred beside it; return the bar."""
    bar = models.ColorBar(color_mapper=mapper, width=10, padding=4)
    plot.add_layout(bar, "right")
    plot.add_layout(models.Title(text=title, align="center", text_font_style="normal"), "right")
    return bar


def show(plot, marks, name, columns, tips=None):
    """Show columns of data as marks in a figure; None clears the marks.

    The marks are created when data are first shown. marks : {name: function → [Glyph, …]}, in
    drawing order. tips : tooltips of the marks.
    """
    existing = [one for one in plot.renderers if one.tags == [name]]
    if existing:
        source = existing[0].data_source
        source.data = columns or {name: [] for name in source.data}
    elif columns and any(map(len, columns.values())):
        settings = {"data_source": models.ColumnDataSource(columns, name=name), "tags": [name]}
        new = [models.GlyphRenderer(glyph=glyph, **settings) for glyph in marks[name]()]
        order = [[], *([one] for one in marks)]
        plot.renderers = sorted([*plot.renderers, *new], key=lambda one: order.index(one.tags))
        plot.add_tools(*[models.HoverTool(renderers=new, tooltips=tips)] * bool(tips))


def small(title, x_label, y_label, **options):
    """Return a small figure for curves that are computed on request."""
    settings = {"height": 150, "toolbar_location": None, "name": title}
    settings |= {"x_axis_label": x_label, "y_axis_label": y_label}
    return figure(title=title, sizing_mode="stretch_width", tools="", **settings | options)


def sides_of(plot):
    """Return (lowest, highest) for each of the two axes of a figure."""
    return [tuple(sorted(map(float, (r.start, r.end)))) for r in (plot.x_range, plot.y_range)]


def rounded(event, pixel):
    """Return x and y of an event, rounded to the digits that pixels of this size resolve."""
    return [round(w, ceil(-log10(d))) for w, d in zip((event.x, event.y), pixel, strict=True)]


def pixels_of(plot, largest, default=None):
    """Return the numbers of pixel rows and columns inside the axes, each from 1 to `largest`.

    Until the browser reports them, return `default`.
    """
    with suppress(UnsetValueError):
        return tuple(min(max(int(n), 1), largest) for n in (plot.inner_height, plot.inner_width))
    return default


def on_view(plot, work, refresh):
    """Call refresh() soon after the view or size of the figure changes, once for several changes.

    Return a function that schedules a call of refresh().
    """
    scheduled = []

    def run():
        scheduled.clear()
        refresh()

    def soon():
        if not scheduled:
            scheduled.append(work.document.add_timeout_callback(run, _DELAY))

    ends = product((plot.x_range, plot.y_range), ("start", "end"))
    for model, name in (*ends, (plot, "inner_width"), (plot, "inner_height")):
        model.on_change(name, lambda attr, old, new: soon())
    return soon
