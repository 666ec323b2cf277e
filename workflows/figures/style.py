"""What all figures share: colours, numbers in TeX, and how a figure is saved."""

import sys
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("agg")

# Okabe & Ito, safe for colour-blind readers.
CIRCLE_COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]


def colour_of(i):
    return CIRCLE_COLOURS[i % len(CIRCLE_COLOURS)]


def line_of(i):
    """Return the style of the i-th line: dashed from the fourth on, as some colours are alike."""
    return {"color": colour_of(i), "ls": (0, (5, 1.2)) if i // 3 % 2 else "-"}


def save(figure, out, name, caption=""):
    """Write the figure as NAME.png and NAME.pdf, and its caption, if it has one, as NAME.txt.

    Returns the paths of the two pictures, which carry the caption too.
    """
    paths = [f"{out}/{name}.{kind}" for kind in ("png", "pdf")]
    for path, key in zip(paths, ("Description", "Subject"), strict=True):
        figure.savefig(path, dpi=200, metadata={key: caption})
    if "matplotlib.pyplot" in sys.modules:  # which keeps its figures; importing it takes a while
        sys.modules["matplotlib.pyplot"].close(figure)
    if caption:
        Path(f"{out}/{name}.txt").write_text(f"{caption}\n", encoding="utf-8")
    return paths


def omega_label(text):
    """Return the continued fraction in TeX, with the paper's name if it has one."""
    from nasm.numbers import NAMES, parse

    names = {str(parse(name)): name.replace("gamma", r"\gamma") for name in NAMES}
    name = rf"{names[text]} = " if text in names else ""
    return rf"$\omega = {name}{text}$"


# As classes, of which neighbours along the boundary must differ: blue, orange, green, sky, ….
_CLASS_COLOURS = [CIRCLE_COLOURS[i] for i in (0, 4, 2, 5, 1, 3)]


def known(breakdown):
    """Drop the points whose claimed error is beyond 2% of the scale: gaps in the curves drawn."""
    return breakdown.where(breakdown.error < 0.02 * breakdown.critical_scale)


@cache
def circle_class(text, whole=1):
    """Return the text of ω in [1/2, 1] for that of ω in [0, 1]: by symmetry 1 - ω is as ω.

    whole : of ω and its image in the plane, P/2 if circles have one there, and else 0.
    """
    from nasm.numbers import moebius, parse

    omega = parse(text) if text else None
    return text if omega is None or float(omega) >= whole / 2 else str(moebius(omega, -1, whole))


def class_colours(angle, circles, whole=1):
    """Return the class of each ray's circle, and {class: colour}, the longest arc first.

    The six classes that are last on 1% of the angle or more have colours, the others greys.
    """
    classes = np.array([circle_class(text, whole) for text in circles])
    width = np.gradient(angle) / np.ptp(angle)
    shares = {name: width[classes == name].sum() for name in dict.fromkeys(classes.tolist())}
    ordered = sorted(filter(None, shares), key=lambda name: -shares[name])
    seen = [name for name in ordered if shares[name] > 0.01][: len(_CLASS_COLOURS)]
    rest = [name for name in ordered if name not in seen]
    shades = _CLASS_COLOURS[: len(seen)]
    shades += [f"{grey:.2f}" for grey in np.linspace(0.15, 0.65, len(rest))]
    return classes, {**dict(zip(seen + rest, shades, strict=True)), "": "black"}


def mark_gaps(axes, x, silent):
    """Mark by × at the bottom where a method has no answer, and say so."""
    if np.any(silent):
        where = {"transform": axes.get_xaxis_transform(), "ls": "", "marker": "x", "ms": 5}
        axes.plot(x[silent], np.full(np.sum(silent), 0.02), color="0.3", **where)
        axes.text(0.01, 0.04, "×: no answer", transform=axes.transAxes, size="x-small")


def letters(panels):
    """Write (a), (b), … above the panels."""
    for axes, name in zip(panels, "abcdefgh", strict=False):
        where = {"transform": axes.transAxes, "ha": "right", "va": "bottom"}
        axes.text(0, 1.02, f"({name})", weight="bold", **where)


def smoothed(field):
    """Return the running median of 7 × 7 cells: escape or not is a matter of chance in each."""
    from scipy.ndimage import median_filter

    return median_filter(field, 7)


def power(n):
    """Return 10^5, 5·10^5, … in TeX; small numbers and those of more digits as they are."""
    if n < 1000 or n % 10 ** (len(str(n)) - 2):
        return str(n)
    exponent = len(str(n)) - 1
    mantissa = n / 10**exponent
    return f"10^{exponent}" if mantissa == 1 else rf"{mantissa:g}\cdot 10^{exponent}"


def dots(colour, size):
    return {"ls": "", "marker": ".", "ms": size, "mew": 0, "color": colour, "rasterized": True}


def cell(y):
    """Return y mod 1 in [-1/4, 3/4), which does not cut the circles of 0 ≤ ω/P ≤ 1/2."""
    return (y + 0.25) % 1 - 0.25
