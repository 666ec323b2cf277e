"""The state of one tab (a point in a plane of forcings, N, and two views) and the tab's address.

The address contains the point, and each part of the state that differs from its initial value:
`k1=0.3&k2=0.2&a=0.1:0.3&b=0:0.2&omega=gamma&orbits=0.5,0.3;0.5,0.4&show=boundary,cycles`.
"""

from collections import defaultdict
from contextlib import suppress
from urllib.parse import urlencode

import numpy as np

from nasm.maps import forcing
from nasm.planes import two_kicks
from nasm.texts import abbreviate, parse_float, parse_fraction, parse_integer, short_repr
from workflows.explore.rays import named_by

STEPS = [m * 10**e for e in range(2, 6) for m in (1, 2, 5)] + [10**6]
LINES = {"boundary": "where the last circle breaks"}
ORBITS = {"kicks": "kick by kick", "symmetry": "symmetry lines", "cycles": "periodic orbits"}
ORBITS |= {"manifolds": "manifolds of p/q"}
_HALF_WIDTH = 1.15  # half-width of the first view, in units of the largest strength
ZOOM = 1e-9, 30.0  # relative to the first view; in smaller views, pixels would coincide as floats
_MAX_COORDINATE = 1e7  # limit on |low| + |high| of a view
_MAX_ORBITS = 50
_MAX_Q = 1000  # limit on q, and on |p/q|, of periodic orbits


class State:
    """The state of one tab.

    plane : nasm.planes.Plane. point : (a, b), the coordinates of the forcing in this plane.
    steps : int, N, the limit on n*, the time of the first escape, in steps (periods).
    a, b : (low, high), the displayed ranges of the plane. x, y : the same for phase space.
    omega : the ω whose circle is followed, as text, or "".
    orbits : starts ((x, y), …) added by the user.
    fraction : the p/q whose periodic orbits are shown, as text, or "".
    show : frozenset of the names in LINES and ORBITS that are shown.
    verdict : nasm.Verdict for the point, None until it is known.
    drawn : the point whose portrait is shown. plays : True while the point is animated.
    datasets : {name: function → xarray.Dataset}; each panel adds the data that it shows.
    """

    def __init__(self, plane):
        sizes = [max(map(abs, vector)) for vector in (plane.first, plane.second)]
        self.plane, self.point, self.steps = plane, (0.5 / sizes[0], 0.4 / sizes[1]), 10_000
        self.a, self.b = ((-_HALF_WIDTH / size, _HALF_WIDTH / size) for size in sizes)
        self.x, self.y = (0.0, 1.0), (-0.25, 0.75)
        self.omega, self.orbits, self.show = "", (), frozenset({"boundary"})
        self.fraction, self.drawn, self.plays = "", None, False
        self.verdict, self.datasets, self._callbacks = None, {}, defaultdict(list)

    @property
    def kappa(self):
        return self.plane.forcing(*self.point)

    def on(self, names, callback):
        """Call callback() when one of the attributes in `names`, e.g. "point omega", changes."""
        for name in names.split():
            self._callbacks[name].append(callback)

    def take(self, **changes):
        """Set attributes, and call the callbacks of those that have changed."""
        changed = [name for name, value in changes.items() if getattr(self, name) != value]
        vars(self).update(changes)
        for callback in [callback for name in changed for callback in self._callbacks[name]]:
            callback()

    def move(self, a, b):
        """Go to another point; raise ValueError if its strengths are too large or not finite."""
        point = float(a), float(b)
        forcing(point)  # check the coordinates before the plane multiplies them
        forcing(self.plane.forcing(*point))
        if point != self.point:
            self.take(point=point, verdict=None)

    def seek(self, fraction):
        """Show the periodic orbits of p/q, or none for ""; raise ValueError for any other text."""
        self.take(fraction=fraction and str(fraction_of(fraction)))

    def follow(self, omega):
        """Follow the circle with this ω, or none for ""; raise ValueError if no circle has this ω.

        A decimal number is replaced by a noble one; return a message about the replacement.
        """
        try:
            omega, message = named_by(omega)
        except ValueError:
            self.take(omega="")
            raise
        self.take(omega=omega)
        return message

    @property
    def boundary(self):
        """The point at which the last circle breaks on the ray through the chosen point.

        It is None if the verdict contains no breakup or if rays of the plane do not begin at κ = 0.
        """
        scale = self.verdict.boundary.value if self.verdict else np.nan
        if any(self.plane.origin) or not np.isfinite(scale):
            return None
        return tuple(scale * value for value in self.point)

    def address(self):
        """Return the query of a link that restores this state."""
        query = {"k1": repr(self.point[0]), "k2": repr(self.point[1])}
        if self.plane != two_kicks():
            query["plane"] = self.plane.name
        first = State(self.plane)
        for name, (part, _, write) in _PARTS.items():
            if getattr(self, part) != getattr(first, part):
                query[name] = write(getattr(self, part))
        return urlencode(query, safe=":,;()[]")

    def go(self, query):
        """Set the state from a query {name: text}; a ValueError leaves it unchanged."""
        name = query.get("plane", two_kicks().name)
        if query and name != self.plane.name:
            raise ValueError(
                f"this page shows {self.plane.name}; start another with --plane {abbreviate(name)}"
            )
        requested = State(self.plane)
        for name, (part, read, _) in _PARTS.items():
            if name in query:
                setattr(requested, part, read(query[name]))
        for ends, first in ((requested.a, self.a), (requested.b, self.b)):
            _allow(ends, np.ptp(first) * np.array(ZOOM))
        for ends in (requested.x, requested.y):
            _allow(ends, (ZOOM[0], 1.0))
        requested.follow(requested.omega)
        requested.seek(requested.fraction)
        point = zip(("k1", "k2"), self.point, strict=True)
        requested.move(
            *(parse_float(query[name]) if name in query else value for name, value in point)
        )
        self.take(
            point=requested.point,
            **{part: getattr(requested, part) for part, *_ in _PARTS.values()},
        )


