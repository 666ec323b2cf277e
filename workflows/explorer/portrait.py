"""The phase portrait: orbits of the forcing, what is left of the last circle, orbits added."""

import numpy as np
from bokeh.events import Tap
from bokeh.models import (
    CheckboxGroup,
    ColorBar,
    Column,
    ColumnDataSource,
    Div,
    HoverTool,
    Line,
    LinearColorMapper,
    Range1d,
    Row,
    Scatter,
    TextInput,
)
from bokeh.plotting import figure

from nasm import barriers, fourier, orbits, periodic
from nasm.verdict import Answer
from workflows.explorer.pixels import on_view, pixels_of, sides_of
from workflows.explorer.words import alert
from workflows.figures.phase_space import CHAOTIC, COLOURS, STRONG, ends, places
from workflows.parts.phase_space import CELL, in_box, periodic_orbits, portraits
from workflows.parts.verdict_words import name_of

_PIXELS = 560  # along each side, until the browser tells
_MOST_PIXELS = 1200
_MOST_STEPS = 5000  # that are drawn of the longest-lived start's orbit
_MOST_POINTS = 5000  # of a circle in the box
_FINE = 2**15  # points of a circle, of which a box shows a part
_TOGGLES = ["kick by kick", "symmetry lines", "periodic orbits"]
_BAR = "ω, rotation number per step; grey: chaotic"
_EMPTY = {"x": [], "y": []}


def panel(state, work):
    """Return the right panel: the portrait, its toggles, and the orbits that were added."""
    plot, image, bar, lines, cycles = _drawn()
    toggles = CheckboxGroup(labels=_TOGGLES, inline=True)
    field = TextInput(title="Add an orbit from x, y", placeholder="0.5, 0.3", width=180)
    told = Div(sizing_mode="stretch_width", min_height=22)
    lane, trace_lane = work.latest("portrait"), work.latest("last circle")
    cycle_lane = work.latest("periodic orbits")
    now = {"portrait": None, "words": "", "added": []}
    now |= {"strong": None, "name": "", "cycles": _NO_CYCLES}

    def seen():
        """Return the portrait with what is left of the last circle."""
        if now["portrait"] is None:
            return None
        found = now["portrait"]
        for name in now["strong"] or ():
            x, y = (lines[name].data[axis] for axis in "xy")
            found = found.assign({f"{name}_x": (name, x), f"{name}_y": (name, y)})
        title = name_of(state.kappa, (state.plane, state.point))
        return found.assign_attrs(title=", ".join(filter(None, [title, now["name"]])))

    state.seen["phase space"] = seen

    def refresh():
        """Compute what the view asks for."""
        box, shape = _box(plot), pixels_of(plot, _MOST_PIXELS) or (_PIXELS, _PIXELS)
        every = 1 if 0 in toggles.active else None
        with_lines = 1 in toggles.active
        args = state.kappa, box, list(now["added"]), every, with_lines, shape
        lane.submit(_computed, *args, done=show)
        draw_decisive()

    def show(found):
        portrait, pixels, curves, now["words"] = found
        now["portrait"] = portrait
        left, bottom, width, height = portrait.attrs["box"]
        image.data = {"pixels": [pixels], "x": [left], "y": [bottom], "w": [width], "h": [height]}
        for source, curve in zip(lines["symmetry"], curves, strict=True):
            source.data = curve
        low, high = ends(portrait)
        bar.color_mapper.update(low=low, high=high)
        tell()

    def tell():
        name = f'<b style="color: {STRONG}">{now["name"]}</b>. ' if now["name"] else ""
        told.text = f'<span role="status">{name}{now["words"]}</span>'

    def moved():
        now.update(strong=None, name="", cycles=_NO_CYCLES)
        trace_lane.cancel()
        cycle_lane.cancel()
        soon()

    def judged():
        if state.verdict is not None:
            trace_lane.submit(_decisive, state.kappa, state.verdict, done=hold)
            find_cycles()

    def hold(found):
        now["strong"], now["name"] = found
        tell()
        draw_decisive()

    def find_cycles():
        cycle_lane.cancel()
        now["cycles"] = _NO_CYCLES
        omega = state.verdict and state.verdict.boundary.omega
        if 2 in toggles.active and omega:
            cycle_lane.submit(_cycles, state.kappa, omega, done=keep_cycles)
        draw_decisive()

    def keep_cycles(found):
        now["cycles"] = found
        draw_decisive()

    def draw_decisive():
        """Draw what is known of the last circle in the box: curves, and points one by one."""
        box, strong = _box(plot), now["strong"] or {}
        lines["circle"].data = _line(box, *strong.get("circle", ([], [])))
        lines["longest_lived"].data = _dots(box, *strong.get("longest_lived", ([], [])))
        cycles.data = _dots(box, **now["cycles"])

    def add(x, y):
        now["added"].append((x % 1, y))
        soon()

    def typed(attr, old, new):
        if not new:
            return
        try:
            x, y = map(float, new.replace(",", " ").split())
            if not np.isfinite([x, y]).all():
                raise ValueError
        except ValueError:
            told.text = alert("two numbers, like 0.5, 0.3")
        else:
            add(x, y)

    def toggled(attr, old, new):
        soon()
        find_cycles()

    plot.on_event(Tap, lambda event: add(event.x, event.y))
    field.on_change("value", typed)
    toggles.on_change("active", toggled)
    soon = on_view(plot, work, refresh)
    state.on("point", moved)
    state.on("verdict", judged)
    soon()
    below = Row(toggles, field, styles={"flex-wrap": "wrap", "gap": "4px 16px"})
    return Column(plot, told, below, sizing_mode="stretch_width")


