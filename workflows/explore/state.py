"""What one tab is looking at: a point in a plane of forcings, N, two views; and all as an address.

Every part of the state that a link brings back is a text in the address, left out where it is as at
first: `a=0.1:0.3&b=0:0.2&omega=gamma&orbits=0.5,0.3;0.5,0.4&show=boundary,cycles`.
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
_HALF = 1.15  # of the largest strength, of the first view
ZOOM = 1e-9, 30.0  # times the first view: beyond that pixels are no longer apart as floats
_FAR = 1e7  # largest coordinates of a view, added
_MOST_ORBITS = 50
_MOST_Q = 1000  # of p/q whose orbits are sought


class State:
    """What one tab looks at.

    plane : nasm.planes.Plane. point : (a, b), its coordinates. steps : int, N of {n* ≤ N}.
    a, b : (lo, hi) of the plane that is shown. x, y : (lo, hi) of phase space.
    omega : text of the ω whose circle is followed, or "". orbits : ((x, y), …) that were added.
    fraction : text of the p/q whose periodic orbits are shown, or "".
    show : frozenset of the names in LINES and ORBITS that are shown.
    verdict : nasm.Verdict of the point, None until it is known.
    drawn : the point whose portrait is shown. plays : whether the point moves by itself.
    seen : {name: function → xarray.Dataset}, what each panel shows now; panels put theirs in.
    """

    def __init__(self, plane):
        sizes = [max(map(abs, vector)) for vector in (plane.first, plane.second)]
        self.plane, self.point, self.steps = plane, (0.5 / sizes[0], 0.4 / sizes[1]), 10_000
        self.a, self.b = ((-_HALF / size, _HALF / size) for size in sizes)
        self.x, self.y = (0.0, 1.0), (-0.25, 0.75)
        self.omega, self.orbits, self.show = "", (), frozenset({"boundary"})
        self.fraction, self.drawn, self.plays = "", None, False
        self.verdict, self.seen, self._hear = None, {}, defaultdict(list)

    @property
    def kappa(self):
        return self.plane.forcing(*self.point)

    def on(self, names, callback):
        """Call back, without arguments, whenever one of these attributes changes: "point omega"."""
        for name in names.split():
            self._hear[name].append(callback)

    def take(self, **changes):
        """Set attributes, and tell those who asked for what has changed."""
        changed = [name for name, value in changes.items() if getattr(self, name) != value]
        vars(self).update(changes)
        for callback in [callback for name in changed for callback in self._hear[name]]:
            callback()

    def move(self, a, b):
        """Go to another point; ValueError if its strengths are not finite or too large."""
        point = float(a), float(b)
        forcing(point)  # before it is multiplied
        forcing(self.plane.forcing(*point))
        if point != self.point:
            self.take(point=point, verdict=None)

    def seek(self, fraction):
        """Show the periodic orbits of a text p/q, or none for ""; ValueError for another text."""
        self.take(fraction=fraction and str(fraction_of(fraction)))

    def follow(self, omega):
        """Follow the circle of another ω, or none for ""; ValueError if it has no circle.

        For a decimal number a noble one is taken; returns what to say of it.
        """
        try:
            omega, words = named_by(omega)
        except ValueError:
            self.take(omega="")
            raise
        self.take(omega=omega)
        return words

    @property
    def boundary(self):
        """The point of the ray where the last circle breaks, None where the verdict knows none, or
        the plane's ray is not the verdict's, which begins without kicks."""
        scale = self.verdict.boundary.value if self.verdict else np.nan
        if any(self.plane.origin) or not np.isfinite(scale):
            return None
        return tuple(scale * value for value in self.point)

    def address(self):
        """Return the query of a link to all of this."""
        found = {"k1": repr(self.point[0]), "k2": repr(self.point[1])}
        if self.plane != two_kicks():
            found["plane"] = self.plane.name
        first = State(self.plane)
        for name, (part, _, written) in _PARTS.items():
            if getattr(self, part) != getattr(first, part):
                found[name] = written(getattr(self, part))
        return urlencode(found, safe=":,;()[]")

    def go(self, query):
        """Take what a query {name: text} asks for; ValueError in words, with nothing changed."""
        name = query.get("plane", two_kicks().name)
        if query and name != self.plane.name:
            raise ValueError(
                f"this page shows {self.plane.name}; start one with --plane {abbreviate(name)}"
            )
        asked = State(self.plane)
        for name, (part, read, _) in _PARTS.items():
            if name in query:
                setattr(asked, part, read(query[name]))
        for ends, first in ((asked.a, self.a), (asked.b, self.b)):
            _allow(ends, np.ptp(first) * np.array(ZOOM))
        for ends in (asked.x, asked.y):
            _allow(ends, (ZOOM[0], 1.0))
        asked.follow(asked.omega)
        asked.seek(asked.fraction)
        point = zip(("k1", "k2"), self.point, strict=True)
        asked.move(*(parse_float(query[name]) if name in query else value for name, value in point))
        self.take(point=asked.point, **{part: getattr(asked, part) for part, *_ in _PARTS.values()})


def fraction_of(text):
    """Return the Fraction p/q that a text spells, None for ""; ValueError in words."""
    if not text:
        return None
    with suppress(ValueError):
        found = parse_fraction(text)
        if found.denominator <= _MOST_Q and abs(found) <= _MOST_Q:
            return found
    raise ValueError(f"{short_repr(text)} must be a fraction like 3/8, with q up to {_MOST_Q}")


def orbits_of(text):
    """Return the starts ((x, y), …) that a text names; ValueError in words."""
    pairs, found = [*filter(None, map(str.strip, text.split(";")))], []
    if len(pairs) > _MOST_ORBITS:
        raise ValueError(f"{len(pairs)} orbits are too many; take {_MOST_ORBITS} or fewer")
    for pair in pairs:
        words = pair.replace(",", " ").split()
        start = [parse_float(word) for word in words] if len(words) == 2 else [np.nan]
        if not np.isfinite(start).all():
            raise ValueError(f"{short_repr(pair)} must be two numbers, like 0.5, 0.3")
        found.append((start[0] % 1, start[1]))
    return tuple(found)


def orbits_text(orbits):
    """Return the text of starts ((x, y), …)."""
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
    if not (abs(low) + abs(high) < _FAR and 0.99 * sizes[0] <= high - low <= 1.01 * sizes[1]):
        raise ValueError(f"the range {low}:{high} must be {sizes[0]:g} to {sizes[1]:g} wide")


def _names(text):
    names = frozenset(filter(None, text.split(",")))
    if not names <= {*LINES, *ORBITS}:
        raise ValueError(f"show={short_repr(text)} must be some of {','.join([*LINES, *ORBITS])}")
    return names


_PARTS = {  # of the address: what it is here, how to read and how to write it
    "n": ("steps", _steps, str),
    **{name: (name, _ends, lambda ends: "{!r}:{!r}".format(*ends)) for name in "abxy"},
    "omega": ("omega", str, str),
    "pq": ("fraction", str, str),
    "orbits": ("orbits", orbits_of, lambda orbits: orbits_text(orbits).replace(" ", "")),
    "show": ("show", _names, lambda names: ",".join(sorted(names))),
}
QUERY = ("k1", "k2", "plane", *_PARTS)
