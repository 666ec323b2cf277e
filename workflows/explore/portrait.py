"""The phase portrait at the selected point: orbits, last circle or longest-lived start."""

from functools import partial

import numpy as np
from bokeh import models
from bokeh.events import Tap
from bokeh.palettes import Viridis256
from bokeh.plotting import figure

from nasm import orbits, survivors, symmetries
from nasm.circles import fourier
from nasm.numbers import distinct_convergents
from nasm.verdicts import Answer
from workflows.explore import widgets
from workflows.explore.state import ORBITS, fraction_of, orbits_of, orbits_text
from workflows.figures.colours import CHAOTIC, LIGHTEST, N_OF_OMEGA, VERMILION
from workflows.figures.phase_space import ends, places
from workflows.shared.on_demand import MANIFOLDS, resonance, spreading
from workflows.shared.orbit_sentences import describe_orbit, describe_residue
from workflows.shared.phase_space import in_box, periodic_orbits, portraits
from workflows.shared.verdict_sentences import forcing_text, lifetime_text

_PIXELS = 560  # along each side, until the browser reports its size
_MAX_PIXELS = 1200
_MAX_STEPS = 5000  # maximum number of steps of the longest-lived start's orbit
_DOT_SPACING = 8  # pixels between dots of that orbit, on average, so that they do not form a line
_MAX_POINTS = 5000  # maximum number of points drawn for a curve in the box
_FINE_POINTS = 2**15  # minimum number of points on a whole circle
_PROFILE_STARTS = 200  # on the vertical midline of the view, for the profile of ω
_MAX_Q = 34  # largest denominator of the convergents whose orbits are shown
_BESIDE, _NARROW = 110, "@media (max-width: 600px) { :host { display: none } }"
_BAR = "ω, rotation number per step; grey: chaotic"
_LOBES = "#E69F00", "#56B4E9"  # also the colours of the unstable and the stable manifold
_TICKS = ".bk-input-group { flex-wrap: wrap } label { margin-right: 1em }"
_GREY = "#888888"
_COLOURS = [Viridis256[int(256 * share)] for share in np.linspace(0, LIGHTEST, N_OF_OMEGA)]
_SYMMETRY = "symmetry", "second symmetry"
_LOBE = {"xs": "x", "ys": "y", "fill_color": "fill", "fill_alpha": 0.6, "line_color": None}
_DOT = {"size": 4, "line_color": "white", "line_width": 0.5, "fill_color": "black"}
_ORBIT = {"marker": "marker", "size": 7, "fill_color": "fill", "line_color": _GREY}
_MARKS = {
    "symmetry": lambda: [models.Line(line_color=_GREY)],
    "second symmetry": lambda: [models.Line(line_color=_GREY, line_dash="dashed")],
    "lobes": lambda: [models.Patches(**_LOBE)],
    "unstable": lambda: [models.Line(line_color=_LOBES[0], line_width=1.5)],
    "stable": lambda: [models.Line(line_color=_LOBES[1], line_width=1.5)],
    "ensemble": lambda: [models.Scatter(size=2, fill_color=VERMILION, line_color=VERMILION)],
    "circle": lambda: [models.Line(line_color=VERMILION, line_width=3)],
    "longest_lived": lambda: [models.Scatter(**_DOT)],
    "cycles": lambda: [models.Scatter(**_ORBIT)],
}
_TIPS = [("orbit", "@orbit"), ("x, y", "@x{0.0000000}, @y{0.0000000}")]
_MARKERS = {"minimax": ("circle", "white"), "minimizing": ("square", "black")}
_CYCLES = dict.fromkeys(("cycles", "lobes", *MANIFOLDS))
_NOTHING = _CYCLES | dict.fromkeys(("circle", "longest_lived", "ensemble"))


