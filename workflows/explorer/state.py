"""What one tab is looking at: a point in a plane of forcings, and a number of steps N."""

from collections import defaultdict

from nasm.maps import forcing


class Forcing:
    """The forcing that one tab looks at.

    plane : nasm.planes.Plane.
    point : (a, b), its coordinates.
    steps : int, N of the boundary {n* ≤ N}.
    verdict : nasm.verdict.Verdict of the point, None until it is known.
    seen : {name: function → xarray.Dataset}, what each panel shows now; panels put theirs in.
    """

    def __init__(self, plane, point, steps):
        self.plane, self.point, self.steps = plane, tuple(map(float, point)), steps
        self.seen = {}
        self.verdict = None
        self._hear = defaultdict(list)

    @property
    def kappa(self):
        """One period of kicks, an array of P floats."""
        return self.plane.forcing(*self.point)

    def on(self, what, callback):
        """Call back, without arguments, whenever "point", "steps" or "verdict" changes."""
        self._hear[what].append(callback)

    def _tell(self, what):
        for callback in self._hear[what]:
            callback()

    def judge(self, verdict):
        """Take the verdict of the point, or None where it is no longer known."""
        self.verdict = verdict
        self._tell("verdict")

    def move(self, a, b):
        """Go to another point; ValueError if its strengths are not finite or too large."""
        point = float(a), float(b)
        forcing(point)  # before it is multiplied
        forcing(self.plane.forcing(*point))
        if point != self.point:
            self.point = point
            self._tell("point")

    def count(self, steps):
        """Take another N."""
        if steps != self.steps:
            self.steps = steps
            self._tell("steps")
