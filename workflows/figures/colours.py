"""The colours of all figures and of the explorer; the colour of a circle follows from its ω.

This module does not import matplotlib, because the explorer shows its first picture without it.
"""

from functools import cache

import numpy as np

from nasm.numbers import moebius, parse

# Blue, orange, green, sky, red, violet, indigo. With deuteranopia or protanopia, any two appear at
# least 17 apart in CIE Lab; each is also at least that far from black, white and the greys below.
COLOURS = ["#0072B2", "#E69F00", "#358600", "#56B4E9", "#8B0000", "#8A2BE2", "#332288"]
VERMILION = "#D55E00"  # for elements that must stand out, but never for a circle

INSIDE, NO_ESCAPE = "0.84", "0.95"
"""Greys: where a barrier exists, and where there is no barrier but no orbit escapes either."""

MARKERS = "o^sDvP*<>X"

N_OF_OMEGA, LIGHTEST = 254, 0.93
"""Colours of ω from lowest to highest: this many of viridis, which is perceptually uniform and safe
for colour-blind readers, up to this fraction, so that none is as pale as the page."""

CHAOTIC = "#b3b3b3"

_DASHES = ["-", (0, (5, 1.2)), (0, (6, 1.2, 1.2, 1.2)), (0, (2, 1)), (0, (6, 1, 1, 1, 1, 1))]
_DASHES += [(0, (9, 2)), (0, (1, 1)), (0, (9, 2, 1, 2)), (0, (4, 1, 4, 3)), (0, (3, 1, 1, 1))]
# The first _KINDS markers and dashes are determined by ω alone; the others distinguish circles that
# would otherwise look alike.
_KINDS = 5


def hexadecimal(grey):
    """Return a grey as browsers need it: "0.84" as "#d6d6d6"."""
    return "#" + 3 * f"{round(255 * float(grey)):02x}"


def colour_of(i):
    return COLOURS[i % len(COLOURS)]


def line_of(i):
    """Return the style of the i-th line: dashed from the fourth on."""
    return {"color": colour_of(i), "ls": (0, (5, 1.2)) if i // 3 % 2 else "-"}


@cache
def circle_style(text, whole=0):
    """Return {"color", "marker", "ls"} for the circle of ω, determined by its partial quotients.

    text : ω as text; "" if it is unknown. whole : as in `circle_class`. All circles of a
    class share a style.

    The index of the colour is the sum of a - 1 over the quotients a between the first one and the
    repeating ones, minus the same sum over the repeating quotients. It is 0, blue, for the golden
    circle; for noble circles it increases by one with each unit added to a quotient after the first
    one. ω + 1 has the colour of ω, and the colours recur after seven; circles of the same colour
    usually differ in marker and dash.
    """
    if not text:
        return {"color": "black", "marker": "x", "ls": "-"}
    omega = parse(circle_class(text, whole))
    first, *quotients = omega.prefix
    steps = sum(a - 1 for a in quotients) - sum(b - 1 for b in omega.tail)
    return _look(steps, (first + len(quotients) + (omega.tail != (1,))) % _KINDS)


def _look(colour, kind):
    return {"color": colour_of(colour), "marker": MARKERS[kind], "ls": _DASHES[kind]}


def circle_styles(circles, whole=0):
    """Return {ω: its style} for all circles in a figure, sorted by ω.

    No two circles share both colour and marker, or both colour and dash.

    circles : each ω as text, "" if it is unknown; a circle and its image are listed as one class.
    Among circles that would look the same, the one with the shortest text has the style of
    `circle_style`; the others get a different marker and dash, or else a different colour.
    """
    own = {
        text: circle_style(text, whole) for text in {circle_class(each, whole) for each in circles}
    }
    styles = {}
    for text in sorted(own, key=lambda text: (len(text), text)):
        if own[text] not in styles.values():
            styles[text] = own[text]
    free = [_look(colour, kind) for colour in range(len(COLOURS)) for kind in range(len(MARKERS))]
    free = [look for look in free if look not in styles.values()]
    for text in sorted(own.keys() - styles.keys()):
        free.sort(key=lambda look: look["color"] != own[text]["color"])
        styles[text] = free.pop(0) if free else own[text]
    return {text: styles[text] for text in sorted(styles, key=_omega)}


def _omega(text):
    return float(parse(text)) if text else np.inf


@cache
def circle_class(text, whole=1):
    """Return the text of the larger of ω and its image under the symmetry, `whole` - ω.

    whole : the sum of ω and its image in the plane, P/2; 0 if circles have no image there.
    """
    omega = parse(text) if text else None
    return text if omega is None or float(omega) >= whole / 2 else str(moebius(omega, -1, whole))


def longest_arcs(angle, classes):
    """Return the classes of last circles that cover over 1% of all angles, longest arc first."""
    return [str(name) for name, share in arcs(angle, classes).items() if name and share > 0.01]


def arcs(angle, names):
    """Return the fraction of all angles that each name covers, as a Series, the largest first."""
    from pandas import Series  # the explorer sends its page before it needs pandas

    width = np.diff(np.r_[angle[0], (angle[1:] + angle[:-1]) / 2, angle[-1]]) / np.ptp(angle)
    shares = Series(width).groupby(np.asarray(names), sort=False).sum()
    return shares.sort_values(ascending=False, kind="stable")
