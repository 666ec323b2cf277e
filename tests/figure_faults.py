"""Find faults in a saved figure, such as texts that overlap or are cut off."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_hex
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text

from workflows.figures import style

_SMALL = 3.0  # in points; smaller markers may be cut by an axis


def faults(figure):
    """Return a list of the faults of a figure, each described in words."""
    renderer = figure.canvas.get_renderer()
    texts = _drawn(figure, renderer)
    return [
        *_cut(figure, texts, renderer),
        *_overprinted(texts, renderer),
        *_on_data(figure, texts, renderer),
        *_covered(figure, texts, renderer),
        *_cut_markers(figure),
        *_alike(figure),
    ]


def _drawn(figure, renderer):
    """Return all texts that are drawn and not clipped away."""
    drawn, draw = [], Text.draw

    def spy(text, *args, **options):
        if text.get_visible() and text.get_text().strip():
            drawn.append(text)
        return draw(text, *args, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", spy)
        figure.draw_without_rendering()
    return [text for text in dict.fromkeys(drawn) if not _is_clipped(text, renderer)]


def _is_clipped(text, renderer):
    if not (text.get_clip_on() and text.axes):
        return False
    box, place = text.get_window_extent(renderer), text.axes.bbox
    return not place.contains(*box.min) and not place.contains(*box.max)


def _name(text):
    return repr(text.get_text())[:40]


def _cut(figure, texts, renderer):
    box = style.frame(figure).transformed(figure.dpi_scale_trans)
    for text in texts:
        low, high = text.get_window_extent(renderer).get_points()
        if (low < box.min - 1).any() or (high > box.max + 1).any():
            yield f"{_name(text)} is cut by the edge of the figure"


def _overprinted(texts, renderer):
    """Report texts that are printed over each other; slanted texts are left out."""
    straight = [text for text in texts if text.get_rotation() % 90 == 0]
    boxes = [text.get_window_extent(renderer).padded(-1.5) for text in straight]
    for (one, box), (other, place) in combinations(zip(straight, boxes, strict=True), 2):
        if min(box.size) > 0 and min(place.size) > 0 and box.overlaps(place):
            yield f"{_name(one)} is printed over {_name(other)}"


def _points(axes):
    """Return the points (n, 2) of curves and markers within the axes, in pixels."""
    parts = []
    for line in axes.get_lines():
        if not line.get_visible() or line.get_transform() != axes.transData:
            continue
        xy = axes.transData.transform(np.column_stack(line.get_data(orig=False)).astype(float))
        xy = xy[np.isfinite(xy).all(axis=1)]
        if line.get_linestyle() != "None" and len(xy) > 1:  # add points on the segments
            steps = np.linspace(0, 1, 20)[:, None, None]
            xy = (xy[:-1] * (1 - steps) + xy[1:] * steps).reshape(-1, 2)
        parts.append(xy)
    for group in axes.collections:
        if isinstance(group, PathCollection):
            parts.append(axes.transData.transform(np.ma.filled(group.get_offsets(), np.nan)))
        elif isinstance(group, LineCollection):
            ends = [axes.transData.transform(part) for part in group.get_segments() if len(part)]
            steps = np.linspace(0, 1, 20)[:, None]
            parts += [part[0] * (1 - steps) + part[-1] * steps for part in ends]
    points = np.concatenate([np.empty((0, 2)), *parts])
    inside = (points >= axes.bbox.min - 1) & (points <= axes.bbox.max + 1)
    return points[inside.all(axis=1)]


def _on_data(figure, texts, renderer):
    """Report legends and texts within axes that lie on points or curves of these axes."""
    for axes in figure.axes:
        points = _points(axes)
        own = [text for text in axes.texts if text in texts]
        legends = [legend for legend in [axes.get_legend()] if legend]
        for artist in own + legends:
            box = artist.get_window_extent(renderer).padded(-2)
            on = ((points > box.min) & (points < box.max)).all(axis=1).sum()
            if on:
                name = "a legend" if isinstance(artist, Legend) else _name(artist)
                yield f"{name} lies on {on} data points"


def _covered(figure, texts, renderer):
    """Report texts that lie under a legend and are not part of it."""
    for legend in figure.findobj(Legend):
        box, own = legend.get_window_extent(renderer).padded(-2), legend.findobj(Text)
        for text in texts:
            if text not in own and box.overlaps(text.get_window_extent(renderer).padded(-2)):
                yield f"{_name(text)} lies under a legend"


def _cut_markers(figure):
    for axes in figure.axes:
        for line in axes.get_lines():
            size = line.get_markersize() * (0.5 if line.get_marker() == "." else 1)
            shown = line.get_marker() not in ("None", "", " ", None) and line.get_visible()
            own = line.get_transform() == axes.transData
            if not shown or not own or not line.get_clip_on() or size < _SMALL:
                continue
            xy = axes.transData.transform(np.column_stack(line.get_data(orig=False)).astype(float))
            xy = xy[np.isfinite(xy).all(axis=1)]
            edge = np.minimum(xy - axes.bbox.min, axes.bbox.max - xy).min(axis=1)
            radius = size / 2 * figure.dpi / 72
            cut = ((edge > -0.5 * radius) & (edge < 0.7 * radius)).sum()
            if cut:
                yield f"{cut} markers {line.get_marker()!r} are cut by an axis"


def look(handle):
    """Return the properties that distinguish a legend entry from the others."""
    if isinstance(handle, Line2D):
        marker = handle.get_marker()
        inside = str(handle.get_markerfacecolor()) if marker != "None" else ""
        dash = handle._unscaled_dash_pattern if handle.get_linestyle() != "None" else None
        return "line", to_hex(handle.get_color()), str(marker), inside, str(dash)
    if hasattr(handle, "get_hatch"):
        face = getattr(handle, "get_facecolor", str)()
        return type(handle).__name__, str(face), handle.get_hatch(), str(handle.get_edgecolor())
    return type(handle).__name__, id(handle)


def _alike(figure):
    """Report entries of one legend that differ only in their text."""
    for legend in figure.findobj(Legend):
        seen = {}
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            words = seen.setdefault(look(handle), text.get_text())
            if words != text.get_text():
                yield f"{words!r} and {text.get_text()!r} look alike"
