"""The plane of forcings: first escape times, where the last circle breaks, and the point."""

from html import escape
from math import ceil, log10

import numpy as np
import xarray as xr
from bokeh.events import MouseLeave, MouseMove, Pan, PanEnd, PanStart, Tap
from bokeh.models import (
    AutocompleteInput,
    CheckboxGroup,
    ColorBar,
    Column,
    ColumnDataSource,
    Div,
    LogColorMapper,
    MultiLine,
    PanTool,
    Range1d,
    ResetTool,
    Row,
    SaveTool,
    Scatter,
    WheelZoomTool,
    ZoomInTool,
    ZoomOutTool,
)
from bokeh.palettes import Magma256
from bokeh.plotting import figure
from contourpy import contour_generator

from nasm.numbers import NAMES
from nasm.planes import plane_of
from pipeline import store
from workflows.explorer import field, rays
from workflows.explorer.field import BLOCKS, Field, View
from workflows.explorer.pixels import on_view, pixels_of, sides_of
from workflows.explorer.rays import NO_LINES
from workflows.explorer.words import alert
from workflows.figures import planes
from workflows.figures.style import smoothed
from workflows.parts.tables import described

_PIXELS = 640  # along each side, until the browser tells
_MOST_PIXELS = 1024
_HALF = 1.15  # of the largest strength, of the first view
_KEPT = 8  # fields that are kept for all tabs, to go back to
_STAYS = 3  # pixels that a cell of OUT may fill
_COLOURS = Magma256[:232]  # the palest are too like the grey of no escape
_LINES = ["where the last circle breaks", "where n* ≤ N begins"]
_CIRCLE = {
    "title": "where the circle of this ω breaks (dashed)",
    "completions": list(NAMES),
    "placeholder": "gamma or [0;2,(1)]",
    "restrict": False,
    "min_characters": 1,
    "width": 260,
}
_SYMBOLS = {r"$\kappa_1$": "κ₁", r"$\kappa_2$": "κ₂", r"$\bar\kappa$": "κ̄", r"$\Delta\kappa$": "Δκ"}


def symbols(plane):
    """Return the symbols of the axes of a plane in plain text, or what they are in words."""
    return [_SYMBOLS.get(symbol, symbol) for symbol in planes.symbols(plane.axes)]


