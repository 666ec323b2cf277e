"""Orbits in phase space, coloured by rotation number, for `ask` and the explorer."""

import numpy as np

from workflows.figures.colours import CHAOTIC, LIGHTEST, N_OF_OMEGA

_SURVIVORS = 48  # maximum number of points drawn for the longest-lived start


def ends(orbits):
    """Return ω of the first and last colours: 0 and P/2, or the extremes of ω in a zoomed view.

    orbits : Dataset returned by `workflows.shared.phase_space.portraits`.
    """
    near = orbits.near.values[np.isfinite(orbits.near.values)]
    if orbits.attrs["box"][2:] == [1.0, 1.0] or near.size == 0:
        return 0.0, len(orbits.attrs["kappa"]) / 2
    low, high = float(near.min()), float(near.max())
    return low, max(high, low + 1e-9)  # in an island all ω are equal


def places(orbits):
    """Return the colour of each orbit, from 0 to N_OF_OMEGA - 1, or -1 if the orbit is chaotic."""
    low, high = ends(orbits)
    share = (orbits.near.values - low) / (high - low) * (N_OF_OMEGA - 1)
    return np.where(np.isfinite(share), np.rint(np.nan_to_num(share)), -1).astype(int)


def draw_orbits(axes, orbits):
    """Draw the points of the orbits, chaotic ones in grey behind the others, and a colour bar."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap, to_hex

    from workflows.figures.style import in_column

    shades = [*map(to_hex, colormaps["viridis"](np.linspace(0, LIGHTEST, N_OF_OMEGA)))]
    omega = orbits.near.values[orbits.which.values]
    order = np.argsort(np.isfinite(omega), kind="stable")
    (low, high), size = ends(orbits), 0.6 if in_column() else 1.2
    look = {"vmin": low, "vmax": high, "plotnonfinite": True, "rasterized": True, "linewidths": 0}
    look |= {"marker": ".", "cmap": ListedColormap(shades).with_extremes(bad=CHAOTIC)}
    x, y = orbits.x.values[order], orbits.y.values[order]
    scale = axes.scatter(x, y, size**2, omega[order], **look)
    label = rf"$\omega$ of the orbit, in $[0, {len(orbits.attrs['kappa']) / 2:g}]$; grey: chaotic"
    location = "bottom" if in_column() else "right"
    axes.figure.colorbar(scale, ax=axes, label=label, shrink=0.8, location=location)


def draw_survivor(axes, x, y, **style):
    """Draw the longest-lived start's orbit as separate dots, to show that it is not a circle.

    x, y : coordinates of the orbit's points, in any order.
    """
    from workflows.figures.style import in_column

    spread = np.argsort(x % 1)[:: 1 + x.size // _SURVIVORS]
    size = 2.5 if in_column() else 4
    dots = {"ls": "", "marker": "o", "ms": size, "mfc": "black", "mec": "white", "mew": 0.5}
    axes.plot(np.asarray(x)[spread], np.asarray(y)[spread], zorder=3, **dots, **style)