class PortraitPanel:
    """The right panel: the portrait, a message and input fields; `children` are its rows."""

    def __init__(self, state, work):
        self.state, self.work, self.portrait = state, work, None
        self.known, self.messages = _NOTHING, {}  # curves and points before clipping; notes on them
        self.plot, self.bar, self.image = _figure(state)
        self.show = partial(widgets.show, self.plot, _MARKS)
        self.profile = models.ColumnDataSource({"x": [], "y": []}, name="profile")
        self.message = models.Div(sizing_mode="stretch_width", min_height=22)
        self.portraits = work.latest("portrait", "portrait")
        names = "last circle", "periodic orbits", "ensemble"
        self.traces, self.cycles, self.ensemble = map(work.latest, names)
        options = {"title": "Orbits added, x, y; …", "placeholder": "0.5, 0.3", "width": 260}
        self.added = models.TextInput(value=orbits_text(state.orbits), **options)
        options = {"title": "Orbits of a fraction p/q", "placeholder": "3/8", "width": 150}
        fraction = models.TextInput(value=state.fraction, **options)
        self.plot.on_event(Tap, self._add)
        soon = widgets.on_view(self.plot, work, self._refresh)
        state.on("point", self._move)
        state.on("point orbits show", soon)
        state.on("show fraction", self._find_cycles)
        state.on("verdict", self._judge)
        state.datasets["phase space"] = self._dataset
        soon()
        options = {"inline": True, "stylesheets": [_TICKS], "styles": {"max-width": "92vw"}}
        spread = models.Button(label="spread an ensemble from the middle")
        spread.on_click(self._spread)
        added = widgets.field(self.added, lambda text: state.take(orbits=orbits_of(text)))
        ticks = widgets.boxes(state, ORBITS, **options)
        fraction = widgets.field(fraction, state.seek)
        below = models.Row(ticks, added, fraction, spread)
        styles, stretch = {"flex-wrap": "nowrap", "gap": "0"}, {"sizing_mode": "stretch_width"}
        profile = _profile(self.plot, self.profile)
        pictures = models.Row(self.plot, profile, styles=styles, **stretch)
        self.beneath = models.Column(**stretch)  # for curves that are computed on request
        self.children = pictures, self.message, below, self.beneath

    def _dataset(self):
        """Return the portrait with the last circle, or with the longest-lived start."""
        portrait = self.portrait
        if portrait is None:
            return None
        for name in ("circle", "longest_lived"):
            source = self.plot.select_one({"name": name})
            if source and len(source.data["x"]):
                curve = {f"{name}_{axis}": (name, source.data[axis]) for axis in "xy"}
                portrait = portrait.assign(curve)
        title = forcing_text(self.state.kappa, (self.state.plane, self.state.point))
        parts = filter(None, [title, self.messages.get("last circle")])
        return portrait.assign_attrs(title=", ".join(parts))

    def _refresh(self):
        state, box = self.state, _box(self.plot)
        x, y = widgets.sides_of(self.plot)
        state.take(x=x, y=y)
        every = 1 if "kicks" in state.show else None
        args = list(state.orbits), every, "symmetry" in state.show, _shape(self.plot)
        self.portraits.submit(_computed, state.kappa, box, *args, done=self._show)
        self._show_known()

    def _show(self, result):
        self.portrait, pixels, curves, message = result
        if self.portrait.attrs["kappa"] == self.state.kappa.tolist():
            self.state.drawn = self.state.point
        self.image.data = _image(pixels, *self.portrait.attrs["box"])
        self.profile.data = curves.pop("profile")
        for name, curve in curves.items():
            self.show(name, curve)
        low, high = ends(self.portrait)
        self.bar.color_mapper.update(low=low, high=high)
        self._write({"portrait": message})

    def _write(self, messages):
        self.messages |= messages
        order = "last circle", "portrait", "periodic orbits", "ensemble"
        name, *rest = map(self.messages.get, order)
        colour = VERMILION if self.known["circle"] else "inherit"
        name = name and f'<b style="color: {colour}">{name}</b>.'
        self.message.text = f'<span role="status">{" ".join(filter(None, [name, *rest]))}</span>'

    def _move(self):
        """Forget the orbits of the previous forcing."""
        self.known, self.messages = _NOTHING, {"portrait": self.messages.get("portrait")}
        self.traces.cancel()
        self.ensemble.cancel()
        self.beneath.children = []
        self._find_cycles()

    def _judge(self):
        state = self.state
        if state.verdict is not None:
            self.traces.submit(_decisive, state.kappa, state.verdict, done=self._add_known)
            self._find_cycles()

    def _find_cycles(self):
        self._add_known((_CYCLES, {"periodic orbits": ""}))
        state = self.state
        omega = state.verdict and "cycles" in state.show and state.verdict.boundary.omega
        fraction = fraction_of(state.fraction)
        self.cycles.cancel()
        if omega or fraction is not None:
            box = _box(self.plot) if "manifolds" in state.show and fraction is not None else None
            self.cycles.submit(_cycles, state.kappa, omega, fraction, box, done=self._add_known)

    def _spread(self):
        """Let an ensemble spread from the middle of the view."""
        logs = {"x_axis_type": "log", "y_axis_type": "log"}
        plot = widgets.small("spreading of the ensemble", "step", "<(y - y₀)²>", **logs)
        source = models.ColumnDataSource({"n": [], "variance": []}, name="variance")
        plot.line("n", "variance", source=source, line_width=2)
        self.beneath.children = [plot]

        def show(result):
            points, source.data, message = result
            self._add_known(({"ensemble": points}, {"ensemble": message}))

        self.ensemble.submit(spreading, self.state.kappa, _box(self.plot), done=show)

    def _add_known(self, result):
        known, messages = result
        self.known = self.known | known
        self._write(messages)
        self._show_known()

    def _show_known(self):
        """Draw the parts of the known curves and points that are in the box."""
        box = _box(self.plot)
        for name, columns in self.known.items():
            shown = _CUTS.get(name, _line)(box, **columns) if columns else None
            if shown and name == "longest_lived":
                max_dots = _shape(self.plot)[1] // _DOT_SPACING
                shown = {axis: values[:max_dots] for axis, values in shown.items()}
            self.show(name, shown, _TIPS if name == "cycles" else None)

    def _add(self, event):
        x, y = widgets.rounded(event, np.array(_box(self.plot)[2:]) / _PIXELS)
        self.added.value = orbits_text((*self.state.orbits, (x % 1, y)))


