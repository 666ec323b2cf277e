"""Known breakups of the last circle on rays, and the rays still to be computed for a view.

Breakups are computed as in arXiv:1606.04824, Sec. VI, by `nasm.barriers`. The result for a ray also
applies to its images under the symmetries of the plane.
"""

import re
from collections import namedtuple
from functools import partial
from math import ceil, inf, nan
from time import monotonic, sleep

import numpy as np

from nasm import barriers, periodic
from nasm.numbers import moebius, nobles_near, parse
from nasm.texts import abbreviate, parse_float
from pipeline.sweep.progress import plural
from workflows.explore.work import spread
from workflows.figures.colours import circle_class, circle_style, longest_arcs
from workflows.shared.tables import columns, dataset

# Largest gap in degrees between rays; smallest number of gaps across a view without the origin.
_FIRST = 15.0, 4  # for the first rays
_FOLLOWED = 1.0, 64  # for the rays on which a circle is followed
_MAX_MISS = 1.0  # pixels by which the drawn line may miss the boundary between rays, as estimated
_MAX_CHANGE = 32.0  # pixels between rays with different last circles, so that colours are right
_MIN_WIDTH = 1.0  # pixels between rays; narrower gaps stay as they are, for example at a jump
_MAX_RAYS = 150  # for one view, if scales scatter by more than their errors
_DECIMALS, _SAME = 7, 2e-7  # of angles in degrees; rays that differ by rounding are the same
_RAYS_PER_CALL = 8  # on which a circle is followed
_MIN_TOL, _MAX_TOL = 1e-4, 1e-3  # relative widths of brackets; between these, a pixel at scale 1
_SHORT_PERIODS, _LONG_PERIODS = 300, 1500  # longest periods of orbits for the followed circle
_MIN_RAYS = 8  # with at most this many rays in a view, the legend also names circles outside it
_PICTURE_PAUSE = 1.0  # seconds between successive pictures
_START_DELAY = 0.5  # seconds to wait for a newer view, because computing a ray cannot be stopped
_MAX_NUMBER, _PRECISION = 1e6, 2.0**-50  # size and relative precision of decimal rotation numbers
_MAX_GAP = 25.0  # largest angle in degrees between rays that a line connects

_COLUMNS = {
    "scale": "scale at which the last circle breaks",  # NaN if unknown
    "error": "error of scale",
    "circle": "rotation number of the last circle, per step, exact",  # "" if unknown
    "omega": "rotation number of the last circle, per step, as a float",
}
Breakup = namedtuple("Breakup", _COLUMNS)  # the breakup of the last circle on a ray


