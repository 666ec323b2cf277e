"""Symbols, labels and outlines shared by the figures of all planes of forcings."""

import numpy as np

from nasm.planes import plane_of, two_kicks
from workflows.figures.colours import INSIDE

# Symbols of the axes of the paper's planes, in TeX and in plain text.
_SYMBOLS = {
    "strength of the first kick": (r"$\kappa_1$", "κ₁"),
    "strength of the second kick": (r"$\kappa_2$", "κ₂"),
    "mean strength κ̄": (r"$\bar\kappa$", "κ̄"),
    "amplitude Δκ of the strengths": (r"$\Delta\kappa$", "Δκ"),
    "strength K of the kicks at integer times": ("$K$", "K"),
    "strength Kα of the kicks delayed by τ": (r"$K_\alpha$", "Kα"),
}


def symbols(axes, plain=False):
    """Return the symbol of each axis of a plane, or the description of an axis without a symbol.

    axes : {name: description}. plain : True for plain text, False for TeX.
    """
    return [_SYMBOLS.get(text, (text, text))[plain] for text in axes.values()]


def of_two_kicks(dataset):
    """Return True for the plane of two kicks, which some parts of figures require."""
    return plane_of(dataset.attrs) == two_kicks()


def whole_of(dataset):
    """Return the sum of ω and its image under the plane's symmetries, or 0 if there is no image."""
    return max(shift for *_, shift in plane_of(dataset.attrs).symmetries)


def in_plane(dataset):
    """Return the two coordinates or variables that give the position of a dataset in its plane."""
    return [dataset[name] for name in plane_of(dataset.attrs).axes]


def label_plane(axes, dataset):
    """Label the axes and give them equal scales; if rays end at 180°, show only the upper half."""
    xlabel, ylabel = symbols(plane_of(dataset.attrs).axes)
    axes.set(xlabel=xlabel, ylabel=ylabel, aspect="equal")
    if "angle" in dataset and dataset.angle[-1] <= 180:
        axes.set_ylim(0, None)


def outline(curve, factor=1):
    """Return both coordinates of a curve on rays, times a factor, for all angles of the plane.

    If the rays of the curve end at 180°, the other half is (-x, -y), by symmetry.
    """
    x, y = (factor * part for part in in_plane(curve))
    if curve.angle[-1] > 180:
        return x.values, y.values
    return [np.concatenate([part, -part, part[..., :1]], axis=-1) for part in (x, y)]


def fill_inside(axes, barrier, **style):
    """Fill the region where barriers exist, except near rays without an answer."""
    axes.fill(*np.nan_to_num(outline(barrier)), facecolor=INSIDE, zorder=0.5, **style)