def _drawn():
    """Return the figure, and the sources and the bar that change with what it shows."""
    left, bottom, width, height = CELL
    plot = figure(
        x_range=Range1d(left, left + width, max_interval=1.0),
        y_range=Range1d(bottom, bottom + height, max_interval=1.0),
        x_axis_label="x (turns)",
        y_axis_label="y (mod 1)",
        tools="box_zoom,pan,wheel_zoom,zoom_in,zoom_out,reset,save",
        active_drag="box_zoom",
        active_scroll="wheel_zoom",
        sizing_mode="scale_width",
        aspect_ratio=1.0,
        toolbar_location="above",
    )
    plot.toolbar.logo = None
    plot.grid.visible = False
    blank = {"pixels": [np.zeros((1, 1), np.uint8)], "x": [left], "y": [bottom]}
    image = ColumnDataSource(blank | {"w": [width], "h": [height]}, name="orbits")
    palette = ["#00000000", CHAOTIC, *COLOURS]  # of the bytes
    mapper = LinearColorMapper(palette, low=-0.5, high=255.5)
    plot.image("pixels", "x", "y", "w", "h", source=image, color_mapper=mapper)
    shades = LinearColorMapper(COLOURS, low=0, high=1)
    bar = ColorBar(color_mapper=shades, title=_BAR, width=10, padding=4)
    plot.add_layout(bar, "right")
    names = "circle", "longest_lived", "symmetry", "second symmetry"
    circle, longest_lived, *symmetry = (ColumnDataSource(_EMPTY, name=name) for name in names)
    lines = {"circle": circle, "longest_lived": longest_lived, "symmetry": symmetry}
    for source, dash in zip(symmetry, ("solid", "dashed"), strict=True):
        plot.add_glyph(source, Line(x="x", y="y", line_color="#444444", line_dash=dash))
    plot.add_glyph(circle, Line(x="x", y="y", line_color=STRONG, line_width=3))
    dots = {"size": 5, "line_color": STRONG, "fill_color": STRONG}
    plot.add_glyph(longest_lived, Scatter(x="x", y="y", **dots))
    cycles = ColumnDataSource(_NO_CYCLES, name="cycles")
    markers = Scatter(x="x", y="y", marker="marker", size=6, fill_color="fill")
    markers = plot.add_glyph(cycles, markers)
    tips = [("orbit", "@orbit"), ("x, y", "@x{0.0000000}, @y{0.0000000}")]
    plot.add_tools(HoverTool(renderers=[markers], tooltips=tips))
    return plot, image, bar, lines, cycles


_NO_CYCLES = {"x": [], "y": [], "marker": [], "fill": [], "orbit": []}
_MARKERS = {"minimax": ("circle", "white"), "minimizing": ("square", "black")}


def _box(plot):
    """Return left, bottom, width and height of what the figure shows, one cell at most."""
    (left, right), (bottom, top) = sides_of(plot)
    return left, bottom, min(right - left, 1.0), min(top - bottom, 1.0)


def _computed(kappa, box, added, every, with_lines, shape):
    """Yield the portrait, its picture, symmetry lines, and the orbits added in words."""
    curves = _symmetry_lines(kappa, box) if with_lines else (_EMPTY, _EMPTY)
    none = "" if curves else "The forcing has no symmetry centre, so there are no symmetry lines."
    for portrait in portraits(kappa, box, added, every):
        if portrait is None:
            yield None
        else:
            words = " ".join(filter(None, [_told(portrait, len(added)), none]))
            yield portrait, _pixels(portrait, shape, len(added)), curves or (_EMPTY, _EMPTY), words


