"""Code shared by all figures: numbers in TeX, saving a figure, and the names in `colours`."""

from contextlib import contextmanager
from io import BytesIO

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox, ScaledTranslation, blended_transform_factory

from nasm.numbers import NAMES, parse
from workflows.figures.colours import (  # noqa: F401
    COLOURS,
    INSIDE,
    MARKERS,
    NO_ESCAPE,
    VERMILION,
    arcs,
    circle_class,
    circle_style,
    circle_styles,
    colour_of,
    line_of,
    longest_arcs,
)
from workflows.figures.files import write

COLUMN = 3.4  # inches, the width of a journal column
_SMALLEST = 6.5  # points, minimum size of text in a column
_TALLEST = 0.65  # maximum height of a panel, relative to its width, if a column contains several
_MARGIN = 0.04  # inches around a figure


_PLAIN = {key: value for key, value in matplotlib.rcParamsDefault.items() if key != "backend"}
_IN_COLUMN = {
    "font.size": 8,
    "axes.titlesize": 8,
    "legend.handlelength": 1.5,
    "figure.figsize": (COLUMN, 0.75 * COLUMN),
}


@contextmanager
def sheet(column=False):
    """Use matplotlib's defaults for figures drawn in this context, ignoring any matplotlibrc.

    column : True for figures that fit a journal column, with 8 pt text and no titles.
    """
    with matplotlib.rc_context(_PLAIN | _IN_COLUMN if column else _PLAIN):
        yield


def in_column():
    return matplotlib.rcParams["figure.figsize"][0] == COLUMN


class _Canvas(FigureCanvasAgg):
    """A canvas that parses each formula only once, because parsing takes 10 ms.

    Matplotlib's parsers cache formulas, but every renderer has its own parser, and a dozen
    renderers are created while a figure is laid out and saved.
    """

    _parser = None

    def get_renderer(self):
        renderer = super().get_renderer()
        _Canvas._parser = renderer.mathtext_parser = self._parser or renderer.mathtext_parser
        return renderer


def canvas(width, height, tall):
    """Return an empty figure of this size; in a column, `tall` times as high as it is wide."""
    figsize = (COLUMN, tall * COLUMN) if in_column() else (width, height)
    figure = Figure(figsize=figsize, layout="constrained")
    _Canvas(figure)
    return figure


def panels(rows, columns, width, height, stack=True, **settings):
    """Return a figure of this size and its axes; `stack` allows stacking the panels in a column."""
    count, shape = rows * columns, height / rows / (width / columns)
    if in_column() and count > 1 and stack:
        rows, columns, width, height = count, 1, COLUMN, COLUMN * count * min(shape, _TALLEST)
    figure = canvas(width, height, height / width)
    return figure, list(figure.subplots(rows, columns, squeeze=False, **settings).flat)


def key(axes, marks, hollow=""):
    """Add marks, {format of a line: label}, to the legend; markers in `hollow` are drawn hollow."""
    for mark, words in marks.items():
        face = "none" if mark in hollow else None
        axes.plot([], [], mark, color="0.4", mfc=face, lw=1, label=words)


def name_circles(axes, styles, **more):
    """Add the circles of `circle_styles` to the legend, with their markers but without lines."""
    for text, style in styles.items():
        label = rf"$\omega = {text}$" if text else r"$\omega$ unknown"
        axes.plot([], [], label=label, **style | {"ls": "", "mew": 0.5} | more)


def legend_below(axes, columns=2, in_column_columns=1, **style):
    """Draw the legend of one of several panels below that panel; set its labels and ticks first."""
    figure, columns = axes.figure, in_column_columns if in_column() else columns
    ticks = axes.bbox.y0 - axes.xaxis.get_tightbbox().y0  # height of ticks and label, in pixels
    below = ScaledTranslation(0, -ticks / figure.dpi - 0.05, figure.dpi_scale_trans)
    across = figure.transFigure if in_column() else axes.transAxes
    place = blended_transform_factory(across, axes.transAxes) + below
    style = {"fontsize": "small", "ncols": columns, "borderaxespad": 0, **style}
    where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0), "bbox_transform": place}
    _make_room(axes.legend(**where, **style))


