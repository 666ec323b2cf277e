"""Progress of a sweep that is running or was stopped, read from the store without a lock.

Prints, for each cube of a run or of all runs in a folder, the number of tiles done, the failures
with their reasons, the rate, and the time remaining.
"""

import sys

import click

from workflows.shared.cli import command, place_options


def tell(path, state):
    """Print the State of a cube, which belongs to the run in the folder `path`."""
    from pipeline.store import printable
    from pipeline.sweep.progress import duration, plural

    text = state.damage or "complete"
    if state.tiles and not state.damage:
        text = f"{state.done} of {plural(state.tiles, 'tile')}"
        if state.lost:
            text += f", {state.lost} computed but since lost"
        if state.failed:
            text += f", {state.failed} failed at the last attempt"
        if state.done < state.tiles and state.rate > 0:
            remaining = duration((state.tiles - state.done) / state.rate)
            text += f"; {state.rate:.3g} tiles/s, about {remaining} remaining"
    click.echo(printable(f"{path}{state.name}: {text}"))
    for index, reason in state.reasons.items():
        click.echo(f"  tile {index} failed: {reason}")
    if state.failed > len(state.reasons):
        click.echo(f"  ... and {state.failed - len(state.reasons)} more")


@command(default_map={"out": "out"})
@place_options
def main(out, store):
    from pipeline.store import status
    from workflows.shared.places import runs_of

    damaged = False
    with runs_of(out, store) as runs:
        for path, place in runs.items():
            for state in status(place):
                tell(path, state)
                damaged |= bool(state.damage)
    sys.exit(damaged)
