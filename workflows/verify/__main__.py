"""Is every number in the store still what was written?

All chunks are read and compared with their checksums. With --repair damaged tiles become missing:
the next run of the command that computed them computes them again, and no others. With --proofs
what is called proved is compared with the certificates, and these are checked by a second program.

The exit code is 1 if damage is found and not repaired.
"""

import sys
from contextlib import nullcontext

import click

from workflows.shared.cli import command, flag, place_options, real


@command()
@flag("--repair", "Mark what is damaged as missing, to be computed again.")
@flag("--proofs", "Check certificates too, with the extra `proof`.")
@real("--longest", 60, 0, 1e9, "CPU seconds: certificates that take longer are not checked.")
@place_options
def main(out, store, repair, proofs, longest):
    from pipeline.store import driving, verify
    from pipeline.sweep.progress import plural
    from workflows.shared.run import cubes_of

    n_damaged = 0
    with cubes_of(out, store) as (place, names), driving(place) if repair else nullcontext():
        for name in names:
            damaged = list(verify(place, name, repair))
            n_damaged += len(damaged)
            words = f"{plural(len(damaged), 'tile')} damaged" if damaged else "sound"
            click.echo(f"{name}: {words}")
            for index, what in damaged:
                click.echo(f"  {f'tile {index}: {what}' if index else what}")
        if proofs:
            from nasm.proofs.barrier import need_flint

            need_flint()
            from workflows.verify.certified import verify_proofs

            n_damaged += verify_proofs(place, longest, repair)
    if n_damaged:
        again = "run again the commands that computed these cubes"
        click.echo(f"repaired: now {again}" if repair else f"add --repair, then {again}", err=True)
    sys.exit(bool(n_damaged) and not repair)
