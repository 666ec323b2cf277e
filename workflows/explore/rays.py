"""Where the last circle breaks, on rays: what is known so far, and the rays that a view needs.

As arXiv:1606.04824, Sec. VI, by `pipeline.cubes.barrier`; all images of a ray under the symmetries
of the plane come with it.
"""

import re
from collections import deque, namedtuple
from time import monotonic, sleep

import numpy as np

from nasm.numbers import nobles_near, parse
from nasm.texts import abbreviate, parse_float
from pipeline.cubes.barrier import boundary
from pipeline.cubes.breakdown import by_residue
from pipeline.cubes.cube import angles_of_rays
from pipeline.sweep.progress import plural
from workflows.explore.work import spread
from workflows.figures.style import circle_class, circle_style, longest_arcs
from workflows.shared.tables import columns, dataset

_SPACING = 2.0  # degrees, of a view around the origin
_N_RAYS, _STRIDES = 65, (16, 8, 4, 2, 1)  # of any other view, at most; of them every 16th first
_TIPS = np.geomspace(2.0, 0.02, 6)  # degrees beside the diagonals, where boundaries have cusps
_PARTS = 8  # in which a circle's rays are computed
_BRACKET = 1e-3  # relative
_WIDE = 0.2  # of a view, around whose boundary a wide bracket will do
_ENOUGH = 8  # rays of a view, to name its circles alone
_PATIENCE = 1.0  # seconds between two pictures
_REST = 0.5  # seconds that a view has to rest: a ray takes up to some, and cannot be stopped
_LARGEST, _PRECISION = 1e6, 2.0**-50  # of a rotation number that is a decimal one; relative
_GAP = 25.0  # degrees without a ray, over which no line is drawn

_COLUMNS = {
    "scale": "scale at which the last circle breaks",  # NaN if not known
    "error": "error of scale",
    "circle": "rotation number of the last circle, per step, exact",  # "" if not known
    "omega": "the same, as a float",
}
Breakup = namedtuple("Breakup", _COLUMNS)  # where the last circle breaks on a ray, and which it is


