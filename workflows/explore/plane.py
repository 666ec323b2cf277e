"""The plane of forcings: escape times, where the last circle breaks, and the chosen forcing."""

from functools import partial
from html import escape
from math import inf, isfinite
from time import monotonic

import numpy as np
from bokeh import models
from bokeh.events import MouseLeave, MouseMove, Pan, PanEnd, Tap
from bokeh.palettes import Magma256

from nasm.numbers import NAMES
from nasm.planes import plane_of
from nasm.verdicts import Answer
from pipeline import store
from workflows.explore import rays, widgets
from workflows.explore.field import BLOCKS, Field, View, computed, precision_of
from workflows.explore.state import LINES
from workflows.figures.colours import INSIDE, NO_ESCAPE, hexadecimal
from workflows.figures.planes import symbols
from workflows.shared.tables import dataset
from workflows.shared.verdict_sentences import scale_text

_PIXELS = 640  # along each side, until the browser reports its size
_MAX_PIXELS = 1024
_GROUND_PIXELS = 256  # along each side of the grey image; the boundary line hides its coarse edges
_MAX_FIELDS = 8  # maximum number stored for all tabs, in case a view is shown again
_MAX_CELL_PIXELS = 3  # cells in OUT up to this size are not recomputed
_MIN_EXCESS = 1e-3  # smallest relative distance from the boundary that is resolved between rays
_ON_BOUNDARY = "on the boundary, or very close to it"
_COLOURS = Magma256[:232]  # without the lightest colours, which resemble the greys
# Unknown, inside the boundary, outside.
_GREYS = ["white", hexadecimal(INSIDE), hexadecimal(NO_ESCAPE)]
_GREY_MEANINGS = {"inside": "a circle exists", "outside": "no circle, but no escape within N"}
_HALO = {"line_color": "white", "line_width": 5}
_CROSS = {"size": 16, "marker": "marker", "angle": "angle", "fill_alpha": 0}
_MARGIN = 0.04  # distance from the edge to the mark of a point outside, relative to the view
_STYLES = _HALO, {"line_color": "colour", "line_width": 2.5}
_MARKS = {
    "boundary": lambda: [models.MultiLine(xs="a", ys="b", **style) for style in _STYLES],
    "followed": lambda: [models.Line(x="a", y="b", line_width=2, line_dash="dashed")],
    "point": lambda: [models.Scatter(**_CROSS, **style) for style in (_HALO, {"line_width": 2})],
}
_CIRCLE = {"title": "where the circle with this ω breaks (dashed)", "width": 260, "restrict": False}
_CIRCLE |= {"placeholder": "gamma or [0;2,(1)]", "completions": [*NAMES], "min_characters": 1}