def _pixels(portrait, shape, n_added):
    """Return the picture of a portrait: 0 for nothing, 1 for chaos, else a colour's place and 2."""
    left, bottom, width, height = portrait.attrs["box"]
    which = portrait.which.values
    value = (places(portrait) + 2).astype(np.uint8)[which]
    column = np.minimum((portrait.x.values - left) / width * shape[1], shape[1] - 1).astype(int)
    row = np.minimum((portrait.y.values - bottom) / height * shape[0], shape[0] - 1).astype(int)
    pixels = np.zeros(shape, np.uint8)
    for here in (value == 1, value > 1):
        pixels[row[here], column[here]] = value[here]
    here = which >= portrait.sizes["orbit"] - n_added  # what was asked for is larger
    for down, right in np.ndindex(3, 3) if n_added else ():
        rows = np.clip(row[here] + down - 1, 0, shape[0] - 1)
        pixels[rows, np.clip(column[here] + right - 1, 0, shape[1] - 1)] = value[here]
    return pixels


def _told(portrait, n_added):
    """Return the number of orbits, and what was found of the last one that was added."""
    chaotic = int(np.isnan(portrait.omega).sum())
    words = f"{portrait.sizes['orbit']} orbits, {chaotic} of them chaotic (grey)."
    if n_added:
        x, y, omega = (float(portrait[name][-1]) for name in ("start_x", "start_y", "omega"))
        kind = f"ω = {omega:.9g} per step" if np.isfinite(omega) else "chaotic"
        words += f" The one added at ({x:.6g}, {y:.6g}): {kind}."
    return words


def _symmetry_lines(kappa, box):
    """Return the lines of each of the two centres; None where the forcing has no centre."""
    try:
        x, y = periodic.symmetry_lines(kappa, np.linspace(0, 1, 4001))
    except ValueError:
        return None
    gap = np.full((4, 1), np.nan)  # between one line and the next
    x, y = np.hstack([x, gap]), np.hstack([y, gap])
    pairs = (in_box(box, x[i : i + 2].ravel(), y[i : i + 2].ravel()) for i in (0, 2))
    return [dict(zip("xy", pair, strict=True)) for pair in pairs]


def _decisive(kappa, found):
    """Return what is left of the last circle, {"circle" or "longest_lived": (x, y)}, and its name.

    None where there is nothing to show.
    """
    if found.circle is not None:
        x, y = found.circle
        n, more = x.size, max(x.size, _FINE)
        x = fourier.resample(x - np.arange(n) / n, more) + np.arange(more) / more
        return {
            "circle": (x, fourier.resample(y, more))
        }, f"Certified circle, ω = {found.boundary.omega}"
    if found.answer is Answer.TRANSPORT:
        x, y, steps = barriers.remnant(kappa, max(1000, int(2 * found.steps)))
        traced = orbits.orbit(kappa, x, y, int(min(steps, _MOST_STEPS)))
        return {"longest_lived": traced}, f"The start that lives longest, {steps:g} steps"
    return None


def _cycles(kappa, omega):
    """Return the points of the periodic orbits of the convergents of ω, and what they are."""
    found = [_NO_CYCLES]
    for fraction, family, x, y in periodic_orbits(kappa, omega):
        words = *_MARKERS[family], f"{fraction} ({family})"
        found.append(
            dict(zip(_NO_CYCLES, (x, y, *np.repeat(words, x.size).reshape(3, -1)), strict=True))
        )
    return {name: np.concatenate([part[name] for part in found]) for name in _NO_CYCLES}


def _line(box, x, y):
    """Return a curve as far as it is in the box, with gaps where it leaves."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    stride = 1 + in_box(box, x, y)[0].size // _MOST_POINTS
    return dict(zip("xy", in_box(box, x[::stride], y[::stride]), strict=True))


def _dots(box, x, y, **more):
    """Return the points in the box, with what belongs to them."""
    left, bottom, width, height = box
    u, v = (np.asarray(x, float) - left) % 1, (np.asarray(y, float) - bottom) % 1
    here = (u <= width) & (v <= height)
    rest = {name: np.asarray(values)[here].tolist() for name, values in more.items()}
    return {"x": left + u[here], "y": bottom + v[here], **rest}