def outer_legend(figure, columns, in_column_columns=1, where="lower", **style):
    """Draw the figure's legend below or above it, with this number of columns."""
    columns = in_column_columns if in_column() else columns
    style = {"fontsize": "small", **style}
    _make_room(figure.legend(loc=f"outside {where} center", ncols=columns, **style))


def _make_room(legend):
    """Add the height of the legend to a figure for a column, so that the panels do not shrink."""
    if in_column():
        figure = legend.get_figure(root=True)
        height = legend.get_window_extent().height / figure.dpi
        figure.set_figheight(figure.get_figheight() + height)


def save(figure, out, name, caption="", kinds=("png", "pdf")):
    """Write the figure as NAME.png and NAME.pdf, and its caption, if it has one, as NAME.txt.

    Figures for a column are named NAME_column.png and so on. If there are several panels,
    they are labelled (a), (b), …. Returns the paths of the pictures; their metadata also contain
    the caption.
    """
    box = finish(figure)
    name += "_column" * in_column()
    paths = [f"{out}/{name}.{kind}" for kind in kinds]
    for path, kind in zip(paths, kinds, strict=True):
        key, picture = "Subject" if kind == "pdf" else "Description", BytesIO()
        options = {
            "format": kind,
            "dpi": figure.dpi,
            "bbox_inches": box,
            "metadata": {key: caption},
        }
        figure.savefig(picture, **options)
        write(path, picture.getvalue())
    if caption:
        write(f"{out}/{name}.txt", f"{caption}\n")
    return paths


def drawn(draw, out, name, caption="", column=False):
    """Draw a figure with `draw()` and save it; see `save` and `sheet`.

    Returns the paths and a one-line error message, "" if the figure was saved.
    """
    try:
        with sheet(column):
            return save(draw(), out, name, caption), ""
    except Exception as error:  # an error in a figure must not stop the other output
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        return [], f"figure {name} could not be drawn: {reason}"


def finish(figure):
    """Label the panels, and lay the figure out once; savefig would do so for each picture.

    Returns the part of the figure to be saved, a Bbox in inches.
    """
    letter(figure)
    if in_column():  # the caption replaces titles, and no text is too small to read
        figure.suptitle("")
        for axes in figure.axes:
            axes.set_title("")
        for text in figure.findobj(Text):
            text.set_fontsize(max(text.get_fontsize(), _SMALLEST))
    figure.set_dpi(300 if in_column() else 200)
    _show_whole_markers(figure)
    if layout := figure.get_layout_engine():
        layout.execute(figure)
        figure.set_layout_engine(None)  # with "none", savefig would draw everything twice
    _close_up(figure)
    return frame(figure)


def _show_whole_markers(figure):
    """Drop points outside the axes, and do not clip markers at the edge of the axes."""
    for axes in figure.axes:
        for line in axes.lines:
            if line.get_transform() != axes.transData:
                continue
            x, y, shown = _within(axes, *line.get_data())
            if shown.any() and line.get_linestyle() == "None":
                line.set_data(x[shown], y[shown])
                line.set_clip_on(False)
            elif shown.any() and (shown | ~np.isfinite(x + y)).all():
                line.set_clip_on(False)


def _close_up(figure):
    """Move outer legends next to the axes, to close the gaps that axes with equal scales leave."""
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    for legend in figure.legends:
        box, gap = legend.get_window_extent(), figure.dpi / 20
        if box.y1 <= (low := min(box.y0 for box in boxes)):
            y, loc = low - gap, "upper center"
        elif box.y0 >= (high := max(box.y1 for box in boxes)):
            y, loc = high + gap, "lower center"
        else:
            continue
        legend.set_loc(loc)
        legend.set_bbox_to_anchor((0.5, y / figure.bbox.height), figure.transSubfigure)


def frame(figure):
    """Return the part of a laid-out figure to be saved, in inches: all except blank margins.

    Axes with equal scales may leave such margins. A figure for a column keeps its width.
    """
    box = figure.get_tightbbox().padded(_MARGIN)
    return Bbox.from_extents(0, box.y0, COLUMN, box.y1) if in_column() else box