def _figure(state):
    """Return the figure, its colour bar, and the source of its image."""
    options = {"max_zoom": 1.0, "active_drag": "box_zoom", "aspect_ratio": 1.13}
    options["name"] = "phase portrait"
    plot = widgets.picture(state, "xy", ("x (turns)", "y (mod 1)"), **options)
    blank = _image(np.zeros((1, 1), np.uint8), *_box(plot))
    image = models.ColumnDataSource(blank, name="orbits")
    palette = ["#00000000", CHAOTIC, *_COLOURS]  # colours of the byte values
    mapper = models.LinearColorMapper(palette, low=-0.5, high=255.5, name="omega")
    plot.image("pixels", "x", "y", "w", "h", source=image, color_mapper=mapper)
    shades = models.LinearColorMapper(_COLOURS, low=0, high=1, name="omega")
    return plot, widgets.add_bar(plot, shades, _BAR), image


def _profile(plot, source):
    """Return the narrow figure beside the portrait: ω of orbits that start on a vertical line."""
    options = {"width": _BESIDE, "tools": "save", "toolbar_location": "above", "x_axis_label": "ω"}
    options["y_axis_label"] = "y (mod 1)"
    options |= {"sizing_mode": "stretch_height", "name": "rotation numbers"}
    beside = figure(y_range=plot.y_range, stylesheets=[_NARROW], **options)
    beside.toolbar.styles = {"min-width": "60px"}  # wide enough for its only tool
    beside.xaxis[0].ticker.desired_num_ticks = 2
    beside.yaxis.major_label_text_font_size = "0px"  # the portrait beside it has the same axis
    beside.grid.visible = False
    beside.scatter("x", "y", source=source, size=3, color="#0072B2")
    return beside


def _box(plot):
    """Return left, bottom, width and height of the view, limited to one unit cell."""
    (left, right), (bottom, top) = widgets.sides_of(plot)
    return left, bottom, min(right - left, 1.0), min(top - bottom, 1.0)


def _shape(plot):
    return widgets.pixels_of(plot, _MAX_PIXELS, (_PIXELS, _PIXELS))


def _image(pixels, left, bottom, width, height):
    return {"pixels": [pixels], "x": [left], "y": [bottom], "w": [width], "h": [height]}


def _computed(kappa, box, added, every, with_lines, shape):
    """Yield (portrait, its picture, {name: curve}, message), with more and more points."""
    curves, notes = dict.fromkeys(_SYMMETRY), []
    if with_lines:
        curves |= _symmetry_lines(kappa, box)
        if not any(curves.values()):
            notes = ["The forcing has no symmetry centre, so there are no symmetry lines."]
    for x, y in added[-1:]:
        notes.insert(0, f"The orbit added at ({x:.6g}, {y:.6g}): {describe_orbit(kappa, x, y)}.")
    left, bottom, width, height = box  # profile orbits start on the box's vertical midline
    y = bottom + height * (np.arange(_PROFILE_STARTS) + 0.5) / _PROFILE_STARTS
    omega, _ = orbits.rotation_number(kappa, left + width / 2, y, 2000)
    curves["profile"] = {"x": omega, "y": y}
    for portrait in portraits(kappa, box, added, every):
        chaotic = int(np.isnan(portrait.omega).sum())
        count = f"{portrait.sizes['orbit']} orbits, {chaotic} of them chaotic (grey)."
        yield portrait, _pixels(portrait, shape, len(added)), {**curves}, " ".join([count, *notes])


def _pixels(portrait, shape, n_added):
    """Return the picture of a portrait: 0 for empty, 1 for chaotic, else 2 + the colour's index."""
    left, bottom, width, height = portrait.attrs["box"]
    which = portrait.which.values
    value = (places(portrait) + 2).astype(np.uint8)[which]
    column = np.minimum((portrait.x.values - left) / width * shape[1], shape[1] - 1).astype(int)
    row = np.minimum((portrait.y.values - bottom) / height * shape[0], shape[0] - 1).astype(int)
    pixels = np.zeros(shape, np.uint8)
    for inside in (value == 1, value > 1):
        pixels[row[inside], column[inside]] = value[inside]
    inside = which >= portrait.sizes["orbit"] - n_added  # added orbits are drawn larger
    for down, right in np.ndindex(3, 3) if n_added else ():
        rows = np.clip(row[inside] + down - 1, 0, shape[0] - 1)
        pixels[rows, np.clip(column[inside] + right - 1, 0, shape[1] - 1)] = value[inside]
    return pixels


