"""The rotation number over phase space, and how many of its digits are reliable."""

import numpy as np

from workflows.figures.style import panels

_FEW_DIGITS = "0.85"


def draw_frequency_map(cube):
    """Draw ω of each start, grey if few digits are reliable, and the number of reliable digits."""
    wide, tall = (float(np.ptp(cube[f"{name}_bounds"].values)) for name in "xy")
    height = min(max(tall / wide, 0.4), 2)
    least = cube.attrs["regular_digits"]
    figure, (left, right) = panels(1, 2, 11, 1.2 + 4.2 * height, sharex=True, sharey=True)
    place, look = (cube.x, cube.y), {"rasterized": True}
    left.set_facecolor(_FEW_DIGITS)
    image = left.pcolormesh(*place, cube.omega, cmap="viridis", **look)
    few = f"grey: fewer than {least} digits"
    figure.colorbar(image, ax=left, label=rf"$\omega$ (turns per step); {few}")
    image = right.pcolormesh(*place, cube.digits, cmap="magma", vmin=0, vmax=14, **look)
    bar = figure.colorbar(image, ax=right, label=r"reliable digits of $\omega$")
    bar.ax.axhline(least, color="white", lw=1)
    left.set_title("rotation number")
    right.set_title("regularity")
    for axes in (left, right):
        axes.set(xlabel="$x$", ylabel="$y$")
    return figure


def frequency_map_caption(cube):
    kappa, n_max, least = (cube.attrs[name] for name in ("kappa", "n_max", "regular_digits"))
    kicks = np.atleast_1d(kappa)
    shown = ", ".join(f"{strength:g}" for strength in kicks[:4]) + ", …" * (kicks.size > 4)
    regular = float(cube.omega.notnull().mean())
    return (
        f"Frequency map of the forcing ({shown}): rotation number of {cube.omega.size} orbits of "
        f"{n_max} steps, by weighted Birkhoff averages. {100 * regular:.1f}% are regular: the "
        f"averages over the whole orbit and over its halves share at least {least} "
        "digits (white line on the right colour bar). Regular orbits lie on invariant circles or "
        "in islands, or stay close to them for all steps."
    )