class Rays:
    """Known breakups in a plane; `known` is {angle in degrees, from 0 to 360: Breakup}."""

    def __init__(self, plane):
        self.plane, self.known = plane, {}
        # ω and its image _reflection - ω have similar boundaries, and share a colour.
        self._reflection = max(shift for *_, shift in plane.symmetries)

    def add(self, table):
        """Add the rays of a table returned by `barrier.boundary` or `barrier.unfolded`."""
        names = "angle", "critical_scale", "error", "circle", "omega"
        for angle, *values in zip(*(table[name].values.tolist() for name in names), strict=True):
            self.known[angle % 360] = Breakup(*values)

    def lines(self, view):
        """Return (boundary, legend) for a view.

        The boundary consists of columns a, b and colour, with one piece of the line per ray; it is
        None if the breakup is known on fewer than two rays. The legend is {ω as text: colour} for
        circles that break last over more than 1% of the angle in view.
        """
        angles, points, circles = self._points()
        if angles.size < 2:
            return None, {}
        inside = (view.a[0] <= points.real) & (points.real <= view.a[1])
        inside &= (view.b[0] <= points.imag) & (points.imag <= view.b[1])
        seen = inside if inside.sum() > _MIN_RAYS else np.ones_like(inside)
        classes = self._classes(circles)
        shades = [circle_style(text)["color"] for text in classes]
        named = longest_arcs(angles[seen], classes[seen])
        colours = {text: circle_style(text)["color"] for text in named}
        is_adjacent = (np.roll(angles, -1) - angles) % 360 <= _MAX_GAP  # to the next ray
        after = np.where(is_adjacent, (points + np.roll(points, -1)) / 2, points)
        before = np.where(np.roll(is_adjacent, 1), np.roll(after, 1), points)
        pieces = np.stack([before, points, after], axis=1)
        # Lists, because Bokeh sends each array in a separate message.
        return {"a": pieces.real.tolist(), "b": pieces.imag.tolist(), "colour": shades}, colours

    def _points(self):
        """Return angles, points as complex numbers, and circles of rays with a known breakup."""
        rays = [(k, ray) for k, ray in sorted(self.known.items()) if np.isfinite(ray.scale)]
        angles = np.array([angle for angle, _ in rays])
        scales, circles = ([getattr(ray, name) for _, ray in rays] for name in ("scale", "circle"))
        return angles, scales * np.exp(1j * np.deg2rad(angles)), np.array(circles, dtype=object)

    def excess(self, a, b):
        """Return the relative distance of points (a, b) beyond the boundary.

        The result has the shape of a and b; it is NaN unless nearby rays on both
        sides of a point are known.
        """
        angles, points, _ = self._points()
        if not angles.size:
            return np.full(np.shape(a), np.nan)
        angle, scales = np.rad2deg(np.arctan2(b, a)) % 360, np.abs(points)
        after = np.searchsorted(angles, angle) % angles.size
        gap, part = (angles[after] - angles[after - 1]) % 360, (angle - angles[after - 1]) % 360
        # Distance from the origin to the chord between neighbouring points of the boundary.
        one, other = np.sin(np.deg2rad([part, gap - part]))
        with np.errstate(divide="ignore", invalid="ignore"):
            chord = np.sin(np.deg2rad(gap)) / (one / scales[after] + other / scales[after - 1])
        return np.hypot(a, b) / np.where((part <= gap) & (gap <= _MAX_GAP), chord, np.nan) - 1

    def nearest(self, a, b):
        """Return the Breakup on the ray closest to a point; None if no ray is known."""
        angles, *_ = self._points()
        if not angles.size:
            return None
        away = (angles - np.rad2deg(np.arctan2(b, a)) + 180) % 360 - 180
        return self.known[angles[np.argmin(abs(away))]]

    def table(self):
        """Return all known rays as a Dataset with the dim angle; None if there are none."""
        from pipeline.cubes.cube import angles_of_rays

        if not self.known:
            return None
        angles = sorted(self.known)
        rays = zip(*(self.known[angle] for angle in angles), strict=True)
        variables, coords = columns("angle", _COLUMNS, rays), {"angle": angles_of_rays(angles)}
        return dataset("Where the last circle breaks", coords, variables, self.plane.record)

    def missing(self, view, started=()):
        """Return the rays to compute next for a view, in degrees, one for each set of images.

        These are a few rays across the view at first. Then gaps are halved in which the line is
        estimated to miss the boundary by more than a pixel, or in which the last circle changes.

        started : rays that were returned before, and may not be known yet; they are left out.
        """
        angles, spacing = _across(view, *_FIRST)
        return self._unknown(angles, spacing / 4, started) or self._unknown(
            self._between(view), _SAME, started
        )

    def _between(self, view):
        """Return the middles of the gaps in which the line through the known points is too coarse.

        The bend at a point is its distance from the chord between its neighbours. A smooth curve
        is within about bend · h / 4g of the chord of the gap h, if g is the gap on the other side
        of the point.
        """
        angles, points, circles = self._points()
        if angles.size < 3:
            return angles[:0]
        gap = (np.roll(angles, -1) - angles) % 360  # from each point to the next
        size, pixel = np.array(view.shape[::-1])[:, None], view.pixel.min()
        ends = np.stack([points.real - view.a[0], points.imag - view.b[0]])
        ends /= view.pixel[:, None]  # in pixels
        after, before = np.roll(ends, -1, axis=1), np.roll(ends, 1, axis=1)
        (x, y), (u, v) = after - ends, after - before
        bend = np.abs(x * v - y * u) / np.maximum(np.hypot(u, v), np.finfo(float).tiny)
        miss = gap / 4 * np.maximum(bend / np.roll(gap, 1), np.roll(bend, -1) / np.roll(gap, -1))
        classes = self._classes(circles)
        error = np.fmax(0, [self.known[angle].error for angle in angles.tolist()]) / pixel
        error = np.max([np.roll(error, k) for k in (1, 0, -1, -2)], axis=0)  # of the four points
        is_coarse = miss > np.maximum(_MAX_MISS, error)
        changes = classes != np.roll(classes, -1)
        is_coarse |= changes & (np.hypot(x, y) > np.maximum(_MAX_CHANGE, error))
        left, right = np.minimum(ends, after), np.maximum(ends, after)
        is_beside = ((right < 0) | (left > size)).any(axis=0)
        every, middles = np.array(sorted(self.known)), []
        for i in np.flatnonzero(is_coarse & ~is_beside & (gap <= _MAX_GAP)):
            # Rays without a known breakup may divide the gap into parts; halve the widest one.
            parts = (every - angles[i]) % 360
            parts = np.sort(parts[parts <= gap[i]])
            widest = np.argmax(np.diff(parts))
            width = parts[widest + 1] - parts[widest]
            if np.deg2rad(width) * np.abs(points[i]) > _MIN_WIDTH * pixel:
                middles.append(angles[i] + parts[widest] + width / 2)
        return np.array(middles)

    def _classes(self, circles):
        return np.array([circle_class(circle, self._reflection) for circle in circles])

    def _unknown(self, angles, apart, started):
        """Return the rays that are more than `apart` degrees from all known and started rays.

        They are ordered so that the first few are spread evenly.
        """
        folded = np.unique(self.plane.fold(angles)[0].round(_DECIMALS))
        folded = folded[np.diff(folded, prepend=-inf) > _SAME]  # images of a ray are rounded
        taken = np.array([*self.known, *started])
        if taken.size:
            gaps = np.abs((folded[:, None] - taken + 180) % 360 - 180).min(axis=1)
            folded = folded[gaps > apart]
        spread_evenly = np.argsort(np.arange(folded.size) * 0.6180339887 % 1)
        return folded[spread_evenly].tolist()