class Rays:
    """What is `known` of a plane, {angle in degrees from 0 to 360: Breakup}."""

    def __init__(self, plane):
        self.plane, self.known = plane, {}
        # Of ω and its image whole - ω the boundaries are alike, and have one colour.
        self._whole = max(shift for *_, shift in plane.symmetries)

    def add(self, table):
        """Take in what `barrier.boundary` or `barrier.unfolded` return."""
        names = "angle", "critical_scale", "error", "circle", "omega"
        for angle, *found in zip(*(table[name].values.tolist() for name in names), strict=True):
            self.known[angle % 360] = Breakup(*found)

    def lines(self, view):
        """Return the boundary, a piece around each ray, columns a, b, colour, or None; and colours
        {text of ω: colour} of those circles that are last on 1% of the view or more."""
        angles, points, circles = self._found()
        if angles.size < 2:
            return None, {}
        inside = (view.a[0] <= points.real) & (points.real <= view.a[1])
        inside &= (view.b[0] <= points.imag) & (points.imag <= view.b[1])
        seen = inside if inside.sum() > _ENOUGH else np.ones_like(inside)
        classes = np.array([circle_class(circle, self._whole) for circle in circles])
        shades = [circle_style(text)["color"] for text in classes]
        named = longest_arcs(angles[seen], classes[seen])
        colours = {text: circle_style(text)["color"] for text in named}
        joined = (np.roll(angles, -1) - angles) % 360 <= _GAP  # to the next
        after = np.where(joined, (points + np.roll(points, -1)) / 2, points)
        before = np.where(np.roll(joined, 1), np.roll(after, 1), points)
        pieces = np.stack([before, points, after], axis=1)
        # No arrays: each would be a message of its own to the browser.
        return {"a": pieces.real.tolist(), "b": pieces.imag.tolist(), "colour": shades}, colours

    def _found(self):
        """Return angles, points as complex numbers, and circles, of the rays with a boundary."""
        rays = [(k, ray) for k, ray in sorted(self.known.items()) if np.isfinite(ray.scale)]
        angles = np.array([angle for angle, _ in rays])
        scales, circles = ([getattr(ray, name) for _, ray in rays] for name in ("scale", "circle"))
        return angles, scales * np.exp(1j * np.deg2rad(angles)), np.array(circles, dtype=object)

    def excess(self, a, b):
        """Return how far points are beyond the boundary, in parts of the boundary's scale, an array
        of the shape of a and b; NaN where no rays are known on both sides."""
        angles, points, _ = self._found()
        if not angles.size:
            return np.full(np.shape(a), np.nan)
        angle, scales = np.rad2deg(np.arctan2(b, a)) % 360, np.abs(points)
        after = np.searchsorted(angles, angle) % angles.size
        gap, part = (angles[after] - angles[after - 1]) % 360, (angle - angles[after - 1]) % 360
        # The chord from one point of the boundary to the next, where the ray passes it.
        one, other = np.sin(np.deg2rad([part, gap - part]))
        with np.errstate(divide="ignore", invalid="ignore"):
            chord = np.sin(np.deg2rad(gap)) / (one / scales[after] + other / scales[after - 1])
        return np.hypot(a, b) / np.where((part <= gap) & (gap <= _GAP), chord, np.nan) - 1

    def nearest(self, a, b):
        """Return the Breakup on the ray that is nearest to a point; None if no ray is known."""
        angles, *_ = self._found()
        if not angles.size:
            return None
        away = (angles - np.rad2deg(np.arctan2(b, a)) + 180) % 360 - 180
        return self.known[angles[np.argmin(abs(away))]]

    def table(self):
        """Return all that is known as a Dataset, dim (angle); None if nothing is."""
        if not self.known:
            return None
        angles = sorted(self.known)
        rays = zip(*(self.known[angle] for angle in angles), strict=True)
        found, where = columns("angle", _COLUMNS, rays), {"angle": angles_of_rays(angles)}
        return dataset("Where the last circle breaks", where, found, self.plane.record)

    def missing(self, view):
        """Return the rays to compute next for a view: degrees, each for all its images.

        If the origin is not in the view, these are a few first, and then those between known ones
        of different circles.
        """
        angles, spacing = _across(view, _SPACING)
        if spacing == _SPACING:
            tips = np.add.outer(np.arange(0, 360, 45), [*-_TIPS, 0, *_TIPS]).ravel()
            return self._unknown(np.concatenate([angles, tips]), 0.0)
        for stride in _STRIDES:
            some = angles[(np.arange(angles.size) % stride == 0) | (angles % 45 == 0)]
            if stride < _STRIDES[0]:
                known = np.array(sorted(self.known))
                circles = np.array([self.known[angle].circle for angle in known.tolist()])
                after = np.searchsorted(known, some % 360)
                some = some[circles[after - 1] != circles[after % known.size]]
            if folded := self._unknown(some, spacing / 2):
                return folded
        return []

    def _unknown(self, angles, apart):
        """Return the rays of these angles but those near a known one, spread evenly."""
        folded = np.unique(self.plane.fold(angles)[0].round(9))
        known = np.array(sorted(self.known))
        if known.size:
            gaps = np.abs((folded[:, None] - known + 180) % 360 - 180).min(axis=1)
            folded = folded[gaps > apart]
        spread_evenly = np.argsort(np.arange(folded.size) * 0.6180339887 % 1)
        return folded[spread_evenly].tolist()


def computed(client, rays, view):
    """Yield what is known with the rays of a view, as `Rays.known`, and how many they are, or None.

    client : function → dask Client; one worker is left to others. rays : Rays so far.
    """
    own, n_rays, shown = Rays(rays.plane), 0, monotonic()
    own.known |= rays.known
    while angles := own.missing(view):
        if not n_rays:
            sleep(_REST)
            yield None
        workers, n_rays = client(), n_rays + len(angles)
        most = max(1, len(workers.nthreads()) - 1)
        calls = deque((None, _on_ray, own.plane, angle, _effort(view)[0]) for angle in angles)
        for ended in spread(workers, calls, most, priority=-1):
            if ended:
                own.add(ended[1])
            if late := monotonic() - shown > _PATIENCE:  # to draw the lines costs more than a ray
                shown = monotonic()
            yield (dict(own.known), plural(n_rays, "ray")) if late else None
        yield dict(own.known), plural(n_rays, "ray")


