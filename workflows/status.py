"""How far is a sweep that runs, or that was stopped?

Read from the store alone, while a driver is at work or when it is dead: nothing is locked, and
nothing is written but the pictures of --draw.
"""

import sys
import time
from math import isfinite

import click

from workflows.parts.cli import command, explained, out_option, store_option


@click.command(context_settings=HELP)
@click.option("--draw", is_flag=True, help="Draw what is there so far into OUT.")
@store_option
@run_option
def main(out, place, draw):
    """The state of all cubes of a store: tiles, failures, CPU time, rate, time left."""
    with explained(place):
        from pipeline.status import driver
        from pipeline.verify import names

        cubes = names(place)
        at_work = driver(place)
        click.echo(f"{place}: {f'a driver is at work ({at_work})' if at_work else 'no driver'}")
        if not cubes:
            click.echo("no cubes yet")
        damaged = sum(not told(out, place, name, bool(at_work), draw) for name in cubes)
    sys.exit(1 if damaged else 0)


def told(out, place, name, at_work, draw):
    """Print the state of a cube; False if its metadata are damaged."""
    from pipeline.faults import StoreError
    from pipeline.status import state

    try:
        found = state(place, name)
    except StoreError as error:
        click.echo(f"{name}: {error}")
        return False
    click.echo(f"{name}: {described(found, at_work)}")
    for index, reason in found.reasons.items():
        click.echo(f"  tile {index} failed: {reason}")
    if found.failed > len(found.reasons):
        click.echo(f"  ... and {found.failed - len(found.reasons)} more")
    if draw:
        draw_cube(out, place, name)
    return True


def described(state, at_work):
    """The state of a cube in words."""
    size = f"{state.size / 1e6:.3g} MB" if state.size >= 1e6 else f"{state.size / 1e3:.3g} kB"
    if not state.tiles:
        return f"written whole; {size}"
    parts = [f"{state.done} of {state.tiles} tiles"]
    if state.missing:
        parts[0] += f" ({100 * state.done / state.tiles:.1f}%), {state.missing} missing"
        if state.failed:
            parts[0] += f", of which {state.failed} failed when last tried"
    parts.append(f"{'about ' if state.sampled else ''}{state.cpu_seconds:.3g} CPU s")
    parts.append(size)
    if isfinite(state.last):
        parts.append(f"last tile {duration(max(0.0, time.time() - state.last))} ago")
    if isfinite(state.rate):
        parts.append(f"{state.rate:.3g} tiles/s before it")
    if at_work and state.missing and isfinite(state.seconds_left):
        parts.append(f"about {duration(state.seconds_left)} left at that rate")
    return "; ".join(parts)


def duration(seconds):
    """In the largest unit of which there are two or more."""
    for unit, length in (("days", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


def draw_cube(out, place, name):
    """Draw a cube of a kind that can be drawn."""
    import os

    from pipeline import store
    from workflows.figures.status import caption, draw_so_far
    from workflows.figures.style import save

    cube = store.read(place, name)
    figure = draw_so_far(cube)
    if figure is None:
        click.echo("  (neither a plane nor rays: not drawn)")
        return
    figure.axes[0].set_title(name)
    os.makedirs(out, exist_ok=True)
    click.echo(f"  figure: {', '.join(save(figure, out, f'status_{name}', caption(cube, name)))}")


if __name__ == "__main__":
    main()
