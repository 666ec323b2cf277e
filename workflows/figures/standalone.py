"""The critical boundary as one page of HTML that needs nothing but a browser."""

import numpy as np
from bokeh.embed import file_html
from bokeh.models import ColumnDataSource, HoverTool
from bokeh.plotting import figure
from bokeh.resources import INLINE

from workflows.figures.planes import in_plane, of_two_kicks, whole_of
from workflows.figures.style import circle_class, circle_style

_MARKERS = {"o": "circle", "^": "triangle", "s": "square", "D": "diamond"}
_MARKERS |= {"v": "inverted_triangle", "x": "x"}
_HOVER = """<div>φ = @angle°, (@a{0.######}, @b{0.######})<br>breaks at s = @value<br>
last circle: ω = @circle @tied<br>a circle at @lower, none at @upper</div>"""


def boundary_page(barrier):
    """Return the page: CB_gt in the colours of the last circles, and each ray's numbers under the
    pointer. barrier : as `pipeline.cubes.barrier.boundary` returns it."""
    barrier = barrier.where(np.isfinite(barrier.critical_scale), drop=True)
    whole = whole_of(barrier)
    styles = [circle_style(text, whole) for text in barrier.circle.values]
    values = zip(barrier.critical_scale.values, barrier.error.values, strict=True)
    (a, b), tied = in_plane(barrier), [text and f"and {text}" for text in barrier.tied.values]
    columns = {
        "angle": [f"{angle:.9g}" for angle in barrier.angle.values],
        "a": a.values,
        "b": b.values,
        "value": [f"{s:.{_digits(error)}f} ± {error:.0e}" for s, error in values],
        "circle": barrier.circle.values.tolist(),
        "tied": tied,
        "class": [circle_class(text, whole) or "not known" for text in barrier.circle.values],
        "colour": [style["color"] for style in styles],
        "marker": [_MARKERS[style["marker"]] for style in styles],
    }
    for side in ("lower", "upper"):
        columns[side] = [f"{s:.7g}" if s == s else "not shown" for s in barrier[side].values]
    title = "Where the last barrier to transport breaks"
    plot = figure(
        title=title,
        match_aspect=True,
        sizing_mode="stretch_width",
        height=640,
        tools="pan,wheel_zoom,box_zoom,reset,save",
        active_scroll="wheel_zoom",
    )
    plot.xaxis.axis_label, plot.yaxis.axis_label = (part.attrs["long_name"] for part in (a, b))
    plot.line(a.values, b.values, color="#888888")
    points = ColumnDataSource(columns)
    look = {"size": 7, "color": "colour", "marker": "marker", "legend_group": "class"}
    marks = plot.scatter("a", "b", source=points, **look)
    plot.add_tools(HoverTool(renderers=[marks], tooltips=_HOVER))
    plot.legend.title = "ω, or its image" if of_two_kicks(barrier) else "ω"
    plot.legend.ncols, plot.legend.location = 2, "center"
    plot.add_layout(plot.legend[0], "below")
    return file_html(plot, INLINE, title)


def _digits(error):
    """Return the decimals of a number with that error, one of the error's own."""
    return int(np.clip(np.ceil(-np.log10(error)), 0, 15)) if error > 0 else 15
