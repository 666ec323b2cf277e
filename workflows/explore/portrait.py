"""The phase portrait: orbits of the forcing, what is left of the last circle, orbits added."""

from itertools import takewhile
from math import ceil, log10

import numpy as np
from bokeh import models
from bokeh.events import Tap
from bokeh.plotting import figure

from nasm import barriers, orbits, symmetries
from nasm.circles import fourier
from nasm.numbers import convergents
from nasm.verdict import Answer
from workflows.explore.instruments import MANIFOLDS, resonance, spreading
from workflows.explore.state import ORBITS, State, fraction_of, orbits_of, orbits_text
from workflows.explore.widgets import boxes, field, on_view, picture, pixels_of, sides_of, small
from workflows.figures.phase_space import CHAOTIC, COLOURS, STRONG, ends, places
from workflows.shared.orbit_words import cycles_words, orbit_words
from workflows.shared.phase_space import in_box, periodic_orbits, portraits
from workflows.shared.verdict_words import name_of

_PIXELS = 560  # along each side, until the browser tells
_MOST_PIXELS = 1200
_MOST_STEPS = 5000  # that are looked at of the longest-lived start's orbit
_APART = 8  # pixels from one of its dots to the next, or so: nearer they would make a line
_MOST_POINTS = 5000  # of a circle in the box
_FINE = 2**15  # points of a circle, of which a box shows a part
_PROFILE = 200  # starts on a vertical line
_MOST_Q = 34  # of the convergents whose orbits are shown
_BAR = "ω, rotation number per step; grey: chaotic"
_EMPTY = {"x": [], "y": []}