class PlanePanel:
    """The plane of forcings on the left of the page, with its legend.

    picture : the plane, and a description of the chosen forcing, or of the one under the pointer.
    lines : the legend, and controls for the lines to draw.
    """

    def __init__(self, state, work, shared):
        self.state, self.work, self.shared = state, work, shared
        self.plot, self.mapper, self.sources = _figure(state)
        self.show = partial(widgets.show, self.plot, _MARKS)
        self.message = models.Div(
            sizing_mode="stretch_width", css_classes=["message"], min_height=40
        )
        self.legend = models.Div(sizing_mode="stretch_width")
        # Cubes in OUT, Field shown, latest request and its time.
        self.cubes = self.shown = self.request = self.asked = None
        lanes = {"cubes": None, "plane": None, "boundary": "verdict", "circle": "verdict"}
        self.lanes = {name: work.latest(name, kernels) for name, kernels in lanes.items()}
        circle = widgets.field(models.AutocompleteInput(**_CIRCLE, value=state.omega), state.follow)
        ticks = models.Row(widgets.boxes(state, LINES, width=220), circle)
        self.picture, self.lines = (self.plot, self.message), (self.legend, ticks)
        self.plot.on_event(Tap, self._move)
        for what in (Pan, PanEnd):
            self.plot.on_event(what, lambda event: "tool" in self.plot.tags or self._move(event))
        self.plot.on_event(MouseMove, lambda event: self._describe(event.x, event.y))
        self.plot.on_event(MouseLeave, lambda event: self._mark())
        state.on("point verdict", self._mark)
        state.on("show", self._show_boundary)
        state.on("steps omega", widgets.on_view(self.plot, work, self._refresh))
        state.datasets |= {"escape": self._escapes, "boundary": shared.rays.table}
        self._mark()
        work.progress("view", "")
        self.lanes["cubes"].submit(self._open, done=self._opened)

    def _open(self):
        """Yield the cubes in OUT; see `_cubes`."""
        try:
            yield from _cubes(self.shared.place, self.state.plane)
        finally:
            self.shared.opened.set()

    def _opened(self, result):
        """Show cubes in OUT, and compute the rest."""
        self.cubes, boundary = result
        if boundary is not None:
            self.shared.rays.add(boundary)
            self._show_boundary()
        self._refresh()

    def _refresh(self):
        state, shared, view = self.state, self.shared, _view(self.plot)
        state.take(a=view.a, b=view.b)
        request = view, state.steps, state.omega
        known = self.cubes is not None and widgets.pixels_of(self.plot, _MAX_PIXELS)
        if request == self.request or not known:  # the cubes in OUT are shown first
            return
        self.request, self.asked = request, monotonic()
        self.work.progress("view")
        self.mapper.high = state.steps
        where = shared.client, state.plane
        known = [*filter(None, [self.shown]), *reversed(shared.fields.values()), *self.cubes]
        args = *where, view, state.steps, known
        self.lanes["plane"].submit(computed, *args, done=lambda result: self._show(view, *result))
        self.lanes["boundary"].cancel()  # its rays would occupy a worker for seconds
        self.show("followed", None)
        self.lanes["circle"].cancel()
        if state.omega:
            show = partial(self.show, "followed")
            self.lanes["circle"].submit(rays.circle, *where, state.omega, view, done=show)
        self._show_boundary()

    def _show(self, view, times, block, progress):
        state, shared = self.state, self.shared
        cells = max(block, BLOCKS[-2]) if progress else 1  # some pixels show a neighbour's time
        self.shown = Field(*view.centres(), times, state.steps, cells, apart=BLOCKS[-2])
        if not progress:
            shared.fields.pop((view, state.steps), None)  # so that the newest field comes last
            shared.fields[view, state.steps] = self.shown
            if len(shared.fields) > _MAX_FIELDS:
                del shared.fields[next(iter(shared.fields))]
            args = shared.client, shared.rays, view, self.asked
            self.lanes["boundary"].submit(rays.computed, *args, done=self._show_rays)
        self.sources["times"].data = _image(view, times.astype(np.float32))
        self.work.progress("plane", progress)
        if block == 1:
            self._mark()

    def _show_rays(self, result):
        known, progress = result
        self.shared.rays.known |= known
        self.work.progress("boundary", progress)
        self._show_boundary()

    def _show_boundary(self):
        view = _view(self.plot)
        drawn, colours = self.shared.rays.lines(view)
        is_shown = "boundary" in self.state.show
        self.show("boundary", drawn if is_shown else None)
        self.legend.text = _legend(colours if is_shown else {})
        a, b = np.meshgrid(*View(view.a, view.b, (_GROUND_PIXELS, _GROUND_PIXELS)).centres())
        excess = self.shared.rays.excess(a, b)
        sides = np.where(np.isnan(excess), 0, np.where(excess <= 0, 1, 2)).astype(np.uint8)
        self.sources["ground"].data = _image(view, sides)
        self._mark()

    def _mark(self):
        a, b = self.state.point
        self.show("point", {"a": [a], "b": [b], **_mark_of((a, b), widgets.sides_of(self.plot))})
        self._describe(a, b)

    def _describe(self, a, b):
        x, y = symbols(self.state.plane.axes, plain=True)
        parts, steps = [f"{x} = {a:.6g}, {y} = {b:.6g}"], self.state.steps
        if (a, b) == self.state.point and not _is_in((a, b), widgets.sides_of(self.plot)):
            parts.append("outside this picture, beyond the triangle at its edge")
        n = self.shown.at(a, b) if self.shown else np.nan
        if not np.isnan(n):
            parts.append(f"n* = {n:.0f}" if n <= steps else f"n* > {steps}")
        parts.append(self._distance(a, b))
        ray = self.shared.rays.nearest(a, b)
        if ray is not None:
            circle = f"{ray.circle} = {ray.omega:.6g}" if ray.circle else "unknown"
            parts.append(f"last circle of the nearest ray: ω = {circle}")
        self.message.text = " · ".join(filter(None, parts))

    def _distance(self, a, b):
        """Describe where the boundary is, according to the verdict or an estimate from the rays."""
        from_zero = not any(self.state.plane.origin)
        verdict = self.state.verdict if (a, b) == self.state.point else None
        if verdict is not None and from_zero:  # the verdict's ray is a ray of the plane
            boundary = verdict.boundary
            is_known = isfinite(boundary.value)
            place = f"{scale_text(boundary)} times these strengths" if is_known else ""
            return side_text(verdict.answer, boundary.value, place)
        excess = float(self.shared.rays.excess(a, b))
        scale = 1 / (1 + excess) if excess > -1 else inf
        place = f"about {scale:.3g} times these {'strengths' if from_zero else 'numbers'}"
        answer = verdict.answer if verdict is not None else None
        return (
            _ON_BOUNDARY
            if abs(excess) < _MIN_EXCESS and answer is None
            else side_text(answer, scale, place)
        )

    def _move(self, event):
        """Move the forcing to where the user clicks, or drags without a tool."""
        try:
            self.state.move(*widgets.rounded(event, _view(self.plot).pixel))
        except ValueError as error:
            self.work.fail("plane", error)

    def _escapes(self):
        plane, shown = self.state.plane, self.shown
        if shown is None:
            return None
        label = "first step at which an orbit of the ensemble is outside the window; away from the "
        label += "boundary of the region n* <= n_max, neighbouring cells may share a value"
        settings = {"n_max": shown.steps, "precision": precision_of(shown.steps), **plane.record}
        axes = zip(plane.axes.items(), (shown.a, shown.b), strict=True)
        coords = {name: (centres, meaning) for (name, meaning), centres in axes}
        times = {"escape_time": ([*coords][::-1], shown.times, label)}
        return dataset("First escape times, as shown", coords, times, settings)


