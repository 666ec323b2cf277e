"""Move the point along its ray or an axis: the portrait follows, and residues are plotted."""

import numpy as np
from bokeh.models import Button, Column, ColumnDataSource, MultiLine, Row, Select, Span
from bokeh.palettes import Viridis3

from workflows.explore.widgets import small
from workflows.figures.planes import symbols
from workflows.shared.on_demand import PLACES, residues

_RAY = "the ray"


def panel(state, work):
    """Return the controls, with a plot of the residues along the path below them.

    The residues are those of the convergents of the last circle at the point selected when playing
    begins.
    """
    options = [_RAY, *symbols(state.plane.axes, plain=True)]
    along = Select(title="Play along", options=options, value=_RAY, width=110)
    button = Button(label="play")
    controls = Row(along, button, styles={"align-items": "end"})
    root = Column(controls, sizing_mode="stretch_width")
    position = Span(dimension="height", line_color="#888888")
    lane, path, repeated = work.latest("residues"), [], []

    def ends():
        point, corners = np.array(state.point), np.array([state.a, state.b])
        if along.value == _RAY:
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(point > 0, corners[:, 1], corners[:, 0]) / point
            return 0 * point, point * np.nanmin(np.where(room > 0, room, 2.0))
        first, last = np.array([point, point])
        i = along.options.index(along.value) - 1
        first[i], last[i] = corners[i]
        return first, last

    def show(curves):
        shades = [*Viridis3][: len(curves["orbit"])]
        source = ColumnDataSource(curves | {"colour": shades}, name="residues")
        label = f"fraction of the path; R of {', '.join(curves['orbit'])}, up to R = 1"
        title = "residues of the last circle's convergents along the path"
        plot = small(title, label, "R", y_range=(0, 1))
        plot.add_glyph(source, MultiLine(xs="at", ys="residue", line_color="colour", line_width=2))
        plot.add_layout(position)
        root.children = [controls, plot]

    def toggle():
        if repeated:
            return stop()
        first, last = ends()
        path[:] = [(s, first + s * (last - first)) for s in np.arange(1, PLACES + 1) / PLACES]
        root.children, button.label = [controls], "stop"
        omega = state.verdict and state.verdict.boundary.omega
        if omega:
            start, end = (state.plane.forcing(*point) for point in (first, last))
            lane.submit(residues, start, end - start, omega, done=show)
        state.take(plays=True)
        repeated.append(work.document.add_periodic_callback(step, 150))  # at least 150 ms apart

    def stop():
        work.document.remove_periodic_callback(repeated.pop())
        button.label = "play"
        state.take(plays=False)

    def step():
        if state.drawn == state.point:  # otherwise the portrait is still being drawn
            position.location, point = path.pop(0)
            if not path:
                stop()
            state.move(*map(float, point.round(6)))

    button.on_click(toggle)
    return root