def panel(state, work, shared):
    """Return the left panel: the plane, what is under the pointer, the colours of the circles."""
    plot, image, lines, point = _drawn(state)
    told = Div(sizing_mode="stretch_width", css_classes=["told"], min_height=40)
    legend = Div(sizing_mode="stretch_width")
    circle, message = AutocompleteInput(**_CIRCLE), Div(width=250)
    wanted = CheckboxGroup(labels=_LINES, active=[0], width=220)
    cubes, shown, asked = [], [], []  # Fields of OUT; the one shown; what is computed last
    lanes = {name: work.latest(name) for name in ("cubes", "plane", "boundary", "circle")}
    x, y = symbols(state.plane)
    sides = plot.x_range, plot.y_range

    def refresh():
        """Compute what the view and N ask for."""
        draw_rays()
        view = _view(plot)
        what = [view, state.steps, circle.value, *cubes]
        if asked == what or not pixels_of(plot, _MOST_PIXELS):
            return
        asked[:] = what
        work.end("view")
        image.glyph.color_mapper.high = state.steps
        where = shared.client, state.plane
        args = *where, view, state.steps, [*shown, *reversed(shared.fields.values()), *cubes]
        lanes["plane"].submit(field.computed, *args, done=lambda found: show(view, *found))
        lanes["boundary"].cancel()  # its rays would hold a worker for seconds
        lines["circle"].data = {"a": [], "b": []}
        if circle.value:
            args = *where, circle.value, view
            lanes["circle"].submit(rays.circle, *args, done=show_circle)

    def show(view, times, block, words):
        cells = max(block, BLOCKS[-2]) if words else 1  # some pixels are still their neighbours'
        shown[:] = [Field(*view.centres(), times, state.steps, cells, apart=BLOCKS[-2])]
        if not words:
            shared.fields.pop((view, state.steps), None)  # the newest last
            shared.fields[view, state.steps] = shown[0]
            if len(shared.fields) > _KEPT:
                del shared.fields[next(iter(shared.fields))]
            args = shared.client, state.plane, shared.rays.missing(view), view
            lanes["boundary"].submit(rays.computed, *args, done=show_rays)
        size = {"da": [np.ptp(view.a)], "db": [np.ptp(view.b)]}
        start = {"a": [view.a[0]], "b": [view.b[0]]}
        image.data_source.data = {"times": [times.astype(np.float32)], **start, **size}
        work.progress("plane", words)
        if block == 1:
            draw_contour()

    def show_rays(found):
        tables, words = found
        for table in tables:
            shared.rays.add(table)
        work.progress("boundary", words)
        draw_rays()

    def show_circle(found):
        lines["circle"].data = found

    def draw_rays():
        drawn, colours = shared.rays.lines(_view(plot))
        lines["boundary"].data = drawn if 0 in wanted.active else NO_LINES
        legend.text = _legend(colours) if 0 in wanted.active else ""
        mark()

    def draw_contour():
        field = shown[0] if 1 in wanted.active and shown else None
        lines["contour"].data = _contour(field, state.steps) if field else {"a": [], "b": []}

    def choose(attr, old, new):
        draw_rays()
        draw_contour()

    def name_circle(attr, old, new):
        try:
            rays.checked(state.plane, new)
            message.text = ""
        except ValueError as error:
            message.text = alert(str(error))
            circle.update(value="")
        refresh()

    def opened(found):
        """Show what OUT holds, and compute the rest."""
        cubes[:], barrier = found
        if barrier is not None:
            shared.rays.add_cube(barrier)
        refresh()

    def words_at(a, b):
        words = f"{x} = {a:.6g}, {y} = {b:.6g}"
        n = shown[0].at(a, b) if shown else np.nan
        if not np.isnan(n):
            words += f" · n* = {n:.0f}" if n <= state.steps else f" · n* > {state.steps}"
        found = shared.rays.at(a, b)
        if found is not None:
            excess, ray = found
            side = "beyond" if excess > 0 else "inside"
            words += f" · {100 * abs(excess):.3g}% {side} the boundary"
            words += f" · last circle of the nearest ray: ω = {rays.named(ray)}"
        return words

    def mark():
        a, b = state.point
        point.data = {"a": [a], "b": [b]}
        told.text = words_at(a, b)

    drag = {"view": None, "before": None, "pans": False}

    def begin(event):
        pans = bool(event.modifiers and event.modifiers["shift"])
        drag.update(view=_view(plot), before=None, pans=pans)

    def dragged(event):
        view = drag["view"]
        if drag["pans"]:
            steps = view.pixel * (-event.delta_x, event.delta_y)
            for side, ends, step in zip(sides, (view.a, view.b), steps, strict=True):
                side.update(start=ends[0] + step, end=ends[1] + step)
        # If a tool of the toolbar pans, the view moves along, which is known one event later.
        elif drag["before"] and view == _view(plot):
            move(*drag["before"])
        drag["before"] = event.x, event.y

    def end(event):
        if drag["view"] == _view(plot) and not drag["pans"]:
            move(event.x, event.y)

    def move(*point):
        """Move the forcing, with no more digits than pixels have."""
        pixel = _view(plot).pixel
        try:
            state.move(*(round(x, ceil(-log10(w))) for x, w in zip(point, pixel, strict=True)))
        except ValueError as error:
            work.fail("plane", error)

    def escapes():
        """What the plane shows, as a Dataset."""
        return _dataset(state.plane, shown[0]) if shown else None

    def pointed(event):
        told.text = words_at(event.x, event.y)

    plot.on_event(Tap, lambda event: move(event.x, event.y))
    plot.on_event(PanStart, begin)
    plot.on_event(Pan, dragged)
    plot.on_event(PanEnd, end)
    plot.on_event(MouseMove, pointed)
    plot.on_event(MouseLeave, lambda event: mark())
    circle.on_change("value", name_circle)
    wanted.on_change("active", choose)
    state.on("point", mark)
    state.on("steps", on_view(plot, work, refresh))
    state.seen |= {"escape": escapes, "boundary": shared.rays.table}
    mark()
    work.begin("view")
    lanes["cubes"].submit(_cubes, shared.place, state.plane, done=opened)
    controls = Row(wanted, circle, message, styles={"flex-wrap": "wrap"})
    return Column(plot, told, legend, controls, sizing_mode="stretch_width")


