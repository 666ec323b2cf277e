"""How far is a sweep that runs, or that was stopped? Read from the store alone, without a lock.

Of all cubes of a run, or of all runs in a folder: tiles done, failures with reasons, rate, time
left.
"""

import sys

import click

from workflows.shared.cli import command, place_options


def tell(path, state):
    """Print the State of a cube of the run in a folder."""
    from pipeline.store import printable
    from pipeline.sweep.progress import duration, plural

    words = state.damage or "complete"
    if state.tiles and not state.damage:
        words = f"{state.done} of {plural(state.tiles, 'tile')}"
        if state.lost:
            words += f", {state.lost} computed and lost since"
        if state.failed:
            words += f", {state.failed} failed when last tried"
        if state.done < state.tiles and state.rate > 0:
            left = duration((state.tiles - state.done) / state.rate)
            words += f"; {state.rate:.3g} tiles/s, about {left} left at that rate"
    click.echo(printable(f"{path}{state.name}: {words}"))
    for index, reason in state.reasons.items():
        click.echo(f"  tile {index} failed: {reason}")
    if state.failed > len(state.reasons):
        click.echo(f"  ... and {state.failed - len(state.reasons)} more")


@command(default_map={"out": "out"})
@place_options
def main(out, store):
    from pipeline.store import status
    from workflows.shared.run import runs_of

    damaged = False
    with runs_of(out, store) as runs:
        for path, place in runs.items():
            for state in status(place):
                tell(path, state)
                damaged |= bool(state.damage)
    sys.exit(damaged)