def side_text(answer, scale, place):
    """Describe which side of the boundary a point is on; "" if this is unknown.

    answer : nasm.Answer of the verdict, or None. scale : scale of the boundary, relative to
    the point. place : the position of the boundary, as text.
    """
    if not isfinite(scale):
        return ""
    if answer is Answer.UNDECIDED:
        return f"undecided: too close to the boundary, which is at {place}"
    # If `answer` and `scale` disagree, the scale is 1 within its error.
    if answer is not None and (answer is Answer.BARRIER) != (scale > 1):
        return _ON_BOUNDARY
    return f"{'inside' if scale > 1 else 'beyond'} the boundary, which is at {place}"


def _is_in(point, ends):
    return all(low <= value <= high for value, (low, high) in zip(point, ends, strict=True))


def _mark_of(point, ends):
    """Return the mark of a point: a cross, or a triangle if the point is outside the view.

    The triangle is at the edge of the view and points towards the point.
    """
    if _is_in(point, ends):
        return {"x": [point[0]], "y": [point[1]], "marker": ["circle_cross"], "angle": [0.0]}
    low, high = np.transpose(ends)
    size = high - low
    at = np.clip(point, low + _MARGIN * size, high - _MARGIN * size)
    across, up = (point - at) / size
    angle = float(np.arctan2(up, across) - np.pi / 2)  # at angle 0 the marker points up
    return {"x": [at[0]], "y": [at[1]], "marker": ["triangle"], "angle": [angle]}