class PortraitPanel:
    """The right picture, what is told of it, and its boxes. root : what Bokeh lays out."""

    def __init__(self, state, work):
        self.state, self.work = state, work
        self.plot, self.image, self.bar, self.lines = _drawn(state)
        profile = _profile(self.plot, self.lines["profile"])
        self.message = models.Div(sizing_mode="stretch_width", min_height=22)
        names = "portrait", "last circle", "periodic orbits", "ensemble"
        self.portraits, self.traces, self.cycles, self.ensemble = map(work.latest, names)
        self.portrait, self.words = None, ""
        self._forget()
        self.added = models.TextInput(
            title="Orbits added, x, y; …", placeholder="0.5, 0.3", width=260
        )
        self.added.value = orbits_text(state.orbits)
        fraction = models.TextInput(title="Orbits of a fraction p/q", placeholder="3/8", width=150)
        fraction.value = state.fraction
        self.plot.on_event(Tap, lambda event: self._add(event.x, event.y))
        soon = on_view(self.plot, work, self._refresh)
        state.on("point", self._move)
        for what in ("point", "orbits", "show"):
            state.on(what, soon)
        for what in ("show", "fraction"):
            state.on(what, self._find_cycles)
        state.on("verdict", self._judge)
        state.seen["phase space"] = self._seen
        soon()
        how = {"inline": True, "stylesheets": [_TICKS], "styles": {"max-width": "92vw"}}
        ticks = boxes(state, ORBITS, **how)
        added = field(self.added, lambda text: state.take(orbits=orbits_of(text)))
        sought = field(fraction, state.seek)
        below = models.Row(ticks, added, sought, styles={"flex-wrap": "wrap", "gap": "4px 16px"})
        spread = models.Button(label="spread an ensemble from the middle")
        spread.on_click(self._spread)
        self.variance = small("<(y - y₀)²> against periods", x_axis_type="log", y_axis_type="log")
        self.variance.line("n", "variance", source=self.lines["variance"], line_width=2)
        below.children.append(spread)
        pictures = models.Row(self.plot, profile, sizing_mode="stretch_width")
        self.root = models.Column(
            pictures, self.message, self.variance, below, sizing_mode="stretch_width"
        )

    def _seen(self):
        """Return the portrait with what is left of the last circle."""
        found = self.portrait
        if found is None:
            return None
        for name in self.decisive:
            x, y = (self.lines[name].data[axis] for axis in "xy")
            found = found.assign({f"{name}_x": (name, x), f"{name}_y": (name, y)})
        title = name_of(self.state.kappa, (self.state.plane, self.state.point))
        return found.assign_attrs(title=", ".join(filter(None, [title, self.name])))

    def _refresh(self):
        """Compute what the view asks for."""
        state, box = self.state, _box(self.plot)
        x, y = sides_of(self.plot)
        state.take(x=x, y=y)
        shape = pixels_of(self.plot, _MOST_PIXELS) or (_PIXELS, _PIXELS)
        every = 1 if "kicks" in state.show else None
        args = state.kappa, box, list(state.orbits), every, "symmetry" in state.show, shape
        self.portraits.submit(_computed, *args, done=self._show)
        self._show_decisive()

    def _show(self, found):
        if found[0].attrs["kappa"] == self.state.kappa.tolist():
            self.state.drawn = self.state.point
        self.portrait, pixels, curves, self.lines["profile"].data, self.words = found
        left, bottom, width, height = self.portrait.attrs["box"]
        place = {"x": [left], "y": [bottom], "w": [width], "h": [height]}
        self.image.data = {"pixels": [pixels], **place}
        for name, curve in zip(_SYMMETRY, curves, strict=True):
            self.lines[name].data = curve
        low, high = ends(self.portrait)
        self.bar.color_mapper.update(low=low, high=high)
        self._tell()

    def _tell(self):
        colour = STRONG if "circle" in self.decisive else "inherit"
        name = f'<b style="color: {colour}">{self.name}</b>. ' if self.name else ""
        self.message.text = (
            f'<span role="status">{name}{self.words} {self.said} {self.spreads}</span>'
        )

    def _forget(self):
        self.decisive, self.name, self.orbits, self.said = {}, "", _NO_CYCLES, ""
        self.curves, self.points, self.spreads = {}, _EMPTY, ""

    def _move(self):
        self._forget()
        self.traces.cancel()
        self.ensemble.cancel()
        self.variance.visible = False
        self._find_cycles()

    def _judge(self):
        verdict = self.state.verdict
        if verdict is not None:
            self.traces.submit(_decisive, self.state.kappa, verdict, done=self._hold)
            self._find_cycles()

    def _hold(self, found):
        self.decisive, self.name = found
        self._tell()
        self._show_decisive()

    def _find_cycles(self):
        self._keep_cycles((_NO_CYCLES, {}, ""))
        state = self.state
        omega = state.verdict and "cycles" in state.show and state.verdict.boundary.omega
        fraction = fraction_of(state.fraction)
        self.cycles.cancel()
        if omega or fraction is not None:
            box = _box(self.plot) if "manifolds" in state.show and fraction is not None else None
            args = state.kappa, omega or None, fraction, box
            self.cycles.submit(_cycles, *args, done=self._keep_cycles)

    def _keep_cycles(self, found):
        self.orbits, self.curves, self.said = found
        self._show_decisive()
        self._tell()

    def _show_decisive(self):
        """Draw what is known of the last circle in the box: curves, and points one by one."""
        box, nothing = _box(self.plot), ([], [])
        self.lines["circle"].data = _line(box, *self.decisive.get("circle", nothing))
        _, width = pixels_of(self.plot, _MOST_PIXELS) or (_PIXELS, _PIXELS)
        dots = _dots(box, *self.decisive.get("longest_lived", nothing))
        self.lines["longest_lived"].data = {axis: dots[axis][: width // _APART] for axis in "xy"}
        self.lines["cycles"].data = _dots(box, **self.orbits)
        for name in MANIFOLDS:
            self.lines[name].data = _line(box, *self.curves.get(name, nothing))
        self.lines["ensemble"].data = _dots(box, **self.points)
        self.lines["lobes"].data = _lobes(box, self.curves.get("lobes", []))

    def _spread(self):
        """Let an ensemble spread from the middle of what is seen now."""
        args = self.state.kappa, _box(self.plot)
        self.ensemble.submit(spreading, *args, done=self._show_ensemble)

    def _show_ensemble(self, found):
        self.points, self.lines["variance"].data, self.spreads = found
        self._show_decisive()
        self.variance.visible = True
        self._tell()

    def _add(self, x, y):
        """Add an orbit to those in the field, with no more digits than pixels have."""
        _, _, *sizes = _box(self.plot)
        x, y = (
            round(v, ceil(-log10(size / _PIXELS))) for v, size in zip((x, y), sizes, strict=True)
        )
        self.added.value = orbits_text((*self.state.orbits, (x % 1, y)))


def _drawn(state):
    """Return the figure, and the sources and the bar that change with what it shows."""
    first = State(state.plane)
    how = {"most": 1.0, "active_drag": "box_zoom", "aspect_ratio": 1.0}
    how["name"] = "phase portrait"
    plot = picture(("x (turns)", "y (mod 1)"), (state.x, state.y), (first.x, first.y), **how)
    left, bottom, width, height = _box(plot)
    blank = {"pixels": [np.zeros((1, 1), np.uint8)], "x": [left], "y": [bottom]}
    image = models.ColumnDataSource(blank | {"w": [width], "h": [height]}, name="orbits")
    palette = ["#00000000", CHAOTIC, *COLOURS]  # of the bytes
    mapper = models.LinearColorMapper(palette, low=-0.5, high=255.5, name="omega")
    plot.image("pixels", "x", "y", "w", "h", source=image, color_mapper=mapper)
    shades = models.LinearColorMapper(COLOURS, low=0, high=1, name="omega")
    bar = models.ColorBar(color_mapper=shades, title=_BAR, width=10, padding=4)
    plot.add_layout(bar, "right")
    blanks = dict.fromkeys(("circle", "longest_lived", *_SYMMETRY), _EMPTY)
    blanks |= dict.fromkeys(("ensemble", *MANIFOLDS), _EMPTY)
    blanks |= {"variance": {"n": [], "variance": []}, "lobes": {"x": [], "y": [], "fill": []}}
    blanks |= {"cycles": _NO_CYCLES, "profile": _EMPTY}
    lines = {name: models.ColumnDataSource(columns, name=name) for name, columns in blanks.items()}
    for name, dash in zip(_SYMMETRY, ("solid", "dashed"), strict=True):
        plot.add_glyph(lines[name], models.Line(x="x", y="y", line_color="#888888", line_dash=dash))
    lobes = models.Patches(xs="x", ys="y", fill_color="fill", fill_alpha=0.6, line_color=None)
    plot.add_glyph(lines["lobes"], lobes)
    for name, colour in zip(MANIFOLDS, _LOBES, strict=True):
        plot.add_glyph(lines[name], models.Line(x="x", y="y", line_color=colour, line_width=1.5))
    plot.scatter("x", "y", source=lines["ensemble"], size=2, color=STRONG)
    plot.add_glyph(lines["circle"], models.Line(x="x", y="y", line_color=STRONG, line_width=3))
    dots = models.Scatter(
        x="x", y="y", size=4, line_color="white", line_width=0.5, fill_color="black"
    )
    plot.add_glyph(lines["longest_lived"], dots)
    markers = models.Scatter(
        x="x", y="y", marker="marker", size=7, fill_color="fill", line_color="#888888"
    )
    markers = plot.add_glyph(lines["cycles"], markers)
    tips = [("orbit", "@orbit"), ("x, y", "@x{0.0000000}, @y{0.0000000}")]
    plot.add_tools(models.HoverTool(renderers=[markers], tooltips=tips))
    return plot, image, bar, lines


def _profile(plot, source):
    """Return the narrow figure beside the portrait: ω of the orbits on a vertical line in it."""
    how = {"width": 110, "tools": "save", "toolbar_location": "above", "x_axis_label": "ω"}
    how |= {"sizing_mode": "stretch_height", "name": "rotation numbers"}
    how["stylesheets"] = ["@media (max-width: 600px) { :host { display: none } }"]
    beside = figure(y_range=plot.y_range, **how)
    beside.toolbar.logo, beside.xaxis[0].ticker.desired_num_ticks = None, 2
    beside.yaxis.visible = beside.grid.visible = False
    beside.axis.axis_label_text_font_style = "normal"
    beside.scatter("x", "y", source=source, size=3, color="#0072B2")
    return beside


_LOBES = "#E69F00", "#56B4E9"  # and the unstable and the stable manifold
_TICKS = ".bk-input-group { flex-wrap: wrap } label { margin-right: 1em }"
_SYMMETRY = "symmetry", "second symmetry"
_NO_CYCLES = {"x": [], "y": [], "marker": [], "fill": [], "orbit": []}
_MARKERS = {"minimax": ("circle", "white"), "minimizing": ("square", "black")}


def _box(plot):
    """Return left, bottom, width and height of what the figure shows, one cell at most."""
    (left, right), (bottom, top) = sides_of(plot)
    return left, bottom, min(right - left, 1.0), min(top - bottom, 1.0)


def _computed(kappa, box, added, every, with_lines, shape):
    """Yield the portrait, its picture, symmetry lines, and the orbits added in words."""
    curves = _symmetry_lines(kappa, box) if with_lines else (_EMPTY, _EMPTY)
    missing = (
        "" if curves else "The forcing has no symmetry centre, so there are no symmetry lines."
    )
    left, bottom, width, height = box
    y = bottom + height * (np.arange(_PROFILE) + 0.5) / _PROFILE
    omega, _ = orbits.rotation_number(kappa, left + width / 2, y, 2000)
    profile = {"x": omega, "y": y}
    told = [
        f"The one added at ({x:.6g}, {y:.6g}): {orbit_words(kappa, x, y)}." for x, y in added[-1:]
    ]
    for portrait in portraits(kappa, box, added, every):
        if portrait is None:
            yield None
        else:
            words = " ".join(filter(None, [_sentences(portrait), *told, missing]))
            pixels = _pixels(portrait, shape, len(added))
            yield portrait, pixels, curves or (_EMPTY, _EMPTY), profile, words


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


def _sentences(portrait):
    chaotic = int(np.isnan(portrait.omega).sum())
    return f"{portrait.sizes['orbit']} orbits, {chaotic} of them chaotic (grey)."


def _symmetry_lines(kappa, box):
    """Return the lines of each of the two centres; None where the forcing has no centre."""
    try:
        x, y = symmetries.symmetry_lines(kappa, np.linspace(0, 1, 4001))
    except ValueError:
        return None
    gap = np.full((4, 1), np.nan)  # between one line and the next
    x, y = np.hstack([x, gap]), np.hstack([y, gap])
    pairs = (in_box(box, x[i : i + 2].ravel(), y[i : i + 2].ravel()) for i in (0, 2))
    return [dict(zip("xy", pair, strict=True)) for pair in pairs]


def _decisive(kappa, found):
    """Return what is left of the last circle, {"circle" or "longest_lived": (x, y)}, and its name.

    Empty where there is nothing to show.
    """
    if found.circle is not None:
        x, y = found.circle
        n, more = x.size, max(x.size, _FINE)
        x = fourier.resample(x - np.arange(n) / n, more) + np.arange(more) / more
        name = f"Certified circle, ω = {found.boundary.omega}"
        return {"circle": (x, fourier.resample(y, more))}, name
    if found.answer is Answer.TRANSPORT:
        x, y, steps = barriers.remnant(kappa, max(1000, int(2 * found.steps)))
        traced = orbits.orbit(kappa, x, y, int(min(steps, _MOST_STEPS)))
        name = f"Not a barrier: the start that lives longest, {steps:g} steps (dots)"
        return {"longest_lived": traced}, name
    return {}, ""


def _cycles(kappa, omega, fraction, box):
    """Return the points of the orbits of the convergents of ω, and of p/q; the manifolds of p/q if
    there is a box to draw them in; and words on p/q."""
    near = (
        [] if omega is None else takewhile(lambda f: f.denominator <= _MOST_Q, convergents(omega))
    )
    found = periodic_orbits(kappa, [f for f in near if f.denominator > 1])
    own = [] if fraction is None else periodic_orbits(kappa, [fraction])
    columns = [_NO_CYCLES]
    for one, family, x, y, residue in found + own:
        words = *_MARKERS[family], f"{one} ({family}), R = {residue:.4g}"
        rows = x, y, *np.repeat(words, x.size).reshape(3, -1)
        columns.append(dict(zip(_NO_CYCLES, rows, strict=True)))
    said = "" if fraction is None else cycles_words(fraction, own)
    points = {name: np.concatenate([part[name] for part in columns]) for name in _NO_CYCLES}
    curves, more = ({}, "") if box is None else resonance(kappa, fraction, box)
    return points, curves, f"{said} {more}"


def _line(box, x, y):
    """Return a curve as far as it is in the box, with gaps where it leaves."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    stride = 1 + in_box(box, x, y)[0].size // _MOST_POINTS
    return dict(zip("xy", in_box(box, x[::stride], y[::stride]), strict=True))


def _lobes(box, lobes):
    """Return the edges of lobes, wherever their images mod 1 may be in the box."""
    left, bottom, _, _ = box
    places = [
        (x + i - np.floor(x[0] - left), y + j - np.floor(y[0] - bottom))
        for x, y in lobes
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
    ]
    colours = [_LOBES[n // 9 % 2] for n in range(len(places))]
    return {"x": [x for x, _ in places], "y": [y for _, y in places], "fill": colours}


def _dots(box, x, y, **more):
    """Return the points in the box, with what belongs to them."""
    left, bottom, width, height = box
    u, v = (np.asarray(x, float) - left) % 1, (np.asarray(y, float) - bottom) % 1
    here = (u <= width) & (v <= height)
    rest = {name: np.asarray(values)[here].tolist() for name, values in more.items()}
    return {"x": left + u[here], "y": bottom + v[here], **rest}
