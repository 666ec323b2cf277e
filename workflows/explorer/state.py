"""What one tab is looking at: a point in a plane of forcings, and a number of steps N."""

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
        self._moved, self._counted, self._judged = [], [], []

    @property
    def kappa(self):
        """One period of kicks, an array of P floats."""
        return self.plane.forcing(*self.point)

    def on_change(self, callback):
        """Call back, without arguments, whenever the point moves."""
        self._moved.append(callback)

    def on_steps(self, callback):
        """Call back, without arguments, whenever N changes."""
        self._counted.append(callback)

    def on_verdict(self, callback):
        """Call back, without arguments, when the verdict of the point is known."""
        self._judged.append(callback)

    def judge(self, verdict):
        """Take the verdict of the point, or None where it is no longer known."""
        self.verdict = verdict
        _tell(self._judged)

    def move(self, a, b):
        """Go to another point; ValueError if its strengths are not finite or too large."""
        point = float(a), float(b)
        forcing(point)  # before it is multiplied
        forcing(self.plane.forcing(*point))
        if point != self.point:
            self.point = point
            _tell(self._moved)

    def count(self, steps):
        """Take another N."""
        if steps != self.steps:
            self.steps = steps
            _tell(self._counted)


def _tell(callbacks):
    for callback in callbacks:
        callback()