def _figure(state):
    """Return the figure, the colour mapper of escape times, and {name: source} of both images."""
    # With this ratio the plane is about square, with the colour bar beside it.
    options = {"active_drag": None, "aspect_ratio": 1.1, "tags": ["arrows"]}
    options["name"] = "plane of forcings; arrow keys move the forcing"
    plot = widgets.picture(state, "ab", symbols(state.plane.axes, plain=True), **options)
    view, clear = _view(plot), {"high_color": "rgba(0, 0, 0, 0)", "nan_color": "rgba(0, 0, 0, 0)"}
    mapper = models.LogColorMapper(_COLOURS, low=10, high=state.steps, **clear)
    greys, sources = models.LinearColorMapper(_GREYS, low=-0.5, high=2.5, name="greys"), {}
    layers = ("ground", greys, np.uint8(0)), ("times", mapper, np.float32("nan"))
    for name, colours, blank in layers:
        sources[name] = models.ColumnDataSource(_image(view, np.full((1, 1), blank)), name=name)
        plot.image("values", "a", "b", "da", "db", source=sources[name], color_mapper=colours)
    widgets.add_bar(plot, mapper, "n*, first escape (steps)")
    return plot, mapper, sources


def _image(view, values):
    place = {"a": [view.a[0]], "b": [view.b[0]], "da": [np.ptp(view.a)], "db": [np.ptp(view.b)]}
    return {"values": [values], **place}


def _view(plot):
    """Return the view of the figure, with about as many pixels as in the browser."""
    pixels = widgets.pixels_of(plot, _MAX_PIXELS, (_PIXELS, _PIXELS))
    shape = tuple(BLOCKS[0] * max(2, round(n / BLOCKS[0])) for n in pixels)
    return View(*widgets.sides_of(plot), shape)


def _cubes(place, plane):
    """Yield the cubes in OUT that belong to this plane: a list of Fields, and the boundary.

    The fields are yielded at once with None, then with the boundary if there is one. If OUT is
    refused, yield no cubes, so that the page computes everything; then raise the error that states
    the reason.
    """
    try:
        cubes = _of_plane(place, plane)
        yield (fields := _fields(cubes, plane)), None
        if "barrier" in cubes:
            from pipeline.cubes.barrier import unfolded

            angles = np.unique(plane.unfold(cubes["barrier"].angle.values))
            yield fields, unfolded(cubes["barrier"].load(), angles)
    except store.Refused:
        yield [], None
        raise
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        yield [], None
        raise store.Refused(f"{place} contains cubes from another program: {error!r}") from None


def _of_plane(place, plane):
    """Return {name: cube} of the cubes in OUT, as far as they belong to this plane."""
    try:
        names = store.names(place)
    except store.Refused:  # there is no such directory
        return {}
    cubes = {name: store.read(place, name) for name in ("escape", "barrier") if name in names}
    return {name: cube for name, cube in cubes.items() if plane_of(cube.attrs) == plane}


def _fields(cubes, plane):
    """Return the Fields of the cube of escape times, if there is one."""
    if "escape" not in cubes:
        return []
    cube = cubes["escape"]
    # As arrays, because xarray imports dask.array, in 0.3 s, before it indexes a variable.
    times = cube.escape_time.values[-1]
    level = cube.level.values if "level" in cube else np.zeros(times.shape)
    axes, steps = [cube[name].values for name in plane.axes], int(cube.attrs["n_max"])
    # Escape times vary irregularly from cell to cell, so coarse cells are only a preview.
    own = np.where((level == level.max()) | np.isinf(times), times, np.nan)
    preview = Field(*axes, times, steps, 2 ** int(level.max()))
    return [Field(*axes, own, steps, stays=_MAX_CELL_PIXELS), preview]


def _legend(colours):
    """Return the colours of the circles, and the greys, as HTML."""
    bar = "display: inline-block; width: 1.4em; height: {}em; vertical-align: middle"
    entries = [(0.35, colour, f"ω = {omega}") for omega, colour in colours.items()]
    entries += [(0.9, f"var(--{side})", words) for side, words in _GREY_MEANINGS.items()]
    return "".join(
        f'<span style="white-space: nowrap; margin-right: 1.2em">'
        f'<span style="{bar.format(height)}; background: {colour}; outline: 1px solid #999">'
        f"</span> {escape(text)}</span>"
        for height, colour, text in entries
    )
