"""Is every number in the store still what was written?

All chunks are read and compared with their checksums. With --repair the damaged tiles are deleted,
so that the next run of the workflow that computed them computes them again, and no others.
"""

import sys
from contextlib import nullcontext

import click

from workflows.parts.cli import command, explained, out_option, store_option


@click.command(context_settings=HELP)
@click.option("--repair", is_flag=True, help="Delete what is damaged, to be computed again.")
@store_option
@run_option
def main(out, place, repair):
    """Verify all cubes of a store; exit code 1 if damage is found and not repaired."""
    with explained(place):
        from pipeline.store import driving
        from pipeline.verify import names

        cubes = names(place)
        with driving(place) if repair else nullcontext():
            n_damaged = sum(check(place, name, repair) for name in cubes)
    if n_damaged and not repair:
        click.echo("to have the damaged tiles computed again, add --repair", err=True)
        sys.exit(1)
    if n_damaged:
        click.echo("repaired: now run the workflows again that computed these cubes", err=True)


def check(place, name, repair):
    """Verify a cube and say what is damaged; returns in how many places."""
    from pipeline.faults import StoreError
    from pipeline.verify import committed, free, verify

    try:
        tiles = committed(place, name)
    except StoreError as error:
        click.echo(f"{name}: {error}")
        return 1
    damaged = {}
    with click.progressbar(length=1 + len(tiles), label=name, file=sys.stderr) as progress:
        for index, what in verify(place, name, tiles):
            progress.update(1)
            if what:
                damaged[index] = what
    click.echo(f"{name}: {len(tiles)} tiles, {len(damaged)} damaged")
    for index, what in damaged.items():
        click.echo(f"  {f'tile {index}: {what}' if index else f'damaged: {what}'}")
        if repair:
            free(place, name, index)
    return len(damaged)


if __name__ == "__main__":
    main()