def _symmetry_lines(kappa, box):
    """Return the symmetry lines of both centres; {} if the forcing has no symmetry centre."""
    try:
        x, y = symmetries.symmetry_lines(kappa, np.linspace(0, 1, 4001))
    except ValueError:
        return {}
    # NaN separates one line from the next.
    pairs = np.insert([x, y], x.shape[1], np.nan, axis=2).reshape(2, 2, -1).swapaxes(0, 1)
    return {name: _curve(in_box(box, *pair)) for name, pair in zip(_SYMMETRY, pairs, strict=True)}


def _decisive(kappa, verdict):
    """Return {"circle" or "longest_lived": curve} and its description, for a verdict.

    Both are empty if there is nothing to show.
    """
    if verdict.circle is not None:
        x, y = verdict.circle
        n, more = x.size, max(x.size, _FINE_POINTS)
        x = fourier.resample(x - np.arange(n) / n, more) + np.arange(more) / more
        name = f"Certified circle, ω = {verdict.boundary.omega}"
        return {"circle": _curve((x, fourier.resample(y, more)))}, {"last circle": name}
    if verdict.answer is Answer.TRANSPORT:
        x, y, steps = survivors.longest_lived_start(kappa, max(1000, int(2 * verdict.steps)))
        traced = orbits.orbit(kappa, x, y, int(min(steps, _MAX_STEPS)))
        lifetime = lifetime_text(kappa, steps)
        name = f"No barrier: the longest-lived start is eliminated after {lifetime} (dots)"
        return {"longest_lived": _curve(traced)}, {"last circle": name}
    return {}, {}


def _cycles(kappa, omega, fraction, box):
    """Return the periodic orbits for the convergents of ω and for p/q, and a message about p/q.

    If a box is given, the curves include the manifolds of p/q.
    """
    fractions = distinct_convergents(omega, _MAX_Q) if omega else ()
    of_convergents, missing = periodic_orbits(kappa, [f for f in fractions if f.denominator > 1])
    own, lost = periodic_orbits(kappa, [] if fraction is None else [fraction])
    points = {name: [] for name in ("x", "y", "marker", "fill", "orbit")}
    for frequency, family, x, y, residue in of_convergents + own:
        labels = *_MARKERS[family], f"{frequency} ({family}), R = {residue:.4g}"
        values = x, y, *([label] * x.size for label in labels)
        for name, more in zip(points, values, strict=True):
            points[name] += [*more]
    kinds = [f"{family} orbit: {describe_residue(residue)}" for _, family, _, _, residue in own]
    notes = [f"{fraction}: {'; '.join(kinds)}."] if own else []
    curves, more = ({}, "") if box is None else resonance(kappa, fraction, box)
    notes = " ".join([*notes, more, *missing, *lost]).strip()
    return {"cycles": points, **curves}, {"periodic orbits": notes}


def _curve(points):
    return dict(zip("xy", points, strict=True))


def _line(box, x, y):
    """Clip a curve to the box, with gaps where it leaves the box."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    stride = 1 + in_box(box, x, y)[0].size // _MAX_POINTS
    return _curve(in_box(box, x[::stride], y[::stride]))


def _lobes(box, x, y):
    """Return the edges of lobes, with all images mod 1 that may be in the box."""
    left, bottom, _, _ = box
    shown = {"x": [], "y": [], "fill": []}
    for n, (u, v) in enumerate(zip(x, y, strict=True)):
        for i, j in np.ndindex(3, 3):
            shown["x"].append(u + i - 1 - np.floor(u[0] - left))
            shown["y"].append(v + j - 1 - np.floor(v[0] - bottom))
            shown["fill"].append(_LOBES[n % 2])
    return shown


def _dots(box, x, y, **more):
    """Select the points in the box, with their other columns."""
    left, bottom, width, height = box
    u, v = (np.asarray(x, float) - left) % 1, (np.asarray(y, float) - bottom) % 1
    inside = (u <= width) & (v <= height)
    rest = {name: np.asarray(values)[inside].tolist() for name, values in more.items()}
    return {"x": left + u[inside], "y": bottom + v[inside], **rest}


_CUTS = {"lobes": _lobes, **dict.fromkeys(("cycles", "longest_lived", "ensemble"), _dots)}
