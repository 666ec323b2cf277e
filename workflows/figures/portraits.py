"""The phase portraits of Figs. 1 and 2, and their captions."""

from workflows.figures.style import (
    COLOURS,
    VERMILION,
    canvas,
    colour_of,
    dots,
    in_column,
    outer_legend,
    panels,
)

_KICKS_SHOWN = 80


def draw_kicks(portraits):
    """Draw T_{κ1κ2}, T_{κ2κ1}, the nonautonomous map, and one orbit in the plane and over time."""
    figure = canvas(9, 11, 11 / 9)
    places = [["first", "second"], ["raw", "island"], ["time", "time"]]
    drawn = figure.subplot_mosaic(places, height_ratios=[1, 1, 0.4])
    first, second = (portraits.isel(forcing=i) for i in (0, 1))
    map_of = r"$\mathcal{T}_{\kappa_1\kappa_2}$, $(\kappa_1, \kappa_2) ="
    _draw_cell(drawn["first"], first.x, first.y, f"{map_of} {_forcing(first)}$")
    _draw_cell(drawn["second"], second.x, second.y, f"{map_of} {_forcing(second)}$")
    title = rf"nonautonomous map, $(\kappa_1, \kappa_2) = {_forcing(first)}$"
    _draw_cell(drawn["raw"], portraits.kick_x, portraits.kick_y, title)
    island, time = drawn["island"], drawn["time"]
    around, y, kick = _island_orbit(portraits)
    for parity, colour, words in ((0, COLOURS[0], "even"), (1, VERMILION, "odd")):
        island.plot(around[parity::2], y[parity::2], label=words, **dots(colour, 4))
        shown = slice(parity, _KICKS_SHOWN, 2)
        time.plot(kick[shown], around[shown], "o", color=colour, ms=2 if in_column() else 4)
    time.plot(kick[:_KICKS_SHOWN], around[:_KICKS_SHOWN], color="0.75", lw=0.6, zorder=0)
    time.set(xlabel="kick $n$", ylabel=r"$\hat x_n$", ylim=(-0.25, 0.75))
    time.set_title("The orbit in (d) over time")
    island.set_title(rf"orbit of $({around[0]:g}, {y[0]:g})$ in (c), magnified in $y$")
    island.set(xlabel=r"$\hat x$: $x$ in $[-1/4, 3/4)$", ylabel="$y$", box_aspect=1)
    island.set(xlim=(-0.25, 0.75))
    outer_legend(figure, 2, 2, title="(d) and (e): kicks", markerscale=3)
    return figure


def _island_orbit(portraits):
    """Return x, y and kick of the orbit, with x reduced to [-1/4, 3/4) so that no island is cut."""
    x, y, kick = (portraits[name].values for name in ("island_x", "island_y", "kick"))
    return (x + 0.25) % 1 - 0.25, y, kick


def kicks_caption(portraits):
    first, second = (portraits.isel(forcing=i) for i in (0, 1))
    around, y, kick = _island_orbit(portraits)
    even, odd = abs(around[::2]).max(), abs(around[1::2] - 0.5).max()
    return (
        f"Phase portraits of T at (κ1, κ2) = {_forcing(first)} (a) and {_forcing(second)} (b), "
        f"{portraits.orbit.size} orbits of {portraits.step.size - 1} steps (of two kicks, κ1 "
        "first) "
        f"from x = 0 and x = 1/2; and of the nonautonomous map at {_forcing(first)} (c), from the "
        f"same starts, with all {kick.size - 1} kicks drawn. (d) and (e): the orbit of "
        f"({around[0]:g}, {y[0]:g}) under the nonautonomous map, in blue after even kicks, in "
        f"vermilion after odd ones. After even kicks it stays within {even:.2f} of x = 0, in the "
        f"island around (0, 1/2) in (a); after odd kicks within {odd:.2f} of x = 1/2, in the "
        "island around (1/2, 1/2) in (b)."
    )


def draw_symmetry(portraits):
    """Draw four portraits related by symmetries, with three orbits and their images in colour."""
    figure, drawn = panels(2, 2, 9, 9.3, stack=False, sharex=True, sharey=True)
    forcings = [portraits.isel(forcing=i) for i in range(4)]
    for axes, here in zip(drawn, forcings, strict=True):
        axes.plot(here.x.values.ravel(), here.y.values.ravel(), **dots("0.5", 1.0))
        title = rf"$(\kappa_1, \kappa_2) = {_forcing(here)}$"
        _draw_cell(axes, here.marked_x, here.marked_y, title, 3.5)
        axes.label_outer()
    first = portraits.isel(forcing=0, step=0)
    for i, (x, y) in enumerate(zip(first.marked_x.values, first.marked_y.values, strict=True)):
        drawn[0].plot([], [], label=f"orbit of $({x:g}, {y:g})$ in (a)", **dots(colour_of(i), 9))
    figure.suptitle("Four portraits related by symmetry; each colour marks an orbit and its images")
    outer_legend(figure, 3, 2)
    return figure


def symmetry_caption(portraits):
    forcings = [portraits.isel(forcing=i) for i in range(4)]
    marked = zip(portraits.marked_x[0, 0].values, portraits.marked_y[0, 0].values, strict=True)
    return (
        f"Phase portraits of T at (κ1, κ2) = {', '.join(map(_forcing, forcings))} (a-d), "
        f"{portraits.orbit.size} orbits of {portraits.step.size - 1} steps. Panels (b), (c) and "
        "(d) are panel (a) shifted by (1/2, 0), (1/2, 1/2) and (0, 1/2). In colour: the orbits of "
        f"{', '.join(f'({x:g}, {y:g})' for x, y in marked)} in (a), and the orbits of their "
        "images in the other panels, iterated independently; they agree with the symmetries to "
        f"{float(portraits.difference.max()):.0e}."
    )


def _draw_cell(axes, x, y, title, points=1.2):
    """Draw each orbit in its own colour; the dimensions of x and y are (step, orbit)."""
    for i in range(x.shape[1]):
        axes.plot(x[:, i], y[:, i], **dots(colour_of(i), points))
    axes.set(xlabel="$x$", ylabel="$y$", xlim=(0, 1), ylim=(0, 1), aspect="equal", title=title)


def _forcing(portrait):
    """Return (κ1, κ2) as text that is valid in TeX and in captions."""
    return f"({float(portrait.kappa1):g}, {float(portrait.kappa2):g})"
