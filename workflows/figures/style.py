"""What all figures share: colours, numbers in TeX, and how a figure is saved."""

from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt

# Okabe & Ito, safe for colour-blind readers.
CIRCLE_COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]


def save(figure, out, name, caption=""):
    """Write the figure as NAME.png and NAME.pdf, and its caption, if it has one, as NAME.txt.

    Returns the paths of the two pictures, which carry the caption too.
    """
    paths = [f"{out}/{name}.{kind}" for kind in ("png", "pdf")]
    for path, key in zip(paths, ("Description", "Subject"), strict=True):
        figure.savefig(path, dpi=200, bbox_inches="tight", metadata={key: caption})
    plt.close(figure)
    if caption:
        Path(f"{out}/{name}.txt").write_text(f"{caption}\n", encoding="utf-8")
    return paths


def omega_label(text):
    """Return the continued fraction in TeX, with the paper's name if it has one."""
    from nasm.numbers import NAMES, parse

    names = {str(parse(name)): name.replace("gamma", r"\gamma") for name in NAMES}
    name = rf"{names[text]} = " if text in names else ""
    return rf"$\omega = {name}{text}$"


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