def _drawn(state):
    """Return the figure, the renderer of the field, {name: source of lines}, and the point's."""
    view = _first_view(state.plane)
    labels = dict(zip(("x_axis_label", "y_axis_label"), symbols(state.plane), strict=True))
    wheel = WheelZoomTool()
    tools = [PanTool(), wheel, ZoomInTool(), ZoomOutTool(), ResetTool(), SaveTool()]
    plot = figure(
        **labels,
        x_range=Range1d(*view.a, **_limits(view.a)),
        y_range=Range1d(*view.b, **_limits(view.b)),
        tools=tools,
        active_scroll=wheel,
        active_drag=None,
        sizing_mode="scale_width",
        aspect_ratio=1.06,  # with the colours beside it
        toolbar_location="above",
    )
    plot.toolbar.logo = None
    plot.grid.visible = False
    plot.axis.axis_label_text_font_style = "normal"
    mapper = LogColorMapper(_COLOURS, low=10, high=state.steps, high_color="#f0f0f0")
    mapper.nan_color = "rgba(0, 0, 0, 0)"
    blank = {"times": [np.full((1, 1), np.nan, np.float32)], "a": [view.a[0]], "b": [view.b[0]]}
    blank |= {"da": [np.ptp(view.a)], "db": [np.ptp(view.b)]}
    source = ColumnDataSource(blank, name="times")
    image = plot.image("times", "a", "b", "da", "db", source=source, color_mapper=mapper)
    title = "n*, first escape (steps); grey: none within N"
    plot.add_layout(ColorBar(color_mapper=mapper, title=title, width=10, padding=4), "right")
    lines = {name: ColumnDataSource({"a": [], "b": []}) for name in ("contour", "circle")}
    lines["boundary"] = ColumnDataSource(NO_LINES, name="boundary")
    for name, style in (
        ("contour", {"line_width": 1.2}),
        ("boundary", {"line_color": "white", "line_width": 5}),
        ("boundary", {"line_color": "colour", "line_width": 2.5}),
        ("circle", {"line_width": 2, "line_dash": "dashed"}),
    ):
        plot.add_glyph(lines[name], MultiLine(xs="a", ys="b", **style))
    point = ColumnDataSource({"a": [], "b": []})
    for style in ({"line_color": "white", "line_width": 5}, {"line_width": 2}):
        cross = Scatter(x="a", y="b", size=16, marker="circle_cross", fill_alpha=0, **style)
        plot.add_glyph(point, cross)
    return plot, image, lines, point


def _first_view(plane):
    half = [_HALF / max(map(abs, vector)) for vector in (plane.first, plane.second)]
    return View((-half[0], half[0]), (-half[1], half[1]), (_PIXELS, _PIXELS))


def _limits(ends):
    """Return how far one can zoom: beyond it, pixels are no longer apart as floats."""
    size = float(np.ptp(ends))
    return {"min_interval": 1e-9 * size, "max_interval": 30 * size}


def _view(plot):
    """Return what the figure shows, with about as many pixels as the browser has."""
    pixels = pixels_of(plot, _MOST_PIXELS) or (_PIXELS, _PIXELS)
    return View(*sides_of(plot), tuple(BLOCKS[0] * max(2, round(n / BLOCKS[0])) for n in pixels))


def _contour(field, steps):
    """Return the boundary of {n* ≤ steps} of a running median, as lines."""
    inside = smoothed(field.times) <= steps
    found = contour_generator(field.a, field.b, inside.astype(float)).lines(0.5)
    a, b = ([line[:, i].tolist() for line in found] for i in (0, 1))
    return {"a": a, "b": b}


def _dataset(plane, field):
    first, second = plane.axes
    axes = {
        name: (name, values, described(plane.axes[name]))
        for name, values in zip(plane.axes, (field.a, field.b), strict=True)
    }
    words = "first step at which an orbit of the ensemble is outside the window; "
    words += "away from the boundary of n* <= n_max cells may share that of one"
    times = (second, first), field.times, described(words)
    attrs = {"title": "First escape times, as shown", "n_max": field.steps, **plane.record}
    return xr.Dataset({"escape_time": times}, axes, attrs)


def _cubes(place, plane):
    """Open the cubes of OUT that are of this plane: a list of Fields, and the barrier or None."""
    try:
        names = store.names(place)
    except store.Refused:  # there is no such directory
        return [], None
    cubes = {name: store.read(place, name) for name in ("escape", "barrier") if name in names}
    cubes = {name: cube for name, cube in cubes.items() if plane_of(cube.attrs) == plane}
    fields = []
    if "escape" in cubes:
        times = cubes["escape"].escape_time.isel(ensemble=-1)
        axes = [times[name].values for name in plane.axes]
        steps = int(cubes["escape"].attrs["n_max"])
        level = cubes["escape"].get("level", xr.zeros_like(times))
        # Escape is a matter of chance in each cell: coarse ones are a preview.
        own = times.where((level == level.max()) | np.isinf(times))
        fields.append(Field(*axes, own, steps, stays=_STAYS))
        fields.append(Field(*axes, times, steps, 2 ** int(level.max())))
    return fields, cubes["barrier"].load() if "barrier" in cubes else None


def _legend(colours):
    """Return the colours of the circles, as HTML."""
    bar = "display: inline-block; width: 1.4em; height: 0.35em; vertical-align: middle"
    return "".join(
        f'<span style="white-space: nowrap; margin-right: 1.2em">'
        f'<span style="{bar}; background: {colour}"></span> ω = {escape(text)}</span>'
        for text, colour in colours.items()
    )
