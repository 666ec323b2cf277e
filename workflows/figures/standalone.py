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
_HOVER = """<div>φ = @angle{%.9g}°, (@a{%.6f}, @b{%.6f})<br>
breaks at s = @critical_scale{%.12g} ± @error{%.0e}<br>
last circle: ω = @circle @also<br>a circle at @lower{%.7g}, none at @upper{%.7g}</div>"""
_NUMBERS = "angle", "a", "b", "critical_scale", "error", "lower", "upper"


def boundary_page(barrier):
    """Return the page: CB_gt in the colours of the last circles, and each ray's numbers under the
    pointer. barrier : as `pipeline.cubes.barrier.boundary` returns it."""
    barrier = barrier.where(np.isfinite(barrier.critical_scale), drop=True)
    (a, b), whole = in_plane(barrier), whole_of(barrier)
    rays = barrier.to_dataframe().reset_index().assign(a=a.values, b=b.values)
    rays["also"] = [text and f"and {text}" for text in rays.tied]
    rays["class"] = [circle_class(text, whole) or "not known" for text in rays.circle]
    looks = [circle_style(text, whole) for text in rays.circle]
    rays["colour"] = [look["color"] for look in looks]
    rays["marker"] = [_MARKERS[look["marker"]] for look in looks]
    title = "Where the last barrier to transport breaks"
    how = {"match_aspect": True, "sizing_mode": "stretch_width", "height": 640, "title": title}
    tools = {"tools": "pan,wheel_zoom,box_zoom,reset,save", "active_scroll": "wheel_zoom"}
    plot = figure(**how, **tools)
    plot.xaxis.axis_label, plot.yaxis.axis_label = (part.attrs["long_name"] for part in (a, b))
    plot.line(a.values, b.values, color="#888888")
    look = {"size": 7, "color": "colour", "marker": "marker", "legend_group": "class"}
    marks = plot.scatter("a", "b", source=ColumnDataSource(rays.to_dict("list")), **look)
    formatters = {f"@{name}": "printf" for name in _NUMBERS}
    plot.add_tools(HoverTool(renderers=[marks], tooltips=_HOVER, formatters=formatters))
    plot.legend.title = "ω, or its image" if of_two_kicks(barrier) else "ω"
    plot.legend.ncols, plot.legend.location = 2, "center"
    plot.add_layout(plot.legend[0], "below")
    return file_html(plot, INLINE, title)
