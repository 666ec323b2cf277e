"""Is the store intact? Do its certificates prove what it claims?

All chunks of a run, or of all runs in a folder, are read and compared with their checksums. With
--repair, damaged tiles are marked as missing: the next run of the command that computed them
recomputes only these tiles. Metadata and coordinates are compared with their digests; if they were
changed, no tile is touched, and the next run of the command restores them. With --proofs, proved
results are compared with their certificates, which a second program checks.

The exit code is 1 if damage is found and not repaired.
"""

import sys
from contextlib import nullcontext

import click

from workflows.shared.cli import command, flag, place_options, real

_NO_DIGESTS = (
    "its metadata cannot be checked, so its tiles are not repaired: it was written by an earlier "
    "version, which stored no digests; to add them, rerun the command that computed it"
)


def examine(path, place, repair, proofs, longest):
    """Print which tiles and metadata in the cubes of a run are damaged.

    Return the number of damaged tiles, counting the metadata of a cube as one tile, and the number
    of those that `repair` marks as missing.
    """
    from pipeline.store import driver_lock, has_digests, names, printable, verify
    from pipeline.sweep.progress import plural

    n_damaged = n_repairable = 0
    with driver_lock(place) if repair else nullcontext():
        for name in names(place):
            damaged = list(verify(place, name, repair))
            is_whole, is_known = all(index for index, _ in damaged), has_digests(place, name)
            n_damaged += len(damaged)
            n_repairable += len(damaged) if is_whole and is_known else 0
            words = f"{plural(len(damaged), 'tile')} damaged" if is_whole else "damaged"
            click.echo(printable(f"{path}{name}: {words if damaged else 'sound'}"))
            for index, what in damaged:
                click.echo(printable(f"  {f'tile {index}: {what}' if index else what}"))
            if is_whole and not is_known:
                click.echo(f"  {_NO_DIGESTS}")
        if proofs:
            from workflows.verify.certified import verify_proofs

            n_wrong, n_freeable = verify_proofs(path, place, longest, repair)
            n_damaged, n_repairable = n_damaged + n_wrong, n_repairable + n_freeable
    return n_damaged, n_repairable


@command(default_map={"out": "out"})
@flag("--repair", "Mark damaged tiles as missing, to be recomputed.")
@flag("--proofs", "Check certificates too; needs the extra `proof`.")
@real(
    *("--max-cpu-seconds", 60, 0, 1e9),
    "CPU time limit per certificate; those predicted to take longer are not checked.",
)
@place_options
def main(out, store, repair, proofs, max_cpu_seconds):
    from workflows.shared.places import runs_of

    if proofs:
        from nasm.proofs.barrier import need_flint

        need_flint()
    n_damaged = n_repairable = 0
    with runs_of(out, store) as runs:
        for path, place in runs.items():
            damaged, repairable = examine(path, place, repair, proofs, max_cpu_seconds)
            n_damaged, n_repairable = n_damaged + damaged, n_repairable + repairable
    n_left = n_damaged - n_repairable if repair else n_damaged
    if n_damaged:
        again = "rerun the commands that computed these cubes"
        if repair:
            click.echo(f"{'not everything is ' if n_left else ''}repaired: now {again}", err=True)
        else:
            click.echo(f"add --repair, then {again}" if n_repairable else again, err=True)
    sys.exit(n_left > 0)
