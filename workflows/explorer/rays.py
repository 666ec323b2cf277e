"""Where the last circle breaks, on rays: what is known so far, and the rays that a view needs.

As arXiv:1606.04824, Sec. VI, by `pipeline.cubes.barrier`; all images of a ray under the symmetries
of the plane come with it.
"""

from dataclasses import dataclass

import numpy as np

from nasm.numbers import parse
from pipeline.cubes.barrier import boundary, unfolded
from workflows.explorer.work import spread
from workflows.figures.style import CIRCLE_COLOURS, circle_class

_GREY = "#555555"
_SPACING = 2.0  # degrees, of a view around the origin
_N_RAYS = 64  # of any other view
_TIPS = np.geomspace(2.0, 0.02, 6)  # degrees beside the diagonals, where boundaries have cusps
_WIDE = 0.2  # of a view, around whose boundary a wide bracket will do
_GAP = 25.0  # degrees without a ray, over which no line is drawn


@dataclass(frozen=True)
class Breakup:
    """scale : where the last circle breaks on the ray, NaN if not known. error : of it.

    circle : text of ω, "" if not known; omega : the float.
    """

    scale: float
    error: float
    circle: str
    omega: float


class Rays:
    """The breakups that are known in a plane, {angle in degrees from 0 to 360: Breakup}.

    colours : {class of circles: colour}, in the order in which the classes were met.
    """

    def __init__(self, plane):
        self.plane, self.known, self.colours = plane, {}, {}
        # Of ω and its image whole - ω the boundaries are alike.
        self._whole = max(shift for *_, shift in plane.symmetries)

    def add(self, table):
        """Take in what `barrier.boundary` or `barrier.unfolded` return."""
        columns = (table[name].values for name in ("angle", "critical_scale", "error", "omega"))
        for angle, scale, error, omega, circle in zip(*columns, table.circle.values, strict=True):
            found = Breakup(float(scale), float(error), str(circle), float(omega))
            self.known[float(angle) % 360] = found
            if circle:
                shades = CIRCLE_COLOURS[len(self.colours) :]
                self.colours.setdefault(self.class_of(found), shades[0] if shades else _GREY)

    def add_cube(self, barrier):
        """Take in the cube `barrier` with all its images."""
        images = self.plane.unfold(barrier.angle.values)
        self.add(unfolded(barrier, np.unique(images)))

    def class_of(self, found):
        """Return the text of ω, or of its image, under which circles have one colour."""
        return circle_class(found.circle, self._whole)

    def lines(self):
        """Return the boundary as pieces, one circle each: lists of a, of b, and of colours."""
        angles = sorted(angle for angle, ray in self.known.items() if np.isfinite(ray.scale))
        if len(angles) < 2:
            return [], [], []
        rays = [self.known[angle] for angle in angles]
        points = [
            ray.scale * np.exp(1j * np.deg2rad(a)) for a, ray in zip(angles, rays, strict=True)
        ]
        pieces, colours = [], []
        for i in range(len(angles)):
            after = (i + 1) % len(angles)
            if not 0 < (angles[after] - angles[i]) % 360 <= _GAP:
                continue
            middle = (points[i] + points[after]) / 2
            for point, end, ray in (
                (points[i], middle, rays[i]),
                (middle, points[after], rays[after]),
            ):
                colour = self.colours.get(self.class_of(ray), _GREY)
                if pieces and colours[-1] == colour and pieces[-1][-1] == point:
                    pieces[-1].append(end)
                else:
                    pieces.append([point, end])
                    colours.append(colour)
        return [np.real(p) for p in pieces], [np.imag(p) for p in pieces], colours

    def at(self, a, b):
        """Return (excess, Breakup) at a point: how far it is beyond the boundary, in parts of the
        boundary's scale, and the nearer ray; None where no rays are known on both sides."""
        angle, radius = np.rad2deg(np.arctan2(b, a)) % 360, np.hypot(a, b)
        angles = np.array(sorted(k for k, ray in self.known.items() if np.isfinite(ray.scale)))
        if not angles.size:
            return None
        i = np.searchsorted(angles, angle)
        before, after = angles[i - 1], angles[i % angles.size]
        gap, part = (after - before) % 360, (angle - before) % 360
        low, high = self.known[before], self.known[after]
        if part == 0 or gap == 0 or gap > _GAP:
            return (radius / low.scale - 1, low) if part == 0 else None
        # The chord from one point of the boundary to the next, where the ray passes it.
        one, other = np.sin(np.deg2rad([part, gap - part]))
        chord = np.sin(np.deg2rad(gap)) / (one / high.scale + other / low.scale)
        return radius / chord - 1, low if part < gap / 2 else high

    def missing(self, view):
        """Return the rays to compute for a view: degrees, each for all its images, coarse first."""
        corners = np.array([complex(a, b) for a in view.a for b in view.b])
        if min(view.a) <= 0 <= max(view.a) and min(view.b) <= 0 <= max(view.b):
            angles = np.arange(0, 360, _SPACING)
            tips = np.add.outer(np.arange(0, 360, 45), np.concatenate([-_TIPS, [0], _TIPS]))
            angles = np.concatenate([angles, tips.ravel()])
            spacing = 0.0
        else:
            middle = corners.mean()
            turns = np.rad2deg(np.angle(corners / middle))
            towards = np.rad2deg(np.angle(middle))
            low, high = towards + turns.min(), towards + turns.max()
            angles, spacing = np.linspace(low, high, _N_RAYS, retstep=True)
            diagonals = np.arange(np.ceil(low / 45), np.floor(high / 45) + 1) * 45
            angles = np.concatenate([diagonals, angles])
        folded = np.unique(self.plane.fold(angles)[0].round(9))
        known = np.array(sorted(self.known))
        if known.size:
            gaps = np.abs((folded[:, None] - known + 180) % 360 - 180).min(axis=1)
            folded = folded[gaps > spacing / 2]
        spread_evenly = np.argsort(np.arange(folded.size) * 0.6180339887 % 1)
        return folded[spread_evenly].tolist()


def computed(client, rays, view):
    """Yield (table, words) for `Rays.add`, ray by ray, and how far that is; or None.

    client : function → dask Client. One worker at least is left to others.
    """
    angles = rays.missing(view)
    if not angles:
        return
    tol = 1e-3 if max(np.ptp(view.a), np.ptp(view.b)) > _WIDE else 1e-4
    workers = client()
    most = max(1, len(workers.nthreads()) - 1)
    calls = ((angle, _on_ray, rays.plane, angle, tol) for angle in angles)
    count = 0
    for ended in spread(workers, calls, most, priority=-1):
        if ended is not None:
            count += 1
            yield ended[1], f"{count} of {len(angles)} rays"
        else:
            yield None


def _on_ray(plane, angle, tol):
    """On a worker: the breakup on a ray and all its images."""
    return boundary(np.unique(plane.unfold(angle)), tol, plane)


def named(found):
    """Return the rotation number in words, "[0;2,(1)] = 0.381966"; "not known" without one."""
    return f"{found.circle} = {float(parse(found.circle)):.6g}" if found.circle else "not known"
