"""The portrait of one forcing, with what decides the verdict."""

import matplotlib.pyplot as plt
import numpy as np

from workflows.figures.style import cell, dots


def draw_verdict(portrait):
    """Draw a phase portrait with the circle that is a barrier, or with an orbit that escapes."""
    escapes = "escaping_y" in portrait
    figure, panels = plt.subplots(
        1, 1 + escapes, figsize=(6 + 6 * escapes, 6.2), layout="constrained", squeeze=False
    )
    axes = panels[0, 0]
    axes.plot(portrait.x.values.ravel(), cell(portrait.y.values.ravel()), **dots("0.3", 0.9))
    if "circle_x" in portrait:
        stride = max(1, portrait.theta.size // 4096)
        x, y = portrait.circle_x.values[::stride] % 1, cell(portrait.circle_y.values[::stride])
        order = np.argsort(x)
        x, y = x[order], y[order]
        # One point more at each end, so that the period is covered from 0 to 1.
        x, y = np.r_[x[-1] - 1, x, x[0] + 1], np.r_[y[-1], y, y[0]]
        axes.plot(x, y, color="#D55E00", lw=1.8, label=rf"$\omega = {portrait.omega}$")
    if escapes:
        time = np.arange(portrait.time.size)
        x, y = portrait.escaping_x.values, portrait.escaping_y.values
        size = 1.5 + 12 / np.sqrt(time.size)  # a few points are lost among the portrait's
        axes.plot(x % 1, cell(y), **dots("#D55E00", size))
        axes.plot([], [], label="orbit that escapes", **dots("#D55E00", 9))
        panels[0, 1].plot(time, y, color="#D55E00", lw=0.3, marker=".", ms=size, rasterized=True)
        panels[0, 1].set(xlabel="step $n$", ylabel="$y_n$ of the orbit that escapes", box_aspect=1)
        panels[0, 1].xaxis.get_major_locator().set_params(integer=True)
    axes.set(xlim=(0, 1), ylim=(-0.25, 0.75), xlabel="$x$ (turns)", ylabel="$y$ (mod 1)")
    axes.set_aspect("equal")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    kappa1, kappa2 = portrait.kappa
    figure.suptitle(rf"$(\kappa_1, \kappa_2)$ = ({kappa1}, {kappa2}): {portrait.answer}")
    return figure
