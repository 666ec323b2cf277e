"""Phase portraits, Figs. 1 and 2, with their captions."""

import matplotlib.pyplot as plt

from workflows.figures.style import CIRCLE_COLOURS, dots

BLUE, VERMILION = CIRCLE_COLOURS[:2]
_KICKS_SHOWN = 80


def draw_kicks(portraits):
    """Draw T_{κ1κ2}, T_{κ2κ1}, the nonautonomous map, and one orbit: in the plane, in time."""
    figure = plt.figure(figsize=(9, 11), layout="constrained")
    places = [["first", "second"], ["raw", "island"], ["time", "time"]]
    panels = figure.subplot_mosaic(places, height_ratios=[1, 1, 0.4])
    for name, i, letter in (("first", 0, "a"), ("second", 1, "b")):
        here = portraits.isel(forcing=i)
        _draw_orbits(panels[name], here.x, here.y)
        panels[name].set_title(
            rf"({letter}) $\mathcal{{T}}_{{\kappa_1\kappa_2}}$, {_forcing(here)}"
        )
    first = portraits.isel(forcing=0)
    _draw_orbits(panels["raw"], portraits.kick_x, portraits.kick_y)
    panels["raw"].set_title(f"(c) nonautonomous map, {_forcing(first)}")
    x, y, kick = portraits.island_x.values, portraits.island_y.values, portraits.kick.values
    for parity, colour, words in ((0, BLUE, "even"), (1, VERMILION, "odd")):
        around = (x[parity::2] + 0.25) % 1 - 0.25
        panels["island"].plot(around, y[parity::2], label=words, **dots(colour, 4))
        # In time x is shown around 0, where one of the islands is.
        centred = (x[:_KICKS_SHOWN] + 0.25) % 1 - 0.25
        panels["time"].plot(
            kick[parity:_KICKS_SHOWN:2], centred[parity::2], "o", color=colour, ms=4
        )
    panels["time"].plot(kick[:_KICKS_SHOWN], centred, color="0.75", lw=0.6, zorder=0)
    panels["island"].legend(title="kicks", markerscale=3, loc="upper center", ncols=2)
    panels["island"].set_title(rf"(d) its orbit of $({x[0]:g}, {y[0]:g})$, zoomed in $y$")
    panels["time"].set(xlabel="kick $n$", ylabel=r"$\hat x_n$", ylim=(-0.25, 0.75))
    panels["time"].set_title("The orbit of (d) in time")
    for name in ("first", "second", "raw"):
        _label_cell(panels[name])
    panels["island"].set(xlabel=r"$\hat x$", ylabel="$y$", xlim=(-0.25, 0.75), box_aspect=1)
    panels["island"].margins(y=0.3)
    return figure


def describe_kicks(portraits):
    """Describe `draw_kicks`."""
    first, second = (_forcing(portraits.isel(forcing=i), "({:g}, {:g})") for i in (0, 1))
    n, kicks = portraits.sizes["orbit"], portraits.sizes["kick"] - 1
    x, y = float(portraits.island_x[0]), float(portraits.island_y[0])
    even, odd = (portraits.isel(kick=slice(parity, None, 2)) for parity in (0, 1))
    distances = [
        float(abs((here.island_x - centre + 0.5) % 1 - 0.5).max())
        for here, centre in ((even, 0.0), (odd, 0.5))
    ]
    return (
        f"Phase portraits of T at (κ1, κ2) = {first} (a) and {second} (b), {n} orbits of "
        f"{portraits.sizes['step'] - 1} steps from x = 0 and x = 1/2, and of the nonautonomous map "
        f"at {first} (c), the same starts and {kicks} kicks, all drawn; κ1 is the first kick. "
        f"(d): the orbit of ({x:g}, {y:g}) under the nonautonomous map, even kicks blue, odd ones "
        f"vermilion: the even ones stay within {distances[0]:.2f} of x = 0, in the island of "
        f"(0, 1/2) of (a), the odd ones within {distances[1]:.2f} of x = 1/2, in that of "
        "(1/2, 1/2) of (b)."
    )


def draw_symmetry(portraits):
    """Draw four forcings related by symmetries, with the images of three orbits in colours."""
    figure, panels = plt.subplots(
        2, 2, figsize=(9, 9.3), layout="constrained", sharex=True, sharey=True
    )
    for axes, i, letter in zip(panels.flat, range(4), "abcd", strict=True):
        here = portraits.isel(forcing=i)
        axes.plot(here.x.values.ravel(), here.y.values.ravel(), **dots("0.5", 1.0))
        for orbit, colour in enumerate(CIRCLE_COLOURS[: portraits.sizes["marked"]]):
            x, y = here.marked_x.isel(marked=orbit), here.marked_y.isel(marked=orbit)
            axes.plot(x, y, **dots(colour, 3.5))
        axes.set_title(f"({letter}) {_forcing(here)}")
        _label_cell(axes)
        axes.label_outer()
    return figure


def describe_symmetry(portraits):
    """Describe `draw_symmetry`."""
    forcings = [_forcing(portraits.isel(forcing=i), "({:g}, {:g})") for i in range(4)]
    starts = ", ".join(
        f"({float(portraits.marked_x[0, 0, i]):g}, {float(portraits.marked_y[0, 0, i]):g})"
        for i in portraits.marked.values
    )
    n, steps = portraits.sizes["orbit"], portraits.sizes["step"] - 1
    return (
        f"Phase portraits of T at (κ1, κ2) = {', '.join(forcings)} (a-d), {n} orbits of {steps} "
        "steps. Panels b, c and d are panel a moved by (1/2, 0), (1/2, 1/2) and (0, 1/2). The "
        f"orbits of {starts} in a are in colours, and so are the orbits of their images elsewhere, "
        "iterated on their own: they stay where the symmetries put them to "
        f"{float(portraits.difference.max()):.0e}."
    )


def _draw_orbits(axes, x, y):
    for orbit in range(x.sizes["orbit"]):
        colour = CIRCLE_COLOURS[orbit % len(CIRCLE_COLOURS)]
        axes.plot(x.isel(orbit=orbit), y.isel(orbit=orbit), **dots(colour, 1.2))


def _forcing(portrait, template=r"$(\kappa_1, \kappa_2) = ({:g}, {:g})$"):
    return template.format(float(portrait.kappa1), float(portrait.kappa2))


def _label_cell(axes):
    axes.set(xlabel="$x$", ylabel="$y$", xlim=(0, 1), ylim=(0, 1), aspect="equal")