def circle(client, plane, omega, view):
    """Yield the line where the circle of ω, a text, breaks, more of it each time; or None."""
    angles, _ = _across(view, 1.0)
    alike = [shift == 0 for *_, shift in plane.symmetries]  # whose images have the same ω
    folded, where = np.unique(plane.unfold(angles)[alike].min(axis=0), return_inverse=True)
    scale, how = np.full(folded.size, np.nan), (_circle_on_rays, plane, omega)
    parts = np.array_split(np.arange(folded.size), _PARTS)
    calls = deque((part, *how, folded[part], _effort(view)[1]) for part in parts)
    for ended in spread(client(), calls, priority=-1):
        if ended is None:
            yield None
            continue
        scale[ended[0]] = ended[1]
        found = scale[where] * np.exp(1j * np.deg2rad(angles))
        yield {"a": found.real, "b": found.imag}


def named_by(text):
    """Return the text of a noble number that rounds to a decimal one, and what to say of it; any
    other text of an irrational number as it is, and ""; ValueError for one of a rational."""
    digits = re.fullmatch(r"[+-]?\d+\.(\d+)", text)
    if not digits and text and parse(text).is_rational:
        raise ValueError(
            f"{abbreviate(text)} is rational, and has no circle; write one like [0;2,(1)]"
        )
    if not digits:
        return text, ""
    value = parse_float(text)
    if not abs(value) < _LARGEST:
        raise ValueError(f"{abbreviate(text)} must be below {_LARGEST:g}; write one like 0.618")
    half = max(0.5 * 10.0 ** -len(digits[1]), _PRECISION * max(1.0, abs(value)))
    # The number itself is rational, and may end too soon.
    noble = str(nobles_near(value + 0.382 * half, 0.618 * half, 1)[0])
    return noble, f"a noble number that rounds to it: {noble}"


def _effort(view):
    """Return the width of brackets and the longest period of orbits that a view asks for."""
    return (_BRACKET, 300) if max(np.ptp(view.a), np.ptp(view.b)) > _WIDE else (1e-4, 1500)


def _across(view, spacing):
    """Return angles of rays all across a view, and their spacing: the one given if the origin is in
    it, or else such that they are 65."""
    corners = np.array([complex(a, b) for a in view.a for b in view.b])
    if view.a[0] <= 0 <= view.a[1] and view.b[0] <= 0 <= view.b[1]:
        return np.arange(0, 360 + spacing, spacing), spacing
    middle = corners.mean()
    towards, turns = np.rad2deg(np.angle(middle)), np.rad2deg(np.angle(corners / middle))
    low, high = towards + turns.min(), towards + turns.max()
    angles, spacing = np.linspace(low, high, _N_RAYS, retstep=True)
    diagonals = np.arange(np.ceil(low / 45), np.floor(high / 45) + 1) * 45  # cusps are there
    return np.union1d(angles, diagonals), spacing


def _on_ray(plane, angle, tol):
    """On a worker: a wide bracket will do where the value has its digits by residues."""
    angles = np.unique(plane.unfold(angle))
    found = boundary(angles, max(tol, _BRACKET), plane)
    enough = tol >= _BRACKET or float((found.error / found.critical_scale).max()) <= tol
    return found if enough else boundary(angles, tol, plane)


def _circle_on_rays(plane, omega, angles, q_max):
    """On a worker: the scales at which the circle breaks."""
    job = by_residue(plane, [parse(omega)], angles, q_max)
    found = job.compute({"circle": [omega], "angle": angles}, job.cube.settings)
    return found["critical_scale"][0]
