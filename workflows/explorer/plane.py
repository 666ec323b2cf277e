"""The plane of forcings: first escape times, where the last circle breaks, and the point."""

import numpy as np
from bokeh.events import MouseLeave, MouseMove, Pan, PanEnd, PanStart, Tap
from bokeh.models import (
    ColorBar,
    Column,
    ColumnDataSource,
    Div,
    LogColorMapper,
    PanTool,
    Range1d,
    ResetTool,
    SaveTool,
    WheelZoomTool,
    ZoomInTool,
    ZoomOutTool,
)
from bokeh.palettes import Magma256
from bokeh.plotting import figure

from nasm.planes import plane_of
from pipeline import store
from workflows.explorer import field, rays
from workflows.explorer.field import BLOCKS, Field, View
from workflows.figures import planes

_PIXELS = 640  # along each side, until the browser tells
_MOST_PIXELS = 1024
_HALF = 1.15  # of the largest strength, of the first view
_SYMBOLS = {r"$\kappa_1$": "κ₁", r"$\kappa_2$": "κ₂", r"$\bar\kappa$": "κ̄", r"$\Delta\kappa$": "Δκ"}


def symbols(plane):
    """Return the symbols of the axes of a plane in plain text, or what they are in words."""
    return [_SYMBOLS.get(symbol, symbol) for symbol in planes.symbols(plane.axes)]


def panel(state, work, shared):
    """Return the left panel: the plane, what is under the pointer, the colours of the circles."""
    view = _first_view(state.plane)
    figure_, image, boundary, point = _drawn(state, view)
    told, legend = Div(sizing_mode="stretch_width"), Div(sizing_mode="stretch_width")
    mapper = image.glyph.color_mapper
    lane, ray_lane = work.latest("plane"), work.latest("boundary")
    seen = {"field": None, "cubes": [], "pending": False, "words": {}}
    x, y = symbols(state.plane)
    sides = figure_.x_range, figure_.y_range

    def refresh():
        """Compute what the view and N ask for."""
        seen["pending"] = False
        mapper.high = max(state.steps, 2)
        here = _view(figure_)
        known = [seen["field"], *seen["cubes"]] if seen["field"] else seen["cubes"]
        args = shared.client, state.plane, here, state.steps, known
        lane.submit(field.computed, *args, done=lambda found: show(here, *found))
        ray_lane.submit(rays.computed, shared.client, shared.rays, here, done=show_ray)

    def soon():
        if not seen["pending"]:
            seen["pending"] = True
            work.tick(refresh)

    def show(here, times, words):
        seen["field"] = Field(*here.centres(), times, state.steps)
        _place(image, here, times)
        seen["words"]["plane"] = words
        tell_progress()

    def show_ray(found):
        table, words = found
        shared.rays.add(table)
        seen["words"]["boundary"] = words
        draw_rays()

    def draw_rays():
        a, b, colours = shared.rays.lines()
        boundary.data = {"a": a, "b": b, "colour": colours}
        legend.text = _legend(shared.rays)

    def tell_progress():
        pass

    def opened(cubes):
        """Show what OUT holds, and compute the rest."""
        seen["cubes"], barrier = cubes
        if barrier is not None:
            shared.rays.add_cube(barrier)
        draw_rays()
        refresh()

    def tell(event):
        told.text = words_at(event.x, event.y)

    def words_at(a, b):
        words = f"{x} = {a:.6g}, {y} = {b:.6g}"
        if (n := _at(seen["field"], a, b)) is not None and not np.isnan(n):
            words += f" · n* {f'= {n:.0f}' if np.isfinite(n) else f'> {state.steps}'}"
        if (found := shared.rays.at(a, b)) is not None:
            excess, ray = found
            side = "beyond" if excess > 0 else "inside"
            words += f" · {100 * abs(excess):.3g}% {side} the boundary"
            words += f" · last circle ω = {rays.named(ray)}"
        return words

    def mark():
        a, b = state.point
        point.data = {"a": [a], "b": [b]}
        told.text = words_at(a, b)

    drag = {"view": None, "before": None}

    def begin(event):
        drag.update(view=_view(figure_), before=None)

    def dragged(event):
        view = drag["view"]
        if event.modifiers and event.modifiers["shift"]:
            steps = view.pixel * (-event.delta_x, event.delta_y)
            for range_, ends, step in zip(sides, (view.a, view.b), steps, strict=True):
                range_.update(start=ends[0] + step, end=ends[1] + step)
        # While the toolbar's tool pans, the view moves along; it is known one event later.
        elif drag["before"] and view == _view(figure_):
            move(*drag["before"])
        drag["before"] = event.x, event.y

    def end(event):
        dragged(event)
        drag["before"] = None

    def move(a, b):
        try:
            state.move(a, b)
        except ValueError as error:
            work.fail("plane", error)

    figure_.on_event(Tap, lambda event: move(event.x, event.y))
    figure_.on_event(PanStart, begin)
    figure_.on_event(Pan, dragged)
    figure_.on_event(PanEnd, end)
    figure_.on_event(MouseMove, tell)
    figure_.on_event(MouseLeave, lambda event: mark())
    for range_ in sides:
        for name in ("start", "end"):
            range_.on_change(name, lambda attr, old, new: soon())
    for name in ("inner_width", "inner_height"):
        figure_.on_change(name, lambda attr, old, new: soon())
    state.on_change(mark)
    state.on_steps(soon)
    mark()
    work.latest("cubes").submit(_cubes, shared.place, state.plane, done=opened)
    return Column(figure_, told, legend, sizing_mode="stretch_width")