def fraction_of(text):
    """Parse a fraction p/q; return None for "". A ValueError explains what is wrong."""
    if not text:
        return None
    with suppress(ValueError):
        fraction = parse_fraction(text)
        if fraction.denominator <= _MAX_Q and abs(fraction) <= _MAX_Q:
            return fraction
    raise ValueError(f"{short_repr(text)} must be a fraction like 3/8, with q up to {_MAX_Q}")


def orbits_of(text):
    """Parse initial conditions ((x, y), …). A ValueError explains what is wrong."""
    pairs, orbits = [*filter(None, map(str.strip, text.split(";")))], []
    if len(pairs) > _MAX_ORBITS:
        raise ValueError(f"orbits: {len(pairs)} is too many; at most {_MAX_ORBITS} are allowed")
    for pair in pairs:
        numbers = pair.replace(",", " ").split()
        start = [parse_float(text) for text in numbers] if len(numbers) == 2 else [np.nan]
        if not np.isfinite(start).all():
            raise ValueError(f"{short_repr(pair)} must be two numbers, like 0.5, 0.3")
        orbits.append((start[0] % 1, start[1]))
    return tuple(orbits)


def orbits_text(orbits):
    """Write initial conditions ((x, y), …) as text."""
    return "; ".join(f"{x!r}, {y!r}" for x, y in orbits)


def _steps(text):
    try:
        return parse_integer(text, STEPS[0], STEPS[-1])
    except ValueError as error:
        raise ValueError(f"n={error}") from None


def _ends(text):
    low, colon, high = text.partition(":")
    if not colon:
        raise ValueError(f"{short_repr(text)} must be a range, like 0.1:0.3")
    return parse_float(low), parse_float(high)


def _allow(ends, sizes):
    low, high = ends
    if not (
        abs(low) + abs(high) < _MAX_COORDINATE and 0.99 * sizes[0] <= high - low <= 1.01 * sizes[1]
    ):
        raise ValueError(f"the range {low}:{high} must be {sizes[0]:g} to {sizes[1]:g} wide")


def _names(text):
    names = frozenset(filter(None, text.split(",")))
    if not names <= {*LINES, *ORBITS}:
        raise ValueError(
            f"show={short_repr(text)} must be a list of names from {','.join([*LINES, *ORBITS])}"
        )
    return names


_PARTS = {  # name in the address: attribute, function to read it, function to write it
    "n": ("steps", _steps, str),
    **{name: (name, _ends, lambda ends: "{!r}:{!r}".format(*ends)) for name in "abxy"},
    "omega": ("omega", str, str),
    "pq": ("fraction", str, str),
    "orbits": ("orbits", orbits_of, lambda orbits: orbits_text(orbits).replace(" ", "")),
    "show": ("show", _names, lambda names: ",".join(sorted(names))),
}
QUERY = ("k1", "k2", "plane", *_PARTS)