def _within(axes, x, y):
    """Return the coordinates of points as floats, and a mask of those within the axes' limits."""
    x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    (left, right), (low, high) = np.sort(axes.get_xlim()), np.sort(axes.get_ylim())
    return x, y, (left <= x) & (x <= right) & (low <= y) & (y <= high)


def letter(figure):
    """Write (a), (b), … above the panels, if there are several; colour bars have no letter."""
    shown = [axes for axes in figure.axes if axes.axison and axes.get_label() != "<colorbar>"]
    style = {"weight": "bold", "textcoords": "offset points", "annotation_clip": False}
    for axes, name in zip(shown, "abcdefgh" if len(shown) > 1 else "", strict=False):
        axes.annotate(f"({name})", (0, 1), (-4, 6), xycoords="axes fraction", ha="right", **style)


def omega_label(text):
    """Return ω as a continued fraction in TeX, preceded by the paper's name for it, if any.

    In a column, return the name alone.
    """
    names = {str(parse(name)): name.replace("gamma", r"\gamma") for name in NAMES}
    if text in names:
        text = names[text] if in_column() else f"{names[text]} = {text}"
    return rf"$\omega = {text}$"


def known(breakdown):
    """Drop the points whose estimated error exceeds 2% of the scale: the curves have gaps there.

    Their coordinates in the plane are dropped too.
    """
    sharp = breakdown.error < 0.02 * breakdown.critical_scale
    places = {
        name: place.where(sharp)
        for name, place in breakdown.coords.items()
        if place.dims == sharp.dims and name not in sharp.dims
    }
    return breakdown.where(sharp).assign_coords(places)


def draw_points(axes, x, y, classes, styles, size=3, **more):
    """Draw points (x, y), each in the style of the class of its circle (see `circle_styles`)."""
    for text, style in styles.items():
        selected = np.equal(classes, text)
        dots = style | {"ls": "", "mew": 0.5, "ms": size / 2 if in_column() else size, **more}
        axes.plot(np.asarray(x)[selected], np.asarray(y)[selected], **dots)


def draw_brackets(axes, x, lower, upper, colour):
    """Draw brackets as bars, and the known ends of half-open ones as arrows."""
    axes.vlines(x, lower, upper, color=colour, lw=1.5)
    for end, other, marker in ((upper, lower, "v"), (lower, upper, "^")):
        alone = np.isfinite(end) & ~np.isfinite(other)
        axes.plot(x[alone], end[alone], ls="", marker=marker, color=colour, mfc="none", ms=6)


def mark_gaps(axes, x, silent, label="no answer"):
    """Draw × at the bottom wherever a method has no answer, and explain × in the legend."""
    if np.any(silent):
        where = {"transform": axes.get_xaxis_transform(), "ls": "", "marker": "x", "ms": 5}
        axes.plot(x[silent], np.full(np.sum(silent), 0.03), color="0.3", label=label, **where)


def power(n):
    """Return n in TeX as 10^5, 5·10^5, …; return n unchanged if it is small or has more digits."""
    if n < 1000 or n % 10 ** (len(str(n)) - 2):
        return str(n)
    exponent = len(str(n)) - 1
    mantissa = n / 10**exponent
    return f"10^{exponent}" if mantissa == 1 else rf"{mantissa:g}\cdot 10^{exponent}"


def dots(colour, size):
    size = size / 2 if in_column() else size
    return {"ls": "", "marker": ".", "ms": size, "mew": 0, "color": colour, "rasterized": True}


def cell(y):
    """Return y mod 1 in [-1/4, 3/4), a range that does not cut circles with 0 ≤ ω/P ≤ 1/2."""
    return (y + 0.25) % 1 - 0.25


def has_flag(codes, meaning):
    """Return True where a flag variable, `status` or `method`, has this meaning."""
    flags = dict(zip(codes.flag_meanings.split(), codes.flag_values, strict=True))
    return codes == flags[meaning]


def of_family(cube, family):
    """Return the forcings of a family, sorted by their parameter."""
    return cube.isel(forcing=np.flatnonzero(cube.family == family)).sortby("parameter")