def _drawn(state, view):
    """Return the figure, and the renderer of the field, the sources of the boundary and point."""
    x, y = symbols(state.plane)
    pan, wheel = PanTool(), WheelZoomTool()
    tools = [pan, wheel, ZoomInTool(), ZoomOutTool(), ResetTool(), SaveTool()]
    axes = {"x_range": Range1d(*view.a), "y_range": Range1d(*view.b)}
    labels = {"x_axis_label": f"{x} (dimensionless)", "y_axis_label": f"{y} (dimensionless)"}
    plot = figure(
        **axes,
        **labels,
        tools=tools,
        active_scroll=wheel,
        active_drag=None,
        active_tap=None,
        sizing_mode="stretch_width",
        aspect_ratio=1.0,
        toolbar_location="above",
    )
    plot.toolbar.logo = None
    plot.grid.visible = False
    mapper = LogColorMapper(Magma256, low=1, high=state.steps, high_color="#f0f0f0")
    mapper.nan_color = "rgba(0, 0, 0, 0)"
    blank = {"times": [np.full((1, 1), np.nan, np.float32)], "a": [view.a[0]], "b": [view.b[0]]}
    blank |= {"da": [np.ptp(view.a)], "db": [np.ptp(view.b)]}
    image = plot.image(
        "times", "a", "b", "da", "db", source=ColumnDataSource(blank), color_mapper=mapper
    )
    bar = ColorBar(color_mapper=mapper, title="n*", width=10, padding=4, label_standoff=4)
    plot.add_layout(bar, "right")
    lines = ColumnDataSource({"a": [], "b": [], "colour": []})
    plot.multi_line("a", "b", source=lines, line_color="white", line_width=5)
    plot.multi_line("a", "b", source=lines, line_color="colour", line_width=2.5)
    point = ColumnDataSource({"a": [], "b": []})
    cross = {"source": point, "size": 16, "marker": "circle_cross", "fill_alpha": 0}
    plot.scatter("a", "b", line_color="white", line_width=5, **cross)
    plot.scatter("a", "b", line_color="black", line_width=2, **cross)
    return plot, image, lines, point


def _first_view(plane):
    half = [_HALF / max(map(abs, vector)) for vector in (plane.first, plane.second)]
    return View((-half[0], half[0]), (-half[1], half[1]), (_PIXELS, _PIXELS))


def _view(plot):
    """Return what the figure shows, with about as many pixels as the browser has."""
    sides = [
        (float(min(r.start, r.end)), float(max(r.start, r.end)))
        for r in (plot.x_range, plot.y_range)
    ]
    told = plot.inner_height or _PIXELS, plot.inner_width or _PIXELS
    block = BLOCKS[0]
    shape = tuple(block * max(2, round(min(n, _MOST_PIXELS) / block)) for n in told)
    return View(*sides, shape)


def _place(image, view, times):
    """Draw the times over the view."""
    data = {"times": [times.astype(np.float32)], "a": [view.a[0]], "b": [view.b[0]]}
    data |= {"da": [np.ptp(view.a)], "db": [np.ptp(view.b)]}
    image.data_source.data = data


def _at(field, a, b):
    """Return the time at a point of the field that is shown, or None outside."""
    if field is None:
        return None
    places = [
        round((value - axis[0]) / (axis[1] - axis[0]))
        for value, axis in ((b, field.b), (a, field.a))
    ]
    inside = all(0 <= i < n for i, n in zip(places, field.times.shape, strict=True))
    return field.times[tuple(places)] if inside else None


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
        fields.append(Field(*axes, times, int(cubes["escape"].attrs["n_max"])))
    barrier = cubes.get("barrier")
    return fields, None if barrier is None else barrier.load()


def _legend(known):
    """Return the colours of the circles, as HTML."""
    bar = "display: inline-block; width: 1.4em; height: 0.35em; vertical-align: middle"
    return "".join(
        f'<span style="white-space: nowrap; margin-right: 1.2em">'
        f'<span style="{bar}; background: {colour}"></span> ω = {text}</span>'
        for text, colour in known.colours.items()
    )
