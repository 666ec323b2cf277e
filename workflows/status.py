"""How far is a sweep that runs, or that was stopped? Read from the store alone, without a lock."""

import re
import sys

import click

from workflows.parts.cli import command, place_options


@command()
@place_options
def main(place):
    """The state of all cubes of a store: tiles done, failures with reasons, rate, time left."""
    from pipeline.store import status
    from workflows.parts.run import explained

    damaged = False
    with explained(place):
        for state in status(place):
            click.echo(f"{state.name}: {described(state, wanted(place, state))}")
            for index, reason in state.reasons.items():
                click.echo(f"  tile {index} failed: {reason}")
            if state.failed > len(state.reasons):
                click.echo(f"  ... and {state.failed - len(state.reasons)} more")
            damaged |= bool(state.damage)
    sys.exit(damaged)


def wanted(place, state):
    """Return how many tiles of the cube are wanted; None if that is not known yet."""
    level = re.fullmatch(r"escape_level(\d+)", state.name)
    if (not level and state.name != "direct_boundary") or state.damage:
        return state.tiles
    from workflows.parts import direct, plane

    if level:
        return plane.tiles_wanted(place, int(level[1]))
    return direct.tiles_wanted(place, state.name)


def described(state, wanted):
    """Put the State of a cube, of which so many tiles are wanted, into words."""
    from pipeline.sweep.progress import duration

    if state.damage or not state.tiles:
        return state.damage or "written whole"
    if wanted is None:
        words = f"{state.done} tiles, of {state.tiles} at most"
    else:
        words = f"{state.done} of {wanted} tiles"
    if state.failed:
        words += f", {state.failed} failed when last tried"
    if wanted is not None and state.done < wanted and state.rate > 0:
        left = duration((wanted - state.done) / state.rate)
        words += f"; {state.rate:.3g} tiles/s, about {left} left at that rate"
    return words


if __name__ == "__main__":
    main()
