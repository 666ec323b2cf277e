"""How far is a sweep that runs, or that was stopped? Read from the store alone, without a lock.

Of all cubes: tiles done, failures with reasons, rate, time left.
"""

import sys

import click

from workflows.shared.cli import command, place_options


@command()
@place_options
def main(out, store):
    from pipeline.store import status
    from pipeline.sweep.progress import duration, plural
    from workflows.shared.run import cubes_of

    damaged = False
    with cubes_of(out, store) as (place, _):
        for state in status(place):
            words = state.damage or "written whole"
            if state.tiles and not state.damage:
                words = f"{state.done} of {plural(state.tiles, 'tile')}"
                if state.failed:
                    words += f", {state.failed} failed when last tried"
                if state.done < state.tiles and state.rate > 0:
                    left = duration((state.tiles - state.done) / state.rate)
                    words += f"; {state.rate:.3g} tiles/s, about {left} left at that rate"
            click.echo(f"{state.name}: {words}")
            for index, reason in state.reasons.items():
                click.echo(f"  tile {index} failed: {reason}")
            if state.failed > len(state.reasons):
                click.echo(f"  ... and {state.failed - len(state.reasons)} more")
            damaged |= bool(state.damage)
    sys.exit(damaged)
