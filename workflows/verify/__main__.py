"""Is every number in the store still what was written?

All chunks of a run, or of all runs in a folder, are read and compared with their checksums. With
--repair damaged tiles become missing: the next run of the command that computed them computes them
again, and no others. With --proofs what is called proved is compared with the certificates, and
these are checked by a second program.

The exit code is 1 if damage is found and not repaired.
"""

import sys
from contextlib import nullcontext

import click

from workflows.shared.cli import command, flag, place_options, real


def examine(path, place, repair, proofs, longest):
    """Print what is damaged in the cubes of the run in a folder; return in how many tiles."""
    from pipeline.store import driving, names, verify
    from pipeline.sweep.progress import plural

    n_damaged = 0
    with driving(place) if repair else nullcontext():
        for name in names(place):
            damaged = list(verify(place, name, repair))
            n_damaged += len(damaged)
            words = f"{plural(len(damaged), 'tile')} damaged" if damaged else "sound"
            click.echo(f"{path}{name}: {words}")
            for index, what in damaged:
                click.echo(f"  {f'tile {index}: {what}' if index else what}")
        if proofs:
            from workflows.verify.certified import verify_proofs

            n_damaged += verify_proofs(path, place, longest, repair)
    return n_damaged


@command(default_map={"out": "out"})
@flag("--repair", "Mark what is damaged as missing, to be computed again.")
@flag("--proofs", "Check certificates too, with the extra `proof`.")
@real("--longest", 60, 0, 1e9, "CPU seconds: certificates that take longer are not checked.")
@place_options
def main(out, store, repair, proofs, longest):
    from workflows.shared.run import runs_of

    if proofs:
        from nasm.proofs.barrier import need_flint

        need_flint()
    n_damaged = 0
    with runs_of(out, store) as runs:
        for path, place in runs.items():
            n_damaged += examine(path, place, repair, proofs, longest)
    if n_damaged:
        again = "run again the commands that computed these cubes"
        click.echo(f"repaired: now {again}" if repair else f"add --repair, then {again}", err=True)
    sys.exit(bool(n_damaged) and not repair)