def computed(client, rays, view, asked):
    """Compute the rays of a view; yield (`Rays.known`, number of these rays as text) for a picture.

    None is yielded while no picture is due. client : function that returns a dask Client. rays :
    the Rays known so far. asked : `monotonic` time at which the user asked for the view.
    """
    own, started = Rays(rays.plane), []
    own.known |= rays.known
    if not own.missing(view):
        return
    sleep(max(0.0, asked + _START_DELAY - monotonic()))
    yield None
    results = spread(client(), _calls(own, view, started), leaves_one=True, priority=-1)
    yield from _pictures(
        results,
        lambda _, found: own.known.update(found),
        lambda: (dict(own.known), plural(len(started), "ray")),
    )


def _calls(rays, view, started):
    """Yield the calls that compute the missing rays of a view, as for `work.spread`.

    rays : the Rays known; results are added to them in the meantime. started : list to which the
    angle of each ray is added when its call is yielded.
    """
    tol = _tolerance(view)
    while len(started) < _MAX_RAYS:
        angles = rays.missing(view, started)[: _MAX_RAYS - len(started)]
        for angle in angles:
            started.append(angle)
            yield None, _on_ray, rays.plane, angle, tol
        if not angles:
            yield None  # until one of the rays that are being computed is known


def circle(client, plane, omega, view):
    """Yield the known part of the line on which the circle of ω (a string) breaks, or None."""
    angles, _ = _across(view, *_FOLLOWED)
    folded, where = np.unique(plane.fold_keeping_circles(angles), return_inverse=True)
    scale, call = np.full(folded.size, np.nan), (_circle_on_rays, plane, omega)
    parts = np.array_split(np.arange(folded.size), ceil(folded.size / _RAYS_PER_CALL))
    q_max = _SHORT_PERIODS if _tolerance(view) == _MAX_TOL else _LONG_PERIODS
    calls = ((part, *call, folded[part], q_max) for part in parts)

    def line():
        points = scale[where] * np.exp(1j * np.deg2rad(angles))
        return {"a": points.real, "b": points.imag}

    results = spread(client(), calls, leaves_one=True, priority=-1)
    yield from _pictures(results, partial(np.put, scale), line)


def _pictures(results, accept, picture):
    """Call accept(key, result) for each result of `work.spread`, and yield pictures or None.

    A picture is due at the end, and about once a second until then, because drawing it takes longer
    than computing a ray. None is yielded while no picture is due.
    """
    shown = monotonic()
    for ended in results:
        if ended:
            accept(*ended)
        if late := monotonic() - shown > _PICTURE_PAUSE:
            shown = monotonic()
        yield picture() if late else None
    yield picture()


def named_by(text):
    """Return an irrational number as text, and a message.

    A decimal number is replaced by a noble number that rounds to it; the message names this number.
    Other strings are returned unchanged, with the message "". A rational number raises ValueError.
    """
    digits = re.fullmatch(r"[+-]?\d+\.(\d+)", text)
    if not digits and text and parse(text).is_rational:
        raise ValueError(
            f"{abbreviate(text)} is rational, and has no circle; write an irrational number, like "
            "[0;2,(1)]"
        )
    if not digits:
        return text, ""
    value = parse_float(text)
    if not abs(value) < _MAX_NUMBER:
        raise ValueError(f"{abbreviate(text)} must be below {_MAX_NUMBER:g}; write one like 0.618")
    half = max(0.5 * 10.0 ** -len(digits[1]), _PRECISION * max(1.0, abs(value)))
    # The decimal number is itself rational, so take a noble number that rounds to it.
    noble = str(nobles_near(value + 0.382 * half, 0.618 * half, 1)[0])
    return noble, f"a noble number that rounds to it: {noble}"


def _tolerance(view):
    return float(np.clip(view.pixel.min(), _MIN_TOL, _MAX_TOL))


def _across(view, spacing, n_gaps):
    """Return the angles of rays across a view, and the degrees between them.

    These are `spacing` if the origin is in the view; otherwise there are `n_gaps` gaps, or more
    where they would be wider than `spacing`.
    """
    if view.a[0] <= 0 <= view.a[1] and view.b[0] <= 0 <= view.b[1]:
        return np.arange(0, 360 + spacing, spacing), spacing
    corners = np.array([complex(a, b) for a in view.a for b in view.b])
    middle = corners.mean()
    towards, turns = np.rad2deg(np.angle(middle)), np.rad2deg(np.angle(corners / middle))
    n_rays = 1 + max(n_gaps, ceil(np.ptp(turns) / spacing))
    return np.linspace(towards + turns.min(), towards + turns.max(), n_rays, retstep=True)


def _on_ray(plane, angle, tol):
    """Return {angle: Breakup} for all images of a ray; called on a worker.

    A wide bracket suffices if residues determine the value to within the tolerance.
    """
    images = np.unique(plane.unfold(angle))
    folded, shifts = plane.fold(images)
    start, profile = plane.ray(folded[0])
    found = barriers.critical_scale(profile, _MAX_TOL, start)
    if tol < _MAX_TOL and not found.error <= tol * found.value:
        found = barriers.critical_scale(profile, tol, start)
    breakups = {}
    for image, shift in zip(images.tolist(), shifts.tolist(), strict=True):
        omega = moebius(found.omega, -1, shift) if found.omega and shift else found.omega
        number = nan if omega is None else float(omega)
        breakups[image] = Breakup(found.value, found.error, str(omega or ""), number)
    return breakups


def _circle_on_rays(plane, omega, angles, q_max):
    """Return the scales at which the circle of ω breaks on rays; called on a worker."""
    start, profiles = plane.ray(angles)
    return [periodic.critical_scale(omega, profile, q_max, start).value for profile in profiles]
